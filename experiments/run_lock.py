"""One process a run: a lock that ends with its process, however that ends."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.provenance import boot_id

LOCK_FILE = ".lock"
_PATIENCE_S = 2.0  # a look at the run takes the lock for an instant


class RunLock:
    """The right to write a run directory, held by this process until it is released or dies.

    Args:
        directory: of the run.

    Raises:
        InputError: another process has it, or the directory cannot be written.
    """

    def __init__(self, directory: Path) -> None:
        if not directory.is_dir():  # FileLock would make it
            raise InputError(f"cannot write to {directory}: no such directory")
        self._lock = FileLock(directory / LOCK_FILE)
        try:
            self._lock.acquire(timeout=_PATIENCE_S)
        except Timeout as error:
            raise InputError(f"run {directory.name} is being written by another process") from error
        except OSError as error:
            raise InputError(f"cannot write to {directory}: {error.strerror or error}") from error

    def release(self) -> None:
        """Let others write."""
        self._lock.release()


def is_alive(directory: Path, record: Mapping[str, Any]) -> bool:
    """Whether the process that writes a run is still there.

    Args:
        directory: of the run.
        record: its ``run.json``, with "pid" and "boot_id".
    """
    path = directory / LOCK_FILE
    if not path.exists():
        return False
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    except (OSError, NotImplementedError):  # a directory that can only be read
        return _has_process(record)
    lock.release()
    return False


def _has_process(record: Mapping[str, Any]) -> bool:
    if record.get("boot_id") != boot_id() or not isinstance(record.get("pid"), int):
        return False
    try:
        os.kill(record["pid"], 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        return False
    return True
