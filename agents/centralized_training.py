"""What both learners have in common besides SB3's base classes."""

import math
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.utils import FloatSchedule

from orchid_uav.agents.learner_state import (
    MOMENTS,
    OPTIMIZER,
    WEIGHTS,
    DivergedError,
    moments_of,
    restore,
    specs_of,
    weights_of,
)
from orchid_uav.storage.tensors import Tensors, TensorSpec

Rows = dict[str, NDArray[np.float32]]
"""{"observation": (rows, O), "state": (rows, S)}."""


_COUNTERS: dict[str, type] = {
    "num_timesteps": int,
    "_n_updates": int,
    "_episode_num": int,
    "_current_progress_remaining": float,
    "learning_rate_scale": float,
    "scheduled_rate_scale": float,
    "ent_coef": float,
    "reward_mean": float,
    "_steps_averaged": int,
}
_STEPS_OF_MEAN = 10_000
"""Steps over which rewards are averaged where they are centred: 50 episodes of the paper's."""


class CentralizedTraining(BaseAlgorithm):
    """Mixin: rows ordered world by world, two learning rates, a budget kept to the world.

    The policy has one optimizer with the parameter groups "actor" and "critic", in this order.
    """

    critic_learning_rate: float | Schedule
    learning_rate_scale: float = 1.0
    """Factor on both learning rates; Reset-and-Finetune lowers it."""
    scheduled_rate_scale: float = 1.0
    """Another one, which follows training progress."""
    center_rewards: bool = False
    """Whether learning sees rewards less their running mean."""
    reward_mean: float = 0.0
    """Mean over the latest steps of the agents' mean reward, if rewards are centred."""
    _steps_averaged: int = 0
    agents_per_world: int

    def _find_agents_per_world(self) -> None:
        # A model that is loaded without an environment keeps the number that it was saved with.
        self.agents_per_world = getattr(self, "agents_per_world", 1)
        if self.env is not None and self.env.has_attr("agents_per_world"):
            self.agents_per_world = int(self.env.get_attr("agents_per_world", [0])[0])

    def _setup_lr_schedule(self) -> None:
        super()._setup_lr_schedule()
        self.critic_lr_schedule = FloatSchedule(self.critic_learning_rate)

    @property
    def learning_rates(self) -> tuple[float, float]:
        """The actor's and the critic's learning rates in force."""
        progress = self._current_progress_remaining
        scale = self.learning_rate_scale * self.scheduled_rate_scale
        return self.lr_schedule(progress) * scale, self.critic_lr_schedule(progress) * scale

    def _update_learning_rate(
        self, optimizers: list[torch.optim.Optimizer] | torch.optim.Optimizer
    ) -> None:
        """Give each parameter group its own rate; SB3 would give all of them the first one."""
        for group, rate in zip(
            self.policy.optimizer.param_groups, self.learning_rates, strict=True
        ):
            group["lr"] = rate

    def _log_learning_rates(self) -> None:
        for group in self.policy.optimizer.param_groups:
            self.logger.record(f"train/{group['name']}_learning_rate", group["lr"])

    def _average_rewards(self, rewards: NDArray[np.float32]) -> None:
        """Move the running mean by steps (T, rows) of rewards, in their order (M37).

        A plain mean of the first ``_STEPS_OF_MEAN`` steps, then one that forgets at that pace, as
        the weights of the reward change in the course of a training.
        """
        for reward in rewards.mean(axis=1, dtype=np.float64).tolist():
            self._steps_averaged += 1
            share = 1.0 / min(self._steps_averaged, _STEPS_OF_MEAN)
            self.reward_mean += share * (reward - self.reward_mean)

    def _check_ends(self, by_itself: bool) -> None:
        """Raise ValueError if an episode ended by itself where that would change the task.

        Without a time limit's bootstrapping, what is taken off every reward would make the
        length of an episode worth something.
        """
        if by_itself and self.center_rewards:
            raise ValueError(
                "an episode ended by itself, not by its time limit: center_rewards would change "
                "what is learned"
            )

    def _log_values(self, mean: float) -> None:
        """Record the level of the values, which grows where learning drifts away."""
        self.logger.record("train/mean_value", mean)
        if self.center_rewards:
            self.logger.record("train/reward_mean", self.reward_mean)

    def _check_losses(self, metrics: Mapping[str, float]) -> None:
        """Raise DivergedError if one of an update's metrics is not a finite number."""
        for name, metric in metrics.items():
            if not math.isfinite(metric):
                raise DivergedError(f"update {self._n_updates}: {name} is {metric}")

    def _check_actions(self, actions: NDArray[np.float32]) -> None:
        """Raise DivergedError if the policy gives actions that are not finite numbers."""
        if not np.isfinite(actions).all():
            raise DivergedError(f"after update {self._n_updates}: an action is not a finite number")

    def _last_rows(self) -> tuple[Rows, NDArray[np.bool_]]:
        """The latest observation, and which rows begin an episode with it."""
        rows = single_precision(cast(Rows, self._last_obs))
        return rows, cast(NDArray[np.bool_], self._last_episode_starts)

    def _rows_within_budget(self, rows: int, steps: int) -> int:
        """Rows of as many worlds as have an episode of ``steps`` steps left to fly (M33)."""
        worlds_left = (self._total_timesteps - self.num_timesteps) / (steps * self.agents_per_world)
        return min(rows, max(1, int(np.ceil(worlds_left))) * self.agents_per_world)

    # What a learner has to remember between two rollouts, for a run that goes on later. The
    # generators of torch, which all of its random numbers come from, belong to the process.

    def training_state(self) -> tuple[dict[str, Any], dict[str, Tensors]]:
        """Counters, and tensors by the name of the file that they belong in.

        Raises:
            DivergedError: a weight is not a finite number.
        """
        weights = weights_of(self.policy, f"after update {self._n_updates}")
        document: dict[str, Any] = {
            name: kind(getattr(self, name))
            for name, kind in _COUNTERS.items()
            if hasattr(self, name)
        }
        optimizer, optimized = self.policy.optimizer, self._optimized()
        document[OPTIMIZER] = {
            str(index): sorted(optimizer.state[parameter])
            for index, parameter in enumerate(optimized)
            if parameter in optimizer.state
        }
        return document, {WEIGHTS: weights, OPTIMIZER: moments_of(optimizer, optimized)}

    def training_state_specs(self, document: Mapping[str, Any]) -> dict[str, dict[str, TensorSpec]]:
        """Shapes and types of the tensors that belong to counters of :meth:`training_state`."""
        optimized = self._optimized()
        for index, names in document[OPTIMIZER].items():
            if names != MOMENTS or index not in map(str, range(len(optimized))):
                raise ValueError(f"Adam has no {names!r} of parameter {index!r}")
        return specs_of(self.policy, optimized, map(int, document[OPTIMIZER]))

    def restore_training_state(
        self, document: Mapping[str, Any], tensors: Mapping[str, Tensors]
    ) -> None:
        """Take over a state that :meth:`training_state` gave."""
        for name, kind in _COUNTERS.items():
            if name in document:
                setattr(self, name, kind(document[name]))
        restore(self.policy, self.policy.optimizer, self._optimized(), tensors)

    def _optimized(self) -> list[torch.nn.Parameter]:
        return [
            parameter
            for group in self.policy.optimizer.param_groups
            for parameter in group["params"]
        ]


def single_precision(rows: Mapping[str, NDArray[Any]]) -> Rows:
    """Rows of any numbers as float32, in which networks and buffers hold them."""
    return {key: np.asarray(values, np.float32) for key, values in rows.items()}
