"""The informed observation: what a UAV on board knows of its users and neighbours (M40).

Its size depends neither on the number of UAVs nor on that of users. Positions are those that are
known in flight (M39), where users are expected in 5 s; loads and link qualities are measured, and
so are true. The last numbers are what best response would decide by, with what is known.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.compilation import SOURCES, compiled, inlined
from orchid_uav.envs.kinematics import clipped, relative
from orchid_uav.envs.knowledge.counterfactuals import (
    SHIFT_DIRECTIONS,
    SHIFT_DISTANCES_M,
    TEMPERATURE,
    GroupScratch,
    judge,
    make_scratch_of_group,
    mean_move_m,
)
from orchid_uav.envs.knowledge.neighbourhood import (
    AHEAD_S,
    NEIGHBOURS,
    expected_m,
    nearest_stations,
    sum_up_cells,
)

DIRECTIONS = 8
RING_ENDS_M = (120.0, 280.0)
"""Ground distances between the rings of the histogram of own users."""
BOUNDARY_M = 100.0
"""A user that is nearer to its own UAV by less than this is at the boundary to another's cell."""
DISTANCE_M, SPEED_MPS, LOAD, DELAY_S, ERROR_M = 500.0, 15.0, 20.0, 30.0, 150.0
EFFICIENCY, GAIN, MOVE_M = 10.0, 0.02, 60.0
"""Scales; EFFICIENCY is in bit/s/Hz, GAIN in units of utility."""
INFORMED_BOUND = 4.0
"""Every number is clipped to this at most, and to the negative of it at least."""
_RINGS = len(RING_ENDS_M) + 1
_OWN = 21
_NEIGHBOURS_FIRST = _OWN + _RINGS * DIRECTIONS
_OF_A_NEIGHBOUR = 9

INFORMED_NAMES = (
    *("station's x / D", "station's y / D"),
    *("altitude within the flight box", "transmit power within its range"),
    *("own load / fleet's mean - 1", "own airtime / fleet's mean - 1"),
    *("fleet's mean load / 20", "log2 of the UAVs in service / 4"),
    *("station's velocity, x / V_max", "station's velocity, y / V_max"),
    *("own users' centroid, x / 500 m", "own users' centroid, y / 500 m"),
    "own users' root mean square distance from it / 500 m",
    *("own farthest user, x / 500 m", "own farthest user, y / 500 m"),
    *("own users' mean velocity, x / 15 m/s", "own users' mean velocity, y / 15 m/s"),
    "own least spectral efficiency / own mean",
    "own mean spectral efficiency / 10 bit/s/Hz",
    *("age of the known positions / 30 s", "error of the known positions / 150 m"),
    *(
        f"own users in direction {direction} of {DIRECTIONS}, ring {ring + 1} / fleet's mean load"
        for ring in range(_RINGS)
        for direction in range(DIRECTIONS)
    ),
    *(
        f"{number + 1}. neighbour: {name}"
        for number in range(NEIGHBOURS)
        for name in (
            *("station, x / 500 m", "station, y / 500 m"),
            *("load / fleet's mean - 1", "airtime / fleet's mean - 1"),
            *("its users' centroid, x / 500 m", "its users' centroid, y / 500 m"),
            "own users at the boundary / fleet's mean load",
            "its users at the boundary / fleet's mean load",
            "1 if there is one",
        )
    ),
    *(
        f"neighbourhood's utility if the station moved in direction {direction} of "
        f"{SHIFT_DIRECTIONS} by {distance:g} m, less that if it stays / 0.02"
        for distance in SHIFT_DISTANCES_M
        for direction in range(SHIFT_DIRECTIONS)
    ),
    *("best response's move, x / 60 m", "best response's move, y / 60 m"),
)
"""What the numbers are, in their order. Places are relative to the own station, but for the first
two; airtime is the sum of 1 / spectral efficiency over a cell's users."""
INFORMED_SIZE = len(INFORMED_NAMES)


