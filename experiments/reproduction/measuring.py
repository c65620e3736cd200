"""Flies what was trained, and makes a row of it."""

import math
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm

from orchid_uav.agents.deployed_actor import LocalActor
from orchid_uav.callbacks import EpisodeCallback, Periodic, UpdateVariance
from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.envs.metrics import EPISODE_METRICS
from orchid_uav.experiments.ablation.design import TOLERANCES, WINDOWS, first_firing
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Metrics, evaluate
from orchid_uav.experiments.evaluation.methods import (
    Contender,
    Policy,
    read_policy,
    rows_of,
    rules,
)
from orchid_uav.experiments.provenance import describe_host, describe_versions
from orchid_uav.experiments.reproduction.rows import SCHEMA, Firing, FlownCase, Row, TrainingCurve
from orchid_uav.experiments.reproduction.settings import (
    CURVE_SEED,
    CURVE_TOPOLOGIES,
    EVALUATION_SEED,
    Case,
    base,
)
from orchid_uav.experiments.reproduction.trainings import Training
from orchid_uav.experiments.runs.directory import Row as EpisodeRow
from orchid_uav.experiments.runs.directory import read_episodes
from orchid_uav.experiments.runs.records import EPISODES_FILE, read_record
from orchid_uav.experiments.training.builders import schedule_episodes
from orchid_uav.experiments.training.loop import WATCHED_FILE
from orchid_uav.storage.files import read_document

BLOCK = 10
"""Episodes in a block of a training curve, for each 1,000 episodes begun."""
EVALUATED_EVERY = 50
"""Episodes from one deterministic evaluation to the next, for each 1,000 episodes begun."""
KEPT_TOPOLOGIES = ("energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi", "worst_rate_bps")
"""Metrics of which every topology's value is kept where figures and spreads need it."""
_CALLS = 2000
_MICROSECONDS = 1e6

Stop = Callable[[], bool]


def watchers(config: RunConfig) -> list[EpisodeCallback]:
    """What watches a training: the deterministic policy on the way, and MAPPO's steps."""
    watching: list[EpisodeCallback] = [
        Periodic(evaluated_every(config), partial(_evaluated, config))
    ]
    if config.training.algorithm == "mappo":
        watching.append(UpdateVariance())
    return watching


def evaluated_every(config: RunConfig) -> int:
    """Episodes from one deterministic evaluation to the next."""
    return EVALUATED_EVERY * math.ceil(config.training.episodes / 1000)


def _evaluated(config: RunConfig, model: BaseAlgorithm, episodes: int) -> dict[str, float]:
    """Means of the deterministic policy, at the training progress of the moment."""
    learner = cast(Any, model)
    actor = LocalActor(learner.policy.actor_layers(), learner.exploration_log_std())
    contender = rows_of(Policy(actor, "", config), "now", "", stochastic=False, is_zero=False)
    return _on_the_way(contender, config, episodes)


def _on_the_way(
    contender: Sequence[Contender], config: RunConfig, episodes: int
) -> dict[str, float]:
    progress = min(episodes / schedule_episodes(config), 1.0)
    metrics = _flown(contender, base(config.network.distribution), config, CURVE_SEED, progress)
    return {name: float(np.mean(metrics[name])) for name in (*EPISODE_METRICS, "utility")}


def _flown(
    contender: Sequence[Contender],
    case: Case,
    config: RunConfig,
    seed: int,
    progress: float = 1.0,
    topologies: int = CURVE_TOPOLOGIES,
    stop: Stop = lambda: False,
) -> Metrics:
    """One contender in one case.

    Raises:
        KeyboardInterrupt: it was asked to stop.
    """
    world = config.network_parameters.with_overrides(dict(case.world))
    plan = EvaluationPlan(
        contender, [case.setting], topologies, seed, world, training_progress=progress
    )
    flown, is_complete = evaluate(plan, stop=stop)
    if not is_complete:
        raise KeyboardInterrupt
    (metrics,) = flown.values()
    return metrics


def row_of_run(
    training: Training,
    run: Path,
    seed: int,
    cases: Iterable[Case],
    topologies: int,
    with_twin: bool,
    stop: Stop,
) -> Row:
    """Fly the policy of a complete run in all cases, and gather what the run has left.

    Args:
        training: what was trained.
        run: its directory.
        seed: its seed.
        cases: where it is flown; the first one also with sampled actions, and by its twin.
        topologies: how many held-out topologies each case has.
        with_twin: whether the zero-action twin flies all cases, not the first alone.
        stop: asked now and then whether to stop.

    Raises:
        KeyboardInterrupt: it was asked to stop.
    """
    began_s = time.perf_counter()
    record, policy = read_record(run), read_policy(run)
    watched = read_document(run / WATCHED_FILE)
    episodes = read_episodes(run / EPISODES_FILE)
    flights: list[FlownCase] = []
    for number, case in enumerate(cases):
        for is_zero in (False, True):
            if not is_zero or with_twin or number == 0:
                is_first = number == 0
                for contender in rows_of(policy, training.key, "", is_first, is_zero):
                    flown = _flown(
                        [contender],
                        case,
                        policy.config,
                        EVALUATION_SEED,
                        topologies=topologies,
                        stop=stop,
                    )
                    keeps = is_first and not is_zero
                    flights.append(described(case, contender, is_zero, flown, keeps))
    return Row(
        **_header(training.key, seed, training.command(seed)),
        episodes=len(episodes),
        seconds_trained=record.seconds,
        seconds_flown=round(time.perf_counter() - began_s, 1),
        reset_episodes=record.reset_episodes,
        curve=training_curve(episodes),
        evaluations=watched[Periodic.__name__]["answers"],
        update_variances=watched.get(UpdateVariance.__name__, {}).get("variances", []),
        firings=_firings(episodes) if not policy.config.reset.enabled else [],
        actor_latency_us=actor_latency_us(policy.actor),
        flights=flights,
    )


