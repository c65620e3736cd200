"""The simulator's step in plain NumPy, as a reference for its speed and its results.

One call of :func:`step_worlds` does to the arrays of :class:`orchid_uav.envs.arrays.Worlds` what
the compiled function of that name does, with the same equations, but on whole arrays: no Python
loop over worlds, UAVs or users. Exponentials, logarithms and arcsines are NumPy's own, which are
faster on arrays than :mod:`orchid_uav.envs.elementary`. ``tests/studies/test_numpy_world.py``
compares the two, slot by slot.
"""

from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.second_copy import second_copy
from orchid_uav.envs import channel as simulators_channel
from orchid_uav.envs import elementary
from orchid_uav.envs import units as simulators_units
from orchid_uav.envs.arrays import HISTOGRAM_CELLS, Constants, Floats, Worlds
from orchid_uav.envs.fairness import jain_index_from_sums
from orchid_uav.envs.kinematics import clipped, displacement_factor, is_outside, relative
from orchid_uav.envs.metrics import (
    BACKHAUL_VIOLATIONS,
    BOUNDARY_VIOLATIONS,
    COLLISIONS,
    COVERAGE,
    ENERGY_EFFICIENCY,
    LOAD_JFI,
    PROPULSION_POWER,
    RATE_JFI,
    SUM_RATE,
    WORST_RATE,
)
from orchid_uav.envs.observation import BACKHAUL_SCALE_DB
from orchid_uav.envs.propulsion import climb_power_w, propulsion_power_w
from orchid_uav.envs.reward import (
    composite_reward,
    coverage_ratio,
    energy_efficiency,
    linear_schedule,
    log_rate_utility,
    normalised_energy_efficiency,
    penalty,
)
from orchid_uav.envs.sharing import MAX_MIN, PROPORTIONAL, bandwidth_share
from orchid_uav.envs.users import counter_uniform, reflect_into, reflection_sign

Integers = NDArray[np.int64]


class _NumpysOwn(ModuleType):
    """Stands in for :mod:`orchid_uav.envs.elementary`."""

    Numeric = Any
    exponential, arcsine = np.exp, np.arcsin
    logarithm, logarithm_2, logarithm_10 = np.log, np.log2, np.log10


_ELEMENTARY = {elementary.__name__: _NumpysOwn(elementary.__name__)}
units = second_copy(simulators_units, _ELEMENTARY)
channel = second_copy(simulators_channel, {**_ELEMENTARY, simulators_units.__name__: units})


def step_worlds(
    constants: Constants,
    worlds: Worlds,
    actions: Floats,
    progress: float,
    prune: bool = False,
) -> None:
    """Advance every world by one slot, in place.

    Args:
        constants: the constants of the parameters with which the worlds were made.
        worlds: B worlds in the middle of their episodes.
        actions: (B, N, 4); they are clipped here to [-1, 1].
        progress: training progress tau in [0, 1], which sets the weights.
        prune: exclude UAVs before any logarithm is taken, as the compiled step does.
    """
    _move_uavs(constants, worlds, actions)
    if constants.user_speed_mps > 0.0:
        _move_users(constants, worlds)
        _count_users(constants, worlds)
    worlds.slot[:] += 1
    _serve(constants, worlds, prune)
    _watch_constraints(constants, worlds)
    _score(constants, worlds, progress)
    _observe(constants, worlds)


def _move_uavs(constants: Constants, worlds: Worlds, actions: Floats) -> None:
    wanted = clipped(actions, -1.0, 1.0)
    displacement_m = wanted[..., :3] * constants.displacement_scale_m
    length_m = np.sqrt(_sum_of_squares(displacement_m))
    displacement_m *= displacement_factor(length_m, constants.max_displacement_m)[..., None]
    displacement_m += worlds.positions_m
    low_m, high_m = _flight_box(constants)
    is_outside(displacement_m, low_m, high_m).any(axis=-1, out=worlds.left_flight_box)
    position_m = clipped(displacement_m, low_m, high_m)
    np.subtract(position_m, worlds.positions_m, out=worlds.velocities_mps)
    worlds.velocities_mps[:] /= constants.slot_s
    worlds.positions_m[:] = position_m
    worlds.stations_m[:] = position_m[..., :2]  # in direct flight a UAV is its own station
    worlds.station_velocities_mps[:] = worlds.velocities_mps[..., :2]
    worlds.transmit_powers_w[:] = clipped(
        worlds.transmit_powers_w + constants.power_step_w * wanted[..., 3],
        constants.min_transmit_power_w,
        constants.max_transmit_power_w,
    )


