"""Optimizers and learning rates of any Stable-Baselines3 model."""

from collections.abc import Callable, Collection
from operator import attrgetter

import torch
from stable_baselines3.common.base_class import BaseAlgorithm


def optimizers_of(
    model: BaseAlgorithm, names: Collection[str] | None = None
) -> list[torch.optim.Optimizer]:
    """The optimizers of a model, or those of them that are named.

    A model lists them itself, as what has to be saved with it. The names are: ``"policy"`` for
    PPO, A2C, DQN and their like; ``"actor"``, ``"critic"`` and, where the temperature is learned,
    ``"ent_coef"`` for SAC, TD3, DDPG and theirs.

    Raises:
        ValueError: a name that the model does not have, or a model without any optimizer.
    """
    found = {}
    for saved in model._get_torch_save_params()[0]:
        part = attrgetter(saved)(model)
        if isinstance(part, torch.optim.Optimizer):
            found[saved.removesuffix("optimizer").rstrip("._")] = part
    if not found:
        raise ValueError(f"{type(model).__name__} has no optimizer that could be reset")
    unknown = [name for name in names or () if name not in found]
    if unknown:
        raise ValueError(
            f"{type(model).__name__} has no optimizer '{unknown[0]}': it has {', '.join(found)}"
        )
    return [found[name] for name in (found if names is None else names)]


class ScaledSchedule:
    """A schedule of a learning rate, times a factor that can change.

    Stable-Baselines3 asks ``lr_schedule`` anew at each update and gives all parameter groups what
    it says, so that a rate written into a group alone would be lost.
    """

    def __init__(self, schedule: Callable[[float], float]) -> None:
        self.schedule = schedule
        self.scale = 1.0

    def __call__(self, progress_remaining: float) -> float:
        """The learning rate in force, for the share of training that is left."""
        return self.scale * self.schedule(progress_remaining)


def set_rate_scale(model: BaseAlgorithm, scale: float) -> None:
    """Multiply a model's learning rates by a factor, from its next update on.

    Models of this project have a factor of their own, which their checkpoints keep. That of any
    other model is lost when it is saved and loaded: whoever set it has to set it again.
    """
    if hasattr(model, "learning_rate_scale"):
        model.learning_rate_scale = scale
        return
    if not isinstance(model.lr_schedule, ScaledSchedule):
        model.lr_schedule = ScaledSchedule(model.lr_schedule)
    model.lr_schedule.scale = scale


def rate_scale_of(model: BaseAlgorithm) -> float:
    """The factor that :func:`set_rate_scale` has set, 1 before."""
    if hasattr(model, "learning_rate_scale"):
        return float(model.learning_rate_scale)
    return model.lr_schedule.scale if isinstance(model.lr_schedule, ScaledSchedule) else 1.0
