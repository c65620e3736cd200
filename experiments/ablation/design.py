"""A base and its variants: trained on the same seeds, flown over the same topologies, compared."""

import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from typing import Any

from orchid_uav.callbacks.reset_and_finetune import has_plateaued
from orchid_uav.envs.metrics import REWARD
from orchid_uav.experiments.ablation.result import AblationSettings, TriggerReplay
from orchid_uav.experiments.ablation.variants import BASE, Variant, apply_variant
from orchid_uav.experiments.configuration import (
    LEARNING_SECTIONS,
    RunConfig,
    flatten,
    reward_differences,
)
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting
from orchid_uav.experiments.evaluation.methods import (
    METHOD_KEYS,
    Contender,
    Policy,
    read_policy,
    rows_of,
    rules,
)
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.runs.directory import FINAL_EPISODES, Row, final_metrics
from orchid_uav.experiments.statistics.comparison import (
    NOT_COMPARED,
    Comparison,
    Difference,
    SeedSummary,
    compare_families,
    compare_pairs,
    describe_seeds,
)
from orchid_uav.experiments.statistics.intervals import INTERVAL, UNKNOWN
from orchid_uav.experiments.statistics.results import EvaluationResult
from orchid_uav.experiments.training.job import TrainingJob

FLOWN = (
    "coverage",
    "energy_efficiency_bit_per_joule",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "utility",
)
"""Metrics on held-out topologies that are compared; per variant they are one family of tests."""
TRAINED = (REWARD, *FLOWN[:-1])
"""Metrics of the last training episodes that are compared; another family per variant."""
SETTLED = (151, 200)
"""First and last episode that the end is compared with, to see a late fall (claim C4)."""
WINDOWS = (10, 25, 50, 100)
TOLERANCES = (0.01, 0.02, 0.05, 0.1)
"""Parameters with which the trigger is replayed on runs without Reset-and-Finetune."""

Values = dict[str, list[float]]
"""One value per seed, by metric; NaN for a run that failed."""


@dataclass(frozen=True)
class Ablation:
    """A base, its variants and seeds, and how their policies are flown."""

    base: RunConfig
    variants: Sequence[Variant]
    seeds: Sequence[int]
    topologies: int
    """Number of held-out topologies that every policy flies."""
    evaluation_seed: int
    margin: float
    """Difference that does not matter in tests of equivalence, as a share of the base's mean."""

    def configurations(self) -> dict[str, RunConfig]:
        """Configurations of the base and all variants, by name, with the base's seed."""
        own = {variant.name: apply_variant(variant, self.base) for variant in self.variants}
        return {BASE: self.base, **own}

    def rewarded_otherwise(self) -> list[str]:
        """Names of the variants whose reward function differs from the base's."""
        base = flatten(self.base)
        return [
            name
            for name, config in self.configurations().items()
            if reward_differences([base, flatten(config)])
        ]

    def jobs(self, runs_dir: Path, command: Sequence[str]) -> list[TrainingJob]:
        """A training job for every seed and configuration, seed by seed."""
        return [
            TrainingJob(name, with_seed(config, seed), runs_dir, tuple(command))
            for seed in self.seeds
            for name, config in self.configurations().items()
        ]

    def describe(self) -> AblationSettings:
        """The settings, as ``ablation.json`` has them."""
        variants = {variant.name: dict(variant.values) for variant in self.variants}
        return AblationSettings(
            base=self.base.model_dump(mode="json"),
            variants=json.loads(json.dumps(variants)),  # tuples become lists
            seeds=list(self.seeds),
            topologies=self.topologies,
            evaluation_seed=self.evaluation_seed,
            margin=self.margin,
            ci95=f"{INTERVAL}, over training seeds",
            family="the figures of one variant in one kind of flight, or in training",
        )

    def plan(self, policies: Mapping[tuple[str, int], Policy]) -> EvaluationPlan:
        """The flights of all policies, of their zero-action twins and of simple rules.

        Args:
            policies: the policies by variant and seed, without those of failed runs.
        """
        objectives: dict[str, None] = {}
        contenders: list[Contender] = []
        for (name, seed), policy in policies.items():
            objectives[policy.config.reward.objective] = None
            own = world_values(policy.config, self.base)
            is_first = seed == next(other for key, other in policies if key == name)
            contenders += [
                contender.with_overrides(own)
                for is_zero in (False, True)
                for contender in rows_of(policy, key_of(name, seed), name, True, is_zero)
                # Without noise the twins of all seeds act alike, so that one is enough.
                if not is_zero or not contender.deterministic or is_first
            ]
        shown = [f"{rule}-{objective}" for rule in ("static", "loiter") for objective in objectives]
        catalogue = rules()
        contenders += [catalogue[key] for key in [*shown, "balanced-loiter"]]
        network = self.base.network
        setting = Setting(
            network.distribution,
            network.uav_count,
            network.user_count,
            network.user_speed_mps,
            network.heading_hold_s,
        )
        world = self.base.network_parameters
        return EvaluationPlan(contenders, [setting], self.topologies, self.evaluation_seed, world)


