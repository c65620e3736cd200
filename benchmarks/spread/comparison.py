"""What the runs of the learners say about each other."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import ttest_ind

from orchid_uav.experiments.comparison import ALPHA, describe_seeds, probability_of_improvement

MARGIN = 0.05
"""Share of what the public learner gains over random play, set before the runs."""
SEEDS_FOR_A_VERDICT = 10
PAIRS = (
    ("orchid mappo", "benchmarl mappo"),
    ("orchid mappo", "benchmarl mappo-gaussian"),
    ("orchid maddpg", "benchmarl maddpg"),
    ("orchid maddpg", "agilerl maddpg"),
    ("benchmarl mappo-gaussian", "benchmarl mappo"),
    ("orchid mappo", "orchid ippo"),
)
"""(compared, reference). The last two are controls: two public ones, and what a central critic is
worth."""


def compare(rows: Sequence[Mapping[str, Any]], random_return: float) -> dict[str, Any]:
    """Every arm's final return over seeds, and the pairs."""
    finals: dict[str, list[float | None]] = {}
    for row in rows:
        finals.setdefault(row["arm"], []).append(row["final_return"])
    return {
        "arms": {arm: describe_seeds(values) for arm, values in finals.items()},
        "pairs": [
            {"compared": one, "reference": other}
            | compare_arms(finals[one], finals[other], random_return)
            for one, other in PAIRS
            if one in finals and other in finals
        ],
    }


def compare_arms(
    compared: Sequence[float | None], reference: Sequence[float | None], random_return: float
) -> dict[str, Any]:
    """Difference of two arms whose seeds have nothing in common but their numbers.

    Failed runs, None, are left out here; the description of their arm counts them.

    Returns:
        "seeds" of either that did not fail; "difference" of the means, compared − reference, with
        its 95 % interval and "p_value" by Welch's t; "margin"; "equivalence_p", the greater of two
        one-sided Welch tests against it; "probability_of_improvement"; "verdict", none with too
        few seeds.
    """
    one, other = (
        np.array([value for value in values if value is not None])
        for values in (compared, reference)
    )
    margin = MARGIN * (float(other.mean()) - random_return)
    welch = ttest_ind(one, other, equal_var=False)
    one_sided = (
        ttest_ind(one + margin, other, equal_var=False, alternative="greater").pvalue,
        ttest_ind(one - margin, other, equal_var=False, alternative="less").pvalue,
    )
    difference, equivalence_p = float(one.mean() - other.mean()), float(max(one_sided))
    verdict = None
    if min(len(one), len(other)) >= SEEDS_FOR_A_VERDICT:
        if equivalence_p <= ALPHA:
            verdict = "equivalent"
        elif welch.pvalue <= ALPHA:
            verdict = "higher" if difference > 0.0 else "lower"
        else:
            verdict = "undecided"
    count = min(len(one), len(other))
    return {
        "seeds": [len(one), len(other)],
        "difference": difference,
        "ci95": [float(end) for end in welch.confidence_interval(0.95)],
        "p_value": float(welch.pvalue),
        "margin": margin,
        "equivalence_p": equivalence_p,
        "probability_of_improvement": probability_of_improvement(
            other[:count], one[:count], "higher"
        )[0],
        "verdict": verdict,
    }
