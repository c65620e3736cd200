"""What changes with training progress tau = episodes finished / episodes in all (decision M9)."""

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback
from orchid_uav.envs.reward import linear_schedule


class ProgressSchedules(EpisodeCallback):
    """Moves the environment's weights, the entropy coefficient and the rates on after every update.

    Args:
        episodes: episodes in all, E_max; after them everything stays as it is then.
        entropy_coef: coefficient c_e at progress 0 and 1; None leaves the model's as it is.
        final_learning_rate_scale: factor on the learning rates at progress 1, from 1 at 0.
    """

    def __init__(
        self,
        episodes: int,
        entropy_coef: tuple[float, float] | None = (0.01, 0.0),
        final_learning_rate_scale: float = 1.0,
    ) -> None:
        super().__init__()
        self.episodes = episodes
        self.entropy_coef = entropy_coef
        self.final_learning_rate_scale = final_learning_rate_scale

    def _on_training_start(self) -> None:
        self._apply(self.episodes_done)

    def _on_episodes(self, episodes: list[Episode]) -> None:
        self._apply(self.episodes_done + len(episodes))

    def _apply(self, episodes_done: int) -> None:
        progress = min(episodes_done / self.episodes, 1.0)
        self.training_env.env_method("set_progress", progress)
        if self.entropy_coef is not None:
            self.learner.ent_coef = linear_schedule(*self.entropy_coef, progress)
        self.learner.scheduled_rate_scale = linear_schedule(
            1.0, self.final_learning_rate_scale, progress
        )
