"""Mission files, as other programs read them, and as a vehicle gets them."""

import json
import math
from itertools import pairwise

import mavsdk
import numpy as np
import pytest
from mavsdk.plugins.mission_raw import MissionRaw
from pymap3d.vincenty import vdist
from pymavlink import mavwp

from orchid_uav.experiments.planning.missions import ardupilot, px4
from orchid_uav.experiments.planning.missions.items import Command, Firmware
from orchid_uav.experiments.planning.missions.plan_file import items_of, write_plan
from orchid_uav.experiments.planning.missions.waypoints_file import items_of as rows_of
from orchid_uav.experiments.planning.missions.waypoints_file import waypoints_text
from orchid_uav.experiments.planning.site import Place, Site
from tests.helpers.fleets import planned, station_at, stations_in, surroundings_of
from tests.helpers.vehicle import LoopbackVehicle

SITES = {
    "north-west": Place(18.2655, -66.7005),
    "north-east": Place(47.3769, 8.5417),
    "south-east": Place(-33.8688, 151.2093),
    "south-west": Place(-22.9068, -43.1729),
    "antimeridian": Place(-16.8, 179.9995),
    "70 N": Place(70.0, 25.8),
}
MISSION, FENCE, RALLY = 0, 1, 2
POLYGON_INSIDE, POLYGON_OUTSIDE = 5001, 5002


@pytest.fixture(autouse=True)
def quiet():
    mavsdk.log_subscribe(lambda *_: True)
    yield
    mavsdk.log_unsubscribe()


@pytest.fixture(scope="module", params=SITES)
def site(request):
    return Site(SITES[request.param])


def fleet_at(firmware, site, drones=3, **fields):
    surroundings = surroundings_of(site=site, **fields)
    stations = stations_in(surroundings, drones)
    return surroundings, stations, planned(firmware, surroundings, stations)


def imported_by_mavsdk(firmware, path):
    """What arrives at a vehicle to which MAVSDK uploads a file."""
    configuration = mavsdk.Configuration.create_with_component_type(
        mavsdk.ComponentType.GROUND_STATION
    )
    sdk = mavsdk.Mavsdk(configuration)
    try:
        with LoopbackVehicle(int(firmware)) as vehicle:
            assert sdk.add_any_connection(vehicle.url) == mavsdk.ConnectionResult.SUCCESS
            system = sdk.first_autopilot(10.0)
            assert system is not None
            raw = MissionRaw(system)
            if path.suffix == ".plan":
                read = raw.import_qgroundcontrol_mission(str(path))
            else:
                read = raw.import_mission_planner_mission(str(path))
            raw.upload_mission(read.mission_items)
            if read.geofence_items:
                raw.upload_geofence(read.geofence_items)
            assert read.rally_items == []
            return vehicle.uploads
    finally:
        sdk.destroy()
        configuration.destroy()


def assert_arrived(arrived, command, frame, params, place, altitude_m):
    assert (arrived.command, arrived.frame) == (command, frame)
    for got, sent in zip(
        (arrived.param1, arrived.param2, arrived.param3, arrived.param4), params, strict=True
    ):
        assert math.isnan(got) if sent is None else got == np.float32(sent)
    assert (arrived.x, arrived.y) == tuple(round(degrees * 1e7) for degrees in place or (0, 0))
    assert arrived.z == np.float32(altitude_m)


@pytest.mark.parametrize("firmware", list(Firmware))
def test_a_vehicle_gets_what_the_plan_says(firmware, site, tmp_path):
    surroundings, _, (_, fence, fleet) = fleet_at(firmware, site)
    for index in (0, 2):
        mission, path = fleet.missions[index], tmp_path / f"{index}.plan"
        write_plan(path, fleet.documents[index])
        uploads = imported_by_mavsdk(firmware, path)
        arrived = uploads[MISSION]
        if firmware == Firmware.ARDUPILOT:
            assert_arrived(arrived.pop(0), 16, 5, (0, 0, 0, 0), mission.home, 150.0)
        assert len(arrived) == len(mission.items)
        for got, item in zip(arrived, mission.items, strict=True):
            assert_arrived(got, item.command, item.frame, item.params, item.place, item.altitude_m)
            assert got.autocontinue == 1
        corners = [
            (POLYGON_INSIDE if inclusion else POLYGON_OUTSIDE, len(polygon), corner)
            for inclusion, polygon in fence.polygons
            for corner in polygon
        ]
        assert len(uploads.get(FENCE, [])) == len(corners)
        for got, (command, count, corner) in zip(uploads.get(FENCE, []), corners, strict=True):
            assert_arrived(got, command, 0, (count, 0, 0, 0), corner, 0.0)
    assert bool(fence.polygons) == (abs(surroundings.site.center.longitude_deg) < 179.0)


