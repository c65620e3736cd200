"""The directory of an ablation: its runs, their flights, what they say."""

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from orchid_uav.agents.safe_files import read_document
from orchid_uav.experiments.ablation import (
    FLOWN,
    TRAINED,
    Ablation,
    compare,
    describe_values,
    flown_values,
    key_of,
    late_changes,
    read_policies,
    replayed_trigger,
    trained_values,
)
from orchid_uav.experiments.curves import curve_table
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation import Progress
from orchid_uav.experiments.evaluation_files import (
    SUMMARY_FILE,
    describe_plan,
    header_of,
    read_interrupted,
    run_evaluation,
)
from orchid_uav.experiments.files import write_json
from orchid_uav.experiments.jobs import Executor, Job, JobProgress
from orchid_uav.experiments.learning_curves import draw_learning_curves
from orchid_uav.experiments.run_directory import Row, read_episodes
from orchid_uav.experiments.run_records import EPISODES_FILE, read_record, status_of
from orchid_uav.experiments.statistics import INTERVAL
from orchid_uav.experiments.training_job import TrainingJob
from orchid_uav.experiments.variants import FROZEN

SCHEMA = 1
DEFAULT_PARENT = Path("orchid-ablate")
DOCUMENT_FILE, CURVES_FILE = "ablation.json", "learning_curves.png"
RUNS_FOLDER, JOBS_FOLDER, EVALUATION_FOLDER = "runs", "jobs", "evaluation"
CURVE_WINDOW, CURVE_STEP = 20, 10
"""Episodes of the trailing mean of a learning curve, and from one of its points to the next."""
_LARGEST_DOCUMENT = 64 * 2**20

Outcome = Literal["completed", "failed", "interrupted"]


