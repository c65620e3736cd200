"""The results of studies: how they are written and read."""

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
from orchid_uav.storage.files import write_atomically

SCHEMA = 1
ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "studies" / "results"
RECORDS = (RESULTS, ROOT / "runs" / "reference")
"""Folders of committed results."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of a process that is to keep to one core."""


def add_allow_changes(parser: argparse.ArgumentParser) -> None:
    """The option of every program that records."""
    parser.add_argument(
        "--allow-changes",
        action="store_true",
        help="record from a checkout with changes that are not committed, too",
    )


def require_commit(
    parser: argparse.ArgumentParser, options: argparse.Namespace, path: Path | None
) -> None:
    """End before anything is measured if it is to be kept and cannot be found again by a commit.

    Args:
        parser: which tells it.
        options: of a parser with :func:`add_allow_changes`.
        path: where the result is to be written; only the folders of ``RECORDS`` are kept.
    """
    if options.allow_changes or path is None:
        return
    if not any(path.resolve().is_relative_to(kept) for kept in RECORDS):
        return
    commit = git_commit()
    if commit is None:
        why = "this is no checkout of git"
    elif commit.endswith(CHANGES):
        why = "this checkout has changes that are not committed: commit them"
    else:
        return
    parser.error(
        f"{path} is kept with the commit it was made from, and {why}, or give --allow-changes"
    )


def record(settings: Mapping[str, Any], **measured: Any) -> dict[str, Any]:
    """A result with all that is needed to judge it and to get it again.

    Where ``measured`` names what stands there anyway, such as the command, theirs is taken.
    """
    host = describe_host()
    del host["name"]
    return {
        "schema": SCHEMA,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": " ".join(["python", "-m", sys.modules["__main__"].__spec__.name, *sys.argv[1:]]),
        "host": host,
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "versions": describe_versions(),
        "settings": dict(settings),
        **measured,
    }


DIGITS = 6


def write_result(path: Path, document: dict[str, Any], beginnings: Sequence[str]) -> None:
    """A compact result, with a line for each of the ``beginnings``: a change shows what changed."""
    text = json.dumps(rounded(document), ensure_ascii=False, separators=(",", ":"))
    for beginning in beginnings:
        text = text.replace(beginning, f"\n{beginning}")
    write_atomically(path, (text + "\n").encode())


def rounded(value: Any) -> Any:
    """A document without what nobody reads at six digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, list):
        return [rounded(one) for one in value]
    if isinstance(value, dict):
        return {key: rounded(one) for key, one in value.items()}
    return value


class StudySummary(EvaluationSummary):
    """The committed summary of an evaluation."""

    planner_wins: dict[str, float]
    """By method, the share of its flights in which the planner has the higher utility."""


def read_evaluation(name: str) -> StudySummary:
    """The committed summary of an evaluation."""
    return StudySummary.from_json(read(name))


def read_ablation(name: str) -> AblationResult:
    """The committed result of an ablation."""
    return AblationResult.from_json(read(name))


def read(name: str) -> dict[str, Any]:
    """A committed result of any kind."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))
