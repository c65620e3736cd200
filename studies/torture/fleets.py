"""Fleets far larger than the paper's: time and memory against their size."""

import json
import os
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np

from studies.recording import ONE_THREAD

UAVS = (1, 10, 50, 200)
USERS = (100, 1_000, 20_000)
_SLOTS = 20
"""Timed in each world; the first ones are left out."""
_WARM_UP = 3
_REPETITIONS = 5
_EPISODE_SLOTS = 200


def run(scale: float, seed: int) -> dict[str, Any]:
    """Measure every size in a process of its own; the largest ones only at scale 1."""
    sizes = [
        (uavs, users)
        for users in USERS
        for uavs in UAVS
        if uavs <= users and (scale >= 1.0 or uavs * users <= scale * UAVS[-1] * USERS[-1])
    ]
    fleets, failures = [], []
    for uavs, users in sizes:
        command = [sys.executable, "-m", "studies.torture.fleets", str(uavs), str(users), str(seed)]
        ended = subprocess.run(
            command, check=False, capture_output=True, text=True, env={**os.environ, **ONE_THREAD}
        )
        if ended.returncode:
            failures.append(f"{uavs} UAVs, {users} users: {ended.stderr.strip()[-300:]}")
            continue
        fleets.append(json.loads(ended.stdout.splitlines()[-1]))
        print(f"{uavs} UAVs, {users} users: {fleets[-1]}", flush=True)
    return {"slots": _SLOTS, "repetitions": _REPETITIONS, "fleets": fleets, "failures": failures}


def measure(uavs: int, users: int, seed: int) -> dict[str, Any]:
    """One fleet: Phase I, a slot of the simulator, a decision of the policy, and memory."""
    from orchid_uav.envs import Parameters, WorldBatch
    from orchid_uav.experiments.evaluation.methods import read_released

    actor = read_released("orchid").actor
    _fly(WorldBatch(Parameters(), seed=seed), actor, 2)  # compiles, or reads what was compiled
    before_kib = _peak_kib()
    values = {"uav_count": uavs, "user_count": users, "episode_slots": _EPISODE_SLOTS}
    world = WorldBatch(Parameters().with_overrides(values), seed=seed)
    began_s = time.perf_counter()
    world.reset()
    deployed_s = time.perf_counter() - began_s
    rounds = [_fly(world, actor, _SLOTS) for _ in range(_REPETITIONS)]
    stepped_s, decided_s = (min(times) for times in zip(*rounds, strict=True))
    metrics = world.episode_metrics(0)
    return {
        "uavs": uavs,
        "users": users,
        "deployment_s": round(deployed_s, 4),
        "slot_ms": round(1e3 * stepped_s, 4),
        "decision_ms": round(1e3 * decided_s, 4),
        "memory_mib": round((_peak_kib() - before_kib) / 1024, 1),
        "process_mib": round(_peak_kib() / 1024, 1),
        "is_finite": all(bool(np.isfinite(value)) for value in metrics.values()),
    }


def _fly(world: Any, actor: Any, slots: int) -> tuple[float, float]:
    """Median seconds of a slot, and of the decisions for it of all UAVs."""
    world.reset()
    stepped, decided = [], []
    for slot in range(slots + _WARM_UP):
        began_s = time.perf_counter()
        actions = actor.act(world.observations().reshape(world.uav_count, -1))
        between_s = time.perf_counter()
        world.step(actions.reshape(1, world.uav_count, -1))
        ended_s = time.perf_counter()
        if slot >= _WARM_UP:
            decided.append(between_s - began_s)
            stepped.append(ended_s - between_s)
    return float(np.median(stepped)), float(np.median(decided))


def _peak_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    print(json.dumps(measure(*map(int, sys.argv[1:4]))))
