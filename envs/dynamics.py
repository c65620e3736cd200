"""One slot of many worlds, compiled.

The loops here only say in which order the equations of the neighbouring modules are applied, and
to what; the equations themselves are those modules' functions. ``step_worlds`` moves on by a slot
in the order of decision M25: UAVs, transmit powers, users, association, rates, reward.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.association import Scratch, associate, make_scratch
from orchid_uav.envs.channel import backhaul_snr, signal_to_noise_ratio, spectral_efficiency
from orchid_uav.envs.compilation import SOURCES, compiled, inlined
from orchid_uav.envs.fairness import jain_index_from_sums
from orchid_uav.envs.kinematics import (
    clipped,
    displacement_factor,
    is_outside,
    is_too_close,
    next_coordinate_m,
    next_transmit_power_w,
)
from orchid_uav.envs.knowledge.in_flight import fail_and_join, sense_users
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
from orchid_uav.envs.observation import BACKHAUL_SCALE_DB, count_users, observe
from orchid_uav.envs.propulsion import climb_power_w, propulsion_power_w, total_power_w
from orchid_uav.envs.reward import (
    composite_reward,
    coverage_ratio,
    energy_efficiency,
    linear_schedule,
    log_rate_utility,
    normalised_energy_efficiency,
    penalty,
)
from orchid_uav.envs.sharing import bandwidth_share, user_rate_bps
from orchid_uav.envs.stations import autopilot_displacement_m, move_stations, settle_stations
from orchid_uav.envs.units import SMALLEST_NORMAL, linear_to_decibel
from orchid_uav.envs.users import counter_uniform, reflect_into, reflection_sign


@compiled
def step_worlds(
    constants: Constants,
    worlds: Worlds,
    actions: Floats,
    progress: float,
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Move every world on by one slot, in place.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds, after :func:`begin_episodes`.
        actions: (B, N, 4), clipped here to [-1, 1].
        progress: training progress tau in [0, 1], which sets the weights.
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    scratch = make_scratch(worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2])
    _step(constants, worlds, actions, progress, scratch, own_path_loss_db)


@inlined
def _step(
    constants: Constants,
    worlds: Worlds,
    actions: Floats,
    progress: float,
    scratch: Scratch,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """What :func:`step_worlds` does, with memory for one world at a time."""
    for world in range(len(worlds.slot)):
        _move_uavs(constants, worlds, world, actions[world])
        if constants.user_speed_mps > 0.0:
            _move_users(constants, worlds, world)
            count_users(constants, worlds, world)
        worlds.slot[world] += 1
        if len(constants.outages) > 0:
            fail_and_join(constants, worlds, world)
        _serve(constants, worlds, world, scratch, own_path_loss_db)
        if not constants.senses_truth:
            sense_users(constants, worlds, world)
        _watch_constraints(constants, worlds, world)
        _score(constants, worlds, world, progress)
        observe(constants, worlds, world)


@compiled
def begin_episodes(
    constants: Constants,
    worlds: Worlds,
    chosen: NDArray[np.int64],
    own_path_loss_db: Callable[..., float] | None = None,
    sources: str = SOURCES,
) -> None:
    """Serve users and observe at slot 0, after new positions were written into ``chosen`` worlds.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds.
        chosen: indices of the worlds that begin, int64.
        own_path_loss_db: see :func:`orchid_uav.envs.association.associate`.
        sources: not used; see ``SOURCES``.
    """
    scratch = make_scratch(worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2])
    _begin(constants, worlds, chosen, scratch, own_path_loss_db)


@inlined
def _begin(
    constants: Constants,
    worlds: Worlds,
    chosen: NDArray[np.int64],
    scratch: Scratch,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """What :func:`begin_episodes` does, with memory for one world at a time."""
    for world in chosen:
        worlds.slot[world] = 0
        worlds.user_velocities_mps[world] = 0.0
        worlds.velocities_mps[world] = 0.0
        worlds.left_flight_box[world] = False
        for uav in range(worlds.positions_m.shape[1]):
            for axis in range(2):
                worlds.stations_m[world, uav, axis] = worlds.positions_m[world, uav, axis]
        worlds.station_velocities_mps[world] = 0.0
        worlds.in_service[world] = True
        if len(constants.outages) > 0:
            fail_and_join(constants, worlds, world)
        count_users(constants, worlds, world)
        _serve(constants, worlds, world, scratch, own_path_loss_db)
        if not constants.senses_truth:
            sense_users(constants, worlds, world)
        _watch_constraints(constants, worlds, world)
        worlds.violation_slots[world] = 0
        _score(constants, worlds, world, 0.0)
        worlds.episode_sums[world] = 0.0
        observe(constants, worlds, world)


@inlined
def _move_uavs(constants: Constants, worlds: Worlds, world: int, actions: Floats) -> None:
    """Kinematics and power control, Sections III-B and IV-C2; decisions M5, M25, M38, M42."""
    east_m, north_m = constants.area_size_m
    low_m, high_m = constants.min_altitude_m, constants.max_altitude_m
    slot_s = constants.slot_s
    if constants.flies_stations:
        move_stations(constants, worlds, world, actions)
    for uav in range(len(actions)):
        velocity = worlds.velocities_mps[world, uav]
        if not worlds.in_service[world, uav]:
            velocity[0], velocity[1], velocity[2] = 0.0, 0.0, 0.0
            worlds.left_flight_box[world, uav] = False
            continue
        if constants.flies_stations:
            climb = clipped(actions[uav, 2], -1.0, 1.0)
            dx, dy, dz = autopilot_displacement_m(constants, worlds, world, uav, climb)
        else:
            dx, dy, dz = _displacement_m(constants, actions[uav])
        position = worlds.positions_m[world, uav]
        worlds.left_flight_box[world, uav] = (
            is_outside(position[0] + dx, 0.0, east_m)
            or is_outside(position[1] + dy, 0.0, north_m)
            or is_outside(position[2] + dz, low_m, high_m)
        )
        x_m = next_coordinate_m(position[0], dx, 0.0, east_m)
        y_m = next_coordinate_m(position[1], dy, 0.0, north_m)
        z_m = next_coordinate_m(position[2], dz, low_m, high_m)
        velocity[0] = (x_m - position[0]) / slot_s
        velocity[1] = (y_m - position[1]) / slot_s
        velocity[2] = (z_m - position[2]) / slot_s
        position[0], position[1], position[2] = x_m, y_m, z_m
        if not constants.flies_stations:  # a UAV is its own station
            worlds.stations_m[world, uav, 0], worlds.stations_m[world, uav, 1] = x_m, y_m
            worlds.station_velocities_mps[world, uav, 0] = velocity[0]
            worlds.station_velocities_mps[world, uav, 1] = velocity[1]
        power_w = worlds.transmit_powers_w[world, uav]
        change = clipped(actions[uav, 3], -1.0, 1.0)
        if constants.flies_stations and constants.station_power_w > 0.0:
            missing_w = constants.station_power_w - power_w
            change = clipped(missing_w / max(constants.power_step_w, SMALLEST_NORMAL), -1.0, 1.0)
        worlds.transmit_powers_w[world, uav] = next_transmit_power_w(
            power_w,
            constants.power_step_w,
            change,
            constants.min_transmit_power_w,
            constants.max_transmit_power_w,
        )
    if constants.flies_stations:
        settle_stations(constants, worlds, world)


@inlined
def _displacement_m(constants: Constants, action: Floats) -> tuple[float, float, float]:
    """Displacement that an action of direct flight wants, within V_max (M5)."""
    scale_x_m, scale_y_m, scale_z_m = constants.displacement_scale_m
    dx = clipped(action[0], -1.0, 1.0) * scale_x_m
    dy = clipped(action[1], -1.0, 1.0) * scale_y_m
    dz = clipped(action[2], -1.0, 1.0) * scale_z_m
    length_m = np.sqrt(dx * dx + dy * dy + dz * dz)
    factor = displacement_factor(length_m, constants.max_displacement_m)
    return dx * factor, dy * factor, dz * factor


@inlined
def _move_users(constants: Constants, worlds: Worlds, world: int) -> None:
    """Random walk with reflection; speed and heading are held for some slots (M16)."""
    users = worlds.user_coordinates_m.shape[2]
    slot = worlds.slot[world]
    velocities = worlds.user_velocities_mps[world]
    if slot % constants.heading_hold_slots == 0:
        key = worlds.walk_key[world]
        first = np.uint64(slot // constants.heading_hold_slots * 2 * users)
        for user in range(users):
            counter = first + np.uint64(2 * user)
            speed_mps = constants.user_speed_mps * counter_uniform(key, counter)
            heading = 2.0 * np.pi * counter_uniform(key, counter + np.uint64(1))
            velocities[0, user] = speed_mps * np.cos(heading)
            velocities[1, user] = speed_mps * np.sin(heading)
    for axis in range(2):
        side_m = constants.area_size_m[axis]
        for user in range(users):
            wanted_m = (
                worlds.user_coordinates_m[world, axis, user]
                + velocities[axis, user] * constants.slot_s
            )
            worlds.user_coordinates_m[world, axis, user] = reflect_into(wanted_m, side_m)
            velocities[axis, user] *= reflection_sign(wanted_m, side_m)


@inlined
def _serve(
    constants: Constants,
    worlds: Worlds,
    world: int,
    scratch: Scratch,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """Association by strongest received power, loads, shares, rates (Section III-D; M11, M12)."""
    association, efficiencies = worlds.association[world], worlds.spectral_efficiency[world]
    rates_bps, loads = worlds.rates_bps[world], worlds.loads[world]
    targets = worlds.target_users[world]
    received_w = rates_bps  # the same memory: rates come when powers are not needed any more
    associate(
        worlds.positions_m[world],
        worlds.transmit_powers_w[world],
        worlds.user_coordinates_m[world],
        targets,
        constants.link,
        constants.access_gain_db,
        constants.best_case_gain_m2,
        scratch,
        worlds.nearest_user_m[world],
        association,
        received_w,
        own_path_loss_db,
    )
    for user in range(len(association)):
        snr = signal_to_noise_ratio(received_w[user], constants.access_noise_power_w)
        is_served = targets[user] & (snr >= constants.required_snr)
        association[user] = association[user] if is_served else -1
        efficiencies[user] = spectral_efficiency(snr) if is_served else 0.0
    cell_sum, cell_inverse_sum = scratch.cell_sum, scratch.cell_inverse_sum
    for uav in range(len(loads)):
        loads[uav], cell_sum[uav], cell_inverse_sum[uav] = 0, 0.0, 0.0
    for user in range(len(association)):
        uav = association[user]
        if uav >= 0:
            loads[uav] += 1
            cell_sum[uav] += efficiencies[user]
            cell_inverse_sum[uav] += 1.0 / efficiencies[user]
    for user in range(len(association)):
        uav = association[user]
        if uav >= 0:
            efficiency = efficiencies[user]
            share = bandwidth_share(
                constants.share_rule, efficiency, loads[uav], cell_sum[uav], cell_inverse_sum[uav]
            )
            rates_bps[user] = user_rate_bps(share, constants.bandwidth_hz, efficiency)
        else:
            rates_bps[user] = 0.0


@inlined
def _watch_constraints(constants: Constants, worlds: Worlds, world: int) -> None:
    """Collisions, backhaul and the count of slots with a violation (M17)."""
    positions_m = worlds.positions_m[world]
    uavs = len(positions_m)
    for uav in range(uavs):
        worlds.close_uavs[world, uav] = 0
        for other in range(uav):
            dx = positions_m[uav, 0] - positions_m[other, 0]
            dy = positions_m[uav, 1] - positions_m[other, 1]
            dz = positions_m[uav, 2] - positions_m[other, 2]
            # Hardly any two are, so that this order looks at two states for hardly any two.
            if (
                is_too_close(dx * dx + dy * dy + dz * dz, constants.min_separation_m)
                and worlds.in_service[world, uav]
                and worlds.in_service[world, other]
            ):
                worlds.close_uavs[world, uav] += 1
                worlds.close_uavs[world, other] += 1
    for uav in range(uavs):
        snr_db = _backhaul_snr_db(constants, positions_m[uav])
        worlds.backhaul_snr_db[world, uav] = snr_db
        worlds.weak_backhaul[world, uav] = worlds.in_service[world, uav] and (
            snr_db < constants.backhaul_required_snr_db
        )
        violations = worlds.violation_slots[world, uav]
        violations[0] += worlds.close_uavs[world, uav] > 0
        violations[1] += worlds.left_flight_box[world, uav]
        violations[2] += worlds.weak_backhaul[world, uav]


@inlined
def _backhaul_snr_db(constants: Constants, position_m: Floats) -> float:
    """SNR of a UAV's link to the mast that it receives best, the nearest (M45)."""
    masts_m = constants.gbs_positions_m
    if len(masts_m) == 0:
        return constants.backhaul_required_snr_db + BACKHAUL_SCALE_DB
    nearest_m2 = np.inf
    for mast in range(len(masts_m)):
        dx = position_m[0] - masts_m[mast, 0]
        dy = position_m[1] - masts_m[mast, 1]
        dz = position_m[2] - masts_m[mast, 2]
        nearest_m2 = min(nearest_m2, dx * dx + dy * dy + dz * dz)
    snr = backhaul_snr(
        np.sqrt(nearest_m2),
        constants.gbs_transmit_power_w,
        constants.backhaul_gain_db,
        constants.carrier_frequency_hz,
        constants.backhaul_noise_power_w,
    )
    return linear_to_decibel(snr)


