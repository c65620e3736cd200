"""Radio links of Section III-C and III-D: air-to-ground, terrestrial, backhaul.

Every function takes scalars or arrays that broadcast against each other, in Python as well as in
the compiled step of :mod:`orchid_uav.envs.dynamics`, which calls these same functions.

To try another channel, hand a function to :class:`orchid_uav.envs.WorldBatch`; association then
looks at every link (``docs/extending.md``).
"""

import math

import numpy as np
from numba.extending import register_jitable
from scipy.constants import speed_of_light

from orchid_uav.envs.elementary import (
    Numeric,
    arcsine,
    exponential,
    logarithm_2,
    logarithm_10,
)
from orchid_uav.envs.parameters import ChannelParameters
from orchid_uav.envs.units import decibel_to_linear, linear_to_decibel

_LN_2 = math.log(2.0)
_TABLE_I = ChannelParameters()
_FREQUENCY_HZ = _TABLE_I.carrier_frequency_hz
_S_CURVE_A = _TABLE_I.s_curve_a
_S_CURVE_B = _TABLE_I.s_curve_b
_LOSS_LOS_DB = _TABLE_I.excess_loss_los_db
_LOSS_NLOS_DB = _TABLE_I.excess_loss_nlos_db

LOSS_ALLOWS_PRUNING = True
"""The loss grows with distance, falls with elevation, and is at least that of a line of sight.

That is, free-space loss plus eta_LoS. True of the Al-Hourani model for b > 0 and eta_NLoS >=
eta_LoS (both validated). It lets association leave out UAVs that cannot be the strongest.
"""


@register_jitable(forceinline=True)
def elevation_angle_deg(altitude_m: Numeric, distance_m: Numeric) -> Numeric:
    """Elevation of the UAV seen from the user, in degrees: (180/pi) arcsin(z / d), d in 3-D."""
    return np.degrees(arcsine(altitude_m / distance_m))


@register_jitable(forceinline=True)
def line_of_sight_probability(
    elevation_deg: Numeric, a: Numeric = _S_CURVE_A, b: Numeric = _S_CURVE_B
) -> Numeric:
    """Pr_LoS = 1 / (1 + a exp(-b (theta - a))), theta in degrees (Section III-C1)."""
    return 1.0 / (1.0 + a * exponential(-b * (elevation_deg - a)))


@register_jitable(forceinline=True)
def free_space_gain(distance_m: Numeric, carrier_frequency_hz: Numeric = _FREQUENCY_HZ) -> Numeric:
    """(c / (4 pi f_c d))^2, received over transmitted power without losses; distance > 0."""
    ratio = speed_of_light / (4.0 * np.pi * carrier_frequency_hz) / distance_m
    return ratio * ratio


@register_jitable(forceinline=True)
def free_space_path_loss_db(
    distance_m: Numeric, carrier_frequency_hz: Numeric = _FREQUENCY_HZ
) -> Numeric:
    """20 log10(d) + 20 log10(f_c) + 20 log10(4 pi / c), distance > 0."""
    return -linear_to_decibel(free_space_gain(distance_m, carrier_frequency_hz))


@register_jitable(forceinline=True)
def excess_loss_db(
    distance_m: Numeric,
    altitude_m: Numeric,
    s_curve_a: Numeric = _S_CURVE_A,
    s_curve_b: Numeric = _S_CURVE_B,
    excess_loss_los_db: Numeric = _LOSS_LOS_DB,
    excess_loss_nlos_db: Numeric = _LOSS_NLOS_DB,
) -> Numeric:
    """Loss beyond free space in dB: eta_LoS and eta_NLoS weighted with their probabilities.

    ``distance_m`` is the 3-D one.
    """
    probability = line_of_sight_probability(
        elevation_angle_deg(altitude_m, distance_m), s_curve_a, s_curve_b
    )
    return probability * excess_loss_los_db + (1.0 - probability) * excess_loss_nlos_db


@register_jitable(forceinline=True)
def air_to_ground_path_loss_db(
    ground_distance_m: Numeric,
    altitude_m: Numeric,
    carrier_frequency_hz: Numeric = _FREQUENCY_HZ,
    s_curve_a: Numeric = _S_CURVE_A,
    s_curve_b: Numeric = _S_CURVE_B,
    excess_loss_los_db: Numeric = _LOSS_LOS_DB,
    excess_loss_nlos_db: Numeric = _LOSS_NLOS_DB,
) -> Numeric:
    """L^A2G in dB: LoS and NLoS loss weighted with their probabilities (Section III-C1).

    ``ground_distance_m`` >= 0 is horizontal, ``altitude_m`` > 0 the UAV's height over the user.
    """
    distance_m = np.sqrt(ground_distance_m * ground_distance_m + altitude_m * altitude_m)
    excess_db = excess_loss_db(
        distance_m, altitude_m, s_curve_a, s_curve_b, excess_loss_los_db, excess_loss_nlos_db
    )
    return free_space_path_loss_db(distance_m, carrier_frequency_hz) + excess_db


