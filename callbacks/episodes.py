"""The base of callbacks that act once episodes have ended and the policy was updated on them."""

from collections.abc import Mapping
from typing import Any, Protocol, cast

from stable_baselines3.common.callbacks import BaseCallback

Episode = dict[str, float]
"""Metrics of one episode by their names: ``orchid_uav.envs.EPISODE_METRICS``, or ``Monitor``'s."""


class Learner(Protocol):
    """The part of a model that these callbacks use, beyond SB3's own interface."""

    ent_coef: float
    learning_rate_scale: float
    scheduled_rate_scale: float

    @property
    def learning_rates(self) -> tuple[float, float]:
        """The current learning rates of the actor and of the critic."""


class EpisodeCallback(BaseCallback):
    """Calls :meth:`_on_episodes` once after each update, with the episodes that it learned from.

    SB3 has no hook that follows an update; the start of the next rollout and the end of training
    are the first moments after it. Episodes are ordered by finishing time, then world (decision
    M33). Several such callbacks act in the order in which they are listed: Reset-and-Finetune
    before the log that records its resets, and the log before the schedules that change the
    coefficients it records.
    """

    def __init__(self, verbose: int = 0) -> None:
        super().__init__(verbose)
        self.episodes_done = 0
        self._finished: list[Episode] = []

    @property
    def learner(self) -> Learner:
        """The model, as :class:`Learner`."""
        return cast(Learner, self.model)

    def _on_episodes(self, episodes: list[Episode]) -> None:
        """Handle new episodes; ``episodes_done`` counts those before them."""
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """What the callback remembers between two updates, as JSON."""
        return {"episodes_done": self.episodes_done}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over a state that :meth:`state` gave."""
        self.episodes_done = int(state["episodes_done"])

    def _on_step(self) -> bool:
        dones = self.locals["dones"]
        if dones.any():
            infos: list[dict[str, Any]] = self.locals["infos"]
            rows_per_episode = getattr(self.model, "agents_per_world", 1)
            ended = [_metrics_of(info) for info in infos[::rows_per_episode]]
            self._finished += [metrics for metrics in ended if metrics]
        return True

    def _on_rollout_start(self) -> None:
        self._flush()

    def _on_training_end(self) -> None:
        self._flush()

    def _flush(self) -> None:
        if self._finished:
            episodes, self._finished = self._finished, []
            self._on_episodes(episodes)
            self.episodes_done += len(episodes)


def _metrics_of(info: Mapping[str, Any]) -> Episode:
    """What ``Monitor`` and this project's environments tell of an episode that has just ended."""
    return {**info.get("episode", {}), **info.get("episode_metrics", {})}
