"""Mission items as autopilots know them (MAVLink), before they are put in a file."""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from orchid_uav.experiments.planning.missions.stays import Stay
from orchid_uav.experiments.planning.missions.transit import DroneWay
from orchid_uav.experiments.planning.model import Floats, Station, Surroundings
from orchid_uav.experiments.planning.site import Place, Site

DEGREE_DIGITS = 7
"""Autopilots hold positions as whole numbers of 1e-7 degrees."""
ALTITUDE_DIGITS = 2
LONGEST_LEG_M = 800.0
"""Between two waypoints: PX4 before 1.14 refuses missions with more than 900 m (MIS_DIST_WPS)."""
LONGEST_HOLD_S = 65_535
"""ArduPilot holds seconds in 16 bits."""
_SAME_M = 0.01


class Command(IntEnum):
    """Commands of mission items that are written here (MAV_CMD)."""

    WAYPOINT = 16
    LOITER_TURNS = 18
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    LAND = 21
    TAKEOFF = 22
    DO_JUMP = 177
    DO_CHANGE_SPEED = 178


class Frame(IntEnum):
    """What the position of an item refers to (MAV_FRAME)."""

    ABOVE_SEA = 0
    NO_POSITION = 2
    ABOVE_HOME = 3


class Firmware(IntEnum):
    """Which autopilot a mission is for (MAV_AUTOPILOT)."""

    ARDUPILOT = 3
    PX4 = 12


class MissionItem(NamedTuple):
    """One item of a mission."""

    command: Command
    params: tuple[float | None, float | None, float | None, float | None]
    """None leaves a value to the autopilot."""
    place: Place | None = None
    altitude_m: float = 0.0
    """Above home."""

    @property
    def frame(self) -> Frame:
        """What its position refers to."""
        return Frame.NO_POSITION if self.place is None else Frame.ABOVE_HOME


class Mission(NamedTuple):
    """The mission of one drone."""

    drone: str
    firmware: Firmware
    home: Place
    home_height_amsl_m: float
    cruise_mps: float
    items: tuple[MissionItem, ...]


def places_of(site: Site, points_m: Floats) -> list[Place]:
    """Where points, (K, 2) or (K, 3), lie on earth, in the digits that autopilots hold."""
    degrees = np.round(site.to_places(np.asarray(points_m)[:, :2]), DEGREE_DIGITS) + 0.0
    return [Place(float(latitude), float(longitude)) for latitude, longitude in degrees]


def waypoints(
    site: Site,
    points_m: Floats,
    *,
    hold_s: int = 0,
    acceptance_m: float = 0.0,
    yaw_deg: float | None,
) -> list[MissionItem]:
    """Waypoints through points, (K, 3).

    Args:
        site: where the points lie.
        points_m: east, north and altitude.
        hold_s: how long to hover at each of them.
        acceptance_m: distance at which each counts as reached; 0 leaves it to the autopilot.
        yaw_deg: param 4; None leaves the heading to PX4.
    """
    return [
        MissionItem(
            Command.WAYPOINT,
            (hold_s, acceptance_m, 0, yaw_deg),
            place,
            round(float(point[2]), ALTITUDE_DIGITS),
        )
        for place, point in zip(places_of(site, points_m), points_m, strict=True)
    ]


def holding(station: Station, site: Site, hold_s: int, yaw_deg: float | None) -> list[MissionItem]:
    """A drone that hovers on its station for some time."""
    place = places_of(site, np.array([[station.east_m, station.north_m]]))[0]
    parts = [LONGEST_HOLD_S] * (hold_s // LONGEST_HOLD_S) + [hold_s % LONGEST_HOLD_S]
    altitude_m = round(station.altitude_m, ALTITUDE_DIGITS)
    return [
        MissionItem(Command.LOITER_TIME, (part, 0, 0, yaw_deg), place, altitude_m)
        for part in parts
        if part
    ]


def speed_of(speed_mps: float) -> MissionItem:
    """From now on fly at another speed over ground."""
    return MissionItem(Command.DO_CHANGE_SPEED, (1, round(speed_mps, 2), -1, 0))


def outward(surroundings: Surroundings, way: DroneWay, yaw_deg: float | None) -> list[MissionItem]:
    """Take-off and the way to the station."""
    site = surroundings.site
    home = home_of(surroundings)
    layer_m = round(way.layer_m, ALTITUDE_DIGITS)
    return [
        MissionItem(Command.TAKEOFF, (0, 0, 0, yaw_deg), home, layer_m),
        speed_of(way.speeds.cruise_mps),
        *waypoints(site, _with_short_legs(way.outbound_m[1:])[1:], yaw_deg=yaw_deg),
    ]


def homeward(
    surroundings: Surroundings, way: DroneWay, stay: Stay, yaw_deg: float | None
) -> list[MissionItem]:
    """What is left of the stay after circles, the way back, and landing at home."""
    site = surroundings.site
    items = []
    if stay.turns:
        items.append(speed_of(way.speeds.cruise_mps))
        if stay.hold_s:
            entry_m = way.inbound_m[:1]
            items.extend(waypoints(site, entry_m, hold_s=stay.hold_s, yaw_deg=yaw_deg))
    items.extend(waypoints(site, _with_short_legs(way.inbound_m[:-1])[1:], yaw_deg=yaw_deg))
    items.append(MissionItem(Command.LAND, (0, 0, 0, yaw_deg), home_of(surroundings), 0.0))
    return items


def home_of(surroundings: Surroundings) -> Place:
    """Where home lies on earth."""
    return places_of(surroundings.site, np.array([surroundings.home_m]))[0]


def _with_short_legs(points_m: Floats) -> Floats:
    """The same line without points that are equal to the one before, and with more on long legs."""
    kept = [points_m[0]]
    for point in points_m[1:]:
        length_m = float(np.linalg.norm(point - kept[-1]))
        if length_m > _SAME_M:
            legs = math.ceil(length_m / LONGEST_LEG_M)
            kept.extend(np.linspace(kept[-1], point, legs + 1)[1:])
    return np.array(kept)
