"""Jain's fairness index (Section IV-C3c and d)."""

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from orchid_uav.envs.elementary import Numeric
from orchid_uav.envs.units import SMALLEST_NORMAL


@register_jitable
def jain_index_from_sums(total: Numeric, total_of_squares: Numeric, count: Numeric) -> Numeric:
    """J = (sum x)^2 / (n sum x^2) from the sums over n = ``count`` values.

    0 for an empty or all-zero set, so that serving nobody is never fair (decision M14): there the
    numerator is 0 and the smallest normal number stands in for the denominator.
    """
    return total * total / np.maximum(count * total_of_squares, SMALLEST_NORMAL)


def jain_index(values: ArrayLike, where: ArrayLike | None = None) -> float:
    """Jain's index of the values, those with ``where`` True if given: 0 (M14) or in [1/n, 1].

    Args:
        values: non-negative numbers, any shape.
        where: booleans of the same shape; True for the values that count.
    """
    chosen = np.asarray(values, dtype=float)
    if where is not None:
        chosen = chosen[np.asarray(where, dtype=bool)]
    if chosen.size and chosen.max() > 0.0:
        chosen = chosen / chosen.max()  # squares of tiny numbers would vanish
    return float(jain_index_from_sums(chosen.sum(), (chosen * chosen).sum(), chosen.size))