def _flight_box(constants: Constants) -> tuple[Floats, Floats]:
    low_m = np.array([0.0, 0.0, constants.min_altitude_m])
    high_m = np.array([*constants.area_size_m, constants.max_altitude_m])
    return low_m, high_m


def _sum_of_squares(vectors: NDArray[Any]) -> NDArray[Any]:
    return np.einsum("...i,...i->...", vectors, vectors)


def _move_users(constants: Constants, worlds: Worlds) -> None:
    turning = np.flatnonzero(worlds.slot % constants.heading_hold_slots == 0)
    if len(turning):
        _turn_users(constants, worlds, turning)
    wanted_m = worlds.user_velocities_mps * constants.slot_s
    wanted_m += worlds.user_coordinates_m
    sides_m = np.array(constants.area_size_m)[:, None]
    worlds.user_coordinates_m[:] = reflect_into(wanted_m, sides_m)
    worlds.user_velocities_mps[:] *= reflection_sign(wanted_m, sides_m)


def _turn_users(constants: Constants, worlds: Worlds, turning: Integers) -> None:
    users = worlds.user_coordinates_m.shape[2]
    draws = (worlds.slot[turning] // constants.heading_hold_slots).astype(np.uint64)
    counters = draws[:, None] * np.uint64(2 * users) + np.arange(2 * users, dtype=np.uint64)
    uniform = counter_uniform(worlds.walk_key[turning, None], counters)
    speed_mps = constants.user_speed_mps * uniform[:, ::2]
    heading = 2.0 * np.pi * uniform[:, 1::2]
    worlds.user_velocities_mps[turning, 0] = speed_mps * np.cos(heading)
    worlds.user_velocities_mps[turning, 1] = speed_mps * np.sin(heading)


def _count_users(constants: Constants, worlds: Worlds) -> None:
    cells_per_m = HISTOGRAM_CELLS / np.array(constants.area_size_m)[:, None]
    cells = (worlds.user_coordinates_m * cells_per_m).astype(np.int64)
    np.minimum(cells, HISTOGRAM_CELLS - 1, out=cells)
    cell = cells[:, 0] * HISTOGRAM_CELLS + cells[:, 1]
    counts = _sum_by_bin(cell, HISTOGRAM_CELLS * HISTOGRAM_CELLS)
    first = worlds.observations[0].size
    worlds.states[:, first : first + counts.shape[1]] = counts / worlds.user_coordinates_m.shape[2]


@lru_cache
def _first_bins(world_count: int, bins: int) -> Integers:
    return np.arange(world_count)[:, None] * bins


def _sum_by_bin(bin_of: Integers, bins: int, weights: Floats | None = None) -> NDArray[np.generic]:
    """Counts or sums of weights per bin, (B, bins); ``bin_of`` (B, M) holds each entry's bin."""
    flat = (bin_of + _first_bins(len(bin_of), bins)).ravel()
    summed = np.bincount(flat, None if weights is None else weights.ravel(), len(bin_of) * bins)
    return summed.reshape(len(bin_of), bins)


def _serve(constants: Constants, worlds: Worlds, prune: bool) -> None:
    ground_squared_m2 = worlds.user_coordinates_m[:, None, 0] - worlds.positions_m[..., 0, None]
    ground_squared_m2 *= ground_squared_m2
    along_y_m2 = worlds.user_coordinates_m[:, None, 1] - worlds.positions_m[..., 1, None]
    along_y_m2 *= along_y_m2
    ground_squared_m2 += along_y_m2
    np.sqrt(ground_squared_m2.min(axis=2), out=worlds.nearest_user_m)
    received = _received_from_few_w if prune else _received_from_all_w
    power_w = received(constants, worlds, ground_squared_m2)
    best_power_w = power_w.max(axis=1)
    strongest = _first_of_equals(power_w == best_power_w[:, None])
    snr = np.divide(best_power_w, constants.access_noise_power_w, out=best_power_w)
    served = snr >= constants.required_snr
    served &= worlds.target_users
    worlds.association[:] = np.where(served, strongest, -1)
    worlds.spectral_efficiency[:] = np.where(served, channel.spectral_efficiency(snr), 0.0)
    _share(constants, worlds, served)


def _received_from_all_w(constants: Constants, worlds: Worlds, ground_squared_m2: Floats) -> Floats:
    """Received powers (B, N, M); ``ground_squared_m2`` is overwritten."""
    path_loss_db = channel.air_to_ground_path_loss_db(
        np.sqrt(ground_squared_m2, out=ground_squared_m2),
        worlds.positions_m[..., 2, None],
        *constants.link,
    )
    return channel.received_power_w(
        worlds.transmit_powers_w[..., None], constants.access_gain_db, path_loss_db
    )


def _received_from_few_w(constants: Constants, worlds: Worlds, ground_squared_m2: Floats) -> Floats:
    """Received powers (B, N, M), 0 for UAVs that cannot be a user's strongest.

    This is the first rule of :mod:`orchid_uav.envs.association`: besides the nearest UAV, with
    distances weighted by power, only UAVs seen at a higher elevation can be the strongest. It needs
    ``LOSS_ALLOWS_PRUNING``. The second rule would exclude few further links, but need more passes.
    """
    altitude_m = worlds.positions_m[..., 2]
    altitude_squared = np.square(altitude_m)[..., None]
    distance_squared = ground_squared_m2 + altitude_squared
    nearness = worlds.transmit_powers_w[..., None] / distance_squared
    elevation = np.divide(altitude_squared, distance_squared, out=distance_squared)
    is_nearest = nearness == nearness.max(axis=1, keepdims=True)
    elevation_of_nearest = np.where(is_nearest, elevation, 0.0).max(axis=1, keepdims=True)
    is_candidate = elevation > elevation_of_nearest
    is_candidate |= is_nearest
    is_candidate &= worlds.target_users[:, None]
    links = np.flatnonzero(is_candidate)
    uavs = links // ground_squared_m2.shape[2]
    path_loss_db = channel.air_to_ground_path_loss_db(
        np.sqrt(ground_squared_m2.ravel()[links]), altitude_m.ravel()[uavs], *constants.link
    )
    power_w = nearness
    power_w.fill(0.0)
    power_w.ravel()[links] = channel.received_power_w(
        worlds.transmit_powers_w.ravel()[uavs], constants.access_gain_db, path_loss_db
    )
    return power_w


def _first_of_equals(is_best: NDArray[np.bool_]) -> Integers:
    """First index along axis 1 that is True, (B, M); several times faster than ``argmax``."""
    count = is_best.shape[1]
    rank = is_best * np.arange(count, 0, -1, dtype=np.int16)[:, None]
    return count - rank.max(axis=1).astype(np.int64)


def _share(constants: Constants, worlds: Worlds, served: NDArray[np.bool_]) -> None:
    uavs = worlds.loads.shape[1]
    cell = worlds.association + 1  # users that are not served share bin 0
    worlds.loads[:] = _sum_by_bin(cell, uavs + 1)[:, 1:]
    efficiency = np.where(served, worlds.spectral_efficiency, 1.0)
    rule = constants.share_rule
    weights = {MAX_MIN: 1.0 / efficiency, PROPORTIONAL: None}.get(rule, efficiency)
    sums = _sum_by_bin(cell, uavs + 1, weights)
    cell_sum = np.take_along_axis(sums, cell, axis=1)
    share = bandwidth_share(rule, efficiency, cell_sum, cell_sum, cell_sum)
    share *= constants.bandwidth_hz
    share *= worlds.spectral_efficiency
    worlds.rates_bps[:] = share


@lru_cache
def _others(uavs: int) -> NDArray[np.bool_]:
    return ~np.eye(uavs, dtype=np.bool_)


def _watch_constraints(constants: Constants, worlds: Worlds) -> None:
    positions_m = worlds.positions_m
    apart_m = positions_m[:, :, None] - positions_m[:, None]
    close = _sum_of_squares(apart_m) < constants.min_separation_m * constants.min_separation_m
    close &= _others(positions_m.shape[1])
    close.sum(axis=2, out=worlds.close_uavs)
    to_masts_m2 = _sum_of_squares(positions_m[:, :, None] - constants.gbs_positions_m)
    snr = channel.backhaul_snr(
        np.sqrt(to_masts_m2.min(axis=2)),
        constants.gbs_transmit_power_w,
        constants.backhaul_gain_db,
        constants.carrier_frequency_hz,
        constants.backhaul_noise_power_w,
    )
    worlds.backhaul_snr_db[:] = units.linear_to_decibel(snr)
    np.less(worlds.backhaul_snr_db, constants.backhaul_required_snr_db, out=worlds.weak_backhaul)
    worlds.violation_slots[..., 0] += worlds.close_uavs > 0
    worlds.violation_slots[..., 1] += worlds.left_flight_box
    worlds.violation_slots[..., 2] += worlds.weak_backhaul


def _score(constants: Constants, worlds: Worlds, progress: float) -> None:
    uavs = worlds.loads.shape[1]
    rates, targets, loads = worlds.rates_bps, worlds.target_users, worlds.loads
    target_count = np.count_nonzero(targets, axis=1)
    served_count = loads.sum(axis=1)
    sum_rate = rates.sum(axis=1)
    speed_mps = np.sqrt(_sum_of_squares(worlds.velocities_mps))
    propulsion_w = propulsion_power_w(speed_mps, *constants.rotor)
    if constants.climbing_mass_kg:
        propulsion_w += climb_power_w(worlds.velocities_mps[..., 2], constants.climbing_mass_kg)
    fleet_propulsion_w = propulsion_w.sum(axis=1)
    total_power_w = fleet_propulsion_w + worlds.transmit_powers_w.sum(axis=1)

    coverage = coverage_ratio(served_count, target_count)
    efficiency = energy_efficiency(sum_rate, total_power_w, constants.power_epsilon_w)
    rate_jfi = jain_index_from_sums(sum_rate, _sum_of_squares(rates), served_count)
    load_jfi = jain_index_from_sums(served_count.astype(float), _sum_of_squares(loads), uavs)
    metrics = worlds.metrics
    metrics[:, COVERAGE] = coverage
    metrics[:, ENERGY_EFFICIENCY] = efficiency
    metrics[:, RATE_JFI] = rate_jfi
    metrics[:, LOAD_JFI] = load_jfi
    worst_rate = np.where(targets, rates, np.inf).min(axis=1)
    metrics[:, WORST_RATE] = np.where(target_count > 0, worst_rate, 0.0)
    metrics[:, SUM_RATE] = sum_rate
    metrics[:, PROPULSION_POWER] = fleet_propulsion_w
    metrics[:, COLLISIONS] = worlds.close_uavs.sum(axis=1) / 2
    metrics[:, BOUNDARY_VIOLATIONS] = np.count_nonzero(worlds.left_flight_box, axis=1)
    metrics[:, BACKHAUL_VIOLATIONS] = np.count_nonzero(worlds.weak_backhaul, axis=1)

    rate_term = rate_jfi
    if constants.rewards_log_rates:
        # A rate of 0, which all users but the targets have, has utility 0.
        utility = log_rate_utility(rates, constants.log_rate_floor_bps, constants.best_rate_bps)
        rate_term = utility.sum(axis=1) / np.maximum(target_count, 1)
    shared = composite_reward(
        constants.coverage_weight,
        linear_schedule(*constants.efficiency_weight, progress),
        linear_schedule(*constants.load_fairness_weight, progress),
        linear_schedule(*constants.rate_fairness_weight, progress),
        coverage,
        normalised_energy_efficiency(efficiency, constants.efficiency_scale_bit_per_joule),
        load_jfi,
        rate_term,
    )
    penalties = penalty(
        worlds.close_uavs,
        worlds.left_flight_box,
        worlds.weak_backhaul,
        constants.collision_penalty,
        constants.boundary_penalty,
        linear_schedule(*constants.backhaul_penalty, progress),
    )
    penalties *= linear_schedule(*constants.penalty_weight, progress)
    np.subtract(shared[:, None], penalties, out=worlds.rewards)
    worlds.episode_sums[:, 0] += worlds.rewards.sum(axis=1) / uavs
    worlds.episode_sums[:, 1:] += metrics


def _observe(constants: Constants, worlds: Worlds) -> None:
    seen = worlds.observations
    across = worlds.positions_m[..., :2] / constants.area_size_m
    altitude = relative(
        worlds.positions_m[..., 2], constants.min_altitude_m, constants.max_altitude_m
    )
    seen[..., 0:2] = across
    seen[..., 2] = altitude
    seen[..., 3] = relative(
        worlds.transmit_powers_w, constants.min_transmit_power_w, constants.max_transmit_power_w
    )
    longer_side_m = max(constants.area_size_m)
    np.divide(worlds.nearest_user_m, longer_side_m, out=seen[..., 4], casting="same_kind")
    seen[..., 5] = worlds.loads / worlds.user_coordinates_m.shape[2]
    seen[..., 6:10:2] = across
    seen[..., 7:10:2] = 1.0 - across
    seen[..., 10] = altitude
    seen[..., 11] = 1.0 - altitude
    seen[..., 12:15] = worlds.violation_slots / np.maximum(worlds.slot, 1)[:, None, None]
    margin_db = worlds.backhaul_snr_db - constants.backhaul_required_snr_db
    seen[..., 15] = margin_db / BACKHAUL_SCALE_DB
    own = seen[0].size
    worlds.states[:, :own] = seen.reshape(len(seen), own)
    worlds.states[:, -1] = worlds.metrics[:, RATE_JFI]
