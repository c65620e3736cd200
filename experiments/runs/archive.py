"""Exports runs to a zip that another machine can import.

Nothing in such a file is trusted: only what :func:`export_runs` writes is accepted, everything that
can be checked is checked before anything is written, and a run appears whole or not at all.
"""

import hashlib
import json
import os
import re
import shutil
import stat
import struct
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Literal, NamedTuple

from pydantic import Field

from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs.index import Run, read_run
from orchid_uav.experiments.runs.records import CONFIG_FILE, RECORD_FILE
from orchid_uav.notices import in_one_line, reason_of
from orchid_uav.storage.documents import Document
from orchid_uav.storage.files import (
    LARGEST_DOCUMENT,
    appearing_when_complete,
    json_bytes,
    sync_directory,
)

MANIFEST = "manifest.json"
LARGEST_TOTAL = 3 * 2**30
"""The most bytes of all files together; below 4 GiB a zip needs no extension of its format."""
MOST_FILES = 10_000
LARGEST_RATIO = 200
"""The most bytes that one compressed byte may stand for; in logs it stands for about ten."""

_CHECKPOINTS = "checkpoints/"
_FILE = re.compile(
    r"(run|config|policy|evaluation|watched)\.json|episodes\.csv|policy\.safetensors"
    r"|events\.out\.tfevents\.[A-Za-z0-9._-]{1,200}"
    rf"|{_CHECKPOINTS}[0-9]{{1,9}}/[a-z_]{{1,40}}\.(json|safetensors)"
    rf"|{_CHECKPOINTS}examples/[0-9]{{1,9}}\.safetensors"
)
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,149}")
_CHUNK = 2**20
_LARGEST_DIRECTORY = 4 * 2**20
_END = struct.Struct("<4s4H2LH")
_SMALL = 2**16
"""Files up to this size may have any ratio: even ``MOST_FILES`` of them do no harm."""
_NO_TIME = (1980, 1, 1, 0, 0, 0)
_TEXTS = (".json", ".csv")
_ODD_FLAGS = 0x2061  # encrypted, patched, strongly encrypted, masked


class _File(Document):
    """What the manifest says about a file."""

    size: int = Field(alias="bytes", ge=0)
    sha256: str = Field(pattern="^[0-9a-f]{64}$")


class _Manifest(Document):
    """All files of an archive, by run and name."""

    schema_version: Literal[1] = Field(alias="schema")
    runs: dict[str, dict[str, _File]]


class Exported(NamedTuple):
    """An archive that was written."""

    path: Path
    runs: list[str]
    size: int
    left_out: list[str]
    """Files that do not belong to a run and were left out, as ``id/name``."""


def export_runs(
    paths: Sequence[Path], target: Path, checkpoints: bool = False, force: bool = False
) -> Exported:
    """Write runs to a zip with a checksum of every file; the same runs give the same bytes.

    Args:
        paths: directories of runs that have ended.
        target: the zip, which appears when it is complete.
        checkpoints: whether to include checkpoints, without which a run can be evaluated but not
            resumed.
        force: whether an existing target may be replaced.

    Raises:
        InputError: a run is damaged or still running, or the target exists or cannot be written.
        RunFailedError: a run changed during the export.
    """
    if not force and os.path.lexists(target):
        raise InputError(f"{target} exists: give another name, or --force to replace it")
    runs = [read_run(path) for path in paths]
    by_id = _by_id(runs)
    files: dict[str, Path] = {}
    left_out: list[str] = []
    for run_id, run in sorted(by_id.items()):
        if run.status == "running":
            raise InputError(f"run {run_id} is running: it can be exported when it has ended")
        if not _ID.fullmatch(run_id):
            raise InputError(f"{run.path}: {run_id!r} is not a valid id of a run")
        for name in _files_of(run.path):
            if not _FILE.fullmatch(name) or not _is_regular(run.path / name):
                left_out.append(f"{run_id}/{name}")
            elif checkpoints or not name.startswith(_CHECKPOINTS):
                files[f"{run_id}/{name}"] = run.path / name
    total = sum(path.stat().st_size for path in files.values())
    if total > LARGEST_TOTAL or len(files) > MOST_FILES:
        raise InputError(
            f"{len(files):,} files of {total:,} bytes are too many for an archive "
            f"({MOST_FILES:,} of {LARGEST_TOTAL:,}): export fewer runs at once"
        )
    try:
        with appearing_when_complete(target, force) as file:
            _write(file, files)
            for run_id, run in by_id.items():
                if read_run(run.path).record != run.record:
                    raise RunFailedError(f"run {run_id} changed while it was exported")
    except OSError as error:
        raise InputError(f"cannot write {target}: {reason_of(error)}") from error
    return Exported(target, sorted(by_id), target.stat().st_size, left_out)


def _by_id(runs: Sequence[Run]) -> dict[str, Run]:
    by_id = {run.record.id: run for run in runs}
    for run in runs:
        other = by_id[run.record.id]
        if other is not run:
            raise InputError(f"run {other.id} is given twice, as {run.path} and as {other.path}")
    return by_id


