"""What trained policies do once their exploration noise is gone.

``python -m studies.movements NAME RUNS`` flies every complete run in a directory of runs on
held-out topologies, and describes how its UAVs move: how fast, whether on a straight line, on loops
or not at all, and whether all of them in the same direction.
"""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs import WorldBatch
from orchid_uav.envs.seeds import evaluation_seeds
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import Policy, read_policy, rows_of
from orchid_uav.experiments.reproduction.settings import EVALUATION_SEED
from orchid_uav.experiments.runs.records import read_record
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

FOLDER = RESULTS / "movements"
TOPOLOGIES = 20
LATE_SLOTS = 50
STILL_MPS, LOOP_SHARE, LEAST_PATH_M = 0.05, 0.2, 20.0
"""A UAV stands still below this speed; it loops if it gets no farther than this share of a path
that is at least so long."""
REPEATS = 0.9
"""A UAV flies to and fro if it turns back in every slot, and its move after the next one is the
same again: at least by this share of its square."""
METRICS = (
    *("utility", "energy_efficiency_bit_per_joule", "thrust_energy_efficiency_bit_per_joule"),
    *("propulsion_power_w", "rate_jfi"),
)
_RUN = re.compile(r"\d{8}T\d{6}Z-(.+)-s(\d+)-[a-z]{4}")

Floats = NDArray[np.float64]


def flown_positions_m(policy: Policy, topologies: int = TOPOLOGIES) -> Floats:
    """Positions (slots + 1, topologies, UAVs, 3) of the policy's UAVs without noise, in m."""
    parameters = policy.config.network_parameters
    world = WorldBatch(parameters, topologies, evaluation_seeds(EVALUATION_SEED, topologies))
    world.set_progress(1.0)
    world.reset()
    positions = [world.arrays.positions_m.copy()]
    for _ in range(policy.config.network.episode_slots):
        seen = world.observations()
        actions = policy.actor.act(seen.reshape(-1, seen.shape[-1]))
        world.step(actions.reshape(topologies, world.uav_count, -1))
        positions.append(world.arrays.positions_m.copy())
    return np.array(positions)


def described(positions_m: Floats, slot_s: float) -> dict[str, float]:
    """How UAVs move in the plane.

    Args:
        positions_m: (slots + 1, topologies, UAVs, 3).
        slot_s: duration of a slot.
    """
    plane = positions_m[..., :2]
    late = plane[-LATE_SLOTS - 1 :]
    steps = np.linalg.norm(np.diff(late, axis=0), axis=-1)
    paths, ways = steps.sum(axis=0), late[-1] - late[0]
    gained = np.linalg.norm(ways, axis=-1)
    moving = paths > STILL_MPS * slot_s * LATE_SLOTS
    directions = ways[moving] / np.maximum(gained[moving], 1e-9)[:, None]
    same = float(np.linalg.norm(directions.mean(axis=0))) if moving.any() else 0.0
    loops = (paths > LEAST_PATH_M) & (gained < LOOP_SHARE * paths)
    moves = np.diff(late, axis=0)
    first, second, third = moves[:-2], moves[1:-1], moves[2:]
    turns_back = (first * second).sum((0, -1)) < 0.0
    repeats = (first * third).sum((0, -1)) > REPEATS * (first * first).sum((0, -1))
    to_and_fro = moving & turns_back & repeats
    return {
        "speed_mps": float(steps.mean() / slot_s),
        "still": float(1.0 - moving.mean()),
        "loops": float(loops.mean()),
        "to_and_fro": float(to_and_fro.mean()),
        "straightness": float((gained[moving] / paths[moving]).mean()) if moving.any() else 0.0,
        "same_direction": same,
        "distance_m": float(np.linalg.norm(plane[-1] - plane[0], axis=-1).mean()),
        "climb_m": float((positions_m[-1, ..., 2] - positions_m[0, ..., 2]).mean()),
    }


def reached(policy: Policy) -> dict[str, float]:
    """What it reaches on the same flights, in the network that it was trained in."""
    network = policy.config.network
    contender = rows_of(policy, "policy", "", stochastic=False, is_zero=False)
    setting = Setting(network.distribution, network.uav_count, network.user_count)
    world = policy.config.network_parameters
    plan = EvaluationPlan(contender, [setting], TOPOLOGIES, EVALUATION_SEED, world)
    (metrics,) = evaluate(plan)[0].values()
    return {metric: float(np.mean(metrics[metric])) for metric in METRICS}


def movements(runs: Sequence[Path]) -> list[dict[str, Any]]:
    """The movements of every complete run, by method and seed."""
    found = []
    for run in sorted(runs):
        match = _RUN.fullmatch(run.name)
        if match is None or read_record(run).status != "completed":
            continue
        policy = read_policy(run)
        moves = described(flown_positions_m(policy), policy.config.network.slot_s)
        found.append({"method": match[1], "seed": int(match[2]), **moves, **reached(policy)})
    return sorted(found, key=lambda one: (one["method"], one["seed"]))


def main() -> None:
    """Describe the runs of all directories that are named."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.movements", description=__doc__.splitlines()[0]
    )
    parser.add_argument("name", help="the result goes to studies/results/movements/NAME.json")
    parser.add_argument("runs", type=Path, nargs="+", help="directories of runs")
    add_recording_options(parser)
    options = parser.parse_args()
    target = FOLDER / f"{options.name}.json"
    require_commit(parser, options, target)
    found = movements([run for directory in options.runs for run in directory.iterdir()])
    settings = {"topologies": TOPOLOGIES, "late_slots": LATE_SLOTS, "seed": EVALUATION_SEED}
    command = f"python -m studies.movements {options.name} RUNS: {len(found)} runs"
    document = record(settings, command=command, runs=found)
    write_result(target, document, ('{"method":',))
    for one in found:
        print(one)


if __name__ == "__main__":
    main()
