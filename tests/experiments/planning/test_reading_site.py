"""From files to the metres of a site: near the equator, near the poles, across the antimeridian."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import Polygon, box

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people
from orchid_uav.experiments.planning.reading.places import parse_home, parse_mast
from orchid_uav.experiments.planning.reading.site import (
    default_area,
    locate,
    mast_of,
    notes_on_zones,
    people_of,
    place_m,
    zones_m,
)
from orchid_uav.experiments.planning.reading.table import PeopleTable
from orchid_uav.experiments.planning.reading.zones import Zones, read_zones
from orchid_uav.experiments.planning.site import Place, Site


def table_of(*places: tuple[float, float], on_earth: bool = True) -> PeopleTable:
    return PeopleTable(
        path=Path("people.csv"),
        coordinates=np.array(places, float),
        on_earth=on_earth,
        weights=np.arange(1, len(places) + 1),
        sources=tuple(f"people.csv, row {row}" for row in range(2, 2 + len(places))),
        notes=(),
    )


def zones_of(*polygons: Polygon, on_earth: bool = True) -> Zones:
    return Zones(Path("zones.geojson"), polygons, on_earth)


TOWN = table_of((17.30, -62.72), (17.31, -62.70), (17.31, -62.72))
CAMP = table_of((100.0, 50.0), (1100.0, 850.0), on_earth=False)
LATITUDES = (-85.0, -45.0, -17.0, 0.0, 17.3, 60.0, 70.0, 80.0, 85.0, 89.5)
LONGITUDES = (0.0, -62.7, 179.995, -179.999, 180.0)


def radii_m(latitude_deg: float) -> tuple[float, float]:
    """Radii of WGS 84 along the meridian and across it, from the ellipsoid's definition."""
    axis_m, flattening = 6_378_137.0, 1 / 298.257223563
    squared = flattening * (2 - flattening)
    inner = 1 - squared * math.sin(math.radians(latitude_deg)) ** 2
    return axis_m * (1 - squared) / inner**1.5, axis_m / math.sqrt(inner)


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("longitude", LONGITUDES)
def test_metres_of_people_are_those_of_the_ellipsoid(latitude, longitude):
    along_m, across_m = radii_m(latitude)
    north_deg = math.degrees(1000 / along_m)
    east_deg = math.degrees(1000 / (across_m * math.cos(math.radians(latitude))))
    steps = np.array([(0, 0), (-1, -1), (1, 1), (1, -1)])
    places = np.array([latitude, longitude]) + steps * [north_deg, east_deg]
    places[:, 1] = (places[:, 1] + 180) % 360 - 180
    table = table_of(*map(tuple, places))
    site = locate(table)
    assert site.center is not None
    assert site.center.latitude_deg == pytest.approx(latitude, abs=1e-9)
    assert math.cos(math.radians(site.center.longitude_deg - longitude)) == pytest.approx(1)
    people = people_of(table, site)
    # A parallel is a circle round the pole: 1 km to the side it has left the straight line by
    # d²/2R·tan(latitude); at 89.5 degrees that is 9 m.
    bend_m = 1000**2 / 2 / 6.35e6 * abs(math.tan(math.radians(latitude))) * 1.1 + 0.1
    wide_m = 1000 * 1000 / 6.35e6 * abs(math.tan(math.radians(latitude))) * 1.1 + 0.1
    expected_m = steps[:, ::-1] * 1000.0
    assert people.positions_m[:, 0] == pytest.approx(expected_m[:, 0], abs=wide_m)
    assert people.positions_m[:, 1] == pytest.approx(expected_m[:, 1], abs=bend_m)
    assert site.to_places(people.positions_m)[:, 0] == pytest.approx(places[:, 0], abs=1e-9)
    assert people.total == 10


def test_local_metres_stay_as_they_are():
    site = locate(CAMP, [zones_of(box(0, 0, 2000, 2000), on_earth=False)], [parse_mast("7,8")])
    assert site == Site(None)
    assert people_of(CAMP, site).positions_m.tolist() == CAMP.coordinates.tolist()
    assert place_m(parse_home("-3,4.5,12"), site) == (-3, 4.5)
    area = zones_m(zones_of(box(0, 0, 2, 2), box(1, 1, 3, 3), on_earth=False), site)
    assert area.area == 7