@register_jitable(forceinline=True)
def air_to_ground_gain(
    distance_m: Numeric,
    altitude_m: Numeric,
    carrier_frequency_hz: Numeric = _FREQUENCY_HZ,
    s_curve_a: Numeric = _S_CURVE_A,
    s_curve_b: Numeric = _S_CURVE_B,
    excess_loss_los_db: Numeric = _LOSS_LOS_DB,
    excess_loss_nlos_db: Numeric = _LOSS_NLOS_DB,
) -> Numeric:
    """10^(-L^A2G / 10) at a 3-D distance, without the logarithm that the power would take back."""
    excess_db = excess_loss_db(
        distance_m, altitude_m, s_curve_a, s_curve_b, excess_loss_los_db, excess_loss_nlos_db
    )
    return free_space_gain(distance_m, carrier_frequency_hz) * decibel_to_linear(-excess_db)


@register_jitable(forceinline=True)
def ground_path_loss_db(
    distance_m: Numeric,
    carrier_frequency_hz: Numeric,
    path_loss_exponent: Numeric,
    shadowing_db: Numeric,
) -> Numeric:
    """L^GBS = 20 log10(4 pi f_c / c) + 10 beta log10(d) + chi (Section III-C2; beta, chi: M4)."""
    reference_db = free_space_path_loss_db(1.0, carrier_frequency_hz)
    return reference_db + 10.0 * path_loss_exponent * logarithm_10(distance_m) + shadowing_db


@register_jitable(forceinline=True)
def received_power_w(
    transmit_power_w: Numeric, antenna_gain_db: Numeric, path_loss_db: Numeric
) -> Numeric:
    """P G_tx G_rx 10^(-L/10); ``antenna_gain_db`` is the sum of both gains."""
    return transmit_power_w * decibel_to_linear(antenna_gain_db - path_loss_db)


@register_jitable(forceinline=True)
def signal_to_noise_ratio(received_w: Numeric, noise_power_w: Numeric) -> Numeric:
    """gamma, linear: received power over the thermal noise N_0 B of the band (Section III-D)."""
    return received_w / noise_power_w


def strongest_transmitter(received_w: Numeric) -> Numeric:
    """Max-RSSI association: the first UAV that each user receives best (Section III-D).

    ``received_w`` is (N, M) or (N,). The simulator finds the same without looking at all links:
    :func:`orchid_uav.envs.association.find_strongest`.
    """
    return np.argmax(received_w, axis=0)


def best_case_gain_m2(
    antenna_gain_db: float, carrier_frequency_hz: float, excess_loss_los_db: float
) -> float:
    """Received over transmitted power of a certain line of sight, times the distance squared."""
    path_loss_db = free_space_path_loss_db(1.0, carrier_frequency_hz) + excess_loss_los_db
    return float(received_power_w(1.0, antenna_gain_db, path_loss_db))


@register_jitable(forceinline=True)
def backhaul_snr(
    distance_m: Numeric,
    transmit_power_w: Numeric,
    antenna_gain_db: Numeric,
    carrier_frequency_hz: Numeric,
    noise_power_w: Numeric,
) -> Numeric:
    """gamma^BH, linear: free-space link from the GBS to a UAV (Section III-C3).

    ``noise_power_w`` is N_0 B_BH. Nearer than 1 m the SNR stays that of 1 m, so that it is finite
    where a flight box around the GBS lets a UAV meet the antenna.
    """
    path_loss_db = free_space_path_loss_db(np.maximum(distance_m, 1.0), carrier_frequency_hz)
    received_w = received_power_w(transmit_power_w, antenna_gain_db, path_loss_db)
    return signal_to_noise_ratio(received_w, noise_power_w)


@register_jitable(forceinline=True)
def spectral_efficiency(snr: Numeric) -> Numeric:
    """Bits per second and hertz of a link with linear SNR: log2(1 + gamma)."""
    return logarithm_2(1.0 + snr)


@register_jitable(forceinline=True)
def snr_of_efficiency_db(efficiency: Numeric) -> Numeric:
    """SNR in dB of a link with this spectral efficiency > 0: :func:`spectral_efficiency` undone."""
    return 10.0 * logarithm_10(exponential(efficiency * _LN_2) - 1.0)
