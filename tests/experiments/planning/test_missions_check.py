"""The check of mission files finds planted faults, and nothing in files without any."""

import copy
import json
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.check import MOST_BYTES, check_plan_file
from orchid_uav.experiments.planning.missions.items import Command, Firmware
from orchid_uav.experiments.planning.missions.waypoints_file import waypoints_text
from orchid_uav.experiments.planning.site import Place, Site
from tests.helpers.fleets import planned, station_at, surroundings_of

FAR_EAST = Place(47.0, 8.0)


@pytest.fixture(scope="module")
def fleets():
    surroundings = surroundings_of(
        site=Site(FAR_EAST), no_fly=surroundings_of(160.0).area, home_m=(0.0, -900.0)
    )
    stations = [station_at(300.0, 300.0)]
    return {firmware: planned(firmware, surroundings, stations)[2] for firmware in Firmware}


@pytest.fixture
def px4(fleets):
    return copy.deepcopy(fleets[Firmware.PX4].documents[0])


@pytest.fixture
def ardupilot(fleets):
    return copy.deepcopy(fleets[Firmware.ARDUPILOT].documents[0])


@pytest.fixture
def checked(tmp_path):
    def check(content, suffix=".plan"):
        path = tmp_path / f"mission{suffix}"
        if isinstance(content, dict | list):
            content = json.dumps(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return check_plan_file(path)

    return check


def first(document, command):
    return next(item for item in document["mission"]["items"] if item["command"] == command)


def sole(findings):
    assert len(findings) == 1, findings
    return findings[0]


def test_what_is_written_here_has_no_findings(checked, fleets):
    for fleet in fleets.values():
        assert checked(fleet.documents[0]) == []
    mission = fleets[Firmware.ARDUPILOT].missions[0]
    assert checked(waypoints_text(mission), ".waypoints") == []


def drop(path):
    def change(document):
        *parents, key = path
        place = document
        for parent in parents:
            place = place[parent]
        del place[key]

    return change


def put(path, value):
    def change(document):
        *parents, key = path
        place = document
        for parent in parents:
            place = place[parent]
        place[key] = value

    return change


ITEM = ("mission", "items", 2)
ROOT_AND_ITEMS = [
    (drop(["fileType"]), "the file", "there is no fileType; it has to be a text"),
    (put(["fileType"], "Mission"), "fileType", "this is 'Mission'; it has to be \"Plan\""),
    (put(["version"], 2), "version", "this is version 2; programs load version 1"),
    (put(["version"], "1"), "version", "this is '1'; it has to be a number"),
    (drop(["groundStation"]), "the file", "there is no groundStation"),
    (drop(["mission"]), "the file", "there is no mission; it has to be an object"),
    (put(["mission"], []), "mission", "this is a list of 0; it has to be an object"),
    (put(["mission", "version"], 1), "mission.version", "programs load version 2"),
    (drop(["mission", "firmwareType"]), "mission", "there is no firmwareType"),
    (put(["mission", "cruiseSpeed"], "fast"), "mission.cruiseSpeed", "a number or null"),
    (drop(["mission", "plannedHomePosition"]), "mission", "there is no plannedHomePosition"),
    (
        put(["mission", "plannedHomePosition"], [47.0, 8.0]),
        "mission.plannedHomePosition",
        "this is a list of 2; it has to be [latitude, longitude, altitude]",
    ),
    (drop(["mission", "items"]), "mission", "there is no items; it has to be a list"),
    (put(ITEM, 7), "mission.items[2]", "this is 7; an item is an object"),
    (put([*ITEM, "type"], "Item"), "mission.items[2].type", "neither SimpleItem nor ComplexItem"),
    (drop([*ITEM, "frame"]), "mission.items[2]", "there is no frame"),
    (put([*ITEM, "command"], True), "mission.items[2].command", "this is True"),
    (put([*ITEM, "autoContinue"], 1), "mission.items[2].autoContinue", "it has to be true or"),
    (put([*ITEM, "params"], [0] * 6), "mission.items[2].params", "there are 6; there have to be 7"),
    (put([*ITEM, "params", 3], "0"), "mission.items[2].params[3]", "it has to be a number or null"),
    (drop([*ITEM, "Altitude"]), "mission.items[2]", "all three or none"),
    (put([*ITEM, "Altitude"], 55), "mission.items[2].Altitude", "QGroundControl flies the one"),
    (put([*ITEM, "frame"], 0), "mission.items[2].AltitudeMode", "1 (above home) goes with frame 3"),
    (put([*ITEM, "doJumpId"], 1), "mission.items[2].doJumpId", "1 is the number of mission.items"),
    (put([*ITEM, "params", 6], None), "mission.items[2].params", "altitude is missing"),
    (put([*ITEM, "params", 4], 95.0), "mission.items[2].params", "latitude and longitude look"),
    (put([*ITEM, "params", 5], 190.0), "mission.items[2].params", "longitude 190 is not between"),
    (
        put([*ITEM, "params", slice(4, 6)], [8.0, 47.0]),
        "mission.items[2].params",
        "latitude and longitude look swapped",
    ),
    (put([*ITEM, "params", 4], 48.5), "mission.items[2].params", "168 km from home: one of them"),
    (put([*ITEM, "params", slice(4, 6)], [0, 0]), "mission.items[2].params", "off Africa"),
    (put(["geoFence"], None), "geoFence", "this is null; it has to be an object"),
    (put(["geoFence", "version"], 1), "geoFence.version", "programs load version 2"),
    (drop(["geoFence", "circles"]), "geoFence", "there is no circles"),
    (put(["geoFence", "polygons", 0], []), "geoFence.polygons[0]", "this is no object"),
    (drop(["rallyPoints", "points"]), "rallyPoints", "there is no points"),
    (put(["rallyPoints", "points"], [[1, 2]]), "rallyPoints.points[0]", "altitude]"),
]


@pytest.mark.parametrize(("change", "where", "what"), ROOT_AND_ITEMS)
def test_faults_that_keep_a_plan_from_loading_are_found(checked, px4, change, where, what):
    change(px4)
    found = sole([finding for finding in checked(px4) if finding.severity == "error"])
    assert found.where == where
    assert what in found.what


def test_px4_refuses_some_commands_and_frames(checked, px4):
    first(px4, Command.DO_CHANGE_SPEED)["frame"] = 3
    found = sole(checked(px4))
    assert found.where == "mission.items[1].frame"
    assert "PX4 takes command 178, which has no position, in frame 2 only" in found.what
    first(px4, Command.DO_CHANGE_SPEED)["frame"] = 2
    first(px4, Command.WAYPOINT)["frame"] = 10
    for key in ("AltitudeMode", "Altitude", "AMSLAltAboveTerrain"):
        del first(px4, Command.WAYPOINT)[key]
    assert "frame 3 (above home) or 0 (above sea), not in 10" in sole(checked(px4)).what


@pytest.mark.parametrize(
    ("command", "what"),
    [(18, "a circle is a polygon of waypoints"), (82, "command 82"), (84, "is for VTOL")],
)
def test_px4_refuses_commands(checked, px4, command, what):
    item = px4["mission"]["items"][2]
    item["command"] = command
    found = [finding for finding in checked(px4) if finding.where == "mission.items[2].command"]
    assert what in sole(found).what


def test_a_mission_for_ardupilot_is_no_mission_for_px4(checked, ardupilot):
    ardupilot["mission"]["firmwareType"] = 12
    found = sole(checked(ardupilot))
    assert found.severity == "error" and "NAV_LOITER_TURNS (18)" in found.what


def test_a_mission_for_px4_is_no_mission_for_ardupilot_where_it_has_null(checked, px4):
    px4["mission"]["firmwareType"] = 3
    assert checked(px4) == []  # null is where ArduPilot takes it
    first(px4, Command.DO_JUMP)["params"][3] = None
    found = sole(checked(px4))
    assert "ArduPilot refuses command 177 with null here" in found.what
    assert found.where.endswith(".params[3]")


@pytest.mark.parametrize(
    ("index", "value", "severity", "what"),
    [
        (0, 256, "error", "up to 255 turns; 256 have to be several items"),
        (2, 3000, "error", "radii up to 2550 m"),
        (2, 48.5, "warning", "cuts off a radius of 48.5 m"),
        (2, 0, "warning", "CIRCLE_RADIUS"),
    ],
)
def test_what_ardupilot_holds_of_circles(checked, ardupilot, index, value, severity, what):
    first(ardupilot, Command.LOITER_TURNS)["params"][index] = value
    ardupilot["geoFence"]["polygons"] = []
    found = sole(checked(ardupilot))
    assert (found.severity, found.where.split(".")[-1]) == (severity, f"params[{index}]")
    assert what in found.what


def test_ardupilot_holds_seconds_and_repeats_in_16_bits(checked, ardupilot):
    ardupilot["mission"]["items"][2]["params"][0] = 70_000
    assert "up to 65535 s; 70000 s" in sole(checked(ardupilot)).what
    ardupilot["mission"]["items"][2]["params"][0] = 0
    jump = {"type": "SimpleItem", "command": 177, "frame": 2, "autoContinue": True}
    jump |= {"params": [1, 40_000, 0, 0, 0, 0, 0], "doJumpId": 99}
    ardupilot["mission"]["items"].insert(3, jump)
    assert any("up to 32767 times" in finding.what for finding in checked(ardupilot))


def test_zero_zero_is_where_the_drone_is_for_ardupilot(checked, ardupilot):
    ardupilot["mission"]["items"][0]["params"][4:6] = [0, 0]
    assert checked(ardupilot) == []


def test_jumps_have_a_target_and_an_end(checked, px4):
    first(px4, Command.DO_JUMP)["params"][0] = 77
    assert "it jumps to doJumpId 77, which no item has" in sole(checked(px4)).what
    first(px4, Command.DO_JUMP)["params"][:2] = [5, -1]
    found = sole(checked(px4))
    assert found.severity == "warning" and "without an end" in found.what


def test_the_start_and_the_end_of_a_mission(checked, px4):
    items = px4["mission"]["items"]
    takeoff, landing = items.pop(0), items.pop()
    found = checked(px4)
    assert [finding.severity for finding in found] == ["warning", "warning"]
    assert "there is no take-off" in found[0].what
    assert "neither a landing (21) nor a return (20)" in found[1].what
    px4["mission"]["items"] = [*items[:3], takeoff, *items[3:], landing]
    errors = [finding for finding in checked(px4) if finding.severity == "error"]
    assert "the first item with a position" in sole(errors).what
    px4["mission"]["items"] = []
    assert "it has no items" in sole(checked(px4)).what
    px4["mission"]["items"] = [landing]
    assert any("begin with a landing" in finding.what for finding in checked(px4))


def test_altitudes_are_above_home(checked, px4):
    for altitude_m in (0.0, -5.0):
        takeoff = px4["mission"]["items"][0]
        takeoff["params"][6] = takeoff["Altitude"] = altitude_m
        assert f"altitude {altitude_m:g} m is not above home" in sole(checked(px4)).what
    for key in ("AltitudeMode", "Altitude", "AMSLAltAboveTerrain"):
        del takeoff[key]
    takeoff["frame"], takeoff["params"][6] = 0, 149.0  # home is at 150 m above sea
    assert "the take-off ends below home" in sole(checked(px4)).what


def test_a_speed_of_nothing_is_found(checked, px4):
    first(px4, Command.DO_CHANGE_SPEED)["params"][1] = 0
    assert "a speed of 0 m/s" in sole(checked(px4)).what


def test_long_legs_are_warned_of_for_px4(checked, px4, ardupilot):
    for document in (px4, ardupilot):
        document["geoFence"]["polygons"] = []
        document["mission"]["items"][2]["params"][4] += 0.02  # some 2 km north
    assert {finding.severity for finding in checked(px4)} == {"warning"}
    assert "MIS_DIST_1WP" in checked(px4)[0].what
    assert checked(ardupilot) == []


def rectangle(north, south, west, east):
    return [[north, west], [north, east], [south, east], [south, west]]


def fenced(document, *, inclusion, polygon):
    document["geoFence"]["polygons"] = [{"version": 1, "inclusion": inclusion, "polygon": polygon}]


@pytest.mark.parametrize(
    ("polygon", "what"),
    [
        ([[47.1, 7.9], [47.1, 8.1]], "it has 2 corners"),
        ([*rectangle(47.1, 46.9, 7.9, 8.1), [47.1, 7.9]], "the last corner repeats the first"),
        ([[47.1, 7.9], [46.9, 8.1], [47.1, 8.1], [46.9, 7.9]], "cross or touch each other"),
        (rectangle(47.1, 46.9, -179.0, 179.0), "crosses longitude 180"),
        ([[47.1, 7.9], [47.1, 8.1], [97.0, 8.0]], "latitude 97"),
        ([[47.1, 7.9], [47.1, 8.1], 5], "this is 5; it has to be [latitude, longitude]"),
    ],
)
def test_faulty_fences_are_found(checked, px4, polygon, what):
    fenced(px4, inclusion=True, polygon=polygon)
    found = sole(checked(px4))
    assert found.severity == "error" and what in found.what
    assert found.where.startswith("geoFence.polygons[0].polygon")


def test_home_and_the_mission_against_the_fence(checked, px4):
    home_latitude = px4["mission"]["plannedHomePosition"][0]
    fenced(px4, inclusion=True, polygon=rectangle(47.1, home_latitude + 0.001, 7.9, 8.1))
    found = sole(checked(px4))
    assert found.where == "geoFence.polygons[0]"
    assert "home lies outside of this inclusion" in found.what
    fenced(px4, inclusion=False, polygon=rectangle(home_latitude + 0.001, 46.9, 7.9, 8.1))
    assert "home lies inside this exclusion" in sole(checked(px4)).what
    fenced(px4, inclusion=True, polygon=rectangle(47.001, 46.9, 7.9, 8.1))
    found = checked(px4)
    assert len(found) > 5
    assert all("leaves the inclusion geoFence.polygons[0]" in finding.what for finding in found)
    # A strip between two waypoints, in which none of them lies
    fenced(px4, inclusion=False, polygon=rectangle(46.9951, 46.995, 7.9, 8.1))
    found = checked(px4)
    assert len(found) == 2  # there and back
    assert "the way there enters the exclusion" in found[0].what


def test_circles_of_fences_and_of_missions(checked, ardupilot):
    circle = first(ardupilot, Command.LOITER_TURNS)
    center = circle["params"][4:6]
    fence = ardupilot["geoFence"]
    fence["polygons"] = []
    fence["circles"] = [
        {"version": 1, "inclusion": False, "circle": {"center": center, "radius": 40.0}}
    ]
    assert checked(ardupilot) == []  # it circles round it
    fence["circles"][0]["circle"]["radius"] = 50.0
    assert any("the circle enters the exclusion" in one.what for one in checked(ardupilot))
    fence["circles"][0]["circle"]["radius"] = -1
    assert "metres above 0" in sole(checked(ardupilot)).what
    fence["circles"][0]["circle"] = {"center": [1, 2, 3], "radius": 5}
    assert "[latitude, longitude]" in sole(checked(ardupilot)).what


def test_more_corners_than_autopilots_store_are_warned_of(checked, px4):
    north = [[47.1, 7.9 + 0.002 * step] for step in range(100)]
    fenced(px4, inclusion=True, polygon=[*north, [46.9, 8.1], [46.9, 7.9]])
    found = sole(checked(px4))
    assert found.severity == "warning" and "102 corners" in found.what


def test_rules_of_unknown_firmware_are_not_checked(checked, px4):
    px4["mission"]["firmwareType"] = 8
    found = sole(checked(px4))
    assert found.severity == "warning" and "neither PX4 (12) nor ArduPilot (3)" in found.what


def test_complex_items_are_told_of(checked, px4):
    px4["mission"]["items"].insert(2, {"type": "ComplexItem", "complexItemType": "survey"})
    assert "is not checked" in sole(checked(px4)).what


def test_very_many_findings_are_cut_off(checked, px4):
    px4["mission"]["items"] = [7] * 1000
    found = checked(px4)
    assert len(found) == 201
    assert "more are not listed" in found[-1].what


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"\xff\xfe\x00", "is no text: byte 0 is not UTF-8"),
        ("", "is no JSON: Expecting value in line 1, column 1"),
        ('{"a": 1,}', "is no JSON: .* in line 1"),
        ('{"mission": NaN}', "NaN is no number of JSON"),
        ('{"mission": ' + "9" * 5000 + "}", "is no JSON"),
        ("[" * 200_000, "nested too deeply"),
    ],
)
def test_what_is_no_plan_at_all_is_refused(checked, content, what):
    with pytest.raises(InputError, match=what):
        checked(content)


