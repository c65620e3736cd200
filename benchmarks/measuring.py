"""What the benchmarks have in common: alternating repetitions and their record."""

import argparse
import ctypes
import os
import statistics
import sys
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from orchid_uav.experiments.files import write_json
from orchid_uav.experiments.provenance import (
    CHANGES,
    describe_host,
    describe_versions,
    git_commit,
)

SCHEMA = 1
ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
RECORDS = (RESULTS, ROOT / "runs" / "reference")
"""Folders of committed results."""
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of a process that is to keep to one core."""
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h

Case = Callable[[int], float]
"""Measures once; its argument is the number of the repetition, from 0."""


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


def arguments_parser(description: str, repetitions: int) -> argparse.ArgumentParser:
    """What every benchmark takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there")
    parser.add_argument(
        "--repetitions",
        type=int,
        default=repetitions,
        help="repetitions of each case (default: %(default)s)",
    )
    add_allow_changes(parser)
    return parser


def arguments(description: str, repetitions: int) -> argparse.Namespace:
    """The command line of a benchmark that takes nothing else."""
    parser = arguments_parser(description, repetitions)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    return options


def alternate(cases: Mapping[str, Case], repetitions: int) -> dict[str, dict[str, Any]]:
    """{"median", "repetitions"} of every case by its name.

    Cases take turns, and another one begins each time, so that a machine that slows down or is
    disturbed for a while does so for all of them. A first round, not recorded, warms up.
    """
    names = list(cases)
    results: dict[str, list[float]] = {name: [] for name in names}
    for name in names:
        cases[name](0)
    for repetition in range(repetitions):
        first = repetition % len(names)
        for name in names[first:] + names[:first]:
            results[name].append(cases[name](repetition))
    return {
        name: {"median": _rounded(statistics.median(values)), "repetitions": _rounded(values)}
        for name, values in results.items()
    }


def ratio(results: Mapping[str, Mapping[str, Any]], over: str, under: str) -> float:
    """Median over the rounds of one case's result divided by the other's in the same round."""
    pairs = zip(results[over]["repetitions"], results[under]["repetitions"], strict=True)
    return round(statistics.median(one / other for one, other in pairs), 2)


def _rounded(value: Any) -> Any:
    """Five digits, which is more than a repetition gives again."""
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.5g}")


def keep_freed_memory(keep: bool) -> None:
    """Whether glibc keeps freed memory of some 100 kB, or hands it back and fetches it anew.

    A process hands it back at first, at a considerable cost to programs with large temporaries,
    and keeps it as soon as it has freed one larger array. Other C libraries are left as they are.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        threshold = 32 << 20 if keep else 128 << 10  # the greatest, and the one at first
        library.mallopt(_M_MMAP_THRESHOLD, threshold)
        library.mallopt(_M_TRIM_THRESHOLD, threshold)


def record(settings: Mapping[str, Any], **figures: Any) -> dict[str, Any]:
    """A result with all that is needed to judge it and to get it again.

    Where ``figures`` name what stands there anyway, such as the command, theirs is taken.
    """
    host = describe_host()
    del host["name"]
    return {
        "schema": SCHEMA,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": " ".join(
            ["python", "-m", f"benchmarks.{Path(sys.argv[0]).stem}", *sys.argv[1:]]
        ),
        "host": host,
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "versions": describe_versions(),
        "settings": dict(settings),
        **figures,
    }


def report(
    title: str, rows: Mapping[str, str], document: Mapping[str, Any], path: Path | None
) -> None:
    """Print a table of names and figures, and write the document if a path is given."""
    table = Table(title=title, show_header=False)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    for name, figure in rows.items():
        table.add_row(name, figure)
    Console().print(table)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, document)
