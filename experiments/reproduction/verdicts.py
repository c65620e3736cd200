"""Rules by which the rows of the seeds become a verdict on a claim."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.statistics.comparison import (
    ALPHA,
    describe_differences,
    equivalence,
    holm,
    least_detectable_effect,
    p_value_above,
    sign_flip_p_value,
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

    @property
    def is_complete(self) -> bool:
        """Whether no pair is missing."""
        return self.n == self.units


def judge_checks(checks: Sequence[Check], evidence: Evidence) -> list[Judgement]:
    """Judge the checks of a claim, which are one family of tests (Holm)."""
    sides = [_sides(check, evidence) for check in checks]
    adjusted = holm([sign_flip_p_value(one - other) for one, other, _ in sides])
    return [
        _judgement(check, one, other, units, p_holm, len(checks))
        for check, (one, other, units), p_holm in zip(checks, sides, adjusted, strict=True)
    ]


def _sides(check: Check, evidence: Evidence) -> tuple[Floats, Floats, int]:
    """The values of both sides in complete pairs, (pairs,), and how many pairs there should be."""
    one, other = check.one(evidence), check.other(evidence)
    units = max(len(one), LEAST_SEEDS)
    if len(one) != len(other):  # a side that was not measured at all
        return np.empty(0), np.empty(0), units
    complete = np.isfinite(one) & np.isfinite(other)
    return one[complete], other[complete], units


def _judgement(
    check: Check, one: Floats, other: Floats, units: int, p_holm: float | None, family: int
) -> Judgement:
    differences = one - other
    difference = describe_differences(differences)
    equivalent = equivalence(differences, check.margin)
    is_within_margin = equivalent is not None and equivalent.equivalent
    return Judgement(
        what=check.what,
        methods=list(check.methods),
        metric=check.metric,
        is_relative=check.is_relative,
        expected=check.expected,
        margin=check.margin,
        finding=_finding(check, differences, p_holm, is_within_margin),
        is_within_margin=is_within_margin,
        n=len(differences),
        units=units,
        one=float(one.mean()) if len(one) else None,
        other=float(other.mean()) if len(other) else None,
        difference=difference.mean,
        ci95=difference.ci95,
        p_holm=p_holm,
        least_detectable_effect=_least_detectable(check, differences, family),
    )


def _least_detectable(check: Check, differences: Floats, family: int) -> float | None:
    if check.expected in ("higher", "lower"):
        return least_detectable_effect(differences, alpha=ALPHA / family)
    return least_detectable_effect(differences, sides=1)


def _finding(
    check: Check, differences: Floats, p_holm: float | None, is_within_margin: bool
) -> Finding:
    """Whether the claim's expectation is met.

    *Higher* and *lower*: no, where the difference is shown to lie within the margin, or on the
    other side of 0; yes, where it is shown to be on the right side. *Equal*: yes within the margin,
    no where it is shown to be beyond it. *Not lower*: yes, where it is shown to be lower by no more
    than the margin; no, where it is shown to be lower by more.
    """
    if len(differences) < LEAST_SEEDS or p_holm is None:
        return "undecided"
    mean, is_shown = float(differences.mean()), p_holm <= ALPHA
    if check.expected == "equal":
        is_beyond = is_shown and p_value_above(differences * np.sign(mean), check.margin) <= ALPHA
        return "yes" if is_within_margin else "no" if is_beyond else "undecided"
    if check.expected == "not lower":
        if p_value_above(differences, -check.margin) <= ALPHA:
            return "yes"
        is_beyond = is_shown and p_value_above(-differences, check.margin) <= ALPHA
        return "no" if is_beyond else "undecided"
    is_right = mean > 0.0 if check.expected == "higher" else mean < 0.0
    if is_shown and is_right and not is_within_margin:
        return "yes"
    return "no" if is_within_margin or is_shown else "undecided"


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
