"""People from KML and KMZ: what Google Earth and GDAL write, and what nobody should."""

import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people

NAMESPACE = ' xmlns="http://www.opengis.net/kml/2.2"'


def write(folder: Path, content: str | bytes, name: str = "people.kml") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refusal(folder: Path, content: str | bytes, name: str = "people.kml") -> str:
    with pytest.raises(InputError) as caught:
        read_people(write(folder, content, name))
    return str(caught.value)


def kml(inner: str, namespace: str = NAMESPACE) -> str:
    return f"<kml{namespace}><Document>{inner}</Document></kml>"


def placemark(coordinates: str, data: str = "", name: str = "") -> str:
    named = f"<name>{name}</name>" if name else ""
    return (
        f"<Placemark>{named}{data}<Point><coordinates>{coordinates}</coordinates></Point>"
        "</Placemark>"
    )


def data(name: str, value: object) -> str:
    return f'<ExtendedData><Data name="{name}"><value>{value}</value></Data></ExtendedData>'


GOOD = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document><name>People</name>
 <Schema name="s" id="s"><SimpleField name="people" type="int"/></Schema>
 <Style id="a"><IconStyle><Icon><href>http://example.org/icon.png</href></Icon></IconStyle></Style>
 <Folder><name>Town</name>
  <Placemark><name>Hall &amp; school</name><styleUrl>#a</styleUrl>
   <ExtendedData><Data name="people"><value> 40 </value></Data></ExtendedData>
   <Point><altitudeMode>clampToGround</altitudeMode>
    <coordinates>
      -62.7204,17.3012,0
    </coordinates></Point></Placemark>
  <Placemark><ExtendedData><SchemaData schemaUrl="#s"><SimpleData name="People">3</SimpleData>
   </SchemaData></ExtendedData><Point><coordinates>-62.7199,17.302</coordinates></Point></Placemark>
  <Folder><Placemark><MultiGeometry>
   <Point><coordinates>-62.71,17.3</coordinates></Point>
   <MultiGeometry><Point><coordinates>-62.712,17.31,12.5</coordinates></Point></MultiGeometry>
  </MultiGeometry></Placemark></Folder>
 </Folder>