def with_seed(config: RunConfig, seed: int) -> RunConfig:
    """The configuration with the given seed."""
    training = config.training.model_copy(update={"seed": seed})
    return config.model_copy(update={"training": training})


def key_of(name: str, seed: int) -> str:
    """The key of a run's policy among the flights."""
    return f"{name}-s{seed}"


def world_values(config: RunConfig, base: RunConfig) -> dict[str, Any]:
    """Values in which a variant's world differs from the base's; the variant is flown with them.

    The weights of the reward are left out: all policies are judged by the base's.
    """
    own, others = flatten(config), flatten(base)
    return {
        key: value
        for key, value in own.items()
        if key.partition(".")[0] not in (*LEARNING_SECTIONS, "reward")
        and key not in METHOD_KEYS
        and value != others[key]
    }


def differing_worlds(ablation: Ablation) -> dict[str, list[str]]:
    """The keys of the world that each variant changes, by variant; without unchanged worlds."""
    worlds = {
        name: list(world_values(config, ablation.base))
        for name, config in ablation.configurations().items()
    }
    return {name: keys for name, keys in worlds.items() if keys}


def read_policies(jobs: Iterable[TrainingJob]) -> dict[tuple[str, int], Policy]:
    """Read the policies of the complete runs, by name and seed."""
    found = [(job, job.completed()) for job in jobs]
    return {(job.name, job.config.training.seed): read_policy(path) for job, path in found if path}


def flown_values(
    results: Iterable[EvaluationResult], name: str, seeds: Sequence[int], deterministic: bool
) -> Values:
    """Means over the topologies, per metric and seed."""
    found = {
        result.method: result.metrics for result in results if result.deterministic == deterministic
    }
    return {
        metric: [
            _number(found.get(key_of(name, seed), {}).get(metric, UNKNOWN).mean) for seed in seeds
        ]
        for metric in FLOWN
    }


def trained_values(logs: Sequence[Sequence[Row]]) -> Values:
    """Means of the last training episodes, per metric and run; NaN for a run without episodes."""
    finals = [final_metrics(rows) for rows in logs]
    return {metric: [_number(final.get(metric)) for final in finals] for metric in TRAINED}


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def compare(
    values: Mapping[str, Values],
    metrics: Sequence[str],
    margin: float,
    rewarded_otherwise: Collection[str] = (),
) -> dict[str, dict[str, Comparison]]:
    """Compare each variant with the base by each metric; the metrics of a variant are one family.

    Args:
        values: values of the base and all variants.
        metrics: the metrics to compare.
        margin: margin of equivalence, as a share of the base's mean.
        rewarded_otherwise: variants whose reward function is not the base's. Their rewards cannot
            be compared: the verdict is "not compared", and the reward belongs to no family.
    """
    better = {metric: METRICS[metric].better or "higher" for metric in metrics}
    margins = {}
    for metric in metrics:
        reached = [value for value in values[BASE][metric] if math.isfinite(value)]
        if reached and fmean(reached):
            margins[metric] = margin * abs(fmean(reached))
    comparisons = {}
    for name, own in values.items():
        if name == BASE:
            continue
        apart = [REWARD] if name in rewarded_otherwise and REWARD in better else []
        judged = {metric: way for metric, way in better.items() if metric not in apart}
        own_margins = {metric: one for metric, one in margins.items() if metric in judged}
        found = compare_families(values[BASE], {name: own}, judged, own_margins)[name]
        comparisons[name] = {
            metric: found[metric]
            if metric in found
            else _uncompared(values[BASE][metric], own[metric])
            for metric in better
        }
    return comparisons


