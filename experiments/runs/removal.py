"""Deletes run directories, and nothing else."""

import os
import secrets
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs.lock import RunLock
from orchid_uav.experiments.runs.records import RECORD_FILE, find_run, read_record, status_of
from orchid_uav.notices import reason_of

_HIDDEN = ".orchid-deleted-"
"""Names of directories that are being removed begin with this; no listing shows them."""


@dataclass(frozen=True)
class Removal:
    """A run that may be deleted."""

    path: Path
    """The run's path in the directory of runs; links in the latter are resolved."""
    status: str
    """The status that users see, or "damaged"."""
    size: int
    """Bytes that deleting it frees."""
    link_target: str | None
    """The target if the run directory is a link, of which only the link is removed; else None."""
    _identity: tuple[int, int]


def plan_removal(names: Sequence[str], runs_dir: Path) -> list[Removal]:
    """Return what deleting runs would remove; nothing is removed yet.

    Args:
        names: ids, unique beginnings of ids, or paths.
        runs_dir: the directory of the runs.

    Raises:
        InputError: one of them is running, is no run, or lies elsewhere.
    """
    removals = {}
    for name in names:
        path = _place_of(name, runs_dir)
        removals[path] = _removal_of(path)
    return list(removals.values())


def _place_of(name: str, runs_dir: Path) -> Path:
    """The run's path; its last part is not followed if it is a link."""
    path = find_run(name, runs_dir)
    if path.name in ("", ".."):
        path = path.resolve()
    home = runs_dir.resolve()
    if path.parent.resolve() != home:
        raise InputError(
            f"{path} does not lie in {runs_dir}: give the directory of its runs with --runs-dir"
        )
    return home / path.name


def _removal_of(path: Path) -> Removal:
    seen = path.lstat()
    if not os.path.lexists(path / RECORD_FILE):
        raise InputError(f"{path} is not a run directory: it has no {RECORD_FILE}")
    try:
        status: str = status_of(path, read_record(path))
    except InputError:
        status = "damaged"
    if status == "running":
        raise InputError(f"run {path.name} is running: stop it first")
    is_link = path.is_symlink()
    return Removal(
        path,
        status,
        size=seen.st_size if is_link else _size_of(path),
        link_target=str(path.readlink()) if is_link else None,
        _identity=(seen.st_dev, seen.st_ino),
    )


def _size_of(directory: Path) -> int:
    return sum(
        (Path(folder) / name).lstat().st_size
        for folder, _, names in os.walk(directory)
        for name in names
    )


def remove(removals: Iterable[Removal]) -> list[str]:
    """Delete runs; each disappears in one step, as it is renamed before its files are deleted.

    Links are removed and never followed. An interruption leaves every run whole or gone.

    Returns:
        The ids of the deleted runs.

    Raises:
        InputError: since the plan was made, a run was replaced or a process began to write it.
        RunFailedError: a run cannot be removed.
    """
    deleted = []
    for removal in removals:
        _finish_earlier(removal.path.parent)
        try:
            _remove(removal)
        except OSError as error:
            raise RunFailedError(f"cannot delete {removal.path}: {reason_of(error)}") from error
        deleted.append(removal.path.name)
    return deleted


def _remove(removal: Removal) -> None:
    path = removal.path
    lock = None if removal.link_target else RunLock(path)
    try:
        hidden = path.with_name(_HIDDEN + secrets.token_hex(8))
        path.rename(hidden)
        seen = hidden.lstat()
        if (seen.st_dev, seen.st_ino) != removal._identity:
            hidden.rename(path)
            raise InputError(f"{path} was replaced while it was looked at: nothing was deleted")
        try:
            _take_apart(hidden)
        except KeyboardInterrupt:
            _take_apart(hidden)
            raise
    finally:
        if lock is not None:
            lock.release()


def _take_apart(hidden: Path) -> None:
    if hidden.is_symlink():
        hidden.unlink()
    elif hidden.exists():
        shutil.rmtree(hidden)  # this follows no links


def _finish_earlier(runs_dir: Path) -> None:
    """Remove what a killed deletion left."""
    for path in runs_dir.glob(f"{_HIDDEN}*"):
        if not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
