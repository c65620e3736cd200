"""Measure once in whatever checkout runs this file; :mod:`benchmarks.before` starts it.

Only what every version has is used here. The argument is a JSON object; one number is printed.
"""

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any


def training_s(values: dict[str, Any], episodes: int) -> float:
    """Seconds of the learning loop, after a short run that loads all that torch loads late."""
    from orchid_uav.experiments.configuration import Layer, merge
    from orchid_uav.experiments.runs.directory import RunDirectory
    from orchid_uav.experiments.training.listeners import Reporter
    from orchid_uav.experiments.training.loop import train

    seconds = 0.0
    for count in (3, episodes):
        config = merge([Layer("probe", {**values, "training.episodes": count})])[0]
        with tempfile.TemporaryDirectory() as directory:
            run = RunDirectory.create(Path(directory), "probe", config, [])
            before_s = time.process_time()
            train(config, run, Reporter())
            seconds = time.process_time() - before_s
    return seconds


def world_steps_per_s(uavs: int, users: int, worlds: int, slots: int) -> float:
    """World-steps per second, without resets, observations and state included."""
    import numpy as np

    from orchid_uav.envs.parameters import Parameters
    from orchid_uav.envs.world import WorldBatch

    overrides = {"network.uav_count": uavs, "network.user_count": users}
    batch = WorldBatch(Parameters().with_overrides(overrides), worlds, seed=0)
    pool = np.random.default_rng(0).uniform(-1.0, 1.0, (slots, worlds, uavs, 4))
    best_s = float("inf")
    for _ in range(3):
        batch.reset()
        before_s = time.perf_counter()
        for actions in pool:
            batch._step_worlds(batch.constants, batch.arrays, actions, 0.5)
        best_s = min(best_s, time.perf_counter() - before_s)
    return worlds * slots / best_s


def stay_on_one_core() -> None:
    """The last one, where the system lets choose: cores of a shared machine differ by a fifth."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


if __name__ == "__main__":
    stay_on_one_core()
    wanted = json.loads(sys.argv[1])
    measure = {"training": training_s, "simulator": world_steps_per_s}[wanted.pop("kind")]
    print(measure(**wanted))
