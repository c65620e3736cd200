"""What both learners have in common besides SB3's base classes."""

from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.type_aliases import Schedule
from stable_baselines3.common.utils import FloatSchedule

Rows = dict[str, NDArray[np.float32]]
"""{"observation": (rows, O), "state": (rows, S)}."""


class CentralizedTraining(BaseAlgorithm):
    """Mixin: rows ordered world by world, two learning rates, a budget kept to the world.

    The policy has one optimizer with the parameter groups "actor" and "critic", in this order.
    """

    critic_learning_rate: float | Schedule
    learning_rate_scale: float = 1.0
    """Factor on both learning rates; Reset-and-Finetune lowers it."""
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
        return (
            self.lr_schedule(progress) * self.learning_rate_scale,
            self.critic_lr_schedule(progress) * self.learning_rate_scale,
        )

    @property
    def optimizers(self) -> list[torch.optim.Optimizer]:
        """All optimizers; Reset-and-Finetune clears their states."""
        return [self.policy.optimizer]

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

    def _last_rows(self) -> tuple[Rows, NDArray[np.bool_]]:
        """The latest observation, and which rows begin an episode with it."""
        return cast(Rows, self._last_obs), cast(NDArray[np.bool_], self._last_episode_starts)

    def _rows_within_budget(self, rows: int, steps: int) -> int:
        """Rows of as many worlds as have an episode of ``steps`` steps left to fly (M33)."""
        worlds_left = (self._total_timesteps - self.num_timesteps) / (steps * self.agents_per_world)
        return min(rows, max(1, int(np.ceil(worlds_left))) * self.agents_per_world)