def test_the_default_area_is_the_box_round_people():
    assert default_area(people_of(CAMP, Site(None)), 200.0).equals(box(-100, -150, 1300, 1050))


def test_masts():
    site = locate(TOWN)
    (east_m, north_m) = place_m(parse_mast("17.305,-62.71"), site)
    assert (east_m, north_m) == pytest.approx((0, 0), abs=1e-6)  # the middle of the box
    assert mast_of(parse_mast("17.305,-62.71"), site, 25.0)[2] == 25.0
    assert mast_of(parse_mast("17.305,-62.71,40"), site, 25.0)[2] == 40.0
    along_m, _ = radii_m(17.305)
    assert place_m(parse_mast("17.315,-62.71"), site)[1] == pytest.approx(
        math.radians(0.01) * along_m, abs=0.1
    )


@pytest.mark.parametrize("latitude", LATITUDES)
@pytest.mark.parametrize("longitude", LONGITUDES)
def test_areas_of_zones_are_those_of_the_ellipsoid(latitude, longitude):
    along_m, across_m = radii_m(latitude)
    half_deg = math.degrees(1500 / (across_m * math.cos(math.radians(latitude))))
    zone = box(longitude - half_deg, latitude - 0.01, longitude + half_deg, latitude + 0.01)
    table = table_of((latitude, (longitude + 180) % 360 - 180))
    site = locate(table, [zones_of(zone)])
    found = zones_m(zones_of(zone), site)
    expected_m2 = 3000 * math.radians(0.02) * along_m
    assert found.area == pytest.approx(expected_m2, rel=1e-3)
    assert found.contains(shapely.Point(0, 0))
    assert found.is_valid


def test_a_zone_across_the_antimeridian_is_the_same_however_it_is_written(tmp_path: Path):
    def ring(west: float, east: float) -> list[list[float]]:
        return [[west, -17], [east, -17], [east, -16.9], [west, -16.9], [west, -17]]

    ways: list[dict[str, Any]] = [
        {"type": "Polygon", "coordinates": [ring(179.95, -179.95)]},
        {"type": "Polygon", "coordinates": [ring(179.95, 180.05)]},
        {"type": "Polygon", "coordinates": [ring(-180.05, -179.95)]},
        {"type": "MultiPolygon", "coordinates": [[ring(179.95, 180)], [ring(-180, -179.95)]]},
    ]
    table = table_of((-16.95, 179.96), (-16.94, -179.96))
    found = []
    for way in ways:
        path = tmp_path / "zones.geojson"
        path.write_text(json.dumps(way), encoding="utf-8")
        zones = read_zones(path)
        found.append(zones_m(zones, locate(table, [zones])))
    along_m, across_m = radii_m(-16.95)
    wide_m = math.radians(0.1) * across_m * math.cos(math.radians(16.95))
    for one in found:
        assert one.geom_type == "Polygon"
        assert one.area == pytest.approx(wide_m * math.radians(0.1) * along_m, rel=1e-3)
        assert one.symmetric_difference(found[0]).area < 0.2 * one.length


def test_long_lines_bend_as_their_parallels_do():
    """At 80 degrees north a parallel leaves the straight line by 71 m in 25 km... on each side."""
    zone = zones_of(box(-1.3, 80.0, 1.3, 80.3))
    site = locate(table_of((80.1, -0.1), (80.1, 0.1)), [zone])
    found = zones_m(zone, site)
    corners = site.to_local_m([[80.0, -1.3], [80.0, 1.3]])
    middle_m = site.to_local_m([[80.0, 0.0]])[0]
    lowest_m = found.intersection(shapely.LineString([(0, -50_000), (0, 50_000)])).bounds[1]
    assert lowest_m == pytest.approx(middle_m[1], abs=0.5)
    half_m = corners[1, 0]
    bend_m = half_m**2 / 2 / 6.4e6 * math.tan(math.radians(80))
    assert corners[0, 1] - lowest_m == pytest.approx(bend_m, rel=0.02)
    assert bend_m > 200


