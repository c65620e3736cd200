"""Ways to the stations and back, and the order in which drones start."""

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.csgraph
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.routing import MAST_M, Router
from orchid_uav.experiments.planning.missions.stays import plan_stays
from orchid_uav.experiments.planning.missions.transit import plan_transit
from orchid_uav.experiments.planning.model import Mast
from tests.helpers.fleets import CRUISE_MPS, station_at, stations_in, surroundings_of

RING = Point(0.0, 600.0).buffer(300.0).difference(Point(0.0, 600.0).buffer(200.0))


def route(surroundings, goal_m, masts=()):
    return Router(surroundings, [goal_m], list(masts)).way_to(goal_m, "uav_0")


def length_m(way):
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def test_a_way_with_nothing_in_it_is_straight():
    way = route(surroundings_of(home_m=(0.0, 0.0)), (300.0, 400.0))
    assert way.tolist() == [[0.0, 0.0], [300.0, 400.0]]


def test_a_way_goes_round_a_zone_at_its_margin():
    zone = shapely.box(400.0, -100.0, 600.0, 100.0)
    surroundings = surroundings_of(home_m=(0.0, 0.0), no_fly=zone)
    way = route(surroundings, (1000.0, 0.0))
    assert len(way) == 4
    shortest_m = 2.0 * np.hypot(380.0, 120.0) + 240.0  # round corners 20 m off the zone's
    assert shortest_m - 0.1 <= length_m(way) <= shortest_m + 10.0
    assert LineString(way).distance(zone) >= 20.0 - 0.1


def test_a_way_stays_in_the_area_only_if_home_lies_in_it():
    horseshoe = shapely.box(-500, -500, 500, 500).difference(shapely.box(-50, -400, 50, 600))
    inside = surroundings_of(area=horseshoe, home_m=(-300.0, 300.0))
    way = route(inside, (300.0, 300.0))
    assert horseshoe.buffer(-10.0).covers(LineString(way))
    assert length_m(way) > 1300.0  # down to 420 m south and up again
    outside = surroundings_of(area=horseshoe, home_m=(-700.0, 300.0))
    assert length_m(route(outside, (300.0, 300.0))) == pytest.approx(1000.0)


def test_narrow_gaps_are_flown_through_with_less_margin_and_the_narrowest_not_at_all():
    walls = [shapely.box(-1200, 0, -4, 20), shapely.box(4, 0, 1200, 20)]
    surroundings = surroundings_of(no_fly=shapely.union_all(walls))
    way = LineString(route(surroundings, (300.0, 600.0)))
    assert 2.0 <= way.distance(surroundings.no_fly) <= 4.0
    walls = [shapely.box(-1200, 0, -1, 20), shapely.box(1, 0, 1200, 20)]
    with pytest.raises(InputError, match="uav_0 cannot be reached from home within the area"):
        route(surroundings_of(no_fly=shapely.union_all(walls)), (300.0, 600.0))


def test_a_station_or_a_home_that_a_zone_encloses_cannot_be_reached():
    stations = [station_at(0.0, 600.0)]
    with pytest.raises(InputError, match="uav_0 cannot be reached from home"):
        plan_transit(surroundings_of(no_fly=RING), stations, CRUISE_MPS)
    enclosed = surroundings_of(no_fly=RING, home_m=(0.0, 600.0))
    with pytest.raises(InputError, match="cannot be reached"):
        plan_transit(enclosed, [station_at(0.0, -600.0)], CRUISE_MPS)
    in_zone = surroundings_of(no_fly=RING, home_m=(250.0, 600.0))
    with pytest.raises(InputError, match=r"home at 250\.0 m east, 600\.0 m north lies in a no-fly"):
        plan_transit(in_zone, stations, CRUISE_MPS)


def test_ends_may_lie_nearer_to_zones_than_ways():
    zone = shapely.box(100.0, -300.0, 200.0, 300.0)
    surroundings = surroundings_of(home_m=(99.9, 0.0), no_fly=zone)
    way = route(surroundings, (200.1, 0.0))
    assert not zone.intersects(LineString(way))
    middle = LineString(way).intersection(shapely.box(101.0, -900.0, 199.0, 900.0))
    assert middle.distance(zone) >= 15.0


