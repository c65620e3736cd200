"""Compiled functions whose cache notices every change of the equations they are made of.

The cache is a convenience. Whatever is wrong with it, the functions are compiled without.
"""

import functools
import hashlib
import inspect
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, ClassVar, TypeVar

import numpy as np
from numba import njit
from numba.core import config
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    NullCache,
)
from numba.core.dispatcher import Dispatcher
from numba.extending import register_jitable

from orchid_uav.notices import note_once, warn_once


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    parts = ("*.py", "knowledge/*.py", "plans/*.py")
    for path in sorted(path for part in parts for path in folder.glob(part)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


Inner = TypeVar("Inner", bound=Callable[..., Any])
SOURCES = _digest_of_sources()
"""Default of an unused argument of the compiled functions. numba stores compiled code under the
types of the arguments, which include defaults, and under the file of the function alone: without
this, an equation changed in another file would go on unchanged in the cache."""


def compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Compile at the first call, with a cache on disk where there is a place for one."""
    dispatcher = njit(error_model="numpy", nogil=True)(function)
    if isinstance(dispatcher, Dispatcher):  # not with NUMBA_DISABLE_JIT
        try:
            dispatcher._cache = _Cache(function)  # type: ignore[attr-defined]
        except RuntimeError:  # what numba raises where no folder for it can be written
            dispatcher._cache = _NoCache(function)  # type: ignore[attr-defined]
    return dispatcher


def inlined(function: Inner) -> Inner:
    """Compile a function that compiled functions call, without counting references to arrays.

    numba would count those of every array, part of an array and tuple of arrays that is passed on,
    which took a quarter of the time of a step. Whoever calls a :func:`compiled` function holds its
    arrays as long as it runs. In return such a function can make no arrays, which numba refuses to
    compile ("NRT required but not enabled"): its caller hands it memory.
    """
    jitted: Inner = njit(error_model="numpy", forceinline=True, _nrt=False)(function)
    return jitted


@functools.lru_cache(maxsize=64)
def specialised(
    function: Callable[..., None], own: Callable[..., Any], digest: str | None
) -> Callable[..., None]:
    """A compiled function whose last argument but ``sources`` is a function of the user's own.

    Args:
        function: what :func:`compiled` gave; its own cache is left alone.
        own: a function that numba has compiled.
        digest: of ``own``, see :func:`digest_of`; without one, no code is kept on disk.
    """
    body = getattr(function, "py_func", function)  # itself, with NUMBA_DISABLE_JIT
    uncached = njit(error_model="numpy", nogil=True)(body)

    @register_jitable
    def call_own(*arguments: Any) -> Any:  # code with a compiled function as a value is not kept
        return own(*arguments)

    def with_own(*arguments: Any) -> None:
        uncached(*arguments, call_own)

    dispatcher = njit(error_model="numpy", nogil=True)(with_own)
    if isinstance(dispatcher, Dispatcher):
        try:
            if digest is None:
                dispatcher._cache = _Unkept()  # type: ignore[attr-defined]
            else:
                kind = f"{body.__module__}.{body.__qualname__}"
                dispatcher._cache = _OwnCache(with_own, (kind, digest, SOURCES))  # type: ignore[attr-defined]
        except RuntimeError:
            dispatcher._cache = _NoCache(with_own)  # type: ignore[attr-defined]
    return dispatcher


def digest_of(function: Callable[..., Any]) -> str | None:
    """A digest of all that the machine code of a function depends on, None if that is unknown.

    That is its bytecode, defaults, and what it closes over or names in its module: numbers, texts,
    tuples of these, arrays, numpy, math, and functions of which the same holds. What is read
    through another module, or by a function inside it, could change unseen.
    """
    digest = hashlib.sha256()
    seen: list[FunctionType] = []

    def add(value: Any) -> bool:
        value = getattr(value, "py_func", value)
        if isinstance(value, FunctionType):
            if value in seen:
                digest.update(b"@%d" % seen.index(value))
                return True
            seen.append(value)
            if value.__module__ not in sys.modules:  # numba looks for it there
                return False
            code, read = value.__code__, inspect.getclosurevars(value)
            digest.update(code.co_code)
            names = (value.__module__, code.co_names, code.co_varnames, code.co_freevars)
            named = sorted({**read.globals, **read.nonlocals}.items())
            return all(map(add, (names, code.co_consts, value.__defaults__, *named)))
        if isinstance(value, tuple):
            digest.update(b"(%d" % len(value))
            return all(map(add, value))
        if isinstance(value, np.ndarray) and not value.dtype.hasobject:
            digest.update(f"{value.dtype} {value.shape} ".encode() + value.tobytes())
            return True
        plain = bool | int | float | complex | str | bytes | np.generic | None
        is_known = value is np or value is math or isinstance(value, plain)
        digest.update(f"{type(value).__name__} {value!r}\0".encode() if is_known else b"")
        return is_known

    return digest.hexdigest() if add(function) else None


class _CheckedFile(IndexDataCacheFile):
    """Files of a cache whose code is of the key that was asked for, and as it was written.

    numba writes the index first: of a process that died then, or had no room for more, an index is
    left that leads to code of earlier days. And a flipped bit in machine code still is some code.
    """

    def save(self, key: Any, data: Any) -> None:
        """Write code with its key."""
        super().save(key, (key, data))

    def load(self, key: Any) -> Any:
        """The code of a key, None if there is none.

        Raises:
            Exception: of any kind, for damaged files.
        """
        its_key, data = super().load(key) or (None, None)
        return data if its_key == key else None

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()  # readers of pickles stop before it

    def _load_data(self, name: str) -> Any:
        content = Path(self._data_path(name)).read_bytes()
        size = len(content) - hashlib.sha256().digest_size
        if size < 0 or hashlib.sha256(content[:size]).digest() != content[size:]:
            raise ValueError("a checksum does not fit")
        return super()._load_data(name)


class _Places(CompileResultCacheImpl):
    """Folders that numba chooses from, without one that would be made in the current directory."""

    _locator_classes: ClassVar[list[type]] = [
        place
        for place in CompileResultCacheImpl._locator_classes
        # Its name begins with an underscore in older versions.
        if place.__name__.lstrip("_") != "UserWideCacheLocator" or os.path.expanduser("~") != "~"  # noqa: PTH111
    ]


class _Cache(FunctionCache):
    """numba's cache of a function, in which no damage and no lack of room is an error.

    Raises:
        RuntimeError: no folder for it can be written.
    """

    _impl_class = _Places

    def __init__(self, function: Callable[..., None]) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _CheckedFile(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for types of arguments, None where it has to be compiled."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # damaged pickles raise whatever their bytes mean
            found = None
            self._begin_anew(error)
        if found is None:
            _announce("once on this machine" if self._enabled else "at every start")
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function."""
        try:
            super().save_overload(sig, data)
        except Exception as error:
            self._go_without(error)

    def _begin_anew(self, damage: Exception) -> None:
        try:
            self.flush()
        except Exception as error:
            self._go_without(error)
        else:
            warn_once(
                "cache",
                f"compiled code in {self._cache_path} was damaged, and is replaced: "
                f"{_described(damage)}",
            )

    def _go_without(self, error: Exception) -> None:
        self.disable()
        _warn_of_no_cache(self._cache_path, _described(error))


class _OwnCache(_Cache):
    """The cache of a function that was specialised for a function of the user's, under its key.

    numba's key would hold the function itself, which is another one in every process.
    """

    def __init__(self, function: Callable[..., None], key: tuple[str, ...]) -> None:
        super().__init__(function)
        self._key = key

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return sig, codegen.magic_tuple(), self._key


class _Unkept(NullCache):
    """The cache of a function specialised for one that may change unseen: it keeps nothing."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Say that the code has to be compiled at every start."""
        _announce("at every start, as the given function reads what cannot be told from its code")


class _NoCache(NullCache):
    """The cache of a function for which there is no place on disk."""

    def __init__(self, function: Callable[..., None]) -> None:
        beside = Path(function.__code__.co_filename).parent / "__pycache__"
        self._refused = config.CACHE_DIR or str(beside)

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """Say that the code has to be compiled at every start."""
        _warn_of_no_cache(self._refused, "it cannot be written")
        _announce("at every start")


def _warn_of_no_cache(folder: str, reason: str) -> None:
    warn_once(
        "cache",
        f"compiled code cannot be kept in {folder}, so that every start compiles it: {reason}; "
        "NUMBA_CACHE_DIR names another folder",
    )


def _announce(how_often: str) -> None:
    note_once("compilation", f"compiling the simulator, ten seconds to a minute, {how_often}")


def _described(error: Exception) -> str:
    reason = (isinstance(error, OSError) and error.strerror) or str(error)
    return f"{type(error).__name__}: {reason}" if reason else type(error).__name__