def test_files_that_are_missing_or_huge_are_refused(checked, tmp_path):
    with pytest.raises(InputError, match=r"a\.plan cannot be read: No such file"):
        check_plan_file(tmp_path / "a.plan")
    with pytest.raises(InputError, match="cannot be read"):
        check_plan_file(tmp_path)
    with pytest.raises(InputError, match="has 20 MB"):
        checked(b" " * (MOST_BYTES + 1))


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=5,
)


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_anything_in_place_of_anything_is_a_finding_at_most(fleets, tmp_path_factory, data):
    document = copy.deepcopy(fleets[data.draw(st.sampled_from(list(Firmware)))].documents[0])
    for _ in range(data.draw(st.integers(1, 3))):
        place = document
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            deeper = isinstance(place[key], dict | list) and data.draw(st.integers(0, 4))
            if not deeper:
                place[key] = data.draw(VALUES)
                break
            place = place[key]
    path = tmp_path_factory.getbasetemp() / "anything.plan"
    path.write_text(json.dumps(document), encoding="utf-8")
    with suppress(InputError):  # an infinite number
        for finding in check_plan_file(path):
            assert finding.where and finding.what


def test_other_json_is_no_plan(checked):
    assert "a plan is an object" in sole(checked([1, 2])).what
    assert {finding.severity for finding in checked({})} == {"error"}
    assert len(checked({"mission": {"items": [{}]}})) > 5


