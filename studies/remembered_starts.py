"""A training of ``orchid reproduce`` that remembers balanced starts for others with its seed.

``python -m studies.remembered_starts ORDER MEMORY`` makes the row that the order asks for, a JSON
file which ``experiments/reproduction/job.py`` reads. Variants of a method with one seed draw the
same topologies, and :func:`balanced_start_m`, a function of a topology alone, is a third of their
time. What it gave is kept in a file of the folder MEMORY for each seed.
"""

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.starts import topologies
from orchid_uav.experiments.reproduction import job
from orchid_uav.experiments.reproduction.trainings import TRAININGS
from orchid_uav.experiments.training.job import done, leave

_KEY_BYTES = 16

Floats = NDArray[np.float64]


class Memory:
    """Starts that :func:`balanced_start_m` gave, by all that it was given.

    Args:
        file: keeps them, in records of one length; need not exist.
        uavs: of every topology; others are not remembered.
        plain: the function that is remembered.
    """

    def __init__(self, file: Path, uavs: int, plain: Callable[..., Floats]) -> None:
        self.file, self.uavs, self.plain = file, uavs, plain
        self.hits = 0
        self._new: list[bytes] = []
        self._parameters: dict[int, tuple[object, bytes]] = {}
        size = _KEY_BYTES + 16 * uavs
        raw = file.read_bytes() if file.exists() else b""
        records = (raw[at : at + size] for at in range(0, len(raw) - size + 1, size))
        self._known = {record[:_KEY_BYTES]: record[_KEY_BYTES:] for record in records}

    def start_m(
        self,
        parameters: object,
        constants: object,
        users_m: Floats,
        target_users: NDArray[np.bool_],
        start_m: Floats,
        walk_key: int,
        begin: object,
    ) -> Floats:
        """The start, in m, (UAVs, 2); made or remembered. ``constants`` follow from parameters."""
        if start_m.shape != (self.uavs, 2):
            return self.plain(
                parameters, constants, users_m, target_users, start_m, walk_key, begin
            )
        key = self._key(parameters, users_m, target_users, start_m, walk_key)
        known = self._known.get(key)
        if known is not None:
            self.hits += 1
            return np.frombuffer(known).reshape(self.uavs, 2).copy()
        made = self.plain(parameters, constants, users_m, target_users, start_m, walk_key, begin)
        self._known[key] = np.ascontiguousarray(made, np.float64).tobytes()
        self._new.append(key + self._known[key])
        return made

    def _key(self, parameters: object, *given: NDArray[np.generic] | int) -> bytes:
        if id(parameters) not in self._parameters:  # kept, so that no other has its id
            self._parameters[id(parameters)] = (parameters, repr(parameters).encode())
        digest = hashlib.blake2b(self._parameters[id(parameters)][1], digest_size=_KEY_BYTES)
        for one in given:
            array = np.ascontiguousarray(one)
            digest.update(f"{array.shape} {array.dtype}".encode())
            digest.update(array.tobytes())
        return digest.digest()

    def keep(self) -> None:
        """Add what is new to the file."""
        with self.file.open("ab") as file:
            file.write(b"".join(self._new))
        self._new.clear()


def make_row(order: Path, folder: Path) -> int:
    """Make the row that is ordered; returns the exit code."""
    row = job.RowJob.read(order)
    assert row.seed is not None
    uavs = TRAININGS[row.method].config(row.seed).network.uav_count
    memory = Memory(folder / f"{row.seed}.bin", uavs, topologies.balanced_start_m)
    topologies.balanced_start_m = memory.start_m
    try:
        return job.make_row(row)
    finally:
        memory.keep()


if __name__ == "__main__":
    leave(done(lambda order: make_row(order, Path(sys.argv[2]))))
