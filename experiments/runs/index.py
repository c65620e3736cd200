"""Lists and compares the runs of a directory, without a database.

Two small files of each run are read, ``run.json`` and ``config.json``, and for a run that has not
ended its log as well. The values of a configuration are shown as they are, without validation.
"""

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from orchid_uav.envs.keys import by_key, with_current_keys
from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.runs.directory import (
    EPISODE_COLUMNS,
    FINAL_EPISODES,
    Row,
    final_metrics,
    number_in,
)
from orchid_uav.experiments.runs.records import (
    CHECKPOINTS_FOLDER,
    CONFIG_FILE,
    EPISODES_FILE,
    LARGEST_LOG,
    RECORD_FILE,
    RunRecord,
    SeenStatus,
    check_log,
    name_of,
    read_plain_config,
    read_record,
    resume_command,
    short_ids,
    status_of,
)
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import read_bytes

TRAINING_METRICS = tuple(column for column in EPISODE_COLUMNS if column != "episode")
"""Names of the final metrics, which are means over the last episodes."""
RECORD_KEYS = (
    *("id", "status", "name", "episodes", "seconds", "resets", "started", "finished"),
    *("command", "error"),
)
"""Keys of a run's record, besides "host.*" and "versions.*"."""
RESUMABLE = ("died", "interrupted", "failed")
"""A run of one of these statuses can be resumed."""

_LOG_END_BYTES = 2**16  # three times the size of the last 50 episodes
_RESET = b",1\n"
"""The end of a log row whose episode had a reset, which is the last column."""


@dataclass(frozen=True)
class Run:
    """A run as its files describe it."""

    path: Path
    status: SeenStatus
    record: RunRecord
    """The content of ``run.json``. If the run has not ended, "episodes", "reset_episodes" and
    "final" are brought up to date from its log."""
    config: Mapping[str, Any]
    """All values of the configuration, by ``"section.key"``."""

    @property
    def id(self) -> str:
        """The run's name on the command line, which is its directory's name."""
        return name_of(self.path)

    @property
    def planned_episodes(self) -> int:
        """The number of episodes that the complete run will have."""
        return int(self.config["training.episodes"])

    @property
    def resume(self) -> str | None:
        """The command that resumes the run; None if there is nothing to resume."""
        return shlex.join(resume_command(self.path)) if self.status in RESUMABLE else None

    @cached_property
    def values(self) -> dict[str, Any]:
        """All values by which runs can be filtered and sorted."""
        record = self.record
        return {
            **self.config,
            **dict.fromkeys(TRAINING_METRICS),
            **record.final,
            **{f"host.{key}": value for key, value in record.host.items()},
            **{f"versions.{key}": value for key, value in record.versions.items()},
            "id": self.id,
            "status": self.status,
            "name": record.name,
            "episodes": record.episodes,
            "seconds": record.seconds,
            "resets": len(record.reset_episodes),
            "started": record.started,
            "finished": record.finished,
            "command": shlex.join(record.command),
            "error": record.error,
        }

    def summary(self) -> dict[str, Any]:
        """The run in brief, for a JSON document."""
        record = self.record
        return {
            "id": self.id,
            "path": str(self.path),
            "status": self.status,
            "name": record.name,
            "episodes": record.episodes,
            "planned_episodes": self.planned_episodes,
            "reset_episodes": record.reset_episodes,
            "started": record.started,
            "finished": record.finished,
            "seconds": record.seconds,
            "error": record.error,
            "resume": self.resume,
            "final": record.final,
            "config": dict(self.config),
        }


class Index(NamedTuple):
    """The content of a directory of runs."""

    runs: list[Run]
    damaged: dict[str, str]
    """Names of directories that look like runs but cannot be read, with the reason."""


def read_index(runs_dir: Path) -> Index:
    """Read all runs directly in a directory, latest first; none if the directory is missing.

    Raises:
        InputError: the directory cannot be read.
    """
    try:
        with os.scandir(runs_dir) as entries:
            names = sorted(entry.name for entry in entries if entry.name[0] != ".")
    except FileNotFoundError:
        return Index([], {})
    except OSError as error:
        raise InputError(f"cannot read {runs_dir}: {reason_of(error)}") from error
    runs, damaged = [], {}
    for name in names:
        path = runs_dir / name
        try:
            os.lstat(path / RECORD_FILE)
        except PermissionError as error:
            damaged[name] = f"cannot read {path}: {error.strerror}"
            continue
        except OSError:
            continue
        try:
            runs.append(read_run(path))
        except InputError as error:
            damaged[name] = str(error)
    return Index(sorted(runs, key=lambda run: (run.record.started, run.id))[::-1], damaged)


