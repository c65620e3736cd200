"""The proof flies what is written, and finds what is wrong with it."""

import dataclasses
import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import Point

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.fence import fence_of
from orchid_uav.experiments.planning.missions.fleet import plan_missions
from orchid_uav.experiments.planning.missions.items import Command, Firmware, MissionItem, places_of
from orchid_uav.experiments.planning.missions.plan_file import items_of
from orchid_uav.experiments.planning.missions.proof import prove
from orchid_uav.experiments.planning.missions.simulation import fly
from orchid_uav.experiments.planning.missions.transit import Speeds, plan_transit
from orchid_uav.experiments.planning.site import Place, Site
from tests.helpers.fleets import (
    CRUISE_MPS,
    UTUADO,
    planned,
    station_at,
    stations_in,
    surroundings_of,
)

FIRMWARES = list(Firmware)
SPEEDS = Speeds(CRUISE_MPS, 3.0, 2.0)


def place_at(east_m, north_m):
    return places_of(Site(UTUADO), np.array([[east_m, north_m]]))[0]


def item(command, *params, at=None, altitude_m=0.0):
    place = None if at is None else place_at(*at)
    return MissionItem(command, (*params, *[0.0] * (4 - len(params))), place, altitude_m)


SIMPLE = [
    item(Command.TAKEOFF, at=(0.0, 0.0), altitude_m=30.0),
    item(Command.DO_CHANGE_SPEED, 1, 10),
    item(Command.WAYPOINT, at=(0.0, 100.0), altitude_m=30.0),
    item(Command.WAYPOINT, 7, at=(50.0, 100.0), altitude_m=30.0),
    item(Command.DO_JUMP, 3, 2),
    item(Command.LOITER_TURNS, 3, 0, 20.0, at=(80.0, 100.0), altitude_m=60.0),
    item(Command.LAND, at=(0.0, 0.0)),
]


def test_items_are_flown_as_worked_out_by_hand():
    track = fly(SIMPLE, Site(UTUADO), UTUADO, 3.0, 2.0)
    # up, north; then three times: east and wait, and back twice in between
    before_turns_s = 10.0 + 10.0 + 3 * (5.0 + 7.0) + 2 * 5.0
    to_circle_s = max(10.0 / 10.0, 30.0 / 3.0)
    turns_s = 3 * 2.0 * math.pi * 20.0 / 10.0
    home_s = math.hypot(60.0, 100.0) / 10.0 + 60.0 / 2.0
    whole_s = before_turns_s + to_circle_s + turns_s + home_s
    assert track.seconds[-1] == pytest.approx(whole_s, abs=0.01)
    in_circle = before_turns_s + to_circle_s + turns_s / 3 * np.array([0.0, 0.25, 0.5, 0.75, 3.0])
    # clockwise from the west
    expected = [(60, 100), (80, 120), (100, 100), (80, 80), (60, 100)]
    assert track.at(in_circle)[:, :2] == pytest.approx(np.array(expected, float), abs=0.05)
    assert track.at(np.array([-5.0, 5.0, 1e6])) == pytest.approx(
        np.array([[0, 0, 0], [0, 0, 15.0], [0, 0, 0]]), abs=0.02
    )


def test_what_cannot_be_flown_is_refused():
    with pytest.raises(ValueError, match="command 20 is not flown"):
        fly([item(Command.RETURN_TO_LAUNCH)], Site(UTUADO), UTUADO, 3.0, 2.0)
    endless = [*SIMPLE[:4], item(Command.DO_JUMP, 3, 10**9)]
    with pytest.raises(ValueError, match="does not end"):
        fly(endless, Site(UTUADO), UTUADO, 3.0, 2.0)


@pytest.mark.parametrize("firmware", FIRMWARES)
@pytest.mark.parametrize("radius_m", [48.0, 0.0])
def test_a_fleet_flies_without_conflict_and_stays_as_long_as_planned(firmware, radius_m):
    zones = shapely.union_all([Point(0, -200).buffer(150), shapely.box(300, 200, 500, 600)])
    surroundings = surroundings_of(no_fly=zones)
    stations = stations_in(surroundings, 8, radius_m=radius_m)
    assert len(stations) == 8
    _, _, fleet = planned(firmware, surroundings, stations)
    assert fleet.proof.conflicts == ()
    assert fleet.proof.least_horizontal_m >= 50.0
    assert fleet.proof.least_vertical_m >= 10.0
    assert fleet.proof.highest_m <= 120.0
    for on_station_s, stay in zip(fleet.proof.on_station_s, fleet.stays, strict=True):
        assert on_station_s == pytest.approx(stay.seconds, abs=3.0)
        assert 1300.0 < stay.seconds <= 1500.0