def test_the_way_ends_on_the_circle_where_it_comes_first():
    surroundings = surroundings_of(home_m=(0.0, 0.0))
    (way,) = plan_transit(surroundings, [station_at(300.0, 400.0, 90.0)], CRUISE_MPS).ways
    share = (500.0 - 48.0) / 500.0
    end = [300.0 * share, 400.0 * share]
    expected = [[0, 0, 0], [0, 0, 80], [*end, 80], [*end, 90]]
    assert way.outbound_m == pytest.approx(np.array(expected))
    assert (way.inbound_m == way.outbound_m[::-1]).all()
    assert way.length_m == pytest.approx(452.0)
    assert way.level_s == pytest.approx(2.0 * 452.0 / 12.0)
    # 90 m up at 3 m/s, 80 m down at 2 m/s, and the last 10 m at 0.5 m/s
    assert way.vertical_s == pytest.approx(30.0 + 40.0 + 20.0)
    assert way.arrives_s == pytest.approx(30.0 + 452.0 / 12.0)


@pytest.mark.parametrize("home_m", [(300.0, 400.0), (310.0, 400.0)])
def test_a_station_over_home_is_reached(home_m):
    surroundings = surroundings_of(home_m=home_m)
    (way,) = plan_transit(surroundings, [station_at(300.0, 400.0)], CRUISE_MPS).ways
    assert np.hypot(*(way.outbound_m[-1, :2] - (300.0, 400.0))) == pytest.approx(48.0)
    (hover,) = plan_transit(surroundings, [station_at(*home_m, radius_m=0.0)], CRUISE_MPS).ways
    assert hover.length_m == 0.0


def test_ways_lie_below_all_circles_where_there_is_room_and_never_above_the_ceiling():
    stations = stations_in(surroundings_of(), 8)
    lowest_m = min(station.altitude_m for station in stations)
    for way in plan_transit(surroundings_of(), stations, CRUISE_MPS).ways:
        assert 30.0 <= way.layer_m <= lowest_m - 10.0
    low = surroundings_of(lowest_m=25.0, highest_m=45.0)
    for way in plan_transit(low, [station_at(0.0, 500.0, 25.0)], CRUISE_MPS).ways:
        assert way.layer_m in (30.0, 40.0)
    very_low = surroundings_of(lowest_m=20.0, highest_m=25.0)
    (way,) = plan_transit(very_low, [station_at(0.0, 500.0, 20.0)], CRUISE_MPS).ways
    assert way.layer_m == 25.0


def test_ways_lead_over_or_under_circles_where_they_cannot_lie_below_all():
    low = surroundings_of(lowest_m=30.0, highest_m=90.0)
    stations = [
        station_at(0.0, -400.0, 90.0),
        station_at(0.0, 800.0, 70.0, name="uav_1"),
        station_at(900.0, 0.0, 30.0, name="uav_2"),
    ]
    ways = plan_transit(low, stations, CRUISE_MPS).ways
    assert ways[1].layer_m == 80.0  # just below uav_0, and not 90 m


def test_the_farthest_starts_first_and_neighbours_do_not_start_together():
    stations = stations_in(surroundings_of(), 10)
    ways = plan_transit(surroundings_of(), stations, CRUISE_MPS).ways
    assert [way.name for way in ways] == [station.name for station in stations]
    in_order = sorted(ways, key=lambda way: way.launch_s)
    assert in_order[0].launch_s == 0.0
    lengths = [way.length_m for way in in_order]
    assert lengths == sorted(lengths, reverse=True)
    # 10 m of height at 3 m/s, and 5 s that a start may be off
    assert np.diff([way.launch_s for way in in_order]).min() >= 8.0


