"""People from GeoJSON: what RFC 7946 allows, what it does not, and what GDAL reads."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people


def write(folder: Path, content: Any, name: str = "people.geojson") -> Path:
    path = folder / name
    if not isinstance(content, bytes):
        text = content if isinstance(content, str) else json.dumps(content)
        content = text.encode()
    path.write_bytes(content)
    return path


def refusal(folder: Path, content: Any) -> str:
    with pytest.raises(InputError) as caught:
        read_people(write(folder, content))
    return str(caught.value)


def point(longitude: Any, latitude: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "Point", "coordinates": [longitude, latitude]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def multipoint(*positions: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "MultiPoint", "coordinates": list(positions)}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features: Any, **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features)} | members


GOOD = collection(
    point(-62.7204, 17.3012, people=40, name="hall"),
    point(-62.7199, 17.302, People="3"),
    point(-62.71, 17.3, count=2.0),
    multipoint([-62.712, 17.31], [-62.713, 17.32, 14.0]),
    multipoint([-62.714, 17.33], weight=7),
)


def test_points_and_their_people(tmp_path):
    table = read_people(write(tmp_path, GOOD))
    assert table.on_earth
    assert table.coordinates.tolist() == [
        [17.3012, -62.7204],
        [17.302, -62.7199],
        [17.3, -62.71],
        [17.31, -62.712],
        [17.32, -62.713],
        [17.33, -62.714],
    ]
    assert table.weights.tolist() == [40, 3, 2, 1, 1, 7]
    numbers = [1, 2, 3, 4, 4, 5]
    assert table.sources == tuple(f"people.geojson, feature {number}" for number in numbers)
    assert any("only 4 of 5 features have a property" in note for note in table.notes)


def test_gdal_reads_the_same_positions(tmp_path):
    path = write(tmp_path, GOOD)
    _, _, geometry, _ = pyogrio.raw.read(path, force_2d=True)
    expected = shapely.get_coordinates(shapely.from_wkb(geometry))
    assert np.array_equal(read_people(path).coordinates[:, ::-1], expected)


def test_what_gdal_writes_is_read(tmp_path):
    path = tmp_path / "people.geojson"
    places = np.array([[179.9999, -17.5], [-179.9995, -17.4987654]])
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(shapely.points(places)),
        geometry_type="Point",
        crs="EPSG:4326",
        driver="GeoJSON",
        field_data=[np.array([5, 6], np.int32)],
        fields=["people"],
    )
    assert '"crs"' in path.read_text(encoding="utf-8")
    table = read_people(path)
    assert np.array_equal(table.coordinates, places[:, ::-1])
    assert table.weights.tolist() == [5, 6]


@pytest.mark.parametrize(
    "content",
    [
        point(-62.7, 17.3),
        point(-62.7, 17.3)["geometry"],
        {"type": "MultiPoint", "coordinates": [[-62.7, 17.3]]},
        b"\xef\xbb\xbf" + json.dumps(point(-62.7, 17.3)).encode(),
        collection({**point(-62.7, 17.3), "properties": None}, bbox=[-63, 17, -62, 18]),
        collection(point(-62.7, 17.3), crs={"type": "name", "properties": {"name": "EPSG:4326"}}),
    ],
)
def test_other_ways_to_write_one_person(tmp_path, content):
    table = read_people(write(tmp_path, content))
    assert table.coordinates.tolist() == [[17.3, -62.7]]
    assert table.weights.tolist() == [1]


def test_metres(tmp_path):
    table = read_people(write(tmp_path, collection(point(120.5, -3), units="m")))
    assert not table.on_earth
    assert table.coordinates.tolist() == [[120.5, -3]]
    assert not read_people(write(tmp_path, collection(point(1, 2), units="m", crs=None))).on_earth


FILES = {
    "not JSON": (b"{", "not valid JSON"),
    "empty": (b"", "not valid JSON"),
    "a literal that JSON has not": (b'{"type": NaN}', "holds NaN"),
    "infinity": (b'{"type": -Infinity}', "holds -Infinity"),
    "a key twice": (b'{"type": "Point", "type": "Point"}', "has the key 'type' twice"),
    "not UTF-8": ('{"type": "é"}'.encode("latin-1"), "is not UTF-8"),
    "UTF-16": ('{"type": "Point"}'.encode("utf-16"), "is not UTF-8"),
    "deep": (b"[" * 100_000, "nested too deeply"),
    "deep objects": (b'{"a":' * 100_000, "nested too deeply"),
    "a huge number": (b'{"type": ' + b"9" * 5000 + b"}", "not valid JSON"),
    "two documents": (b"{}\n{}", "not valid JSON"),
    "a list": (b"[]", "has [] instead of an object"),
    "another type": (b'{"type": "Topology"}', "its type is 'Topology'"),
    "no type": (b"{}", "its type is None"),
    "features that are none": (b'{"type": "FeatureCollection", "features": {}}', "a list"),
    "no features": (collection(), "nobody in it"),
    "feet": (collection(point(1, 2), units="ft"), "\"units\": 'ft'"),
    "null units": (collection(point(1, 2), units=None), '"units": None'),
    "a grid": (
        collection(
            point(500_000, 1_900_000),
            crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32620"}},
        ),
        "a coordinate system of its own, 'urn:ogc:def:crs:EPSG::32620': convert it to WGS 84",
    ),
    "a link": (collection(crs={"type": "link", "properties": {"href": "x"}}), "of its own"),
    "an unknown system": (collection(point(1, 2), crs=None), "of its own, None"),
    "degrees and metres": (
        collection(units="m", crs={"type": "name", "properties": {"name": "EPSG:4326"}}),
        'leave "crs" away',
    ),
}


@pytest.mark.parametrize(("content", "told"), FILES.values(), ids=FILES)
def test_files_that_are_refused(tmp_path, content, told):
    message = refusal(tmp_path, content)
    assert told in message
    assert message.startswith(str(tmp_path / "people.geojson"))
    assert "\n" not in message


FEATURES = {
    "a line": (
        {"type": "Feature", "geometry": {"type": "LineString", "coordinates": []}},
        "its geometry is 'LineString'; would be right: Point or MultiPoint",
    ),
    "a collection": (
        {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": []}},
        "its geometry is 'GeometryCollection'",
    ),
    "no place": ({"type": "Feature", "geometry": None}, "no geometry"),
    "nothing": (None, "no geometry"),
    "a number": (7, "7 is no geometry"),
    "an empty position": (point(1, 2) | {"geometry": {"type": "Point"}}, "None is not a position"),
    "no positions": (multipoint(), "MultiPoint without positions"),
    "one number": (multipoint([1]), "[1] is not a position"),
    "text": (point("-62.7", 17.3), "'-62.7' is not a number"),
    "truth": (point(-62.7, True), "True is not a number"),
    "null": (point(None, 17.3), "None is not a number"),
    "swapped beyond 90": (point(17.3, -98.2), "are latitude and longitude swapped?"),
    "too far east": (point(181, 17.3), "181.0 is not a longitude"),
    "a pole": (point(0, -90), "too near to a pole"),
    "nested": (multipoint([[[[[[[1]]]]]], 2]), "is not a number"),
    "nobody": (point(-62.7, 17.3, people=0), "0 is not a number of people"),
    "half of one": (point(-62.7, 17.3, people=0.5), "0.5 is not a number of people"),
    "missing people": (point(-62.7, 17.3, people=None), "the number of people is missing"),
    "true people": (point(-62.7, 17.3, people=True), "True is not a number of people"),
    "a list of people": (point(-62.7, 17.3, people=[1]), "[1] is not a number of people"),
    "too many": (point(-62.7, 17.3, people=100_001), "100001 is not a number of people"),
    "very many": (point(-62.7, 17.3, people=10**400), "is not a number of people"),
    "twice": (point(-62.7, 17.3, people=1, count=1), "'people' and 'count' mean the same"),
    "shared": (multipoint([-62.7, 17.3], [-62.7, 17.4], people=40), "40 people are given for 2"),
}


@pytest.mark.parametrize(("feature", "told"), FEATURES.values(), ids=FEATURES)
def test_wrong_features_are_named(tmp_path, feature, told):
    message = refusal(tmp_path, collection(point(-62.7, 17.3), feature, point(-62.71, 17.3)))
    first, *others = message.splitlines()
    assert first.startswith(f"{tmp_path / 'people.geojson'} has 1 mistake")
    assert len(others) == 1
    assert others[0].startswith("  people.geojson, feature 2: ")
    assert told in others[0]
    assert len(others[0]) < 300


def test_numbers_that_overflow(tmp_path):
    message = refusal(tmp_path, '{"type": "Point", "coordinates": [1e999, 1' + "0" * 400 + "]}")
    assert "inf is not a finite number" in message
    message = refusal(tmp_path, '{"type": "Point", "coordinates": [1, 1' + "0" * 400 + "]}")
    assert "is not a finite number" in message


def test_all_mistakes_are_told_up_to_twenty(tmp_path):
    lines = refusal(tmp_path, collection(*[point(-62.7, 95)] * 30)).splitlines()
    assert "has 30 mistakes" in lines[0]
    assert lines[20].startswith("  people.geojson, feature 20: 95.0 is not a latitude")
    assert lines[21:] == ["  and 10 more"]


def test_twenty_thousand_positions_and_no_more(tmp_path):
    position = [-62.7, 17.3]
    full = multipoint(*[position] * 19_999)
    assert len(read_people(write(tmp_path, collection(full, point(*position)))).weights) == 20_000
    told = refusal(tmp_path, collection(full, point(*position), point(*position)))
    assert "more than 20,000 positions" in told


def test_twenty_thousand_features_and_no_more(tmp_path):
    one = point(-62.7, 17.3)
    assert len(read_people(write(tmp_path, collection(*[one] * 20_000))).weights) == 20_000
    assert "20,001 features, more than 20,000" in refusal(tmp_path, collection(*[one] * 20_001))


def test_what_is_too_large_to_be_read_whole(tmp_path):
    path = tmp_path / "people.geojson"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(InputError, match="more than the 33,554,432 it may have"):
        read_people(path)
    with pytest.raises(InputError, match="cannot read"):
        read_people(tmp_path / "missing.geojson")
