"""``claims.json``: what all rows together say, as a typed document."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

import numpy as np
from pydantic import Field

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.ablation.design import counted_firings
from orchid_uav.experiments.ablation.result import TriggerReplay
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import MARGINS, UTILITY
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS, Claim
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.needs import chosen
from orchid_uav.experiments.reproduction.rows import Row
from orchid_uav.experiments.reproduction.settings import DISTRIBUTIONS, Case
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.reproduction.verdicts import (
    Judgement,
    Verdict,
    judge_checks,
    verdict_of,
)
from orchid_uav.experiments.statistics.comparison import (
    Comparison,
    Difference,
    SeedSummary,
    compare_pairs,
    describe_differences,
    describe_seeds,
)
from orchid_uav.experiments.statistics.results import ResultHeader
from orchid_uav.storage.documents import Document

SCHEMA = 1
RowKey = tuple[str, int | None]
"""Method and seed of a row; of a rule's flights there is no seed."""
SENSITIVITIES = (
    *("orchid-kappa-0.1", "orchid-shares-se", "orchid-shares-pf", "orchid-10mhz", "orchid-20mhz"),
    *("orchid-n-init-10", "orchid-log-std-1", "orchid-log-std-2", "orchid-uniform"),
)
"""Trainings that differ from ``orchid`` in one of the choices that the paper leaves open."""
AMONG_UNIFORM = ("orchid-uniform", "orchid-no-rf-uniform")
"""Those trained among uniform users, which are flown there as well."""
TABLED = (
    *("coverage", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi", "worst_rate_bps"),
    *("utility", "displacement_m", "nearest_uav_m", "user_snr_db", "blocking_pairs", "collisions"),
)
"""Metrics in the tables of methods."""


class Judged(Document):
    """The verdict for one distribution of users, and what it rests on."""

    verdict: Verdict | None
    """None in a quick run, which gives no verdicts."""
    checks: list[Judgement]


class JudgedClaim(Document):
    """A claim, or a question, with its verdict."""

    key: str
    says: str
    where: str
    figure: str
    note: str
    command: list[str]
    """Trains and flies what it needs, and judges it alone."""
    tcp: Judged
    uniform: Judged | None


class FlownMethod(Document):
    """A method in the paper's network, over its seeds."""

    method: str
    purpose: str
    command: list[str]
    """Trains its first seed; empty for a rule."""
    seeds: int
    """Seeds that were trained; 0 for a rule."""
    deterministic: dict[str, SeedSummary]
    sampled: dict[str, SeedSummary] = Field(default_factory=dict)
    twin: dict[str, float] = Field(default_factory=dict)
    """Means of the zero-action twin; of a rule there is none."""
    beside_orchid: dict[str, Difference] = Field(default_factory=dict)
    """By metric: the method less the paper's policy, paired by training seed."""
    walking: dict[str, SeedSummary] = Field(default_factory=dict)
    """Where users walk and hold their headings for 20 s; empty where it was not flown there."""
    walking_beside_orchid: dict[str, Difference] = Field(default_factory=dict)
    reset_episodes: list[list[int]] = Field(default_factory=list)
    """By seed."""
    actor_latency_us: float | None = None


class Sensitivity(Document):
    """What another choice changes: the utility gained over the method's own zero-action twin."""

    method: str
    purpose: str
    users: Distribution
    """Among whom it was flown."""
    gained: SeedSummary
    gained_by_orchid: SeedSummary
    difference: Comparison


class Reproduction(ResultHeader):
    """The content of ``claims.json``."""

    is_quick: bool
    seeds: list[int]
    topologies: int
    rows: dict[str, list[int]]
    """Seeds with a row, by method; no seed for a rule."""
    asked: dict[str, int]
    """How many rows there should be, by method or rule, for the claims and figures asked for."""
    waiting: dict[str, int]
    """How many of them are missing, where some are."""
    missing: int
    """How many are missing of all."""
    hours: float
    """Of one core, for all of the rows."""
    commits: list[str]
    """Commits of the code that made the rows."""
    processors: list[str]
    claims: list[JudgedClaim]
    questions: list[JudgedClaim]
    methods: list[FlownMethod]
    sensitivities: list[Sensitivity]
    false_alarms: list[TriggerReplay]
    """The trigger of Reset-and-Finetune on policies that learn nothing."""


def judged(claim: Claim, evidence: Evidence, is_quick: bool) -> JudgedClaim:
    """A claim with its verdict, for both distributions where it has both."""

    def of(distribution: Distribution) -> Judged:
        found = judge_checks(list(claim.checks(distribution)), evidence)
        # What one comparison has shown already is no verdict while others wait for their seeds.
        is_complete = all(one.is_complete for one in found)
        verdict = verdict_of([one.finding for one in found]) if is_complete else "undecided"
        return Judged(verdict=None if is_quick else verdict, checks=found)

    tcp, uniform = DISTRIBUTIONS
    return JudgedClaim(
        key=claim.key,
        says=claim.says,
        where=claim.where,
        figure=claim.figure,
        note=claim.note,
        command=["orchid", "reproduce", "--only", claim.key],
        tcp=of(tcp),
        uniform=of(uniform) if claim.by_distribution else None,
    )


def flown_methods(evidence: Evidence) -> list[FlownMethod]:
    """Every method that has a row, in the paper's network: trained ones first."""
    present = evidence.methods()
    trained = [key for key in TRAININGS if key in present]
    rules = [key for key in sorted(present) if evidence.rule(key) is not None]
    return [
        *(_trained(key, evidence) for key in trained),
        *(
            FlownMethod(method=key, purpose="", command=[], seeds=0, **_flown(key, evidence))
            for key in rules
        ),
    ]


def _trained(key: str, evidence: Evidence) -> FlownMethod:
    rows = evidence.rows(key)
    base = [settings.base("tcp")]
    latencies = [row.actor_latency_us for row in rows if row.actor_latency_us is not None]
    twin = {metric: evidence.flown(f"{key}-zero", metric, base)[0] for metric in TABLED}
    return FlownMethod(
        method=key,
        purpose=TRAININGS[key].purpose,
        command=list(TRAININGS[key].command(SEEDS[0])),
        seeds=len(rows),
        sampled=_summaries(key, evidence, base, deterministic=False),
        twin={metric: float(value) for metric, value in twin.items() if np.isfinite(value)},
        reset_episodes=[row.reset_episodes for row in rows],
        actor_latency_us=median(latencies) if latencies else None,
        **_flown(key, evidence),
    )


def _flown(key: str, evidence: Evidence) -> dict[str, Any]:
    """What a method or rule reaches without noise, and how far that is from ``orchid``."""
    base, walking = [settings.base("tcp")], settings.walking_held("tcp")
    found: dict[str, Any] = {
        "deterministic": _summaries(key, evidence, base),
        "beside_orchid": _beside_orchid(key, evidence, base),
    }
    if np.isfinite(evidence.flown(key, UTILITY, walking)).any():
        found["walking"] = _summaries(key, evidence, walking)
        found["walking_beside_orchid"] = _beside_orchid(key, evidence, walking)
    return found


def _summaries(
    key: str, evidence: Evidence, cases: Sequence[Case], deterministic: bool = True
) -> dict[str, SeedSummary]:
    return {
        metric: describe_seeds(evidence.flown(key, metric, cases, deterministic=deterministic))
        for metric in TABLED
    }


def _beside_orchid(key: str, evidence: Evidence, cases: Sequence[Case]) -> dict[str, Difference]:
    if key == "orchid":
        return {}
    by_metric = {
        metric: evidence.flown(key, metric, cases) - evidence.flown("orchid", metric, cases)
        for metric in TABLED
    }
    return {
        metric: describe_differences(differences[np.isfinite(differences)])
        for metric, differences in by_metric.items()
    }


def sensitivities(evidence: Evidence) -> list[Sensitivity]:
    """What each open choice changes, as far as it was trained."""
    tcp, uniform = DISTRIBUTIONS
    flown = [*((key, tcp) for key in SENSITIVITIES), *((key, uniform) for key in AMONG_UNIFORM)]
    return [_sensitivity(key, users, evidence) for key, users in flown if evidence.rows(key)]


def _sensitivity(key: str, users: Distribution, evidence: Evidence) -> Sensitivity:
    own, gained = (evidence.gained(one, UTILITY, [settings.base(users)]) for one in ("orchid", key))
    return Sensitivity(
        method=key,
        purpose=TRAININGS[key].purpose,
        users=users,
        gained=describe_seeds(gained),
        gained_by_orchid=describe_seeds(own),
        difference=compare_pairs(own, gained, "higher", MARGINS[UTILITY]),
    )


def false_alarms(rows: Sequence[Row]) -> list[TriggerReplay]:
    """Firings on runs that learn nothing, by window and tolerance."""
    episodes = defaultdict(list)
    for row in rows:
        for firing in row.firings:
            episodes[firing.window, firing.tolerance].append(firing.episode)
    return [counted_firings(*key, episodes[key]) for key in sorted(episodes)]


def seeds_by_method(rows: Iterable[Row]) -> dict[str, list[int]]:
    """Seeds that have a row, by method."""
    found: dict[str, list[int]] = {}
    for row in rows:
        seeds = found.setdefault(row.method, [])
        if row.seed is not None:
            seeds.append(row.seed)
    return {method: sorted(seeds) for method, seeds in sorted(found.items())}


def reproduction(
    header: ResultHeader,
    rows: Sequence[Row],
    asked: Sequence[RowKey],
    is_quick: bool,
    only: Sequence[str] = (),
) -> Reproduction:
    """Everything that the rows say.

    Args:
        header: what every document of results begins with.
        rows: of all methods and rules.
        asked: method and seed of every row that there should be.
        is_quick: whether they are of a quick run, which gives no verdicts.
        only: the claims that are wanted; all of them by default.
    """
    seeds = sorted({row.seed for row in rows if row.seed is not None}) if is_quick else SEEDS
    evidence = Evidence(rows, seeds)
    claims, questions = (
        [judged(claim, evidence, is_quick) for claim in chosen(some, only)]
        for some in (CLAIMS, QUESTIONS)
    )
    present = {(row.method, row.seed) for row in rows}
    waiting = Counter(method for method, seed in asked if (method, seed) not in present)
    seconds = sum((row.seconds_trained or 0.0) + (row.seconds_flown or 0.0) for row in rows)
    return Reproduction(
        **header.to_json(),
        is_quick=is_quick,
        seeds=list(seeds),
        topologies=settings.QUICK_TOPOLOGIES if is_quick else settings.TOPOLOGIES,
        rows=seeds_by_method(rows),
        asked=Counter(method for method, _ in asked),
        waiting=waiting,
        missing=waiting.total(),
        hours=round(seconds / 3600.0, 1),
        commits=sorted({row.versions["git_commit"] or "unknown" for row in rows}),
        processors=sorted({str(row.host["processor"]) for row in rows}),
        claims=claims,
        questions=questions,
        methods=flown_methods(evidence),
        sensitivities=sensitivities(evidence),
        false_alarms=false_alarms(evidence.rows("orchid-frozen")),
    )
