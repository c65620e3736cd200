"""The worked example: what its script writes, valid by other people's rules, and plausible."""

import importlib.util
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely
from geojson_pydantic import FeatureCollection

from orchid_uav.experiments.planning.reading.people import read_people
from orchid_uav.experiments.planning.reading.site import locate, people_of, zones_m
from orchid_uav.experiments.planning.reading.zones import read_zones

EXAMPLE = Path(__file__).parents[3] / "examples" / "planning"
FILES = ("people.csv", "area.geojson", "airport.geojson")


def test_the_script_writes_the_files_that_are_there(tmp_path):
    path = EXAMPLE / "make_example.py"
    spec = importlib.util.spec_from_file_location("make_example", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(tmp_path)
    assert sorted(one.name for one in tmp_path.iterdir()) == sorted(FILES)
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (EXAMPLE / name).read_bytes(), name


@pytest.mark.parametrize("name", FILES[1:])
def test_polygons_are_those_of_other_readers(name):
    text = (EXAMPLE / name).read_text(encoding="utf-8")
    collection = FeatureCollection.model_validate_json(text)
    (feature,) = collection.features
    assert feature.geometry.type == "Polygon"
    assert "made up" in feature.properties["name"]
    _, _, geometry, _ = pyogrio.raw.read(EXAMPLE / name)
    (theirs,) = shapely.from_wkb(geometry)
    assert theirs.exterior.is_ccw
    (ours,) = read_zones(EXAMPLE / name).polygons
    assert ours.equals(theirs)


def test_people_and_zones_make_a_site():
    area, airport = (read_zones(EXAMPLE / name) for name in FILES[1:])
    table = read_people(EXAMPLE / "people.csv", area)
    assert table.notes == ()  # all are inside
    site = locate(table, [area, airport])
    people = people_of(table, site)
    assert len(people.weights) == 220
    assert sum(people.weights >= 20) == 12
    assert people.weights[people.weights < 20].max() <= 6
    assert people.weights.max() <= 80
    west, south, east, north = zones_m(area, site).bounds
    assert (east - west, north - south) == pytest.approx((3000, 2500), abs=50)
    closed = zones_m(airport, site)
    assert 0.5e6 < closed.area < 1.5e6
    assert not shapely.intersects_xy(closed, people.positions_m).any()
    assert np.ptp(people.positions_m, axis=0).min() > 1500
