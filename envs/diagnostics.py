"""Metrics of a slot that evaluation wants and learning does not."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.association import link_power_w
from orchid_uav.envs.channel import (
    LOSS_ALLOWS_PRUNING,
    signal_to_noise_ratio,
    snr_of_efficiency_db,
    spectral_efficiency,
)
from orchid_uav.envs.compilation import SOURCES, compiled, inlined
from orchid_uav.envs.metrics import (
    COVERAGE,
    DIAGNOSTIC_METRICS,
    ENERGY_EFFICIENCY,
    LOAD_JFI,
    RATE_JFI,
    SUM_RATE,
)
from orchid_uav.envs.propulsion import (
    climb_power_w,
    load_factor,
    propulsion_power_w,
    total_power_w,
)
from orchid_uav.envs.reward import energy_efficiency, final_utility
from orchid_uav.envs.sharing import (
    PROPORTIONAL,
    SPECTRAL_EFFICIENCY,
    bandwidth_share,
    cell_throughput_bps,
    user_rate_bps,
)
from orchid_uav.envs.world import WorldBatch

_LEAST_GAIN = 1.0 + 1e-9
"""A rate that grows by less than this factor has grown by rounding alone."""


class Diagnostics:
    """Time means of ``DIAGNOSTIC_METRICS`` over an episode of every world.

    Call :meth:`begin` after the worlds' episodes have begun and :meth:`observe` after each step.
    """

    def __init__(self, world: WorldBatch) -> None:
        self._world = world
        self._inspect = world.specialised(inspect_worlds)
        self._sums = np.zeros((world.world_count, len(DIAGNOSTIC_METRICS)))
        self._slots = 0
        self._last_velocities_mps = np.zeros_like(world.arrays.velocities_mps)
        self._starts_m = np.array(world.arrays.positions_m)
        self._gbs: tuple[Floats, Floats, Floats] | None = None

    def begin(self) -> None:
        """Forget the last episode, or the slots of this one so far."""
        self._sums[:] = 0.0
        self._slots = 0
        arrays = self._world.arrays
        self._last_velocities_mps[:] = arrays.velocities_mps
        has_begun = arrays.slot == 0
        self._starts_m[has_begun] = arrays.positions_m[has_begun]
        self._gbs = None

    def observe(self) -> None:
        """Add the slot that was just flown."""
        world = self._world
        arrays = world.arrays
        inspected = np.empty((world.world_count, 4))
        world.divide(
            lambda part, worlds: self._inspect(
                world.constants, worlds, self._last_velocities_mps[part], inspected[part]
            )
        )
        self._last_velocities_mps[:] = arrays.velocities_mps
        self._slots += 1
        if self._gbs is None or world.parameters.network.user_speed_mps > 0.0:
            self._gbs = _gbs_metrics(world)
        utility = final_utility(
            world.parameters.reward,
            world.constants.efficiency_scale_bit_per_joule,
            arrays.metrics[:, COVERAGE],
            arrays.metrics[:, ENERGY_EFFICIENCY],
            arrays.metrics[:, LOAD_JFI],
            arrays.metrics[:, RATE_JFI],
        )
        gbs_rate_bps, gbs_coverage, gbs_served = self._gbs
        total_coverage = (arrays.loads.sum(axis=1) + gbs_served) / world.user_count
        moved_m = np.linalg.norm(arrays.positions_m - self._starts_m, axis=2).mean(axis=1)
        thrust_efficiency, nearest_m, snr_db, pairs = inspected.T
        self._sums += np.column_stack(
            [
                *(utility, thrust_efficiency, nearest_m, moved_m, snr_db, pairs),
                *(gbs_rate_bps, gbs_coverage, total_coverage),
            ]
        )

    def episode_metrics(self, world: int) -> dict[str, float]:
        """Means over the slots so far, by the names of ``DIAGNOSTIC_METRICS``."""
        means = self._sums[world] / max(self._slots, 1)
        return dict(zip(DIAGNOSTIC_METRICS, means.tolist(), strict=True))


def _gbs_metrics(world: WorldBatch) -> tuple[Floats, Floats, Floats]:
    """Mean rate of the GBS's users, unserved ones at 0, their served share and number (M4)."""
    rates_bps = world.gbs_rates_bps()
    users = (~world.arrays.target_users).sum(axis=1)
    some = np.maximum(users, 1)
    served = (rates_bps > 0.0).sum(axis=1)
    return rates_bps.sum(axis=1) / some, np.where(users > 0, served / some, 1.0), served


