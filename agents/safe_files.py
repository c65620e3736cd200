"""Files that may be damaged or hostile: nothing is unpickled, nothing large read unasked.

JSON documents carry their own checksum, a *seal*; files of tensors are safetensors whose names,
shapes and types are known beforehand. What is wrong with a file is a ValueError, never a traceback
from deep inside a parser, and never numbers that differ from those written.
"""

import hashlib
import json
import math
import stat
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

SEAL = "seal"
"""Key of a JSON document's own checksum."""
LARGEST_DOCUMENT = 4 * 2**20
"""Bytes of a JSON document at most."""
_LARGEST_HEADER = 2**20
_DEEPEST_DOCUMENT = 32
"""Levels of lists and objects; what is written as it was read must not exhaust the stack."""
_CHUNK = 2**20
_TYPES = {
    "BOOL": np.bool_,
    "U8": np.uint8,
    "I64": np.int64,
    "U64": np.uint64,
    "F32": np.float32,
    "F64": np.float64,
}
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}

Tensors = dict[str, NDArray[Any]]


class TensorKind(NamedTuple):
    """Shape and type of a tensor."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @classmethod
    def of(cls, array: NDArray[Any]) -> "TensorKind":
        """The kind of an array."""
        return cls(tuple(array.shape), array.dtype)

    @property
    def size(self) -> int:
        """In bytes."""
        size = self.dtype.itemsize
        for length in self.shape:  # in Python's integers, which do not overflow
            size *= int(length)
        return size


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
    """Raise ValueError if a document could not be written again as it was read."""
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


def _check_size(path: Path, largest: int) -> int:
    """The size of a regular file that may be read."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):  # opening a pipe would wait for ever
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
    size = _check_size(path, largest)
    with path.open("rb") as file:
        return file.read(size)  # Python takes memory for all that is asked for


def checksum_of_file(path: Path, largest: int) -> str:
    """SHA-256 of a regular file of at most so many bytes.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no regular file, or too large.
    """
    _check_size(path, largest)
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def largest_file(kinds: Mapping[str, TensorKind]) -> int:
    """Bytes that a safetensors file of these tensors has at most."""
    return sum(kind.size for kind in kinds.values()) + _LARGEST_HEADER + 8


def read_tensors(path: Path, kinds: Mapping[str, TensorKind], checksum: str) -> Tensors:
    """The tensors of a safetensors file, after all that can be was checked.

    In this order: size, checksum, header's length, names, shapes, types; then memory is taken.

    Args:
        path: the file.
        kinds: what it must hold, by name.
        checksum: its SHA-256.

    Raises:
        OSError: it cannot be read.
        ValueError: it is anything else.
    """
    if checksum_of_file(path, largest_file(kinds)) != checksum:
        raise ValueError(f"{path} is not what was written: its checksum (sha256) does not fit")
    with path.open("rb") as file:
        prefix = file.read(8)
    if len(prefix) < 8 or struct.unpack("<Q", prefix)[0] > _LARGEST_HEADER:
        raise ValueError(f"{path} is not a safetensors file: its header is too long or missing")
    try:
        with safe_open(path, framework="numpy") as file:
            if set(file.keys()) != set(kinds):
                raise ValueError(f"{path} holds other tensors than it should")
            for name, kind in kinds.items():
                header = file.get_slice(name)
                found = tuple(header.get_shape()), header.get_dtype()
                if found != (kind.shape, _NAMES[kind.dtype]):
                    raise ValueError(
                        f"{path}: {name} is {found[1]} of shape {found[0]}, "
                        f"not {_NAMES[kind.dtype]} of shape {kind.shape}"
                    )
            return {name: file.get_tensor(name) for name in kinds}
    except SafetensorError as error:
        raise ValueError(f"{path} is not a readable safetensors file: {error}") from error
