"""The network as a simulator, and its PettingZoo, Gymnasium and SB3 faces."""

from orchid_uav.envs.centralized import CentralizedState
from orchid_uav.envs.factory import make_supersuit_vec_env, make_vec_env, parallel_env
from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.world import WorldBatch, evaluation_seeds, world_seeds

__all__ = [
    "EPISODE_METRICS",
    "SLOT_METRICS",
    "CentralizedState",
    "Parameters",
    "WorldBatch",
    "evaluation_seeds",
    "make_supersuit_vec_env",
    "make_vec_env",
    "parallel_env",
    "world_seeds",
]
