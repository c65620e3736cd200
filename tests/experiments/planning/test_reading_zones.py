"""Areas and zones: polygons that are valid, closed, and whole across the antimeridian."""

import json
from pathlib import Path
from typing import Any

import pytest
import shapely
from shapely.geometry import Polygon, box

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.zones import read_zones

SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2], [0, 0]]
HOLE = [[0.5, 0.5], [0.5, 1], [1, 1], [1, 0.5], [0.5, 0.5]]


def polygon(*rings: Any) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": list(rings)}


def write(folder: Path, content: Any, name: str = "zones.geojson") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
    return path


def features(*geometries: Any, **members: Any) -> dict[str, Any]:
    found = [{"type": "Feature", "properties": {}, "geometry": one} for one in geometries]
    return {"type": "FeatureCollection", "features": found} | members


def kml(*placemarks: str) -> str:
    inner = "".join(f"<Placemark>{one}</Placemark>" for one in placemarks)
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{inner}</Document></kml>'


def kml_polygon(outer: Any, *holes: Any) -> str:
    def boundary(name: str, ring: Any) -> str:
        text = "\n  ".join(",".join(map(str, position)) for position in ring)
        ring_text = f"<LinearRing><coordinates>\n  {text}\n</coordinates></LinearRing>"
        return f"<{name}>{ring_text}</{name}>"

    inner = "".join(boundary("innerBoundaryIs", hole) for hole in holes)
    return f"<Polygon>{boundary('outerBoundaryIs', outer)}{inner}</Polygon>"


def refusal(folder: Path, content: Any, name: str = "zones.geojson") -> str:
    with pytest.raises(InputError) as caught:
        read_zones(write(folder, content, name))
    return str(caught.value)


def test_polygons_and_holes(tmp_path):
    content = features(
        polygon(SQUARE, HOLE),
        {"type": "MultiPolygon", "coordinates": [[[[x + 5, y] for x, y in SQUARE]], [HOLE]]},
    )
    zones = read_zones(write(tmp_path, content))
    assert zones.on_earth
    assert [one.area for one in zones.polygons] == [3.75, 4, 0.25]
    assert zones.polygons[1].equals(box(5, 0, 7, 2))
    bare = read_zones(write(tmp_path, polygon(SQUARE)))
    assert bare.polygons[0].equals(box(0, 0, 2, 2))


def test_kml_polygons(tmp_path):
    raised = [(*position, 100) for position in SQUARE]
    pair = f"<MultiGeometry>{kml_polygon(SQUARE)}{kml_polygon(HOLE)}</MultiGeometry>"
    zones = read_zones(write(tmp_path, kml(kml_polygon(raised, HOLE), pair), "zones.kml"))
    assert zones.on_earth
    assert [one.area for one in zones.polygons] == [3.75, 4, 0.25]


def test_metres(tmp_path):
    content = features(polygon([[x * 1000, y * 1000] for x, y in SQUARE]), units="m")
    zones = read_zones(write(tmp_path, content))
    assert not zones.on_earth
    assert zones.polygons[0].area == 4e6


@pytest.mark.parametrize("is_kml", [False, True])
@pytest.mark.parametrize("outwards", [1, -1])
@pytest.mark.parametrize("inwards", [1, -1])
def test_the_winding_is_repaired(tmp_path, outwards, inwards, is_kml):
    outer, hole = SQUARE[::outwards], HOLE[::inwards]
    if is_kml:
        zones = read_zones(write(tmp_path, kml(kml_polygon(outer, hole)), "zones.kml"))
    else:
        zones = read_zones(write(tmp_path, polygon(outer, hole)))
    (found,) = zones.polygons
    assert found.area == 3.75
    assert found.exterior.is_ccw
    assert not found.interiors[0].is_ccw


ACROSS = {
    "by a jump": [[179, 10], [-179, 10], [-179, 11], [179, 11], [179, 10]],
    "by a jump the other way": [[-179, 10], [-179, 11], [179, 11], [179, 10], [-179, 10]],
    "beyond 180": [[179, 10], [181, 10], [181, 11], [179, 11], [179, 10]],
    "beyond -180": [[-181, 10], [-179, 10], [-179, 11], [-181, 11], [-181, 10]],
    "over 180 itself": [
        *([179, 10], [180, 10], [-180, 10], [-179, 10], [-179, 11], [179, 11], [179, 10]),
    ],
}


@pytest.mark.parametrize("ring", ACROSS.values(), ids=ACROSS)
def test_polygons_across_the_antimeridian_are_whole(tmp_path, ring):
    (found,) = read_zones(write(tmp_path, polygon(ring))).polygons
    turns = round((found.bounds[0] - 179) / 360)
    assert shapely.transform(found, lambda one: one - [360 * turns, 0]).equals(
        box(179, 10, 181, 11)
    )


def test_holes_stay_in_polygons_across_the_antimeridian(tmp_path):
    for hole in (
        [[-179.9, 10.2], [-179.5, 10.2], [-179.5, 10.5], [-179.9, 10.2]],
        [[179.9, 10.2], [-179.9, 10.2], [-179.9, 10.5], [179.9, 10.2]],
        [[179.5, 10.2], [179.9, 10.2], [179.9, 10.5], [179.5, 10.2]],
    ):
        (found,) = read_zones(write(tmp_path, polygon(ACROSS["by a jump"], hole))).polygons
        assert len(found.interiors) == 1
        assert found.area == pytest.approx(2 - shapely.area(Polygon(found.interiors[0])))