def _files_of(directory: Path) -> list[str]:
    """Names of all files except hidden ones, which are locks or unfinished."""
    found = []
    for folder, folders, names in os.walk(directory):
        folders[:] = sorted(name for name in folders if name[0] != ".")
        inner = Path(folder).relative_to(directory)
        links = [name for name in folders if (Path(folder) / name).is_symlink()]
        found += [(inner / name).as_posix() for name in [*names, *links] if name[0] != "."]
    return sorted(found)


def _is_regular(path: Path) -> bool:
    return stat.S_ISREG(path.lstat().st_mode)


def _write(file: IO[bytes], files: Mapping[str, Path]) -> None:
    runs: dict[str, dict[str, _File]] = {}
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, path in files.items():
            digest, size = hashlib.sha256(), 0
            with _open_regular(path) as source, archive.open(_entry(name), "w") as target:
                while chunk := source.read(_CHUNK):
                    digest.update(chunk)
                    size += target.write(chunk)
            run_id, _, inner = name.partition("/")
            runs.setdefault(run_id, {})[inner] = _File(bytes=size, sha256=digest.hexdigest())
        manifest = _Manifest(schema=1, runs=runs)
        archive.writestr(_entry(MANIFEST), json_bytes(manifest.to_json()))


def _open_regular(path: Path) -> IO[bytes]:
    """Open a file without following a link that may have taken its place."""
    flags = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(path, os.O_RDONLY | flags)
    return os.fdopen(descriptor, "rb")


def _entry(name: str) -> zipfile.ZipInfo:
    """Make an entry without time, owner or anything else that differs between machines."""
    entry = zipfile.ZipInfo(name, _NO_TIME)
    entry.create_system = 3
    entry.external_attr = (stat.S_IFREG | 0o644) << 16
    is_text = name.endswith(_TEXTS) or ".tfevents." in name
    entry.compress_type = zipfile.ZIP_DEFLATED if is_text else zipfile.ZIP_STORED
    return entry


def import_runs(archive: Path, runs_dir: Path) -> list[Path]:
    """Unpack the runs of an archive; they appear only once all of them are checked.

    Args:
        archive: a file that :func:`export_runs` should have written, but that may come from
            anywhere.
        runs_dir: directory for the runs; it is made if it is missing.

    Returns:
        The run directories.

    Raises:
        InputError: the file is no such archive or is damaged, or a run of the same id exists.
            Nothing is left behind.
    """
    try:
        with archive.open("rb") as file:
            _check_end(file)
            with zipfile.ZipFile(file) as unpacker:
                entries = _check_entries(unpacker.infolist())
                runs = _read_manifest(unpacker, entries)
                _check_room(runs_dir, runs)
                return _unpack(unpacker, runs, runs_dir)
    except FileNotFoundError as error:
        raise InputError(f"there is no {error.filename or archive}") from error
    except OSError as error:
        place = f" ({error.filename})" if error.filename else ""
        raise InputError(f"cannot import {archive}: {reason_of(error)}{place}") from error
    except (
        *(zipfile.BadZipFile, zlib.error, struct.error, EOFError),
        *(ValueError, NotImplementedError, RuntimeError),
    ) as error:
        reason = in_one_line(error)
        raise InputError(f"{archive} is not an archive of runs, or is damaged: {reason}") from error


def _check_end(file: IO[bytes]) -> None:
    """Check the zip's last record before anything relies on it.

    An archive of another layout, with a comment or with extensions for large files, is no export.
    """
    size = file.seek(0, os.SEEK_END)
    if size < _END.size:
        raise ValueError("it is too short")
    file.seek(max(0, size - _END.size - 20))
    tail = file.read()
    mark, disk, first_disk, here, count, length, start, comment = _END.unpack(tail[-_END.size :])
    if mark != b"PK\5\6" or tail[:4] == b"PK\6\7" or disk or first_disk or comment:
        raise ValueError("it is not a zip that an export wrote")
    if here != count or start + length + _END.size != size:
        raise ValueError("its directory is not where it should be")
    if count > MOST_FILES or length > _LARGEST_DIRECTORY:
        raise ValueError(f"it has {count:,} files and a directory of {length:,} bytes")


