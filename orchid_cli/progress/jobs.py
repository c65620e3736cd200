"""How far jobs are, on terminals and in logs."""

import time
from collections.abc import Sequence
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.experiments.jobs.local_processes import Job, JobEnd, JobProgress, Overview

_SECONDS_BETWEEN_LINES = 5.0
_MOST_NAMES = 8


def job_progress(out: Console, quiet: bool) -> JobProgress:
    """The display that suits a console."""
    if quiet:
        return SilentJobProgress()
    return LiveJobProgress(out) if has_cursor(out) else LineJobProgress(out)


def duration_text(seconds: float) -> str:
    """Hours, minutes and seconds: ``1:02:03``."""
    return str(timedelta(seconds=round(seconds)))


def _restart_text(job: Job, error: str) -> str:
    return f"{job.name}: {error}; it is run once more and goes on where it stopped"


def _failure_text(end: JobEnd) -> str:
    return f"{end.job.name}: failed after {duration_text(end.seconds)}: {end.error} ({end.job.log})"


def _stopping_text(running: int) -> str:
    jobs = "1 job saves what it has" if running == 1 else f"{running} jobs save what they have"
    return f"stopping: {jobs}; once more stops at once" if running else "stopping"


class SilentJobProgress:
    """Shows nothing."""

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Nothing."""

    def update(self, overview: Overview) -> None:
        """Nothing."""

    def restarted(self, job: Job, error: str) -> None:
        """Nothing."""

    def stopping(self, running: int) -> None:
        """Nothing."""

    def ended(self, end: JobEnd) -> None:
        """Nothing."""

    def end(self) -> None:
        """Nothing."""


class LineJobProgress:
    """A line every few seconds and one for every end, for logs."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Say how many jobs there are."""
        self._count, self._ended = len(jobs), 0
        self._last_line_s = time.monotonic()
        print_line(self._out, f"{len(jobs)} jobs, {processes} at once")

    def update(self, overview: Overview) -> None:
        """Print a line if one is due."""
        now_s = time.monotonic()
        if now_s - self._last_line_s < _SECONDS_BETWEEN_LINES:
            return
        self._last_line_s = now_s
        names = [f"{job.name} {share:.0%}" for job, share in overview.running[:_MOST_NAMES]]
        if len(overview.running) > _MOST_NAMES:
            names.append("...")
        left_s = overview.seconds_left
        left = "" if left_s is None else f"; about {duration_text(left_s)} left"
        print_line(self._out, f"{overview.share:.0%}: {', '.join(names)}{left}")

    def restarted(self, job: Job, error: str) -> None:
        """Say so."""
        print_line(self._out, _restart_text(job, error))

    def stopping(self, running: int) -> None:
        """Say so."""
        print_line(self._out, _stopping_text(running))

    def ended(self, end: JobEnd) -> None:
        """Say how."""
        if end.status == "not started":
            return
        self._ended += 1
        text = f"{end.job.name}: {end.status} after {duration_text(end.seconds)}"
        text = _failure_text(end) if end.status == "failed" else text
        print_line(self._out, f"{text}; {self._ended} of {self._count}")

    def end(self) -> None:
        """Nothing more to say."""


class LiveJobProgress:
    """A bar for all jobs over one for each that is running, for terminals."""

    def __init__(self, out: Console) -> None:
        self._out = out
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=out,
            expand=True,
            transient=True,
            refresh_per_second=2,
        )
        self._rows: dict[str, TaskID] = {}

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Open the display."""
        self._count = len(jobs)
        self._all = self._progress.add_task(f"0 of {self._count}", total=1.0, left="")
        self._progress.start()

    def update(self, overview: Overview) -> None:
        """Move on."""
        failed = f", {overview.failed} failed" if overview.failed else ""
        left_s = overview.seconds_left
        self._progress.update(
            self._all,
            completed=overview.share,
            description=f"{overview.completed} of {self._count}{failed}",
            left="" if left_s is None else f"{duration_text(left_s)} left",
        )
        for job, share in overview.running:
            if job.name not in self._rows:
                self._rows[job.name] = self._progress.add_task(job.name, total=1.0, left="")
            self._progress.update(self._rows[job.name], completed=share)

    def restarted(self, job: Job, error: str) -> None:
        """Say so, above the bars."""
        print_line(self._out, _restart_text(job, error))

    def stopping(self, running: int) -> None:
        """Say so, above the bars."""
        print_line(self._out, _stopping_text(running))

    def ended(self, end: JobEnd) -> None:
        """Close its bar, and say what went wrong if something did."""
        row = self._rows.pop(end.job.name, None)
        if row is not None:
            self._progress.remove_task(row)
        if end.status == "failed":
            print_line(self._out, _failure_text(end))

    def end(self) -> None:
        """Close the display."""
        self._progress.stop()
