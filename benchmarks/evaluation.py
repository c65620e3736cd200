"""The time of ``orchid eval``: the UAV study, and the same flights one world at a time.

The study is 7 UAV counts × 6 methods × 100 topologies on one core, from the drawing of the
topologies to the last metric of the last episode, without start-up, bootstrap intervals and plots.

"one at a time" is what one would build from the usual parts: a PettingZoo environment through
SuperSuit to SB3, an SB3 model's ``predict`` on its rows, the metrics from its infos, and the
further metrics (blocking pairs, GBS users, thrust) by the ``Diagnostics`` of ``orchid eval``. It is
timed on a few episodes of every UAV count; the rules fly there, too, without ``predict``.
"""

import itertools
import time
from collections.abc import Sequence
from unittest import mock

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv
from threadpoolctl import threadpool_limits

from benchmarks.measuring import alternate, arguments, ratio, report
from orchid_uav.agents import MAPPO, LocalActor
from orchid_uav.agents.controllers.controller import Controller
from orchid_uav.envs import evaluation_seeds, make_supersuit_vec_env, parallel_env
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.evaluation import flights as flying
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import select
from studies.recording import record

UAVS = range(4, 11)
STUDY = ("orchid", "maddpg-pf", "maddpg-mmf", "static-pf", "static-mmf", "loiter-mmf")
EPISODES = 100
EPISODES_ONE_AT_A_TIME = 1
POLICY = "orchid"


def plan(methods: Sequence[str]) -> EvaluationPlan:
    """The UAV study with some methods."""
    settings = [Setting(uavs=uavs) for uavs in UAVS]
    return EvaluationPlan(select(methods), settings, EPISODES, seed=0, world=Parameters())


def batched_s(methods: Sequence[str]) -> float:
    """Seconds per episode of ``orchid eval``."""
    study = plan(methods)
    began_s = time.perf_counter()
    evaluate(study)
    flights = len(study.settings) * len(study.contenders) * EPISODES
    return (time.perf_counter() - began_s) / flights


def one_at_a_time_s(methods: Sequence[str]) -> float:
    """Seconds per episode through SuperSuit and SB3's ``predict``."""
    took_s = 0.0
    for uavs, contender in itertools.product(UAVS, select(methods)):
        objective = contender.overrides["reward.objective"]
        env = make_supersuit_vec_env(
            lambda uavs=uavs, objective=objective: parallel_env(uavs=uavs, objective=objective)
        )
        model = None if contender.policy is None else _model(env, contender.policy.actor)
        for seed in evaluation_seeds(0, EPISODES_ONE_AT_A_TIME):
            began_s = time.perf_counter()
            _fly(env, model, contender.make([seed]), seed)
            took_s += time.perf_counter() - began_s
    return took_s / (len(UAVS) * len(methods) * EPISODES_ONE_AT_A_TIME)


def _model(env: VecEnv, actor: LocalActor) -> MAPPO:
    """Make an SB3 model with a released actor."""
    model = MAPPO("CentralizedCriticPolicy", env, n_steps=2)
    weights = model.policy.actor.state_dict()
    arrays = [array for layer in actor.layers for array in layer]
    for name, array in zip(weights, arrays, strict=True):
        weights[name] = torch.from_numpy(array.copy())
    model.policy.actor.load_state_dict(weights)
    return model


def _fly(env: VecEnv, model: MAPPO | None, rule: Controller, seed: int) -> dict[str, float]:
    world = env.worlds[0].unwrapped.world
    world.set_progress(1.0)
    env.seed(seed)
    observations = env.reset()
    diagnostics = Diagnostics(world)
    diagnostics.begin()
    rule.begin(world)
    for _ in range(world.parameters.network.episode_slots):
        if model is None:
            actions = rule.act(world)[0].astype(np.float32)
        else:
            actions, _ = model.predict(observations, deterministic=True)
        last = int(world.arrays.slot[0])
        observations, _, _, infos = env.step(actions)
        if world.arrays.slot[0] > last:  # otherwise the next episode has begun
            diagnostics.observe()
    return infos[0]["episode_metrics"] | diagnostics.episode_metrics(0)


def main() -> None:
    """Measure, print and write."""
    options = arguments(__doc__.splitlines()[0], repetitions=3)
    torch.set_num_threads(1)
    with threadpool_limits(1), mock.patch.object(flying, "usable_cores", lambda: 1):
        results = alternate(
            {
                "study, batched": lambda _: batched_s(STUDY),
                "study, one at a time": lambda _: one_at_a_time_s(STUDY),
                "`orchid` alone, batched": lambda _: batched_s([POLICY]),
                "`orchid` alone, one at a time": lambda _: one_at_a_time_s([POLICY]),
            },
            options.repetitions,
        )
    flights = len(UAVS) * len(STUDY) * EPISODES
    study_s = round(results["study, batched"]["median"] * flights, 1)
    ratios = {
        name: ratio(results, f"{name}, one at a time", f"{name}, batched")
        for name in ("study", "`orchid` alone")
    }
    document = record(
        {
            "uavs": list(UAVS),
            "methods": STUDY,
            "episodes": EPISODES,
            "repetitions": options.repetitions,
            "episodes_one_at_a_time": EPISODES_ONE_AT_A_TIME,
        },
        seconds_per_episode=results,
        study_s=study_s,
        ratios=ratios,
    )
    rows = {f"{name}, s": f"{result['median']:.4f}" for name, result in results.items()}
    rows |= {f"{name}, one at a time / batched": f"{value}" for name, value in ratios.items()}
    rows["study, s"] = f"{study_s}"
    report("evaluation", rows, document, options.json)


if __name__ == "__main__":
    main()