@compiled
def inform_worlds(
    constants: Constants,
    worlds: Worlds,
    moves_m: Floats,
    observations: NDArray[np.float32],
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Write what every UAV knows.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds.
        moves_m: of :func:`orchid_uav.envs.knowledge.counterfactuals.shifts_m`.
        observations: result, (B, N, INFORMED_SIZE).
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    uavs, users = worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2]
    centroids_m, airtimes = np.empty((uavs, 2)), np.empty(uavs)
    places_m = np.empty((2, users))
    group = np.empty(1 + NEIGHBOURS, np.int64)
    scratch, utilities = make_scratch_of_group(users), np.empty(len(moves_m))
    _inform(
        constants,
        worlds,
        moves_m,
        (centroids_m, airtimes, places_m, group),
        scratch,
        utilities,
        observations,
        own_path_loss_db,
    )


@inlined
def _inform(
    constants: Constants,
    worlds: Worlds,
    moves_m: Floats,
    memory: tuple[Floats, Floats, Floats, NDArray[np.int64]],
    scratch: GroupScratch,
    utilities: Floats,
    observations: NDArray[np.float32],
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """What :func:`inform_worlds` does, with memory for one world at a time."""
    uavs, users = worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2]
    centroids_m, airtimes, places_m, group = memory
    for world in range(len(worlds.slot)):
        sum_up_cells(constants, worlds, world, AHEAD_S, centroids_m, airtimes)
        for user in range(users):
            for axis in range(2):
                places_m[axis, user] = expected_m(constants, worlds, world, user, axis, AHEAD_S)
        flying = max(worlds.in_service[world].sum(), 1)
        mean_load = max(worlds.loads[world].sum() / flying, 1.0)
        mean_airtime = max(airtimes.sum() / flying, 1e-9)
        for uav in range(uavs):
            seen = observations[world, uav]
            seen[:] = 0.0
            seen[6] = mean_load / LOAD
            seen[7] = np.log2(flying) / 4.0
            _see_own(constants, worlds, world, uav, places_m, mean_load, seen)
            seen[4] = worlds.loads[world, uav] / mean_load - 1.0
            seen[5] = airtimes[uav] / mean_airtime - 1.0
            station_m = worlds.stations_m[world, uav]
            for axis in range(2):
                seen[10 + axis] = (centroids_m[uav, axis] - station_m[axis]) / DISTANCE_M
            for place in range(1, nearest_stations(worlds, world, uav, group)):
                other = group[place]
                first = _NEIGHBOURS_FIRST + (place - 1) * _OF_A_NEIGHBOUR
                for axis in range(2):
                    seen[first + axis] = (
                        worlds.stations_m[world, other, axis] - station_m[axis]
                    ) / DISTANCE_M
                    seen[first + 4 + axis] = (centroids_m[other, axis] - station_m[axis]) / (
                        DISTANCE_M
                    )
                seen[first + 2] = worlds.loads[world, other] / mean_load - 1.0
                seen[first + 3] = airtimes[other] / mean_airtime - 1.0
                for both in range(2):
                    near, far = (uav, other) if both == 0 else (other, uav)
                    seen[first + 6 + both] = (
                        _users_at_boundary(worlds, world, near, far, places_m) / mean_load
                    )
                seen[first + 8] = 1.0
            judge(
                constants,
                worlds,
                world,
                uav,
                moves_m,
                AHEAD_S,
                scratch,
                utilities,
                own_path_loss_db,
            )
            first = _NEIGHBOURS_FIRST + NEIGHBOURS * _OF_A_NEIGHBOUR
            for move in range(1, len(moves_m)):
                seen[first + move - 1] = (utilities[move] - utilities[0]) / GAIN
            wanted_m = mean_move_m(utilities, moves_m, TEMPERATURE)
            seen[len(seen) - 2], seen[len(seen) - 1] = wanted_m[0] / MOVE_M, wanted_m[1] / MOVE_M
            for number in range(len(seen)):
                seen[number] = clipped(seen[number], -INFORMED_BOUND, INFORMED_BOUND)


