"""A training that is stopped after every episode and gone on with, a thousand times over."""

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from orchid_uav.experiments.configuration import Layer, RunConfig, merge
from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.runs.directory import Row, RunDirectory
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.experiments.training.loop import train
from orchid_uav.experiments.training.trackers import open_tracker
from studies.torture.subjects import differences, outcome_of_runs

CYCLES = 1000
"""At scale 1."""
_NOTED = (10, 30, 100, 300, 1000)
"""Cycles after which the process and the directory are measured."""
_COMMON: dict[str, Any] = {
    "network.uav_count": 2,
    "network.user_count": 20,
    "network.episode_slots": 10,
    "reset.window": 50,
    "reset.tolerance_jfi": 1e9,
    "reset.tolerance_reward": 1e9,
    "reset.max_resets": 5,
    "checkpoint.every_episodes": 10**6,  # only where a stop is asked for, and at the end
    "checkpoint.keep": 1,
}
_LEARNERS: dict[str, dict[str, Any]] = {
    "MAPPO": {"ppo.hidden_sizes": [16, 16]},
    "MADDPG": {
        "training.algorithm": "maddpg",
        "maddpg.hidden_sizes": [16, 16],
        "maddpg.batch_size": 32,
        "maddpg.buffer_size": 500,
    },
}


class _Stopping(Reporter):
    """Asks for a stop after the first episode that it is shown."""

    def __init__(self, interruption: Interruption) -> None:
        self._interruption = interruption

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Ask for a stop."""
        self._interruption.requested = True


def run(scale: float, seed: int) -> dict[str, Any]:
    """Stop and go on ``CYCLES`` times ``scale`` with each learner, beside an undisturbed run."""
    cycles = max(20, round(CYCLES * scale))
    learners = [of_learner(name, cycles, seed) for name in _LEARNERS]
    return {
        "cycles": cycles,
        "learners": learners,
        "failures": [
            f"{learner['name']} differs: {name}"
            for learner in learners
            for name in learner["differences"]
        ],
    }


def of_learner(name: str, cycles: int, seed: int) -> dict[str, Any]:
    """Stop and go on so many times, beside an undisturbed run of the same configuration."""
    own = _COMMON | _LEARNERS[name] | {"training.episodes": cycles + 1, "training.seed": seed}
    config = merge([Layer("torture", own)])[0]
    with tempfile.TemporaryDirectory() as place:
        whole, pieces = Path(place) / "whole", Path(place) / "pieces"
        _train(RunDirectory.create(whole, "run", config, ["torture"]), config, Reporter())
        run = RunDirectory.create(pieces, "run", config, ["torture"])
        path, noted, done = run.path, [], 0
        began_s = time.monotonic()
        while True:
            interruption = Interruption()
            status = _train(run, config, _Stopping(interruption), interruption)
            if status == "completed":
                break
            done += 1
            if done in _NOTED or done == cycles:
                noted.append({"cycle": done, **_measured(path)})
                print(f"{name}: {noted[-1]}", flush=True)
            config = read_config(path, read_record(path))
            run = RunDirectory.reopen(path, config, ["torture", "--resume"])
        differing = differences(outcome_of_runs(whole), outcome_of_runs(pieces))
        return {
            "name": name,
            "cycles": done,
            "seconds_per_cycle": round((time.monotonic() - began_s) / done, 3),
            "reset_episodes": read_record(path).reset_episodes,
            "noted": noted,
            "differences": differing,
        }


def _train(
    run: RunDirectory,
    config: RunConfig,
    reporter: Reporter,
    interruption: Interruption | None = None,
) -> str:
    """Train as the command does, with its tracker; how the run ended."""
    trackers = [open_tracker("tensorboard", run.path, config)]
    return train(config, run, reporter, trackers, interruption or Interruption()).status


def _measured(run: Path) -> dict[str, int]:
    """What a leak would make grow."""
    fields = dict(
        line.split(":", 1)
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    )
    return {
        "resident_kib": int(fields["VmRSS"].split()[0]),
        "open_files": sum(1 for _ in Path("/proc/self/fd").iterdir()),
        "threads": int(fields["Threads"]),
        "files_of_run": sum(path.is_file() for path in run.rglob("*")),
        "bytes_of_run": sum(path.stat().st_size for path in run.rglob("*") if path.is_file()),
        "bytes_of_record": (run / "run.json").stat().st_size,
    }
