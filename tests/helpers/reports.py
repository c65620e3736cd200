"""A document of a reproduction that was never judged, with findings of every kind."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.ablation.result import TriggerReplay
from orchid_uav.experiments.evaluation.method_keys import RULE_IDEAS
from orchid_uav.experiments.reproduction.checks import MARGINS, UTILITY
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS, Claim
from orchid_uav.experiments.reproduction.figures.drawn import DrawnFigure
from orchid_uav.experiments.reproduction.job import RULES
from orchid_uav.experiments.reproduction.result import (
    AMONG_UNIFORM,
    SCHEMA,
    SENSITIVITIES,
    TABLED,
    FlownMethod,
    Judged,
    JudgedClaim,
    Reproduction,
    Sensitivity,
)
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.reproduction.verdicts import Check, Finding, Judgement, verdict_of
from orchid_uav.experiments.statistics.comparison import Difference, SeedSummary, compare_pairs
from tests.helpers.reproductions import USUAL, VERSIONS, noise_of

KINDS: Sequence[Sequence[Finding]] = (
    ("yes",),
    ("yes", "no"),
    ("no", "undecided"),
    ("undecided",),
)
"""Findings of a claim's checks, in turn: all claims of a kind have the same verdict."""
EFFECTS: dict[Finding, float] = {"yes": 4.0, "no": -3.0, "undecided": 0.5}
"""Differences in margins."""


def make_judgement(check: Check, finding: Finding) -> Judgement:
    """A comparison with numbers that no other one has."""
    drawn = noise_of(check.what, check.metric, check.margin)
    one = USUAL.get(check.metric, 1.0) * drawn.uniform(0.5, 0.9)
    difference = check.margin * (EFFECTS[finding] + drawn.uniform(-0.3, 0.3))
    half = 0.6 * check.margin
    return Judgement(
        what=check.what,
        methods=list(check.methods),
        metric=check.metric,
        is_relative=check.is_relative,
        expected=check.expected,
        margin=check.margin,
        finding=finding,
        is_within_margin=finding == "no" and bool(drawn.integers(2)),
        n=10,
        units=10,
        one=one,
        other=one - difference,
        difference=difference,
        ci95=[difference - half, difference + half],
        p_holm=0.0123,
        least_detectable_effect=1.5 * check.margin,
    )


def make_claim(claim: Claim, findings: Sequence[Finding], is_quick: bool) -> JudgedClaim:
    """A claim whose comparisons found these, in turn."""

    def judged(distribution: Distribution) -> Judged:
        checks = [
            make_judgement(check, findings[number % len(findings)])
            for number, check in enumerate(claim.checks(distribution))
        ]
        verdict = verdict_of([check.finding for check in checks])
        return Judged(verdict=None if is_quick else verdict, checks=checks)

    return JudgedClaim(
        key=claim.key,
        says=claim.says,
        where=claim.where,
        figure=claim.figure,
        note=claim.note,
        command=["orchid", "reproduce", "--only", claim.key],
        tcp=judged("tcp"),
        uniform=judged("uniform") if claim.by_distribution else None,
    )


def make_claims(claims: Iterable[Claim], is_quick: bool) -> list[JudgedClaim]:
    """Claims with verdicts of every kind, in turn."""
    return [
        make_claim(claim, KINDS[number % len(KINDS)], is_quick)
        for number, claim in enumerate(claims)
    ]


def make_summary(method: str, metric: str, n: int) -> SeedSummary:
    """A method's values over its seeds."""
    mean = USUAL[metric] * noise_of(method, metric).uniform(0.8, 0.99)
    std = 0.02 * mean
    return SeedSummary(
        n=n, failed=0, mean=mean, median=mean, iqm=mean, std=std, ci95=[mean, mean], ci95_of="iqm"
    )


def make_difference(method: str, metric: str) -> Difference:
    """What a method has more than the paper's."""
    mean = USUAL[metric] * noise_of(method, metric, "beside").uniform(0.01, 0.1)
    ends = [0.9 * mean, 1.1 * mean]
    return Difference(mean=mean, median=mean, iqm=mean, ci95=ends, ci95_of="mean")