@inlined
def _score(constants: Constants, worlds: Worlds, world: int, progress: float) -> None:
    """Metrics of the slot and every UAV's reward (Section IV-C3, V-B; decisions M7 to M14)."""
    uavs = worlds.positions_m.shape[1]
    users = worlds.user_coordinates_m.shape[2]
    target_count, served_count = 0, 0
    sum_rate, sum_rate_squared, worst_rate, log_utility = 0.0, 0.0, np.inf, 0.0
    for user in range(users):
        if worlds.target_users[world, user]:
            rate = worlds.rates_bps[world, user]
            target_count += 1
            served_count += worlds.association[world, user] >= 0
            sum_rate += rate
            sum_rate_squared += rate * rate
            worst_rate = min(worst_rate, rate)
            if constants.rewards_log_rates:
                log_utility += log_rate_utility(
                    rate, constants.log_rate_floor_bps, constants.best_rate_bps
                )
    load_squared, propulsion_w, transmit_w = 0.0, 0.0, 0.0
    close, outside, weak, in_service = 0, 0, 0, 0
    for uav in range(uavs):
        if not worlds.in_service[world, uav]:
            continue
        in_service += 1
        close += worlds.close_uavs[world, uav]
        outside += worlds.left_flight_box[world, uav]
        weak += worlds.weak_backhaul[world, uav]
        load_squared += worlds.loads[world, uav] * worlds.loads[world, uav]
        propulsion_w += _propulsion_power_w(constants, worlds.velocities_mps[world, uav])
        transmit_w += worlds.transmit_powers_w[world, uav]

    coverage = coverage_ratio(served_count, target_count)
    # With all UAVs failed there is neither rate nor power, and no efficiency.
    power_w = total_power_w(propulsion_w, transmit_w) if in_service > 0 else 1.0
    efficiency = energy_efficiency(sum_rate, power_w, constants.power_epsilon_w)
    rate_jfi = jain_index_from_sums(sum_rate, sum_rate_squared, served_count)
    load_jfi = jain_index_from_sums(float(served_count), load_squared, in_service)
    metrics = worlds.metrics[world]
    metrics[COVERAGE] = coverage
    metrics[ENERGY_EFFICIENCY] = efficiency
    metrics[RATE_JFI] = rate_jfi
    metrics[LOAD_JFI] = load_jfi
    metrics[WORST_RATE] = worst_rate if target_count > 0 else 0.0
    metrics[SUM_RATE] = sum_rate
    metrics[PROPULSION_POWER] = propulsion_w
    metrics[COLLISIONS] = close / 2
    metrics[BOUNDARY_VIOLATIONS] = outside
    metrics[BACKHAUL_VIOLATIONS] = weak

    rate_term = log_utility / max(target_count, 1) if constants.rewards_log_rates else rate_jfi
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
    penalty_weight = linear_schedule(*constants.penalty_weight, progress)
    backhaul_penalty = linear_schedule(*constants.backhaul_penalty, progress)
    for uav in range(uavs):
        worlds.rewards[world, uav] = shared - penalty_weight * penalty(
            worlds.close_uavs[world, uav],
            worlds.left_flight_box[world, uav],
            worlds.weak_backhaul[world, uav],
            constants.collision_penalty,
            constants.boundary_penalty,
            backhaul_penalty,
        )
    _add_up(worlds, world)


@inlined
def _add_up(worlds: Worlds, world: int) -> None:
    """Add the slot's mean reward and metrics to the episode's sums."""
    reward, uavs = 0.0, worlds.rewards.shape[1]
    for uav in range(uavs):
        reward += worlds.rewards[world, uav]
    sums = worlds.episode_sums[world]
    sums[0] += reward / uavs
    for metric in range(worlds.metrics.shape[1]):
        sums[1 + metric] += worlds.metrics[world, metric]


@inlined
def _propulsion_power_w(constants: Constants, velocity: Floats) -> float:
    speed_mps = np.sqrt(
        velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]
    )
    power_w = propulsion_power_w(speed_mps, *constants.rotor)
    return power_w + climb_power_w(velocity[2], constants.climbing_mass_kg)
