"""Conversions between decibels and linear units.

They take scalars and arrays alike, from Python and from compiled code.
"""

import math

import numpy as np
from numba.extending import register_jitable

from orchid_uav.envs.elementary import Numeric, exponential, logarithm_10

SMALLEST_NORMAL = float(np.finfo(np.float64).tiny)
"""Stands in for a denominator of 0 where the numerator is 0 too."""

_NATURAL_PER_DECIBEL = math.log(10.0) / 10.0


@register_jitable
def decibel_to_linear(value_db: Numeric) -> Numeric:
    """Power ratio of a level in dB: 10^(x/10)."""
    return exponential(value_db * _NATURAL_PER_DECIBEL)


@register_jitable
def linear_to_decibel(ratio: Numeric) -> Numeric:
    """Level in dB of a power ratio > 0."""
    return 10.0 * logarithm_10(ratio)


@register_jitable
def dbm_to_watt(power_dbm: Numeric) -> Numeric:
    """Power in W of a level in dBm."""
    return 1e-3 * decibel_to_linear(power_dbm)
