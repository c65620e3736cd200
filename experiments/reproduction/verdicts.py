"""Rules by which the rows of the seeds become a verdict on a claim."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t

from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.statistics.comparison import ALPHA, Comparison, compare_pairs, holm
from orchid_uav.storage.documents import Document

Floats = NDArray[np.float64]
Expectation = Literal["higher", "lower", "equal", "not lower", "not higher"]
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
    metric: str
    is_relative: bool
    """Whether the numbers below are relative spreads, without the metric's unit."""
    expected: Expectation
    margin: float
    finding: Finding
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
    """Shown with 80 % power by as many pairs."""


def judge_checks(checks: Sequence[Check], evidence: Evidence) -> list[Judgement]:
    """Judge the checks of a claim, which are one family of tests (Holm)."""
    sides = [_sides(check, evidence) for check in checks]
    found = [
        compare_pairs(other, one, None, check.margin)
        for check, (one, other) in zip(checks, sides, strict=True)
    ]
    adjusted = holm([comparison.p_value for comparison in found])
    return [
        _judgement(check, one, other, comparison, p_holm)
        for check, (one, other), comparison, p_holm in zip(
            checks, sides, found, adjusted, strict=True
        )
    ]


def _sides(check: Check, evidence: Evidence) -> tuple[Floats, Floats]:
    """The values of both sides; none where one of them was not measured at all."""
    one, other = check.one(evidence), check.other(evidence)
    return (one, other) if len(one) == len(other) else (np.empty(0), np.empty(0))


def _judgement(
    check: Check, one: Floats, other: Floats, comparison: Comparison, p_holm: float | None
) -> Judgement:
    complete = np.isfinite(one) & np.isfinite(other)
    return Judgement(
        what=check.what,
        metric=check.metric,
        is_relative=check.is_relative,
        expected=check.expected,
        margin=check.margin,
        finding=_finding(check, (one - other)[complete], comparison, p_holm),
        n=comparison.n,
        units=max(len(one), LEAST_SEEDS),
        one=float(one[complete].mean()) if complete.any() else None,
        other=float(other[complete].mean()) if complete.any() else None,
        difference=comparison.difference.mean,
        ci95=comparison.difference.ci95,
        p_holm=p_holm,
        least_detectable_effect=comparison.least_detectable_effect,
    )


def _finding(
    check: Check, differences: Floats, comparison: Comparison, p_holm: float | None
) -> Finding:
    """Whether the claim's expectation is met.

    *Higher* and *lower*: no, where the difference is shown to lie within the margin, or on the
    other side of 0; yes, where it is shown to be on the right side. *Equal*: yes within the margin,
    no where it is shown to be beyond it. *Not lower* and *not higher*: yes, where it is shown not
    to go beyond the margin the wrong way; no, where it is shown to go beyond it.
    """
    mean, equivalence = comparison.difference.mean, comparison.equivalence
    if comparison.n < LEAST_SEEDS or mean is None or p_holm is None:
        return "undecided"
    is_equal = equivalence is not None and equivalence.equivalent
    is_shown = p_holm <= ALPHA
    if check.expected == "equal":
        is_beyond = is_shown and p_beyond(differences * np.sign(mean), -check.margin) <= ALPHA
        return "yes" if is_equal else "no" if is_beyond else "undecided"
    sign = 1.0 if check.expected in ("higher", "not lower") else -1.0
    is_right = sign * mean > 0.0
    if check.expected in ("higher", "lower"):
        if is_shown and is_right and not is_equal:
            return "yes"
        return "no" if is_equal or is_shown else "undecided"
    if p_beyond(sign * differences, check.margin) <= ALPHA:
        return "yes"
    is_beyond = is_shown and p_beyond(-sign * differences, -check.margin) <= ALPHA
    return "no" if is_beyond else "undecided"


def p_beyond(differences: Floats, margin: float) -> float:
    """p-value that the mean lies below −margin: a one-sided paired t-test against it.

    With a negative margin it is about a mean that does not reach so far above 0.
    """
    distance = float(np.mean(differences)) + margin
    error = float(np.std(differences, ddof=1)) / math.sqrt(len(differences))
    if not error:
        return 0.0 if distance > 0.0 else 1.0
    return float(t.sf(distance / error, len(differences) - 1))


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
