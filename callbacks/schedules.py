"""What changes with training progress tau = episodes finished / episodes in all (decision M9)."""

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback
from orchid_uav.envs.reward import linear_schedule


class ProgressSchedules(EpisodeCallback):
    """Moves the environment's weights and the entropy coefficient on after every update.

    Args:
        episodes: episodes in all, E_max.
        entropy_coef: coefficient c_e at progress 0 and 1; None leaves the model's as it is.
    """

    def __init__(
        self, episodes: int, entropy_coef: tuple[float, float] | None = (0.01, 0.0)
    ) -> None:
        super().__init__()
        self.episodes = episodes
        self.entropy_coef = entropy_coef

    def _on_training_start(self) -> None:
        self._apply(self.episodes_done)

    def _on_episodes(self, episodes: list[Episode]) -> None:
        self._apply(self.episodes_done + len(episodes))

    def _apply(self, episodes_done: int) -> None:
        progress = min(episodes_done / self.episodes, 1.0)
        self.training_env.env_method("set_progress", progress)
        if self.entropy_coef is not None:
            self.learner.ent_coef = linear_schedule(*self.entropy_coef, progress)