WRONG = {
    "a bow tie": (
        [[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]],
        "crosses or touches itself at latitude 0.5, longitude 0.5 (self-intersection)",
    ),
    "two corners": ([[0, 0], [1, 1], [0, 0]], "a ring has 3 positions"),
    "nothing": ([], "a ring has 0 positions"),
    "not closed": (SQUARE[:-1], "not closed: it begins at latitude 0, longitude 0 and ends at lat"),
    "flat": ([[0, 0], [1, 1], [2, 2], [0, 0]], "a polygon"),
    "one place": ([[1, 1]] * 5, "a polygon is not valid at latitude 1, longitude 1"),
    "swapped": ([[17, -98], [17, -99], [18, -98], [17, -98]], "-98.0 is not a latitude"),
    "too far east": ([[0, 0], [361, 0], [1, 1], [0, 0]], "361.0 is not a longitude"),
    "round a pole": ([[0, 80], [120, 80], [-120, 80], [0, 80]], "a ring goes round a pole"),
    "round a pole by turns": (
        [[0, 80], [120, 80], [240, 80], [360, 80], [0, 80]],
        "a ring goes round a pole",
    ),
    "too wide": ([[-100, 0], [0, 0], [100, 0], [0, 10], [-100, 0]], "spans more than 180 degrees"),
    "text": ([["0", 0], [1, 0], [1, 1], ["0", 0]], "'0' is not a number"),
    "a number": ([1, 2, 3, 1], "1 is not a position"),
    "null": (None, "None stands where a list of coordinates belongs"),
}


@pytest.mark.parametrize(("ring", "told"), WRONG.values(), ids=WRONG)
def test_polygons_that_are_not_valid_are_named(tmp_path, ring, told):
    message = refusal(tmp_path, features(polygon(SQUARE), polygon(ring), polygon(HOLE)))
    first, *others = message.splitlines()
    assert "zones.geojson has 1 mistake" in first
    assert len(others) == 1
    assert others[0].startswith("  zones.geojson, feature 2: ")
    assert told in others[0]


def test_a_part_of_several_is_named(tmp_path):
    parts = {"type": "MultiPolygon", "coordinates": [[SQUARE], [WRONG["a bow tie"][0]], [SQUARE]]}
    assert "  zones.geojson, feature 1, polygon 2: " in refusal(tmp_path, features(parts))
    tie = kml_polygon(WRONG["a bow tie"][0])
    pair = f"<name>Airport</name><MultiGeometry>{kml_polygon(SQUARE)}{tie}</MultiGeometry>"
    message = refusal(tmp_path, kml(pair), "zones.kml")
    assert "  zones.kml, placemark 1 'Airport', polygon 2: a polygon crosses" in message


def test_in_metres_the_place_is_in_metres(tmp_path):
    tie = [[0, 0], [1000, 1000], [1000, 0], [0, 1000], [0, 0]]
    assert "itself at x 500, y 500" in refusal(tmp_path, features(polygon(tie), units="m"))


def test_a_hole_outside(tmp_path):
    hole = [[x + 5, y] for x, y in HOLE]
    assert "hole lies outside shell" in refusal(tmp_path, polygon(SQUARE, hole))


def test_a_place_beyond_the_antimeridian_is_named_as_on_maps(tmp_path):
    tie = [[179, 0], [-179, 1], [-179, 0], [179, 1], [179, 0]]
    message = refusal(tmp_path, polygon(tie))
    assert "at latitude 0.5, longitude -180" in message or "longitude 180" in message


GEOMETRIES = {
    "a point": {"type": "Point", "coordinates": [0, 0]},
    "a line": {"type": "LineString", "coordinates": SQUARE},
    "nothing": None,
    "no polygons": {"type": "MultiPolygon", "coordinates": []},
    "no rings": {"type": "Polygon", "coordinates": []},
}


@pytest.mark.parametrize("geometry", GEOMETRIES.values(), ids=GEOMETRIES)
def test_other_geometries_are_named(tmp_path, geometry):
    message = refusal(tmp_path, features(polygon(SQUARE), geometry))
    assert "zones.geojson, feature 2: " in message


def test_kml_without_polygons(tmp_path):
    point = "<name>Pin</name><Point><coordinates>1,2</coordinates></Point>"
    message = refusal(tmp_path, kml(kml_polygon(SQUARE), point), "zones.kml")
    assert "placemark 2 'Pin': its geometry is a Point; would be right: Polygon" in message
    for inner in ("", "<outerBoundaryIs/>", "<outerBoundaryIs><LinearRing/></outerBoundaryIs>"):
        assert "placemark 1: " in refusal(tmp_path, kml(f"<Polygon>{inner}</Polygon>"), "zones.kml")
    assert "no polygon" in refusal(tmp_path, kml(), "zones.kml")


def test_a_second_outer_ring_is_not_taken_for_a_hole(tmp_path):
    two = kml_polygon(SQUARE, HOLE).replace("innerBoundaryIs", "outerBoundaryIs")
    assert "has 2 outer rings: it must have one" in refusal(tmp_path, kml(two), "zones.kml")


def test_files_of_other_kinds(tmp_path):
    assert "a table, which has no polygons" in refusal(tmp_path, "lat,lon\n", "zones.csv")
    assert "ends in none of .geojson" in refusal(tmp_path, "", "zones.shp")
    assert "no polygon: draw at least one" in refusal(tmp_path, features())


def test_too_many_corners_are_refused(tmp_path):
    ring = [[0, 0], *([x / 1e5, 1 + x % 2] for x in range(100_000, 0, -1)), [0, 0]]
    assert "100,002 corners together, more than 100,000" in refusal(tmp_path, polygon(ring))
