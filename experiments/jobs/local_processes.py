"""Runs jobs side by side, each in its own process, and says how each ended."""

import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.interruption import Interruption, Raising, interruption_requests
from orchid_uav.experiments.jobs.child_process import (
    Child,
    describe_end,
    readable_exit_codes,
    shortened,
    usable_cores,
)
from orchid_uav.experiments.jobs.workload import Job, Workload

INTERRUPTED_CODE = 130
"""Exit code of a job that was asked to stop and has saved what it had."""

_TRIES = 2
_SECONDS_BETWEEN_LOOKS = 0.1
_SECONDS_BETWEEN_UPDATES = 0.5
_SECONDS_TO_SAVE = 30.0

Status = Literal["completed", "failed", "interrupted", "not started"]


@dataclass(frozen=True)
class JobEnd:
    """How a job ended."""

    job: Job
    status: Status
    code: int | None
    """The exit code of its last process, or minus the signal that killed it; None without one."""
    tries: int
    seconds: float
    """Duration of all tries together."""
    error: str | None
    """Why it did not complete, in at most 300 characters without control codes."""


class Overview(NamedTuple):
    """The progress of all jobs."""

    fraction_done: float
    """Share of the whole cost; a job that has ended counts in full, even if it failed."""
    seconds_left: float | None
    """None if it cannot be estimated yet."""
    running: Sequence[tuple[Job, float]]
    """The running jobs, each with its finished fraction, in the order in which they began."""
    completed: int
    failed: int


class JobProgress:
    """Shows the progress of jobs; this base class shows nothing.

    An exception in a hook stops all jobs and is passed on.
    """

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """The jobs are about to begin, with ``processes`` of them at once."""

    def update(self, overview: Overview) -> None:
        """The current progress; called twice a second."""

    def restarted(self, job: Job, error: str) -> None:
        """A job was killed and is run once more."""

    def stopping(self, running: int) -> None:
        """A stop was requested; this many jobs are saving what they have."""

    def ended(self, end: JobEnd) -> None:
        """A job has ended, or will not be started any more."""

    def end(self) -> None:
        """No job is running any more; called after an exception as well."""


class Executor(Protocol):
    """Runs jobs somewhere."""

    @property
    def was_stopped(self) -> bool:
        """Whether a stop was asked for while the last jobs were running, even by the very end."""

    def run(self, jobs: Sequence[Job], progress: JobProgress) -> list[JobEnd]:
        """Run jobs of different names and return how each ended, in the order given."""


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
        if processes < 1:
            raise InputError(f"{processes} jobs at once: give 1 or more")
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

    def run(self, jobs: Sequence[Job], progress: JobProgress) -> list[JobEnd]:
        """Run jobs, begun in the order given, and return how each ended.

        Raises:
            ValueError: two jobs have the same name.
        """
        if len({job.name for job in jobs}) < len(jobs):
            raise ValueError("two jobs have the same name")
        with interruption_requests(Raising.NEVER, b"") as self._stop, readable_exit_codes():
            return _LocalRun(jobs, self.processes, progress, self._stop).run()


@dataclass
class _LocalRun:
    """One run of some jobs."""

    jobs: Sequence[Job]
    processes: int
    progress: JobProgress
    stop: Interruption

    def __post_init__(self) -> None:
        count = len(self.jobs)
        self._waiting = deque(range(count))
        self._children: dict[int, Child] = {}
        self._ends: dict[int, JobEnd] = {}
        self._tries = [0] * count
        self._seconds = [0.0] * count
        self._last_codes: list[int | None] = [None] * count
        self._workload = Workload(self.jobs, self.processes)
        self._next_update_s = 0.0
        self._is_stopping = False

    def run(self) -> list[JobEnd]:
        """Run all jobs and return how each ended."""
        self.progress.begin(self.jobs, min(self.processes, len(self.jobs)))
        try:
            while self._waiting or self._children:
                self._heed_stop_requests()
                while self._may_start():
                    self._start(self._waiting.popleft())
                self._show()
                time.sleep(_SECONDS_BETWEEN_LOOKS)
                self._collect()
        finally:
            try:
                self._leave_none_running()
            finally:
                self.progress.end()
        return [self._ends[index] for index in range(len(self.jobs))]

    def _heed_stop_requests(self) -> None:
        if not self.stop.requested:
            return
        for child in self._children.values():
            child.stop()
        if self.stop.is_urgent:
            for child in self._children.values():
                child.kill()
        waiting, self._waiting = self._waiting, deque()
        if not self._is_stopping:
            self._is_stopping = True
            self.progress.stopping(len(self._children))
        for index in waiting:
            self._end(index, "interrupted" if self._tries[index] else "not started", None)

    def _may_start(self) -> bool:
        is_one_free = len(self._children) < self.processes
        return bool(self._waiting) and is_one_free and not self.stop.requested

    def _start(self, index: int) -> None:
        job = self.jobs[index]
        self._tries[index] += 1
        try:
            self._children[index] = Child.start(job.command, job.log)
        except (OSError, ValueError) as error:
            self._end(index, "failed", shortened(f"cannot be started: {error}"))

    def _collect(self) -> None:
        for index, child in list(self._children.items()):
            code = child.process.poll()
            if code is not None:
                del self._children[index]
                child.close()
                self._seconds[index] += time.monotonic() - child.began_s
                self._last_codes[index] = code
                self._settle(index, code, describe_end(code, child.log, child.log_start))

    def _settle(self, index: int, code: int, error: str) -> None:
        was_killed = code < 0
        if code == 0:
            self._end(index, "completed", None)
        elif self.stop.requested and (was_killed or code == INTERRUPTED_CODE):
            self._end(index, "interrupted", error if was_killed else None)
        elif was_killed and self._tries[index] < _TRIES:
            self._waiting.appendleft(index)
            self.progress.restarted(self.jobs[index], error)
        else:
            self._end(index, "failed", error)

    def _end(self, index: int, status: Status, error: str | None) -> None:
        self._workload.look([index])
        if status in {"completed", "failed"}:
            self._workload.end(index, status == "completed")
        end = JobEnd(
            self.jobs[index],
            status,
            self._last_codes[index],
            self._tries[index],
            self._seconds[index],
            error,
        )
        self._ends[index] = end
        self.progress.ended(end)

    def _show(self) -> None:
        now_s = time.monotonic()
        if now_s < self._next_update_s:
            return
        self._next_update_s = now_s + _SECONDS_BETWEEN_UPDATES
        running = list(self._children)
        self._workload.look(running)
        seconds = list(self._seconds)
        for index, child in self._children.items():
            seconds[index] += now_s - child.began_s
        statuses = [end.status for end in self._ends.values()]
        left_s = self._workload.seconds_left(running, seconds)
        self.progress.update(
            Overview(
                fraction_done=self._workload.fraction_done,
                seconds_left=None if self._is_stopping else left_s,
                running=[(self.jobs[index], self._workload.fractions[index]) for index in running],
                completed=statuses.count("completed"),
                failed=statuses.count("failed"),
            )
        )

    def _leave_none_running(self) -> None:
        """End jobs that an exception cut off: let them save what they have, then kill the rest."""
        children = self._children.values()
        try:
            for child in children:
                child.stop()
            end_s = time.monotonic() + _SECONDS_TO_SAVE
            while any(child.process.poll() is None for child in children):
                if self.stop.is_urgent or time.monotonic() > end_s:
                    break
                time.sleep(_SECONDS_BETWEEN_LOOKS)
        finally:
            for child in children:
                child.kill()
            for child in children:
                child.close()
