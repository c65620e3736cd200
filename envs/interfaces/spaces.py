"""Gymnasium spaces of one UAV's observation and action, and of the global state."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from orchid_uav.envs.arrays import ACTION_SIZE, OBSERVATION_SIZE, Constants, state_size
from orchid_uav.envs.channel import backhaul_snr
from orchid_uav.envs.knowledge.informed import INFORMED_BOUND, INFORMED_SIZE
from orchid_uav.envs.observation import BACKHAUL_SCALE_DB
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.units import linear_to_decibel

_ROUNDING = 1e-6


def observation_space(parameters: Parameters, own_size: int | None = None) -> spaces.Box:
    """Local observation (O,), float32; see ``OBSERVATION_NAMES``, or ``INFORMED_NAMES``.

    Of the paper's, everything lies in [0, 1] but the nearest user's distance, at most the
    diagonal, and the backhaul's margin, whose bounds are those at the nearest and the farthest
    point of the flight box from a mast. With ``own_size``, that many numbers of the caller's own,
    of which no bounds are known.
    """
    if own_size is not None:
        return spaces.Box(-np.inf, np.inf, (own_size,), np.float32)
    if parameters.uav.observation == "informed":
        return spaces.Box(-INFORMED_BOUND, INFORMED_BOUND, (INFORMED_SIZE,), np.float32)
    return _paper_observation_space(parameters)


def _paper_observation_space(parameters: Parameters) -> spaces.Box:
    low = np.zeros(OBSERVATION_SIZE, np.float32)
    high = np.ones(OBSERVATION_SIZE, np.float32)
    high[4] = math.sqrt(2.0) + _ROUNDING
    least, greatest = _backhaul_margins(parameters)
    low[15] = np.nextafter(np.float32(least - _ROUNDING), np.float32(-np.inf))
    high[15] = np.nextafter(np.float32(greatest + _ROUNDING), np.float32(np.inf))
    return spaces.Box(low, high, dtype=np.float32)


def _backhaul_margins(parameters: Parameters) -> tuple[float, float]:
    """Least and greatest backhaul SNR above its threshold in the flight box, scaled (M18)."""
    uav, constants = parameters.uav, Constants.of(parameters)
    masts_m = constants.gbs_positions_m
    if not len(masts_m):
        return 1.0, 1.0
    low_m = np.array([0.0, 0.0, uav.min_altitude_m])
    high_m = np.array([*constants.area_size_m, uav.max_altitude_m])
    # The mast that a UAV receives best is the nearest, and none is farther than its own corner.
    farthest_m = np.linalg.norm(np.maximum(masts_m - low_m, high_m - masts_m), axis=1).min()
    nearest_m = np.linalg.norm(np.clip(masts_m, low_m, high_m) - masts_m, axis=1).min()
    margins = []
    for distance_m in (farthest_m, nearest_m):
        snr = backhaul_snr(
            distance_m,
            constants.gbs_transmit_power_w,
            constants.backhaul_gain_db,
            constants.carrier_frequency_hz,
            constants.backhaul_noise_power_w,
        )
        margin_db = linear_to_decibel(snr) - constants.backhaul_required_snr_db
        margins.append(float(margin_db) / BACKHAUL_SCALE_DB)
    return margins[0], margins[1]


def action_space() -> spaces.Box:
    """Action (4,), float32 in [-1, 1]: moves along x, y, z, and transmit power."""
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)


def state_space(parameters: Parameters) -> spaces.Box:
    """Global state s(t) for the critic, float32: all observations, u_dist, J (decision M19)."""
    one, uavs = _paper_observation_space(parameters), parameters.network.uav_count
    context = state_size(uavs) - uavs * OBSERVATION_SIZE
    low = np.concatenate([np.tile(one.low, uavs), np.zeros(context, np.float32)])
    high = np.concatenate([np.tile(one.high, uavs), np.ones(context, np.float32)])
    return spaces.Box(low, high, dtype=np.float32)


def centralized_space(observation: spaces.Space[Any], state: spaces.Space[Any]) -> spaces.Dict:
    """What centralised training gives each agent: {"observation", "state"}."""
    return spaces.Dict({"observation": observation, "state": state})
