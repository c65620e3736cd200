"""Receding horizon: the whole fleet's stations are searched anew every few seconds.

It is central, and sees all that the setting lets anybody see: what a decentralised rule or a
learned policy is compared with where users move, as :class:`Planner` is where they stand still. It
looks one step ahead and climbs hills, so that it is no proven ceiling.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from orchid_uav.agents.controllers.controller import Actions, check_stations, station_actions
from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.channel import signal_to_noise_ratio, spectral_efficiency
from orchid_uav.envs.compilation import SOURCES, compiled, inlined
from orchid_uav.envs.kinematics import clipped
from orchid_uav.envs.knowledge.counterfactuals import CELL_SUMS, expected_utility, receive_from
from orchid_uav.envs.knowledge.neighbourhood import expected_m
from orchid_uav.envs.users import counter_uniform
from orchid_uav.envs.world import WorldBatch

PERIOD_S = 5.0
TRIALS = 600
CIRCLE_POINTS = 4
"""Points of the circles over which the utility is averaged."""
_LEAST_STEP_M, _GREATEST_STEP_M = 10.0, 400.0
_NUMBERS_PER_TRIAL = 3
_SEARCH_KEY = np.uint64(0x5EA2C4)
"""Keeps the search's random numbers apart from the users' walks."""


class RecedingHorizon:
    """Hill climbing over all stations every ``period_s``, in station flight.

    Args:
        period_s: seconds between two searches; users are expected where they will be in this time.
        trials: of each search, which goes on from the stations that were wanted before.
    """

    def __init__(self, period_s: float = PERIOD_S, trials: int = TRIALS) -> None:
        self.period_s = period_s
        self.trials = trials

    def begin(self, world: WorldBatch) -> None:
        """Want the stations that there are.

        Raises:
            ValueError: an action moves the UAVs themselves.
        """
        check_stations(world, "receding horizon")
        self._search = world.specialised(search_worlds)
        self._wanted_m = world.arrays.stations_m.copy()

    def act(self, world: WorldBatch) -> Actions:
        """Towards the stations that are wanted, after a search where one is due."""
        slot_s = world.parameters.network.slot_s
        period_slots = max(1, round(self.period_s / slot_s))
        if int(world.arrays.slot[0]) % period_slots == 0:
            world.divide(
                lambda part, worlds: self._search(
                    world.constants, worlds, self.period_s, self.trials, self._wanted_m[part]
                )
            )
        return station_actions(world, (self._wanted_m - world.arrays.stations_m) / slot_s)


@compiled
def search_worlds(
    constants: Constants,
    worlds: Worlds,
    ahead_s: float,
    trials: int,
    wanted_m: Floats,
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Search better stations for every world.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds.
        ahead_s: users are expected where they will be in this time.
        trials: moves of a single station that are tried.
        wanted_m: stations to begin with, and result, (B, N, 2).
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    uavs, users = worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2]
    scratch = _make_scratch(uavs, users)
    place_m = np.empty(2)
    for world in range(len(worlds.slot)):
        count, size, transmit_w = _look(constants, worlds, world, ahead_s, scratch)
        if size == 0 or count == 0:
            continue
        places_m, flying = wanted_m[world], scratch.flying
        for cell in range(size):
            uav = flying[cell]
            _receive(constants, worlds, world, uav, places_m[uav], count, scratch, own_path_loss_db)
            scratch.received_w[cell] = scratch.tried_w
        best = _utility(constants, scratch, size - 1, size, count, transmit_w)
        first = np.uint64(worlds.slot[world]) * np.uint64(trials * _NUMBERS_PER_TRIAL)
        key = worlds.walk_key[world] ^ _SEARCH_KEY
        for trial in range(trials):
            counter = first + np.uint64(trial * _NUMBERS_PER_TRIAL)
            cell = min(int(counter_uniform(key, counter) * size), size - 1)
            uav = flying[cell]
            _try(constants, key, counter, places_m[uav], place_m)
            if not _has_room(constants, places_m, flying[:size], cell, place_m):
                continue
            _receive(constants, worlds, world, uav, place_m, count, scratch, own_path_loss_db)
            utility = _utility(constants, scratch, cell, size, count, transmit_w)
            if utility > best:
                best = utility
                scratch.received_w[cell] = scratch.tried_w
                places_m[uav] = place_m


class _Scratch(NamedTuple):
    """Memory for one world, N UAVs in service and M target users of which count."""

    coordinates_m: Floats
    """Where the users are expected, (2, M)."""
    flying: NDArray[np.int64]
    """UAVs in service, (N,)."""
    received_w: Floats
    """From every UAV at the points of its circle, (N, points, M)."""
    tried_w: Floats
    """From a UAV elsewhere, (points, M)."""
    efficiencies: Floats
    cells: NDArray[np.int64]
    cell_sums: Floats


@register_jitable
def _make_scratch(uavs: int, users: int) -> _Scratch:
    return _Scratch(
        np.empty((2, users)),
        np.empty(uavs, np.int64),
        np.empty((uavs, CIRCLE_POINTS, users)),
        np.empty((CIRCLE_POINTS, users)),
        np.empty(users),
        np.empty(users, np.int64),
        np.empty((uavs, CELL_SUMS)),
    )


@inlined
def _look(
    constants: Constants, worlds: Worlds, world: int, ahead_s: float, scratch: _Scratch
) -> tuple[int, int, float]:
    """Numbers of target users and of UAVs in service, and the transmit power of these."""
    count, size, transmit_w = 0, 0, 0.0
    for user in range(worlds.target_users.shape[1]):
        if worlds.target_users[world, user]:
            for axis in range(2):
                scratch.coordinates_m[axis, count] = expected_m(
                    constants, worlds, world, user, axis, ahead_s
                )
            count += 1
    for uav in range(worlds.in_service.shape[1]):
        if worlds.in_service[world, uav]:
            scratch.flying[size] = uav
            size += 1
            transmit_w += worlds.transmit_powers_w[world, uav]
    return count, size, transmit_w


@inlined
def _try(
    constants: Constants, key: np.uint64, counter: np.uint64, station_m: Floats, place_m: Floats
) -> None:
    """Draw another place for a station, near or far."""
    margin_m = constants.circle_radius_m
    east_m, north_m = constants.area_size_m
    share = counter_uniform(key, counter + np.uint64(1))
    step_m = _GREATEST_STEP_M * (_LEAST_STEP_M / _GREATEST_STEP_M) ** share
    angle = 2.0 * np.pi * counter_uniform(key, counter + np.uint64(2))
    place_m[0] = clipped(station_m[0] + step_m * np.cos(angle), margin_m, east_m - margin_m)
    place_m[1] = clipped(station_m[1] + step_m * np.sin(angle), margin_m, north_m - margin_m)


@inlined
def _has_room(
    constants: Constants,
    places_m: Floats,
    flying: NDArray[np.int64],
    cell: int,
    place_m: Floats,
) -> bool:
    """Whether the place keeps the spacing to all other stations."""
    for other in range(len(flying)):
        dx = places_m[flying[other], 0] - place_m[0]
        dy = places_m[flying[other], 1] - place_m[1]
        if other != cell and dx * dx + dy * dy < constants.centre_spacing_m**2:
            return False
    return True


@inlined
def _receive(
    constants: Constants,
    worlds: Worlds,
    world: int,
    uav: int,
    place_m: Floats,
    count: int,
    scratch: _Scratch,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """Power that users would receive from the points of a UAV's circle round a place."""
    for point in range(CIRCLE_POINTS):
        angle = 2.0 * np.pi * point / CIRCLE_POINTS
        receive_from(
            constants,
            worlds.transmit_powers_w[world, uav],
            place_m[0] + constants.circle_radius_m * np.cos(angle),
            place_m[1] + constants.circle_radius_m * np.sin(angle),
            worlds.positions_m[world, uav, 2],
            scratch.coordinates_m,
            count,
            scratch.tried_w[point],
            own_path_loss_db,
        )


@inlined
def _utility(
    constants: Constants, scratch: _Scratch, tried: int, size: int, count: int, transmit_w: float
) -> float:
    """Mean of U_total over the points of the circle, with one UAV where it is tried."""
    total = 0.0
    for point in range(CIRCLE_POINTS):
        for user in range(count):
            strongest_w, cell = scratch.tried_w[point, user], tried
            for other in range(size):
                if other != tried:
                    other_w = scratch.received_w[other, point, user]
                    cell = other if other_w > strongest_w else cell
                    strongest_w = max(strongest_w, other_w)
            snr = signal_to_noise_ratio(strongest_w, constants.access_noise_power_w)
            scratch.efficiencies[user] = spectral_efficiency(snr)
            scratch.cells[user] = cell if snr >= constants.required_snr else -1
        total += expected_utility(
            constants,
            scratch.efficiencies,
            scratch.cells,
            scratch.cell_sums,
            count,
            size,
            transmit_w,
        )
    return total / CIRCLE_POINTS