def read_run(path: Path) -> Run:
    """Read a run from its directory.

    Raises:
        InputError: the run is damaged, or the directory is no run.
    """
    record = read_record(path)
    sections = read_plain_config(path, record)
    if not all(isinstance(one, dict) for one in sections.values()):
        raise InputError(f"{path / CONFIG_FILE} is not the configuration of a run")
    config = _defaults() | by_key(with_current_keys(sections))  # a key may be newer than the run
    if not isinstance(config["training.episodes"], int):
        raise InputError(f"{path}: training.episodes in its configuration is not a number")
    status = status_of(path, record)
    if status in ("running", "died"):
        _bring_up_to_date(record, path / EPISODES_FILE)
    return Run(path, status, record, config)


@cache
def _defaults() -> dict[str, Any]:
    return flatten(RunConfig())


def read_log(run: Run) -> list[Row]:
    """Read the rows of a run's log; of a log that is being written, the complete rows.

    Raises:
        InputError: the log is damaged.
    """
    path = run.path / EPISODES_FILE
    if path.exists():
        check_log(run.path, run.record)
    try:
        lines = read_bytes(path, LARGEST_LOG).decode().split("\n")[:-1]
        if lines and lines[0].split(",") != list(EPISODE_COLUMNS):
            raise ValueError("it has other columns than expected")
        return _rows(lines[1:])
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(f"cannot read {path}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(f"{path} is damaged: {error}") from error


def _rows(lines: Sequence[str]) -> list[Row]:
    cells = (line.split(",") for line in lines)
    return [dict(zip(EPISODE_COLUMNS, map(number_in, row), strict=True)) for row in cells]


def is_number(value: Any) -> bool:
    """Whether a value is a number; true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _bring_up_to_date(record: RunRecord, log: Path) -> None:
    """Take episodes, resets and latest metrics from the log, as the record lacks them yet."""
    try:
        with log.open("rb") as file:
            resets = [int(line.split(b",")[0]) for line in file if line.endswith(_RESET)]
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - _LOG_END_BYTES))
            lines = file.read(_LOG_END_BYTES).decode().split("\n")[1:-1]  # complete lines
        rows = _rows(lines[-FINAL_EPISODES:])
    except (OSError, ValueError):  # then the record stays as it is
        return
    if rows:
        record.episodes, record.reset_episodes = int(rows[-1]["episode"]), resets
        record.final = final_metrics(rows)


def details(run: Run) -> dict[str, Any]:
    """All that is known about a run, for a JSON document."""
    record = run.record
    return {
        **run.summary(),
        "recorded_id": record.id,
        "former_ids": record.former_ids,
        "command": record.command,
        "versions": record.versions,
        "host": record.host,
        "resumed": [one.to_json() for one in record.resumed],
        "checkpoints": checkpoints_of(run),
        "changed": {
            key: {"value": value, "default": default}
            for key, (value, default) in changed(run).items()
        },
    }


def checkpoints_of(run: Run) -> list[int]:
    """The episodes after which there is a checkpoint."""
    try:
        names = [path.name for path in (run.path / CHECKPOINTS_FOLDER).iterdir()]
    except OSError:
        return []
    return sorted(int(name) for name in names if name.isdecimal())


def differences(runs: Sequence[Run]) -> dict[str, list[Any]]:
    """Configuration keys in which runs differ, each with its values in the order of the runs."""
    keys = dict.fromkeys(key for run in runs for key in run.config)
    values = {key: [run.config.get(key) for run in runs] for key in keys}
    return {
        key: found for key, found in values.items() if any(one != found[0] for one in found[1:])
    }


def changed(run: Run) -> dict[str, tuple[Any, Any]]:
    """Configuration keys in which a run differs from the defaults, with both values."""
    defaults = _defaults()
    return {
        key: (value, defaults.get(key))
        for key, value in run.config.items()
        if key not in defaults or value != defaults[key]
    }


def short_names(runs: Sequence[Run]) -> list[str]:
    """The shortest parts of the ids that still tell them apart; paths where ids are equal."""
    ids = [run.id for run in runs]
    short = short_ids(ids)
    return [
        short[run] if ids.count(run) == 1 else str(one.path)
        for run, one in zip(ids, runs, strict=True)
    ]


def value_text(value: Any, key: str = "") -> str:
    """A value as text for people; a metric of ``METRICS`` is scaled as its heading says."""
    if value is None:
        return "-" if key in TRAINING_METRICS else "none"
    if isinstance(value, bool):
        return str(value).lower()
    if key in METRICS and is_number(value):
        return METRICS[key].text(value)
    if isinstance(value, float):
        return (
            f"{value:g}" if key in TRAINING_METRICS or float(f"{value:g}") == value else repr(value)
        )
    return value if isinstance(value, str) else json.dumps(value)
