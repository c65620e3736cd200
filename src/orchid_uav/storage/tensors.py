"""Tensors in safetensors files that are checked before they are read."""

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from orchid_uav.storage.files import checksum_of_file

_LARGEST_HEADER = 2**20
_TYPES = {
    "BOOL": np.bool_,
    "U8": np.uint8,
    "I64": np.int64,
    "U64": np.uint64,
    "F16": np.float16,
    "F32": np.float32,
    "F64": np.float64,
}
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
Tensors = dict[str, NDArray[Any]]


class TensorSpec(NamedTuple):
    """Shape and type of a tensor."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @classmethod
    def of(cls, array: NDArray[Any]) -> "TensorSpec":
        """The shape and type of an array."""
        return cls(tuple(array.shape), array.dtype)

    @property
    def size(self) -> int:
        """In bytes."""
        size = self.dtype.itemsize
        for length in self.shape:  # in Python's integers, which do not overflow
            size *= int(length)
        return size


def largest_file(specs: Mapping[str, TensorSpec]) -> int:
    """Bytes that a safetensors file of these tensors has at most."""
    return sum(spec.size for spec in specs.values()) + _LARGEST_HEADER + 8


def read_tensors(path: Path, specs: Mapping[str, TensorSpec], checksum: str) -> Tensors:
    """The tensors of a safetensors file, after all that can be was checked.

    In this order: size, checksum, header's length, names, shapes, types; then memory is taken.

    Args:
        path: the file.
        specs: what it must hold, by name.
        checksum: its SHA-256.

    Raises:
        OSError: it cannot be read.
        ValueError: it is anything else.
    """
    if checksum_of_file(path, largest_file(specs)) != checksum:
        raise ValueError(f"{path} is not what was written: its checksum (sha256) does not fit")
    with path.open("rb") as file:
        prefix = file.read(8)
    if len(prefix) < 8 or struct.unpack("<Q", prefix)[0] > _LARGEST_HEADER:
        raise ValueError(f"{path} is not a safetensors file: its header is too long or missing")
    try:
        with safe_open(path, framework="numpy") as file:
            if set(file.keys()) != set(specs):
                raise ValueError(f"{path} holds other tensors than it should")
            for name, spec in specs.items():
                header = file.get_slice(name)
                found = tuple(header.get_shape()), header.get_dtype()
                if found != (spec.shape, _NAMES[spec.dtype]):
                    raise ValueError(
                        f"{path}: {name} is {found[1]} of shape {found[0]}, "
                        f"not {_NAMES[spec.dtype]} of shape {spec.shape}"
                    )
            return {name: file.get_tensor(name) for name in specs}
    except SafetensorError as error:
        raise ValueError(f"{path} is not a readable safetensors file: {error}") from error
