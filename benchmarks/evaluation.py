"""What ``orchid eval`` costs: the UAV study, and the same flights one world at a time.

The study is 7 UAV counts × 6 methods × 100 topologies on one core, from the drawing of the
topologies to the last figure of the last episode; start-up, bootstrap intervals and plots apart.

"one at a time" is what one would write with the usual parts: a PettingZoo environment through
SuperSuit to SB3, an SB3 model's ``predict`` on its rows, the metrics from its infos. It is timed on
a few episodes of every UAV count and flies the learned policies alone; ``orchid eval`` does the
same flights in the same run, with its further figures (blocking pairs, GBS users, thrust).
"""

import time
from collections.abc import Sequence

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv
from threadpoolctl import threadpool_limits

from benchmarks.measuring import alternate, arguments, ratio, record, report
from orchid_uav.agents import MAPPO
from orchid_uav.cli.evaluation_display import SilentProgress
from orchid_uav.envs import evaluation_seeds, make_supersuit_vec_env, parallel_env
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.evaluation import Plan, Setting, evaluate
from orchid_uav.experiments.methods import read_released, select

UAVS = range(4, 11)
STUDY = ("orchid", "maddpg-pf", "maddpg-mmf", "static-pf", "static-mmf", "loiter-mmf")
EPISODES = 100
EPISODES_ONE_AT_A_TIME = 2
POLICY = "orchid"


def plan(methods: Sequence[str]) -> Plan:
    """The UAV study of some methods."""
    settings = [Setting("tcp", uavs, 100, 0.0, 1.0) for uavs in UAVS]
    return Plan(select(methods), settings, EPISODES, seed=0, world=Parameters())


def batched_s(methods: Sequence[str]) -> float:
    """Seconds per episode of ``orchid eval``."""
    study = plan(methods)
    began_s = time.perf_counter()
    evaluate(study, SilentProgress())
    flights = len(study.settings) * len(study.entries) * EPISODES
    return (time.perf_counter() - began_s) / flights


def one_at_a_time_s() -> float:
    """Seconds per episode through SuperSuit and SB3's ``predict``."""
    took_s = 0.0
    for uavs in UAVS:
        env = make_supersuit_vec_env(lambda uavs=uavs: parallel_env(uavs=uavs))
        model = _model(env)
        for seed in evaluation_seeds(0, EPISODES_ONE_AT_A_TIME):
            began_s = time.perf_counter()
            _fly(env, model, seed)
            took_s += time.perf_counter() - began_s
    return took_s / (len(UAVS) * EPISODES_ONE_AT_A_TIME)


def _model(env: VecEnv) -> MAPPO:
    """An SB3 model with the released actor."""
    model = MAPPO("CentralizedCriticPolicy", env, n_steps=2)
    weights = model.policy.actor.state_dict()
    layers = read_released(POLICY).actor.layers
    for (name, _), array in zip(
        weights.items(), [part for layer in layers for part in layer], strict=True
    ):
        weights[name] = torch.from_numpy(array.copy())
    model.policy.actor.load_state_dict(weights)
    return model


def _fly(env: VecEnv, model: MAPPO, seed: int) -> dict[str, float]:
    env.seed(seed)
    observations = env.reset()
    dones = np.zeros(env.num_envs, bool)
    while not dones.any():
        actions, _ = model.predict(observations, deterministic=True)
        observations, _, dones, infos = env.step(actions)
    return infos[0]["episode_metrics"]


def main() -> None:
    """Measure, print, write."""
    options = arguments(__doc__.splitlines()[0], repetitions=3)
    torch.set_num_threads(1)
    with threadpool_limits(1):
        results = alternate(
            {
                "study, per episode": lambda _: batched_s(STUDY),
                "policy, batched": lambda _: batched_s([POLICY]),
                "policy, one at a time": lambda _: one_at_a_time_s(),
            },
            options.repetitions,
        )
    flights = len(UAVS) * len(STUDY) * EPISODES
    study_s = round(results["study, per episode"]["median"] * flights, 1)
    speedup = ratio(results, "policy, one at a time", "policy, batched")
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
        ratio=speedup,
    )
    rows = {f"{name}, s": f"{result['median']:.4f}" for name, result in results.items()}
    rows |= {"study, s": f"{study_s}", "one at a time / batched": f"{speedup}"}
    report("evaluation", rows, document, options.json)


if __name__ == "__main__":
    main()
