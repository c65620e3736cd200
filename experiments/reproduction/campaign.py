"""All rows of a reproduction: which are missing, how long they take, and making them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.jobs.local_processes import Executor, JobEnd, JobProgress
from orchid_uav.experiments.jobs.workload import last_end
from orchid_uav.experiments.reproduction.job import HOVERING, RULES, RowJob
from orchid_uav.experiments.reproduction.trainings import QUICK_SEEDS, SEEDS, TRAININGS
from orchid_uav.notices import reason_of

ROWS_FOLDER, RUNS_FOLDER, JOBS_FOLDER = "rows", "runs", "jobs"


@dataclass(frozen=True)
class Campaign:
    """The rows that a reproduction needs.

    Args:
        directory: of the reproduction; runs and logs of jobs are kept in it.
        rows: the folder of the rows, which may be that of another reproduction.
        is_quick: two seeds of short trainings, on few topologies.
    """

    directory: Path
    rows: Path
    is_quick: bool = False

    @property
    def seeds(self) -> tuple[int, ...]:
        """The training seeds."""
        return QUICK_SEEDS if self.is_quick else SEEDS

    def methods(self) -> list[str]:
        """The methods that are trained."""
        return [
            key for key, training in TRAININGS.items() if training.in_quick or not self.is_quick
        ]

    def jobs(self) -> list[RowJob]:
        """A job for every row, in the order in which they are made: rules, then by method."""
        wanted: list[tuple[str, int | None]] = [(rule, None) for rule in RULES]
        wanted += [(method, seed) for method in (*HOVERING, *self.methods()) for seed in self.seeds]
        runs = self.directory / RUNS_FOLDER
        return [RowJob(method, seed, self.rows, runs, self.is_quick) for method, seed in wanted]

    def waiting(self) -> list[RowJob]:
        """The jobs whose rows are missing."""
        return [job for job in self.jobs() if not job.is_done]

    def make(
        self, jobs: Iterable[RowJob], executor: Executor, progress: JobProgress
    ) -> list[JobEnd]:
        """Make rows, and say how each job ended.

        Raises:
            RunFailedError: the directory cannot be written.
        """
        folder = self.directory / JOBS_FOLDER
        try:
            for path in (folder, self.directory / RUNS_FOLDER, self.rows):
                path.mkdir(parents=True, exist_ok=True)
            ordered = [job.as_job(folder) for job in jobs]
        except OSError as error:
            raise RunFailedError(f"cannot write to {self.directory}: {reason_of(error)}") from error
        return executor.run(ordered, progress) if ordered else []


def hours(jobs: Sequence[RowJob], processes: int) -> float:
    """Rough duration of jobs, with so many of them at once."""
    return last_end([job.minutes for job in jobs], [0.0] * processes) / 60.0
