"""Calls a function every few episodes."""

from collections.abc import Callable, Mapping
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback


class Periodic(EpisodeCallback):
    """Calls a function after every so many episodes, and keeps what it answers.

    With several worlds an update may pass more than one multiple; the function is then called once,
    for the last of them.

    Args:
        every: episodes from one call to the next.
        measure: given the model, and how many episodes it has learned from; gives what JSON can
            hold.

    Raises:
        ValueError: ``every`` is less than 1.
    """

    def __init__(self, every: int, measure: Callable[[BaseAlgorithm, int], Any]) -> None:
        super().__init__()
        if every < 1:
            raise ValueError(f"every {every} episodes: give 1 or more")
        self.every = every
        self.answers: dict[int, Any] = {}
        """The answers, by the number of episodes."""
        self._measure = measure

    def state(self) -> dict[str, Any]:
        """The answers so far."""
        answers = {str(episode): answer for episode, answer in self.answers.items()}
        return super().state() | {"answers": answers}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over a state that :meth:`state` gave."""
        super().restore(state)
        self.answers = {int(episode): answer for episode, answer in state["answers"].items()}

    def _on_episodes(self, episodes: list[Episode]) -> None:
        before = self.episodes_done
        done = before + len(episodes)
        if done // self.every > before // self.every:
            self.answers[done] = self._measure(self.model, done)