def _check_entries(entries: Sequence[zipfile.ZipInfo]) -> dict[str, zipfile.ZipInfo]:
    """Check every entry and return them by name."""
    by_name: dict[str, zipfile.ZipInfo] = {}
    folded: set[str] = set()
    for entry in entries:
        name = entry.orig_filename
        run_id, separator, inner = name.partition("/")
        is_known = bool(separator and _ID.fullmatch(run_id) and _FILE.fullmatch(inner))
        if not (is_known or name == MANIFEST):
            raise ValueError(f"it holds {name!r:.80}, which is not a file of a run")
        if name.casefold() in folded:
            raise ValueError(f"it holds {name} twice")
        if stat.S_IFMT(entry.external_attr >> 16) != stat.S_IFREG or entry.extra or entry.comment:
            raise ValueError(f"{name} is a link, a special file, or not what an export writes")
        if entry.flag_bits & _ODD_FLAGS or entry.compress_type not in (
            zipfile.ZIP_STORED,
            zipfile.ZIP_DEFLATED,
        ):
            raise ValueError(f"{name} is encrypted, or not compressed as an export does it")
        ratio = entry.file_size / max(entry.compress_size, 1)
        if entry.file_size > _SMALL and ratio > LARGEST_RATIO:
            raise ValueError(f"{name} would unpack to {ratio:,.0f} times its size")
        folded.add(name.casefold())
        by_name[name] = entry
    total = sum(entry.file_size for entry in entries)
    if total > LARGEST_TOTAL:
        raise ValueError(f"it would unpack to {total:,} bytes, more than {LARGEST_TOTAL:,}")
    return by_name


def _read_manifest(
    archive: zipfile.ZipFile, entries: Mapping[str, zipfile.ZipInfo]
) -> dict[str, dict[str, _File]]:
    """Read the manifest by run and file; check that exactly these files are in the archive."""
    entry = entries.get(MANIFEST)
    if entry is None or entry.file_size > LARGEST_DOCUMENT:
        raise ValueError(f"it has no {MANIFEST}, or one that is too large")
    try:
        runs = _Manifest.from_json(json.loads(archive.read(entry))).runs
    except ValueError as error:
        raise ValueError(f"its {MANIFEST} is not one that an export wrote: {error}") from error
    promised = {
        f"{run_id}/{name}": file for run_id, files in runs.items() for name, file in files.items()
    }
    if {MANIFEST, *promised} != set(entries):
        raise ValueError(f"its {MANIFEST} does not list the files that the archive holds")
    for name, file in promised.items():
        if file.size != entries[name].file_size:
            raise ValueError(f"{name} does not have the size that {MANIFEST} says")
    for run_id, files in runs.items():
        if not {RECORD_FILE, CONFIG_FILE} <= set(files):
            raise ValueError(f"run {run_id!r:.80} has no {RECORD_FILE} or no {CONFIG_FILE}")
    if not runs:
        raise ValueError("it holds no run")
    return runs


def _check_room(runs_dir: Path, runs: Mapping[str, Mapping[str, _File]]) -> None:
    for run_id in runs:
        if os.path.lexists(runs_dir / run_id):
            raise InputError(f"run {run_id} is already in {runs_dir}")
    existing = next(path for path in [runs_dir, *runs_dir.absolute().parents] if path.exists())
    total = sum(file.size for files in runs.values() for file in files.values())
    free = shutil.disk_usage(existing).free
    if total > free:
        raise InputError(
            f"it unpacks to {total:,} bytes, but {existing} has room for only {free:,}"
        )


def _unpack(
    archive: zipfile.ZipFile, runs: Mapping[str, Mapping[str, _File]], runs_dir: Path
) -> list[Path]:
    is_new = not runs_dir.exists()
    runs_dir.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=".orchid-import-", dir=runs_dir))
    moved: list[Path] = []
    try:
        for run_id, files in runs.items():
            for name, expected in files.items():
                _unpack_file(archive, f"{run_id}/{name}", expected, staging / run_id / name)
            _check_run(staging / run_id)
        for run_id in runs:
            place = runs_dir / run_id
            if os.path.lexists(place):  # it has appeared since the first check
                raise InputError(f"run {run_id} is already in {runs_dir}")
            (staging / run_id).rename(place)
            moved.append(place)
        sync_directory(runs_dir)
    except BaseException:
        for place in moved:
            place.rename(staging / place.name)
        shutil.rmtree(staging, ignore_errors=True)
        if is_new:
            with suppress(OSError):
                runs_dir.rmdir()
        raise
    staging.rmdir()
    return moved


def _check_run(path: Path) -> None:
    try:
        record = read_run(path).record
    except InputError as error:
        raise ValueError(str(error).replace(f"{path.parent}{os.sep}", "")) from error
    if record.id != path.name:
        raise ValueError(f"run {path.name} calls itself {record.id!r:.80}")


def _unpack_file(archive: zipfile.ZipFile, name: str, expected: _File, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    digest, left = hashlib.sha256(), expected.size
    with warnings.catch_warnings():
        # Two files in one place, of which Python 3.14 lets the second be read with a warning.
        warnings.simplefilter("error", UserWarning)
        try:
            source = archive.open(name)
        except UserWarning as error:
            raise ValueError(str(error)) from error
    with source, target.open("xb") as file:
        while chunk := source.read(min(_CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                break
            digest.update(chunk)
            file.write(chunk)
    if left or digest.hexdigest() != expected.sha256:
        raise ValueError(f"{name} is not what was exported: its checksum (sha256) does not fit")