def make_method(method: str) -> FlownMethod:
    """A method in the paper's network."""
    is_rule = method in RULE_IDEAS
    seeds = 0 if is_rule else len(SEEDS)
    summaries = {metric: make_summary(method, metric, 10) for metric in TABLED}
    beside = {metric: make_difference(method, metric) for metric in TABLED if method != "orchid"}
    flown: dict[str, Any] = {"deterministic": summaries, "beside_orchid": beside}
    if is_rule:
        return FlownMethod(method=method, purpose="", command=[], seeds=0, **flown)
    return FlownMethod(
        method=method,
        purpose=TRAININGS[method].purpose,
        command=list(TRAININGS[method].command(SEEDS[0])),
        seeds=seeds,
        **flown,
        sampled={metric: make_summary(f"{method} sampled", metric, 10) for metric in TABLED},
        twin={metric: USUAL[metric] for metric in TABLED},
        reset_episodes=[[100 + seed] for seed in SEEDS],
        actor_latency_us=25.0,
    )


def make_sensitivity(method: str, users: Distribution = "tcp") -> Sensitivity:
    """A training with another choice that gains a little."""
    return Sensitivity(
        method=method,
        purpose=TRAININGS[method].purpose,
        users=users,
        gained=make_summary(method, UTILITY, 10),
        gained_by_orchid=make_summary("orchid", UTILITY, 10),
        difference=compare_pairs([0.1] * 10, [0.123] * 10, "higher", MARGINS[UTILITY]),
    )


def make_document(is_quick: bool = False, **fields: Any) -> Reproduction:
    """A whole document; fields are replaced."""
    seeds = list(SEEDS[:2] if is_quick else SEEDS)
    values: dict[str, Any] = {
        "schema": SCHEMA,
        "status": "completed",
        "date": "2026-11-27",
        "command": ["orchid", "reproduce", "results"],
        "versions": VERSIONS,
        "host": {"processor": "Test processor"},
        "is_quick": is_quick,
        "seeds": seeds,
        "topologies": 100,
        "rows": dict.fromkeys(TRAININGS, seeds) | {rule: [] for rule in RULES},
        "asked": dict.fromkeys(TRAININGS, len(seeds)) | dict.fromkeys(RULES, 1),
        "waiting": {},
        "missing": 0,
        "hours": 31.5,
        "commits": [str(VERSIONS["git_commit"])],
        "processors": ["Test processor"],
        "claims": make_claims(CLAIMS, is_quick),
        "questions": make_claims(QUESTIONS, is_quick),
        "methods": [make_method(key) for key in (*TRAININGS, *RULES)],
        "sensitivities": [
            *(make_sensitivity(key) for key in SENSITIVITIES),
            *(make_sensitivity(key, "uniform") for key in AMONG_UNIFORM),
        ],
        "false_alarms": [
            TriggerReplay(
                window=window, tolerance=0.05, runs=10, fired=fired, median_episode=episode
            )
            for window, fired, episode in ((10, 7, 123.0), (25, 0, None))
        ],
    }
    return Reproduction.model_validate(values | fields)


def make_figures(folder: Path) -> list[DrawnFigure]:
    """Figures that show nothing, for every figure of the paper."""
    keys = ("fig3_tcp", "fig4_tcp", "fig4_uniform", "fig5_tcp", "fig6_tcp_1s", "fig7", "fig8")
    figures = []
    for key in keys:
        path = folder / f"{key}.svg"
        path.write_text(
            '<svg xmlns="http://www.w3.org/2000/svg" width="700" height="300" '
            f'viewBox="0 0 700 300"><title>{key}</title></svg>',
            encoding="utf-8",
        )
        title = f"Fig. {key[3]}: of {key}"
        figures.append(DrawnFigure(key, title, path, f"Seen in {key}: 0.5.", f"Read {key} so."))
    return figures
