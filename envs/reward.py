"""Reward terms, weights and penalties of Section IV-C3."""

import numpy as np
from numba.extending import register_jitable

from orchid_uav.envs.channel import (
    air_to_ground_path_loss_db,
    received_power_w,
    signal_to_noise_ratio,
    spectral_efficiency,
)
from orchid_uav.envs.elementary import Numeric, logarithm
from orchid_uav.envs.parameters import Parameters, RewardParameters
from orchid_uav.envs.propulsion import least_power_speed_mps, propulsion_power_w, total_power_w
from orchid_uav.envs.sharing import user_rate_bps
from orchid_uav.envs.units import SMALLEST_NORMAL


@register_jitable
def linear_schedule(start: Numeric, end: Numeric, progress: Numeric) -> Numeric:
    """Weight at training progress tau in [0, 1]: from ``start`` to ``end`` in a straight line."""
    return start + (end - start) * progress


@register_jitable
def coverage_ratio(served_count: Numeric, target_count: Numeric) -> Numeric:
    """r^cov, eq. (cov_reward): served over target users; 1 if there is nobody to serve (M14)."""
    return (served_count + (target_count == 0)) / np.maximum(target_count, 1)


@register_jitable
def energy_efficiency(sum_rate_bps: Numeric, total_power_w: Numeric, epsilon_w: Numeric) -> Numeric:
    """EE_sys in bit/J: sum rate over total power, eq. (ee_reward) before Norm(·)."""
    return sum_rate_bps / (total_power_w + epsilon_w)


@register_jitable
def normalised_energy_efficiency(
    efficiency_bit_per_joule: Numeric, scale_bit_per_joule: Numeric
) -> Numeric:
    """Norm(EE) = EE / EE_max clipped to [0, 1] (decision M7)."""
    return np.minimum(np.maximum(efficiency_bit_per_joule / scale_bit_per_joule, 0.0), 1.0)


@register_jitable
def log_rate_utility(rate_bps: Numeric, low_rate_bps: Numeric, high_rate_bps: Numeric) -> Numeric:
    """One user's term of the PF reward (M13): log(R/R_lo) / log(R_hi/R_lo) clipped to [0, 1].

    0 where no rate exceeds R_lo.
    """
    ratio = np.maximum(rate_bps, low_rate_bps) / low_rate_bps
    span = np.maximum(logarithm(high_rate_bps / low_rate_bps), SMALLEST_NORMAL)
    return np.minimum(logarithm(ratio) / span, 1.0)


@register_jitable
def penalty(
    close_uav_count: Numeric,
    leaves_flight_box: Numeric,
    backhaul_is_weak: Numeric,
    collision_penalty: Numeric,
    boundary_penalty: Numeric,
    backhaul_penalty: Numeric,
) -> Numeric:
    """r^pen of one UAV, eq. (penalty_reward); the first three are counts or 0/1 indicators."""
    return (
        collision_penalty * close_uav_count
        + boundary_penalty * leaves_flight_box
        + backhaul_penalty * backhaul_is_weak
    )


@register_jitable
def composite_reward(
    coverage_weight: Numeric,
    efficiency_weight: Numeric,
    load_weight: Numeric,
    rate_weight: Numeric,
    coverage: Numeric,
    efficiency: Numeric,
    load_fairness: Numeric,
    rate_fairness: Numeric,
) -> Numeric:
    """The shared terms of eq. (hybrid_reward), which are U_total, eq. (global_utility), too."""
    return (
        coverage_weight * coverage
        + efficiency_weight * efficiency
        + load_weight * load_fairness
        + rate_weight * rate_fairness
    )


def final_utility(
    weights: RewardParameters,
    efficiency_scale_bit_per_joule: float,
    coverage: Numeric,
    efficiency_bit_per_joule: Numeric,
    load_jfi: Numeric,
    rate_jfi: Numeric,
) -> Numeric:
    """U_total, eq. (global_utility), at training progress 1, from metrics of a slot.

    The same function for every objective, so that it compares methods.
    """
    return composite_reward(
        weights.coverage_weight,
        weights.efficiency_weight[1],
        weights.load_fairness_weight[1],
        weights.rate_fairness_weight[1],
        coverage,
        normalised_energy_efficiency(efficiency_bit_per_joule, efficiency_scale_bit_per_joule),
        load_jfi,
        rate_jfi,
    )


def best_rate_bps(parameters: Parameters) -> float:
    """Rate of a user straight below a UAV at H_min and P_max that gets the whole sub-band.

    It is R_hi of decision M13 and the numerator of EE_max (M7).
    """
    channel, uav = parameters.channel, parameters.uav
    path_loss_db = air_to_ground_path_loss_db(0.0, uav.min_altitude_m, **channel.air_to_ground())
    power_w = received_power_w(uav.max_transmit_power_w, channel.access_gain_db, path_loss_db)
    snr = signal_to_noise_ratio(power_w, parameters.access_noise_power_w)
    return float(user_rate_bps(1.0, parameters.bandwidth_hz, spectral_efficiency(snr)))


def energy_efficiency_scale(parameters: Parameters) -> float:
    """EE_max in bit/J (decision M7); about 0.8 Mbit/J at Table I, above 0 even for dead links."""
    speed_mps = least_power_speed_mps(parameters.rotor, parameters.uav.max_speed_mps)
    least_power_w = propulsion_power_w(speed_mps, **parameters.rotor.power_curve())
    power_w = total_power_w(least_power_w, parameters.uav.max_transmit_power_w)
    return max(float(best_rate_bps(parameters) / power_w), SMALLEST_NORMAL)
