"""What happens while training."""

from orchid_uav.callbacks.episodes import EpisodeCallback
from orchid_uav.callbacks.reset_and_finetune import ResetAndFinetune
from orchid_uav.callbacks.schedules import ProgressSchedules

__all__ = ["EpisodeCallback", "ProgressSchedules", "ResetAndFinetune"]
