"""Reset-and-Finetune: on a plateau, clear the optimizer and lower the rates (Section IV-D)."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import torch

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback

_SMALLEST_DENOMINATOR = 1e-8
LOWEST_RATE_SCALE = 0.01
"""No learning rate falls below this fraction of its first value (decision M22)."""


def relative_change(series: Sequence[float], window: int) -> float:
    """Change of the mean over the last ``window`` numbers against that over the window before.

    |new - old| / max(|old|, 1e-8) (decision M21), so it is defined for negative and zero means.
    """
    new = sum(series[-window:]) / window
    old = sum(series[-2 * window : -window]) / window
    return abs(new - old) / max(abs(old), _SMALLEST_DENOMINATOR)


def has_plateaued(
    jfi: Sequence[float],
    reward: Sequence[float],
    window: int,
    tolerance_jfi: float,
    tolerance_reward: float,
) -> bool:
    """The fused trigger: both J_e and U_e changed by less than their tolerance.

    False before two windows are full.
    """
    if min(len(jfi), len(reward)) < 2 * window:
        return False
    return (
        relative_change(jfi, window) < tolerance_jfi
        and relative_change(reward, window) < tolerance_reward
    )


def reset_optimizer(optimizer: torch.optim.Optimizer) -> None:
    """Forget Adam's moments *and* its step count; weights and learning rates stay (decision M23).

    Zeroing the moments alone leaves the bias correction of a long run in force, which makes the
    first steps several times too large.
    """
    optimizer.state.clear()


class ResetAndFinetune(EpisodeCallback):
    """Watches J_e (rate JFI) and U_e (reward) and intervenes when both plateau.

    For models with ``optimizers`` and ``learning_rate_scale``, such as
    :class:`orchid_uav.agents.MAPPO`. Episodes count from 1. Order at an episode's end: update,
    windows, reset (decision M21).

    Args:
        window: W, episodes per window.
        tolerance_jfi: epsilon_tol of the rate JFI.
        tolerance_reward: epsilon_tol of the reward.
        kappa: factor on both learning rates at a reset (decision M1).
        max_resets: interventions at most; each needs 2W fresh episodes (decision M22).
        at_episodes: acts after these episodes instead, whatever the windows say (a control).
        clear_optimizer: whether a reset clears the optimizer; without, a control, it lowers the
            rates alone.
    """

    def __init__(
        self,
        window: int = 50,
        tolerance_jfi: float = 0.05,
        tolerance_reward: float = 0.05,
        kappa: float = 0.5,
        max_resets: int = 1,
        at_episodes: Collection[int] | None = None,
        clear_optimizer: bool = True,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        if window < 1 or max_resets < 1:
            raise ValueError(f"window is {window} and max_resets {max_resets}: both are at least 1")
        if not 0.0 < kappa <= 1.0:
            raise ValueError(f"kappa is {kappa}: it lies in (0, 1]")
        if not (tolerance_jfi > 0.0 and tolerance_reward > 0.0):
            raise ValueError(
                f"tolerances are {tolerance_jfi} and {tolerance_reward}: both are above 0"
            )
        self.window = window
        self.tolerance_jfi = tolerance_jfi
        self.tolerance_reward = tolerance_reward
        self.kappa = kappa
        self.max_resets = max_resets
        self.at_episodes = at_episodes
        self.clear_optimizer = clear_optimizer
        self.reset_episodes: list[int] = []
        self._jfi: list[float] = []
        self._reward: list[float] = []

    def state(self) -> dict[str, Any]:
        """The windows, and the episodes of the resets."""
        return super().state() | {
            "rate_jfi": self._jfi,
            "reward": self._reward,
            "reset_episodes": self.reset_episodes,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Be as the callback that :meth:`state` was asked of."""
        super().restore(state)
        self._jfi = [float(value) for value in state["rate_jfi"]]
        self._reward = [float(value) for value in state["reward"]]
        self.reset_episodes = [int(episode) for episode in state["reset_episodes"]]

    def _on_episodes(self, episodes: list[Episode]) -> None:
        for number, episode in enumerate(episodes, start=self.episodes_done + 1):
            self._jfi.append(episode["rate_jfi"])
            self._reward.append(episode["reward"])
            if len(self.reset_episodes) < self.max_resets and self._is_due(number):
                self._intervene(number)

    def _is_due(self, episode: int) -> bool:
        if self.at_episodes is not None:
            return episode in self.at_episodes
        return has_plateaued(
            self._jfi, self._reward, self.window, self.tolerance_jfi, self.tolerance_reward
        )

    def _intervene(self, episode: int) -> None:
        if self.clear_optimizer:
            for optimizer in self.learner.optimizers:
                reset_optimizer(optimizer)
        scale = self.learner.learning_rate_scale * self.kappa
        self.learner.learning_rate_scale = max(scale, LOWEST_RATE_SCALE)
        self.reset_episodes.append(episode)
        self._jfi.clear()
        self._reward.clear()
