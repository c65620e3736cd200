"""When the state of a run is saved, and stopping so that nothing is lost."""

from collections.abc import Callable

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback


class StoppedError(Exception):
    """Ends ``learn`` between two rollouts: a slot more could end an episode without its update."""


class Checkpoints(EpisodeCallback):
    """Has the state saved every few episodes, at the end, and when a stop is asked for.

    Always between two rollouts: the update on the last one is done and the buffer is empty, so the
    state is small and whole. A stop that is asked for follows the update that the rollout in
    progress leads to, as a :class:`StoppedError`. List it last, so that all other callbacks have
    acted.

    Args:
        every: episodes from one save to the next.
        save: saves the state, given how many episodes are done.
        is_stop_requested: whether training is to end.
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
