"""What a UAV can know of its own cell and of its nearest neighbours, for rules and observations."""

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.compilation import inlined
from orchid_uav.envs.kinematics import clipped

NEIGHBOURS = 3
"""Nearest other UAVs that a UAV knows."""
AHEAD_S = 5.0
"""Time in which users are expected to keep going as they do."""


@inlined
def nearest_stations(worlds: Worlds, world: int, uav: int, group: NDArray[np.int64]) -> int:
    """Fill ``group`` with a UAV and its nearest others in service; return how many these are."""
    stations_m = worlds.stations_m[world]
    group[0], count = uav, 1
    for other in range(len(stations_m)):
        if other == uav or not worlds.in_service[world, other]:
            continue
        distance_m2 = _squared_m2(stations_m, uav, other)
        place = count
        while place > 1 and distance_m2 < _squared_m2(stations_m, uav, group[place - 1]):
            if place < len(group):
                group[place] = group[place - 1]
            place -= 1
        if place < len(group):
            group[place] = other
            count = min(count + 1, len(group))
    return count


@inlined
def _squared_m2(stations_m: Floats, one: int, other: int) -> float:
    dx = stations_m[other, 0] - stations_m[one, 0]
    dy = stations_m[other, 1] - stations_m[one, 1]
    return dx * dx + dy * dy


@inlined
def expected_m(
    constants: Constants, worlds: Worlds, world: int, user: int, axis: int, ahead_s: float
) -> float:
    """Where a user is expected in some time, from what is known of it, along one axis."""
    return clipped(
        worlds.known_coordinates_m[world, axis, user]
        + worlds.known_velocities_mps[world, axis, user] * ahead_s,
        0.0,
        constants.area_size_m[axis],
    )


@inlined
def sum_up_cells(
    constants: Constants,
    worlds: Worlds,
    world: int,
    ahead_s: float,
    centroids_m: Floats,
    airtimes: Floats,
) -> None:
    """Centroid (N, 2) and airtime (N,) of the users of every UAV; its own station without users.

    Airtime is the sum of 1 / spectral efficiency: the time that the cell needs for a bit to each.
    """
    loads = worlds.loads[world]
    centroids_m[:] = 0.0
    airtimes[:] = 0.0
    for user in range(worlds.association.shape[1]):
        uav = worlds.association[world, user]
        if uav >= 0:
            airtimes[uav] += 1.0 / worlds.spectral_efficiency[world, user]
            for axis in range(2):
                expected = expected_m(constants, worlds, world, user, axis, ahead_s)
                centroids_m[uav, axis] += expected / loads[uav]
    for uav in range(len(loads)):
        if loads[uav] == 0:
            for axis in range(2):
                centroids_m[uav, axis] = worlds.stations_m[world, uav, axis]
