"""A reproduction in its directory: which rows are missing, making them, and what they say."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchid_uav.experiments.ablation.calibration import seconds_per_episode
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.directory import header_of
from orchid_uav.experiments.jobs.executor import Executor, JobEnd, JobProgress
from orchid_uav.experiments.provenance import Status
from orchid_uav.experiments.reproduction.figures.all_figures import draw_figures
from orchid_uav.experiments.reproduction.job import HOVERING, RULES, RowJob
from orchid_uav.experiments.reproduction.needs import figures_for, needed_for
from orchid_uav.experiments.reproduction.report.page import report_html
from orchid_uav.experiments.reproduction.result import Reproduction, reproduction
from orchid_uav.experiments.reproduction.rows import Row, read_rows, row_path
from orchid_uav.experiments.reproduction.trainings import QUICK_SEEDS, SEEDS, TRAININGS
from orchid_uav.experiments.statistics.results import ResultHeader
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import write_atomically, write_json

DEFAULT_DIRECTORY, DEFAULT_QUICK = Path("orchid-reproduce"), Path("orchid-reproduce-quick")
ROWS_FOLDER, RUNS_FOLDER, JOBS_FOLDER, FIGURES_FOLDER = "rows", "runs", "jobs", "figures"
DOCUMENT_FILE, REPORT_FILE = "claims.json", "report.html"


@dataclass(frozen=True)
class Campaign:
    """The rows that a reproduction needs, and the directory that it writes.

    Args:
        directory: of the reproduction; runs and logs of jobs are kept in it.
        rows: the folder of the rows, which may be that of another reproduction.
        is_quick: two seeds of short trainings, on few topologies.
        only: figures and claims that are wanted; all of them by default.

    Raises:
        InputError: the directory holds something else, or a figure or claim is not known.
    """

    directory: Path
    rows: Path
    is_quick: bool = False
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        needed_for(self.only)
        if not self.directory.exists():
            return
        is_empty = self.directory.is_dir() and not any(self.directory.iterdir())
        if not is_empty and not (self.directory / DOCUMENT_FILE).is_file():
            raise InputError(
                f"--out {self.directory} holds no reproduction, and is left alone: "
                "name a new or empty directory"
            )

    @property
    def seeds(self) -> tuple[int, ...]:
        """The training seeds."""
        return QUICK_SEEDS if self.is_quick else SEEDS

    def jobs(self) -> list[RowJob]:
        """A job for every row, in the order in which they are made: rules, then by method."""
        trained = [
            key for key, training in TRAININGS.items() if training.in_quick or not self.is_quick
        ]
        hovering = [key for key, one in HOVERING.items() if one.beside in trained]
        wanted: list[tuple[str, int | None]] = [(rule, None) for rule in RULES]
        wanted += [(method, seed) for method in (*hovering, *trained) for seed in self.seeds]
        needed = needed_for(self.only)
        runs = self.directory / RUNS_FOLDER
        return [
            RowJob(method, seed, self.rows, runs, self.is_quick)
            for method, seed in wanted
            if method in needed
        ]

    def waiting(self) -> list[RowJob]:
        """The jobs whose rows are missing."""
        return [job for job in self.jobs() if not job.is_done]

    def reserve(self, command: Sequence[str]) -> None:
        """Make the directory, and read what rows there are.

        Raises:
            InputError: it cannot be written, or a file among the rows is none.
        """
        rows = self.checked_rows()
        if any(row.is_quick != self.is_quick for row in rows):
            kind = "full" if self.is_quick else "quick"
            raise InputError(
                f"{self.rows} holds rows of a {kind} reproduction: name another folder"
            )
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if not (self.directory / DOCUMENT_FILE).exists():
                # First of all, since by it the next call knows the directory as a reproduction.
                self._write(self.gathered(command, "running", rows))
            for name in (RUNS_FOLDER, JOBS_FOLDER, FIGURES_FOLDER):
                (self.directory / name).mkdir(exist_ok=True)
            self.rows.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"cannot write to {self.directory}: {reason_of(error)}") from error

    def make(
        self,
        jobs: Sequence[RowJob],
        executor: Executor,
        progress: JobProgress,
        minutes: Mapping[str, float],
    ) -> list[JobEnd]:
        """Make rows, and say how each job ended.

        Args:
            jobs: some of :meth:`waiting`.
            executor: runs them.
            progress: shows them.
            minutes: how long each takes, by the job's name.

        Raises:
            RunFailedError: the directory cannot be written.
        """
        try:
            folder = self.directory / JOBS_FOLDER
            ordered = [job.as_job(folder, minutes[job.name]) for job in jobs]
        except OSError as error:
            raise RunFailedError(f"cannot write to {self.directory}: {reason_of(error)}") from error
        return executor.run(ordered, progress) if ordered else []

    def report(self, command: Sequence[str], status: Status) -> Reproduction:
        """Draw the figures and write report and document, of the rows that there are.

        Raises:
            InputError: a file among the rows is none.
            RunFailedError: the directory cannot be written.
        """
        rows = self.checked_rows()
        document = self.gathered(command, status, rows)
        try:
            drawn = draw_figures(rows, self.directory / FIGURES_FOLDER, figures_for(self.only))
            page = report_html(document, drawn)
            write_atomically(self.directory / REPORT_FILE, page.encode())
            self._write(document)
        except OSError as error:
            raise RunFailedError(f"cannot write to {self.directory}: {reason_of(error)}") from error
        return document

    def checked_rows(self) -> list[Row]:
        """All rows.

        Raises:
            InputError: a file among them is none, or of a training that was another one then.
        """
        rows = list(read_rows(self.rows))
        for row in rows:
            training = TRAININGS.get(row.method)
            if training is None or row.seed is None:
                continue
            command = list(training.command(row.seed))
            if row.command != command:
                path = row_path(self.rows, row.method, row.seed)
                raise InputError(
                    f"{path} was made by '{shlex.join(row.command)}', and {row.method} is now "
                    f"'{shlex.join(command)}': remove it, or name another folder"
                )
        return rows

    def gathered(self, command: Sequence[str], status: Status, rows: Sequence[Row]) -> Reproduction:
        """What the rows say."""
        header = ResultHeader.from_json(header_of(list(command), status))
        asked = [(job.method, job.seed) for job in self.jobs()]
        return reproduction(header, rows, asked, self.is_quick, self.only)

    def _write(self, document: Reproduction) -> None:
        write_json(self.directory / DOCUMENT_FILE, document.to_json())


def measured_minutes(jobs: Sequence[RowJob]) -> dict[str, float]:
    """How long jobs take here, by name, from some episodes of each kind of learner.

    Raises:
        RunFailedError: training fails in the first episodes.
    """
    paces: dict[tuple[str, str, int], float] = {}
    minutes: dict[str, float] = {}
    for job in jobs:
        training = job.training_job()
        minutes[job.name] = job.minutes_flown
        if training is None:
            continue
        config = training.config
        kind = config.training.algorithm, config.uav.flight, config.training.worlds
        if kind not in paces:
            paces[kind] = seconds_per_episode(config)
        minutes[job.name] += paces[kind] * config.training.episodes / 60.0
    return minutes
