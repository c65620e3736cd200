"""Runs jobs on this machine, each in its own process."""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from orchid_uav.envs.threads import usable_cores
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.interruption import Interruption, Raising, interruption_requests
from orchid_uav.experiments.jobs.child_process import (
    Child,
    describe_end,
    readable_exit_codes,
)
from orchid_uav.experiments.jobs.executor import JobEnd, JobProgress, JobRun, TryEnd
from orchid_uav.experiments.jobs.workload import Job

_SECONDS_BETWEEN_LOOKS = 0.1
_SECONDS_BETWEEN_UPDATES = 0.5


class LocalProcesses:
    """Runs jobs on this machine, each in its own process.

    A job that is killed by a signal is run once more. Signals to this process are requests, as for
    a training run: the first one asks all jobs to stop (SIGTERM) and waits for them, an urgent one
    kills them. Outside the main thread signals are left alone.

    No process is left running, whatever happens. That is why signals raise no exception here: it
    could come between the start of a process and the note of it, or while all are being killed,
    and leave one running. If this process itself is killed, the jobs notice by the end of their
    standard input.

    Args:
        processes: how many jobs run at once; reduced to the cores that this process may use.

    Raises:
        InputError: ``processes`` is less than 1.
    """

    def __init__(self, processes: int) -> None:
        check_count(processes)
        cores = usable_cores()
        self.processes = min(processes, cores)
        """The most jobs that run at once."""
        self.note: str | None = None
        """Why ``processes`` is less than was asked for; None if it is not."""
        if self.processes < processes:
            self.note = (
                f"{self.processes} at once instead of {processes}: "
                f"this process may use {cores} core{'s' if cores > 1 else ''}"
            )
        self._stop = Interruption()

    @property
    def was_stopped(self) -> bool:
        """Whether a stop was asked for while the last jobs were running, even by the very end."""
        return self._stop.requested

    def check(self, folder: Path) -> None:
        """Do nothing: what this process can write its children can write."""

    def run(self, jobs: Sequence[Job], progress: JobProgress) -> list[JobEnd]:
        """Run jobs, begun in the order given, and return how each ended.

        Raises:
            ValueError: two jobs have the same name.
        """
        with interruption_requests(Raising.NEVER, b"") as self._stop, readable_exit_codes():
            return JobRun(jobs, _Children(self.processes), progress, self._stop).run()

    def close(self) -> None:
        """Do nothing: no process outlives :meth:`run`."""


def check_count(processes: int) -> None:
    """Check how many jobs shall run at once.

    Raises:
        InputError: less than 1.
    """
    if processes < 1:
        raise InputError(f"{processes} jobs at once: give 1 or more")


class _Children:
    """Jobs as children of this process, at most ``processes`` at once."""

    most_losses = 0

    def __init__(self, processes: int) -> None:
        self._processes = processes
        self._children: dict[str, Child] = {}
        self.seconds_between_updates = _SECONDS_BETWEEN_UPDATES

    def capacity(self) -> int:
        return self._processes

    def start(self, job: Job) -> None:
        self._children[job.name] = Child.start(job.command, job.log)

    def collect(self) -> Iterator[TryEnd]:
        time.sleep(_SECONDS_BETWEEN_LOOKS)
        for name, child in list(self._children.items()):
            code = child.process.poll()
            if code is not None:
                del self._children[name]
                child.close()
                yield TryEnd(name, code, describe_end(code, child.log, child.log_start))

    def stop(self) -> None:
        for child in self._children.values():
            child.stop()

    def kill(self) -> None:
        for child in self._children.values():
            child.kill()

    def close(self) -> None:
        for child in self._children.values():
            child.close()
