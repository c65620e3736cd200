"""Train the released policies by their documented commands: ``make reference``.

Each run of ``orchid train`` is made in a runs directory of its own. Its configuration, episodes,
weights and record are copied to ``runs/reference/KEY``, the record without what names the machine
and the process. ``evaluation.json`` holds what the policy does on a few topologies; a test flies
them again.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from orchid_uav.agents.deployed_actor import DESCRIPTION_FILE, WEIGHTS_FILE
from orchid_uav.envs import Parameters
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import COMMANDS, read_policy, rows_of
from orchid_uav.storage.files import sealed, write_json
from studies.recording import add_recording_options, require_commit

REFERENCE = Path(__file__).parent.parent / "runs" / "reference"
KEPT_FILES = ("config.json", "episodes.csv", WEIGHTS_FILE, DESCRIPTION_FILE)
EVALUATION_FILE = "evaluation.json"
TOPOLOGIES = 10
_PROCESS_KEYS = ("pid", "boot_id")


def train(key: str, runs_dir: Path) -> Path:
    """Run the documented command, and return the run's directory."""
    command = [
        *(sys.executable, "-m", "orchid_uav", "train", *COMMANDS[key], "--name", key),
        *("--runs-dir", str(runs_dir / key), "--quiet"),
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (run,) = (runs_dir / key).iterdir()
    return run


def release(run: Path, key: str) -> None:
    """Copy the files of a run that others need."""
    record = json.loads((run / "run.json").read_text(encoding="utf-8"))
    if record["status"] != "completed":
        raise RuntimeError(f"{run} is {record['status']}")
    target = REFERENCE / key
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for name in KEPT_FILES:
        shutil.copyfile(run / name, target / name)
    record = {name: value for name, value in record.items() if name not in _PROCESS_KEYS}
    del record["host"]["name"]
    record["command"] = ["orchid", "train", *COMMANDS[key], "--name", key]
    write_json(target / "run.json", sealed(record))


def fly(key: str) -> dict[str, list[float]]:
    """Every metric of a released policy on the first held-out topologies."""
    # As it lies here: the installed package may not know of it yet.
    policy = rows_of(read_policy(REFERENCE / key), key, "", stochastic=False, is_zero=False)
    plan = EvaluationPlan(policy, [Setting()], TOPOLOGIES, seed=0, world=Parameters())
    flown, _ = evaluate(plan)
    (metrics,) = flown.values()
    return {name: values.tolist() for name, values in metrics.items()}


def main() -> None:
    """Train all policies, or the named ones, in parallel."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("keys", nargs="*", metavar="KEY")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--fly-alone", action="store_true", help="train nothing, fly again")
    add_recording_options(parser)
    arguments = parser.parse_args()
    if unknown := set(arguments.keys) - set(COMMANDS):
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(COMMANDS)}")
    require_commit(parser, arguments, REFERENCE)
    # The longest runs first, so that no processor idles at the end.
    keys = sorted(arguments.keys or COMMANDS, key=lambda key: "maddpg" not in COMMANDS[key])
    if arguments.fly_alone:
        for key in keys:
            write_json(REFERENCE / key / EVALUATION_FILE, fly(key))
        return
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(arguments.jobs) as pool:
        runs = {key: pool.submit(train, key, Path(name)) for key in keys}
        for key, run in runs.items():
            release(run.result(), key)
            write_json(REFERENCE / key / EVALUATION_FILE, fly(key))
            print(f"wrote {(REFERENCE / key).relative_to(REFERENCE.parent.parent)}", flush=True)


if __name__ == "__main__":
    main()
