"""Compiled functions whose cache notices every change of the equations they are made of."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from numba import njit


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


SOURCES = _digest_of_sources()
"""Default of an unused argument of the compiled functions. numba stores compiled code under the
types of the arguments, which include defaults, and under the file of the function alone: without
this, an equation changed in another file would go on unchanged in the cache."""


def compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Compile with a cache on disk where there is a place for one."""
    try:
        return njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # no place for a cache can be written: every process compiles anew
        return njit(error_model="numpy")(function)
