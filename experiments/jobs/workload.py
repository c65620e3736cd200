"""Jobs, how much of their work is done, and how long the rest will take."""

import heapq
import math
import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchid_uav.storage.files import remove_leftovers, write_json

_FIRST_ESTIMATE = 0.1
"""Share of an average job; less finished work does not show the pace."""


@dataclass(frozen=True)
class Job:
    """A process to run; run again, it goes on where it stopped.

    Raises:
        ValueError: the command is empty, or the cost is not positive.
    """

    name: str
    command: tuple[str, ...]
    log: Path
    """The file that the process's output is appended to."""
    fraction_done: Callable[[], float]
    """Tells how much of the job is done, 0 to 1. Asked twice a second; its errors are ignored."""
    cost: float = 1.0
    """How long the whole job takes, relative to others."""

    def __post_init__(self) -> None:
        if not self.command:
            raise ValueError(f"job '{self.name}' has an empty command")
        if not 0.0 < self.cost < math.inf:
            raise ValueError(f"job '{self.name}' costs {self.cost}: give a positive finite number")


def job_from_order(
    name: str,
    module: str,
    order: Mapping[str, Any],
    folder: Path,
    fraction_done: Callable[[], float],
    cost: float,
) -> Job:
    """Write an order down, and describe the process that carries it out.

    Args:
        name: of the job; the order and the log are called so.
        module: the process is ``python -m module ORDER``.
        order: a JSON object; a path in it is written relative to ``folder``, since a folder above
            may have a name that is not valid text for JSON.
        folder: where order and log are kept.
        fraction_done: see :class:`Job`.
        cost: see :class:`Job`.
    """
    folder = folder.absolute()  # the process may run on another machine
    path = folder / f"{name}.json"
    remove_leftovers(folder, [path.name])
    write_json(
        path,
        {
            key: os.path.relpath(value.resolve(), folder.resolve())
            if isinstance(value, Path)
            else value
            for key, value in order.items()
        },
    )
    return Job(
        name=name,
        # -P: a statistics.py in the user's working directory must not replace the library's.
        command=(sys.executable, "-P", "-m", module, str(path)),
        log=folder / f"{name}.log",
        fraction_done=fraction_done,
        cost=cost,
    )


def path_in_order(path: str, order: Path) -> Path:
    """A path that :func:`job_from_order` has written into the file ``order``."""
    return (order.parent / path).resolve()


def last_end(waiting: Iterable[float], busy: Sequence[float]) -> float:
    """The time until the last job ends if each goes to the process that is free first.

    At the end some processes have nothing left to do, and the last job may run alone.

    Args:
        waiting: how long each waiting job takes, in the order in which they begin.
        busy: how long each process still needs for its current job.
    """
    free = sorted(busy)
    for cost in waiting:
        heapq.heapreplace(free, free[0] + cost)
    return max(free)


def hours_text(minutes: Sequence[float], processes: int) -> str:
    """How long jobs take with so many of them at once, in words: ``40 min`` or ``3.5 hours``."""
    total = last_end(minutes, [0.0] * processes) if minutes else 0.0
    return f"{total / 60.0:.1f} hours" if total >= 60.0 else f"{math.ceil(total)} min"


class Workload:
    """How much of all jobs is done, and how long the rest will take.

    Work done before this object was made counts as done, but is left out of the pace.

    Args:
        jobs: all jobs, in the order in which they begin.
        processes: how many run at once.
    """

    def __init__(self, jobs: Sequence[Job], processes: int) -> None:
        self._jobs = jobs
        self._processes = processes
        self.fractions = [_asked(job, otherwise=0.0) for job in jobs]
        """How much of each job is done, 0 to 1."""
        self._first_fractions = tuple(self.fractions)
        self._ended: set[int] = set()

    def look(self, indices: Iterable[int]) -> None:
        """Ask these jobs how far they are."""
        for index in indices:
            self.fractions[index] = _asked(self._jobs[index], otherwise=self.fractions[index])

    def end(self, index: int, is_complete: bool) -> None:
        """Count a job as ended."""
        self._ended.add(index)
        if is_complete:
            self.fractions[index] = 1.0

    @property
    def fraction_done(self) -> float:
        """How much of all jobs is done or given up, as a share of the cost, 0 to 1."""
        return 1.0 - sum(self._left()) / self._total if self._jobs else 1.0

    def seconds_left(self, running: Sequence[int], seconds: Sequence[float]) -> float | None:
        """Seconds until all jobs have ended; None if they cannot be estimated yet.

        Args:
            running: indices of the jobs that are running.
            seconds: for how long each job has been running, (jobs,).
        """
        left = self._left()
        if not any(left):
            return 0.0
        work = busy_s = 0.0
        for job, now, first, job_s in zip(
            self._jobs, self.fractions, self._first_fractions, seconds, strict=True
        ):
            if first < 1.0:  # the time of a job that was already complete tells nothing
                work += job.cost * max(now - first, 0.0)
                busy_s += job_s
        if work <= 0.0 or work < _FIRST_ESTIMATE * self._total / len(self._jobs):
            return None
        busy = [left[index] for index in running]
        busy += [0.0] * (self._processes - len(busy))
        waiting = (cost for index, cost in enumerate(left) if index not in running)
        return last_end(waiting, busy) * busy_s / work

    @property
    def _total(self) -> float:
        return sum(job.cost for job in self._jobs)

    def _left(self) -> list[float]:
        """The part of each job's cost that is left."""
        return [
            0.0 if index in self._ended else job.cost * (1.0 - self.fractions[index])
            for index, job in enumerate(self._jobs)
        ]


def _asked(job: Job, otherwise: float) -> float:
    try:
        fraction_done = float(job.fraction_done())
    except Exception:  # it may read a file that is just being written
        return otherwise
    return otherwise if math.isnan(fraction_done) else min(max(fraction_done, 0.0), 1.0)
