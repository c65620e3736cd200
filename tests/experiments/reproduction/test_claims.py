"""Every claim holds where its effect is planted, and fails where the opposite is.

Effects are in margins; what they are planted in is written down here a second time, from the words
of the claim.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pytest

from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import BLOCK_MARGINS, MARGINS, SPREAD_MARGINS
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.job import HOVERING, RULES
from orchid_uav.experiments.reproduction.needs import needed_for
from orchid_uav.experiments.reproduction.result import TABLED, judged
from orchid_uav.experiments.reproduction.rows import FlownCase, Row, TrainingCurve
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.statistics import intervals
from tests.helpers.reproductions import USUAL, drawn_of, make_row, noise_of

COVERAGE, EFFICIENCY, RATE, LOAD = TABLED[:4]
WORST, UTILITY, REWARD = "worst_rate_bps", "utility", "reward"
FAIRNESS = (RATE, LOAD)
LEARNED = ("orchid", "maddpg-pf", "maddpg-mmf")
EPISODES, BLOCK, TOPOLOGIES = 700, 10, 20
BY_CLAIM = {claim.key: claim for claim in (*CLAIMS, *QUESTIONS)}


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    """Intervals decide nothing, and take most of the time."""
    monkeypatch.setattr(intervals, "RESAMPLES", 20)


class Effect(NamedTuple):
    """What one label has more than all others."""

    label: str
    metrics: Sequence[str]
    margins: float
    kind: str = "mean"
    """Of flights their "mean", or their "spread" over topologies; of a training its whole "curve",
    how it is "late" in its last 50 episodes, or how its "early" and its "last" 200 jump."""
    where: Callable[[Case], bool] = lambda case: True
    axis: Callable[[Case], bool] = lambda case: True
    """The cases that the claim is about; in all others the effect is the opposite."""


def users(case: Case) -> bool:
    return case.setting.uavs == 6 and case.setting.speed_mps == case.sensing_error_m == 0.0


def uavs(case: Case) -> bool:
    return case.setting.users == 100 and case.setting.speed_mps == case.sensing_error_m == 0.0


def papers(case: Case) -> bool:
    return users(case) and uavs(case)


def walking(case: Case) -> bool:
    return case.setting.speed_mps > 0.0


def on_any_axis(case: Case) -> bool:
    return case.sensing_error_m == 0.0


def of_stations(case: Case) -> bool:
    return walking(case) and case.setting.heading_hold_s == 20.0


def fast(case: Case) -> bool:
    return case.setting.speed_mps == 15.0


def wrong(case: Case) -> bool:
    return case.sensing_error_m > 0.0


def of_each(labels: Sequence[str], *effect, **named) -> list[Effect]:
    return [Effect(label, *effect, **named) for label in labels]


def crowded(case: Case) -> bool:
    return case.setting.users == 200


PLANTED: dict[str, list[Effect]] = {
    "c1": [
        Effect("static-mmf", [REWARD], 5, "curve"),
        Effect("static-pf", [REWARD, *FAIRNESS], 5, "curve"),
    ],
    "c3": [Effect("orchid", [REWARD, EFFICIENCY], -4, "early")],
    "c4": [
        Effect("orchid-no-rf", [EFFICIENCY, LOAD], -5, "late"),
        Effect("orchid", [EFFICIENCY, LOAD], 5, "late"),
    ],
    "c6": of_each(LEARNED, [EFFICIENCY], 5, where=crowded, axis=users),
    "c7": [Effect("maddpg-mmf", [EFFICIENCY], 5, axis=users)],
    "c8": [Effect("static-pf", [EFFICIENCY], -5, axis=users)],
    "c9": [Effect("orchid", [EFFICIENCY], -5, "spread", axis=users)],
    "c10": [Effect("orchid", FAIRNESS, 5, axis=users)],
    "c11": [
        Effect("maddpg-mmf", [EFFICIENCY], 3, axis=uavs),
        Effect("static-pf", [EFFICIENCY], -5, axis=uavs),
    ],
    "c12": [Effect("orchid", [EFFICIENCY], -5, "spread", axis=uavs)],
    "c31": [Effect("orchid", [EFFICIENCY], -5, "spread", axis=walking)],
    "c13": [Effect("orchid", FAIRNESS, 5, axis=uavs)],
    "c15": [
        Effect("static-pf", FAIRNESS, -5, where=fast),
        Effect("static-pf", FAIRNESS, 5, "spread", where=fast),
        Effect("orchid", FAIRNESS, 5, where=fast),
    ],
    "c16": [
        Effect("orchid-random-init", [REWARD], 5, "curve"),
        Effect("orchid-random-init", [EFFICIENCY, LOAD], -5, "curve"),
        Effect("orchid-random-init", [EFFICIENCY, LOAD], 4, "last"),
    ],
    "c18": [Effect("orchid-long", [EFFICIENCY], 5, axis=papers)],
    "c19": [Effect("orchid-long", [WORST], 5, axis=papers)],
    "c20": [Effect("orchid", ["blocking_pairs"], -5)],
    "c21": [Effect("orchid-long", ["nearest_uav_m"], 5, axis=papers)],
    "c22": [Effect("orchid-pf", ["user_snr_db"], 5, axis=papers)],
    "c23": of_each(("maddpg-pf", "maddpg-mmf"), [EFFICIENCY], 5, axis=on_any_axis),
    "c24": [Effect("static-pf", [EFFICIENCY], -5, where=fast)],
    "c25": [
        Effect("static-pf", FAIRNESS, 5, axis=uavs),
        Effect("static-pf", FAIRNESS, 5, "spread", axis=uavs),
    ],
    "c26": [Effect("maddpg-mmf", FAIRNESS, -5, "spread", axis=users)],
    "c28": [Effect("orchid", [*FAIRNESS, UTILITY], 5, where=wrong)],
    "q1": [Effect("orchid", [UTILITY, RATE, WORST], 5, axis=papers)],
    "q2": [Effect("orchid", [UTILITY, EFFICIENCY, *FAIRNESS], 5, axis=papers)],
    "q3": [Effect("orchid", [UTILITY], 5, axis=papers)],
    "q4": [Effect("orchid-informed", [UTILITY, RATE, WORST], 5, axis=of_stations)],
    "q5": [Effect("orchid-informed", [UTILITY, EFFICIENCY, *FAIRNESS], 5, axis=of_stations)],
    "q6": [Effect("orchid-informed", [UTILITY], 5, axis=of_stations)],
    "q7": [
        Effect("orchid", FAIRNESS, 5, axis=users),
        Effect("orchid", [EFFICIENCY], -5, "spread", axis=users),
    ],
    "q8": [
        Effect("orchid-tuned", FAIRNESS, 5, axis=users),
        Effect("orchid-tuned", [EFFICIENCY], -5, "spread", axis=users),
    ],
}
"""What makes a claim true; with the other sign it is false."""
AGAINST: dict[str, list[Effect]] = {
    "c2": [Effect("orchid", [EFFICIENCY], -5), Effect("orchid", [EFFICIENCY], -5, "curve")],
    "c5": of_each(LEARNED, [COVERAGE], -5, axis=users),
    "c14": of_each(LEARNED, [COVERAGE], -5, axis=walking),
    "c17": [Effect("orchid-long", [RATE], 5, axis=papers)],
    "c30": [Effect("orchid", FAIRNESS, -5, where=fast)],
}
"""What makes a claim false that is true where nothing differs."""


class World(NamedTuple):
    """Rows with effects."""

    effects: Sequence[Effect]
    metrics: Sequence[str]
    signs: Mapping[str, float]
    """Factors on the effects, by distribution of users."""

    def of(self, label: str, metric: str, kind: str, case: Case | None = None) -> float:
        """The effects, in margins."""
        total = 0.0
        for effect in self.effects:
            if (effect.label, effect.kind) != (label, kind) or metric not in effect.metrics:
                continue
            if case is None:
                total += self.signs["tcp"] * effect.margins
            elif effect.where(case):
                on_axis = 1.0 if effect.axis(case) else -1.0
                total += on_axis * self.signs[case.setting.distribution] * effect.margins
        return total

    def flight(self, label: str, case: Case, seed: int | None) -> FlownCase:
        """A method, a twin or a rule in a case."""
        metrics, topologies = {}, {}
        for metric in self.metrics:
            margin = MARGINS.get(metric, 1.0)
            noise = 0.0
            if seed is not None and not label.endswith("-zero"):
                noise = 0.1 * drawn_of(label, metric, seed)
            mean = USUAL[metric] + margin * (self.of(label, metric, "mean", case) + noise)
            widening = SPREAD_MARGINS.get(metric, 0.0) * self.of(label, metric, "spread", case)
            std = (0.2 + widening) * (USUAL[metric] if metric == EFFICIENCY else 1.0)
            metrics[metric] = [mean, std]
            if seed is None or case == settings.base("tcp"):
                drawn = np.tile([-1.0, 1.0], TOPOLOGIES // 2)
                own = noise_of(label, metric, case, "topologies").normal(size=TOPOLOGIES)
                topologies[metric] = (mean + std * drawn + 0.1 * margin * own).tolist()
        return FlownCase(
            **case.setting._asdict(),
            sensing_error_m=case.sensing_error_m,
            deterministic=True,
            is_zero=label.endswith("-zero"),
            metrics=metrics,
            topologies=topologies,
        )

    def curve(self, label: str, seed: int) -> TrainingCurve:
        """A level training whose blocks jump to and fro."""
        blocks = EPISODES // BLOCK
        mean = {}
        for metric in {*self.metrics} & {REWARD, *TABLED[:4]}:
            noise = 0.1 * drawn_of(label, metric, seed, "curve")
            level = np.full(blocks, self.of(label, metric, "curve") + noise)
            level[-5:] += self.of(label, metric, "late")
            size = np.zeros(blocks)
            size[:20] = 5.0 + self.of(label, metric, "early")
            size[-20:] = 5.0 + self.of(label, metric, "last")
            jumps = BLOCK_MARGINS.get(metric, 0.0) * size * np.tile([-1.0, 1.0], blocks // 2)
            mean[metric] = (USUAL[metric] + MARGINS[metric] * level + jumps).tolist()
        return TrainingCurve(block=BLOCK, mean=mean, std={})

    def rows(self, methods: set[str], cases: Sequence[Case]) -> Iterator[Row]:
        """Of all seeds of these methods, and of these rules."""
        for method in sorted(methods):
            if method in RULES:
                flights = [self.flight(method, case, None) for case in cases]
                yield make_row(method, None, flights=flights)
            if method in RULES and method not in HOVERING:
                continue
            for seed in SEEDS:
                labels = (method, f"{method}-zero") if method in TRAININGS else ()
                flights = [self.flight(label, case, seed) for case in cases for label in labels]
                curve = self.curve(method, seed)
                yield make_row(method, seed, episodes=EPISODES, flights=flights, curve=curve)


def verdicts_of(key: str, effects: Sequence[Effect], tcp: float, uniform: float) -> list[str]:
    """The verdicts for both distributions of users, each with its sign of the effects."""
    claim = BY_CLAIM[key]
    metrics = sorted({check.metric for check in claim.checks("tcp")})
    world = World(effects, metrics, {"tcp": tcp, "uniform": uniform})
    evidence = Evidence(world.rows(needed_for([key]), settings.flown_by("everything")), SEEDS)
    found = judged(claim, evidence, is_quick=False)
    return [one.verdict for one in (found.tcp, found.uniform) if one is not None]


@pytest.mark.parametrize("key", PLANTED)
def test_a_claim_holds_where_it_is_true_and_not_where_the_opposite_is(key):
    holds, fails = verdicts_of(key, PLANTED[key], 1.0, -1.0), ["holds", "does not hold"]
    assert holds == fails[: len(holds)]
    assert verdicts_of(key, PLANTED[key], -1.0, 1.0) == fails[::-1][: len(holds)]


@pytest.mark.parametrize("key", AGAINST)
def test_a_claim_that_nothing_is_lost_holds_until_something_is(key):
    fails = verdicts_of(key, AGAINST[key], 1.0, 0.0)
    assert fails == ["does not hold", "holds"][: len(fails)]
    assert verdicts_of(key, AGAINST[key], 0.0, 1.0) == ["holds", "does not hold"][: len(fails)]


@pytest.mark.parametrize(("share", "verdict"), [(1.0, "holds"), (25.0, "does not hold")])
def test_variances_of_updates_are_compared_with_the_square_of_the_factor(share, verdict):
    rows = []
    for method, kappa in (("orchid", 0.5), ("orchid-decay-only", 0.5), ("orchid-kappa-0.1", 0.1)):
        for seed in SEEDS:
            after = share * kappa**2 * (1.0 + 0.01 * drawn_of(method, seed))
            variances = [1.0] * 100 + [after] * 600
            rows.append(make_row(method, seed, reset_episodes=[100], update_variances=variances))
    assert judged(BY_CLAIM["c27"], Evidence(rows, SEEDS), is_quick=False).tcp.verdict == verdict


def test_all_claims_are_here_that_can_be_judged():
    assert {*PLANTED, *AGAINST, "c27", "c29"} == {*BY_CLAIM}