</Document></kml>
"""
PLACES = [[17.3012, -62.7204], [17.302, -62.7199], [17.3, -62.71], [17.31, -62.712]]


@pytest.mark.parametrize("with_namespace", [True, False])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_points_and_their_people(tmp_path, with_namespace, encoding):
    text = GOOD if with_namespace else GOOD.replace(NAMESPACE, "")
    table = read_people(write(tmp_path, text.replace("UTF-8", encoding).encode(encoding)))
    assert table.on_earth
    assert table.coordinates.tolist() == PLACES
    assert table.weights.tolist() == [40, 3, 1, 1]
    assert table.sources[0] == "people.kml, placemark 1 'Hall & school'"
    assert table.sources[3] == "people.kml, placemark 3"
    assert any("only 2 of 3 placemarks have" in note for note in table.notes)


def test_older_namespaces_and_prefixes(tmp_path):
    text = GOOD.replace("opengis.net/kml/2.2", "earth.google.com/kml/2.0")
    assert read_people(write(tmp_path, text)).coordinates.tolist() == PLACES
    prefixed = (
        '<k:kml xmlns:k="http://www.opengis.net/kml/2.2"><k:Placemark><k:Point>'
        "<k:coordinates>1,2</k:coordinates></k:Point></k:Placemark></k:kml>"
    )
    assert read_people(write(tmp_path, prefixed)).coordinates.tolist() == [[2, 1]]


@pytest.mark.parametrize("driver", ["KML", "LIBKML"])
def test_gdal_reads_and_writes_the_same_positions(tmp_path, driver):
    if driver not in pyogrio.list_drivers():
        pytest.skip("this build of GDAL has no such driver")
    path = tmp_path / "people.kml"
    places = np.array([[-62.7204, 17.3012], [-62.7199, 17.302], [-62.71, 17.3]])
    # Before GDAL 3.12 its driver KML wrote the first two fields as name and description.
    words = np.array(["a", "b", "c"], object)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(shapely.points(places)),
        geometry_type="Point",
        crs="EPSG:4326",
        driver=driver,
        field_data=[words, words, np.array([7, 8, 9], np.int32)],
        fields=["Name", "Description", "people"],
    )
    table = read_people(path)
    assert table.coordinates == pytest.approx(places[:, ::-1], abs=1e-9)
    assert table.weights.tolist() == [7, 8, 9]
    good = write(tmp_path, GOOD)
    _, _, geometry, _ = pyogrio.raw.read(good, layer="Town", force_2d=True)
    theirs = shapely.get_coordinates(shapely.from_wkb(geometry))
    ours = read_people(good).coordinates[:, ::-1]
    assert np.array_equal(theirs, ours[: len(theirs)])
    assert len(theirs) >= 2


@pytest.mark.parametrize(
    "coordinates",
    ["1,2", " 1,2,3 ", "\n\t1,2,0\n", "1 , 2", "1, 2, 3", "1,2,", "+1.0,2e0", "\u00a01,2"],
)
def test_whitespace_in_coordinates(tmp_path, coordinates):
    table = read_people(write(tmp_path, kml(placemark(coordinates))))
    assert table.coordinates.tolist() == [[2, 1]]


PLACEMARKS = {
    "no commas": (placemark("1 2"), "'1' is not a position: write longitude,latitude"),
    "decimal commas": (placemark("-62,72,17,30"), "'-62,72,17,30' is not a position"),
    "two positions": (placemark("1,2 3,4"), "a Point has 2 positions"),
    "none": (placemark(" "), "a Point has no coordinates"),
    "an empty point": ("<Placemark><Point/></Placemark>", "a Point has no coordinates"),
    "twice": (
        "<Placemark><Point><coordinates>1,2</coordinates><coordinates>1,2</coordinates></Point>"
        "</Placemark>",
        "a Point has no coordinates",
    ),
    "text": (placemark("west,north"), "'west' is not a number"),
    "not finite": (placemark("1,nan"), "'nan' is not a number"),
    "height": (placemark("1,2,high"), "'high' is not a number"),
    "swapped": (placemark("17.3,-98.2"), "are latitude and longitude swapped?"),
    "a line": (
        "<Placemark><LineString><coordinates>1,2 3,4</coordinates></LineString></Placemark>",
        "its geometry is a LineString; would be right: Point",
    ),
    "a ring": ("<Placemark><LinearRing/></Placemark>", "its geometry is a LinearRing"),
    "a track": (
        '<Placemark><gx:Track xmlns:gx="http://www.google.com/kml/ext/2.2"/></Placemark>',
        "its geometry is a Track",
    ),
    "a point and a line": (
        "<Placemark><MultiGeometry><Point><coordinates>1,2</coordinates></Point><LineString/>"
        "</MultiGeometry></Placemark>",
        "its geometry is a LineString",
    ),
    "nothing": ("<Placemark><name/></Placemark>", "it has no geometry; would be right: Point"),
    "people": (placemark("1,2", data("people", "some")), "'some' is not a number of people"),
    "no people": (placemark("1,2", data("weight", "")), "the number of people is missing"),
    "twice people": (
        placemark("1,2", data("people", 1) + data("count", 1)),
        "'people' and 'count' mean the same",
    ),
    "shared people": (
        f"<Placemark>{data('people', 4)}<MultiGeometry>"
        + "<Point><coordinates>1,2</coordinates></Point>" * 2
        + "</MultiGeometry></Placemark>",
        "4 people are given for 2 positions",
    ),
}


@pytest.mark.parametrize(("wrong", "told"), PLACEMARKS.values(), ids=PLACEMARKS)
def test_wrong_placemarks_are_named(tmp_path, wrong, told):
    message = refusal(tmp_path, kml(placemark("1,2") + wrong + placemark("1,2")))
    first, *others = message.splitlines()
    assert first.startswith(f"{tmp_path / 'people.kml'} has 1 mistake")
    assert len(others) == 1
    assert others[0].startswith("  people.kml, placemark 2: ")
    assert told in others[0]


ENTITIES = (
    '<!DOCTYPE kml [<!ENTITY a "1,2">]>' + kml(placemark("&a;")),
    '<!DOCTYPE kml [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
    + kml(placemark("1,2", name="&a;")),
    '<!DOCTYPE kml SYSTEM "http://127.0.0.1:9/kml.dtd">' + kml(placemark("1,2")),
    "<!DOCTYPE kml [<!ENTITY a '1'>"
    + "".join(f"<!ENTITY {chr(98 + n)} '{f'&{chr(97 + n)};' * 10}'>" for n in range(9))
    + "]>"
    + kml(placemark("&j;,2")),
)


@pytest.mark.parametrize("content", ENTITIES)
def test_entities_and_references_are_refused(tmp_path, content):
    message = refusal(tmp_path, content)
    assert "document type, entities or references" in message
    assert "\n" not in message


FILES = {
    "not XML": ("lat,lon", "not valid XML"),
    "empty": ("", "not valid XML"),
    "cut off": (GOOD[:600], "not valid XML"),
    "an unknown encoding": ('<?xml version="1.0" encoding="x-none"?><kml/>', "not valid XML"),
    "an encoding of several bytes": (
        '<?xml version="1.0" encoding="shift_jis"?><kml/>',
        "not valid XML",
    ),
    "not KML": ("<gpx><wpt/></gpx>", "its outermost element is 'gpx', not 'kml'"),
    "nobody": (kml(""), "nobody in it"),
    "a link": (
        kml("<NetworkLink><Link><href>http://127.0.0.1:9/a.kml</href></Link></NetworkLink>"),
        "links to contents that lie elsewhere",
    ),
    "bytes that are not UTF-8": (b"<kml><name>\xff\xfe</name></kml>", "not valid XML"),
    "a deep one": ("<a>" * 200_000, "not valid XML"),
}


@pytest.mark.parametrize(("content", "told"), FILES.values(), ids=FILES)
def test_files_that_are_refused(tmp_path, content, told):
    message = refusal(tmp_path, content)
    assert told in message
    assert "\n" not in message


def test_deep_folders_are_no_problem(tmp_path):
    inner = "<Folder>" * 50_000 + placemark("1,2") + "</Folder>" * 50_000
    assert read_people(write(tmp_path, kml(inner))).coordinates.tolist() == [[2, 1]]


def test_a_point_that_is_not_in_a_placemark_is_nobody(tmp_path):
    overlay = "<PhotoOverlay><Point><coordinates>5,5</coordinates></Point></PhotoOverlay>"
    table = read_people(write(tmp_path, kml(overlay + placemark("1,2"))))
    assert table.coordinates.tolist() == [[2, 1]]


def zipped(folder: Path, **files: str | bytes) -> bytes:
    path = folder / "made.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path.read_bytes()


@pytest.mark.parametrize("name", ["people.kmz", "people.kml"])
def test_kmz(tmp_path, name):
    content = zipped(tmp_path, **{"files/icon.png": b"\x89PNG", "doc.kml": GOOD})
    table = read_people(write(tmp_path, content, name))
    assert table.coordinates.tolist() == PLACES
    assert table.sources[3] == f"{name}, placemark 3"


def test_kmz_that_are_refused(tmp_path):
    bomb = zipped(tmp_path, **{"doc.kml": b"<kml>" + b" " * 2**27})
    assert len(bomb) < 2**18
    tracemalloc.start()
    try:
        assert "more than the 33,554,432 bytes" in refusal(tmp_path, bomb, "people.kmz")
        assert tracemalloc.get_traced_memory()[1] < 2**27
    finally:
        tracemalloc.stop()
    none = zipped(tmp_path, **{"readme.txt": "hello"})
    assert "zip file without a KML" in refusal(tmp_path, none, "people.kmz")
    good = zipped(tmp_path, **{"doc.kml": GOOD})
    assert "damaged KMZ" in refusal(tmp_path, good[: len(good) // 2], "people.kmz")
    at = good.index(b"doc.kml") + 20
    spoilt = good[:at] + bytes(byte ^ 0xFF for byte in good[at : at + 40]) + good[at + 40 :]
    assert "damaged KMZ" in refusal(tmp_path, spoilt, "people.kmz")
    flags = good.index(b"PK\x01\x02") + 8
    encrypted = good[:flags] + b"\x01" + good[flags + 1 :]
    encrypted = encrypted[:6] + b"\x01" + encrypted[7:]
    assert "cannot be unpacked" in refusal(tmp_path, encrypted, "people.kmz")
