"""Measure where a program spends its time, by wrapping a few of its functions."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import wraps
from typing import Any
from unittest import mock


class Stopwatch:
    """Seconds spent in some functions, separately for each path of calls between them."""

    def __init__(self) -> None:
        self._seconds: dict[tuple[str, ...], float] = defaultdict(float)
        self._path: tuple[str, ...] = ()

    @contextmanager
    def watching(self, functions: Mapping[str, tuple[Any, str]]) -> Iterator[None]:
        """Within the block, time calls of ``getattr(owner, name)`` under each label."""
        with ExitStack() as patches:
            for label, (owner, name) in functions.items():
                timed = self._timed(label, getattr(owner, name))
                patches.enter_context(mock.patch.object(owner, name, timed))
            yield

    def _timed(self, label: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def timed(*arguments: Any, **keywords: Any) -> Any:
            outer = self._path
            self._path = (*outer, label)
            begin_s = time.perf_counter()
            try:
                return function(*arguments, **keywords)
            finally:
                self._seconds[self._path] += time.perf_counter() - begin_s
                self._path = outer

        return timed

    def exclusive_s(self) -> dict[tuple[str, ...], float]:
        """Seconds by path of labels, without the time of watched functions called from there."""
        own = dict(self._seconds)
        for path, seconds in self._seconds.items():
            if path[:-1] in own:
                own[path[:-1]] -= seconds
        return own