@pytest.fixture
def rows(fleets):
    return waypoints_text(fleets[Firmware.ARDUPILOT].missions[0]).splitlines()


@pytest.mark.parametrize(
    ("row", "column", "value", "where", "what"),
    [
        (0, 0, "QGC WPL 120", "row 1", 'it has to be "QGC WPL 110"'),
        (1, 3, "22", "row 2", "the first row is not home"),
        (1, 8, "95.0", "row 2", "latitude 95"),
        (3, 0, "7", "row 4", "its number is 7; 2 follows here"),
        (4, 8, "north", "row 5", "could not convert string to float: 'north'"),
        (4, 8, "nan", "row 5", "infinite or missing"),
        (4, 2, "3.0", "row 5", "all columns hold numbers"),
        (4, 11, "1\t1", "row 5", "there are 13 columns; there have to be 12"),
        (4, 9, "80.0", "row 5.params", "km from home"),
    ],
)
def test_faults_in_waypoints_files_are_found(checked, rows, row, column, value, where, what):
    fields = rows[row].split("\t")
    fields[column] = value
    rows[row] = "\t".join(fields)
    found = checked("\n".join(rows), ".waypoints")[0]
    assert (found.severity, found.where) == ("error", where)
    assert what in found.what


def test_a_waypoints_file_without_rows_is_told_of(checked):
    assert "the first is home" in sole(checked("QGC WPL 110\n", ".waypoints")).what
