"""A run's directory, as it is written: its id, its record, its log of episodes."""

import csv
import hashlib
import io
import math
import os
import re
import secrets
import shutil
import string
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean

from orchid_uav.agents.deployed_actor import DESCRIPTION_FILE, WEIGHTS_FILE
from orchid_uav.envs.metrics import COUNTS, EPISODE_METRICS
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.provenance import Status, boot_id, describe_host, describe_versions
from orchid_uav.experiments.runs.lock import RunLock
from orchid_uav.experiments.runs.records import (
    CONFIG_FILE,
    EPISODES_FILE,
    LARGEST_LOG,
    NUMERICS,
    RECORD_FILE,
    SCHEMA,
    Resumption,
    RunRecord,
    read_config,
    read_record,
)
from orchid_uav.notices import note_once, reason_of
from orchid_uav.storage.files import (
    checksum_of_file,
    json_bytes,
    read_bytes,
    remove_leftovers,
    sealed,
    sync_file,
    write_atomically,
    write_json,
)

Row = dict[str, float]

EPISODE_COLUMNS = (
    "episode",
    *EPISODE_METRICS,
    "actor_lr",
    "critic_lr",
    "entropy_coef",
    "reset",
)
"""Columns of ``episodes.csv``."""
LEARNERS_COLUMNS = ("actor_lr", "critic_lr", "entropy_coef")
"""Those that are empty where a learner has no such thing."""
_WHOLE_NUMBERS = COUNTS | {"episode", "reset"}
FINAL_EPISODES = 50
"""How many of the last episodes a run's final metrics are means of."""
_RESERVE_FILE, _RESERVE_SIZE = ".reserve", 2**16
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_NOT_IN_IDS = re.compile(r"[^A-Za-z0-9._-]")
_LONGEST_ID = 150
_TRIES = 100


