"""How good it would be to be elsewhere: moves of a UAV's station, judged by its neighbourhood.

The utility of the UAV and its nearest neighbours takes the place of the fleet's, so that a UAV
needs to know nobody farther away.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.association import link_power_w
from orchid_uav.envs.channel import signal_to_noise_ratio, spectral_efficiency
from orchid_uav.envs.compilation import SOURCES, compiled, inlined
from orchid_uav.envs.fairness import jain_index_from_sums
from orchid_uav.envs.kinematics import clipped
from orchid_uav.envs.knowledge.neighbourhood import NEIGHBOURS, expected_m, nearest_stations
from orchid_uav.envs.propulsion import propulsion_power_w, total_power_w
from orchid_uav.envs.reward import (
    composite_reward,
    coverage_ratio,
    energy_efficiency,
    normalised_energy_efficiency,
)
from orchid_uav.envs.sharing import cell_squared_rates, cell_throughput_bps

SHIFT_DIRECTIONS = 8
SHIFT_DISTANCES_M = (60.0, 180.0, 400.0)
TEMPERATURE = 0.003
"""Of the softmax over the moves, in units of utility."""
CELL_SUMS = 5
"""Sums over a cell's users: their number, their spectral efficiencies, the inverses, squares and
fourth powers of these."""


def shifts_m() -> Floats:
    """Moves of its station that a UAV judges, (1 + directions x distances, 2), to stay first."""
    angles = 2.0 * np.pi * np.arange(SHIFT_DIRECTIONS) / SHIFT_DIRECTIONS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.zeros((1, 2)), *(distance * ring for distance in SHIFT_DISTANCES_M)])


@compiled
def answer_worlds(
    constants: Constants,
    worlds: Worlds,
    moves_m: Floats,
    ahead_s: float,
    temperature: float,
    wanted_m: Floats,
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Best response of every UAV: the mean of the moves, weighted by the softmax of :func:`judge`.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds.
        moves_m: of :func:`shifts_m`.
        ahead_s: users are expected where they will be in this time, from what is known (M39).
        temperature: of the softmax, in units of utility.
        wanted_m: result, (B, N, 2); 0 for UAVs that are not in service.
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    scratch = make_scratch_of_group(worlds.user_coordinates_m.shape[2])
    utilities = np.empty(len(moves_m))
    _answer(
        constants,
        worlds,
        moves_m,
        ahead_s,
        temperature,
        scratch,
        utilities,
        wanted_m,
        own_path_loss_db,
    )


@inlined
def _answer(
    constants: Constants,
    worlds: Worlds,
    moves_m: Floats,
    ahead_s: float,
    temperature: float,
    scratch: "GroupScratch",
    utilities: Floats,
    wanted_m: Floats,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """What :func:`answer_worlds` does, with memory for one UAV at a time."""
    for world in range(len(worlds.slot)):
        for uav in range(worlds.positions_m.shape[1]):
            wanted_m[world, uav] = 0.0
            if not worlds.in_service[world, uav]:
                continue
            judge(
                constants,
                worlds,
                world,
                uav,
                moves_m,
                ahead_s,
                scratch,
                utilities,
                own_path_loss_db,
            )
            wanted = mean_move_m(utilities, moves_m, temperature)
            wanted_m[world, uav, 0], wanted_m[world, uav, 1] = wanted


@inlined
def mean_move_m(utilities: Floats, moves_m: Floats, temperature: float) -> tuple[float, float]:
    """Mean of the moves (S, 2), weighted by the softmax of their utilities (S,)."""
    best = -np.inf
    for move in range(len(moves_m)):
        best = max(best, utilities[move])
    total, east_m, north_m = 0.0, 0.0, 0.0
    for move in range(len(moves_m)):
        weight = np.exp((utilities[move] - best) / temperature)
        total += weight
        east_m += weight * moves_m[move, 0]
        north_m += weight * moves_m[move, 1]
    return east_m / total, north_m / total


@inlined
def judge(
    constants: Constants,
    worlds: Worlds,
    world: int,
    uav: int,
    moves_m: Floats,
    ahead_s: float,
    scratch: "GroupScratch",
    utilities: Floats,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """Judge moves (S, 2) of a UAV's station by U_total of its neighbourhood, others staying.

    The arguments are those of :func:`answer_worlds`; the result is ``utilities`` (S,), all 0 if
    the UAV is not in service.
    """
    utilities[:] = 0.0
    if not worlds.in_service[world, uav]:
        return
    group = scratch.group
    margin_m = constants.circle_radius_m
    size = nearest_stations(worlds, world, uav, group)
    count = _find_users(constants, worlds, world, group[:size], ahead_s, scratch)
    transmit_w = worlds.transmit_powers_w[world, uav]
    scratch.others_w[:count] = 0.0
    for place in range(1, size):
        other = group[place]
        transmit_w += worlds.transmit_powers_w[world, other]
        station_m = worlds.stations_m[world, other]
        _receive(constants, worlds, world, other, station_m, count, scratch, own_path_loss_db)
        _keep_strongest(place, count, scratch)
    for move in range(len(moves_m)):
        for axis in range(2):
            wanted_m = worlds.stations_m[world, uav, axis] + moves_m[move, axis]
            high_m = constants.area_size_m[axis] - margin_m
            scratch.place_m[axis] = clipped(wanted_m, margin_m, high_m)
        _receive(constants, worlds, world, uav, scratch.place_m, count, scratch, own_path_loss_db)
        _associate(constants, count, scratch)
        utilities[move] = expected_utility(
            constants,
            scratch.efficiencies,
            scratch.cells,
            scratch.cell_sums,
            count,
            size,
            transmit_w,
        )


class GroupScratch(NamedTuple):
    """Memory for one UAV and its neighbours, and their users, the first of which count."""

    group: NDArray[np.int64]
    """The UAV and its neighbours."""
    place_m: Floats
    """Where the UAV is judged, (2,)."""

    coordinates_m: Floats
    """Where they are expected, (2, M)."""
    received_w: Floats
    """From one UAV, (M,)."""
    others_w: Floats
    """From the strongest of the others, (M,), and which of the group that is."""
    others: NDArray[np.int64]
    efficiencies: Floats
    """Of the strongest link, (M,), and which of the group serves it, -1 if none."""
    cells: NDArray[np.int64]
    cell_sums: Floats
    """See :func:`expected_utility`."""


@register_jitable
def make_scratch_of_group(users: int) -> GroupScratch:
    """Memory for worlds of so many users."""
    return GroupScratch(
        np.empty(1 + NEIGHBOURS, np.int64),
        np.empty(2),
        np.empty((2, users)),
        np.empty(users),
        np.empty(users),
        np.empty(users, np.int64),
        np.empty(users),
        np.empty(users, np.int64),
        np.empty((1 + NEIGHBOURS, CELL_SUMS)),
    )


@inlined
def _find_users(
    constants: Constants,
    worlds: Worlds,
    world: int,
    group: NDArray[np.int64],
    ahead_s: float,
    scratch: GroupScratch,
) -> int:
    """Where the users are expected that a group serves; return how many these are."""
    count = 0
    for user in range(worlds.association.shape[1]):
        is_served = False
        for uav in group:
            is_served = is_served or worlds.association[world, user] == uav
        if is_served:
            for axis in range(2):
                scratch.coordinates_m[axis, count] = expected_m(
                    constants, worlds, world, user, axis, ahead_s
                )
            count += 1
    return count


@inlined
def _receive(
    constants: Constants,
    worlds: Worlds,
    world: int,
    uav: int,
    place_m: Floats,
    count: int,
    scratch: GroupScratch,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """Power that the users would receive from a UAV at a place."""
    receive_from(
        constants,
        worlds.transmit_powers_w[world, uav],
        place_m[0],
        place_m[1],
        worlds.positions_m[world, uav, 2],
        scratch.coordinates_m,
        count,
        scratch.received_w,
        own_path_loss_db,
    )


@inlined
def _keep_strongest(place: int, count: int, scratch: GroupScratch) -> None:
    for user in range(count):
        is_better = scratch.received_w[user] > scratch.others_w[user]
        scratch.others[user] = place if is_better else scratch.others[user]
        scratch.others_w[user] = max(scratch.received_w[user], scratch.others_w[user])


@inlined
def _associate(constants: Constants, count: int, scratch: GroupScratch) -> None:
    """Who serves each user, the UAV itself being 0, and how well."""
    for user in range(count):
        received_w, others_w = scratch.received_w[user], scratch.others_w[user]
        snr = signal_to_noise_ratio(max(received_w, others_w), constants.access_noise_power_w)
        scratch.efficiencies[user] = spectral_efficiency(snr)
        cell = 0 if received_w >= others_w else scratch.others[user]
        scratch.cells[user] = cell if snr >= constants.required_snr else -1


@inlined
def receive_from(
    constants: Constants,
    power_w: float,
    x_m: float,
    y_m: float,
    altitude_m: float,
    coordinates_m: Floats,
    count: int,
    received_w: Floats,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """Power that users would receive from a UAV at a place.

    Args:
        constants: of the worlds' parameters.
        power_w: that the UAV sends with.
        x_m: the place.
        y_m: the place.
        altitude_m: the place.
        coordinates_m: of the users, (2, M), the first ``count`` of which count.
        count: number of users.
        received_w: result, (M,).
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
    """
    for user in range(count):
        dx, dy = coordinates_m[0, user] - x_m, coordinates_m[1, user] - y_m
        received_w[user] = link_power_w(
            power_w,
            dx * dx + dy * dy + altitude_m * altitude_m,
            altitude_m,
            constants.link,
            constants.access_gain_db,
            own_path_loss_db,
        )


@inlined
def expected_utility(
    constants: Constants,
    efficiencies: Floats,
    cells: NDArray[np.int64],
    cell_sums: Floats,
    count: int,
    size: int,
    transmit_w: float,
) -> float:
    """U_total of some circling UAVs and their users, at training progress 1.

    Args:
        constants: of the worlds' parameters.
        efficiencies: spectral efficiency of each user's link, the first ``count`` of which count.
        cells: by which of the UAVs each user is served, -1 if by none.
        cell_sums: memory for as many UAVs at least, (N, CELL_SUMS).
        count: number of users.
        size: number of UAVs.
        transmit_w: their transmit power in all.
    """
    cell_sums[:size] = 0.0
    served = 0
    for member in range(count):
        cell = cells[member]
        if cell >= 0:
            efficiency = efficiencies[member]
            squared = efficiency * efficiency
            served += 1
            cell_sums[cell, 0] += 1.0
            cell_sums[cell, 1] += efficiency
            cell_sums[cell, 2] += 1.0 / efficiency
            cell_sums[cell, 3] += squared
            cell_sums[cell, 4] += squared * squared
    rate_sum, rate_squared, load_squared = 0.0, 0.0, 0.0
    for cell in range(size):
        load = cell_sums[cell, 0]
        load_squared += load * load
        if load > 0.0:
            rate_sum += cell_throughput_bps(
                constants.share_rule,
                constants.bandwidth_hz,
                load,
                cell_sums[cell, 1],
                cell_sums[cell, 2],
                cell_sums[cell, 3],
            )
            rate_squared += cell_squared_rates(
                constants.share_rule,
                constants.bandwidth_hz,
                load,
                cell_sums[cell, 1],
                cell_sums[cell, 2],
                cell_sums[cell, 3],
                cell_sums[cell, 4],
            )
    propulsion_w = size * propulsion_power_w(
        constants.circle_chord[0] / constants.slot_s, *constants.rotor
    )
    efficiency = energy_efficiency(
        rate_sum, total_power_w(propulsion_w, transmit_w), constants.power_epsilon_w
    )
    return composite_reward(
        constants.coverage_weight,
        constants.efficiency_weight[1],
        constants.load_fairness_weight[1],
        constants.rate_fairness_weight[1],
        coverage_ratio(served, count),
        normalised_energy_efficiency(efficiency, constants.efficiency_scale_bit_per_joule),
        jain_index_from_sums(float(served), load_squared, size),
        jain_index_from_sums(rate_sum, rate_squared, served),
    )