class AblationStudy:
    """An ablation in its directory, where what is finished is not done again.

    Args:
        ablation: what is compared.
        directory: of the study.
        command: how it was called, for the records.

    Raises:
        InputError: the directory holds something else, or cannot be written.
    """

    def __init__(self, ablation: Ablation, directory: Path, command: Sequence[str]) -> None:
        self.ablation = ablation
        self.directory = directory
        self.command = list(command)
        self.training_jobs = ablation.jobs(directory / RUNS_FOLDER, command)
        self._check_directory()

    def _check_directory(self) -> None:
        """Other seeds and variants may be added to a study, but not another base."""
        directory, document = self.directory, self.directory / DOCUMENT_FILE
        try:
            if not directory.exists() or (directory.is_dir() and not any(directory.iterdir())):
                return
            known = read_document(document, _LARGEST_DOCUMENT)["settings"]
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise InputError(
                f"--out {directory} holds no ablation, and is left alone: {error}"
            ) from error
        wanted = json.loads(json.dumps(self.ablation.describe()))
        differing = [
            key
            for key in ("base", "topologies", "evaluation_seed", "margin")
            if known.get(key) != wanted[key]
        ]
        if differing:
            raise InputError(
                f"--out {directory} holds an ablation with another {', '.join(differing)}; "
                "seeds and variants can be added to it, nothing else changed"
            )

    def waiting(self) -> list[TrainingJob]:
        """The runs that are not complete."""
        return [job for job in self.training_jobs if _status(job) != "completed"]

    def reserve(self) -> None:
        """Make the directory and say in it what is to come.

        Raises:
            InputError: it cannot be written.
        """
        try:
            (self.directory / JOBS_FOLDER).mkdir(parents=True, exist_ok=True)
            (self.directory / RUNS_FOLDER).mkdir(exist_ok=True)
            self._write(self._header("running"))
        except OSError as error:
            raise InputError(
                f"cannot write to --out {self.directory}: {error.strerror or error}"
            ) from error

    def train(
        self, executor: Executor, progress: JobProgress, costs: Mapping[str, float]
    ) -> Outcome:
        """Train what is not complete.

        Args:
            executor: where the runs are trained.
            progress: shows them.
            costs: how long a run takes, by variant.
        """
        jobs: list[Job] = [
            job.as_job(self.directory / JOBS_FOLDER, costs[job.name]) for job in self.waiting()
        ]
        ends = executor.run(jobs, progress) if jobs else []
        if executor.was_stopped or any(end.status == "interrupted" for end in ends):
            self._write(self._header("interrupted"))
            return "interrupted"
        return "failed" if any(end.status == "failed" for end in ends) else "completed"

    def evaluate(self, progress: Progress) -> dict[str, Any] | None:
        """Fly all policies, compare them, and write ``ablation.json``; None if interrupted.

        Raises:
            RunFailedError: no run of some variant has a policy, or the disk is full.
        """
        policies = read_policies(self.training_jobs)
        names = list(self.ablation.configurations())
        without = [name for name in names if all(key != name for key, _ in policies)]
        if without:
            self._write(self._header("failed"))
            raise RunFailedError(f"no run of {', '.join(without)} was completed")
        plan = self.ablation.plan(policies)
        settings = json.loads(json.dumps(describe_plan(plan, 0)))
        folder = self.directory / EVALUATION_FOLDER
        summary = _known_summary(folder, settings)
        if summary is None:
            try:
                flown = read_interrupted(folder, plan, settings)
            except InputError:  # of other runs, before some were added
                shutil.rmtree(folder)
                flown = {}
            folder.mkdir(exist_ok=True)
            summary = run_evaluation(
                plan, settings, folder, self.command, flown, progress, with_figures=False
            )
        if summary["status"] == "interrupted":
            self._write(self._header("interrupted"))
            return None
        document = self._document(summary["results"])
        self._write(document)
        return document

    def _document(self, results: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        ablation = self.ablation
        names = list(ablation.configurations())
        logs = {name: [self._rows(name, seed) for seed in ablation.seeds] for name in names}
        complete = {name: [rows or [] for rows in own] for name, own in logs.items()}
        flown = {
            kind: {
                name: flown_values(results, name, ablation.seeds, kind == "evaluation")
                for name in names
            }
            for kind in ("evaluation", "sampled")
        }
        trained = {name: trained_values(own) for name, own in complete.items()}
        families = {
            **{kind: (values, FLOWN) for kind, values in flown.items()},
            "training": (trained, TRAINED),
        }
        has_failed = any(_status(job) != "completed" for job in self.training_jobs)
        curves = {name: [rows for rows in own if rows] for name, own in complete.items()}
        draw_learning_curves(curves, self.directory / CURVES_FILE, window=CURVE_WINDOW)
        own_keys = {key_of(name, seed) for name in names for seed in ablation.seeds}
        return self._header("failed" if has_failed else "completed") | {
            "runs": [self._describe_run(job, families) for job in self.training_jobs],
            "values": {kind: describe_values(values) for kind, (values, _) in families.items()},
            "comparisons": {
                kind: compare(values, figures, ablation.margin)
                for kind, (values, figures) in families.items()
            },
            "others": [result for result in results if result["method"] not in own_keys],
            "late_changes": late_changes(complete),
            "replayed_trigger": {
                name: replayed_trigger(complete[name])
                for name, config in ablation.configurations().items()
                if name == FROZEN or not config.reset.enabled
            },
            "learning_curves": curve_table(curves, TRAINED, CURVE_WINDOW, CURVE_STEP),
        }

    def _rows(self, name: str, seed: int) -> list[Row] | None:
        """Episodes of a completed run."""
        job = self._job(name, seed)
        path = job.find()
        if path is None or _status(job) != "completed":
            return None
        return read_episodes(path / EPISODES_FILE)

    def _job(self, name: str, seed: int) -> TrainingJob:
        return next(
            job
            for job in self.training_jobs
            if (job.name, job.config.training.seed) == (name, seed)
        )

    def _describe_run(
        self, job: TrainingJob, families: Mapping[str, tuple[Mapping[str, Any], Any]]
    ) -> dict[str, Any]:
        """A run's figures, one number each: what the comparisons are made from."""
        path, seed = job.find(), job.config.training.seed
        record = read_record(path) if path else {}
        index = list(self.ablation.seeds).index(seed)
        return {
            "variant": job.name,
            "seed": seed,
            "run": record.get("id"),
            "status": _status(job),
            "episodes": record.get("episodes", 0),
            "seconds": record.get("seconds"),
            "reset_episodes": record.get("reset_episodes", []),
            "error": record.get("error"),
            **{
                kind: {
                    figure: _json_number(per_seed[index])
                    for figure, per_seed in values[job.name].items()
                }
                for kind, (values, _) in families.items()
            },
        }

    def _header(self, status: str) -> dict[str, Any]:
        settings = self.ablation.describe() | {
            "ci95": f"{INTERVAL}, over training seeds",
            "family": "the figures of one variant in one kind of flight, or in training",
            "updated": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        return header_of(settings, self.command, status)

    def _write(self, document: Mapping[str, Any]) -> None:
        write_json(self.directory / DOCUMENT_FILE, document)


def _known_summary(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """Of a complete evaluation of the same runs."""
    try:
        summary = read_document(folder / SUMMARY_FILE, _LARGEST_DOCUMENT)
    except (OSError, ValueError):
        return None
    is_same = summary.get("status") == "completed" and summary.get("settings") == settings
    return summary if is_same else None


def _status(job: TrainingJob) -> str:
    path = job.find()
    return "not begun" if path is None else status_of(path, read_record(path))


def _json_number(value: float) -> float | None:
    return value if math.isfinite(value) else None
