"""Reads run directories: records, configurations, and whether a run is alive."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, JsonValue, ValidationError, field_validator

from orchid_uav.envs.keys import describe_error
from orchid_uav.experiments.configuration import RunConfig, as_read_before
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.provenance import Status
from orchid_uav.experiments.runs.lock import is_alive
from orchid_uav.notices import reason_of
from orchid_uav.storage.documents import Document
from orchid_uav.storage.files import checksum_of_file, read_document, read_sealed
from orchid_uav.suggestions import did_you_mean, nearest

SCHEMA = 1
RECORD_FILE, CONFIG_FILE, EPISODES_FILE = "run.json", "config.json", "episodes.csv"
CHECKPOINTS_FOLDER = "checkpoints"
DEFAULT_RUNS_DIR = Path("runs")
_TIME = re.compile(r"^\d{8}T\d{6}Z-")
_ID = re.compile(r"\d{8}T\d{6}Z-(.+-s\d+)-[a-z]{4}")
"""The form of the id of a new run; a directory may have another name."""
_LARGEST_CONFIG = 2**20
LARGEST_LOG = 2**30
"""The most bytes that ``episodes.csv`` may have."""

NUMERICS = 2
"""Raised whenever last digits of simulator or learner change, and with them a training's course.
2: the simulator's own elementary functions, and the learner's products in other orders."""

SeenStatus = Status | Literal["died"]
"""The status that users see: "died" if a run says that it is running and its process is gone."""


class Resumption(Document):
    """When and how a run was resumed."""

    time: str
    command: list[str]
    versions: dict[str, str | None]
    host: str


class RunRecord(Document):
    """The content of ``run.json``."""

    schema_version: int = Field(default=SCHEMA, alias="schema")
    id: str
    name: str
    command: list[str]
    versions: dict[str, str | None]
    host: dict[str, JsonValue]
    started: str
    seconds: float
    """Duration of the learning loop."""
    episodes: int
    reset_episodes: list[int]
    final: dict[str, float | None]
    """Means of the last episodes, by column; None for a mean that is not a finite number."""
    resumed: list[Resumption]
    config_sha256: str
    status: Status
    pid: int | None = None
    boot_id: str | None = None
    finished: str | None
    error: str | None
    episodes_sha256: str | None = None
    """Checksum of the log, once it is complete."""
    former_ids: list[str] = Field(default=[])
    """Ids of the runs that this one was copied from, or that it had before it was renamed. Those of
    its checkpoints and policies that are older than its present id name one of these."""
    numerics: int = 1
    """``NUMERICS`` of the version that began the run."""
    next_config_sha256: str | None = None
    """Checksum of the configuration that is about to replace the present one."""

    @property
    def final_scalars(self) -> dict[str, float]:
        """The final metrics that are finite, under the names that trackers show."""
        return {f"final/{name}": one for name, one in self.final.items() if one is not None}

    @field_validator("former_ids", mode="before")
    @classmethod
    def _only_texts(cls, found: Any) -> list[str]:
        """Ignore entries that are no ids, so that the run can still be read."""
        return [one for one in found if isinstance(one, str)] if isinstance(found, list) else []


def read_record(path: Path) -> RunRecord:
    """Read the record of a run directory.

    Raises:
        InputError: there is no record, or it is damaged.
    """
    file = path / RECORD_FILE
    try:
        document = read_sealed(file)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"{path} is not a run directory: it has no {RECORD_FILE}") from error
    except OSError as error:
        raise InputError(f"cannot read {file}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(f"cannot read the run: {error}") from error
    try:
        return RunRecord.from_json(document)
    except ValueError as error:
        raise InputError(f"{file} is not the record of a run: {error}") from error


def read_plain_config(path: Path, record: RunRecord) -> dict[str, Any]:
    """Read the sections of a run's configuration as their version read them, without validation.

    Raises:
        InputError: there is no configuration, or it is damaged.
    """
    file = path / CONFIG_FILE
    checksums = record.config_sha256, record.next_config_sha256
    try:
        found = checksum_of_file(file, _LARGEST_CONFIG)
        if found not in checksums:
            raise ValueError(f"{file} is not the configuration that the run was made with (sha256)")
        return as_read_before(read_document(file, _LARGEST_CONFIG, found))
    except OSError as error:
        raise InputError(f"cannot read {file}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(f"cannot read the run: {error}") from error


def read_config(path: Path, record: RunRecord) -> RunConfig:
    """Read and validate a run's configuration.

    Raises:
        InputError: there is no configuration, it is damaged, or it belongs to another version.
    """
    try:
        return RunConfig.model_validate(read_plain_config(path, record))
    except ValidationError as error:
        raise InputError(f"{path / CONFIG_FILE}: {describe_error(error, RunConfig)[1]}") from error


def check_log(path: Path, record: RunRecord) -> None:
    """Check the log of a run that has ended against the checksum in its record.

    Raises:
        InputError: the log cannot be read, or is not what the run wrote.
    """
    file, checksum = path / EPISODES_FILE, record.episodes_sha256
    try:
        if checksum is not None and checksum_of_file(file, LARGEST_LOG) != checksum:
            raise ValueError(f"{file} is not what was written: its checksum (sha256) does not fit")
    except OSError as error:
        raise InputError(f"cannot read {file}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(f"cannot read the run: {error}") from error


def status_of(path: Path, record: RunRecord) -> SeenStatus:
    """A run's status; "died" if its record says "running" but no process writes it."""
    is_dead = record.status == "running" and not is_alive(path, record.pid, record.boot_id)
    return "died" if is_dead else record.status


