"""Callbacks that act during training."""

from orchid_uav.callbacks.checkpoints import Checkpoints, StoppedError
from orchid_uav.callbacks.episode_log import EpisodeLog
from orchid_uav.callbacks.episodes import EpisodeCallback
from orchid_uav.callbacks.periodic import Periodic
from orchid_uav.callbacks.reset_and_finetune import ResetAndFinetune
from orchid_uav.callbacks.schedules import LearningRateDecay, ProgressSchedules
from orchid_uav.callbacks.update_variance import UpdateVariance

__all__ = [
    "Checkpoints",
    "EpisodeCallback",
    "EpisodeLog",
    "LearningRateDecay",
    "Periodic",
    "ProgressSchedules",
    "ResetAndFinetune",
    "StoppedError",
    "UpdateVariance",
]
