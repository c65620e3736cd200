"""Schedules over training progress tau = finished episodes / all episodes (decision M9)."""

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback
from orchid_uav.envs.reward import linear_schedule


class _Schedule(EpisodeCallback):
    """Calls :meth:`_move_to` at the beginning of training and after every update.

    Args:
        episodes: number of episodes E_max over which progress grows from 0 to 1, where it stays.
    """

    def __init__(self, episodes: int) -> None:
        super().__init__()
        self.episodes = episodes

    def _on_training_start(self) -> None:
        self._apply(self.episodes_done)

    def _on_episodes(self, episodes: list[Episode]) -> None:
        self._apply(self.episodes_done + len(episodes))

    def _apply(self, episodes_done: int) -> None:
        self._move_to(min(episodes_done / self.episodes, 1.0))

    def _move_to(self, progress: float) -> None:
        raise NotImplementedError


class LearningRateDecay(_Schedule):
    """Lowers both learning rates linearly; a control for Reset-and-Finetune.

    List it before :class:`EpisodeLog`, which records the rates in force after an episode.

    Args:
        episodes: number of episodes E_max over which progress grows from 0 to 1.
        final_scale: factor on the learning rates at progress 1; at progress 0 it is 1.
    """

    def __init__(self, episodes: int, final_scale: float = 1.0) -> None:
        super().__init__(episodes)
        self.final_scale = final_scale

    def _move_to(self, progress: float) -> None:
        self.learner.scheduled_rate_scale = linear_schedule(1.0, self.final_scale, progress)


class ProgressSchedules(_Schedule):
    """Updates the environment's reward weights and the entropy coefficient.

    List it after :class:`EpisodeLog`, which records the coefficient that the update used.

    Args:
        episodes: number of episodes E_max over which progress grows from 0 to 1.
        entropy_coef: coefficient c_e at progress 0 and 1; None leaves the model's unchanged.
    """

    def __init__(
        self, episodes: int, entropy_coef: tuple[float, float] | None = (0.01, 0.0)
    ) -> None:
        super().__init__(episodes)
        self.entropy_coef = entropy_coef

    def _move_to(self, progress: float) -> None:
        self.training_env.env_method("set_progress", progress)
        if self.entropy_coef is not None:
            self.learner.ent_coef = linear_schedule(*self.entropy_coef, progress)