@inlined
def _see_own(
    constants: Constants,
    worlds: Worlds,
    world: int,
    uav: int,
    places_m: Floats,
    mean_load: float,
    seen: NDArray[np.float32],
) -> None:
    """What a UAV knows of itself and of the users that it serves."""
    station_m, velocity_mps = worlds.stations_m[world, uav], worlds.station_velocities_mps[world]
    fastest_mps = constants.max_displacement_m / constants.slot_s
    for axis in range(2):
        seen[axis] = station_m[axis] / constants.area_size_m[axis]
        seen[8 + axis] = velocity_mps[uav, axis] / fastest_mps
    seen[2] = relative(
        worlds.positions_m[world, uav, 2], constants.min_altitude_m, constants.max_altitude_m
    )
    power = relative(
        worlds.transmit_powers_w[world, uav],
        constants.min_transmit_power_w,
        constants.max_transmit_power_w,
    )
    seen[3] = max(power, 0.0)  # one that has failed sends nothing
    seen[19] = constants.delay_slots * constants.slot_s / DELAY_S
    seen[20] = constants.flight_error_std_m / ERROR_M
    load = worlds.loads[world, uav]
    if load == 0:
        return
    east_sum_m, north_sum_m, squared_sum_m2, farthest_m2 = 0.0, 0.0, 0.0, -1.0
    efficiency_sum, least_efficiency = 0.0, np.inf
    for user in range(places_m.shape[1]):
        if worlds.association[world, user] != uav:
            continue
        dx, dy = places_m[0, user] - station_m[0], places_m[1, user] - station_m[1]
        distance_m2 = dx * dx + dy * dy
        east_sum_m, north_sum_m = east_sum_m + dx, north_sum_m + dy
        squared_sum_m2 += distance_m2
        if distance_m2 > farthest_m2:
            farthest_m2 = distance_m2
            seen[13], seen[14] = dx / DISTANCE_M, dy / DISTANCE_M
        for axis in range(2):
            seen[15 + axis] += worlds.known_velocities_mps[world, axis, user] / (load * SPEED_MPS)
        efficiency = worlds.spectral_efficiency[world, user]
        efficiency_sum += efficiency
        least_efficiency = min(least_efficiency, efficiency)
        # Half a sector on, so that the first direction is east and its neighbours' halves.
        turn = np.arctan2(dy, dx) / (2.0 * np.pi) + 0.5 / DIRECTIONS
        direction = int((turn - np.floor(turn)) * DIRECTIONS) % DIRECTIONS
        ring = 0
        for end_m in RING_ENDS_M:
            ring += distance_m2 > end_m * end_m
        seen[_OWN + ring * DIRECTIONS + direction] += 1.0 / mean_load
    mean_m2 = (east_sum_m * east_sum_m + north_sum_m * north_sum_m) / (load * load)
    seen[12] = np.sqrt(max(squared_sum_m2 / load - mean_m2, 0.0)) / DISTANCE_M
    seen[17] = least_efficiency * load / efficiency_sum
    seen[18] = efficiency_sum / (load * EFFICIENCY)


@inlined
def _users_at_boundary(worlds: Worlds, world: int, own: int, other: int, places_m: Floats) -> float:
    """Users of a UAV that are not much nearer to it than to another."""
    own_m, other_m = worlds.stations_m[world, own], worlds.stations_m[world, other]
    count = 0.0
    for user in range(places_m.shape[1]):
        if worlds.association[world, user] == own:
            to_own_m = np.sqrt(
                (places_m[0, user] - own_m[0]) ** 2 + (places_m[1, user] - own_m[1]) ** 2
            )
            to_other_m = np.sqrt(
                (places_m[0, user] - other_m[0]) ** 2 + (places_m[1, user] - other_m[1]) ** 2
            )
            count += to_other_m - to_own_m < BOUNDARY_M
    return count
