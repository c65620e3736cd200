"""The directory of an evaluation: ``episodes.parquet``, ``summary.json`` and figures."""

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from orchid_uav.envs.seeds import evaluation_seeds
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.flights import (
    CEILING,
    FLOOR,
    EvaluationPlan,
    FlightProgress,
    Flown,
    describe,
    evaluate,
    summarise_flights,
)
from orchid_uav.experiments.interruption import Raising, interruption_requests
from orchid_uav.experiments.metrics import EVALUATION_METRICS
from orchid_uav.experiments.provenance import Status, describe_host, describe_versions
from orchid_uav.experiments.statistics.intervals import INTERVAL
from orchid_uav.experiments.statistics.results import (
    EvaluationSettings,
    EvaluationSummary,
)
from orchid_uav.notices import kind_and_reason, reason_of, warn_once
from orchid_uav.storage.files import (
    leftovers,
    read_document,
    remove_leftovers,
    write_atomically,
    write_json,
)

SCHEMA = 1
_LARGEST_SUMMARY = 64 * 2**20
DEFAULT_PARENT = Path("orchid-eval")
_STOPPING = b"stopping; what was flown is kept\n"
EPISODES_FILE, SUMMARY_FILE, FIGURES_FOLDER = "episodes.parquet", "summary.json", "figures"
_DRAWING, _RESERVING = "drawing", "reserving"
"""Names of temporary folders, with what :mod:`tempfile` adds."""
_TEMPORARY = (EPISODES_FILE, SUMMARY_FILE, _DRAWING, _RESERVING)


def make_default_directory(parent: Path = DEFAULT_PARENT) -> Path:
    """Make a new directory ``<parent>/<UTC time>``, with a number added if that exists."""
    name = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    for suffix in ("", *(f"-{number}" for number in range(2, 100))):
        directory = parent / (name + suffix)
        try:
            directory.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(f"cannot make {directory}: {reason_of(error)}") from error
        return directory
    raise InputError(f"cannot find a free name for {parent / name}")


def describe_plan(plan: EvaluationPlan, planner_evaluations: int) -> EvaluationSettings:
    """What defines an evaluation: two with equal settings give equal metrics."""
    settings = plan.settings
    described = {
        "methods": [
            {
                "method": contender.key,
                "run": contender.policy.run if contender.policy else None,
                "sha256": description.sha256 if description else None,
                "deterministic": contender.deterministic,
                "overrides": dict(contender.overrides),
                **({"file": contender.own_file._asdict()} if contender.own_file else {}),
            }
            for contender in plan.contenders
            for description in [contender.policy.actor.description if contender.policy else None]
        ],
        "distributions": list(dict.fromkeys(setting.distribution for setting in settings)),
        "uavs": list(dict.fromkeys(setting.uavs for setting in settings)),
        "users": list(dict.fromkeys(setting.users for setting in settings)),
        "speeds_mps": list(dict.fromkeys(setting.speed_mps for setting in settings)),
        "heading_hold_s": list(dict.fromkeys(setting.heading_hold_s for setting in settings)),
        "episodes": plan.episodes,
        "seed": plan.seed,
        "planner_evaluations": planner_evaluations,
        "world": plan.world.model_dump(mode="json"),
        "training_progress": plan.training_progress,
        "ci95": f"{INTERVAL}, over topologies",
        "headroom": f"(U - U_{FLOOR}) / (U_{CEILING} - U_{FLOOR}), U the mean utility",
    }
    return EvaluationSettings.from_json(json.loads(json.dumps(described)))  # tuples become lists


