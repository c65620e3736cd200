"""Conversions between decibels and linear units.

Plain NumPy expressions: scalars and arrays alike, from Python and from compiled code.
"""

import math
from typing import Any, TypeAlias

import numpy as np
from numba.extending import register_jitable

Numeric: TypeAlias = Any
"""A number or an array of numbers. The equations take either, and give what they are given."""

SMALLEST_NORMAL = float(np.finfo(np.float64).tiny)
"""Stands in for a denominator of 0 where the numerator is 0 too."""

_NATURAL_PER_DECIBEL = math.log(10.0) / 10.0


@register_jitable
def decibel_to_linear(value_db: Numeric) -> Numeric:
    """Power ratio of a level in dB: 10^(x/10), by exp, which is several times faster."""
    return np.exp(value_db * _NATURAL_PER_DECIBEL)


@register_jitable
def linear_to_decibel(ratio: Numeric) -> Numeric:
    """Level in dB of a power ratio > 0."""
    return 10.0 * np.log10(ratio)


@register_jitable
def dbm_to_watt(power_dbm: Numeric) -> Numeric:
    """Power in W of a level in dBm."""
    return 1e-3 * decibel_to_linear(power_dbm)