def has_checkpoint(path: Path) -> bool:
    """Whether the run has a checkpoint to resume from."""
    return any(one.name.isdecimal() for one in (path / CHECKPOINTS_FOLDER).glob("*/"))


def resume_command(path: Path) -> list[str]:
    """The command line that resumes or extends a run."""
    return ["orchid", "train", "--resume", run_argument(path)]


def run_argument(path: Path) -> str:
    """The run as an argument of a command: its id if that is enough, else its path."""
    try:
        default = expanded(os.environ.get("ORCHID_RUNS_DIR") or DEFAULT_RUNS_DIR)
        is_default = path.name not in ("", "..") and path.parent.resolve() == default.resolve()
    except (OSError, InputError):
        is_default = False
    return path.name if is_default else str(path)


def name_of(path: Path) -> str:
    """A run's name, which is that of its directory or, if that is a link, of the link."""
    return path.name if path.name not in ("", "..") else path.resolve().name


def without_time(run_id: str) -> str:
    """An id without its time; what remains is the part that people recognise."""
    return _TIME.sub("", run_id, count=1)


def _name_and_seed(run_id: str) -> str:
    match = _ID.fullmatch(run_id)
    return match[1] if match else run_id


def short_ids(ids: Sequence[str]) -> dict[str, str]:
    """The shortest unique part of each id: name and seed, else with the letters, else the whole id.

    :func:`find_run` finds a run by this part as well, unless further runs share it.
    """
    parts = {run: (_name_and_seed(run), without_time(run), run) for run in ids}
    short = {}
    for run, own in parts.items():
        taken = {part for other, found in parts.items() if other != run for part in found}
        short[run] = next((part for part in own if part not in taken), run)
    return short


def find_run(name: str, runs_dir: Path) -> Path:
    """Find the directory of a run that is given as a path, an id, or a unique beginning of an id.

    The time may be left out, so that the short ids of tables are found as well.

    Raises:
        InputError: no run fits, or several do.
    """
    given = expanded(name)
    try:
        if given.is_dir():
            return given
    except (OSError, ValueError) as error:
        raise InputError(f"no run {name!r}: {getattr(error, 'strerror', error)}") from error
    try:
        entries = sorted(runs_dir.iterdir())
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InputError(f"no run '{name}': there is no directory {runs_dir}") from error
    except OSError as error:
        raise InputError(f"cannot read {runs_dir}: {reason_of(error)}") from error
    # Not `Path.is_file`, which raises an error for a directory that may not be entered.
    ids = [path.name for path in entries if os.path.isfile(path / RECORD_FILE)]  # noqa: PTH113
    found = [name] if name in ids else [run for run in ids if run.startswith(name)]
    found = found or [run for run in ids if _name_and_seed(run) == name]
    found = found or [run for run in ids if without_time(run).startswith(name)]
    if len(found) == 1:
        return runs_dir / found[0]
    if found:
        shown = ", ".join(found[:4]) + (" ..." if len(found) > 4 else "")
        raise InputError(f"the ids of {len(found)} runs begin with '{name}': {shown}")
    try:
        os.lstat(runs_dir / name / RECORD_FILE)
    except PermissionError as error:
        raise InputError(f"cannot read {runs_dir / name}: {error.strerror}") from error
    except (OSError, ValueError):
        pass
    near = nearest(name, ids, cutoff=0.3)
    hint = f"; {did_you_mean([near])}" if near else ""
    raise InputError(f"no run '{name}' in {runs_dir}{hint}")


def expanded(path: str | Path) -> Path:
    """Return the path with ``~`` replaced.

    Raises:
        InputError: the user is unknown, or the path is not UTF-8 and so fits in no JSON document.
    """
    try:
        os.fspath(path).encode()
        return Path(path).expanduser()
    except UnicodeEncodeError as error:
        shown = os.fsencode(path)
        raise InputError(f"the path {shown!r} cannot be used: it is not UTF-8") from error
    except RuntimeError as error:
        raise InputError(
            f"{path}: the home directory is unknown; give the path without '~'"
        ) from error
