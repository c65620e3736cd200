"""This code beside the code before it: ``python -m benchmarks.before PATH --json FILE``.

PATH is a checkout of another commit with a ``.venv`` of its own (``git worktree add PATH COMMIT``,
then ``make install`` there). Every measurement is a process with one thread, in the one or the
other checkout, and all take turns. Trainings are measured in seconds of processor time, simulators
in world-steps per second of the best of three episodes.
"""

import json
import os
import subprocess
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.measuring import Case, alternate, arguments_parser, ratio, report
from studies.recording import ONE_THREAD, record, require_commit

PROBE = Path(__file__).with_name("probe.py")
NOW = Path(__file__).parent.parent
EPISODES = 40
MAPPO: dict[str, Any] = {"training.algorithm": "mappo"}
MADDPG: dict[str, Any] = {"training.algorithm": "maddpg"}
BEFORE: dict[str, dict[str, Any]] = {
    "MAPPO": {"kind": "training", "values": MAPPO, "episodes": EPISODES},
    "MADDPG": {"kind": "training", "values": MADDPG, "episodes": EPISODES},
    "6 x 100": {"kind": "simulator", "uavs": 6, "users": 100, "worlds": 64, "slots": 200},
    "20 x 1,000": {"kind": "simulator", "uavs": 20, "users": 1000, "worlds": 8, "slots": 50},
    "200 x 20,000": {"kind": "simulator", "uavs": 200, "users": 20_000, "worlds": 1, "slots": 20},
}
"""What both checkouts can do, by name; a simulator is named by UAVs and users."""
AFTER = {
    **BEFORE,
    "MAPPO": {**BEFORE["MAPPO"], "values": {**MAPPO, "ppo.minibatch": "rows"}},
    "MAPPO, slots": {**BEFORE["MAPPO"], "values": {**MAPPO, "ppo.minibatch": "slots"}},
}


def measured(checkout: Path, wanted: Mapping[str, Any], repetition: int) -> float:
    """One measurement in a checkout."""
    finished = subprocess.run(
        [str(checkout / ".venv/bin/python"), "-P", str(PROBE), json.dumps(wanted)],
        env={**os.environ, **ONE_THREAD},
        check=True,
        capture_output=True,
        text=True,
    )
    return float(finished.stdout.splitlines()[-1])


def commit_of(checkout: Path) -> str:
    """The commit that is checked out."""
    command = ["git", "-C", str(checkout), "rev-parse", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def main() -> None:
    """Measure and report."""
    parser = arguments_parser("This code beside the code before it.", repetitions=3)
    parser.add_argument("checkout", type=Path, metavar="PATH", help="checkout of the code before")
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    cases: dict[str, Case] = {}
    for name, wanted in AFTER.items():
        cases[name] = partial(measured, NOW, wanted)
        if name in BEFORE:
            cases[f"{name}, before"] = partial(measured, options.checkout, BEFORE[name])
    results = alternate(cases, options.repetitions)
    ratios = {}
    for name, wanted in AFTER.items():
        before = f"{name if name in BEFORE else 'MAPPO'}, before"
        # How many times as fast: by seconds it is before over now, by speeds now over before.
        pair = (before, name) if wanted["kind"] == "training" else (name, before)
        ratios[name] = ratio(results, *pair)
    document = record(
        {
            "episodes": EPISODES,
            "repetitions": options.repetitions,
            "before": commit_of(options.checkout),
        },
        command=f"python -m benchmarks.before PATH --repetitions {options.repetitions}",
        results=results,
        times_as_fast=ratios,
    )
    rows = {name: f"{result['median']:,.2f}" for name, result in results.items()}
    rows |= {f"{name}: times as fast": f"{value:.2f}" for name, value in ratios.items()}
    report("Now and before, one thread", rows, document, options.json)


if __name__ == "__main__":
    main()
