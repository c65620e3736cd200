"""Small runs, and what tests of them have in common."""

import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from orchid_uav.experiments.configuration import Layer, RunConfig, merge

TINY = {
    "network.uav_count": 2,
    "network.user_count": 20,
    "network.episode_slots": 10,
    "ppo.hidden_sizes": [16, 16],
}
"""Flies and learns an episode in about ten milliseconds."""

TINY_FLAGS = [f"--set={key}={json.dumps(value)}" for key, value in TINY.items()]

COLUMNS = [
    "episode",
    "reward",
    "coverage",
    "energy_efficiency_bit_per_joule",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "sum_rate_bps",
    "propulsion_power_w",
    "collisions",
    "boundary_violations",
    "backhaul_violations",
    "actor_lr",
    "critic_lr",
    "entropy_coef",
    "reset",
]
"""Of ``episodes.csv``, written out: other programs rely on them."""

WHOLE_NUMBERS = ("episode", "collisions", "boundary_violations", "backhaul_violations", "reset")

ESCAPE = "\x1b"


@dataclass(frozen=True)
class Finished:
    """A command that has ended."""

    code: int
    out: str
    err: str


def tiny_config(episodes: int = 3, **values: Any) -> RunConfig:
    """TINY with other values, written with two underscores: ``reset__window=2``."""
    dotted = {key.replace("__", "."): value for key, value in values.items()}
    return merge([Layer("test", TINY | {"training.episodes": episodes} | dotted)])[0]


def cells(directory: Path) -> list[list[str]]:
    """The lines of a run's ``episodes.csv``, split, header first."""
    text = (directory / "episodes.csv").read_text()
    assert text.endswith("\n"), "the last row is cut off"
    return [line.split(",") for line in text.splitlines()]


def columns(directory: Path) -> dict[str, list[float]]:
    """The columns of a run's ``episodes.csv``, read without the project's own reader."""
    header, *rows = cells(directory)
    assert all(len(row) == len(header) for row in rows)
    return {name: [float(row[index]) for row in rows] for index, name in enumerate(header)}


def record_of(directory: Path) -> dict[str, Any]:
    """A run's ``run.json``."""
    return json.loads((directory / "run.json").read_text())


def files_of(directory: Path) -> set[str]:
    """Names of a run's files; of TensorBoard's only the part that is the same for all runs."""
    return {re.sub(r"(tfevents)\..*", r"\1", path.name) for path in directory.iterdir()}


def fingerprint(directory: Path) -> dict[str, str]:
    """Every path below a directory, with the hash of its content."""
    return {
        str(path.relative_to(directory)): (
            hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "directory"
        )
        for path in sorted(directory.rglob("*"))
    }


def assert_is_an_error(finished: Finished, *parts: str, code: int = 2) -> None:
    """The command failed with one or two lines on stderr that hold the parts, and no output."""
    assert finished.code == code
    assert finished.out == ""
    assert finished.err.startswith("error: ")
    assert len(finished.err.splitlines()) <= 2, finished.err
    for part in parts:
        assert part in finished.err


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """No file of this process can grow beyond ``size`` bytes: a disk that is full."""
    resource = pytest.importorskip("resource", reason="limits on file sizes are POSIX")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
