"""Training beside BenchMARL's MAPPO: on this project's environment, and on simple_spread.

On this project's environment ``orchid train`` trains on the paper's network as users run it: with
checkpoints, log and TensorBoard's events. BenchMARL's MAPPO uses TorchRL's wrapper and logs
nothing. Both fly one world, update after every episode of 200 slots for 4 epochs, and have networks
with the same layers. A minibatch has 128 samples of one UAV each in ``orchid train``, and 21 frames
of six UAVs in BenchMARL. So both take ten gradient steps per epoch. BenchMARL uses fused Adam here,
like ours, which is not its default.

On simple_spread the settings are those of ``studies.simple_spread.study``. "mappo-stock" is
BenchMARL's MAPPO in TorchRL's wrapper, and "mappo" the same in the validation's batch of worlds.
Judging is outside the measured time.

Every case is a process of its own with one thread. Time begins after imports and construction, and
the cases take turns.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.measuring import alternate, arguments_parser, ratio, report
from orchid_uav.experiments.configuration import RunConfig
from studies.recording import ONE_THREAD, record, require_commit
from studies.simple_spread.study import ROOT, Arm, add_pythons, chosen_pythons

EPISODES, SPREAD_FRAMES = 20, 10_000
_PAPER = RunConfig()
_PPO, _SLOTS = _PAPER.ppo, _PAPER.network.episode_slots
FLEET_SETTINGS = {
    "frames": EPISODES * _SLOTS,
    "worlds": 1,
    "frames_per_iteration": _SLOTS,
    "minibatch_frames": _PPO.batch_size // _PAPER.network.uav_count,
    "epochs": _PPO.epochs,
    "hidden_sizes": list(_PPO.hidden_sizes),
    "learning_rate": _PPO.actor_learning_rate,
    "gamma": _PPO.discount,
    "gae_lambda": _PPO.gae_lambda,
    "clip_range": _PPO.clip_ratio,
    "max_grad_norm": _PPO.max_grad_norm,
}
"""Settings of BenchMARL's run, with the names of ``studies.simple_spread.task.Settings``."""
SPREAD_ARMS = {
    "orchid mappo": ["benchmarl mappo", "benchmarl mappo-stock"],
    "orchid maddpg": ["benchmarl maddpg", "agilerl maddpg"],
}
"""Our learner, and the learners compared with it."""


def orchid_s(repetition: int) -> float:
    """Seconds of ``orchid train``."""
    with tempfile.TemporaryDirectory() as directory:
        command = [sys.executable, "-m", "orchid_uav", "train", "--json", "--quiet"]
        command += ["--set", "ppo.minibatch=rows"]  # as many gradient steps as BenchMARL takes
        command += ["--episodes", str(EPISODES), "--seed", str(repetition)]
        return json.loads(_output([*command, "--runs-dir", directory]))["seconds"]


def benchmarl_s(python: str, parts: list[dict[str, Any]], repetition: int) -> float:
    """Seconds of BenchMARL on the same environment; their parts are appended to ``parts``."""
    command = [python, "-m", "benchmarks.benchmarl_fleet", json.dumps(FLEET_SETTINGS)]
    parts.append(json.loads(_output([*command, str(repetition)]).splitlines()[-1]))
    return parts[-1]["seconds"]


def spread_s(arm: Arm, python: str, repetition: int) -> float:
    """Seconds of training on simple_spread."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "run.json"
        _output(arm.command({arm.library: python}, repetition, out))
        return json.loads(out.read_text(encoding="utf-8"))["training_s"]


def _output(command: list[str]) -> str:
    environment = os.environ | ONE_THREAD
    return subprocess.run(
        command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True
    ).stdout


def main() -> None:
    """Measure and report."""
    parser = arguments_parser(__doc__.splitlines()[0], repetitions=3)
    add_pythons(parser)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    pythons = chosen_pythons(options)
    parts: list[dict[str, Any]] = []
    fleet = alternate(
        {
            "orchid train": orchid_s,
            "BenchMARL MAPPO": partial(benchmarl_s, pythons["benchmarl"], parts),
        },
        options.repetitions,
    )
    judging = {"frames": SPREAD_FRAMES, "curve_points": 1, "curve_episodes": 1, "final_episodes": 1}
    names = [name for own, others in SPREAD_ARMS.items() for name in (own, *others)]
    arms = [Arm(*name.split(), judging) for name in names]
    spread = alternate(
        {arm.name: partial(spread_s, arm, pythons[arm.library]) for arm in arms},
        options.repetitions,
    )
    spent = {
        part: round(statistics.median(run[part] for run in parts[1:]), 4)
        for part in ("collecting_s", "learning_s")
    }
    ratios = {
        "BenchMARL MAPPO / orchid train": ratio(fleet, "BenchMARL MAPPO", "orchid train"),
        **{
            f"{other} / {own}": ratio(spread, other, own)
            for own, others in SPREAD_ARMS.items()
            for other in others
        },
    }
    speeds = {
        name: round(frames / case["median"])
        for cases, frames in ((fleet, FLEET_SETTINGS["frames"]), (spread, SPREAD_FRAMES))
        for name, case in cases.items()
    }
    document = record(
        {
            "repetitions": options.repetitions,
            "episodes": EPISODES,
            "spread_frames": SPREAD_FRAMES,
            "benchmarl": FLEET_SETTINGS,
        },
        seconds=fleet,
        spread_seconds=spread,
        benchmarl_spent_s=spent,
        benchmarl_versions=parts[0]["versions"],
        frames_per_second=speeds,
        ratios=ratios,
        command="python -m benchmarks.training_speed",  # without this machine's paths
    )
    rows = {name: f"{value} frames/s" for name, value in speeds.items()}
    rows |= {f"BenchMARL, {part}": f"{value:.2f} s" for part, value in spent.items()}
    rows |= {name: f"{value:.2f} x" for name, value in ratios.items()}
    report("Training, one thread", rows, document, options.json)


if __name__ == "__main__":
    main()
