"""Fences in mission files, and the same limits as GeoJSON."""

import json

import numpy as np
import pytest
import shapely
from geojson_pydantic import FeatureCollection
from shapely.geometry import Point, Polygon

from orchid_uav.experiments.planning.missions.check import check_plan_file
from orchid_uav.experiments.planning.missions.fence import (
    MOST_CORNERS,
    fence_geojson,
    fence_of,
)
from orchid_uav.experiments.planning.missions.items import Firmware
from orchid_uav.experiments.planning.missions.plan_file import write_plan
from orchid_uav.experiments.planning.missions.transit import plan_transit
from orchid_uav.experiments.planning.site import Place, Site
from tests.helpers.fleets import CRUISE_MPS, planned, station_at, stations_in, surroundings_of

ZONE = shapely.box(-60.0, 200.0, 60.0, 300.0)


def fence_for(surroundings, stations=None):
    stations = stations or [station_at(500.0, 500.0)]
    return fence_of(surroundings, plan_transit(surroundings, stations, CRUISE_MPS))


def in_metres(surroundings, fence):
    return [
        (inclusion, Polygon(surroundings.site.to_local_m(corners)))
        for inclusion, corners in fence.polygons
    ]


def assert_equal(polygon, expected, tolerance_m=0.05):
    assert polygon.symmetric_difference(expected).area <= tolerance_m * expected.length


def assert_no_findings(fleet, tmp_path):
    for document in fleet.documents:
        write_plan(tmp_path / "a.plan", document)
        assert check_plan_file(tmp_path / "a.plan") == []


def test_the_fence_is_the_area_and_zones_are_exclusions():
    zones = shapely.union_all([ZONE, shapely.box(5e3, 0, 6e3, 9)])
    surroundings = surroundings_of(2000.0, no_fly=zones)
    fence = fence_for(surroundings)
    (inside, area), (outside, zone) = in_metres(surroundings, fence)
    assert (inside, outside, fence.note) == (True, False, "")
    assert_equal(area, surroundings.area)
    assert_equal(zone, ZONE)
    assert len(fence.polygons[0][1]) == 4  # not closed


def test_holes_of_the_area_are_exclusions():
    area = shapely.box(-1200, -1200, 1200, 1200).difference(Point(0, 0).buffer(100, 2))
    for home_m in [(0.0, -960.0), (0.0, -2000.0)]:
        surroundings = surroundings_of(area=area, home_m=home_m)
        polygons = in_metres(surroundings, fence_for(surroundings))
        assert [inclusion for inclusion, _ in polygons] == [True, False]
        assert_equal(polygons[1][1], Point(0, 0).buffer(100, 2))


def test_a_home_outside_of_the_area_and_the_ways_from_it_lie_in_the_fence():
    surroundings = surroundings_of(home_m=(0.0, -2000.0))
    stations = [station_at(-500.0, 500.0), station_at(500.0, 0.0, name="uav_1")]
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    ((inclusion, polygon),) = in_metres(surroundings, fence_of(surroundings, transit))
    assert inclusion
    assert polygon.contains(Point(surroundings.home_m).buffer(25.0))
    for way in transit.ways:
        assert polygon.contains(shapely.LineString(way.outbound_m[1:, :2]).buffer(25.0))
    assert polygon.difference(surroundings.area).area < 0.3 * surroundings.area.area


def test_a_zone_that_encloses_home_like_a_ring_becomes_the_border():
    ring = Point(0, 0).buffer(700, 4).difference(Point(0, 0).buffer(600, 4))
    surroundings = surroundings_of(no_fly=ring, home_m=(0.0, -400.0))
    ((inclusion, polygon),) = in_metres(
        surroundings, fence_for(surroundings, [station_at(0.0, 300.0)])
    )
    assert inclusion
    assert_equal(polygon, Point(0, 0).buffer(600, 4))


