"""Write and read the results of studies."""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from orchid_uav.experiments.ablation.result import AblationResult
from orchid_uav.experiments.provenance import (
    CHANGES,
    describe_host,
    describe_versions,
    git_commit,
)
from orchid_uav.experiments.statistics.results import EvaluationSummary
from orchid_uav.storage.documents import rounded
from orchid_uav.storage.files import write_atomically

SCHEMA = 1
ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "studies" / "results"
RECORDS = (RESULTS, ROOT / "runs" / "reference")
"""Folders of committed results."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment variables that keep a process to one core."""


def add_recording_options(parser: argparse.ArgumentParser, result: Path | None = None) -> None:
    """Add the options that recording programs share.

    Args:
        parser: of the program.
        result: where its one result goes by default (``--json``); None where it has another way.
    """
    if result is not None:
        parser.add_argument(
            "--json", type=Path, default=result, metavar="FILE", help="where the result goes"
        )
    parser.add_argument(
        "--allow-changes",
        action="store_true",
        help="record even if the checkout has uncommitted changes",
    )


def require_commit(
    parser: argparse.ArgumentParser, options: argparse.Namespace, path: Path | None
) -> None:
    """Exit before measuring if the result would be committed but no commit holds the code.

    Args:
        parser: the parser that reports the error.
        options: parsed options, with that of :func:`add_recording_options`.
        path: where the result will be written; only folders in ``RECORDS`` are committed.
    """
    if options.allow_changes or path is None:
        return
    if not any(path.resolve().is_relative_to(kept) for kept in RECORDS):
        return
    commit = git_commit()
    if commit is None:
        why = "this is not a git checkout"
    elif commit.endswith(CHANGES):
        why = "this checkout has uncommitted changes: commit them"
    else:
        return
    parser.error(
        f"{path} must name the commit from which it was made, but {why}, or give --allow-changes"
    )


def record(settings: Mapping[str, Any], **measured: Any) -> dict[str, Any]:
    """A result with everything that is needed to judge and to reproduce it.

    ``measured`` replaces entries that are otherwise filled in, such as the command.
    """
    host = describe_host()
    del host["name"]
    return {
        "schema": SCHEMA,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": " ".join(["python", "-m", _program(), *sys.argv[1:]]),
        "host": host,
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "versions": describe_versions(),
        "settings": dict(settings),
        **measured,
    }


def _program() -> str:
    """The module that was started; a process of pytest has none."""
    spec = sys.modules["__main__"].__spec__
    return spec.name if spec is not None else "unknown"


DIGITS = 6


def write_result(path: Path, document: dict[str, Any], beginnings: Sequence[str]) -> None:
    """Write compact JSON with a line for each of the ``beginnings``, for readable diffs."""
    text = json.dumps(rounded(document, DIGITS), ensure_ascii=False, separators=(",", ":"))
    for beginning in beginnings:
        text = text.replace(beginning, f"\n{beginning}")
    write_atomically(path, (text + "\n").encode())


class StudySummary(EvaluationSummary):
    """The committed summary of an evaluation."""

    planner_wins: dict[str, float]
    """For each method, the share of its flights in which the planner has the higher utility."""


def read_evaluation(name: str) -> StudySummary:
    """The committed summary of an evaluation."""
    return StudySummary.from_json(read(name))


def read_ablation(name: str) -> AblationResult:
    """Read the committed result of an ablation."""
    return AblationResult.from_json(read(name))


def read(name: str) -> dict[str, Any]:
    """Read a committed result of any kind."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