def row_of_rule(key: str, cases: Iterable[Case], topologies: int, stop: Stop) -> Row:
    """Fly a rule in all cases."""
    began_s = time.perf_counter()
    contender = rules()[key]
    flights = []
    for case in cases:
        flown = _flown(
            [contender], case, RunConfig(), EVALUATION_SEED, topologies=topologies, stop=stop
        )
        flights.append(described(case, contender, False, flown, keeps_topologies=True))
    return Row(
        **_header(key, None, ("orchid", "eval", "--methods", key)),
        seconds_flown=round(time.perf_counter() - began_s, 1),
        flights=flights,
    )


def row_of_hovering(key: str, rule: str, config: RunConfig) -> Row:
    """The training curve of a fleet that hovers where Phase I has put it, and learns nothing.

    It flies the very topologies of a training with the same seed, one after the other, at the same
    training progress; and as often as a training's policy those on which it is flown on its way.

    Args:
        key: of the row.
        rule: what hovers there.
        config: of the training.
    """
    every, contender = evaluated_every(config), [rules()[rule]]
    return Row(
        **_header(key, config.training.seed, ("orchid", "reproduce", "--only", "fig3")),
        episodes=config.training.episodes,
        curve=training_curve(hover(config)),
        evaluations={
            str(episodes): _on_the_way(contender, config, episodes)
            for episodes in range(every, config.training.episodes + 1, every)
        },
    )


def hover(config: RunConfig) -> list[EpisodeRow]:
    """The episodes of a training in which no UAV does anything."""
    env = FleetVecEnv(config.network_parameters, 1, seed=None)
    env.seed(config.training.seed)
    env.reset()
    nothing = np.zeros((env.num_envs, ACTION_SIZE), np.float32)
    rows: list[EpisodeRow] = []
    for episode in range(config.training.episodes):
        env.set_progress(min(episode / schedule_episodes(config), 1.0))
        for _ in range(config.network.episode_slots):
            *_, infos = env.step(nothing)
        rows.append({"episode": float(episode + 1), **infos[0]["episode_metrics"]})
    return rows


def _header(method: str, seed: int | None, command: Sequence[str]) -> dict[str, Any]:
    host = describe_host()
    del host["name"]
    return {
        "schema": SCHEMA,
        "method": method,
        "seed": seed,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "command": list(command),
        "host": host,
        "versions": describe_versions(),
    }


def described(
    case: Case, contender: Contender, is_zero: bool, flown: Metrics, keeps_topologies: bool
) -> FlownCase:
    """A flight as it stands in a row."""
    return FlownCase(
        **case.setting._asdict(),
        sensing_error_m=case.sensing_error_m,
        deterministic=contender.deterministic,
        is_zero=is_zero,
        metrics={name: _mean_and_std(values) for name, values in flown.items()},
        topologies={name: flown[name].tolist() for name in KEPT_TOPOLOGIES if keeps_topologies},
    )


def _mean_and_std(values: NDArray[np.float64]) -> list[float | None]:
    both = (float(np.mean(values)), float(np.std(values, ddof=1)))
    return [number if math.isfinite(number) else None for number in both]


def training_curve(episodes: Sequence[Mapping[str, float]]) -> TrainingCurve:
    """Means and standard deviations over blocks; the last, incomplete block is left out."""
    block = BLOCK * math.ceil(len(episodes) / 1000)
    count = len(episodes) // block
    tables = {
        name: np.array([row[name] for row in episodes[: count * block]]).reshape(count, block)
        for name in EPISODE_METRICS
    }
    return TrainingCurve(
        block=block,
        mean={name: table.mean(axis=1).tolist() for name, table in tables.items()},
        std={name: table.std(axis=1, ddof=1).tolist() for name, table in tables.items()},
    )


def _firings(episodes: Sequence[EpisodeRow]) -> list[Firing]:
    return [
        Firing(
            window=window, tolerance=tolerance, episode=first_firing(episodes, window, tolerance)
        )
        for window in WINDOWS
        for tolerance in TOLERANCES
    ]


def actor_latency_us(actor: LocalActor, calls: int = _CALLS) -> float:
    """Median time of one decision of one UAV, in microseconds, on one core."""
    observation = np.zeros((1, actor.observation_size), np.float32)
    times = []
    for _ in range(calls):
        began_s = time.perf_counter()
        actor.act(observation)
        times.append(time.perf_counter() - began_s)
    return round(statistics.median(times) * _MICROSECONDS, 2)
