"""The same tuning effort for both algorithms: ``python -m studies.tuning --json FILE``.

This is a random search over the settings that a practitioner would tune; the first trial has the
defaults. Both algorithms get the same numbers of trials, episodes and topologies. Seeds and
topologies are used for nothing else. The score is the mean utility of the deterministic policy at
training progress 1.
"""

import argparse
import random
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from orchid_uav.envs import Parameters
from orchid_uav.experiments.configuration import Layer, RunConfig, merge
from orchid_uav.experiments.evaluation.flights import Plan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import Contender, select
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.experiments.training.loop import train
from orchid_uav.storage.files import write_json
from studies.recording import add_allow_changes, record, require_commit

SEED = 9001
TOPOLOGIES = 100
SPACES: dict[str, dict[str, list[Any]]] = {
    "mappo": {
        "ppo.actor_learning_rate": [3e-5, 1e-4, 3e-4, 1e-3],
        "ppo.critic_learning_rate": [3e-4, 1e-3, 3e-3],
        "ppo.discount": [0.9, 0.97, 0.99],
        "ppo.log_std_init": [0.0, -1.0, -2.0],
        "ppo.epochs": [4, 8],
    },
    "maddpg": {
        "maddpg.actor_learning_rate": [1e-5, 3e-5, 1e-4, 3e-4],
        "maddpg.critic_learning_rate": [3e-4, 1e-3, 3e-3],
        "maddpg.discount": [0.9, 0.97, 0.99],
        "maddpg.exploration_std": [0.1, 0.3, 0.5],
        "maddpg.preactivation_penalty": [1e-3, 1e-1],
    },
}


def trials(algorithm: str, count: int) -> list[dict[str, Any]]:
    """The defaults, then ``count`` - 1 random draws."""
    generator = random.Random(f"{SEED} {algorithm}")
    space = SPACES[algorithm]
    drawn = [
        {key: generator.choice(values) for key, values in space.items()} for _ in range(count - 1)
    ]
    return [{}, *drawn]


def configure(algorithm: str, values: dict[str, Any], episodes: int) -> RunConfig:
    """The configuration of one trial."""
    layer = {
        "training.algorithm": algorithm,
        "training.seed": SEED,
        "training.episodes": episodes,
        **values,
    }
    return merge([Layer("tuning", layer)])[0]


def score(contender: Contender) -> dict[str, float]:
    """Mean utility and a few metrics over the tuning topologies."""
    plan = Plan([contender], [Setting()], TOPOLOGIES, SEED, Parameters())
    (metrics,) = evaluate(plan)[0].values()
    names = ("utility", "energy_efficiency_bit_per_joule", "load_jfi", "rate_jfi", "coverage")
    return {name: float(f"{np.mean(metrics[name]):.6g}") for name in names}


def run_trial(algorithm: str, values: dict[str, Any], episodes: int) -> dict[str, Any]:
    """Train one trial and score it."""
    config = configure(algorithm, values, episodes)
    with tempfile.TemporaryDirectory() as directory:
        run = RunDirectory.create(Path(directory), "tuning", config, [])
        outcome = train(config, run, Reporter())
        metrics = score(select([], [run.path])[0])
    return {"values": values, "seconds": round(outcome.seconds, 1), **metrics}


def main() -> None:
    """Search with both algorithms in turn, and write the log after every trial."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--episodes", type=int, default=200)
    add_allow_changes(parser)
    arguments = parser.parse_args()
    require_commit(parser, arguments, arguments.json)
    settings = {
        "seed": SEED,
        "topologies": TOPOLOGIES,
        "trials": arguments.trials,
        "episodes": arguments.episodes,
        "spaces": SPACES,
    }
    logs: dict[str, list[dict[str, Any]]] = {algorithm: [] for algorithm in SPACES}
    zero_action = score(select(["static-mmf"])[0])
    for number in range(arguments.trials):
        for algorithm, log in logs.items():
            values = trials(algorithm, arguments.trials)[number]
            log.append(run_trial(algorithm, values, arguments.episodes))
            print(algorithm, log[-1], flush=True)
            write_json(arguments.json, record(settings, zero_action=zero_action, trials=logs))


if __name__ == "__main__":
    main()