def test_what_autopilots_cannot_store_is_fenced_more_coarsely_and_never_too_narrowly(tmp_path):
    zones = [Point(0, -300).buffer(150, 32), Point(600, 300).buffer(200, 32)]
    surroundings = surroundings_of(
        area=Point(0, 0).buffer(1200, 32), no_fly=shapely.union_all(zones)
    )
    stations = stations_in(surroundings, 6)
    for firmware in Firmware:
        _, fence, fleet = planned(firmware, surroundings, stations)
        corners = sum(len(polygon) for _, polygon in fence.polygons)
        assert 20 < corners <= MOST_CORNERS
        assert "wider than the area and the no-fly zones allow" in fence.note
        wider_m = float(fence.note.split("up to ")[1].split(" m")[0])
        area, *excluded = (polygon for _, polygon in in_metres(surroundings, fence))
        assert surroundings.area.buffer(-0.05).within(area)
        assert area.within(surroundings.area.buffer(wider_m, join_style="mitre"))
        assert len(excluded) == 2
        for polygon in excluded:
            nearest = min(zones, key=polygon.hausdorff_distance)
            assert polygon.within(nearest.buffer(0.05))
            assert polygon.hausdorff_distance(nearest) <= wider_m
        assert_no_findings(fleet, tmp_path)


def test_more_zones_than_fit_are_left_out_and_told():
    places = [(x, y) for x in range(-1000, 1001, 250) for y in range(-600, 1001, 400)]
    zones = [Point(place).buffer(25.0, 8) for place in places]
    surroundings = surroundings_of(no_fly=shapely.union_all(zones))
    fence = fence_for(surroundings, [station_at(-120.0, 500.0, radius_m=20.0)])
    assert sum(len(polygon) for _, polygon in fence.polygons) <= MOST_CORNERS
    assert len(fence.polygons) > 2
    told = f"Of 45 no-fly zones, {46 - len(fence.polygons)} are not in it at all."
    assert fence.note.endswith(told)


@pytest.mark.parametrize("latitude_deg", [70.0, -70.0])
def test_long_edges_bend_with_the_earth_and_circles_at_the_border_stay_inside(
    latitude_deg, tmp_path
):
    surroundings = surroundings_of(8000.0, site=Site(Place(latitude_deg, 25.0)))
    border_m = 4000.0 - 48.05
    places = [(2e3, border_m), (border_m, 0.0), (-border_m, 0.0), (-2e3, -border_m)]
    stations = [station_at(*place, name=f"uav_{index}") for index, place in enumerate(places)]
    for firmware in Firmware:
        _, fence, fleet = planned(firmware, surroundings, stations)
        assert fence.note == ""
        assert_no_findings(fleet, tmp_path)


def test_there_is_no_fence_across_the_antimeridian():
    fence = fence_for(surroundings_of(site=Site(Place(-16.8, 179.9995))))
    assert fence.polygons == ()
    assert "180" in fence.note


def test_the_geojson_is_valid_and_says_what_is_what():
    hole = Point(0, -200).buffer(100, 2)
    area = shapely.box(-1200, -1200, 1200, 1200).difference(hole)
    surroundings = surroundings_of(area=area, no_fly=ZONE)
    content = json.loads(json.dumps(fence_geojson(surroundings)))
    FeatureCollection.model_validate(content)
    assert [feature["properties"]["kind"] for feature in content["features"]] == ["area", "no-fly"]
    for feature, expected in zip(content["features"], (area, ZONE), strict=True):
        shape = shapely.geometry.shape(feature["geometry"])
        assert shape.is_valid and shape.exterior.is_ccw
        assert not any(ring.is_ccw for ring in shape.interiors)
        degrees = np.array(shape.exterior.coords)
        assert (np.round(degrees, 7) == degrees).all()
        back = shapely.transform(
            shape, lambda places: surroundings.site.to_local_m(places[:, ::-1])
        )
        assert_equal(back, expected)


def test_the_geojson_is_cut_at_the_antimeridian():
    content = fence_geojson(surroundings_of(site=Site(Place(-16.8, 179.9995))))
    longitudes = [
        [place[0] for place in feature["geometry"]["coordinates"][0]]
        for feature in content["features"]
    ]
    assert sorted(min(one) < 0.0 for one in longitudes) == [False, True]
    assert all(np.ptp(one) < 1.0 for one in longitudes)
