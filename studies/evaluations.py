"""The evaluations that the documentation shows: ``make studies``.

Each is one ``orchid eval`` command; its summary is kept with rounded numbers.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from orchid_uav.experiments.evaluation.directory import EPISODES_FILE, SUMMARY_FILE
from orchid_uav.experiments.evaluation.flights import CEILING
from orchid_uav.experiments.metrics import label_of
from studies.recording import (
    ONE_THREAD,
    RESULTS,
    add_recording_options,
    require_commit,
    write_result,
)

PLANNER_BUDGETS = (31, 100, 300, 1000, 3000, 10000)
PAPER_AND_BOUNDS = (
    "orchid,orchid-zero,orchid-no-rf,orchid-no-rf-zero,orchid-tuned,orchid-tuned-zero,"
    "maddpg-pf,maddpg-pf-zero,maddpg-mmf,maddpg-mmf-zero,static-pf,static-mmf,loiter-mmf,"
    "balanced-loiter,planner"
)

STUDIES: dict[str, tuple[str, ...]] = {
    "methods": (
        *("--methods", "all,balanced-loiter-retargeted,planner-retargeted"),
        "--stochastic",
    ),
    "uavs": ("--uavs", "4..10", "--methods", PAPER_AND_BOUNDS),
    "uavs_60mhz": (
        *("--uavs", "4..10", "--set", "network.total_bandwidth_hz=60e6"),
        *("--methods", "orchid,maddpg-pf,maddpg-mmf,static-pf,static-mmf,loiter-mmf"),
    ),
    "n_init_10": (
        *("--set", "deployment.n_init=10"),
        *("--methods", "orchid,orchid-zero,static-pf,static-mmf,loiter-mmf,balanced-loiter"),
    ),
    "mobility": (
        *("--speeds", "0..15:5", "--heading-hold", "1,20"),
        *("--methods", "orchid,maddpg-mmf,static-mmf,loiter-mmf,balanced-loiter,track,planner"),
    ),
    **{
        f"planner_{budget}": (
            *("--methods", "loiter-mmf,balanced-loiter,planner"),
            *("--planner-evaluations", str(budget)),
        )
        for budget in PLANNER_BUDGETS
    },
}


def run(name: str) -> None:
    """Fly a study and write its summary."""
    environment = os.environ | ONE_THREAD
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "out"
        command = [sys.executable, "-m", "orchid_uav", "eval", *STUDIES[name], "--quiet"]
        subprocess.run(
            [*command, "--no-figures", "--out", str(out)],
            check=True,
            stdout=subprocess.DEVNULL,
            env=environment,
        )
        document = json.loads((out / SUMMARY_FILE).read_text(encoding="utf-8"))
        document["planner_wins"] = planner_wins(pq.read_table(out / EPISODES_FILE).to_pylist())
    document["command"] = ["orchid", "eval", *STUDIES[name]]
    write_result(RESULTS / f"{name}.json", document, ('{"method":"',))


def planner_wins(rows: list[dict[str, Any]]) -> dict[str, float]:
    """For each method, the share of its flights in which the planner has the higher utility."""
    names = ("distribution", "uavs", "users", "speed_mps", "heading_hold_s", "episode")
    planned = {
        tuple(row[name] for name in names): row["utility"]
        for row in rows
        if row["method"] == CEILING
    }
    wins: dict[str, list[bool]] = {}
    for row in rows:
        own = tuple(row[name] for name in names)
        if own in planned and row["method"] != CEILING:
            wins.setdefault(label_of(row["method"], row["deterministic"]), []).append(
                planned[own] > row["utility"]
            )
    return {label: sum(won) / len(won) for label, won in wins.items()}


def main() -> None:
    """Run all evaluations, or the named ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="STUDY")
    add_recording_options(parser)
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(STUDIES):
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(STUDIES)}")
    require_commit(parser, arguments, RESULTS)
    for name in arguments.names or STUDIES:
        run(name)
        print(f"wrote {name}.json", flush=True)


if __name__ == "__main__":
    main()
