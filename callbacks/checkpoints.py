"""Decides when a run's state is saved, and stops a run so that nothing is lost."""

from collections.abc import Callable

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback


class StoppedError(Exception):
    """Ends ``learn`` between two rollouts.

    One more slot could end an episode that is then never followed by its update.
    """


class Checkpoints(EpisodeCallback):
    """Saves the state every few episodes, at the end, and when a stop is requested.

    It always saves between two rollouts: the update on the last rollout is done and the buffer is
    empty, so the state is small and complete. When a stop is requested, the rollout in progress
    and its update are finished first; then :class:`StoppedError` is raised. List this callback
    last, so that all others have acted before it saves.

    Args:
        every: episodes from one save to the next.
        save: saves the state, given how many episodes are done.
        is_stop_requested: tells whether training is to stop.
    """

    def __init__(
        self,
        every: int,
        save: Callable[[int], None],
        is_stop_requested: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__()
        self.every = every
        self._save = save
        self._is_stop_requested = is_stop_requested
        self._is_due = False

    def _on_episodes(self, episodes: list[Episode]) -> None:
        done = self.episodes_done
        self._is_due = (done + len(episodes)) // self.every > done // self.every

    def _on_rollout_start(self) -> None:
        super()._on_rollout_start()
        is_stopping = self._is_stop_requested()
        if self._is_due or is_stopping:
            self._is_due = False
            self._save(self.episodes_done)
        if is_stopping:
            raise StoppedError

    def _on_training_end(self) -> None:
        super()._on_training_end()
        self._save(self.episodes_done)
