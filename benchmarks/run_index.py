"""The time of ``orchid runs list`` with a thousand runs.

The runs have the episodes and the policy of a released run, but their own ids, seeds and metrics;
files that a listing does not read are hard links. Measured are the whole command, with its output
as for a file and as for a terminal, the reading and sorting alone, and the start of any command
and of Python itself.
"""

import hashlib
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

from benchmarks.measuring import alternate, arguments, ratio, report
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import RunDirectory, read_episodes
from orchid_uav.experiments.runs.filters import Keys, select
from orchid_uav.experiments.runs.index import TRAINING_METRICS, read_index
from orchid_uav.experiments.runs.records import CONFIG_FILE, EPISODES_FILE, RECORD_FILE
from orchid_uav.storage.files import json_bytes, read_document, sealed
from studies.recording import record

RUNS = 1000
WHOLE, ON_TERMINAL = "`orchid runs list`", "`orchid runs list` on a terminal"
TARGET_S = 1.0
POLICY = Path("runs/reference/orchid")
POLICY_FILES = ("policy.json", "policy.safetensors")
WHERE, SORT = "reset.kappa=0.5", "-rate_jfi"


def make_runs(runs_dir: Path, count: int) -> None:
    """Write run directories that differ in seed, factor at a reset, and metrics."""
    rows = read_episodes(POLICY / EPISODES_FILE)
    template = RunDirectory.create(runs_dir, "lab", RunConfig(), ["orchid", "train"])
    template.append_episodes(rows)
    template.write_policy({name: (POLICY / name).read_bytes() for name in POLICY_FILES})
    template.finish("completed", rows, [101], seconds=300.0)
    config = read_document(template.path / CONFIG_FILE)
    generator = random.Random(0)
    for number in range(1, count):
        started = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(hours=number)
        run_id = f"{started:%Y%m%dT%H%M%SZ}-lab-s{number}-abcd"
        path = runs_dir / run_id
        (path / "checkpoints" / "700").mkdir(parents=True)
        config["training"]["seed"] = number
        config["reset"]["kappa"] = generator.choice((0.1, 0.5))
        content = json_bytes(config)
        own = {
            "id": run_id,
            "started": started.isoformat(timespec="seconds"),
            "config_sha256": hashlib.sha256(content).hexdigest(),
            "final": {
                name: value and value * generator.uniform(0.9, 1.1)
                for name, value in template.record.final.items()
            },
        }
        (path / CONFIG_FILE).write_bytes(content)
        (path / RECORD_FILE).write_bytes(json_bytes(sealed(template.record.to_json() | own)))
        for name in (EPISODES_FILE, *POLICY_FILES):
            os.link(template.path / name, path / name)


def command_s(given: Sequence[str], as_on_terminal: bool = False) -> float:
    """Seconds of a command in a process of its own."""
    variables = {"FORCE_COLOR": "1", "COLUMNS": "140"} if as_on_terminal else {}
    began_s = time.perf_counter()
    subprocess.run(
        [sys.executable, *given],
        env=os.environ | variables,
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return time.perf_counter() - began_s


def reading_s(directory: Path) -> float:
    """Seconds to read, filter and sort in this process."""
    began_s = time.perf_counter()
    runs = read_index(directory).runs
    keys = Keys(runs)
    chosen = select(runs, keys, [keys.condition(WHERE)], SORT)
    took_s = time.perf_counter() - began_s
    assert len(runs) == RUNS and 0 < len(chosen) < RUNS and set(TRAINING_METRICS) <= set(keys.known)
    return took_s


def main() -> None:
    """Measure, print and write."""
    options = arguments(__doc__.splitlines()[0], repetitions=15)
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        make_runs(directory, RUNS)
        listing = ["-m", "orchid_uav", "runs", "list", "--runs-dir", name]
        commands = {
            WHOLE: listing,
            f"`orchid runs list --where {WHERE} --sort {SORT}`": [
                *listing,
                f"--where={WHERE}",
                f"--sort={SORT}",
            ],
            "`orchid runs list --json`": [*listing, "--json"],
            "`orchid --version`": ["-m", "orchid_uav", "--version"],
            "python alone": ["-c", "pass"],
        }
        results = alternate(
            {case: (lambda _, given=given: command_s(given)) for case, given in commands.items()}
            | {
                ON_TERMINAL: lambda _: command_s(listing, as_on_terminal=True),
                "reading, filtering, sorting alone": lambda _: reading_s(directory),
            },
            options.repetitions,
        )
    ratios = {
        f"{WHOLE} / {other}": ratio(results, WHOLE, other)
        for other in ("`orchid --version`", "python alone")
    }
    document = record(
        {"runs": RUNS, "repetitions": options.repetitions, "target_s": TARGET_S},
        seconds=results,
        ratios=ratios,
        is_below_target=all(results[case]["median"] < TARGET_S for case in (WHOLE, ON_TERMINAL)),
    )
    rows = {f"{name}, s": f"{result['median']:.3f}" for name, result in results.items()}
    rows |= {name: f"{value}" for name, value in ratios.items()}
    report(f"{RUNS} runs listed", rows, document, options.json)


if __name__ == "__main__":
    main()
