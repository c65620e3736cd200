"""What runs jobs side by side, wherever they run, and says how each ended."""

import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.jobs.child_process import shortened
from orchid_uav.experiments.jobs.workload import Job, Workload

INTERRUPTED_CODE = 130
"""Exit code of a job that was asked to stop and has saved what it had."""

_MOST_KILLS = 2
"""So often a job may be killed by a signal: what kills it twice is likely to be the job itself."""
_SECONDS_TO_SAVE = 30.0

JobStatus = Literal["completed", "failed", "interrupted", "not started"]


@dataclass(frozen=True)
class JobEnd:
    """How a job ended."""

    job: Job
    status: JobStatus
    code: int | None
    """The exit code of its last process, or minus the signal that killed it; None if there was no
    process, or if its machine was lost."""
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
        """The current progress; called about twice a second."""

    def restarted(self, job: Job, error: str) -> None:
        """A job was killed, or its machine was lost, and it is run once more."""

    def stopping(self, running: int) -> None:
        """A stop was requested; this many jobs are saving what they have."""

    def ended(self, end: JobEnd) -> None:
        """A job has ended, or will not be started any more."""

    def end(self) -> None:
        """No job is running any more; called after an exception as well."""


class Executor(Protocol):
    """Runs jobs somewhere."""

    @property
    def processes(self) -> int:
        """The most jobs that run at once."""

    @property
    def note(self) -> str | None:
        """What the user should know of where jobs run, such as why there are fewer at once."""

    @property
    def was_stopped(self) -> bool:
        """Whether a stop was asked for while the last jobs were running, even by the very end."""

    def check(self, folder: Path) -> None:
        """Make sure that jobs can read and write below a directory, which need not exist yet.

        Raises:
            InputError: they cannot.
        """

    def run(self, jobs: Sequence[Job], progress: JobProgress) -> list[JobEnd]:
        """Run jobs of different names, begun in the order given, and return how each ended.

        Raises:
            ValueError: two jobs have the same name.
        """

    def close(self) -> None:
        """Give back what the executor holds; it runs no jobs any more."""


class TryEnd(NamedTuple):
    """How one try of a job ended."""

    job: str
    """The job's name."""
    code: int | None
    """The exit code, or minus the signal that killed it; None if its machine was lost."""
    error: str
    """Why it ended, in at most 300 characters; only shown if the job did not complete."""


class Place(Protocol):
    """Where jobs run, each in its own process. Nothing here waits for the end of a job."""

    seconds_between_updates: float
    """How often jobs are asked how far they are."""
    most_losses: int
    """So often the machine of a job may be lost."""

    def capacity(self) -> int:
        """How many jobs may run at once; it may change."""

    def start(self, job: Job) -> None:
        """Start a job.

        Raises:
            OSError: there is no such program, or the log cannot be written.
            ValueError: no system can start such a command.
        """

    def collect(self) -> Iterable[TryEnd]:
        """Wait a moment, and return the tries that have ended since the last call."""

    def stop(self) -> None:
        """Ask the running jobs to save what they have and end; asked once, however often called."""

    def kill(self) -> None:
        """Kill the running jobs."""

    def close(self) -> None:
        """Wait for the end of jobs that were killed."""


@dataclass
class JobRun:
    """One run of some jobs at a place."""

    jobs: Sequence[Job]
    place: Place
    progress: JobProgress
    stop: Interruption

    def __post_init__(self) -> None:
        count = len(self.jobs)
        self._indices = {job.name: index for index, job in enumerate(self.jobs)}
        if len(self._indices) < count:
            raise ValueError("two jobs have the same name")
        self._waiting = deque(range(count))
        self._began_s: dict[int, float] = {}
        """When the running jobs began, by index."""
        self._ends: dict[int, JobEnd] = {}
        self._tries = [0] * count
        self._kills = [0] * count
        self._losses = [0] * count
        self._seconds = [0.0] * count
        self._last_codes: list[int | None] = [None] * count
        self._workload = Workload(self.jobs, max(self.place.capacity(), 1))
        self._next_update_s = 0.0
        self._is_stopping = False

    def run(self) -> list[JobEnd]:
        """Run all jobs and return how each ended."""
        self.progress.begin(self.jobs, min(self.place.capacity(), len(self.jobs)))
        try:
            while self._waiting or self._began_s:
                self._heed_stop_requests()
                while self._may_start():
                    self._start(self._waiting.popleft())
                self._show()
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
        self.place.stop()
        if self.stop.is_urgent:
            self.place.kill()
        waiting, self._waiting = self._waiting, deque()
        if not self._is_stopping:
            self._is_stopping = True
            self.progress.stopping(len(self._began_s))
        for index in waiting:
            self._end(index, "interrupted" if self._tries[index] else "not started", None)

    def _may_start(self) -> bool:
        is_one_free = len(self._began_s) < self.place.capacity()
        return bool(self._waiting) and is_one_free and not self.stop.requested

    def _start(self, index: int) -> None:
        self._tries[index] += 1
        try:
            self.place.start(self.jobs[index])
        except (OSError, ValueError) as error:
            self._end(index, "failed", shortened(f"cannot be started: {error}"))
        else:
            self._began_s[index] = time.monotonic()

    def _collect(self) -> None:
        for one in self.place.collect():
            index = self._indices[one.job]
            self._seconds[index] += time.monotonic() - self._began_s.pop(index)
            self._last_codes[index] = one.code
            self._settle(index, one.code, one.error)

    def _settle(self, index: int, code: int | None, error: str) -> None:
        was_lost = code is None
        was_killed = code is not None and code < 0
        self._losses[index] += was_lost
        self._kills[index] += was_killed
        if code == 0:
            self._end(index, "completed", None)
        elif self.stop.requested and (was_lost or was_killed or code == INTERRUPTED_CODE):
            self._end(index, "interrupted", error if was_lost or was_killed else None)
        elif (was_killed and self._kills[index] < _MOST_KILLS) or (
            was_lost and self._losses[index] <= self.place.most_losses
        ):
            self._waiting.appendleft(index)
            self.progress.restarted(self.jobs[index], error)
        else:
            self._end(index, "failed", error)

    def _end(self, index: int, status: JobStatus, error: str | None) -> None:
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
        self._next_update_s = now_s + self.place.seconds_between_updates
        running = list(self._began_s)
        self._workload.look(running)
        seconds = list(self._seconds)
        for index, began_s in self._began_s.items():
            seconds[index] += now_s - began_s
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
        try:
            self.place.stop()
            end_s = time.monotonic() + _SECONDS_TO_SAVE
            while self._began_s and not self.stop.is_urgent and time.monotonic() < end_s:
                for one in self.place.collect():
                    del self._began_s[self._indices[one.job]]
        finally:
            self.place.kill()
            self.place.close()
