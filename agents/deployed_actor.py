"""The actor as it is deployed: a file of weights, and NumPy to fly with it."""

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from safetensors.numpy import save

from orchid_uav.storage.documents import Document
from orchid_uav.storage.files import read_sealed, sealed
from orchid_uav.storage.tensors import TensorSpec, read_tensors

WEIGHTS_FILE = "policy.safetensors"
DESCRIPTION_FILE = "policy.json"
_MOST_LAYERS, _MOST_WEIGHTS = 64, 2**28
_LARGEST_OBSERVATION, _LARGEST_LOG_STD = 1e3, 100.0
"""Far beyond those that occur."""

Floats = NDArray[np.float32]

_ROWS_AT_ONCE = 256
"""Rows of one matrix product, so that what lies between two layers stays in the cache."""


class PolicyDescription(Document):
    """The content of ``policy.json``."""

    schema_version: Literal[1] = Field(alias="schema")
    kind: str
    layer_sizes: Annotated[
        list[Annotated[int, Field(gt=0, le=65536)]], Field(min_length=2, max_length=_MOST_LAYERS)
    ]
    """Sizes of the observation, of every hidden layer, and of the actions."""
    hidden_activation: Literal["relu"]
    output_activation: Literal["tanh"]
    run: str | None = None
    """The id of the run that it was learned in."""
    algorithm: str | None = None
    objective: str | None = None
    observation: str | None = None
    flight: str | None = None
    """What its actions move; None before there was a choice, which is direct flight."""
    episodes: int | None = None
    sha256: str
    """Checksum of the file of weights."""

    @model_validator(mode="after")
    def _check_size(self) -> Self:
        if sum(map(math.prod, itertools.pairwise(self.layer_sizes))) > _MOST_WEIGHTS:
            raise ValueError(f"layers of {self.layer_sizes} have too many weights")
        return self


class LocalActor:
    """tanh(MLP(observation)) with ReLU between layers: the deterministic, decentralised policy.

    Args:
        layers: (weight (out, in), bias (out,)) of every layer, in order.
        log_std: log standard deviation (A,) of the noise used in training.
        description: what ``policy.json`` says of it, where it comes from a file.
    """

    def __init__(
        self,
        layers: Sequence[tuple[Floats, Floats]],
        log_std: Floats,
        description: PolicyDescription | None = None,
    ) -> None:
        self._layers = [(np.ascontiguousarray(weight.T), bias) for weight, bias in layers]
        self.log_std = log_std
        self.description = description
        self.observation_size = self._layers[0][0].shape[0]
        self.action_size = self._layers[-1][0].shape[1]

    @property
    def layers(self) -> list[tuple[Floats, Floats]]:
        """(weight (out, in), bias (out,)) of every layer, in order."""
        return [(weight.T, bias) for weight, bias in self._layers]

    def act(self, observation: ArrayLike) -> Floats:
        """Actions (n, A) in [-1, 1] for local observations (n, O), n being any number of UAVs.

        Raises:
            ValueError: another shape, or a number that is not finite.
        """
        hidden = np.asarray(observation, dtype=np.float32)
        if hidden.ndim != 2 or hidden.shape[1] != self.observation_size:
            raise ValueError(
                f"observations have shape {hidden.shape}, not (UAVs, {self.observation_size})"
            )
        if not np.isfinite(hidden).all():
            raise ValueError("an observation is not a finite number")
        actions = np.empty((len(hidden), self.action_size), np.float32)
        for first in range(0, len(hidden), _ROWS_AT_ONCE):
            rows = slice(first, first + _ROWS_AT_ONCE)
            np.tanh(self._before_tanh(hidden[rows]), out=actions[rows])
        return actions

    def _before_tanh(self, hidden: Floats) -> Floats:
        for index, (weight, bias) in enumerate(self._layers):
            if index > 0:
                np.maximum(hidden, 0.0, out=hidden)
            hidden = hidden @ weight
            hidden += bias
        return hidden


def policy_files(
    layers: Sequence[tuple[Floats, Floats]], log_std: Floats, origin: Mapping[str, str | int]
) -> dict[str, bytes]:
    """Names and contents of the files that :func:`load_policy` reads.

    Args:
        layers: (weight (out, in), bias (out,)) of every layer, in order.
        log_std: log standard deviation (A,) of the noise used in training.
        origin: the run and its kind, by the names of fields of :class:`PolicyDescription`.
    """
    tensors = {"log_std": log_std}
    for index, (weight, bias) in enumerate(layers):
        tensors[f"actor.{index}.weight"] = np.ascontiguousarray(weight, dtype=np.float32)
        tensors[f"actor.{index}.bias"] = np.ascontiguousarray(bias, dtype=np.float32)
    weights = save(tensors)
    sizes = [layers[0][0].shape[1], *(len(bias) for _, bias in layers)]
    description = PolicyDescription.from_json(
        {
            "schema": 1,
            "kind": "actor",
            "layer_sizes": sizes,
            "hidden_activation": "relu",
            "output_activation": "tanh",
            **origin,
            "sha256": hashlib.sha256(weights).hexdigest(),
        }
    )
    description_text = json.dumps(sealed(description.to_json()), indent=2) + "\n"
    return {WEIGHTS_FILE: weights, DESCRIPTION_FILE: description_text.encode()}


def load_policy(path: str | Path) -> LocalActor:
    """The actor of a run directory or of a ``policy.safetensors``; nothing is unpickled.

    Raises:
        FileNotFoundError: a file is missing.
        ValueError: a file is damaged, or the two do not belong together.
    """
    weights_path = Path(path)
    if weights_path.is_dir():
        weights_path = weights_path / WEIGHTS_FILE
    description_path = weights_path.with_suffix(".json")
    for needed in (weights_path, description_path):
        if not needed.exists():
            raise FileNotFoundError(f"no such file: {needed}")
    description = _read_description(description_path)
    sizes = description.layer_sizes
    shapes: dict[str, tuple[int, ...]] = {"log_std": (sizes[-1],)}
    for index, (inputs, outputs) in enumerate(itertools.pairwise(sizes)):
        shapes[f"actor.{index}.weight"] = (outputs, inputs)
        shapes[f"actor.{index}.bias"] = (outputs,)
    specs = {name: TensorSpec(shape, np.dtype(np.float32)) for name, shape in shapes.items()}
    tensors = read_tensors(weights_path, specs, description.sha256)
    if not all(np.isfinite(tensor).all() for tensor in tensors.values()):
        raise ValueError(f"{weights_path} holds numbers that are not finite")
    layers = [
        (tensors[f"actor.{index}.weight"], tensors[f"actor.{index}.bias"])
        for index in range(len(sizes) - 1)
    ]
    if (
        _largest_output(layers) > float(np.finfo(np.float32).max)
        or tensors["log_std"].max() > _LARGEST_LOG_STD
    ):
        raise ValueError(f"{weights_path} holds numbers so large that actions overflow")
    return LocalActor(layers, tensors["log_std"], description)


def _largest_output(layers: Sequence[tuple[Floats, Floats]]) -> float:
    """An upper bound of every number inside the network, in whatever order sums are taken."""
    bound = _LARGEST_OBSERVATION
    for weight, bias in layers:
        bound = float((np.abs(weight).sum(axis=1, dtype=float) * bound + np.abs(bias)).max())
    return bound


def _read_description(path: Path) -> PolicyDescription:
    document = read_sealed(path)
    try:
        return PolicyDescription.from_json(document)
    except ValueError as error:
        raise ValueError(f"{path} describes no policy as is known here: {error}") from error