def read_interrupted(
    directory: Path,
    plan: EvaluationPlan,
    settings: EvaluationSettings,
    note: Callable[[str], None] = lambda text: None,
) -> Flown:
    """Read the flights of an interrupted evaluation of the same settings; none from no directory.

    Args:
        directory: the evaluation's directory.
        plan: the flights of the evaluation.
        settings: the result of :func:`describe_plan`.
        note: called with a sentence if existing flights have to be flown again.

    Raises:
        InputError: the directory holds anything else, which must not be overwritten.
    """
    try:
        if not directory.exists() or (directory.is_dir() and not _content_of(directory)):
            return {}
        summary = read_document(directory / SUMMARY_FILE, _LARGEST_SUMMARY)
        status, known = summary["status"], summary["settings"]
        if not isinstance(known, dict):
            raise ValueError(f"{directory / SUMMARY_FILE} has no settings")
    except (OSError, ValueError, LookupError) as error:
        raise InputError(
            f"--out {directory} holds no results of orchid eval, and is left alone: {error}"
        ) from error
    if status != "interrupted":
        raise InputError(f"--out {directory} holds a complete evaluation: choose another directory")
    known, wanted = _with_current_keys(known), settings.to_json()
    if known != wanted:
        differing = [key for key in wanted if known.get(key) != wanted[key]]
        raise InputError(
            f"--out {directory} holds an interrupted evaluation of other settings: "
            f"{', '.join(differing)}"
        )
    if not (directory / EPISODES_FILE).is_file():
        return {}
    try:
        table = pq.read_table(directory / EPISODES_FILE)
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"cannot read {directory / EPISODES_FILE}: {error}") from error
    names = list(describe(next(plan.flights())))
    missing = [name for name in (*names, *EVALUATION_METRICS) if name not in table.column_names]
    if missing:
        note(
            f"--out {directory} holds flights of another version, which did not measure "
            f"{', '.join(missing)}: they are flown again"
        )
        return {}
    groups: dict[tuple[Any, ...], list[dict[str, Any]]] = {}
    for row in table.to_pylist():
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    flown: Flown = {}
    for flight in plan.flights():
        found = groups.get(tuple(describe(flight).values()), [])
        if len(found) == plan.episodes:
            flown[flight.key] = {
                name: np.array([row[name] for row in found], float) for name in EVALUATION_METRICS
            }
    return flown


def _content_of(directory: Path) -> set[Path]:
    """What lies there, but for what an evaluation that was killed while writing has left."""
    return set(directory.iterdir()).difference(leftovers(directory, _TEMPORARY))


def _with_current_keys(settings: dict[str, Any]) -> dict[str, Any]:
    try:
        return EvaluationSettings.from_json(settings).to_json()
    except ValueError:
        return settings  # of another version; the caller reports what differs


