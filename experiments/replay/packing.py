"""Arrays as short texts inside a JSON document, which a browser unpacks by itself.

The bytes of an array, little-endian, are compressed by zlib and written in base64;
``DecompressionStream("deflate")`` takes that apart again. What changes little from one slot to the
next is written as its first state and differences.
"""

import base64
import math
import zlib
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.storage.documents import Document

Kind = Literal["uint8", "int8", "int16", "int32", "float32"]
_WHOLE: tuple[Kind, ...] = ("int8", "int16", "int32")
_LIMIT = 2**30
"""Of the numbers that are written, in either direction, so that differences fit into int32."""
_LARGEST = 2**28
"""Bytes that an array may unpack to."""


class Packed(Document):
    """An array of numbers.

    Unpack: base64, then zlib, then read as ``type``, little-endian, in C order. With ``series`` the
    bytes are those of states along the first axis, of which each has ``size`` numbers, the product
    of ``shape[1:]``: first the first state, ``size`` numbers of int32; then for number 0 of a state
    all its differences from one state to the next, ``shape[0] - 1`` numbers of ``type``; then those
    of number 1, and so on. ::

        for (let number = 0; number < size; number++) {
          let value = first[number];
          numbers[number] = value;
          for (let state = 1; state < shape[0]; state++) {
            value += differences[number * (shape[0] - 1) + state - 1];
            numbers[state * size + number] = value;
          }
        }

    The value is then number × ``scale``; or where there is ``ratio`` instead, 0 for the number 0
    and ``ratio`` to the power of the number for others; or the number itself if there is neither.
    """

    packed: str
    type: Kind
    shape: list[int]
    series: bool = False
    scale: float | None = None
    ratio: float | None = None

    def numbers(self) -> NDArray[np.generic]:
        """The numbers as they were packed, without scale or ratio.

        Raises:
            ValueError: the text is not what an array of this shape and type is packed to.
        """
        kind, size = np.dtype(self.type).newbyteorder("<"), math.prod(self.shape)
        if min(self.shape, default=1) < 0 or size > _LARGEST // kind.itemsize:
            raise ValueError(f"an array cannot have the shape {self.shape}")
        first = math.prod(self.shape[1:]) if self.series else 0
        expected = size * kind.itemsize + first * (4 - kind.itemsize)
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(base64.b64decode(self.packed, validate=True), expected + 1)
        if len(content) != expected:
            raise ValueError(f"an array of {self.shape} has not the {expected} bytes that it needs")
        if not self.series:
            return np.frombuffer(content, kind).reshape(self.shape)
        begin = np.frombuffer(content[: 4 * first], "<i4").astype(np.int64)
        steps = np.frombuffer(content[4 * first :], kind).astype(np.int64)
        steps = steps.reshape(first, max(self.shape[0] - 1, 0))
        all_states = np.concatenate([begin[:, None], steps], axis=1)
        return np.cumsum(all_states, axis=1).T.reshape(self.shape).astype(np.int32)

    def values(self) -> NDArray[np.float64]:
        """The values, in float64."""
        numbers = self.numbers().astype(np.float64)
        if self.ratio is not None:
            return np.where(numbers == 0.0, 0.0, np.power(self.ratio, numbers))
        return numbers * (1.0 if self.scale is None else self.scale)


def pack(values: ArrayLike, kind: Kind) -> Packed:
    """Pack an array of any shape as it is, in the given type.

    Raises:
        ValueError: the type cannot hold the values.
    """
    given = np.asarray(values)
    with np.errstate(over="ignore", invalid="ignore"):
        content = given.astype(np.dtype(kind).newbyteorder("<"))
    if kind != "float32" and not np.array_equal(content, given):
        raise ValueError(f"the values do not fit into {kind}")
    return Packed(packed=_text(content.tobytes()), type=kind, shape=list(given.shape))


def pack_states(values: ArrayLike, scale: float) -> Packed:
    """Pack states along the first axis, each value within ``scale`` / 2 of what it was.

    Errors do not add up from state to state. The type is the shortest that holds the differences.

    Raises:
        ValueError: there is no state, or a value is not finite or beyond 2**30 scales.
    """
    return _differences(np.asarray(values, np.float64) / scale, scale=scale)


def pack_magnitudes(values: ArrayLike, ratio: float) -> Packed:
    """Pack states of values from 0 up, each within a factor of √``ratio`` of what it was.

    Values from 0 to 1 become 0.

    Raises:
        ValueError: there is no state, or a value is not finite.
    """
    given = np.asarray(values, np.float64)
    if not np.isfinite(given).all():
        raise ValueError("a value is not finite")
    powers = np.log(np.maximum(given, 1.0)) / math.log(ratio)
    # One above 1 by less than half a step keeps being above 0.
    return _differences(np.where(given > 1.0, np.maximum(powers, 1.0), 0.0), ratio=ratio)


def _differences(numbers: NDArray[np.float64], **meaning: float) -> Packed:
    if not len(numbers):
        raise ValueError("there is no state to pack")
    if not (np.abs(numbers) <= _LIMIT).all():  # NaN compares false
        raise ValueError("a value is not finite, or too large for its scale")
    states = np.rint(numbers).astype(np.int64)
    steps = np.diff(states, axis=0)
    kind = next(one for one in _WHOLE if _fit(steps, one))
    # Number by number, not state by state: what changes alike then stands side by side.
    series = steps.reshape(len(steps), math.prod(states.shape[1:])).T
    content = states[0].astype("<i4").tobytes()
    content += series.astype(np.dtype(kind).newbyteorder("<")).tobytes()
    shape = list(states.shape)
    return Packed(packed=_text(content), type=kind, shape=shape, series=True, **meaning)


def _fit(steps: NDArray[np.int64], kind: Kind) -> bool:
    limits = np.iinfo(kind)
    return not steps.size or (steps.min() >= limits.min and steps.max() <= limits.max)


def _text(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode("ascii")