def test_a_drone_whose_battery_ends_while_others_still_start_is_refused():
    surroundings = surroundings_of(1400.0)
    stations = stations_in(surroundings, 36, radius_m=12.0)
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    launches_s = [way.launch_s for way in transit.ways]
    first = launches_s.index(0.0)
    longest_s = [900.0] * len(stations)
    longest_s[first] = 25.0
    assert transit.ways[first].seconds + 25.0 < max(launches_s)
    fence = fence_of(surroundings, transit)
    with pytest.raises(InputError, match=rf"uav_{first} could not come back between the other"):
        plan_missions(Firmware.ARDUPILOT, surroundings, stations, transit, fence, longest_s)


def test_where_ways_lead_through_circles_drones_pass_before_they_are_flown_and_after():
    surroundings = surroundings_of(lowest_m=30.0, highest_m=30.0)
    places = [(0.0, -500.0), (0.0, 800.0)]
    stations = [
        station_at(*place, 30.0, name=f"uav_{index}", radius_m=120.0)
        for index, place in enumerate(places)
    ]
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    fence = fence_of(surroundings, transit)
    for longest_s in ([1500.0, 1500.0], [1500.0, 700.0]):
        fleet = plan_missions(Firmware.PX4, surroundings, stations, transit, fence, longest_s)
        assert fleet.proof.conflicts == ()
        near, far = fleet.stays
        assert far.seconds > longest_s[1] - 2.0
        # the near one has to be away before the far one comes to its circle and clearance
        assert near.leaves_s <= far.leaves_s + (1300.0 - 2.0 * 120.0 - 50.0) / 12.0 - 5.0
    near_way, far_way = transit.ways
    assert far_way.launch_s == 0.0
    # and may not be there before the far one is past them, with 5 s of slack
    assert near_way.arrives_s >= 10.0 + (960.0 - 500.0 + 120.0 + 50.0) / 12.0 + 5.0


def test_a_home_in_the_clearance_of_two_circles_at_the_altitude_of_ways_is_refused():
    places = [(0.0, 78.0), (0.0, -68.0)]
    stations = [station_at(*place, 30.0, name=f"uav_{i}") for i, place in enumerate(places)]
    low = surroundings_of(home_m=(0.0, 0.0), lowest_m=30.0, highest_m=30.0)
    with pytest.raises(InputError, match="finds no altitude for its way"):
        planned(Firmware.PX4, low, stations)
    high = surroundings_of(home_m=(0.0, 0.0))
    stations = [station._replace(altitude_m=80.0) for station in stations]
    _, _, fleet = planned(Firmware.PX4, high, stations)
    assert fleet.proof.conflicts == ()


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_whatever_is_planned_has_no_conflict(data):
    coordinate = st.floats(-1000.0, 1000.0)
    seed = data.draw(st.integers(0, 10**6))
    zones = data.draw(
        st.lists(st.tuples(coordinate, coordinate, st.floats(10.0, 300.0)), max_size=4)
    )
    lowest_m = data.draw(st.sampled_from([30.0, 60.0, 80.0]))
    surroundings = surroundings_of(
        site=Site(Place(data.draw(st.floats(-70.0, 70.0)), data.draw(st.floats(-179.0, 179.0)))),
        no_fly=shapely.union_all([Point(x, y).buffer(size, 3) for x, y, size in zones]),
        home_m=(data.draw(st.floats(-1500.0, 1500.0)), data.draw(coordinate)),
        lowest_m=lowest_m,
        highest_m=lowest_m + data.draw(st.sampled_from([0.0, 15.0, 40.0])),
        clearance_m=data.draw(st.sampled_from([10.0, 25.0, 50.0])),
    )
    radius_m = data.draw(st.sampled_from([0.0, 12.5, 48.0, 120.0]))
    stations = stations_in(surroundings, data.draw(st.integers(1, 7)), radius_m=radius_m, seed=seed)
    assume(stations)
    try:
        _, _, fleet = planned(data.draw(st.sampled_from(FIRMWARES)), surroundings, stations)
    except InputError:
        return  # some cannot be reached
    assert fleet.proof.conflicts == ()
    assert fleet.proof.least_horizontal_m >= surroundings.clearance_m - 0.1


