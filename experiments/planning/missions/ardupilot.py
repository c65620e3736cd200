"""Missions for ArduPilot's copters.

ArduPilot holds the turns and the radius of a circle in 8 bits each: radii are whole metres up to
255, then tens of metres, and more than 255 turns are several items.
"""

import math

import numpy as np

from orchid_uav.experiments.planning.missions.items import (
    ALTITUDE_DIGITS,
    Command,
    Firmware,
    Mission,
    MissionItem,
    holding,
    home_of,
    homeward,
    outward,
    places_of,
    speed_of,
)
from orchid_uav.experiments.planning.missions.stays import Stay
from orchid_uav.experiments.planning.missions.transit import DroneWay
from orchid_uav.experiments.planning.model import Station, Surroundings

MOST_TURNS = 255
MOST_RADIUS_M = 2550
_YAW_DEG = 0.0
"""Not used by copters; ArduPilot refuses most commands with no number here."""
_ACCELERATION_MPS2, _RATE_DEG_PER_S = 2.5, 20.0
"""WPNAV_ACCEL and CIRCLE_RATE as they come from the factory."""


def circle_radius_m(station: Station) -> int:
    """The radius that is flown: the next one below the planned that ArduPilot can hold."""
    radius_m = min(station.circle_radius_m, MOST_RADIUS_M)
    return int(radius_m / 10.0) * 10 if radius_m >= 256.0 else max(int(radius_m), 1)


def circling_mps(station: Station) -> float:
    """The speed at which a drone circles; with settings from the factory it flies no faster."""
    radius_m = circle_radius_m(station)
    # It keeps half of the acceleration for corrections.
    in_turn_mps = math.sqrt(0.5 * _ACCELERATION_MPS2 * radius_m)
    rate_mps = math.radians(_RATE_DEG_PER_S) * radius_m
    return math.floor(100.0 * min(station.speed_mps, in_turn_mps, rate_mps)) / 100.0


def turn_s(station: Station) -> float:
    """How long it flies one circle; 0 if it hovers."""
    if station.circle_radius_m == 0.0:
        return 0.0
    return 2.0 * math.pi * circle_radius_m(station) / circling_mps(station)


def mission_of(surroundings: Surroundings, station: Station, way: DroneWay, stay: Stay) -> Mission:
    """The mission of one drone."""
    items = outward(surroundings, way, _YAW_DEG)
    if station.circle_radius_m == 0.0:
        items.extend(holding(station, surroundings.site, stay.hold_s, _YAW_DEG))
    else:
        items.append(speed_of(circling_mps(station)))
        items.extend(_circles(surroundings, station, stay.turns))
    items.extend(homeward(surroundings, way, stay, _YAW_DEG))
    return Mission(
        station.name,
        Firmware.ARDUPILOT,
        home_of(surroundings),
        surroundings.home_height_amsl_m,
        way.speeds.cruise_mps,
        tuple(items),
    )


def _circles(surroundings: Surroundings, station: Station, turns: int) -> list[MissionItem]:
    center_m = np.array([[station.east_m, station.north_m]])
    center = places_of(surroundings.site, center_m)[0]
    altitude_m = round(station.altitude_m, ALTITUDE_DIGITS)
    parts = [MOST_TURNS] * (turns // MOST_TURNS) + [turns % MOST_TURNS]
    return [
        MissionItem(
            Command.LOITER_TURNS, (part, 0, circle_radius_m(station), 0), center, altitude_m
        )
        for part in parts
        if part
    ]
