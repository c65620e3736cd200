"""A learner of your own on the PettingZoo interface: cross-entropy search over linear policies.

python examples/extending/pettingzoo_learner.py  # searches for minutes, writes ./linear.npy
orchid eval --method examples/extending/pettingzoo_learner.py:Linear --methods learned
"""

import numpy as np
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from orchid_uav.agents.controllers.controller import Actions
from orchid_uav.envs import WorldBatch, parallel_env

WEIGHTS = "linear.npy"
SHAPE = (17, 4)  # inputs: sixteen numbers and a constant; output: an action


def act(weights: NDArray[np.float64], seen: NDArray[np.float32]) -> NDArray[np.float64]:
    """Actions (..., 4) for observations (..., 16)."""
    return np.tanh(seen @ weights[:-1] + weights[-1])


def episode_reward(env: ParallelEnv, weights: NDArray[np.float64], seed: int) -> float:
    """Sum over an episode of the mean reward of all UAVs, which share the weights."""
    seen, _ = env.reset(seed=seed)
    total = 0.0
    while env.agents:
        seen, rewards, *_ = env.step({agent: act(weights, seen[agent]) for agent in env.agents})
        total += float(np.mean(list(rewards.values())))
    return total


def train(rounds: int = 50, candidates: int = 40, elite: int = 8, **world: int) -> None:
    """Draw candidates, keep the best, and draw the next ones around them."""
    env, generator = parallel_env(**world), np.random.default_rng(0)
    env.set_progress(1.0)  # reward weights as at the end of training
    mean, std = np.zeros(SHAPE), np.full(SHAPE, 0.5)
    for seed in range(rounds):
        drawn = mean + std * generator.standard_normal((candidates, *SHAPE))
        rewards = [episode_reward(env, weights, seed) for weights in drawn]
        best = drawn[np.argsort(rewards)[-elite:]]
        mean, std = best.mean(axis=0), best.std(axis=0) + 0.02
    np.save(WEIGHTS, mean)


class Linear:
    """Flies the policy that was found."""

    def begin(self, world: WorldBatch) -> None:
        """Read the weights."""
        self.weights = np.load(WEIGHTS, allow_pickle=False)

    def act(self, world: WorldBatch) -> Actions:
        """An action for every UAV's observation."""
        return act(self.weights, world.arrays.observations)


if __name__ == "__main__":
    train()
