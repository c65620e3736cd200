"""What happens while training."""

from orchid_uav.callbacks.episode_log import EpisodeLog
from orchid_uav.callbacks.episodes import EpisodeCallback
from orchid_uav.callbacks.reset_and_finetune import ResetAndFinetune
from orchid_uav.callbacks.schedules import ProgressSchedules
from orchid_uav.callbacks.stop import StopOnRequest

__all__ = [
    "EpisodeCallback",
    "EpisodeLog",
    "ProgressSchedules",
    "ResetAndFinetune",
    "StopOnRequest",
]
