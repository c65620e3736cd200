"""The complete state of a training run: taken to be saved, and restored."""

import base64
import json
import random
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from orchid_uav.agents.maddpg.maddpg import MADDPG
from orchid_uav.agents.mappo.mappo import MAPPO
from orchid_uav.callbacks import EpisodeCallback
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.storage.tensors import Tensors, TensorSpec

_WORLDS = "worlds"


class TrainingState(NamedTuple):
    """The state of a run between two rollouts."""

    document: dict[str, Any]
    """The part that is written as JSON."""
    tensors: dict[str, Tensors]
    """Tensors by the name of the file that they are written to."""


class Training:
    """A learner, its worlds and its callbacks, whose state can be taken and restored.

    Args:
        model: the learner, built for ``env``.
        env: the worlds.
        callbacks: those that have a state, always in the same order.
    """

    def __init__(
        self, model: MAPPO | MADDPG, env: FleetVecEnv, callbacks: Sequence[EpisodeCallback]
    ) -> None:
        self.model = model
        self.env = env
        self.callbacks = callbacks

    def state(self) -> TrainingState:
        """The state between two rollouts.

        Raises:
            DivergedError: a weight is not a finite number.
        """
        learner, tensors = self.model.training_state()
        worlds, arrays = self.env.world.state()
        document = {
            "learner": learner,
            "worlds": worlds,
            "callbacks": [
                {"kind": type(callback).__name__, **callback.state()} for callback in self.callbacks
            ],
            "generators": _generators(self.model.device),
        }
        return TrainingState(document, {**tensors, _WORLDS: arrays})

    def specs(self, document: Mapping[str, Any]) -> dict[str, dict[str, TensorSpec]]:
        """Shapes and types of the tensors that belong to a document, by file and name."""
        _, arrays = self.env.world.state()
        worlds = {name: TensorSpec.of(array) for name, array in arrays.items()}
        return self.model.training_state_specs(document["learner"]) | {_WORLDS: worlds}

    def restore(self, state: TrainingState) -> None:
        """Take over a state that :meth:`state` of a training with the same configuration gave.

        Raises:
            LookupError, TypeError, ValueError: the state belongs to something else.
        """
        document, tensors = state
        self.model.restore_training_state(document["learner"], tensors)
        self.env.world.restore(document["worlds"], tensors[_WORLDS])
        for callback, remembered in zip(self.callbacks, document["callbacks"], strict=True):
            if remembered["kind"] != type(callback).__name__:
                raise ValueError(f"{remembered['kind']} instead of {type(callback).__name__}")
            callback.restore(remembered)
        rows = self.env.rows()
        self.model._last_obs = rows
        is_start = self.env.world.arrays.slot == 0
        self.model._last_episode_starts = np.repeat(is_start, self.env.agents_per_world)
        # Last, since the lines above may have drawn from them.
        _restore_generators(document["generators"], self.model.device)
        # A value that was missing or of another type shows here, as it reads back differently.
        for key, value in self.state().document.items():
            if _canonical(value) != _canonical(document[key]):
                raise ValueError(f"its '{key}' entry does not fit this run")


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _generators(device: torch.device) -> dict[str, Any]:
    name, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002 - libraries may draw from it
    version, words, following = random.getstate()
    states = {
        "torch": _text(torch.get_rng_state()),
        "numpy": [str(name), np.asarray(keys).tolist(), *rest],
        "python": [version, list(words), following],
    }
    if device.type == "cuda":
        states["cuda"] = _text(torch.cuda.get_rng_state(device))
    return states


def _restore_generators(states: Mapping[str, Any], device: torch.device) -> None:
    version, words, following = states["python"]
    random.setstate((version, tuple(words), following))
    name, keys, *rest = states["numpy"]
    if not 0 <= rest[0] <= len(keys):  # NumPy does not check this itself
        raise ValueError(f"{rest[0]} is not a position of NumPy's generator")
    np.random.set_state((name, np.array(keys, np.uint32), *rest))  # noqa: NPY002
    if device.type == "cuda":
        torch.cuda.set_rng_state(_tensor(states["cuda"]), device)
    torch.set_rng_state(_tensor(states["torch"]))


def _text(state: torch.Tensor) -> str:
    return base64.b64encode(state.cpu().numpy().tobytes()).decode()


def _tensor(text: str) -> torch.Tensor:
    return torch.from_numpy(np.frombuffer(base64.b64decode(text), np.uint8).copy())
