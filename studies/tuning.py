"""The same tuning effort for both algorithms: ``python -m studies.tuning --jobs 2``.

Two trials are known beforehand, the paper's numbers and what a trial outside this study had found;
others are drawn at random from what a practitioner would tune, and one follows from those. Both
algorithms get the same numbers of trials, seeds, episodes and topologies, and seeds and topologies
are used for nothing else. A run is stopped several times on its way, where its deterministic policy
is flown. So a recipe is judged along the curve as well as at the end: one that rises and then
collapses loses.

Results are written after every run, and the same command continues there.
"""

import argparse
import random
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from orchid_uav.envs import Parameters
from orchid_uav.experiments.configuration import Layer, RunConfig, merge
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import Contender, select
from orchid_uav.experiments.provenance import git_commit
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.experiments.training.loop import train
from orchid_uav.storage.files import read_document
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

NAME = "tuning"
FIRST_SEED = 9001
TOPOLOGIES = 100
JUDGED = 4
"""Points of a run at which its policy is flown, evenly spaced; the last is the end."""
METRICS = (
    "utility",
    "energy_efficiency_bit_per_joule",
    "load_jfi",
    "rate_jfi",
    "coverage",
    "boundary_violations",
)
SPACES: dict[str, dict[str, list[Any]]] = {
    "mappo": {
        "ppo.actor_learning_rate": [1e-5, 3e-5, 1e-4, 3e-4],
        "ppo.critic_learning_rate": [3e-4, 1e-3, 3e-3],
        "ppo.discount": [0.9, 0.97, 0.99],
        "ppo.log_std_init": [0.0, -1.0, -2.0],
        "ppo.minibatch": ["rows", "slots"],
        "training.center_rewards": [False, True],
    },
    "maddpg": {
        "maddpg.actor_learning_rate": [1e-5, 3e-5, 1e-4, 3e-4],
        "maddpg.critic_learning_rate": [3e-4, 1e-3, 3e-3],
        "maddpg.discount": [0.9, 0.97, 0.99],
        "maddpg.exploration_std": [0.1, 0.3, 0.5],
        "maddpg.preactivation_penalty": [1e-3, 0.1, 1.0],
        "training.center_rewards": [False, True],
    },
}
KNOWN: dict[str, dict[str, Any]] = {
    "mappo": {
        "ppo.actor_learning_rate": 3e-4,
        "ppo.critic_learning_rate": 1e-3,
        "ppo.discount": 0.9,
        "ppo.gae_lambda": 0.9,
        "ppo.log_std_init": -1.8,
    },
    "maddpg": {
        "maddpg.actor_learning_rate": 1e-5,
        "maddpg.critic_learning_rate": 3e-3,
        "maddpg.discount": 0.9,
        "maddpg.preactivation_penalty": 1.0,
    },
}
"""What was known to work when the search was set up, one recipe for each."""
LATER: dict[str, list[dict[str, Any]]] = {
    algorithm: [{**values, "training.center_rewards": True}] for algorithm, values in KNOWN.items()
}
"""What the trials before suggested: the known recipes with centred rewards."""

Run = dict[str, Any]
"""Algorithm, trial and seed of a run, and what it gave."""


def trials(algorithm: str, count: int) -> list[dict[str, Any]]:
    """The paper's numbers, the known recipe and random draws, ``count`` in all; then the later."""
    generator = random.Random(f"{FIRST_SEED} {algorithm}")
    space = SPACES[algorithm]
    drawn = [{key: generator.choice(values) for key, values in space.items()} for _ in range(count)]
    return [{}, KNOWN[algorithm], *drawn][:count] + LATER[algorithm]


def configure(algorithm: str, values: Mapping[str, Any], seed: int, episodes: int) -> RunConfig:
    """The configuration of a run up to its first judgement; schedules are those of the whole."""
    layer = {
        "training.algorithm": algorithm,
        "training.seed": seed,
        "training.episodes": episodes // JUDGED,
        "training.schedule_episodes": episodes,
        **values,
    }
    return merge([Layer(NAME, layer)])[0]


