"""Flies the items of a mission, as an autopilot would, without wind and inertia."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orchid_uav.experiments.planning.missions.items import Command, MissionItem
from orchid_uav.experiments.planning.model import Floats
from orchid_uav.experiments.planning.site import Place, Site

_ARC_RAD = math.radians(10.0)
"""Circles are followed in chords of this angle."""
_MOST_CORNERS = 200_000


class Track(NamedTuple):
    """A flight as straight lines."""

    seconds: Floats
    """When each corner is passed, from take-off, (K,)."""
    points_m: Floats
    """Corners: east, north and altitude, (K, 3)."""

    def at(self, seconds: Floats) -> Floats:
        """Where the drone is at times, (T, 3); on the ground before take-off and after landing."""
        places = [np.interp(seconds, self.seconds, self.points_m[:, axis]) for axis in range(3)]
        return np.stack(places, axis=1)


def fly(
    items: Sequence[MissionItem],
    site: Site,
    home: Place,
    climb_mps: float,
    descend_mps: float,
) -> Track:
    """Fly a mission from take-off to landing.

    Args:
        items: as they are in a file; a jump names its target by its number, counted from 1.
        site: for the metres of the track.
        home: where the drone stands.
        climb_mps: speed upwards.
        descend_mps: speed downwards.

    Raises:
        ValueError: an item is of a kind that is not flown here, or the mission does not end.
    """
    places = [item.place or home for item in items]
    local_m = [(float(east_m), float(north_m)) for east_m, north_m in site.to_local_m(places)]
    pilot = _Pilot(site.to_local_m([home])[0], climb_mps, descend_mps)
    jumps_left = {
        number: int(item.params[1] or 0)
        for number, item in enumerate(items)
        if item.command == Command.DO_JUMP
    }
    number = 0
    while number < len(items):
        item = items[number]
        number += 1
        if item.command == Command.DO_JUMP and jumps_left[number - 1] > 0:
            jumps_left[number - 1] -= 1
            number = int(item.params[0] or 0) - 1
        elif item.command != Command.DO_JUMP:
            pilot.do(item, local_m[number - 1])
        if len(pilot.corners) > _MOST_CORNERS:
            raise ValueError("the mission does not end")
    return pilot.track()


class _Pilot:
    def __init__(self, home_m: Floats, climb_mps: float, descend_mps: float) -> None:
        self._climb_mps, self._descend_mps = climb_mps, descend_mps
        self._speed_mps = math.nan  # a mission has to say
        self._second = 0.0
        self.corners = [(0.0, float(home_m[0]), float(home_m[1]), 0.0)]

    def track(self) -> Track:
        corners = np.array(self.corners)
        return Track(corners[:, 0], corners[:, 1:])

    def do(self, item: MissionItem, local_m: tuple[float, float]) -> None:
        first, second, third, _ = (param or 0.0 for param in item.params)
        if item.command == Command.TAKEOFF:
            self._go(*self._place()[:2], item.altitude_m)
        elif item.command in (Command.WAYPOINT, Command.LOITER_TIME):
            self._go(*local_m, item.altitude_m)
            self._wait(first)
        elif item.command == Command.LOITER_TURNS:
            self._circle(local_m, item.altitude_m, third, first)
        elif item.command == Command.LAND:
            self._go(*local_m, self._place()[2])
            self._go(*local_m, item.altitude_m)
        elif item.command == Command.DO_CHANGE_SPEED:
            self._speed_mps = second
        else:
            raise ValueError(f"command {item.command:d} is not flown here")

    def _place(self) -> tuple[float, float, float]:
        return self.corners[-1][1:]

    def _go(self, east_m: float, north_m: float, altitude_m: float) -> None:
        from_east_m, from_north_m, from_altitude_m = self._place()
        level_m = math.hypot(east_m - from_east_m, north_m - from_north_m)
        up_m = altitude_m - from_altitude_m
        vertical_s = up_m / self._climb_mps if up_m > 0.0 else -up_m / self._descend_mps
        level_s = level_m / self._speed_mps if level_m > 0.0 else 0.0
        self._wait(max(vertical_s, level_s))
        self.corners[-1] = (self._second, east_m, north_m, altitude_m)

    def _wait(self, seconds: float) -> None:
        self._second += seconds
        self.corners.append((self._second, *self._place()))

    def _circle(
        self, center_m: tuple[float, float], altitude_m: float, radius_m: float, turns: float
    ) -> None:
        """Go to the nearest point of the circle, then round it; a negative radius turns left."""
        offset_m = np.array(self._place()[:2]) - center_m
        start = math.atan2(offset_m[1], offset_m[0])
        chords = math.ceil(2.0 * math.pi * turns / _ARC_RAD)
        arc_s = 2.0 * math.pi * turns * abs(radius_m) / self._speed_mps / max(chords, 1)
        for chord in range(chords + 1):
            angle = start - math.copysign(2.0 * math.pi * turns * chord / max(chords, 1), radius_m)
            east_m = center_m[0] + abs(radius_m) * math.cos(angle)
            north_m = center_m[1] + abs(radius_m) * math.sin(angle)
            if chord == 0:
                self._go(east_m, north_m, altitude_m)
            else:
                self._second += arc_s
                self.corners.append((self._second, east_m, north_m, altitude_m))
