"""Missions for PX4.

PX4 knows no circles in missions, so a circle is a polygon of waypoints that is flown over and over.
A waypoint counts as reached half an edge before it, which rounds the corners off: the way lies
inside the circle.
"""

import math

import numpy as np

from orchid_uav.experiments.planning.missions.items import (
    Command,
    Firmware,
    Mission,
    MissionItem,
    holding,
    home_of,
    homeward,
    outward,
    speed_of,
    waypoints,
)
from orchid_uav.experiments.planning.missions.stays import Stay
from orchid_uav.experiments.planning.missions.transit import DroneWay
from orchid_uav.experiments.planning.model import Station, Surroundings

DEEPEST_CHORD_M = 1.5
"""How far an edge of the polygon may lie inside the circle; more corners would slow drones down,
because they can stop at the next one."""
_FEWEST_CORNERS, _MOST_CORNERS = 6, 36
_YAW_DEG = None
"""The heading is the autopilot's choice."""
_ACCELERATION_MPS2, _JERK_MPS3, _TURN_SHARE = 3.0, 4.0, 0.5
"""MPC_ACC_HOR, MPC_JERK_AUTO and MPC_XY_TRAJ_P as they come from the factory."""


def circling_mps(station: Station) -> float:
    """The speed at which a drone circles; with settings from the factory it flies no faster."""
    corners = _corners(station.circle_radius_m)
    edge_m = 2.0 * station.circle_radius_m * math.sin(math.pi / corners)
    inner_m = station.circle_radius_m * math.cos(math.pi / corners)
    in_turn_mps = math.sqrt(_TURN_SHARE * _ACCELERATION_MPS2 * inner_m)
    ramp = 4.0 * _ACCELERATION_MPS2**2 / _JERK_MPS3
    stopping_mps = (math.sqrt(ramp**2 + 8.0 * _ACCELERATION_MPS2 * edge_m) - ramp) / 2.0
    return math.floor(100.0 * min(station.speed_mps, in_turn_mps, stopping_mps)) / 100.0


def turn_s(station: Station) -> float:
    """How long it flies one circle; 0 if it hovers."""
    if station.circle_radius_m == 0.0:
        return 0.0
    corners = _corners(station.circle_radius_m)
    edges_m = corners * 2.0 * station.circle_radius_m * math.sin(math.pi / corners)
    return edges_m / circling_mps(station)


def mission_of(surroundings: Surroundings, station: Station, way: DroneWay, stay: Stay) -> Mission:
    """The mission of one drone."""
    items = outward(surroundings, way, _YAW_DEG)
    if station.circle_radius_m == 0.0:
        items.extend(holding(station, surroundings.site, stay.hold_s, _YAW_DEG))
    else:
        items.append(speed_of(circling_mps(station)))
        first = len(items) + 1  # items are numbered from 1 in a file
        items.extend(_circle(surroundings, station, way))
        if stay.turns > 1:
            items.append(MissionItem(Command.DO_JUMP, (first, stay.turns - 1, 0, 0)))
    items.extend(homeward(surroundings, way, stay, _YAW_DEG))
    return Mission(
        station.name,
        Firmware.PX4,
        home_of(surroundings),
        surroundings.home_height_amsl_m,
        way.speeds.cruise_mps,
        tuple(items),
    )


def _circle(surroundings: Surroundings, station: Station, way: DroneWay) -> list[MissionItem]:
    """One turn, clockwise; its last corner is where the drone came to the circle."""
    corners, radius_m = _corners(station.circle_radius_m), station.circle_radius_m
    east_m, north_m = way.outbound_m[-1, :2] - (station.east_m, station.north_m)
    turns = np.arctan2(north_m, east_m) - 2.0 * np.pi * np.arange(1, corners + 1) / corners
    points_m = np.stack(
        [
            station.east_m + radius_m * np.cos(turns),
            station.north_m + radius_m * np.sin(turns),
            np.full(corners, station.altitude_m),
        ],
        axis=1,
    )
    reached_m = round(radius_m * math.sin(math.pi / corners), 2)
    return waypoints(surroundings.site, points_m, acceptance_m=reached_m, yaw_deg=_YAW_DEG)


def _corners(radius_m: float) -> int:
    """How many corners the polygon of a circle has."""
    share = min(DEEPEST_CHORD_M / radius_m, 0.5)
    return max(_FEWEST_CORNERS, min(math.ceil(math.pi / math.acos(1.0 - share)), _MOST_CORNERS))
