"""Compare the runs of the learners."""

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

import numpy as np
from scipy.stats import t, ttest_ind

from orchid_uav.experiments.statistics.comparison import ALPHA, describe_seeds

MARGIN = 0.05
"""The margin as a share of the public learner's gain over random play, set before the runs."""
SEEDS_FOR_A_VERDICT = 10
PAIRS = (
    ("orchid mappo", "benchmarl mappo"),
    ("orchid mappo", "benchmarl mappo-gaussian"),
    ("orchid maddpg", "benchmarl maddpg"),
    ("orchid maddpg", "agilerl maddpg"),
)
CONTROLS = (
    ("benchmarl mappo-gaussian", "benchmarl mappo"),
    ("orchid mappo", "orchid ippo"),
    ("orchid maddpg-tripled", "agilerl maddpg"),
)
"""(compared, reference): pairs that show what the distribution changes, what the central critic
changes, and whether AgileRL's learner differs because of its number of steps."""


def compare(rows: Sequence[Mapping[str, Any]], random_return: float) -> dict[str, Any]:
    """Compare arms by their final return over seeds, and by their learning curves.

    Of a learning curve the mean is compared, which shows how fast a learner is.
    """
    finals: dict[str, list[float | None]] = {}
    curves: dict[str, list[float | None]] = {}
    for row in rows:
        finals.setdefault(row["arm"], []).append(row["final_return"])
        curves.setdefault(row["arm"], []).append(fmean(row["curve"]) if "curve" in row else None)
    return {
        "arms": {arm: describe_seeds(values).to_json() for arm, values in finals.items()},
        "pairs": _pairs(finals, random_return),
        "pairs_of_curves": _pairs(curves, random_return),
    }


def _pairs(
    values: Mapping[str, Sequence[float | None]], random_return: float
) -> list[dict[str, Any]]:
    return [
        {"compared": one, "reference": other, "control": (one, other) in CONTROLS}
        | compare_arms(values[one], values[other], random_return)
        for one, other in (*PAIRS, *CONTROLS)
        if one in values and other in values
    ]


def compare_arms(
    compared: Sequence[float | None], reference: Sequence[float | None], random_return: float
) -> dict[str, Any]:
    """Difference of two arms; equal seeds of the two have nothing in common, so nothing is paired.

    Returns:
        "seeds" of either that did not fail and how many "failed", None; "difference" of the means,
        compared − reference, with its 90 % interval and "p_value" by Welch's t; "margin";
        "equivalence_p", the greater of two one-sided Welch tests against it, significant at 5 %
        where the interval lies within the margin; "least_margin", the smallest margin that these
        seeds would have met; "verdict": None with too few seeds, and "undecided" also where runs
        failed, since their returns are unknown.
    """
    one, other = (
        np.array([value for value in values if value is not None])
        for values in (compared, reference)
    )
    failed = [len(compared) - len(one), len(reference) - len(other)]
    found: dict[str, Any] = {"seeds": [len(one), len(other)], "failed": failed, "verdict": None}
    if min(len(one), len(other)) < 2:
        return found
    welch = ttest_ind(one, other, equal_var=False)
    low, high = map(float, welch.confidence_interval(1.0 - 2.0 * ALPHA))
    difference = float(one.mean() - other.mean())
    error = (high - low) / 2.0 / t.isf(ALPHA, welch.df)
    margin = MARGIN * (float(other.mean()) - random_return)
    equivalence_p = float(t.sf((margin - abs(difference)) / error, welch.df))
    if any(failed):
        verdict = "undecided"
    elif min(len(one), len(other)) < SEEDS_FOR_A_VERDICT:
        verdict = None
    elif equivalence_p <= ALPHA:
        verdict = "equivalent"
    elif welch.pvalue <= ALPHA:
        verdict = "higher" if difference > 0.0 else "lower"
    else:
        verdict = "undecided"
    return found | {
        "difference": difference,
        "ci90": [low, high],
        "p_value": float(welch.pvalue),
        "margin": margin,
        "least_margin": max(abs(low), abs(high)),
        "equivalence_p": equivalence_p,
        "verdict": verdict,
    }
