"""Callbacks that act during training."""

from orchid_uav.callbacks.checkpoints import Checkpoints, StoppedError
from orchid_uav.callbacks.episode_log import EpisodeLog
from orchid_uav.callbacks.episodes import EpisodeCallback
from orchid_uav.callbacks.reset_and_finetune import ResetAndFinetune
from orchid_uav.callbacks.schedules import LearningRateDecay, ProgressSchedules

__all__ = [
    "Checkpoints",
    "EpisodeCallback",
    "EpisodeLog",
    "LearningRateDecay",
    "ProgressSchedules",
    "ResetAndFinetune",
    "StoppedError",
]
