"""Worlds of a batch over several cores.

Compiled functions release Python's lock and touch no world but those that they are given, so plain
threads do. A world's numbers do not depend on how many there are.
"""

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Part = TypeVar("Part")

LEAST_LINKS = 10_000
"""Links of UAVs and users whose slot takes some 50 microseconds, worth waking a thread for."""


def usable_cores() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def parts_of(worlds: int, links: int, threads: int) -> list[slice]:
    """Ranges of worlds, as equal as possible, one for each thread that is worth it.

    Args:
        worlds: number of worlds.
        links: UAVs times users of a world.
        threads: parts at most.
    """
    parts = max(1, min(threads, worlds, worlds * links // LEAST_LINKS))
    ends = [worlds * part // parts for part in range(parts + 1)]
    return [slice(first, last) for first, last in itertools.pairwise(ends)]


def run_each(function: Callable[[Part], None], parts: Sequence[Part]) -> None:
    """Call a function with every part, side by side; the last part in this thread."""
    *others, last = parts
    waiting = [_pool(os.getpid()).submit(function, part) for part in others]
    try:
        function(last)
    finally:
        for one in waiting:
            one.result()


@cache
def _pool(process: int) -> ThreadPoolExecutor:
    """The threads of this process; those of its parent do not exist in a forked one."""
    return ThreadPoolExecutor(usable_cores(), thread_name_prefix="orchid-worlds")