def flown(contender: Contender, seed: int = FIRST_SEED) -> dict[str, float]:
    """Means over the topologies of a seed."""
    plan = EvaluationPlan([contender], [Setting()], TOPOLOGIES, seed, Parameters())
    (metrics,) = evaluate(plan)[0].values()
    return {name: float(np.mean(metrics[name])) for name in METRICS}


def score(judged: list[Mapping[str, float]]) -> float:
    """Utility of one run: half its mean along the curve, half its end."""
    utility = [one["utility"] for one in judged]
    return 0.5 * float(np.mean(utility)) + 0.5 * utility[-1]


def run(algorithm: str, trial: int, values: Mapping[str, Any], seed: int, episodes: int) -> Run:
    """Train one seed of a trial, and fly its policy on the way and at the end."""
    config = configure(algorithm, values, seed, episodes)
    judged: list[Mapping[str, float]] = []
    with tempfile.TemporaryDirectory() as directory:
        made = RunDirectory.create(Path(directory), NAME, config, [])
        while True:
            seconds = train(config, made, Reporter()).seconds
            judged.append(flown(select([], [made.path])[0]))
            if len(judged) == JUDGED:
                break
            config = config.extended_to(config.training.episodes + episodes // JUDGED)
            made = RunDirectory.reopen(made.path, config, [])
    return {
        "algorithm": algorithm,
        "trial": trial,
        "seed": seed,
        "seconds": round(seconds, 1),
        "score": score(judged),
        "judged": judged,
    }


def missing(
    runs: list[Run], values: Mapping[str, list[dict[str, Any]]], seed_count: int
) -> Iterator[tuple[str, int, Mapping[str, Any], int]]:
    """Arguments of the runs that are not there, one trial of both algorithms after the other."""
    known = {(one["algorithm"], one["trial"], one["seed"]) for one in runs}
    for number in range(len(next(iter(values.values())))):
        for algorithm, seed in product(values, range(FIRST_SEED, FIRST_SEED + seed_count)):
            if (algorithm, number, seed) not in known:
                yield algorithm, number, values[algorithm][number], seed


def goes_on_with(before: dict[str, Any], settings: dict[str, Any]) -> bool:
    """Whether a search with these settings begins with the trials of the one before."""
    return {**before, "values": None} == {**settings, "values": None} and all(
        settings["values"][algorithm][: len(tried)] == tried
        for algorithm, tried in before["values"].items()
    )


def main() -> None:
    """Search, and write the log after every run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=7, help="without the later ones")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=1)
    add_recording_options(parser, RESULTS / f"{NAME}.json")
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    settings = {
        "first_seed": FIRST_SEED,
        "seeds": options.seeds,
        "topologies": TOPOLOGIES,
        "trials": options.trials,
        "episodes": options.episodes,
        "judged": JUDGED,
        "values": {algorithm: trials(algorithm, options.trials) for algorithm in SPACES},
    }
    runs: list[Run] = []
    if options.json.exists():
        before = read_document(options.json)
        if not goes_on_with(before["settings"], settings):
            parser.error(f"{options.json} holds another search: move it away")
        runs = before["runs"]
    zero_action = flown(select(["static-mmf"])[0])
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        waiting = [
            pool.submit(run, *arguments, options.episodes)
            for arguments in missing(runs, settings["values"], options.seeds)
        ]
        for finished in as_completed(waiting):
            runs.append({**finished.result(), "git_commit": git_commit()})
            print(
                {key: runs[-1][key] for key in ("algorithm", "trial", "seed", "score")}, flush=True
            )
            runs.sort(key=lambda one: (one["algorithm"], one["trial"], one["seed"]))
            document = record(settings, zero_action=zero_action, runs=runs)
            write_result(options.json, document, ('{"algorithm"',))


if __name__ == "__main__":
    main()
