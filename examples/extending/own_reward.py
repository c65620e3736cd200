"""A reward term of your own: transmit power costs, so that the batteries of the radios last.

python examples/extending/own_reward.py          # trains for minutes, writes ./own_reward
orchid eval --method examples/extending/own_reward.py:Frugal --methods learned
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents import MAPPO, load_policy
from orchid_uav.agents.controllers.learned import Learned
from orchid_uav.agents.deployed_actor import policy_files
from orchid_uav.envs import WorldBatch, make_vec_env

FOLDER = Path("own_reward")
WEIGHT = 0.5


def radio_cost(world: WorldBatch) -> NDArray[np.float64]:
    """Added to every UAV's reward after each step, (B, N)."""
    return -WEIGHT * world.arrays.transmit_powers_w / world.parameters.uav.max_transmit_power_w


def train(episodes: int = 700, **world: int) -> None:
    """Train with unchanged MAPPO, without Reset-and-Finetune and schedules."""
    env = make_vec_env(extra_reward=radio_cost, **world)
    env.set_progress(1.0)  # reward weights as at the end of training
    slots = env.parameters.network.episode_slots
    model = MAPPO("CentralizedCriticPolicy", env, n_steps=slots, seed=0)
    model.learn(episodes * slots * env.num_envs)
    FOLDER.mkdir(exist_ok=True)
    files = policy_files(model.policy.actor_layers(), model.exploration_log_std(), {})
    for name, content in files.items():
        (FOLDER / name).write_bytes(content)


class Frugal(Learned):
    """Flies the trained policy; the worlds of an evaluation have the built-in reward."""

    def __init__(self) -> None:
        super().__init__(load_policy(FOLDER))


if __name__ == "__main__":
    train()
