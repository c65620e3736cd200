"""Rows of a reproduction that never ran, with effects that are known."""

import functools
import zlib
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from orchid_uav.experiments.ablation.design import TOLERANCES, WINDOWS
from orchid_uav.experiments.reproduction.job import HOVERING, RULES
from orchid_uav.experiments.reproduction.result import SCHEMA as DOCUMENT_SCHEMA
from orchid_uav.experiments.reproduction.result import TABLED, Reproduction, RowKey, reproduction
from orchid_uav.experiments.reproduction.rows import SCHEMA, Firing, FlownCase, Row, TrainingCurve
from orchid_uav.experiments.reproduction.settings import QUICK_CASES, Case, flown_by
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.statistics.results import ResultHeader

EFFICIENCY = "energy_efficiency_bit_per_joule"
USUAL = {
    "reward": 300.0,
    "coverage": 1.0,
    EFFICIENCY: 0.30e6,
    "rate_jfi": 0.80,
    "load_jfi": 0.85,
    "worst_rate_bps": 5e6,
    "utility": 1.5,
    "displacement_m": 150.0,
    "nearest_uav_m": 400.0,
    "user_snr_db": 20.0,
    "blocking_pairs": 2.0,
    "collisions": 0.0,
}
"""What every method reaches, but for its effects."""
EFFECTS: dict[str, dict[str, float]] = {
    "orchid": {"rate_jfi": -0.05, "load_jfi": -0.03},
    "orchid-zero": {"rate_jfi": 0.02, "utility": 0.05},
    "maddpg-mmf": {EFFICIENCY: 0.04e6},
    "maddpg-pf": {"reward": -8.0},
    "static-mmf": {"reward": 20.0, "rate_jfi": 0.05, "load_jfi": 0.05},
    "static-pf": {"reward": 20.0, "rate_jfi": 0.05, "load_jfi": 0.05, "worst_rate_bps": -1e6},
    "orchid-long": {"worst_rate_bps": 0.5e6, "nearest_uav_m": 60.0},
    "orchid-informed": {"utility": 0.4, "rate_jfi": 0.1, "worst_rate_bps": 2e6},
    "best-response": {"utility": 0.8, "rate_jfi": 0.17, "worst_rate_bps": 3e6},
    "balanced-loiter": {"utility": 0.6, "rate_jfi": 0.12, "worst_rate_bps": 2.5e6},
}
"""By method, beside the usual."""
SEED_NOISE, TOPOLOGY_NOISE = 0.004, 0.05
"""Standard deviations as shares of the usual value."""
UNSTEADY = {"orchid-no-rf": 12.0, "orchid-random-init": 12.0, "orchid-pf": 12.0}
"""How much more than others some methods scatter between their seeds."""
LEARNED_METRICS = ("reward", "coverage", EFFICIENCY, "rate_jfi", "load_jfi", "worst_rate_bps")
VERSIONS = {"orchid_uav": "0.1.0", "git_commit": "1234567890abcdef1234567890abcdef12345678"}


def noise_of(*names: object) -> np.random.Generator:
    """A generator that depends on names alone."""
    return np.random.default_rng(zlib.crc32(repr(names).encode()))


@functools.cache
def drawn_of(*names: object) -> float:
    """A standard normal number that depends on names alone."""
    return float(noise_of(*names).normal())


def mean_of(label: str, metric: str, seed: int | None) -> float:
    """What a method with a seed reaches over all topologies."""
    value = USUAL[metric] + EFFECTS.get(label, {}).get(metric, 0.0)
    if metric in ("coverage", "collisions") or seed is None or label.endswith("-zero"):
        return value
    scatter = SEED_NOISE * UNSTEADY.get(label, 1.0) * USUAL[metric]
    return value + scatter * drawn_of(label, metric, seed)


def make_flight(
    label: str, case: Case, seed: int | None, deterministic: bool = True, keeps: bool = False
) -> FlownCase:
    """A flight whose means are those of :func:`mean_of`, and worse where users walk."""
    lost = 0.02 * case.setting.speed_mps / 15.0
    metrics, topologies = {}, {}
    for metric in TABLED:
        mean = mean_of(label, metric, seed)
        mean -= lost * (metric in ("rate_jfi", "load_jfi")) * (label != "orchid")
        std = TOPOLOGY_NOISE * USUAL[metric] * (metric != "coverage")
        metrics[metric] = [mean, std]
        if keeps:
            drawn = noise_of(label, metric, seed, "topologies").normal(size=20)
            topologies[metric] = (mean + std * (drawn - drawn.mean())).tolist()
    return FlownCase(
        **case.setting._asdict(),
        sensing_error_m=case.sensing_error_m,
        deterministic=deterministic,
        is_zero=label.endswith("-zero"),
        metrics=metrics,
        topologies=topologies,
    )


