"""What all learners share: the task, the budget, the settings, and how a policy is judged."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mpe2 import simple_spread_v3
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

AGENTS, STEPS, OBSERVATION, STATE, ACTIONS = 3, 25, 18, 54, 5
_FIRST_CURVE_SEED, _FIRST_FINAL_SEED = 1_000_000, 2_000_000

PPO_SETTINGS = ("epochs", "minibatch_frames", "gae_lambda", "clip_range", "entropy_coefficient")
MADDPG_SETTINGS = (
    *("buffer_frames", "updates_per_iteration", "batch_frames", "target_rate"),
    "exploration_std",
)
Policy = Callable[[NDArray[np.float32]], NDArray[np.floating[Any]]]
"""Deterministic actions (3, 5) in [0, 1] for observations (3, 18)."""


@dataclass(frozen=True)
class Settings:
    """The settings of every learner; a frame is one step of one world, with its three agents."""

    frames: int = 200_000
    worlds: int = 10
    frames_per_iteration: int = 2500
    hidden_sizes: tuple[int, ...] = (64, 64)
    learning_rate: float = 1e-3
    adam_epsilon: float = 1e-5
    gamma: float = 0.95
    max_grad_norm: float = 5.0
    # PPO
    epochs: int = 10
    minibatch_frames: int = 250
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    entropy_coefficient: float = 0.0
    # MADDPG
    buffer_frames: int = 1_000_000
    updates_per_iteration: int = 250
    batch_frames: int = 256
    target_rate: float = 0.01
    exploration_std: float = 0.2
    """The standard deviation for actions in [0, 1]."""
    # judging
    curve_points: int = 20
    curve_episodes: int = 32
    final_episodes: int = 256

    @property
    def curve_frames(self) -> list[int]:
        """Frames at which, or at the first opportunity after which, the policy is judged."""
        distance = self.frames // self.curve_points
        return [distance * (point + 1) for point in range(self.curve_points)]


def make_spread() -> ParallelEnv[str, Any, Any]:
    """simple_spread_v3 with three agents, continuous actions and episodes of 25 steps."""
    return simple_spread_v3.parallel_env(
        N=AGENTS, local_ratio=0.5, max_cycles=STEPS, continuous_actions=True
    )


def returns(policy: Policy, seeds: range) -> list[float]:
    """Return of one episode per seed, undiscounted, the mean over the agents."""
    env = make_spread()
    totals = []
    for seed in seeds:
        observations, _ = env.reset(seed=seed)
        total = 0.0
        while env.agents:
            agents = env.possible_agents
            actions = policy(np.stack([observations[agent] for agent in agents]))
            chosen = np.clip(actions, 0.0, 1.0).astype(np.float32)
            observations, rewards, *_ = env.step(dict(zip(agents, chosen, strict=True)))
            total += sum(rewards.values()) / AGENTS
        totals.append(total)
    return totals


def final_returns(policy: Policy, settings: Settings) -> list[float]:
    """Returns on the episodes that are compared."""
    return returns(policy, range(_FIRST_FINAL_SEED, _FIRST_FINAL_SEED + settings.final_episodes))


@dataclass
class Progress:
    """Judges a policy at regular numbers of frames, and measures the time of training."""

    settings: Settings
    curve: list[tuple[int, float]] = field(default_factory=list)
    """(frames, mean return)."""
    judging_s: float = 0.0
    _begun_s: float = field(default_factory=time.perf_counter)

    def due(self, frames: int) -> bool:
        """Whether the next point of the curve is reached."""
        points = len(self.curve)
        return points < self.settings.curve_points and frames >= self.settings.curve_frames[points]

    def judge(self, frames: int, policy: Policy) -> None:
        """Add a point to the curve."""
        begun_s = time.perf_counter()
        seeds = range(_FIRST_CURVE_SEED, _FIRST_CURVE_SEED + self.settings.curve_episodes)
        self.curve.append((frames, float(np.mean(returns(policy, seeds)))))
        self.judging_s += time.perf_counter() - begun_s

    @property
    def training_s(self) -> float:
        """Seconds of training so far, without judging."""
        return time.perf_counter() - self._begun_s - self.judging_s


@dataclass(frozen=True)
class Learned:
    """What a learner returns."""

    policy: Policy
    progress: Progress
    training_s: float
    versions: dict[str, str]
