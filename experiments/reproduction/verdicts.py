"""Rules by which the rows of the seeds become a verdict on a claim."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.statistics.comparison import (
    ALPHA,
    Comparison,
    compare_pairs,
    holm,
    least_detectable_effect,
    p_value_above,
)
from orchid_uav.storage.documents import Document

Floats = NDArray[np.float64]
Expectation = Literal["higher", "lower", "equal", "not lower"]
"""What a claim says of one side beside the other. *Not lower*: lower by no more than the margin."""
Finding = Literal["yes", "no", "undecided"]
Verdict = Literal["holds", "partly", "does not hold", "undecided", "not testable in this model"]

LEAST_SEEDS = 10
"""A verdict needs this many complete pairs."""


@dataclass(frozen=True)
class Check:
    """One comparison that a claim consists of.

    ``one`` and ``other`` give a value per unit, paired: per training seed, or per topology where
    neither side was trained.
    """

    what: str
    methods: tuple[str, ...]
    """Methods and rules whose rows it needs; a zero-action twin's are those of its method."""
    metric: str
    """Key of the metric, for its unit and scale."""
    expected: Expectation
    margin: float
    """The greatest difference that does not matter, in the metric's unit; fixed before the runs."""
    one: Callable[[Evidence], Floats]
    other: Callable[[Evidence], Floats]
    is_relative: bool = False
    """Whether the numbers are relative spreads (coefficients of variation), without a unit."""


class Judgement(Document):
    """What the rows say of a check."""

    what: str
    methods: list[str]
    """Methods and rules that it is made of."""
    metric: str
    is_relative: bool
    """Whether the numbers below are relative spreads, without the metric's unit."""
    expected: Expectation
    margin: float
    finding: Finding
    is_within_margin: bool
    """Whether the difference is shown to be within the margin, whatever is claimed."""
    n: int
    """Complete pairs."""
    units: int
    """Pairs that there should be."""
    one: float | None
    """Mean of the one side."""
    other: float | None
    difference: float | None
    """Mean of the paired differences, one − other."""
    ci95: list[float] | None
    p_holm: float | None
    """Of a difference from 0, adjusted within the claim."""
    least_detectable_effect: float | None
    """What as many pairs would decide with 80 % power: how far from 0 the difference would have to
    be (*higher*, *lower*: each of the claim's tests at its share of 5 %), or how far on either side
    of the margin (*equal*, *not lower*)."""


def judge_checks(checks: Sequence[Check], evidence: Evidence) -> list[Judgement]:
    """Judge the checks of a claim, which are one family of tests (Holm)."""
    sides = [_sides(check, evidence) for check in checks]
    found = [
        compare_pairs(other, one, None, check.margin)
        for check, (one, other) in zip(checks, sides, strict=True)
    ]
    adjusted = holm([comparison.p_value for comparison in found])
    return [
        _judgement(check, one, other, comparison, p_holm, len(checks))
        for check, (one, other), comparison, p_holm in zip(
            checks, sides, found, adjusted, strict=True
        )
    ]


def _sides(check: Check, evidence: Evidence) -> tuple[Floats, Floats]:
    """The values of both sides; none where one of them was not measured at all."""
    one, other = check.one(evidence), check.other(evidence)
    return (one, other) if len(one) == len(other) else (np.empty(0), np.empty(0))


def _judgement(
    check: Check,
    one: Floats,
    other: Floats,
    comparison: Comparison,
    p_holm: float | None,
    family: int,
) -> Judgement:
    complete = np.isfinite(one) & np.isfinite(other)
    differences = (one - other)[complete]
    return Judgement(
        what=check.what,
        methods=list(check.methods),
        metric=check.metric,
        is_relative=check.is_relative,
        expected=check.expected,
        margin=check.margin,
        finding=_finding(check, differences, comparison, p_holm),
        is_within_margin=comparison.equivalence is not None and comparison.equivalence.equivalent,
        n=comparison.n,
        units=max(len(one), LEAST_SEEDS),
        one=float(one[complete].mean()) if complete.any() else None,
        other=float(other[complete].mean()) if complete.any() else None,
        difference=comparison.difference.mean,
        ci95=comparison.difference.ci95,
        p_holm=p_holm,
        least_detectable_effect=_least_detectable(check, differences, family),
    )


def _least_detectable(check: Check, differences: Floats, family: int) -> float | None:
    if check.expected in ("higher", "lower"):
        return least_detectable_effect(differences, alpha=ALPHA / family)
    return least_detectable_effect(differences, sides=1)


def _finding(
    check: Check, differences: Floats, comparison: Comparison, p_holm: float | None
) -> Finding:
    """Whether the claim's expectation is met.

    *Higher* and *lower*: no, where the difference is shown to lie within the margin, or on the
    other side of 0; yes, where it is shown to be on the right side. *Equal*: yes within the margin,
    no where it is shown to be beyond it. *Not lower*: yes, where it is shown to be lower by no more
    than the margin; no, where it is shown to be lower by more.
    """
    mean, equivalence = comparison.difference.mean, comparison.equivalence
    if comparison.n < LEAST_SEEDS or mean is None or p_holm is None:
        return "undecided"
    is_equal = equivalence is not None and equivalence.equivalent
    is_shown = p_holm <= ALPHA
    if check.expected == "equal":
        is_beyond = is_shown and p_value_above(differences * np.sign(mean), check.margin) <= ALPHA
        return "yes" if is_equal else "no" if is_beyond else "undecided"
    if check.expected == "not lower":
        if p_value_above(differences, -check.margin) <= ALPHA:
            return "yes"
        is_beyond = is_shown and p_value_above(-differences, check.margin) <= ALPHA
        return "no" if is_beyond else "undecided"
    is_right = mean > 0.0 if check.expected == "higher" else mean < 0.0
    if is_shown and is_right and not is_equal:
        return "yes"
    return "no" if is_equal or is_shown else "undecided"


def verdict_of(findings: Sequence[Finding]) -> Verdict:
    """Sum the findings of a claim's checks up.

    *Holds*: all are yes. *Partly*: some are yes and some no. *Does not hold*: all are no.
    *Undecided*: anything else, as what is open may still go either way.
    """
    if not findings:
        return "not testable in this model"
    if all(finding == "yes" for finding in findings):
        return "holds"
    if "yes" in findings and "no" in findings:
        return "partly"
    return "undecided" if "undecided" in findings else "does not hold"
