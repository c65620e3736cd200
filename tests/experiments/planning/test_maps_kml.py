"""Plans as KML, judged by the OGC's schema (as fastkml bundles it) and by GDAL."""

import dataclasses
import io
from xml.etree import ElementTree

import fastkml
import pyogrio
import pytest
import shapely
from fastkml.validator import validate

from orchid_uav.experiments.planning.maps.kml import plan_kml
from orchid_uav.experiments.planning.site import Place
from tests.helpers.plans import UTUADO, make_plan

KML = "{http://www.opengis.net/kml/2.2}"
FIJI = Place(-16.8, 179.999)
HOSTILE = "</name><NetworkLink>&amp;&<b>\U0001f681\u202euav\x00\x1b\ud800\uffff]]>"


def renamed(plan, name):
    """The plan with another name of its first drone."""
    first = plan.document.drones[0].model_copy(update={"id": name})
    document = plan.document.model_copy(update={"drones": [first, *plan.document.drones[1:]]})
    stations = (plan.stations[0]._replace(name=name), *plan.stations[1:])
    return dataclasses.replace(plan, document=document, stations=stations)


def placemarks(content, folder):
    """The placemarks below a folder."""
    root = ElementTree.fromstring(content)
    for one in root.iter(f"{KML}Folder"):
        if one.findtext(f"{KML}name") == folder:
            return list(one.iter(f"{KML}Placemark"))
    raise AssertionError(f"there is no folder {folder}")


def text_of(element, tag):
    return element.findtext(f".//{KML}{tag}")


def points_of(element):
    return [
        [float(number) for number in triple.split(",")]
        for coordinates in element.iter(f"{KML}coordinates")
        for triple in coordinates.text.split()
    ]


@pytest.mark.parametrize(
    "plan",
    [
        make_plan(),
        make_plan(drones=1, rows=1, masts=0, zone=False, ways=False, want=None),
        make_plan(hover=True, masts=2),
        make_plan(center=FIJI),
        renamed(make_plan(), HOSTILE),
    ],
    ids=["usual", "least", "hovering", "antimeridian", "hostile"],
)
def test_it_keeps_to_the_schema(plan, tmp_path):
    path = tmp_path / "plan.kml"
    path.write_bytes(plan_kml(plan))
    assert validate(file_to_validate=path) is True


def test_the_schema_would_tell_a_wrong_order(tmp_path):
    path = tmp_path / "plan.kml"
    content = plan_kml(make_plan()).replace(b"styleUrl", b"style")
    path.write_bytes(content)
    with pytest.raises(AssertionError):
        validate(file_to_validate=path)


def test_gdal_finds_every_folder(tmp_path):
    plan = make_plan()
    path = tmp_path / "plan.kml"
    path.write_bytes(plan_kml(plan))
    layers = dict(pyogrio.list_layers(path).tolist())
    assert {"Stations", "Circles", "Masts and home", "Zones", "Ways"} <= set(layers)
    _, _, shapes, _ = pyogrio.raw.read(path, layer="Stations")
    for point, drone in zip(shapely.from_wkb(shapes), plan.document.drones, strict=True):
        expected = (drone.lon, drone.lat, drone.altitude_m)
        assert (point.x, point.y, point.z) == pytest.approx(expected, abs=1e-7)
    people = 0
    for layer in [*plan.servers, "not served"]:
        _, _, shapes, _ = pyogrio.raw.read(path, layer=layer)
        people += len(shapes)
    assert people == len(plan.people.weights)
    _, _, shapes, _ = pyogrio.raw.read(path, layer="Circles")
    for ring in shapely.from_wkb(shapes):
        assert ring.is_valid
        assert ring.exterior.is_ccw


def test_fastkml_reads_it():
    document = fastkml.KML.parse(io.BytesIO(plan_kml(make_plan()))).features[0]
    names = [folder.name for folder in document.features]
    assert names == ["Stations", "Circles", "People", "Masts and home", "Zones", "Ways"]


