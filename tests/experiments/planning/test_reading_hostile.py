"""Whatever bytes a file has, it is read or refused in plain words, and never anything else."""

import io
import json
import random
import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people
from orchid_uav.experiments.planning.reading.zones import read_zones
from tests.helpers.damage import spoil

CSV = 'lat,lon,people,name\n17.3012,-62.7204,4,"A, B"\n17.302,-62.7199,1,\n'
POINTS = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"people": 4},
            "geometry": {"type": "Point", "coordinates": [-62.72, 17.3]},
        },
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "MultiPoint", "coordinates": [[-62.71, 17.3], [-62.7, 17.3, 4]]},
        },
    ],
}
RING = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]
POLYGONS = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "MultiPolygon", "coordinates": [[RING], [RING]]},
        },
        {
            "type": "Feature",
            "properties": {},
            "geometry": {"type": "Polygon", "coordinates": [RING]},
        },
    ],
}
KML = (
    '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    "<Placemark><name>A</name>{}</Placemark></Document></kml>"
)
KML_POINT = KML.format(
    '<ExtendedData><Data name="people"><value>4</value></Data></ExtendedData>'
    "<Point><coordinates>-62.72,17.3,0</coordinates></Point>"
)
KML_POLYGON = KML.format(
    "<Polygon><outerBoundaryIs><LinearRing><coordinates>0,0 2,0 2,2 0,0</coordinates>"
    "</LinearRing></outerBoundaryIs></Polygon>"
)


def zipped(content: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", content)
    return file.getvalue()


SEEDS = {
    ".csv": [CSV.encode(), CSV.encode("utf-16"), CSV.replace(",", ";").encode("utf-8-sig")],
    ".geojson": [json.dumps(POINTS).encode(), json.dumps(POLYGONS).encode()],
    ".kml": [KML_POINT.encode(), KML_POLYGON.encode()],
    ".kmz": [zipped(KML_POINT), zipped(KML_POLYGON)],
}
PIECES = [
    *(b'"', b",", b";", b"\n", b"\r", b"\0", b"\xff", b"\xed\xa0\x80", b"9" * 400, b"nan", b"-"),
    *(b"<", b"&a;", b"]]>", b"<!DOCTYPE a>", b"[", b"]" * 5, b"{", b"NaN", b"1e999", b"\\ud800"),
    *(b"\xef\xbb\xbf", b"null", b"true", b"PK\x03\x04", b"\xe2\x88\x92", b"<Point/>", b'"units":'),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hostile")


def read_or_refuse(path: Path) -> None:
    for read in (read_people, read_zones):
        try:
            read(path)
        except InputError as error:
            lines = str(error).splitlines()
            assert str(path) in lines[0]
            assert len(lines) <= 22
            assert max(map(len, lines)) < 1000
            str(error).encode()  # it can be printed


@settings(deadline=None, max_examples=100)
@given(suffix=st.sampled_from(sorted(SEEDS)), content=st.binary(max_size=200))
def test_any_bytes(folder, suffix, content):
    path = folder / f"any{suffix}"
    path.write_bytes(content)
    read_or_refuse(path)


@settings(deadline=None, max_examples=300)
@given(
    suffix=st.sampled_from(sorted(SEEDS)),
    which=st.integers(0, 2),
    changes=st.lists(
        st.tuples(
            st.floats(0, 1),
            st.integers(0, 12),
            st.sampled_from(PIECES) | st.binary(max_size=4),
        ),
        min_size=1,
        max_size=4,
    ),
)
def test_files_with_parts_cut_out_and_put_in(folder, suffix, which, changes):
    content = SEEDS[suffix][which % len(SEEDS[suffix])]
    for place, cut, piece in changes:
        at = int(place * len(content))
        content = content[:at] + piece + content[at + cut :]
    path = folder / f"changed{suffix}"
    path.write_bytes(content)
    read_or_refuse(path)


@settings(deadline=None, max_examples=300)
@given(seed=st.integers(0, 2**32), times=st.integers(1, 3), document=st.sampled_from([0, 1]))
def test_documents_with_other_values(folder, seed, times, document):
    chance = random.Random(seed)
    text = json.dumps([POINTS, POLYGONS][document])
    for _ in range(times):
        changed = json.loads(text)
        if changed:
            spoil(changed, chance)
        text = json.dumps(changed)
    path = folder / "spoilt.geojson"
    path.write_text(text, encoding="utf-8")
    read_or_refuse(path)


@pytest.mark.parametrize("suffix", SEEDS)
def test_undamaged_they_are_read(folder, suffix):
    path = folder / f"seed{suffix}"
    for content in SEEDS[suffix][: 3 if suffix == ".csv" else 1]:
        path.write_bytes(content)
        assert read_people(path).weights[0] == 4
    if suffix != ".csv":
        path.write_bytes(SEEDS[suffix][1])
        assert read_zones(path).polygons[0].area >= 2
