"""What runs on the machines of a Ray cluster; Ray's workers import this module."""

import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from orchid_uav.experiments.jobs.child_process import Child, describe_end, shortened
from orchid_uav.experiments.jobs.executor import INTERRUPTED_CODE
from orchid_uav.experiments.provenance import describe_host, describe_versions
from orchid_uav.extras import import_extra
from orchid_uav.notices import reason_of

TOKEN_FILE, LOCK_FILE = "token", "lock"
_FAILED_CODE = 1
_SECONDS_BETWEEN_LOOKS = 0.1
_SECONDS_TO_SAVE = 30.0


def mark_of(log: Path) -> Path:
    """The file that holds the id of the node on which a job runs.

    Ray tells at once which nodes it has lost, but the tasks on one that was merely cut off seem to
    run for minutes more.
    """
    return log.with_suffix(".node")


def run_command(
    command: Sequence[str], log: str, drivers_python: str, node: str | None = None
) -> tuple[int, str]:
    """Run a job's process to its end; a Ray task.

    A process of its own has the main thread, which signals need, and nothing of what Ray's worker
    has loaded. It notices by the end of its standard input if the worker is killed. Ray cancels a
    task by KeyboardInterrupt: the process is then asked to save and end.

    Args:
        command: the command; this machine's Python takes the place of the driver's.
        log: the file that its output is appended to, on a file system that all machines share.
        drivers_python: the Python that the command was made for.
        node: the id of this node; by default Ray is asked.

    Returns:
        Its exit code, or minus the signal that killed it; and why it ended, for people.
    """
    host, path = platform.node(), Path(log)
    if not path.parent.is_dir():  # `Child.start` would make it, on this machine alone
        return _FAILED_CODE, shortened(f"{host} does not see {path.parent}")
    own = [sys.executable, *command[1:]] if command[0] == drivers_python else list(command)
    child = None
    try:
        mark_of(path).write_text(_own_node() if node is None else node)
        child = Child.start(own, path)
        # Not `wait`: KeyboardInterrupt comes without a signal, and so only between two calls.
        while child.process.poll() is None:
            time.sleep(_SECONDS_BETWEEN_LOOKS)
    except KeyboardInterrupt:
        if child is None:
            return INTERRUPTED_CODE, ""
        child.stop()
        _wait_while_it_saves(child)
    except (OSError, ValueError) as error:
        return _FAILED_CODE, shortened(f"cannot be started on {host}: {error}")
    child.kill()
    child.close()
    code = child.process.returncode
    return code, describe_end(code, path, child.log_start)


def _own_node() -> str:
    return import_extra("ray").get_runtime_context().get_node_id()


def _wait_while_it_saves(child: Child) -> None:
    end_s = time.monotonic() + _SECONDS_TO_SAVE
    while child.process.poll() is None and time.monotonic() < end_s:
        time.sleep(_SECONDS_BETWEEN_LOOKS)


def look(folder: str, name: str) -> dict[str, Any]:
    """Tell what this machine sees of a directory; a Ray task.

    Args:
        folder: a directory in which the driver has written a token and holds a lock.
        name: the file to write into it.

    Returns:
        ``host``, ``processor`` and ``versions`` of this machine; ``token``, as it reads it;
        ``fault``, why it cannot write there, or None; ``sees_lock``, whether it sees that the lock
        is held.
    """
    directory = Path(folder)
    found: dict[str, Any] = {
        "host": platform.node(),
        "processor": describe_host()["processor"],
        "versions": describe_versions(),
        "token": None,
        "fault": None,
        "sees_lock": False,
    }
    try:
        found["token"] = (directory / TOKEN_FILE).read_text()
        (directory / name).write_text(found["token"])
    except (OSError, ValueError) as error:
        found["fault"] = reason_of(error) if isinstance(error, OSError) else str(error)
        return found
    lock = FileLock(directory / LOCK_FILE, fallback_to_soft=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        found["sees_lock"] = True
    except OSError:  # a file system without locks
        pass
    else:
        lock.release()
    return found
