"""A run's directory: its id, its record, its log of episodes."""

import csv
import io
import math
import os
import re
import secrets
import shutil
import string
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean
from typing import Any, Literal

from orchid_uav.envs.metrics import EPISODE_METRICS
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.files import write_atomically, write_json
from orchid_uav.experiments.provenance import describe_host, describe_process, describe_versions

Status = Literal["running", "completed", "failed", "interrupted"]
Row = dict[str, float]

SCHEMA = 1
EPISODE_COLUMNS = (
    "episode",
    *EPISODE_METRICS,
    "actor_lr",
    "critic_lr",
    "entropy_coef",
    "reset",
)
"""Columns of ``episodes.csv``."""
_WHOLE_NUMBERS = frozenset(
    {"episode", "collisions", "boundary_violations", "backhaul_violations", "reset"}
)
FINAL_EPISODES = 50
"""Last episodes whose means are a run's final figures."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_TRIES = 100


class RunDirectory:
    """A directory ``runs/<id>/`` that this process writes.

    Args:
        path: the directory, which exists.
        record: the content of ``run.json``.
    """

    def __init__(self, path: Path, record: dict[str, Any]) -> None:
        self.path = path
        self.record = record
        self._episodes_size = 0

    @classmethod
    def create(
        cls, runs_dir: Path, name: str, config: RunConfig, command: Sequence[str]
    ) -> "RunDirectory":
        """Make a new directory and write what is known before the run begins.

        The id is UTC time, name, seed and four random letters. ``mkdir`` itself tells whether it
        is taken, so that two runs started at once never share one.

        Raises:
            InputError: a name that cannot be one, or a directory that cannot be written.
        """
        if not _NAME.fullmatch(name):
            raise InputError(
                f"--name {name!r} is not a run's name: up to 64 letters, digits, '.', '_', '-'"
            )
        started = datetime.now(UTC)
        try:
            runs_dir.mkdir(parents=True, exist_ok=True)
            path = _new_directory(runs_dir, f"{started:%Y%m%dT%H%M%SZ}-{name}-s", config)
        except OSError as error:
            raise InputError(
                f"cannot make a run directory in {runs_dir}: {error.strerror or error}"
            ) from error
        run = cls(
            path,
            {
                "schema": SCHEMA,
                "id": path.name,
                "name": name,
                "status": "running",
                "command": list(command),
                "versions": describe_versions(),
                "host": describe_host(),
                **describe_process(),
                "started": started.isoformat(timespec="seconds"),
                "finished": None,
                "seconds": None,
                "episodes": 0,
                "reset_episodes": [],
                "final": {},
                "error": None,
            },
        )
        try:
            write_json(path / "config.json", config.model_dump(mode="json"))
            run.append_episodes([])
            run._save()
        except BaseException as error:
            shutil.rmtree(path, ignore_errors=True)
            if isinstance(error, OSError):
                raise InputError(f"cannot write to {path}: {error.strerror or error}") from error
            raise
        return run

    @property
    def id(self) -> str:
        """The run's id, which is the directory's name."""
        return self.path.name

    def append_episodes(self, rows: Iterable[Mapping[str, float]]) -> None:
        """Add rows to ``episodes.csv``, all or, if the disk is full, none of them."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if self._episodes_size == 0:
            writer.writerow(EPISODE_COLUMNS)
        for row in rows:
            writer.writerow(_formatted(row))
        content = text.getvalue().encode()
        # Unbuffered: what a failed write leaves in a buffer would be written at closing after all.
        with (self.path / "episodes.csv").open("ab", buffering=0) as file:
            try:
                written = 0
                while written < len(content):
                    written += file.write(content[written:])
            except OSError:
                os.truncate(file.fileno(), self._episodes_size)
                raise
        self._episodes_size += len(content)

    def write_policy(self, files: Mapping[str, bytes]) -> None:
        """Write the policy's files, weights first."""
        for name, content in files.items():
            write_atomically(self.path / name, content)

    def finish(
        self,
        status: Status,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
        seconds: float,
        error: str | None = None,
    ) -> None:
        """Record how the run ended, and its final figures."""
        self.record |= {
            "status": status,
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "seconds": round(seconds, 3),
            "episodes": len(rows),
            "reset_episodes": list(reset_episodes),
            "final": final_figures(rows),
            "error": error,
        }
        self._save()

    def _save(self) -> None:
        write_json(self.path / "run.json", self.record)


def final_figures(rows: Sequence[Row]) -> dict[str, float | None]:
    """Means of the last ``FINAL_EPISODES`` episodes, by column; empty if there was no episode.

    None where a mean is not a finite number, which JSON cannot hold.
    """
    last = rows[-FINAL_EPISODES:]
    if not last:
        return {}
    values = {
        column: [row[column] for row in last] for column in EPISODE_COLUMNS if column != "episode"
    }
    return {
        column: fmean(found) if all(map(math.isfinite, found)) else None
        for column, found in values.items()
    }


def read_episodes(path: Path) -> list[Row]:
    """The rows of an ``episodes.csv``."""
    with path.open(newline="", encoding="utf-8") as file:
        return [
            {column: float(value) for column, value in row.items()} for row in csv.DictReader(file)
        ]


def _formatted(row: Mapping[str, float]) -> list[str]:
    return [
        str(int(row[column])) if column in _WHOLE_NUMBERS else repr(float(row[column]))
        for column in EPISODE_COLUMNS
    ]


def _new_directory(runs_dir: Path, prefix: str, config: RunConfig) -> Path:
    for _ in range(_TRIES):
        letters = "".join(secrets.choice(string.ascii_lowercase) for _ in range(4))
        path = runs_dir / f"{prefix}{config.training.seed}-{letters}"
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise OSError(f"no free name beginning with {prefix}")
