"""People from GeoPackage, Shapefile, FlatGeobuf and GPX, written by GDAL itself."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people

DRIVERS = {"gpkg": "GPKG", "shp": "ESRI Shapefile", "fgb": "FlatGeobuf"}
PLACES = np.array([[-62.7204, 17.3012], [-62.7199, 17.302], [-62.71, 17.3]])


def write(path: Path, geometries: Any = None, crs: str | None = "EPSG:4326", **kw: Any) -> Path:
    if geometries is None:
        geometries = shapely.points(PLACES)
    kw = {
        "field_data": [np.array([7, 8, 9], np.int32)[: len(geometries)]],
        "fields": ["People"],
    } | kw
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(geometries),
        crs=crs,
        driver=DRIVERS[path.suffix[1:]],
        **({"geometry_type": "Point"} | kw),
    )
    return path


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_people(path)
    return str(caught.value)


@pytest.mark.parametrize("suffix", DRIVERS)
def test_points_and_their_people(tmp_path, suffix):
    table = read_people(write(tmp_path / f"people.{suffix}"))
    order = np.argsort(table.weights)  # FlatGeobuf sorts by place
    assert table.on_earth
    assert np.array_equal(table.coordinates[order], PLACES[:, ::-1])
    assert table.weights[order].tolist() == [7, 8, 9]
    assert table.sources[0] == f"people.{suffix}, feature 1"
    assert table.notes == ()


def test_a_gpx_has_waypoints(tmp_path):
    path = tmp_path / "people.gpx"
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" creator="hand" '
        'xmlns="http://www.topografix.com/GPX/1/1">'
        '<wpt lat="17.3012" lon="-62.7204"><ele>3</ele><name>A</name></wpt>'
        '<wpt lat="17.302" lon="-62.7199"/></gpx>',
        encoding="utf-8",
    )
    table = read_people(path)
    assert table.coordinates.tolist() == [[17.3012, -62.7204], [17.302, -62.7199]]
    assert any("counts as one person" in note for note in table.notes)


def test_without_pyogrio_it_is_said_what_installs_it(tmp_path, monkeypatch):
    path = write(tmp_path / "people.gpkg")
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    message = refusal(path)
    assert "install" in message
    assert "pyogrio>=" in message
    assert message.count("\n") == 1


@pytest.mark.parametrize("suffix", DRIVERS)
def test_other_coordinate_systems_are_refused(tmp_path, suffix):
    path = write(tmp_path / f"people.{suffix}", crs="EPSG:32620")
    assert "convert it to WGS 84 (EPSG:4326)" in refusal(path)
    assert "EPSG:32620" in refusal(path) or "UTM" in refusal(path)


def test_a_shapefile_that_does_not_say_its_system_is_refused(tmp_path):
    path = write(tmp_path / "people.shp")
    path.with_suffix(".prj").unlink()
    assert "the coordinate system that it does not name" in refusal(path)


def test_wrong_features_are_named(tmp_path):
    geometries = [shapely.Point(-62.7, 17.3), shapely.LineString(PLACES), shapely.Point(-62.7, 95)]
    path = write(tmp_path / "people.gpkg", geometries, geometry_type="Unknown")
    message = refusal(path)
    assert "people.gpkg, feature 2: its geometry is 'LineString'" in message
    assert "people.gpkg, feature 3: 95.0 is not a latitude" in message


@pytest.mark.parametrize("suffix", ["gpkg", "shp"])
@pytest.mark.parametrize(
    ("values", "told"),
    [
        ([1.0, np.nan, 3.0], "the number of people is missing"),
        ([1.0, 2.5, 3.0], "2.5 is not a number of people"),
        ([1, 0, 3], "0 is not a number of people"),
    ],
)
def test_numbers_of_people_that_are_none(tmp_path, suffix, values, told):
    path = write(tmp_path / f"people.{suffix}", field_data=[np.array(values)])
    message = refusal(path)
    assert "has 1 mistake" in message
    assert f"people.{suffix}, feature 2: {told}" in message


def test_several_layers_are_refused(tmp_path):
    path = write(tmp_path / "people.gpkg", layer="people")
    write(path, layer="roads", append=True)
    assert "several layers, people, roads: save the one with people" in refusal(path)


def test_fields_that_mean_the_same(tmp_path):
    values = np.array([1, 2, 3], np.int32)
    path = write(tmp_path / "people.gpkg", field_data=[values, values], fields=["count", "weight"])
    assert "the fields 'count' and 'weight' mean the same" in refusal(path)


def test_more_than_twenty_thousand_are_refused(tmp_path):
    points = shapely.points(np.full(20_001, -62.7), np.full(20_001, 17.3))
    path = write(tmp_path / "people.fgb", points, field_data=[], fields=[])
    assert "more than 20,000 positions" in refusal(path)


def test_the_content_must_be_what_the_name_says(tmp_path):
    """GDAL goes by content: a file of its virtual format could name any other file."""
    secret = tmp_path / "secret.csv"
    secret.write_text("x,y\n-62.7,17.3\n", encoding="utf-8")
    virtual = (
        '<OGRVRTDataSource><OGRVRTLayer name="secret">'
        f"<SrcDataSource>{secret}</SrcDataSource><GeometryType>wkbPoint</GeometryType>"
        '<LayerSRS>EPSG:4326</LayerSRS><GeometryField encoding="PointFromColumns" x="x" y="y"/>'
        "</OGRVRTLayer></OGRVRTDataSource>"
    )
    for suffix in (*DRIVERS, "gpx"):
        path = tmp_path / f"people.{suffix}"
        path.write_text(virtual, encoding="utf-8")
        assert "is not the" in refusal(path)
    _, _, geometry, _ = pyogrio.raw.read(path)  # so it would have been read
    assert shapely.from_wkb(geometry)[0] == shapely.Point(-62.7, 17.3)


def test_damaged_and_missing_files(tmp_path):
    assert "is not a file" in refusal(tmp_path / "missing.gpkg")
    path = write(tmp_path / "people.gpkg")
    path.write_bytes(path.read_bytes()[:3000])
    assert "cannot read" in refusal(path)
    path = write(tmp_path / "people.shp")
    path.with_suffix(".shx").unlink()
    assert "cannot read" in refusal(path)
