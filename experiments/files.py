"""Writing files so that a reader never meets half of one."""

import errno
import json
import os
import tempfile
from pathlib import Path
from typing import IO, Any

from orchid_uav.envs.notices import warn_once
from orchid_uav.experiments.errors import InputError

_NOT_OFFERED = {errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP}
"""How a file system says that it does not do this at all."""
_NOT_OF_DIRECTORIES = _NOT_OFFERED | {errno.EBADF, errno.EACCES, errno.EPERM}


def expanded(path: str | Path) -> Path:
    """The path with ``~`` replaced.

    Raises:
        InputError: there is no such user, or no text that libraries and JSON could hold.
    """
    try:
        os.fspath(path).encode()
        return Path(path).expanduser()
    except UnicodeEncodeError as error:
        shown = os.fsencode(path)
        raise InputError(f"{shown!r} is no path that is used here: it is not UTF-8") from error
    except RuntimeError as error:
        raise InputError(f"{path}: no home is known for that; give the path without '~'") from error


def write_atomically(path: Path, content: bytes) -> None:
    """Replace ``path`` in one step: temporary file beside it, fsync, rename."""
    descriptor, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
            sync_file(file, path.parent)
        share(Path(temporary))
        Path(temporary).replace(path)
        sync_directory(path.parent)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def share(path: Path) -> None:
    """Let everybody read a file of ``mkstemp``, whose 0600 would hide it from colleagues."""
    try:
        path.chmod(0o644)
    except OSError as error:  # shared folders of other systems have no such permissions
        warn_once("permissions", f"permissions cannot be set in {path.parent}: {error.strerror}")


def sync_file(file: IO[Any], directory: Path) -> None:
    """Have a file of a directory, open for writing, on the disk, if its file system does that."""
    file.flush()
    try:
        os.fsync(file.fileno())
    except OSError as error:
        _pass_over(error, _NOT_OFFERED, directory)


def sync_directory(directory: Path) -> None:
    """Have names that were made or changed in a directory on the disk, where systems allow it."""
    if os.name != "posix":
        return
    try:
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
    except OSError as error:
        _pass_over(error, _NOT_OF_DIRECTORIES, directory)


def _pass_over(error: OSError, refusals: set[int], directory: Path) -> None:
    if error.errno not in refusals:
        raise error
    warn_once(
        "sync",
        f"the file system of {directory} does not say when files are on the disk "
        f"({error.strerror}): after a power failure the latest ones may be missing",
    )


def json_bytes(document: Any) -> bytes:
    """A JSON document as it is written."""
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    return (text + "\n").encode()


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document atomically."""
    write_atomically(path, json_bytes(document))
