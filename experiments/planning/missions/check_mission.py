"""Checks the items of a mission against what autopilots accept."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from shapely.geometry import LineString

from orchid_uav.experiments.planning.missions.ardupilot import MOST_RADIUS_M, MOST_TURNS
from orchid_uav.experiments.planning.missions.check_fence import Route, ring
from orchid_uav.experiments.planning.missions.findings import Findings, check_degrees
from orchid_uav.experiments.planning.missions.items import (
    LONGEST_HOLD_S,
    Command,
    Firmware,
    Frame,
)
from orchid_uav.experiments.planning.site import MOST_ACROSS_M, Place, Site

_FARTHEST_LEG_M = 900.0
"""MIS_DIST_1WP and MIS_DIST_WPS of PX4 before 1.14."""
_MOST_JUMPS = 32_767
_RELATIVE_FRAMES = {3, 6, 10, 11}
_PX4_FRAMES = {0, 3, 5, 6}
_HAS_POSITION = {16, 17, 18, 19, 21, 22, 31, 82, 84, 85, 4501}
_FOR_VTOL = {84, 85, 3000}
_PX4_ROI = {195, 201}
"""They have a position or not, as their frame says."""
_PX4_COMMANDS = (
    {0, 16, 17, 19, 20, 21, 22, 31, 84, 85, 93, 4501, 42600, 211, 177, 178, 179, 189, 2003, 203}
    | {2000, 2001, 2500, 2501, 200, 204, 205, 1000, 1001, 187, 195, 196, 197, 201, 206, 260, 214}
    | {530, 531, 532, 3000}
)
"""FeasibilityChecker::checkMissionItemValidity."""
_ARDUPILOT_NULLS = {16: {3}, 21: {3}, 22: {3}, 84: {3}, 85: {2, 3}}
"""AP_Mission::sanity_check_params: which of the first four parameters may be missing."""
_HIGHEST_TURNING_M = 255


class ReadItem(NamedTuple):
    """A mission item as it was read; None stands for null."""

    where: str
    number: int | None
    """By which jumps call it."""
    command: int
    frame: int
    params: tuple[float | None, ...]
    """Seven of them; the last three are latitude, longitude and altitude."""

    @property
    def place(self) -> Place | None:
        """Its position, if it has one; ArduPilot takes 0, 0 for where the drone is then."""
        latitude_deg, longitude_deg = self.params[4], self.params[5]
        if self.command not in _HAS_POSITION or latitude_deg is None or longitude_deg is None:
            return None
        return Place(latitude_deg, longitude_deg) if latitude_deg or longitude_deg else None


def check_items(
    findings: Findings,
    items: Sequence[ReadItem],
    firmware: int | None,
    home: Place | None,
    home_height_m: float,
) -> list[Route]:
    """Check items one by one and in their order; returns what they fly along."""
    if not items:
        findings.warning("the mission", "it has no items: a drone that flies it does nothing")
        return []
    usable = True
    for item in items:
        usable &= _check_position(findings, item, firmware, home)
        _check_common(findings, item)
        if firmware == Firmware.PX4:
            _check_px4(findings, item)
        elif firmware == Firmware.ARDUPILOT:
            _check_ardupilot(findings, item)
    _check_numbers(findings, items)
    _check_start_and_end(findings, items, firmware, home_height_m)
    if not usable or home is None:
        return []
    routes = list(_routes(items, home))
    _check_distances(findings, items, firmware, home)
    return routes


def _check_position(
    findings: Findings, item: ReadItem, firmware: int | None, home: Place | None
) -> bool:
    """Whether the position, if the command has one, is of use; if not, it is noted."""
    if item.command not in _HAS_POSITION:
        return True
    where = f"{item.where}.params"
    if None in item.params[4:]:
        findings.error(where, "a latitude, longitude or altitude is missing")
        return False
    if item.place is not None:
        return check_degrees(findings, *item.place, where) and (
            home is None or _is_near_home(findings, item.place, where, home)
        )
    if firmware != Firmware.ARDUPILOT:
        findings.error(where, "latitude 0, longitude 0 lies in the sea off Africa")
    return firmware == Firmware.ARDUPILOT


def _is_near_home(findings: Findings, place: Place, where: str, home: Place) -> bool:
    distance_m = _distance_m(home, place)
    if distance_m <= MOST_ACROSS_M:
        return True
    hint = "one of them is mistaken"
    if abs(place.longitude_deg) <= 90.0:
        swapped = Place(place.longitude_deg, place.latitude_deg)
        if _distance_m(home, swapped) <= MOST_ACROSS_M:
            hint = "latitude and longitude look swapped"
    findings.error(where, f"the position is {distance_m / 1000.0:.0f} km from home: {hint}")
    return False


def _check_common(findings: Findings, item: ReadItem) -> None:
    altitude_m = item.params[6]
    flown_high = item.command in _HAS_POSITION - {Command.LAND, 85}
    is_above_home = item.frame not in _RELATIVE_FRAMES or altitude_m is None or altitude_m > 0.0
    if flown_high and not is_above_home:
        findings.error(
            f"{item.where}.params[6]",
            f"altitude {altitude_m:g} m is not above home; it has to be more than 0",
        )
    if item.command == Command.DO_CHANGE_SPEED and item.params[1] == 0.0:
        findings.error(f"{item.where}.params[1]", "a speed of 0 m/s; it has to be more")


def _check_px4(findings: Findings, item: ReadItem) -> None:
    where = f"{item.where}.command"
    if item.command == Command.LOITER_TURNS:
        findings.error(
            where,
            "PX4 refuses missions with NAV_LOITER_TURNS (18); a circle is a polygon of waypoints "
            "with DO_JUMP (177), or NAV_LOITER_TIME (19) hovers",
        )
    elif item.command not in _PX4_COMMANDS:
        findings.error(where, f"PX4 refuses missions with command {item.command}")
    elif item.command in _FOR_VTOL:
        findings.error(where, f"command {item.command} is for VTOL aircraft, not for copters")
    elif item.command in _HAS_POSITION and item.frame not in _PX4_FRAMES:
        findings.error(
            f"{item.where}.frame",
            f"PX4 takes positions in frame 3 (above home) or 0 (above sea), not in {item.frame}",
        )
    elif item.command not in _HAS_POSITION | _PX4_ROI and item.frame != Frame.NO_POSITION:
        findings.error(
            f"{item.where}.frame",
            f"PX4 takes command {item.command}, which has no position, in frame 2 only, not in "
            f"{item.frame}",
        )


def _check_ardupilot(findings: Findings, item: ReadItem) -> None:
    for index, value in enumerate(item.params[:4]):
        if value is None and index not in _ARDUPILOT_NULLS.get(item.command, set()):
            findings.error(
                f"{item.where}.params[{index}]",
                f"ArduPilot refuses command {item.command} with null here; 0 is right",
            )
    first, third = item.params[0] or 0.0, item.params[2] or 0.0
    if item.command == Command.LOITER_TURNS:
        if first > MOST_TURNS:
            findings.error(
                f"{item.where}.params[0]",
                f"ArduPilot holds up to {MOST_TURNS} turns; {first:g} have to be several items",
            )
        radius_m = abs(third)
        if radius_m < 1.0:
            findings.warning(
                f"{item.where}.params[2]",
                "a radius below 1 m is the drone's own setting (CIRCLE_RADIUS); give one in metres",
            )
        elif radius_m > MOST_RADIUS_M:
            findings.error(
                f"{item.where}.params[2]", f"ArduPilot holds radii up to {MOST_RADIUS_M} m"
            )
        elif radius_m % (10.0 if radius_m > _HIGHEST_TURNING_M else 1.0):
            findings.warning(
                f"{item.where}.params[2]",
                f"ArduPilot cuts off a radius of {radius_m:g} m: whole metres up to "
                f"{_HIGHEST_TURNING_M}, then tens of metres",
            )
    if item.command in (Command.WAYPOINT, Command.LOITER_TIME) and first > LONGEST_HOLD_S:
        findings.error(
            f"{item.where}.params[0]",
            f"ArduPilot holds up to {LONGEST_HOLD_S} s; {first:g} s have to be several items",
        )
    if item.command == Command.DO_JUMP and (item.params[1] or 0.0) > _MOST_JUMPS:
        findings.error(f"{item.where}.params[1]", f"ArduPilot repeats up to {_MOST_JUMPS} times")


def _check_numbers(findings: Findings, items: Sequence[ReadItem]) -> None:
    numbers: dict[int, str] = {}
    for item in items:
        if item.number is None:
            continue
        if item.number in numbers:
            findings.error(
                f"{item.where}.doJumpId",
                f"{item.number} is the number of {numbers[item.number]} already; each has its own",
            )
        numbers.setdefault(item.number, item.where)
    for item in items:
        if item.command != Command.DO_JUMP:
            continue
        target, repeats = item.params[0], item.params[1]
        if target not in numbers:
            findings.error(
                f"{item.where}.params[0]",
                f"it jumps to doJumpId {target if target is None else f'{target:g}'}, which no "
                "item has",
            )
        if repeats is None or repeats < 0.0:
            findings.warning(
                f"{item.where}.params[1]",
                "it repeats without an end: the drone flies until its battery is empty",
            )


def _check_start_and_end(
    findings: Findings, items: Sequence[ReadItem], firmware: int | None, home_height_m: float
) -> None:
    places = [item for item in items if item.command in _HAS_POSITION]
    takeoffs = [item for item in items if item.command == Command.TAKEOFF]
    if not takeoffs:
        findings.warning(
            "the mission", "there is no take-off (22): it can only be started in the air"
        )
    for item in takeoffs:
        if item is not places[0]:
            note = findings.error if firmware == Firmware.PX4 else findings.warning
            note(
                f"{item.where}.command",
                "a take-off has to be the first item with a position; PX4 refuses others",
            )
        altitude_m = item.params[6]
        if item.frame == Frame.ABOVE_SEA and altitude_m is not None and altitude_m <= home_height_m:
            findings.error(f"{item.where}.params[6]", "the take-off ends below home")
    if items[0].command == Command.LAND:
        findings.error(f"{items[0].where}.command", "a mission must not begin with a landing")
    if items[-1].command not in (Command.LAND, Command.RETURN_TO_LAUNCH):
        findings.warning(
            f"{items[-1].where}.command",
            "the last item is neither a landing (21) nor a return (20): the drone stays in the air",
        )


def _check_distances(
    findings: Findings, items: Sequence[ReadItem], firmware: int | None, home: Place
) -> None:
    if firmware != Firmware.PX4:
        return
    before, name = home, "home"
    for item in items:
        if item.place is None:
            continue
        length_m = _distance_m(before, item.place)
        if length_m > _FARTHEST_LEG_M:
            findings.warning(
                f"{item.where}.params",
                f"it is {length_m:.0f} m from {name}; PX4 refuses or warns of more than "
                f"{_FARTHEST_LEG_M:g} m (MIS_DIST_1WP, MIS_DIST_WPS): waypoints between them help",
            )
        before, name = item.place, "the position before"


def _routes(items: Sequence[ReadItem], home: Place) -> Iterator[Route]:
    """Straight lines between positions, also where a jump leads back, and circles."""
    numbered = {float(item.number): item for item in items if item.number is not None}
    before = home
    for item in items:
        if item.command == Command.DO_JUMP:
            target = numbered.get(item.params[0] or 0.0)
            if target is not None and target.place is not None:
                yield Route(item.where, _line(before, target.place), "the way back of the jump")
            continue
        if item.place is None:
            continue
        place = item.place
        if item.command == Command.LOITER_TURNS and (item.params[2] or 0.0) != 0.0:
            circle = ring(place, abs(item.params[2] or 0.0))
            yield Route(item.where, LineString([*circle, circle[0]]), "the circle")
            nearest = np.argmin(np.hypot(*(circle - (before.longitude_deg, before.latitude_deg)).T))
            place = Place(*map(float, circle[nearest][::-1]))
        yield Route(item.where, _line(before, place), "the way there")
        before = place


def _line(start: Place, end: Place) -> LineString:
    # Autopilots do not leap at longitude 180; nothing is fenced there.
    return LineString(
        [(start.longitude_deg, start.latitude_deg), (end.longitude_deg, end.latitude_deg)]
    )


def _distance_m(start: Place, end: Place) -> float:
    """Roughly, also where it is far."""
    mean = math.radians((start.latitude_deg + end.latitude_deg) / 2.0)
    turn = (end.longitude_deg - start.longitude_deg + 180.0) % 360.0 - 180.0
    north_m = 111_195.0 * (end.latitude_deg - start.latitude_deg)
    far_m = math.hypot(north_m, 111_195.0 * turn * math.cos(mean))
    if far_m > 2.0 * MOST_ACROSS_M:
        return far_m
    return float(np.hypot(*Site(start).to_local_m([end])[0]))