def test_mavsdk_and_pymavlink_read_waypoints_files(site, tmp_path):
    _, _, (_, _, fleet) = fleet_at(Firmware.ARDUPILOT, site, drones=1)
    (mission,) = fleet.missions
    path = tmp_path / "uav_0.waypoints"
    path.write_text(waypoints_text(mission), encoding="utf-8", newline="\n")
    # As for PX4: for ArduPilot, MAVSDK would put home before the home that is there.
    arrived = imported_by_mavsdk(Firmware.PX4, path)[MISSION]
    assert_arrived(arrived.pop(0), 16, 0, (0, 0, 0, 0), mission.home, 150.0)
    for got, item in zip(arrived, mission.items, strict=True):
        assert_arrived(got, item.command, item.frame, item.params, item.place, item.altitude_m)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(mission.items) + 1
    home = loader.wp(0)
    assert (home.frame, home.command, home.x, home.y) == (0, 16, *mission.home)
    for row, item in enumerate(mission.items, 1):
        read = loader.wp(row)
        assert (read.seq, read.command, read.frame) == (row, item.command, item.frame)
        assert (read.x, read.y) == (item.place or (0.0, 0.0))
        assert (read.param1, read.param3, read.z) == (
            item.params[0],
            item.params[2],
            item.altitude_m,
        )


def metres_between(site, place, east_m, north_m):
    """Along the ground, on the ellipsoid."""
    wanted = site.to_places([east_m, north_m])[0]
    return float(vdist(*place, *wanted)[0])


def test_stations_come_through_each_format(site):
    surroundings, stations, (_, _, fleet) = fleet_at(Firmware.ARDUPILOT, site)
    for station, mission, document in zip(stations, fleet.missions, fleet.documents, strict=True):
        read_back = items_of(json.loads(json.dumps(document)))
        for items in (read_back, rows_of(waypoints_text(mission))):
            (circle,) = (item for item in items if item.command == Command.LOITER_TURNS)
            assert metres_between(site, circle.place, station.east_m, station.north_m) < 0.02
            assert circle.altitude_m == pytest.approx(station.altitude_m, abs=0.0051)
            assert circle.params[2] == 48
    _, _, (_, _, fleet) = fleet_at(Firmware.PX4, site)
    for station, document in zip(stations, fleet.documents, strict=True):
        items = items_of(json.loads(json.dumps(document)))
        (jump,) = (index for index, item in enumerate(items) if item.command == Command.DO_JUMP)
        corners = items[int(items[jump].params[0]) - 1 : jump]
        points_m = surroundings.site.to_local_m([corner.place for corner in corners])
        center_m = points_m.mean(axis=0)
        assert np.hypot(*(center_m - (station.east_m, station.north_m))) < 0.02
        assert np.hypot(*(points_m - center_m).T) == pytest.approx(48.0, abs=0.02)
        angles = np.unwrap(np.arctan2(*(points_m - center_m).T[::-1]))
        assert (np.diff(angles) < 0.0).all()  # clockwise, as ArduPilot's positive radius
        assert {corner.altitude_m for corner in corners} == {round(station.altitude_m, 2)}


def test_a_plan_has_what_the_loaders_of_qgroundcontrol_ask_for():
    _, _, (_, _, fleet) = fleet_at(Firmware.PX4, Site(SITES["north-west"]), drones=1)
    (document,) = json.loads(json.dumps(fleet.documents))
    assert list(document) == [
        "fileType",
        "version",
        "groundStation",
        "mission",
        "geoFence",
        "rallyPoints",
    ]
    mission = document["mission"]
    assert (document["fileType"], document["version"], mission["version"]) == ("Plan", 1, 2)
    assert (mission["firmwareType"], mission["vehicleType"]) == (12, 2)
    assert mission["plannedHomePosition"][2] == 150.0
    assert document["rallyPoints"] == {"version": 2, "points": []}
    (polygon,) = document["geoFence"]["polygons"]
    assert (polygon["version"], polygon["inclusion"]) == (1, True)
    assert polygon["polygon"][0] != polygon["polygon"][-1]
    for number, item in enumerate(mission["items"], 1):
        assert item["type"] == "SimpleItem" and item["autoContinue"] is True
        assert item["doJumpId"] == number and len(item["params"]) == 7
        has_position = item["command"] in (16, 21, 22)
        assert item["frame"] == (3 if has_position else 2)
        keys = {"AltitudeMode", "Altitude", "AMSLAltAboveTerrain"}
        assert keys & set(item) == (keys if has_position else set())
        if has_position:
            assert (item["AltitudeMode"], item["Altitude"]) == (1, item["params"][6])
    first, last = mission["items"][0], mission["items"][-1]
    assert (first["command"], last["command"]) == (22, 21)
    assert first["params"][4:6] == last["params"][4:6] == mission["plannedHomePosition"][:2]


