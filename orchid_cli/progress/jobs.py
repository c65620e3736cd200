"""The progress of jobs, on terminals and in logs."""

from collections.abc import Sequence
from datetime import timedelta

from rich.console import Console
from rich.progress import TaskID, TextColumn

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.cli.progress.displays import Pace, bars
from orchid_uav.experiments.jobs.executor import JobEnd, JobProgress, Overview
from orchid_uav.experiments.jobs.workload import Job

_MOST_NAMES = 8


def job_progress(out: Console, quiet: bool) -> JobProgress:
    """The display that suits a console."""
    if quiet:
        return JobProgress()
    return LiveJobProgress(out) if has_cursor(out) else LineJobProgress(out)


def duration_text(seconds: float) -> str:
    """Hours, minutes and seconds: ``1:02:03``."""
    return str(timedelta(seconds=round(seconds)))


class _Display(JobProgress):
    """What both displays print; on a terminal it appears above the bars."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Count the jobs."""
        self._count = len(jobs)

    def restarted(self, job: Job, error: str) -> None:
        """Print that a job is run once more, and why."""
        print_line(
            self._out, f"{job.name}: {error}; it is run once more and continues where it stopped"
        )

    def stopping(self, running: int) -> None:
        """Print that a stop was asked for, and what it waits for."""
        jobs = "1 job saves what it has" if running == 1 else f"{running} jobs save what they have"
        what = f": {jobs}; Ctrl-C once more stops at once" if running else ""
        print_line(self._out, f"stopping{what}")


def _end_text(end: JobEnd) -> str:
    error = f": {end.error} ({end.job.log})" if end.status == "failed" else ""
    return f"{end.job.name}: {end.status} after {duration_text(end.seconds)}{error}"


class LineJobProgress(_Display):
    """For logs: a line every few seconds, and one for every job that ends."""

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Print how many jobs there are."""
        super().begin(jobs, processes)
        self._ended = 0
        self._pace = Pace()
        print_line(self._out, f"{len(jobs)} jobs, {processes} at once")

    def update(self, overview: Overview) -> None:
        """Print a line if one is due."""
        if not self._pace.is_due():
            return
        names = [f"{job.name} {done:.0%}" for job, done in overview.running[:_MOST_NAMES]]
        if len(overview.running) > _MOST_NAMES:
            names.append("...")
        left_s = overview.seconds_left
        left = "" if left_s is None else f"; about {duration_text(left_s)} left"
        print_line(self._out, f"{overview.fraction_done:.0%}: {', '.join(names)}{left}")

    def ended(self, end: JobEnd) -> None:
        """Print how the job ended."""
        if end.status != "not started":
            self._ended += 1
            print_line(self._out, f"{_end_text(end)}; {self._ended} of {self._count}")


class LiveJobProgress(_Display):
    """For terminals: a bar for all jobs, and below it one for each running job."""

    def __init__(self, out: Console) -> None:
        super().__init__(out)
        self._progress = bars(
            out,
            TextColumn("{task.fields[left]}"),
            before=(TextColumn("{task.description}", markup=False),),
            transient=True,
            refresh_per_second=2,
        )
        self._rows: dict[str, TaskID] = {}

    def begin(self, jobs: Sequence[Job], processes: int) -> None:
        """Open the display."""
        super().begin(jobs, processes)
        self._all = self._progress.add_task(f"0 of {self._count}", total=1.0, left="")
        self._progress.start()

    def update(self, overview: Overview) -> None:
        """Move on."""
        failed = f", {overview.failed} failed" if overview.failed else ""
        left_s = overview.seconds_left
        self._progress.update(
            self._all,
            completed=overview.fraction_done,
            description=f"{overview.completed} of {self._count}{failed}",
            left="" if left_s is None else f"{duration_text(left_s)} left",
        )
        for job, fraction_done in overview.running:
            if job.name not in self._rows:
                self._rows[job.name] = self._progress.add_task(job.name, total=1.0, left="")
            self._progress.update(self._rows[job.name], completed=fraction_done)

    def ended(self, end: JobEnd) -> None:
        """Close the job's bar, and print what went wrong if it failed."""
        row = self._rows.pop(end.job.name, None)
        if row is not None:
            self._progress.remove_task(row)
        if end.status == "failed":
            print_line(self._out, _end_text(end))

    def end(self) -> None:
        """Close the display."""
        self._progress.stop()
