"""A row as a job: its run is trained if it is not complete, then flown, then written down.

Other processes start it as ``python -m orchid_uav.experiments.reproduction.job FILE``.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.interruption import interruption_requests
from orchid_uav.experiments.jobs.workload import Job, job_from_order, path_in_order
from orchid_uav.experiments.reproduction.rows import Row, row_path, write_row
from orchid_uav.experiments.reproduction.settings import (
    QUICK_CASES,
    QUICK_TOPOLOGIES,
    TOPOLOGIES,
    flown_by,
)
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.training.job import PATIENCE_S, TrainingJob, done, leave, run_one
from orchid_uav.storage.files import read_document

_MODULE = "orchid_uav.experiments.reproduction.job"


class Hovering(NamedTuple):
    """A fleet that hovers through a training's topologies."""

    rule: str
    beside: str
    """The training whose topologies and reward it has."""


HOVERING = {
    "static-mmf": Hovering("static-mmf", "orchid"),
    "static-pf": Hovering("static-pf", "maddpg-pf"),
    "static-mmf-uniform": Hovering("static-mmf", "orchid-uniform"),
}
"""Curves of hovering, by the key of their rows."""
RULES = (
    *("static-mmf", "static-pf", "loiter-mmf", "balanced-loiter", "track"),
    *("balanced-loiter-120", "best-response"),
)
"""Rules that are flown beside the trained methods."""
_MINUTES_PER_CASE = {"direct": 0.05, "station": 0.15}
"""Of one core, for a policy's flights in one setting."""
_QUICK_SHARE = 0.03
"""Of a rule's flights, what a quick run flies of them."""
_TRAINED_SHARE = 0.75
"""Rough share of a job's time that goes into the training."""


@dataclass(frozen=True)
class RowJob:
    """A row that shall exist in the end."""

    method: str
    seed: int | None
    """None for the flights of a rule."""
    rows: Path
    """The folder of all rows."""
    runs: Path
    """The folder of all runs."""
    is_quick: bool = False

    @property
    def name(self) -> str:
        """The job's name."""
        return self.method if self.seed is None else f"{self.method}-s{self.seed}"

    @property
    def is_done(self) -> bool:
        """Whether the row exists."""
        return row_path(self.rows, self.method, self.seed).exists()

    @property
    def minutes_flown(self) -> float:
        """Minutes of one core that its flights take, roughly."""
        if self.seed is None:
            minutes = 10.0 if self.method == "best-response" else 1.0
            return minutes * _QUICK_SHARE if self.is_quick else minutes
        if self.is_quick or self.method not in TRAININGS:
            return 0.2
        training = TRAININGS[self.method]
        each = _MINUTES_PER_CASE[training.config(self.seed).uav.flight]
        twins = 2 if self.seed == SEEDS[0] else 1
        return each * twins * len(flown_by(training.flown))

    def training_job(self) -> TrainingJob | None:
        """The run that it needs; None for a rule."""
        if self.seed is None or self.method not in TRAININGS:
            return None
        training = TRAININGS[self.method]
        config = training.config(self.seed, self.is_quick)
        return TrainingJob(self.method, config, self.runs, training.command(self.seed))

    def as_job(self, folder: Path, cost: float) -> Job:
        """Describe the process that makes the row; its order and log are kept in ``folder``."""
        order = {
            "method": self.method,
            "seed": self.seed,
            "rows": self.rows,
            "runs": self.runs,
            "is_quick": self.is_quick,
        }
        return job_from_order(self.name, _MODULE, order, folder, self._fraction_done(), cost)

    def _fraction_done(self) -> Callable[[], float]:
        training = self.training_job()
        trained = training.fraction_done() if training else lambda: 0.0

        def fraction_done() -> float:
            return 1.0 if self.is_done else _TRAINED_SHARE * trained()

        return fraction_done

    @classmethod
    def read(cls, order: Path) -> "RowJob":
        """Read a job from a file that :meth:`as_job` wrote.

        Raises:
            InputError: the file is not one of those.
        """
        try:
            document = read_document(order)
            rows, runs = (path_in_order(document[name], order) for name in ("rows", "runs"))
            return cls(document["method"], document["seed"], rows, runs, document["is_quick"])
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise InputError(f"{order} is not the order of a row: {error}") from error


def make_row(job: RowJob) -> int:
    """Make the row, unless it exists.

    Returns:
        0, or 130 if it was interrupted; what was done is then kept.

    Raises:
        InputError: the run cannot be begun or resumed.
        RunFailedError: the run failed.
    """
    if job.is_done:
        return 0
    from orchid_uav.experiments.reproduction.measuring import watchers

    training = job.training_job()
    if training is not None and (code := run_one(training, watchers(training.config), PATIENCE_S)):
        return code
    with interruption_requests() as interruption:
        row = _measured(job, training, lambda: interruption.requested)
    if job.is_quick:
        row = row.model_copy(update={"is_quick": True})
    write_row(job.rows, row)
    if training is not None and (run := training.completed()):
        shutil.rmtree(run / "checkpoints", ignore_errors=True)  # a complete run needs none
    return 0


def _measured(job: RowJob, training: TrainingJob | None, stop: Callable[[], bool]) -> Row:
    from orchid_uav.experiments.reproduction import measuring

    topologies = QUICK_TOPOLOGIES if job.is_quick else TOPOLOGIES
    if job.seed is None:
        cases = QUICK_CASES if job.is_quick else flown_by("everything")
        return measuring.row_of_rule(job.method, cases, topologies, stop)
    if training is None:
        rule, beside = HOVERING[job.method]
        own = TRAININGS[beside].config(job.seed, job.is_quick)
        return measuring.row_of_hovering(job.method, rule, own)
    run = training.completed()
    if run is None:
        raise InputError(f"run {training.key} has disappeared from {job.runs}")
    of_method = TRAININGS[job.method]
    cases = QUICK_CASES if job.is_quick else flown_by(of_method.flown)
    is_first = job.seed == SEEDS[0]
    return measuring.row_of_run(of_method, run, job.seed, cases, topologies, is_first, stop)


if __name__ == "__main__":
    leave(done(lambda order: make_row(RowJob.read(order))))
