"""One row of metrics per episode, handed to a sink."""

from collections.abc import Callable, Sequence

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback
from orchid_uav.callbacks.reset_and_finetune import ResetAndFinetune

Row = dict[str, float]


class EpisodeLog(EpisodeCallback):
    """Passes the rows of ``episodes.csv`` to a sink after each update.

    A row holds the episode's number (from 1) and metrics, the learning rates in force after it,
    the entropy coefficient of the update on it, and whether it triggered a reset. List this
    callback after ``reset_and_finetune`` and before :class:`ProgressSchedules`.

    Args:
        sink: called with the new rows.
        reset_and_finetune: the callback whose resets are recorded, if there is one.
    """

    def __init__(
        self,
        sink: Callable[[Sequence[Row]], None],
        reset_and_finetune: ResetAndFinetune | None = None,
    ) -> None:
        super().__init__()
        self._sink = sink
        self._reset_and_finetune = reset_and_finetune

    def _on_episodes(self, episodes: list[Episode]) -> None:
        actor_rate, critic_rate = self.learner.learning_rates
        resets = self._reset_and_finetune.reset_episodes if self._reset_and_finetune else []
        self._sink(
            [
                {
                    "episode": number,
                    **episode,
                    "actor_lr": actor_rate,
                    "critic_lr": critic_rate,
                    "entropy_coef": self.learner.ent_coef,
                    "reset": int(number in resets),
                }
                for number, episode in enumerate(episodes, start=self.episodes_done + 1)
            ]
        )