@pytest.fixture(scope="module", params=FIRMWARES, ids=lambda firmware: firmware.name)
def fleet(request):
    zone = shapely.box(-60.0, 200.0, 60.0, 300.0)
    surroundings = surroundings_of(no_fly=zone)
    stations = [
        station_at(-500.0, 700.0, 90.0),
        station_at(-520.0, 200.0, 110.0, name="uav_1"),
        station_at(500.0, 500.0, 100.0, name="uav_2"),
    ]
    transit, _, missions = planned(request.param, surroundings, stations)
    launches_s = [way.launch_s for way in transit.ways]
    return surroundings, stations, [items_of(one) for one in missions.documents], launches_s


def whats(fleet, change):
    surroundings, stations, missions, launches_s = fleet
    changed = [list(items) for items in missions]
    proof = prove(surroundings, stations, changed, change(changed) or launches_s, SPEEDS)
    return [(conflict.drones, conflict.what) for conflict in proof.conflicts]


def with_altitude(items, altitude_m):
    return [
        one._replace(altitude_m=altitude_m) if one.place and one.command != Command.LAND else one
        for one in items
    ]


def test_the_fleet_itself_has_no_conflict(fleet):
    assert whats(fleet, lambda missions: None) == []


def test_two_drones_that_start_together_are_found(fleet):
    (found, *_) = whats(fleet, lambda missions: [0.0, 0.0, 100.0])
    assert found[0] == ("uav_0", "uav_1")
    assert "come within 0.0 m beside and 0.0 m above" in found[1]


def test_a_drone_that_flies_through_the_circle_of_another_is_found(fleet):
    def through(missions):
        missions[2].insert(2, item(Command.WAYPOINT, 600, at=(-520.0, 152.0), altitude_m=112.0))

    found = whats(fleet, through)
    assert any(drones == ("uav_1", "uav_2") for drones, _ in found)


def test_a_way_through_a_zone_is_found(fleet):
    def through(missions):
        missions[1].insert(2, item(Command.WAYPOINT, at=(0.0, 250.0), altitude_m=60.0))

    assert (("uav_1",), "flies through a no-fly zone") in whats(fleet, through)


def test_a_zone_that_a_way_only_cuts_between_two_seconds_is_found(fleet):
    surroundings, stations, missions, launches_s = fleet
    way = shapely.LineString([surroundings.home_m, (stations[0].east_m, stations[0].north_m)])
    strip = way.interpolate(400.03).buffer(0.1)
    surroundings = dataclasses.replace(surroundings, no_fly=strip)
    proof = prove(surroundings, stations, missions, launches_s, SPEEDS)
    assert [conflict.what for conflict in proof.conflicts] == ["flies through a no-fly zone"]


def test_flying_too_high_is_found(fleet):
    def raised(missions):
        missions[0][:] = with_altitude(missions[0], 120.5)

    found = whats(fleet, raised)
    assert (("uav_0",), "flies higher than 120 m") in found
    assert (("uav_0",), "never comes to its station") in found


def test_leaving_the_area_is_found(fleet):
    def left(missions):
        missions[0].insert(2, item(Command.WAYPOINT, at=(-1300.0, 0.0), altitude_m=60.0))

    assert (("uav_0",), "leaves the area") in whats(fleet, left)


def test_swapped_missions_and_a_landing_elsewhere_are_found(fleet):
    def swapped(missions):
        missions[0], missions[1] = missions[1], missions[0]

    assert (("uav_0",), "never comes to its station") in whats(fleet, swapped)

    def elsewhere(missions):
        missions[2][-1] = item(Command.LAND, at=(0.0, 0.0))

    assert (("uav_2",), "does not land at home") in whats(fleet, elsewhere)


def test_from_a_home_outside_of_the_area_only_circles_have_to_lie_in_it():
    surroundings = surroundings_of(home_m=(0.0, -2000.0))
    stations = [station_at(0.0, 0.0)]
    _, _, fleet = planned(Firmware.PX4, surroundings, stations)
    assert fleet.proof.conflicts == ()
    small = surroundings_of(area=shapely.box(-47.0, -60.0, 60.0, 60.0), home_m=(0.0, -2000.0))
    items = [items_of(document) for document in fleet.documents]
    (conflict,) = prove(small, stations, items, [0.0], SPEEDS).conflicts
    assert conflict.what == "leaves the area"
