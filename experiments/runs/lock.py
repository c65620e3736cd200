"""A lock that lets one process write a run, and that ends with it, however it ends."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

from filelock import FileLock, Timeout

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.provenance import boot_id
from orchid_uav.notices import reason_of, warn_once

LOCK_FILE = ".lock"
_PATIENCE_S = 2.0  # `is_alive` takes the lock for an instant
_LINUX_ENOTSUPP = 524  # Lustre's error, for which `errno` has no name
_NO_LOCKS = {errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK, _LINUX_ENOTSUPP}
"""Errors of file systems without locks."""


class RunHeldError(InputError):
    """Another process has the right to write the run."""


class RunLock:
    """The right to write a run directory, held by this process until it is released or dies.

    On a file system without locks the right is assumed, with a warning.

    Args:
        directory: the run's directory.
        patience_s: how long to wait for another process that has the lock; None for an instant.
        gives_up: asked again and again whether to wait no longer.

    Raises:
        RunHeldError: another process holds the lock.
        InputError: the directory cannot be written.
    """

    def __init__(
        self,
        directory: Path,
        patience_s: float | None = None,
        gives_up: Callable[[], bool] = lambda: False,
    ) -> None:
        if not directory.is_dir():  # `FileLock` would make it
            raise InputError(f"cannot write to {directory}: no such directory")
        self._lock = _lock_of(directory)
        try:
            self._lock.acquire(
                timeout=_PATIENCE_S if patience_s is None else patience_s, cancel_check=gives_up
            )
        except Timeout as error:
            raise RunHeldError(
                f"run {directory.name} is being written by another process"
            ) from error
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                reason = reason_of(error)
                raise InputError(f"cannot write to {directory}: {reason}") from error
            warn_once(
                "locks",
                f"the file system of {directory} has no locks ({error.strerror}): nothing keeps "
                "two processes from writing one run, so see to it yourself",
            )

    def release(self) -> None:
        """Release the lock."""
        self._lock.release()


def is_alive(directory: Path, pid: int | None = None, boot: str | None = None) -> bool:
    """Whether the process that writes a run is still alive.

    Args:
        directory: the run's directory.
        pid: the id of that process, from the run's record.
        boot: the result of ``boot_id`` when that process began.
    """
    path = directory / LOCK_FILE
    if not path.exists():
        return False
    lock = _lock_of(directory)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        return True
    except OSError:  # a read-only directory, or a file system without locks
        return boot == boot_id() and pid is not None and _has_process(pid)
    lock.release()
    return False


def _lock_of(directory: Path) -> FileLock:
    # On a file system without locks, filelock would by default use the mere existence of the file
    # as a lock, which would outlive its process.
    return FileLock(directory / LOCK_FILE, fallback_to_soft=False)


def _has_process(pid: int) -> bool:
    if os.name == "nt":  # on Windows signal 0 is ctrl-C
        return True
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (OSError, OverflowError):
        return False
    return True
