"""Examples of what a teacher does: the newest are kept, in memory and in files that only grow."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from orchid_uav.storage.files import write_atomically
from orchid_uav.storage.tensors import TensorSpec, read_tensors

Halves = NDArray[np.float16]
"""Half precision: numbers of a few units at most, of which there are many."""


class Shard(NamedTuple):
    """The examples of one iteration, as a checkpoint names them."""

    iteration: int
    rows: int
    sha256: str


class Examples:
    """The newest examples, each an observation and the teacher's action for it.

    Args:
        capacity: number of examples that are kept.
        observation_size: numbers in an observation.
        action_size: numbers in an action.
    """

    def __init__(self, capacity: int, observation_size: int, action_size: int) -> None:
        self.capacity = capacity
        self.observations = np.zeros((capacity, observation_size), np.float16)
        self.actions = np.zeros((capacity, action_size), np.float16)
        self.total = 0
        """Examples that there have been."""
        self.shards: list[Shard] = []
        """Those of which examples are left, oldest first."""

    @property
    def count(self) -> int:
        """Examples that are kept."""
        return min(self.total, self.capacity)

    def add(
        self, iteration: int, observations: Halves, actions: Halves, folder: Path | None
    ) -> None:
        """Take the examples of an iteration, and write them to a file of their own.

        Args:
            iteration: its number.
            observations: (rows, O).
            actions: (rows, A).
            folder: of the files; None writes nothing.
        """
        checksum = ""
        if folder is not None:
            content = save({"observations": observations, "actions": actions})
            checksum = hashlib.sha256(content).hexdigest()
            folder.mkdir(parents=True, exist_ok=True)
            write_atomically(_file(folder, iteration), content)
        self._put(observations, actions)
        self.shards.append(Shard(iteration, len(actions), checksum))
        while sum(shard.rows for shard in self.shards[1:]) >= self.capacity:
            self.shards.pop(0)

    def _put(self, observations: Halves, actions: Halves) -> None:
        places = (self.total + np.arange(len(actions))) % self.capacity
        self.observations[places] = observations
        self.actions[places] = actions
        self.total += len(actions)

    def document(self) -> dict[str, Any]:
        """What a checkpoint has to say of the examples."""
        return {"total": self.total, "shards": [list(shard) for shard in self.shards]}

    def restore(self, document: Mapping[str, Any], folder: Path) -> None:
        """Read back what a checkpoint names.

        Raises:
            OSError: a file is missing.
            ValueError: a file is not the one that was written, or the numbers do not fit.
        """
        shards = [Shard(*map(_same, shard)) for shard in document["shards"]]
        rows = sum(shard.rows for shard in shards)
        if not 0 <= rows <= document["total"] or min(document["total"], self.capacity) > rows:
            raise ValueError(f"{rows} examples of {document['total']} are named")
        self.shards, self.total = shards, document["total"] - rows
        for shard in shards:
            specs = {
                "observations": TensorSpec(
                    (shard.rows, self.observations.shape[1]), np.dtype(np.float16)
                ),
                "actions": TensorSpec((shard.rows, self.actions.shape[1]), np.dtype(np.float16)),
            }
            tensors = read_tensors(_file(folder, shard.iteration), specs, shard.sha256)
            self._put(tensors["observations"], tensors["actions"])


def remove_shards(folder: Path, before: int = 0, after: float = np.inf) -> None:
    """Delete the files of iterations before one, and after another."""
    for path in folder.glob("*.safetensors"):
        if path.stem.isdigit() and not before <= int(path.stem) <= after:
            path.unlink(missing_ok=True)


def _file(folder: Path, iteration: int) -> Path:
    return folder / f"{iteration}.safetensors"


def _same(value: Sequence[Any]) -> Any:
    if not isinstance(value, int | str):
        raise ValueError(f"{value!r} names no shard of examples")
    return value
