"""The directory of an ablation: its runs, their flights, and the results."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from orchid_uav.experiments.ablation.design import (
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
from orchid_uav.experiments.ablation.result import AblationHeader, AblationResult, AblationRun
from orchid_uav.experiments.ablation.variants import FROZEN
from orchid_uav.experiments.configuration import RunConfig, as_read_before, flatten
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.directory import EPISODES_FILE as FLIGHTS_FILE
from orchid_uav.experiments.evaluation.directory import (
    SUMMARY_FILE,
    describe_plan,
    header_of,
    read_interrupted,
    run_evaluation,
    told_if_not_drawn,
)
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, FlightProgress
from orchid_uav.experiments.figures.contact_sheet import SHEET_FILE, write_ablation_sheet
from orchid_uav.experiments.figures.learning_curves import draw_learning_curves
from orchid_uav.experiments.figures.style import setting_of
from orchid_uav.experiments.jobs.executor import Executor, JobProgress
from orchid_uav.experiments.jobs.workload import Job
from orchid_uav.experiments.provenance import Status
from orchid_uav.experiments.runs.directory import Row, read_episodes
from orchid_uav.experiments.runs.records import EPISODES_FILE, check_log, read_record
from orchid_uav.experiments.statistics.curves import curve_table
from orchid_uav.experiments.statistics.results import EvaluationResult, EvaluationSummary
from orchid_uav.experiments.training.job import TrainingJob
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import leftovers, read_document, remove_leftovers, write_json

DEFAULT_PARENT = Path("orchid-ablate")
DOCUMENT_FILE, CURVES_FILE = "ablation.json", "learning_curves.png"
RUNS_FOLDER, JOBS_FOLDER, EVALUATION_FOLDER = "runs", "jobs", "evaluation"
_TEMPORARY = (DOCUMENT_FILE, SHEET_FILE)
CURVE_WINDOW, CURVE_STEP = 20, 10
"""Episodes of a learning curve's trailing mean, and from one of its points to the next."""
_LARGEST_DOCUMENT = 64 * 2**20
_FIXED = ("base", "topologies", "evaluation_seed", "margin")
"""Settings that must not change when a study goes on."""

Outcome = Literal["completed", "failed", "interrupted"]


