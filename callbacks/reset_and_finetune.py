"""Reset-and-Finetune: on a plateau, clear the optimizer and lower the rates (Section IV-D)."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import torch

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback
from orchid_uav.callbacks.learning_rates import optimizers_of, rate_scale_of, set_rate_scale

_SMALLEST_DENOMINATOR = 1e-8
LOWEST_RATE_SCALE = 0.01
"""No learning rate falls below this fraction of its first value (decision M22)."""


def relative_change(series: Sequence[float], window: int) -> float:
    """Relative change from the mean of the window before to that of the last ``window`` numbers.

    It is |new - old| / max(|old|, 1e-8) (decision M21), which is defined for negative and zero
    means as well.
    """
    new = sum(series[-window:]) / window
    old = sum(series[-2 * window : -window]) / window
    return abs(new - old) / max(abs(old), _SMALLEST_DENOMINATOR)


def has_plateaued(
    series: Mapping[str, Sequence[float]], window: int, tolerances: Mapping[str, float]
) -> bool:
    """The fused trigger: every metric changed by less than its tolerance.

    False before two windows are full.

    Args:
        series: a metric's values, one an episode, by its name.
        window: W, episodes per window.
        tolerances: epsilon_tol of each metric that is watched, by its name.
    """
    return all(
        len(series[name]) >= 2 * window and relative_change(series[name], window) < tolerance
        for name, tolerance in tolerances.items()
    )


def reset_optimizer(optimizer: torch.optim.Optimizer) -> None:
    """Forget Adam's moments *and* its step count; weights and learning rates stay (decision M23).

    Zeroing the moments alone leaves the bias correction of a long run in force, which makes the
    first steps several times too large.
    """
    optimizer.state.clear()


class ResetAndFinetune(EpisodeCallback):
    """Watches metrics of the episodes and intervenes when all of them plateau.

    In ORCHID these are J_e (rate JFI) and U_e (reward). With ``tolerances`` it watches whatever
    else an episode has, and works with every Stable-Baselines3 model that has an optimizer: PPO,
    A2C, DQN, SAC, TD3, sb3-contrib's. Episodes count from 1. The order at an episode's end is:
    update, windows, reset (decision M21).

    A model that is saved and loaded by Stable-Baselines3 begins at its first learning rates again.
    :meth:`state`, kept beside it, and :meth:`restore` bring the lower ones back.

    Args:
        window: W, episodes per window.
        tolerance_jfi: epsilon_tol of the rate JFI.
        tolerance_reward: epsilon_tol of the reward.
        kappa: factor on all learning rates at a reset (decision M1).
        max_resets: interventions at most; each needs 2W fresh episodes (decision M22).
        at_episodes: acts after these episodes instead, whatever the windows say (a control).
        clear_optimizer: whether a reset clears the optimizers; without, a control, it lowers the
            rates alone.
        tolerances: the metrics to watch instead of the two, with a tolerance for each. A name is
            a key of ``info["episode_metrics"]`` (this project's environments) or of
            ``info["episode"]`` (``Monitor``: ``"r"`` the return, ``"l"`` the length, and its
            ``info_keywords``), or, with a slash, a value of the model's logger, such as
            ``"train/value_loss"``: what the update behind an episode recorded.
        optimizers: the optimizers that a reset clears, see :func:`optimizers_of`; by default all.

    Raises:
        ValueError: an argument outside its range; at the beginning of training, a model without
            these optimizers; at the end of an episode, a metric that it does not have.
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
        tolerances: Mapping[str, float] | None = None,
        optimizers: Collection[str] | None = None,
    ) -> None:
        super().__init__(verbose)
        if window < 1 or max_resets < 1:
            raise ValueError(f"window is {window} and max_resets {max_resets}: both are at least 1")
        if not 0.0 < kappa <= 1.0:
            raise ValueError(f"kappa is {kappa}: it lies in (0, 1]")
        if tolerances is None:
            tolerances = {"rate_jfi": tolerance_jfi, "reward": tolerance_reward}
        if not tolerances:
            raise ValueError("tolerances names no metric: at least one has to be watched")
        for name, tolerance in tolerances.items():
            if not tolerance > 0.0:
                raise ValueError(f"the tolerance of {name} is {tolerance}: it is above 0")
        self.window = window
        self.tolerances = dict(tolerances)
        self.kappa = kappa
        self.max_resets = max_resets
        self.at_episodes = at_episodes
        self.clear_optimizer = clear_optimizer
        self.optimizers = optimizers
        self.reset_episodes: list[int] = []
        self._windows: dict[str, list[float]] = {name: [] for name in tolerances}

    def state(self) -> dict[str, Any]:
        """The windows, and the episodes of the resets."""
        return super().state() | {"windows": self._windows, "reset_episodes": self.reset_episodes}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over a state that :meth:`state` gave.

        Raises:
            KeyError: the state has not the metrics that are watched.
        """
        super().restore(state)
        windows = state.get("windows", state)  # which lay in the state itself at first
        self._windows = {
            name: [float(value) for value in windows[name]] for name in self.tolerances
        }
        self.reset_episodes = [int(episode) for episode in state["reset_episodes"]]

    def _on_training_start(self) -> None:
        optimizers_of(self.model, self.optimizers)
        if self.reset_episodes and rate_scale_of(self.model) == 1.0:
            set_rate_scale(self.model, self._rate_scale_after(len(self.reset_episodes)))

    def _rate_scale_after(self, resets: int) -> float:
        scale = 1.0
        for _ in range(resets):
            scale = max(scale * self.kappa, LOWEST_RATE_SCALE)
        return scale

    def _on_episodes(self, episodes: list[Episode]) -> None:
        for number, episode in enumerate(episodes, start=self.episodes_done + 1):
            values = self._watched(episode)
            if values is None:
                continue
            for name, value in values.items():
                self._windows[name].append(value)
            if len(self.reset_episodes) < self.max_resets and self._is_due(number):
                self._intervene(number)

    def _watched(self, episode: Episode) -> dict[str, float] | None:
        """The episode's values of the metrics; None before the logger knows all that it is asked.

        Some algorithms collect episodes before their first update.
        """
        known = dict(episode)
        for name in self.tolerances:
            if "/" in name:
                if name not in self.logger.name_to_value:
                    return None
                known[name] = self.logger.name_to_value[name]
            if name not in known:
                raise ValueError(f"an episode has no metric '{name}': it has {', '.join(episode)}")
        return {name: float(known[name]) for name in self.tolerances}

    def _is_due(self, episode: int) -> bool:
        if self.at_episodes is not None:
            return episode in self.at_episodes
        return has_plateaued(self._windows, self.window, self.tolerances)

    def _intervene(self, episode: int) -> None:
        if self.clear_optimizer:
            for optimizer in optimizers_of(self.model, self.optimizers):
                reset_optimizer(optimizer)
        scale = rate_scale_of(self.model) * self.kappa
        set_rate_scale(self.model, max(scale, LOWEST_RATE_SCALE))
        self.reset_episodes.append(episode)
        for values in self._windows.values():
            values.clear()