def test_a_row_of_a_waypoints_file():
    _, _, (_, _, fleet) = fleet_at(Firmware.ARDUPILOT, Site(SITES["north-east"]), drones=1)
    rows = waypoints_text(fleet.missions[0]).split("\n")
    home = fleet.missions[0].home
    assert rows[0] == "QGC WPL 110" and rows[-1] == ""
    zeros = "\t".join(["0.00000000"] * 4)
    place = f"{home.latitude_deg:.8f}\t{home.longitude_deg:.8f}"
    assert rows[1] == f"0\t1\t0\t16\t{zeros}\t{place}\t150.000000\t1"
    assert rows[2].startswith(f"1\t0\t3\t22\t{zeros}\t{place}\t")


def test_equal_missions_give_equal_bytes(tmp_path):
    for name in ("one", "two"):
        _, _, (_, _, fleet) = fleet_at(Firmware.ARDUPILOT, Site(SITES["north-east"]))
        write_plan(tmp_path / f"{name}.plan", fleet.documents[1])
        path = tmp_path / f"{name}.waypoints"
        path.write_bytes(waypoints_text(fleet.missions[1]).encode())
    for suffix in (".plan", ".waypoints"):
        written = [(tmp_path / f"{name}{suffix}").read_bytes() for name in ("one", "two")]
        assert written[0] == written[1]
        assert b"\r" not in written[0]


def test_legs_are_short_enough_for_older_px4():
    surroundings = surroundings_of(6000.0)
    _, _, fleet = planned(Firmware.PX4, surroundings, [station_at(2500.0, 2500.0)])
    places = [item.place for item in fleet.missions[0].items if item.place]
    legs_m = [float(vdist(*one, *other)[0]) for one, other in pairwise(places)]
    assert 500.0 < max(legs_m) <= 801.0


@pytest.mark.parametrize("firmware", list(Firmware))
def test_a_drone_that_hovers_waits_for_its_time_also_for_days(firmware):
    stations = [station_at(0.0, 300.0, radius_m=0.0)]
    for longest_s, parts in ((1234.5, 1), (150_000.0, 3)):
        _, _, fleet = planned(firmware, surroundings_of(), stations, longest_s)
        items = fleet.missions[0].items
        waits = [item.params[0] for item in items if item.command == Command.LOITER_TIME]
        assert sum(waits) == int(longest_s) and len(waits) == parts
        assert max(waits) <= 65_535
        assert {item.command for item in items} & {Command.DO_JUMP, Command.LOITER_TURNS} == set()
        assert fleet.proof.on_station_s[0] == pytest.approx(longest_s, abs=3.0)


def test_more_turns_than_fit_in_a_byte_are_several_items():
    stations = [station_at(0.0, 300.0, radius_m=20.9)]
    _, _, fleet = planned(Firmware.ARDUPILOT, surroundings_of(), stations, 20_000.0)
    circles = [item for item in fleet.missions[0].items if item.command == Command.LOITER_TURNS]
    assert sum(item.params[0] for item in circles) == fleet.stays[0].turns > 512
    assert [item.params[0] for item in circles[:-1]] == [255] * (len(circles) - 1)
    assert {item.params[2] for item in circles} == {20}


@pytest.mark.parametrize(
    ("radius_m", "flown_m"), [(0.4, 1), (48.0, 48), (48.97, 48), (255.9, 255), (259.0, 250)]
)
def test_radii_are_those_that_ardupilot_holds(radius_m, flown_m):
    assert ardupilot.circle_radius_m(station_at(0.0, 0.0, radius_m=radius_m)) == flown_m


def test_circles_are_flown_no_faster_than_settings_from_the_factory_allow():
    station = station_at(0.0, 0.0)
    # half of 2.5 m/s² for the turn; PX4 half of 3 m/s², on the polygon's inner radius
    assert ardupilot.circling_mps(station) == 7.74
    assert px4.circling_mps(station) < math.sqrt(1.5 * 48.0)
    assert px4.circling_mps(station) > 7.5
    slow = station._replace(speed_mps=3.0)
    assert ardupilot.circling_mps(slow) == px4.circling_mps(slow) == 3.0


@pytest.mark.parametrize("radius_m", [5.0, 20.0, 48.0, 150.0, 400.0])
def test_the_polygon_of_px4_lies_close_to_the_circle(radius_m):
    surroundings = surroundings_of()
    _, _, fleet = planned(Firmware.PX4, surroundings, [station_at(0.0, 300.0, radius_m=radius_m)])
    items = fleet.missions[0].items
    (jump,) = (index for index, item in enumerate(items) if item.command == Command.DO_JUMP)
    corners = jump - int(items[jump].params[0]) + 1
    chord_m = radius_m * (1.0 - math.cos(math.pi / corners))
    assert chord_m <= 1.55
    reached_m = items[jump - 1].params[1]
    assert reached_m == pytest.approx(radius_m * math.sin(math.pi / corners), abs=0.01)
    assert items[jump].params[1] == fleet.stays[0].turns - 1
