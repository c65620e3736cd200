"""How a UAV moves within a slot (Section III-B, IV-C2; decisions M5, M25 and M38)."""

import math

import numpy as np
from numba.extending import register_jitable

from orchid_uav.envs.elementary import Numeric
from orchid_uav.envs.units import SMALLEST_NORMAL


@register_jitable
def displacement_factor(length_m: Numeric, max_length_m: Numeric) -> Numeric:
    """Factor in [0, 1] that scales a displacement down to V_max delta_t where longer (M5)."""
    return max_length_m / np.maximum(length_m, max_length_m)


@register_jitable
def clipped(value: Numeric, low: Numeric, high: Numeric) -> Numeric:
    """``value`` kept inside [``low``, ``high``]."""
    return np.minimum(np.maximum(value, low), high)


@register_jitable
def next_coordinate_m(
    position_m: Numeric, displacement_m: Numeric, low_m: Numeric, high_m: Numeric
) -> Numeric:
    """q(t+1) = q(t) + displacement along one axis, kept inside the flight box (M25)."""
    return clipped(position_m + displacement_m, low_m, high_m)


@register_jitable
def next_transmit_power_w(
    power_w: Numeric, step_w: Numeric, action: Numeric, min_w: Numeric, max_w: Numeric
) -> Numeric:
    """P(t+1) = P(t) + delta_p a, kept within [P_min, P_max]."""
    return clipped(power_w + step_w * action, min_w, max_w)


@register_jitable
def is_too_close(distance_squared_m2: Numeric, min_separation_m: Numeric) -> Numeric:
    """I(d_nj < d_min), of the squared 3-D distance of two UAVs."""
    return distance_squared_m2 < min_separation_m * min_separation_m


@register_jitable
def is_outside(value: Numeric, low: Numeric, high: Numeric) -> Numeric:
    """Whether ``value`` lies outside [``low``, ``high``]."""
    return (value < low) | (value > high)


@register_jitable
def relative(value: Numeric, low: Numeric, high: Numeric) -> Numeric:
    """Where ``value`` lies in [``low``, ``high``], as 0..1; 0 if the interval has no extent."""
    return (value - low) / np.maximum(high - low, SMALLEST_NORMAL)


def chord(radius_m: float, step_m: float) -> tuple[float, float, float]:
    """Length in m of a step along a circle, and cosine and sine of the angle that it turns by."""
    step_m = min(step_m, 2.0 * radius_m)
    angle = 2.0 * math.asin(0.5 * step_m / radius_m)
    return step_m, math.cos(angle), math.sin(angle)


@register_jitable
def circling_displacement_m(
    east_m: Numeric, north_m: Numeric, radius_m: float, step_m: float, cosine: float, sine: float
) -> tuple[Numeric, Numeric]:
    """Next move of a UAV at this place relative to the centre of its circle.

    On the circle the move is a chord of length ``step_m``, counter-clockwise; away from it, a step
    of that length towards the point where the chord from the nearest point of the circle ends.
    ``step_m``, ``cosine`` and ``sine`` are those of :func:`chord`.
    """
    distance_m = np.sqrt(east_m * east_m + north_m * north_m)
    outward_m = np.maximum(distance_m, SMALLEST_NORMAL)
    # At the centre any direction would do: it is east.
    x = east_m / outward_m + (distance_m == 0.0)
    y = north_m / outward_m
    dx = radius_m * (x * cosine - y * sine) - east_m
    dy = radius_m * (x * sine + y * cosine) - north_m
    length_m = np.maximum(np.sqrt(dx * dx + dy * dy), np.maximum(step_m, SMALLEST_NORMAL))
    return dx * (step_m / length_m), dy * (step_m / length_m)