def test_the_altitude_mode_stands_before_the_coordinates():
    root = ElementTree.fromstring(plan_kml(make_plan()))
    seen = 0
    for kind in ("Point", "LineString", "Polygon"):
        for element in root.iter(f"{KML}{kind}"):
            seen += 1
            assert element[0].tag == f"{KML}altitudeMode"
            assert all(len(point) == 3 for point in points_of(element))
    assert seen > 220


def test_what_flies_is_above_the_ground_and_people_stand_on_it():
    plan = make_plan()
    content = plan_kml(plan)
    for folder in ("Stations", "Circles"):
        drawn = placemarks(content, folder)
        for placemark, drone in zip(drawn, plan.document.drones, strict=True):
            assert text_of(placemark, "altitudeMode") == "relativeToGround"
            assert {point[2] for point in points_of(placemark)} == {drone.altitude_m}
    for placemark in placemarks(content, "People"):
        assert text_of(placemark, "altitudeMode") == "clampToGround"
    for placemark, way_m in zip(placemarks(content, "Ways"), plan.ways_m, strict=True):
        assert [point[2] for point in points_of(placemark)] == way_m[:, 2].tolist()


def test_everything_lies_near_the_site():
    root = ElementTree.fromstring(plan_kml(make_plan()))
    for longitude, latitude, _ in points_of(root):
        assert abs(longitude - UTUADO.longitude_deg) < 0.05
        assert abs(latitude - UTUADO.latitude_deg) < 0.05


def test_people_are_told_by_who_serves_them():
    plan = make_plan(masts=2)
    content = plan_kml(plan)
    for server, name in enumerate(plan.servers):
        assert len(placemarks(content, name)) == (plan.server == server).sum()
    assert len(placemarks(content, "not served")) == (plan.server == -1).sum() > 0


def test_every_style_that_is_used_exists():
    root = ElementTree.fromstring(plan_kml(make_plan(masts=2)))
    styles = {style.get("id") for style in root.iter(f"{KML}Style")}
    used = {element.text.removeprefix("#") for element in root.iter(f"{KML}styleUrl")}
    assert used == styles


def test_colours_are_alpha_blue_green_red():
    root = ElementTree.fromstring(plan_kml(make_plan()))
    style = next(one for one in root.iter(f"{KML}Style") if one.get("id") == "drone_0")
    assert style.findtext(f"{KML}IconStyle/{KML}color") == "ff8e5403"  # #03548E
    assert style.findtext(f"{KML}PolyStyle/{KML}color") == "268e5403"


def test_a_hostile_name_is_text():
    content = plan_kml(renamed(make_plan(), HOSTILE))
    root = ElementTree.fromstring(content)
    assert not list(root.iter(f"{KML}NetworkLink"))
    name = text_of(placemarks(content, "Stations")[0], "name")
    assert name.startswith("</name><NetworkLink>&amp;&<b>\U0001f681")
    assert name.endswith("]]>")
    assert not set(name) & set("\u202e\x00\x1b\ud800\uffff")


def test_a_long_name_is_shortened():
    content = plan_kml(renamed(make_plan(), "x" * 10_000))
    assert len(text_of(placemarks(content, "Stations")[0], "name")) < 250
    assert b"x" * 250 not in content


def test_descriptions_which_programs_read_as_html_hold_no_names():
    content = plan_kml(renamed(make_plan(), "<b>"))
    for placemark in placemarks(content, "Stations"):
        assert "<" not in text_of(placemark, "description")


def test_the_same_plan_gives_the_same_bytes():
    assert plan_kml(make_plan(seed=4)) == plan_kml(make_plan(seed=4))


def test_a_site_without_a_place_on_earth_is_refused():
    with pytest.raises(ValueError, match="no place on earth"):
        plan_kml(make_plan(center=None))