def reserve_directory(directory: Path) -> None:
    """Make the directory before anything is flown, and check that it can be written.

    Raises:
        InputError: the directory cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryDirectory(prefix=f".{_RESERVING}-", dir=directory).cleanup()
    except OSError as error:
        raise InputError(f"cannot write to --out {directory}: {reason_of(error)}") from error


def episodes_table(plan: EvaluationPlan, flown: Flown) -> pa.Table:
    """Make the table of episodes, with a row per method, setting and episode."""
    seeds = evaluation_seeds(plan.seed, plan.episodes)
    columns: dict[str, list[Any]] = {}
    for flight in plan.flights():
        if flight.key not in flown:
            continue
        described = describe(flight) | {"episode": list(range(plan.episodes)), "seed": seeds}
        metrics = {name: flown[flight.key][name].tolist() for name in EVALUATION_METRICS}
        for name, values in (described | metrics).items():
            repeated = values if isinstance(values, list) else [values] * plan.episodes
            columns.setdefault(name, []).extend(repeated)
    return pa.table(columns)


def summary_document(
    plan: EvaluationPlan,
    flown: Flown,
    settings: EvaluationSettings,
    command: list[str],
    is_complete: bool,
) -> EvaluationSummary:
    """The content of ``summary.json``, which is also what ``orchid eval --json`` prints."""
    return EvaluationSummary(
        **header_of(command, "completed" if is_complete else "interrupted"),
        settings=settings,
        results=summarise_flights(plan, flown, with_intervals=is_complete),
    )


def header_of(command: list[str], status: Status) -> dict[str, Any]:
    """The keys with which every document of results begins."""
    host = describe_host()
    del host["name"]
    return {
        "schema": SCHEMA,
        "status": status,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": command,
        "versions": describe_versions(),
        "host": host,
    }


def run_evaluation(
    plan: EvaluationPlan,
    settings: EvaluationSettings,
    directory: Path,
    command: list[str],
    flown: Flown,
    progress: FlightProgress,
    with_figures: bool = True,
) -> EvaluationSummary:
    """Fly a plan and fill the directory; the summary's status says whether all of it was flown.

    After an interruption no figures are drawn and no intervals computed, as both take long.

    Args:
        plan: the flights of the evaluation.
        settings: the result of :func:`describe_plan`.
        directory: the evaluation's directory, made by :func:`reserve_directory`.
        command: the command that was called.
        flown: flights of an earlier, interrupted call.
        progress: shows the progress.
        with_figures: whether to draw figures.

    Raises:
        RunFailedError: the directory cannot be written.
    """
    document = summary_document(plan, {}, settings, command, is_complete=False)
    with _told(directory):
        remove_leftovers(directory, _TEMPORARY)
    with interruption_requests(Raising.AT_ONCE, _STOPPING) as interruption:

        def save(done: Flown) -> None:
            with interruption.held_back():
                save_flights(directory, plan, done, settings, command)

        try:
            flown, is_complete = evaluate(
                plan, progress, flown, save, lambda: interruption.requested
            )
            if flown:
                document = summary_document(plan, flown, settings, command, is_complete)
                write_evaluation(directory, document, with_figures and is_complete)
        except KeyboardInterrupt:
            document.status = "interrupted"
        finally:
            _remove_if_empty(directory)
    return document


def _remove_if_empty(directory: Path) -> None:
    """Remove the directory if it is empty, and the parent of default directories likewise."""
    for one in (directory, *([directory.parent] if directory.parent == DEFAULT_PARENT else [])):
        if one.is_dir() and not any(one.iterdir()):
            one.rmdir()


def save_flights(
    directory: Path,
    plan: EvaluationPlan,
    flown: Flown,
    settings: EvaluationSettings,
    command: list[str],
) -> None:
    """Save flights, so that the same evaluation can go on from them.

    Raises:
        RunFailedError: the flights cannot be written.
    """
    document = summary_document(plan, {}, settings, command, is_complete=False)
    with _told(directory):
        # In this order: a summary without a table of episodes means that nothing was flown yet.
        if not (directory / SUMMARY_FILE).exists():
            write_json(directory / SUMMARY_FILE, document.to_json())
        _write_table(episodes_table(plan, flown), directory / EPISODES_FILE)


def write_evaluation(
    directory: Path, document: EvaluationSummary, with_figures: bool = True
) -> None:
    """Add the summary to saved flights, and figures if they can be drawn.

    Raises:
        RunFailedError: the summary cannot be written.
    """
    with _told(directory):
        shutil.rmtree(directory / FIGURES_FOLDER, ignore_errors=True)
        if with_figures and document.results:
            # All results are known but not drawn yet: "interrupted" lets the same command go on.
            write_json(
                directory / SUMMARY_FILE,
                document.model_copy(update={"status": "interrupted"}).to_json(),
            )
            with told_if_not_drawn(directory):
                _draw(directory, document)
        write_json(directory / SUMMARY_FILE, document.to_json())


@contextmanager
def told_if_not_drawn(directory: Path) -> Iterator[None]:
    """Turn an error while drawing into a warning, so that the evaluation itself is kept."""
    try:
        yield
    except Exception as error:
        reason = kind_and_reason(error)
        warn_once("figures", f"no figures in {directory}, since drawing failed: {reason}")


def _draw(directory: Path, document: EvaluationSummary) -> None:
    from orchid_uav.experiments.figures.contact_sheet import write_evaluation_sheet
    from orchid_uav.experiments.figures.evaluation_figures import draw_figures

    with tempfile.TemporaryDirectory(prefix=f".{_DRAWING}-", dir=directory) as beside:
        figures = draw_figures(document.results, Path(beside) / FIGURES_FOLDER)
        write_evaluation_sheet(Path(beside) / FIGURES_FOLDER, document, figures)
        (Path(beside) / FIGURES_FOLDER).rename(directory / FIGURES_FOLDER)


def _write_table(table: pa.Table, path: Path) -> None:
    content = pa.BufferOutputStream()
    pq.write_table(table, content)
    write_atomically(path, content.getvalue().to_pybytes())


@contextmanager
def _told(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RunFailedError(f"cannot write to {directory}: {reason_of(error)}") from error