def test_small_zones_keep_their_corners_and_no_more():
    zone = zones_of(box(-62.72, 17.30, -62.70, 17.32))
    assert len(zones_m(zone, locate(TOWN, [zone])).exterior.coords) == 5


def test_zones_that_cover_continents_are_cut_off():
    zone = zones_of(box(-100, -40, 20, 60))
    site = locate(TOWN, [zone])
    west, south, east, north = zones_m(zone, site).bounds
    assert all(95_000 < abs(edge) < 115_000 for edge in (west, south, east, north))


def test_zones_far_away_are_left_out_with_a_note():
    zones = zones_of(box(-62.72, 17.30, -62.70, 17.32), box(2, 48, 3, 49), box(117, -18, 118, -17))
    site = locate(TOWN, [zones])
    assert zones_m(zones, site).area < 1e7  # the third is on the other side of the earth
    assert notes_on_zones(zones, site) == [
        "2 of 3 polygons of zones.geojson are more than 100 km away and were left out"
    ]
    assert notes_on_zones(zones_of(zones.polygons[0]), site) == []
    assert notes_on_zones(zones_of(box(0, 0, 1, 1), on_earth=False), Site(None)) == []


@pytest.mark.parametrize(
    ("zone", "told"),
    [
        (box(2, 48, 3, 49), "no polygon within 50 km of the people"),
        (box(17.30, -62.72, 17.32, -62.70), "longitudes and latitudes seem to be swapped"),
        (box(-62.0, 17.30, -61.9, 17.32), "no polygon within 50 km of the people"),
    ],
)
def test_zones_none_of_which_is_near_are_refused(zone, told):
    with pytest.raises(InputError, match=told):
        locate(TOWN, [zones_of(zone)])


def test_degrees_and_metres_do_not_mix():
    with pytest.raises(InputError) as caught:
        locate(TOWN, [zones_of(box(0, 0, 1, 1), on_earth=False)])
    assert "people.csv has positions in degrees, and zones.geojson in metres" in str(caught.value)
    with pytest.raises(InputError) as caught:
        locate(CAMP, [zones_of(box(0, 0, 1, 1))])
    assert "people.csv has positions in metres, and zones.geojson in degrees" in str(caught.value)
    assert '"units": "m"' in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("850,1200", "--mast 850,1200 does not fit people.csv: 850.0 is not a latitude"),
        ("17.3,200", "200.0 is not a longitude"),
        ("48.86,2.35", "--mast 48.86,2.35 is 6,7"),
        ("-62.71,17.3", "latitude and longitude seem to be swapped"),
        ("17.3,62.71", "a sign of the longitude seems to be wrong"),
    ],
)
def test_places_that_are_not_near_are_refused(text, told):
    with pytest.raises(InputError) as caught:
        locate(TOWN, places=[parse_mast("17.3,-62.71"), parse_mast(text)])
    assert told in str(caught.value)


def test_places_in_metres():
    assert locate(CAMP, places=[parse_home("30000,-20000")]) == Site(None)
    with pytest.raises(InputError, match="59 km from the people"):
        locate(CAMP, places=[parse_home("60000,0")])


def test_people_outside_the_area_are_people_all_the_same(tmp_path: Path):
    path = tmp_path / "people.csv"
    path.write_text("lat,lon,people\n17.30,-62.72,5\n17.31,-62.70,40\n17.31,-62.72,2\n", "utf-8")
    area = zones_of(box(-62.725, 17.29, -62.71, 17.32))
    table = read_people(path, area)
    assert table.weights.tolist() == [5, 40, 2]
    assert table.notes == (
        "40 of 47 people are outside zones.geojson: drones stay inside and serve them from there",
    )
    assert read_people(path, zones_of(box(-62.725, 17.29, -62.69, 17.32))).notes == ()
    with pytest.raises(InputError, match="no polygon within 50 km"):
        read_people(path, zones_of(box(2, 48, 3, 49)))


def test_the_centre_does_not_depend_on_weights():
    assert locate(TOWN).center == Place(17.305, pytest.approx(-62.71))