class AblationStudy:
    """An ablation in its directory, where nothing that is finished is done again.

    Args:
        ablation: what is compared.
        directory: the study's directory.
        command: the command that was called, for the records.

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
        directory = self.directory
        try:
            # Runs may come first, for example from an array of jobs.
            begun = {directory / RUNS_FOLDER}
            if not directory.exists() or (
                directory.is_dir()
                and begun.union(leftovers(directory, _TEMPORARY)).issuperset(directory.iterdir())
            ):
                return
            document = read_document(directory / DOCUMENT_FILE, _LARGEST_DOCUMENT)
            known = AblationHeader.from_json(document).settings
        except (OSError, ValueError) as error:
            raise InputError(
                f"--out {directory} holds no ablation, and is left alone: {error}"
            ) from error
        with suppress(ValueError):  # of another version; what differs is told below
            # Keys that are newer than the study have the values that it was made with.
            base = RunConfig.model_validate(as_read_before(known.base))
            known = known.model_copy(update={"base": base.model_dump(mode="json")})
        wanted = self.ablation.describe()
        differing = [key for key in _FIXED if getattr(known, key) != getattr(wanted, key)]
        if differing:
            raise InputError(
                f"--out {directory} holds an ablation with another {', '.join(differing)}; "
                "seeds and variants can be added to it, nothing else changed"
            )

    def waiting(self) -> list[TrainingJob]:
        """The runs that are not complete."""
        return [job for job in self.training_jobs if not job.completed()]

    def reserve(self) -> None:
        """Make the directory and write the settings into it.

        Raises:
            InputError: the directory cannot be written.
        """
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            remove_leftovers(self.directory, _TEMPORARY)
            # This file comes first: a directory that has content but lacks it is somebody else's.
            write_json(self.directory / DOCUMENT_FILE, self._header("running").to_json())
            for folder in (JOBS_FOLDER, RUNS_FOLDER):
                (self.directory / folder).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot write to --out {self.directory}: {reason_of(error)}"
            ) from error

    def train(
        self, executor: Executor, progress: JobProgress, costs: Mapping[str, float]
    ) -> Outcome:
        """Train what is not complete, and say whether all runs are complete then.

        Args:
            executor: runs the training jobs.
            progress: shows the progress of the jobs.
            costs: how long a run takes, by variant.

        Raises:
            RunFailedError: the disk is full.
        """
        folder = self.directory / JOBS_FOLDER
        with self._writing():
            jobs: list[Job] = [job.as_job(folder, costs[job.name]) for job in self.waiting()]
        ends = executor.run(jobs, progress) if jobs else []
        if executor.was_stopped or any(end.status == "interrupted" for end in ends):
            return "interrupted"
        return "failed" if any(end.status == "failed" for end in ends) else "completed"

    def note_interruption(self) -> None:
        """Write into ``ablation.json`` that the study was interrupted."""
        self._write(self._header("interrupted"))

    def evaluate(self, progress: FlightProgress) -> AblationResult | None:
        """Fly all policies, compare them, and write ``ablation.json``; None if interrupted.

        Failed runs are counted as failures; all runs of a variant may have failed.

        Raises:
            RunFailedError: not a single run was completed, or the disk is full.
        """
        policies = read_policies(self.training_jobs)
        if not policies:
            self._write(self._header("failed"))
            raise RunFailedError(f"no run was completed; see {self.directory / JOBS_FOLDER}")
        summary = self._fly(self.ablation.plan(policies), progress)
        if summary.status == "interrupted":
            return None
        logs = {
            name: [_rows(job) for job in self.training_jobs if job.name == name]
            for name in self.ablation.configurations()
        }
        curves = {name: [rows for rows in own if rows] for name, own in logs.items()}
        document = self._document(summary.results, logs, curves)
        self._write(document)
        with told_if_not_drawn(self.directory):
            path, setting = self.directory / CURVES_FILE, self._setting()
            draw_learning_curves(curves, path, window=CURVE_WINDOW, title=setting)
            write_ablation_sheet(self.directory, document, self._facts(setting), path)
        return document

    def _write(self, document: AblationHeader) -> None:
        with self._writing():
            write_json(self.directory / DOCUMENT_FILE, document.to_json())

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RunFailedError(f"cannot write to {self.directory}: {reason_of(error)}") from error

    def _fly(self, plan: EvaluationPlan, progress: FlightProgress) -> EvaluationSummary:
        """Return the summary of the evaluation; it is begun or resumed if it is not complete."""
        settings = describe_plan(plan, 0)
        folder = self.directory / EVALUATION_FOLDER
        try:
            document = read_document(folder / SUMMARY_FILE, _LARGEST_DOCUMENT)
            summary = EvaluationSummary.from_json(document)
            if summary.status == "completed" and summary.settings == settings:
                return summary
        except (OSError, ValueError):
            pass
        try:
            flown = read_interrupted(folder, plan, settings)
        except InputError:  # an evaluation from before runs were added
            flown = {}
            for name in (SUMMARY_FILE, FLIGHTS_FILE):
                (folder / name).unlink(missing_ok=True)
        folder.mkdir(exist_ok=True)
        return run_evaluation(
            plan, settings, folder, self.command, flown, progress, with_figures=False
        )

    def _document(
        self,
        results: Sequence[EvaluationResult],
        logs: Mapping[str, Sequence[Sequence[Row]]],
        curves: Mapping[str, Sequence[Sequence[Row]]],
    ) -> AblationResult:
        ablation = self.ablation
        names = list(ablation.configurations())
        flown = {
            kind: {
                name: flown_values(results, name, ablation.seeds, kind == "evaluation")
                for name in names
            }
            for kind in ("evaluation", "sampled")
        }
        trained = {name: trained_values(own) for name, own in logs.items()}
        families = {
            **{kind: (values, FLOWN) for kind, values in flown.items()},
            "training": (trained, TRAINED),
        }
        own_keys = {key_of(name, seed) for name in names for seed in ablation.seeds}
        return AblationResult(
            **self._header("failed" if self.waiting() else "completed").to_json(),
            runs=[self._describe_run(job, families) for job in self.training_jobs],
            values={kind: describe_values(values) for kind, (values, _) in families.items()},
            comparisons={
                kind: compare(values, metrics, ablation.margin, ablation.rewarded_otherwise())
                for kind, (values, metrics) in families.items()
            },
            others=[result for result in results if result.method not in own_keys],
            late_changes=late_changes(logs),
            replayed_trigger={
                name: replayed_trigger(logs[name])
                for name, config in ablation.configurations().items()
                if name == FROZEN or not config.reset.enabled
            },
            learning_curves=curve_table(curves, TRAINED, CURVE_WINDOW, CURVE_STEP),
        )

    def _facts(self, setting: str) -> dict[str, str]:
        """Facts about the study for the page of its figure."""
        ablation = self.ablation
        return {
            "Setting": setting,
            "Compared": ", ".join(ablation.configurations()),
            "Training seeds": ", ".join(map(str, ablation.seeds)),
            "Topologies": f"{ablation.topologies:,} to fly afterwards, seed "
            f"{ablation.evaluation_seed}, the same for all policies",
        }

    def _setting(self) -> str:
        """The setting, as far as base and variants have it in common."""
        return setting_of(map(flatten, self.ablation.configurations().values()))

    def _describe_run(
        self, job: TrainingJob, families: Mapping[str, tuple[Mapping[str, Any], Any]]
    ) -> AblationRun:
        """Describe a run, with the numbers from which the comparisons are made, one per metric."""
        path, seed = job.find(), job.config.training.seed
        record = read_record(path) if path else None
        index = list(self.ablation.seeds).index(seed)
        return AblationRun(
            variant=job.name,
            seed=seed,
            run=record.id if record else None,
            status=job.status(),
            episodes=record.episodes if record else 0,
            seconds=record.seconds if record else None,
            reset_episodes=record.reset_episodes if record else [],
            error=record.error if record else None,
            **{
                kind: {
                    metric: _json_number(per_seed[index])
                    for metric, per_seed in values[job.name].items()
                }
                for kind, (values, _) in families.items()
            },
        )

    def _header(self, status: Status) -> AblationHeader:
        return AblationHeader(
            **header_of(self.command, status),
            settings=self.ablation.describe(),
            updated=datetime.now(UTC).isoformat(timespec="seconds"),
        )


def _rows(job: TrainingJob) -> list[Row]:
    """Episodes of a complete run; no rows for any other."""
    path = job.completed()
    if path is None:
        return []
    check_log(path, read_record(path))
    return read_episodes(path / EPISODES_FILE)


def _json_number(value: float) -> float | None:
    return value if math.isfinite(value) else None
