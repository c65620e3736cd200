"""Files that may be damaged or hostile: nothing is unpickled, nothing large read unasked.

JSON documents carry their own checksum, a *seal*; files of tensors are safetensors whose names,
shapes and types are known beforehand. What is wrong with a file is a ValueError, never a traceback
from deep inside a parser, and never numbers that differ from those written.
"""

import errno
import hashlib
import json
import math
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from orchid_uav.notices import warn_once

SEAL = "seal"
"""Key of a JSON document's own checksum."""
LARGEST_DOCUMENT = 4 * 2**20
"""Bytes of a JSON document at most."""
_DEEPEST_DOCUMENT = 32
"""Levels of lists and objects; what is written as it was read must not exhaust the stack."""
_CHUNK = 2**20
_NOT_OFFERED = {errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP}
"""How a file system says that it does not do this at all."""
_NOT_OF_DIRECTORIES = _NOT_OFFERED | {errno.EBADF, errno.EACCES, errno.EPERM}


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with its checksum.

    Raises:
        ValueError: it holds a number that is not finite.
    """
    content = {key: value for key, value in document.items() if key != SEAL}
    return content | {SEAL: _checksum(content)}


def _checksum(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def read_document(
    path: Path, largest: int = LARGEST_DOCUMENT, checksum: str | None = None
) -> dict[str, Any]:
    """A JSON object that may come from anywhere.

    Args:
        path: the file.
        largest: bytes that it may have.
        checksum: its SHA-256, if it is known.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no regular file, too large, not what it was, or no JSON object of finite
            numbers.
    """
    content = read_bytes(path, largest)
    if checksum is not None and hashlib.sha256(content).hexdigest() != checksum:
        raise ValueError(f"{path} is not what was written: its checksum (sha256) does not fit")
    try:
        text = content.decode("utf-8")
        document = json.loads(text, parse_constant=_refuse)
        if isinstance(document, dict):
            _check_content(document, text)
            return document
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not valid JSON: {error}") from error
    raise ValueError(f"{path} is not a JSON object")


def read_sealed(path: Path, largest: int = LARGEST_DOCUMENT) -> dict[str, Any]:
    """A JSON object whose seal is unbroken.

    Raises:
        OSError: it cannot be read.
        ValueError: as :func:`read_document`, or it is not what was written.
    """
    document = read_document(path, largest)
    try:
        unbroken = document.get(SEAL) == sealed(document)[SEAL]
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} cannot be checked: {error}") from error
    if not unbroken:
        raise ValueError(f"{path} is not what was written: its seal does not fit")
    return document


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant}")


def _check_content(document: Any, text: str) -> None:
    """Raise ValueError if writing a document again would give something else."""
    if "\\u" in text:
        json.dumps(document, ensure_ascii=False).encode()  # half of a surrogate pair is no text
    level = [document]
    for _ in range(_DEEPEST_DOCUMENT):
        inner = []
        for one in level:
            for value in one.values() if isinstance(one, dict) else one:
                if isinstance(value, dict | list):
                    inner.append(value)
                elif isinstance(value, float) and not math.isfinite(value):
                    raise ValueError("it holds a number that is too large")
        level = inner
        if not level:
            return
    raise ValueError(f"it is nested deeper than {_DEEPEST_DOCUMENT} levels")


@contextmanager
def _regular_file(path: Path, largest: int) -> Iterator[tuple[IO[bytes], int]]:
    """An open regular file that may be read, and its size."""
    _check_size(path, path.stat(), largest)  # opening a pipe would wait for ever
    with path.open("rb") as file:
        # Another process may have replaced what was looked at: the size is that of what is open.
        yield file, _check_size(path, os.fstat(file.fileno()), largest)


def _check_size(path: Path, status: os.stat_result, largest: int) -> int:
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"{path} is not a regular file")
    if status.st_size > largest:
        raise ValueError(
            f"{path} has {status.st_size:,} bytes, more than the {largest:,} it may have"
        )
    return status.st_size


def read_bytes(path: Path, largest: int) -> bytes:
    """A regular file of at most so many bytes.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no regular file, or too large.
    """
    with _regular_file(path, largest) as (file, size):
        return file.read(size)  # Python takes memory for all that is asked for


def checksum_of_file(path: Path, largest: int) -> str:
    """SHA-256 of a regular file of at most so many bytes.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no regular file, or too large.
    """
    digest = hashlib.sha256()
    with _regular_file(path, largest) as (file, _size):
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


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


def leftovers(directory: Path, names: Iterable[str]) -> list[Path]:
    """What a process that died while it wrote files of these names has left beside them."""
    wanted = "|".join(map(re.escape, names))
    pattern = re.compile(rf"\.({wanted})[.-][a-z0-9_]{{8}}")  # as `tempfile` ends names
    return [path for path in directory.iterdir() if pattern.fullmatch(path.name)]


def remove_leftovers(directory: Path, names: Iterable[str]) -> None:
    """Remove what :func:`leftovers` finds; only for who alone writes these files.

    Raises:
        OSError: something cannot be removed.
    """
    for path in leftovers(directory, names):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


@contextmanager
def appearing_when_complete(target: Path, force: bool) -> Iterator[IO[bytes]]:
    """A file to write, which gets its name in the end, or none if that raises.

    Args:
        target: its name.
        force: whether a file of that name is replaced.

    Raises:
        OSError: it cannot be written, or the name was taken meanwhile.
    """
    descriptor, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    temporary = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as file:
            yield file
            sync_file(file, target.parent)
        share(temporary)
        if force:
            temporary.replace(target)
        else:
            _rename_without_replacing(temporary, target)
        sync_directory(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _rename_without_replacing(source: Path, target: Path) -> None:
    try:
        target.hardlink_to(source)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        if os.path.lexists(target):
            raise FileExistsError(17, "File exists", str(target)) from None
        source.rename(target)


def share(path: Path) -> None:
    """Give a file of ``mkstemp`` ordinary permissions: its 0600 would hide it from colleagues."""
    try:
        path.chmod(0o644)
    except OSError as error:  # shared folders of other systems have no such permissions
        warn_once("permissions", f"permissions cannot be set in {path.parent}: {error.strerror}")


def sync_file(file: IO[Any], directory: Path) -> None:
    """Write an open file of a directory through to the disk, if the file system supports it."""
    file.flush()
    try:
        os.fsync(file.fileno())
    except OSError as error:
        _pass_over(error, _NOT_OFFERED, directory)


def sync_directory(directory: Path) -> None:
    """Write changed names of a directory through to the disk, where the system allows it."""
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