def _uncompared(base: Sequence[float], variant: Sequence[float]) -> Comparison:
    """A comparison with nothing but the counts of runs, for a metric that is not compared."""
    counted = compare_pairs(base, variant, None)
    known: dict[str, Any] = {
        name: getattr(counted, name) for name in ("n", "seeds", "failed_base", "failed_variant")
    }
    known["difference"] = Difference(mean=None, median=None, iqm=None, ci95=None, ci95_of=None)
    known["verdict"] = NOT_COMPARED
    return counted.model_copy(update=dict.fromkeys(Comparison.model_fields) | known)


def describe_values(values: Mapping[str, Values]) -> dict[str, dict[str, SeedSummary]]:
    """Interquartile mean, mean, median and spread over seeds, by variant and metric."""
    return {
        name: {metric: describe_seeds(per_seed) for metric, per_seed in own.items()}
        for name, own in values.items()
    }


def late_changes(
    logs: Mapping[str, Sequence[Sequence[Row]]],
) -> dict[str, dict[str, SeedSummary]] | None:
    """The mean of the last episodes minus that of ``SETTLED``, over seeds, by variant and metric.

    None if a run is too short for that.
    """
    runs = [rows for own in logs.values() for rows in own if rows]
    if not runs or min(map(len, runs)) < SETTLED[1] + FINAL_EPISODES:
        return None
    return {
        name: {
            metric: describe_seeds([_late_change(rows, metric) for rows in own])
            for metric in TRAINED
        }
        for name, own in logs.items()
    }


def _late_change(rows: Sequence[Row], metric: str) -> float:
    """The late change of one run; NaN if it failed."""
    if not rows:
        return math.nan
    first, last = SETTLED
    values = [row[metric] for row in rows]
    return fmean(values[-FINAL_EPISODES:]) - fmean(values[first - 1 : last])


def replayed_trigger(logs: Sequence[Sequence[Row]]) -> list[TriggerReplay]:
    """When the trigger of Reset-and-Finetune would have fired, for a grid of its parameters.

    On a policy that does not learn every firing is a false alarm. One tolerance holds for both
    metrics.
    """
    return [
        counted_firings(
            window, tolerance, [first_firing(rows, window, tolerance) for rows in logs if rows]
        )
        for window in WINDOWS
        for tolerance in TOLERANCES
    ]


def counted_firings(window: int, tolerance: float, episodes: Sequence[int | None]) -> TriggerReplay:
    """Count the runs in which the trigger would have fired, from its first episode in each."""
    fired = [episode for episode in episodes if episode is not None]
    return TriggerReplay(
        window=window,
        tolerance=tolerance,
        runs=len(episodes),
        fired=len(fired),
        median_episode=median(fired) if fired else None,
    )


def first_firing(rows: Sequence[Row], window: int, tolerance: float) -> int | None:
    """The first episode at which the trigger would have fired on a run; None if at none."""
    tolerances = {"rate_jfi": tolerance, REWARD: tolerance}
    series = {name: [row[name] for row in rows] for name in tolerances}
    for episode in range(2 * window, len(rows) + 1):
        seen = {name: values[:episode] for name, values in series.items()}
        if has_plateaued(seen, window, tolerances):
            return episode
    return None
