"""How far the steps of an update scatter: Var(Δθ) of Section IV-D, as it is."""

from collections.abc import Mapping
from typing import Any

import torch

from orchid_uav.callbacks.episodes import Episode, EpisodeCallback


class UpdateVariance(EpisodeCallback):
    """Measures the variance of the actor's steps within each update.

    Δθ is what one step of the optimizer changes. Its variance is taken over the steps of one
    update (8 with the paper's numbers), for every weight by itself, so that a common direction
    does not count, and averaged over the weights. The paper expects that it falls to κ² of what it
    was when Reset-and-Finetune multiplies the learning rates by κ.

    It watches alone: training has the same bits with it and without it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.variances: list[float] = []
        """One an update."""
        self._steps = 0

    def state(self) -> dict[str, Any]:
        """The variances so far."""
        return super().state() | {"variances": self.variances}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over a state that :meth:`state` gave."""
        super().restore(state)
        self.variances = [float(variance) for variance in state["variances"]]

    def _on_training_start(self) -> None:
        policy: Any = self.model.policy
        self._weights = policy.actor_parameters()
        self._sums, self._squares = self._flat().zero_(), self._flat().zero_()
        policy.optimizer.register_step_pre_hook(self._remember)
        policy.optimizer.register_step_post_hook(self._add)

    def _flat(self) -> torch.Tensor:
        return torch.cat([weight.detach().flatten() for weight in self._weights]).double()

    def _remember(self, *_: Any) -> None:
        self._before = self._flat()

    def _add(self, *_: Any) -> None:
        step = self._flat() - self._before
        self._sums += step
        self._squares += step * step
        self._steps += 1

    def _on_episodes(self, episodes: list[Episode]) -> None:
        count = self._steps
        if count > 1:
            scatter = self._squares - self._sums**2 / count
            self.variances.append(float(scatter.mean()) / (count - 1))
        self._sums.zero_()
        self._squares.zero_()
        self._steps = 0
