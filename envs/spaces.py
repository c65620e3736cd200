"""Gymnasium spaces of one UAV's observation and action, and of the global state."""

import math
from typing import Any

import numpy as np
from gymnasium import spaces

from orchid_uav.envs.arrays import ACTION_SIZE, OBSERVATION_SIZE, state_size


def observation_space() -> spaces.Box:
    """Local observation (16,), float32; see ``OBSERVATION_NAMES``.

    Everything lies in [0, 1] but the nearest user's distance, at most the diagonal, and the
    backhaul's margin, which other parameters than Table I can drive anywhere.
    """
    low = np.zeros(OBSERVATION_SIZE, np.float32)
    high = np.ones(OBSERVATION_SIZE, np.float32)
    high[4] = math.sqrt(2.0) + 1e-6
    low[-1], high[-1] = -np.inf, np.inf
    return spaces.Box(low, high, dtype=np.float32)


def action_space() -> spaces.Box:
    """Action (4,), float32 in [-1, 1]: moves along x, y, z, and transmit power."""
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)


def state_space(uavs: int) -> spaces.Box:
    """Global state s(t) for the critic, float32: all observations, u_dist, J (decision M19)."""
    one = observation_space()
    context = state_size(uavs) - uavs * OBSERVATION_SIZE
    low = np.concatenate([np.tile(one.low, uavs), np.zeros(context, np.float32)])
    high = np.concatenate([np.tile(one.high, uavs), np.ones(context, np.float32)])
    return spaces.Box(low, high, dtype=np.float32)


def centralized_space(observation: spaces.Space[Any], state: spaces.Space[Any]) -> spaces.Dict:
    """What centralised training gives each agent: {"observation", "state"}."""
    return spaces.Dict({"observation": observation, "state": state})