class RunDirectory:
    """A directory ``runs/<id>/`` that this process writes.

    Args:
        path: the directory, which exists.
        lock: held by this process.
        record: the content of ``run.json``.
    """

    def __init__(self, path: Path, lock: RunLock, record: RunRecord) -> None:
        self.path = path
        self.record = record
        self.is_resumed = False
        self.renamed_from: str | None = None
        """The former id, if the run was reopened in a directory of another name."""
        self._episodes_size = 0
        self._lock = lock

    @classmethod
    def create(
        cls, runs_dir: Path, name: str, config: RunConfig, command: Sequence[str]
    ) -> "RunDirectory":
        """Make a new directory and write what is known before the run begins.

        The id consists of UTC time, name, seed and four random letters. ``mkdir`` itself fails if
        it is taken, so that two runs that start at once never share one.

        Raises:
            InputError: the name is not allowed, or the directory cannot be written.
        """
        if not _NAME.fullmatch(name):
            raise InputError(
                f"--name {name!r} is not a run's name: up to 64 letters, digits, '.', '_', '-'"
            )
        started = datetime.now(UTC)
        # Known before the directory is made: who is killed between the two leaves one that is none.
        versions, host = describe_versions(), describe_host()
        try:
            runs_dir.mkdir(parents=True, exist_ok=True)
            path = _new_directory(runs_dir, f"{started:%Y%m%dT%H%M%SZ}-{name}-s", config)
        except OSError as error:
            raise InputError(
                f"cannot make a run directory in {runs_dir}: {reason_of(error)}"
            ) from error
        try:
            lock, content = RunLock(path), _config_bytes(config)
            record = RunRecord(
                schema=SCHEMA,
                id=path.name,
                name=name,
                command=list(command),
                versions=versions,
                host=host,
                started=started.isoformat(timespec="seconds"),
                seconds=0.0,
                episodes=0,
                reset_episodes=[],
                final={},
                resumed=[],
                config_sha256=hashlib.sha256(content).hexdigest(),
                status="running",
                finished=None,
                error=None,
                numerics=NUMERICS,
            )
            run = cls(path, lock, record)
            write_atomically(path / CONFIG_FILE, content)
            run.append_episodes([])
            run._reserve()
            run._begin()
        except BaseException as error:
            shutil.rmtree(path, ignore_errors=True)
            if isinstance(error, OSError):
                raise InputError(f"cannot write to {path}: {reason_of(error)}") from error
            raise
        return run

    @classmethod
    def reopen(
        cls, path: Path, config: RunConfig, command: Sequence[str], lock: RunLock | None = None
    ) -> "RunDirectory":
        """Resume a run that was interrupted, failed or died, or extend a complete one.

        A run whose directory is not named by its id is a copy or was renamed. Either way its id
        becomes the directory's name, so that no two resumed runs have the same id.

        Args:
            path: the run's directory.
            config: the run's configuration, perhaps with more episodes.
            command: the command that resumes it.
            lock: the run's lock, if this process already has it.

        Raises:
            InputError: another process is writing the run, or it is damaged or cannot be written.
        """
        lock = lock or RunLock(path)
        try:
            run = cls(path, lock, read_record(path))
            run._reserve()  # before anything changes
            run._be_called_by_its_directory()
            known, episodes = read_config(path, run.record), config.training.episodes
            if config != known:
                is_longer = episodes > known.training.episodes
                if not is_longer or config != known.extended_to(episodes):
                    raise InputError(f"run {path.name} was changed by another process meanwhile")
                run._replace_config(config)
            run._remove_leftovers()
            run.is_resumed = True
            if run.record.numerics != NUMERICS:
                note_once(
                    f"numerics of {run.id}",
                    f"run {run.id} began with a version whose numbers differ from today's in their "
                    "last digits: it goes on, but not bit for bit as it would have there",
                )
            run.record.resumed.append(
                Resumption(
                    time=datetime.now(UTC).isoformat(timespec="seconds"),
                    command=list(command),
                    versions=describe_versions(),
                    host=describe_host()["name"],
                )
            )
            run._begin()
        except BaseException as error:
            with suppress(OSError):
                (path / _RESERVE_FILE).unlink(missing_ok=True)
            lock.release()
            if isinstance(error, OSError):
                raise InputError(f"cannot write to {path}: {reason_of(error)}") from error
            raise
        return run

    def _be_called_by_its_directory(self) -> None:
        """Take the directory's name as id: it is unique beside the others, even after copying."""
        found = _NOT_IN_IDS.sub("-", self.path.resolve().name).lstrip("-._")[:_LONGEST_ID]
        if found not in ("", self.id):
            self.renamed_from = self.id
            self.record.former_ids = [*self.record.former_ids, self.id]
            self.record.id = found

    def _remove_leftovers(self) -> None:
        """Remove temporary files of a process that died while it replaced a file."""
        names = (RECORD_FILE, CONFIG_FILE, EPISODES_FILE, WEIGHTS_FILE, DESCRIPTION_FILE)
        remove_leftovers(self.path, names)

    def _begin(self) -> None:
        record = self.record
        record.status, record.finished, record.error = "running", None, None
        record.pid, record.boot_id = os.getpid(), boot_id()
        record.episodes_sha256 = None  # until the log is complete
        self._save()

    def _reserve(self) -> None:
        """Reserve room for the last record of a run that fails because the disk is full.

        The content is random, since some file systems compress. The file is a new one, since an
        existing one might be a link to another.
        """
        self._give_reserve_back()
        (self.path / _RESERVE_FILE).write_bytes(os.urandom(_RESERVE_SIZE))

    def _give_reserve_back(self) -> None:
        (self.path / _RESERVE_FILE).unlink(missing_ok=True)

    def _replace_config(self, config: RunConfig) -> None:
        """Replace the configuration in steps between which it always agrees with the record."""
        content = _config_bytes(config)
        checksum = hashlib.sha256(content).hexdigest()
        self.record.next_config_sha256 = checksum
        self._begin()  # no longer complete, whatever happens from here on
        write_atomically(self.path / CONFIG_FILE, content)
        self.record.config_sha256 = checksum
        self.record.next_config_sha256 = None
        self.record.model_fields_set.discard("next_config_sha256")  # so that it is not written

    @property
    def id(self) -> str:
        """The run's id, which is its directory's name."""
        return self.record.id

    def append_episodes(self, rows: Iterable[Mapping[str, float]]) -> None:
        """Add rows to ``episodes.csv``: all of them or, if the disk is full, none."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if self._episodes_size == 0:
            writer.writerow(EPISODE_COLUMNS)
        for row in rows:
            writer.writerow(_formatted(row))
        content = text.getvalue().encode()
        # Unbuffered: closing would still write what a failed write had left in a buffer.
        with (self.path / EPISODES_FILE).open("ab", buffering=0) as file:
            try:
                written = 0
                while written < len(content):
                    written += file.write(content[written:])
            except OSError:
                os.truncate(file.fileno(), self._episodes_size)
                raise
        self._episodes_size += len(content)

    def keep_episodes(self, size: int, checksum: str) -> list[Row]:
        """Cut the log of episodes off after ``size`` bytes and return the rows that stay.

        Args:
            size: bytes of the part that stays; 0 for none.
            checksum: the SHA-256 of that part.

        Raises:
            ValueError: the log is damaged.
        """
        path = self.path / EPISODES_FILE
        if type(size) is not int or size < 0:
            raise ValueError(f"{size!r} is not a size of a log")
        content = read_bytes(path, max(LARGEST_LOG, 2 * size))[:size] if path.is_file() else b""
        if size and (len(content) != size or hashlib.sha256(content).hexdigest() != checksum):
            raise ValueError(f"{path} is not what was written")
        rows = _parsed(content.decode()) if size else []
        write_atomically(path, content)
        self._episodes_size = size
        if not size:
            self.append_episodes([])
        return rows

    def sync_episodes(self) -> tuple[int, str]:
        """Write the log through to the disk, and return its size and SHA-256."""
        with (self.path / EPISODES_FILE).open("rb+") as file:  # Windows syncs what can be written
            sync_file(file, self.path)
            content = file.read(self._episodes_size)
        return self._episodes_size, hashlib.sha256(content).hexdigest()

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
        """Record how the run ended, and its final metrics."""
        record = self.record
        record.seconds, record.episodes = round(seconds, 3), len(rows)
        record.reset_episodes = list(reset_episodes)
        record.final = final_metrics(rows)
        record.episodes_sha256 = self._log_checksum()
        self.give_up(status, error)

    def _log_checksum(self) -> str | None:
        try:
            return checksum_of_file(self.path / EPISODES_FILE, LARGEST_LOG)
        except (OSError, ValueError):  # perhaps the very reason why the run failed
            return None

    def give_up(self, status: Status, error: str | None) -> None:
        """Record only how the run ended; the results of a run that could not resume are kept."""
        self.record.status, self.record.error = status, error
        self.record.finished = datetime.now(UTC).isoformat(timespec="seconds")
        self._give_reserve_back()
        self._save()
        self.release()

    def release(self) -> None:
        """Release the lock, if it is still held."""
        self._lock.release()

    def _save(self) -> None:
        write_json(self.path / RECORD_FILE, sealed(self.record.to_json()))


def _config_bytes(config: RunConfig) -> bytes:
    return json_bytes(config.model_dump(mode="json"))


def final_metrics(rows: Sequence[Row]) -> dict[str, float | None]:
    """Means of the last ``FINAL_EPISODES`` episodes, by column; empty without episodes.

    A mean that is not a finite number, which JSON cannot hold, is None.
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
    """The rows of an ``episodes.csv``.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is no such log.
    """
    return _parsed(read_bytes(path, LARGEST_LOG).decode())


def _parsed(text: str) -> list[Row]:
    header, *lines = text.split("\n")
    if header != ",".join(EPISODE_COLUMNS) or not lines or lines.pop():
        raise ValueError("the log of episodes has other columns, or ends in the middle of a row")
    rows = [
        dict(zip(EPISODE_COLUMNS, map(number_in, line.split(",")), strict=True)) for line in lines
    ]
    if [row["episode"] for row in rows] != list(range(1, len(rows) + 1)):
        raise ValueError("the log of episodes lacks some episodes")
    return rows


def number_in(cell: str) -> float:
    """A cell's number; NaN where it is empty, as its column does not apply to the learner."""
    return float(cell) if cell else math.nan


def _formatted(row: Mapping[str, float]) -> list[str]:
    return [_text(column, row[column]) for column in EPISODE_COLUMNS]


def _text(column: str, value: float) -> str:
    if math.isnan(value) and column in LEARNERS_COLUMNS:
        return ""
    return str(int(value)) if column in _WHOLE_NUMBERS else repr(float(value))


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