@compiled
def inspect_worlds(
    constants: Constants,
    worlds: Worlds,
    last_velocities_mps: Floats,
    metrics: Floats,
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Energy efficiency with thrust paid for, distance to the nearest UAV, SNR, blocking pairs.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds after a step.
        last_velocities_mps: of the slot before, (B, N, 3).
        metrics: result, (B, 4).
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    scratch = _make_scratch(worlds.positions_m.shape[1])
    _inspect(constants, worlds, last_velocities_mps, scratch, metrics, own_path_loss_db)


class _Scratch(NamedTuple):
    """Memory for the cells of one world, (N,) each."""

    counts: Floats
    sums: Floats
    inverse_sums: Floats
    square_sums: Floats
    means: Floats
    """Throughput over bandwidth: the mean of efficiencies that the rule of shares makes."""
    reaches_m2: Floats
    """Squared ground distances from which on a UAV gains by no user."""


@register_jitable
def _make_scratch(uavs: int) -> _Scratch:
    return _Scratch(
        np.empty(uavs),
        np.empty(uavs),
        np.empty(uavs),
        np.empty(uavs),
        np.empty(uavs),
        np.empty(uavs),
    )


@inlined
def _inspect(
    constants: Constants,
    worlds: Worlds,
    last_velocities_mps: Floats,
    scratch: _Scratch,
    metrics: Floats,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """What :func:`inspect_worlds` does, with memory for one world at a time."""
    for world in range(len(worlds.slot)):
        power_w = _power_with_thrust_w(constants, worlds, world, last_velocities_mps[world])
        metrics[world, 0] = energy_efficiency(
            worlds.metrics[world, SUM_RATE], power_w, constants.power_epsilon_w
        )
        metrics[world, 1] = _mean_nearest_uav_m(worlds.positions_m[world], worlds.in_service[world])
        metrics[world, 2] = _mean_snr_db(worlds.spectral_efficiency[world])
        metrics[world, 3] = _count_blocking_pairs(
            constants, worlds, world, scratch, own_path_loss_db
        )


@inlined
def _power_with_thrust_w(
    constants: Constants, worlds: Worlds, world: int, last_velocities_mps: Floats
) -> float:
    """Total power if the thrust that turns and accelerates were paid for, too."""
    propulsion_w, transmit_w = 0.0, 0.0
    velocities = worlds.velocities_mps[world]
    for uav in range(len(velocities)):
        if not worlds.in_service[world, uav]:
            continue
        speed_squared, change_squared = 0.0, 0.0
        for axis in range(3):
            speed_squared += velocities[uav, axis] ** 2
            change_squared += (velocities[uav, axis] - last_velocities_mps[uav, axis]) ** 2
        factor = load_factor(np.sqrt(change_squared) / constants.slot_s)
        propulsion_w += propulsion_power_w(np.sqrt(speed_squared), *constants.rotor, factor)
        propulsion_w += climb_power_w(velocities[uav, 2], constants.climbing_mass_kg)
        transmit_w += worlds.transmit_powers_w[world, uav]
    return total_power_w(propulsion_w, transmit_w)


@inlined
def _mean_nearest_uav_m(positions_m: Floats, in_service: NDArray[np.bool_]) -> float:
    """Mean over the UAVs in service of the distance to the nearest other; NaN where none is."""
    total_m, counted = 0.0, 0
    for uav in range(len(positions_m)):
        nearest_squared = np.inf
        for other in range(len(positions_m)):
            if other != uav and in_service[uav] and in_service[other]:
                squared = 0.0
                for axis in range(3):
                    squared += (positions_m[uav, axis] - positions_m[other, axis]) ** 2
                nearest_squared = min(nearest_squared, squared)
        if nearest_squared < np.inf:
            total_m += np.sqrt(nearest_squared)
            counted += 1
    return total_m / counted if counted else np.nan


@inlined
def _mean_snr_db(efficiencies: Floats) -> float:
    """Mean SNR of the users that UAVs serve, whose efficiency is not 0; NaN where there is none."""
    total_db, served = 0.0, 0
    for user in range(len(efficiencies)):
        is_served = efficiencies[user] > 0.0
        snr_db = snr_of_efficiency_db(efficiencies[user] if is_served else 1.0)
        total_db += snr_db if is_served else 0.0
        served += is_served
    return total_db / served if served else np.nan


@inlined
def _count_blocking_pairs(
    constants: Constants,
    worlds: Worlds,
    world: int,
    scratch: _Scratch,
    own_path_loss_db: Callable[..., float] | None,
) -> int:
    """User-UAV pairs that would both gain if the user changed over to the UAV.

    The user gains in rate with its share in the new cell, the UAV in the throughput of its cell.
    """
    _look_at_cells(constants, worlds, world, scratch)
    if own_path_loss_db is None and LOSS_ALLOWS_PRUNING:
        _bound_reaches(worlds, world, scratch)
    # How crowded cells are, and what a user adds: the sum of 1/efficiency where rates are equal
    # (max-min), the number of users where bandwidth is (proportional), the sum of the efficiencies
    # where shares follow these. A change pays only into a less crowded cell.
    crowding = scratch.inverse_sums
    if constants.share_rule == PROPORTIONAL:
        crowding = scratch.counts
    elif constants.share_rule == SPECTRAL_EFFICIENCY:
        crowding = scratch.sums
    association, efficiencies = worlds.association[world], worlds.spectral_efficiency[world]
    loads, means, reaches_m2 = worlds.loads[world], scratch.means, scratch.reaches_m2
    uavs = len(loads)
    least = np.inf
    for uav in range(uavs):
        least = min(least, crowding[uav])
    pairs = 0
    for user in range(len(association)):
        own = association[user]
        if own < 0:  # no UAV reaches it
            continue
        efficiency = efficiencies[user]
        added = 1.0 / efficiency
        if constants.share_rule == PROPORTIONAL:
            added = 1.0
        elif constants.share_rule == SPECTRAL_EFFICIENCY:
            added = efficiency
        if least + added >= crowding[own]:
            continue
        for uav in range(uavs):
            # The user receives its present UAV best. A change that would not pay over an equally
            # good link does not pay at all, and these tests compute no link.
            if (
                crowding[uav] + added < crowding[own]
                and efficiency > means[uav]
                and _ground_distance_squared_m2(worlds, world, uav, user) < reaches_m2[uav]
            ):
                link = _link_efficiency(constants, worlds, world, uav, user, own_path_loss_db)
                pairs += link > 0.0 and _both_gain(
                    constants,
                    link,
                    (
                        loads[uav],
                        scratch.sums[uav],
                        scratch.inverse_sums[uav],
                        scratch.square_sums[uav],
                    ),
                    worlds.rates_bps[world, user] * _LEAST_GAIN,
                    means[uav] * constants.bandwidth_hz * _LEAST_GAIN,
                )
    return pairs


@inlined
def _look_at_cells(constants: Constants, worlds: Worlds, world: int, scratch: _Scratch) -> None:
    """Sums over the users of every UAV."""
    association, efficiencies = worlds.association[world], worlds.spectral_efficiency[world]
    loads = worlds.loads[world]
    uavs = len(loads)
    counts, means, reaches_m2 = scratch.counts, scratch.means, scratch.reaches_m2
    sums, inverse_sums, square_sums = scratch.sums, scratch.inverse_sums, scratch.square_sums
    for uav in range(uavs):
        counts[uav], means[uav], reaches_m2[uav] = loads[uav], 0.0, np.inf
        sums[uav], inverse_sums[uav], square_sums[uav] = 0.0, 0.0, 0.0
    for user in range(len(association)):
        uav = association[user]
        if uav >= 0:
            sums[uav] += efficiencies[user]
            inverse_sums[uav] += 1.0 / efficiencies[user]
            square_sums[uav] += efficiencies[user] ** 2
            means[uav] += worlds.rates_bps[world, user] / constants.bandwidth_hz


@inlined
def _bound_reaches(worlds: Worlds, world: int, scratch: _Scratch) -> None:
    """Bound the distances at which links have to be computed.

    A UAV gains only by users whose efficiency is above the mean of its cell, and efficiency falls
    with distance. Where one of its own users is not above the mean, no user farther away is.
    """
    association, reaches_m2 = worlds.association[world], scratch.reaches_m2
    for user in range(len(association)):
        uav = association[user]
        if uav >= 0 and worlds.spectral_efficiency[world, user] <= scratch.means[uav]:
            distance_m2 = _ground_distance_squared_m2(worlds, world, uav, user)
            reaches_m2[uav] = min(reaches_m2[uav], distance_m2)


@inlined
def _both_gain(
    constants: Constants,
    efficiency: float,
    cell: tuple[int, float, float, float],
    enough_for_user_bps: float,
    enough_for_uav_bps: float,
) -> bool:
    """Whether a user of this spectral efficiency gains by joining a cell, and the cell with it."""
    load, cell_sum, cell_inverse_sum, cell_square_sum = cell
    load += 1
    cell_sum += efficiency
    cell_inverse_sum += 1.0 / efficiency
    share = bandwidth_share(constants.share_rule, efficiency, load, cell_sum, cell_inverse_sum)
    if user_rate_bps(share, constants.bandwidth_hz, efficiency) <= enough_for_user_bps:
        return False
    throughput_bps = cell_throughput_bps(
        constants.share_rule,
        constants.bandwidth_hz,
        load,
        cell_sum,
        cell_inverse_sum,
        cell_square_sum + efficiency**2,
    )
    return throughput_bps > enough_for_uav_bps


@inlined
def _link_efficiency(
    constants: Constants,
    worlds: Worlds,
    world: int,
    uav: int,
    user: int,
    own_path_loss_db: Callable[..., float] | None,
) -> float:
    """Spectral efficiency of a link in bit/s/Hz, 0 where it is below the required SNR."""
    altitude_m = worlds.positions_m[world, uav, 2]
    power_w = link_power_w(
        worlds.transmit_powers_w[world, uav],
        _ground_distance_squared_m2(worlds, world, uav, user) + altitude_m * altitude_m,
        altitude_m,
        constants.link,
        constants.access_gain_db,
        own_path_loss_db,
    )
    snr = signal_to_noise_ratio(power_w, constants.access_noise_power_w)
    return spectral_efficiency(snr) if snr >= constants.required_snr else 0.0


@inlined
def _ground_distance_squared_m2(worlds: Worlds, world: int, uav: int, user: int) -> float:
    dx = worlds.user_coordinates_m[world, 0, user] - worlds.positions_m[world, uav, 0]
    dy = worlds.user_coordinates_m[world, 1, user] - worlds.positions_m[world, uav, 1]
    return dx * dx + dy * dy