def test_ways_keep_off_masts_that_are_as_high_as_they_are():
    stations = [station_at(0.0, 600.0, 100.0)]
    low = Mast(0.0, 0.0, 50.0)
    (way,) = plan_transit(surroundings_of(masts=(low,)), stations, CRUISE_MPS).ways
    assert way.layer_m >= 60.0
    assert len(way.outbound_m) == 4
    near_home = Mast(0.0, -900.0, 75.0)
    beside = [station_at(-150.0, 800.0), station_at(150.0, 800.0, name="uav_1")]
    ways = plan_transit(surroundings_of(), beside, CRUISE_MPS).ways
    assert {way.layer_m for way in ways} == {80.0, 90.0}
    ways = plan_transit(surroundings_of(masts=(near_home,)), beside, CRUISE_MPS).ways
    assert {way.layer_m for way in ways} == {90.0}
    tower = Mast(0.0, 0.0, 110.0)
    (way,) = plan_transit(surroundings_of(masts=(tower,)), stations, CRUISE_MPS).ways
    assert LineString(way.outbound_m[:, :2]).distance(Point(0.0, 0.0)) >= MAST_M - 0.5


def test_stays_are_as_long_as_batteries_allow_and_returns_are_apart():
    surroundings = surroundings_of()
    stations = stations_in(surroundings, 8)
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    stays = plan_stays(surroundings, stations, transit, [1000.0] * 8, [26.0] * 8)
    assert max(stay.seconds for stay in stays) > 995.0
    assert min(stay.seconds for stay in stays) > 850.0
    for stay, way in zip(stays, transit.ways, strict=True):
        assert stay.seconds <= 1000.0
        assert stay.turns * 26.0 + stay.hold_s == pytest.approx(stay.seconds)
        assert stay.leaves_s == pytest.approx(way.arrives_s + stay.seconds)
    # 10 m of height at 2 m/s, and 5 s that a return may be off
    assert np.diff(sorted(stay.lands_s for stay in stays)).min() >= 9.0


def test_a_battery_that_does_not_last_for_one_circle_is_refused():
    surroundings = surroundings_of()
    stations = [station_at(0.0, 600.0)]
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    with pytest.raises(InputError, match=r"uav_0 could not come back .* \(20 s on station\)"):
        plan_stays(surroundings, stations, transit, [20.0], [26.0])


@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_ways_never_touch_zones_and_are_no_longer_than_ways_along_a_fine_grid(data):
    coordinate = st.floats(-900.0, 900.0)
    zones = data.draw(
        st.lists(st.tuples(coordinate, coordinate, st.floats(20.0, 250.0)), max_size=4)
    )
    no_fly = shapely.union_all(
        [Point(x, y).buffer(size, data.draw(st.integers(1, 4))) for x, y, size in zones]
    )
    goal_m = data.draw(coordinate), data.draw(coordinate)
    surroundings = surroundings_of(no_fly=no_fly)
    if no_fly.distance(Point(goal_m)) < 1.0 or no_fly.distance(Point(surroundings.home_m)) < 1.0:
        return
    shortest_m = grid_length_m(surroundings, goal_m)
    try:
        way = route(surroundings, goal_m)
    except InputError:
        assert shortest_m is None
        return
    assert not no_fly.intersects(LineString(way))
    if shortest_m is not None:
        assert length_m(way) <= 1.02 * shortest_m + 1.0


def grid_length_m(surroundings, goal_m, step_m=60.0):
    """Length of a way over a grid that keeps 60 m away from zones; None if there is none."""
    free = surroundings.area.buffer(-60.0).difference(surroundings.no_fly.buffer(60.0))
    axis = np.arange(-1200.0, 1201.0, step_m)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    points = points[shapely.contains_xy(free, points[:, 0], points[:, 1])]
    points = np.concatenate([[surroundings.home_m, goal_m], points])
    offsets = points[:, None] - points[None]
    distances = np.hypot(offsets[..., 0], offsets[..., 1])
    start, end = np.nonzero(np.triu(distances < 1.5 * step_m, 1))
    lines = shapely.linestrings(np.stack([points[start], points[end]], axis=1))
    shapely.prepare(free)
    allowed = shapely.covers(free.buffer(0.01), lines)
    weights = np.where(allowed, distances[start, end], 0.0)
    graph = scipy.sparse.coo_array((weights[allowed], (start[allowed], end[allowed])))
    graph.resize((len(points), len(points)))
    found = scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=0)[1]
    return float(found) if np.isfinite(found) else None
