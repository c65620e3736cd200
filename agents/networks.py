"""What every learner's policy has in common: the local actor, and how networks begin."""

import math
import platform
from collections.abc import Iterable, Sequence
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import nn
from torch.nn import functional

HIDDEN_SIZES = (256, 256, 256)
"""Hidden layers of actor and critic (Section VI-A)."""

ADAM = {"eps": 1e-5, "fused": True}
"""Arguments of Adam for both networks (M31)."""
LAST_ACTOR_GAIN, LAST_CRITIC_GAIN = 0.01, 1.0
_ROWS_WORTH_PACKING = 128
"""Rows from which oneDNN's own layout of tensors repays the copies into it and back."""


@cache
def onednn_is_faster() -> bool:
    """Whether large products take less time in oneDNN than in MKL, of which torch has both.

    MKL, which torch uses by itself, does without AVX-512 on AMD's processors. The answer depends on
    the processor alone, so that a run has the same bits whenever it is repeated there.
    """
    return (
        torch.backends.mkldnn.is_available()
        and torch.backends.mkl.is_available()
        and torch.backends.cpu.get_cpu_capability() == "AVX512"
        and "AuthenticAMD" in _processor()
    )


def _processor() -> str:
    try:
        return Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:  # not Linux, or a container without it
        return platform.processor()


class Perceptron(nn.Sequential):
    """Linear layers with ReLU between them, applied with less overhead than ``Sequential`` has.

    A step of the rollout sends six rows through four small layers: calling seven modules for that
    takes a seventh of its time. Updates send hundreds, for which :func:`onednn_is_faster` decides.
    """

    def forward(self, rows: torch.Tensor) -> torch.Tensor:
        """Outputs (..., outputs) of inputs (..., inputs)."""
        is_packed = (
            rows.shape[:-1].numel() >= _ROWS_WORTH_PACKING
            and rows.is_cpu
            and rows.dtype == torch.float32
            and onednn_is_faster()
        )
        if is_packed:
            rows = rows.to_mkldnn()
        *hidden_layers, last = cast(list[nn.Linear], list(self)[::2])
        for layer in hidden_layers:
            rows = functional.linear(rows, layer.weight, layer.bias)
            rows = torch.relu(rows) if is_packed else rows.relu_()
        rows = functional.linear(rows, last.weight, last.bias)
        return rows.to_dense() if is_packed else rows


def perceptron(inputs: int, hidden_sizes: Sequence[int], outputs: int) -> Perceptron:
    """A multi-layer perceptron with ReLU between its layers."""
    layers: list[nn.Module] = []
    for size in hidden_sizes:
        layers += [nn.Linear(inputs, size), nn.ReLU(inplace=True)]
        inputs = size
    return Perceptron(*layers, nn.Linear(inputs, outputs))


def initialise_orthogonally(network: nn.Sequential, last_gain: float) -> None:
    """Orthogonal weights with gain sqrt(2), ``last_gain`` for the last layer; biases 0 (M31)."""
    network.apply(partial(BasePolicy.init_weights, gain=math.sqrt(2.0)))
    BasePolicy.init_weights(network[-1], gain=last_gain)


def check_spaces(observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> None:
    """Raise TypeError where centralised training of a local actor is not possible."""
    if not isinstance(observation_space, spaces.Dict) or not {"observation", "state"} <= set(
        observation_space.spaces
    ):
        raise TypeError(
            'the observation space is not a Dict with "observation" and "state": wrap the '
            "environment in orchid_uav.envs.CentralizedState"
        )
    if not isinstance(action_space, spaces.Box) or not action_space.is_bounded():
        raise TypeError(f"the action space is {action_space}, not a bounded Box")


class LocalActorPolicy(BasePolicy):
    """Mixin of policies whose attribute ``actor`` maps local observations to actions.

    The deterministic action is ``tanh(MLP(observation))`` in [-1, 1] (decision M20); boxes with
    other bounds are reached by :meth:`unscale_action`.
    """

    actor: nn.Sequential
    action_space: spaces.Box

    def make_optimizer(
        self,
        actor: Iterable[nn.Parameter],
        critic: Iterable[nn.Parameter],
        lr_schedule: Schedule,
    ) -> torch.optim.Optimizer:
        """One optimizer with the groups "actor" and "critic", which have rates of their own."""
        return self.optimizer_class(
            [{"params": list(actor), "name": "actor"}, {"params": list(critic), "name": "critic"}],
            lr=lr_schedule(1),  # type: ignore[call-arg]
            **self.optimizer_kwargs,
        )

    def action_mean(self, observation: torch.Tensor) -> torch.Tensor:
        """Deterministic action (rows, A) in [-1, 1] for local observations (rows, O)."""
        return torch.tanh(self.actor(observation))

    def unscale_action(self, scaled_action: np.ndarray) -> np.ndarray:
        """From [-1, 1], where samples beyond are clipped (M20), to the action space's bounds."""
        clipped = np.clip(scaled_action, -1.0, 1.0)
        return clipped if self._is_unit_box else super().unscale_action(clipped)

    @cached_property
    def _is_unit_box(self) -> bool:
        return bool((self.action_space.low == -1).all() and (self.action_space.high == 1).all())

    def actor_layers(self) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Copies of the actor's weights (out, in) and biases (out,), layer by layer."""
        return [
            (
                layer.weight.detach().cpu().numpy().copy(),
                layer.bias.detach().cpu().numpy().copy(),
            )
            for layer in self.actor
            if isinstance(layer, nn.Linear)
        ]
