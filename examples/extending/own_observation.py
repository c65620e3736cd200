"""Observations of your own: the built-in ones, and the direction to the middle of the users served.

python examples/extending/own_observation.py     # trains for minutes, writes ./own_observation
orchid eval --method examples/extending/own_observation.py:Informed --methods learned
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents import MAPPO, load_policy
from orchid_uav.agents.controllers.controller import Actions
from orchid_uav.agents.deployed_actor import policy_files
from orchid_uav.envs import WorldBatch, make_vec_env

FOLDER = Path("own_observation")


def observe(world: WorldBatch) -> NDArray[np.float32]:
    """What every UAV sees, (B, N, 18); any number of values is allowed, and all spaces adapt."""
    arrays = world.arrays
    serves = arrays.association[:, None, :] == np.arange(world.uav_count)[:, None]  # (B, N, M)
    users = serves.sum(axis=2)[..., None]
    middle_m = np.einsum("bnm,bma->bna", serves, world.users_m) / np.maximum(users, 1)
    way_m = np.where(users > 0, middle_m - arrays.positions_m[..., :2], 0.0)
    scaled = way_m / world.parameters.network.area_size_m
    return np.concatenate([arrays.observations, scaled], axis=2, dtype=np.float32)


def train(episodes: int = 700, **world: int) -> None:
    """Train with unchanged MAPPO, without Reset-and-Finetune and schedules."""
    env = make_vec_env(observe=observe, **world)
    env.set_progress(1.0)  # reward weights as at the end of training
    slots = env.parameters.network.episode_slots
    model = MAPPO("CentralizedCriticPolicy", env, n_steps=slots, seed=0)
    model.learn(episodes * slots * env.num_envs)
    FOLDER.mkdir(exist_ok=True)
    files = policy_files(model.policy.actor_layers(), model.exploration_log_std(), {})
    for name, content in files.items():
        (FOLDER / name).write_bytes(content)


class Informed:
    """Flies the trained policy; it calls ``observe`` itself, as an evaluation does not."""

    def __init__(self) -> None:
        self.actor = load_policy(FOLDER)

    def begin(self, world: WorldBatch) -> None:
        """Prepare an episode; this policy needs nothing."""

    def act(self, world: WorldBatch) -> Actions:
        """The network's mean for every UAV's observation."""
        seen = observe(world)
        return self.actor.act(seen.reshape(-1, seen.shape[2])).reshape(*seen.shape[:2], 4)


if __name__ == "__main__":
    train()
