"""What the benchmarks share: alternating repetitions, and how they are recorded."""

import argparse
import ctypes
import statistics
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from orchid_uav.storage.files import write_json
from studies.recording import add_recording_options, require_commit

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h

Case = Callable[[int], float]
"""A function that measures once; its argument is the number of the repetition, from 0."""


def arguments_parser(description: str, repetitions: int) -> argparse.ArgumentParser:
    """A parser with the options that every benchmark takes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all numbers there")
    parser.add_argument(
        "--repetitions",
        type=int,
        default=repetitions,
        help="repetitions of each case (default: %(default)s)",
    )
    add_recording_options(parser)
    return parser


def arguments(description: str, repetitions: int) -> argparse.Namespace:
    """Parse the command line of a benchmark without further options."""
    parser = arguments_parser(description, repetitions)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    return options


def alternate(cases: Mapping[str, Case], repetitions: int) -> dict[str, dict[str, Any]]:
    """Measure all cases; return {"median", "repetitions"} of each by its name.

    Cases take turns, and each round begins with another one, so that a machine that is slow or
    disturbed for a while affects all of them. A first round warms up and is not recorded.
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
    """Median over rounds of one case's result divided by the other's in the same round."""
    pairs = zip(results[over]["repetitions"], results[under]["repetitions"], strict=True)
    return round(statistics.median(one / other for one, other in pairs), 2)


def _rounded(value: Any) -> Any:
    """Round to five digits, which is more than a repetition reproduces."""
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.5g}")


def keep_freed_memory(keep: bool) -> None:
    """Make glibc keep freed blocks of some 100 kB, or return them to the system.

    At first a process returns them, at a considerable cost to programs with large temporaries. It
    keeps them as soon as it has freed one larger array. Other C libraries are not changed.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        threshold = 32 << 20 if keep else 128 << 10  # the greatest threshold, and the initial one
        library.mallopt(_M_MMAP_THRESHOLD, threshold)
        library.mallopt(_M_TRIM_THRESHOLD, threshold)


def report(
    title: str, rows: Mapping[str, str], document: Mapping[str, Any], path: Path | None
) -> None:
    """Print a table of names and numbers, and write the document if a path is given."""
    table = Table(title=title, show_header=False)
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    for name, text in rows.items():
        table.add_row(name, text)
    Console().print(table)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(path, document)