def make_curve(label: str, seed: int, episodes: int) -> TrainingCurve:
    """A training that begins a tenth below its end, and comes near it."""
    block = 10 * -(-episodes // 1000)
    count = episodes // block
    rise = 1.0 - 0.1 * np.exp(-4.0 * np.arange(count) / count)
    mean = {}
    for metric in LEARNED_METRICS:
        scatter = 0.01 * USUAL[metric] * (metric != "coverage")
        drawn = noise_of(label, metric, seed, "curve").normal(size=count)
        mean[metric] = (mean_of(label, metric, seed) * rise + scatter * drawn).tolist()
    return TrainingCurve(
        block=block, mean=mean, std={metric: [0.0] * count for metric in LEARNED_METRICS}
    )


def make_row(method: str, seed: int | None, is_quick: bool = False, **changes: object) -> Row:
    """A row of a method, of a rule, or of hovering while others are trained."""
    is_trained = method in TRAININGS
    flown = TRAININGS[method].flown if is_trained else "everything"
    cases = QUICK_CASES if is_quick else flown_by(flown)
    flights = [] if "flights" in changes else list(_flights(method, seed, cases))
    beside = HOVERING[method].beside if method in HOVERING else "orchid"
    trained = method if is_trained else beside
    episodes = 150 if is_quick else _episodes(trained)
    values: dict[str, object] = {
        "schema": SCHEMA,
        "method": method,
        "seed": seed,
        "date": "2026-11-27",
        "command": list(TRAININGS[method].command(seed or 0)) if is_trained else ["orchid"],
        "host": {"system": "Linux x86_64", "processor": "Test processor", "cores": 2},
        "versions": VERSIONS,
        "is_quick": is_quick,
        "flights": flights,
        "seconds_flown": 36.0,
    }
    if seed is not None:
        values["episodes"] = episodes
        if "curve" not in changes:
            values["curve"] = make_curve(method, seed, episodes)
    if is_trained:
        values |= _learned(method, int(seed or 0), episodes)
    return Row.model_validate(values | changes)


def _flights(method: str, seed: int | None, cases: Sequence[Case]) -> Iterator[FlownCase]:
    if seed is None:
        yield from (make_flight(method, case, None, keeps=True) for case in cases)
    elif method in TRAININGS:
        for number, case in enumerate(cases):
            yield make_flight(method, case, seed, keeps=number == 0)
        yield make_flight(method, cases[0], seed, deterministic=False, keeps=True)
        for case in cases if seed == SEEDS[0] else cases[:1]:
            yield make_flight(f"{method}-zero", case, seed)


@functools.cache
def _episodes(method: str) -> int:
    return TRAININGS[method].config(SEEDS[0]).training.episodes


def _learned(method: str, seed: int, episodes: int) -> dict[str, object]:
    every = 50 * -(-episodes // 1000)
    evaluations = {
        str(episode): {metric: mean_of(method, metric, seed) for metric in LEARNED_METRICS}
        for episode in range(every, episodes + 1, every)
    }
    return {
        "seconds_trained": 324.0,
        "reset_episodes": [] if "no-rf" in method else [100 + seed],
        "evaluations": evaluations,
        "update_variances": np.where(np.arange(episodes) < 100 + seed, 4e-11, 1e-11).tolist(),
        "firings": [
            Firing(window=window, tolerance=tolerance, episode=200 if window < 30 else None)
            for window in WINDOWS
            for tolerance in TOLERANCES
        ],
        "actor_latency_us": 25.0,
    }


def make_rows(
    methods: Iterable[str] = TRAININGS,
    seeds: Sequence[int] = SEEDS,
    rules: Iterable[str] = RULES,
    is_quick: bool = False,
    **changes: object,
) -> Iterator[Row]:
    """Rows of trained methods and of rules."""
    for rule in rules:
        yield make_row(rule, None, is_quick, **changes)
    for method in (*(HOVERING if rules else ()), *methods):
        for seed in seeds:
            yield make_row(method, seed, is_quick, **changes)


def make_reproduction(
    rows: Sequence[Row], missing: Sequence[RowKey] = (), is_quick: bool = False
) -> Reproduction:
    """What rows say, of which some more are asked for."""
    header = ResultHeader.model_validate(
        {
            "schema": DOCUMENT_SCHEMA,
            "status": "completed",
            "date": "2026-11-27",
            "command": ["orchid", "reproduce"],
            "versions": VERSIONS,
            "host": {"system": "Linux x86_64", "processor": "Test processor", "cores": 2},
        }
    )
    asked = [*((row.method, row.seed) for row in rows), *missing]
    return reproduction(header, rows, asked, is_quick)
