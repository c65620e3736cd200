"""Arcsine, exponential and logarithms that compilers vectorise.

The C library's functions branch, so that a loop which calls one of them is computed number by
number. These consist of additions, multiplications, divisions and square roots alone, each of which
every processor rounds alike, and of selections instead of branches. So a loop over users is
computed with vector instructions, and its bits depend neither on the C library nor on the
processor: no multiplication is contracted with an addition, which only some processors could do.
Relative errors are below 1e-14 over all of their range.

Like all equations here they take numbers and arrays, from Python and from compiled code.
"""

import math
from typing import Any, TypeAlias

import numpy as np
from numba import types
from numba.extending import intrinsic, overload, register_jitable

Numeric: TypeAlias = Any
"""A number or an array of numbers. The equations take either, and give what they are given."""

_LOG2_E = 1.0 / math.log(2.0)
_LOG10_2 = math.log10(2.0)
_LN_2_HIGH, _LN_2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
"""ln 2 in two parts, the first with so few digits that its products by whole numbers are exact."""
_ROUNDING = 1.5 * 2.0**52
"""Added to a number it leaves the nearest whole number in the last bits."""
_ROUNDING_BITS = 0x4338000000000000
_FRACTION_BITS = 52
_FRACTION = (1 << _FRACTION_BITS) - 1
_EXPONENT_OF_ONE = 0x3FF0000000000000
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_LEAST_EXPONENT, _GREATEST_EXPONENT = -708.0, 709.0


def bits_of(number: Numeric) -> Numeric:
    """The bits of a double as a whole number."""
    return np.asarray(number, np.float64).view(np.int64)[()]  # numbers of numbers, arrays of arrays


def number_of(bits: Numeric) -> Numeric:
    """The double of these bits."""
    return np.asarray(bits, np.int64).view(np.float64)[()]


def either(condition: Numeric, number: Numeric, other: Numeric) -> Numeric:
    """``number`` where the condition holds, else ``other``."""
    return np.where(condition, number, other)[()]  # type: ignore[call-overload]


@intrinsic
def _bitcast_to_int(context, number):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], context.get_value_type(types.int64))

    return types.int64(types.float64), generate


@intrinsic
def _bitcast_to_float(context, bits):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.bitcast(arguments[0], context.get_value_type(types.float64))

    return types.float64(types.int64), generate


@overload(bits_of)
def _bits_of(number):  # type: ignore[no-untyped-def]
    return lambda number: _bitcast_to_int(number)  # noqa: PLW0108 - numba reads its source


@overload(number_of)
def _number_of(bits):  # type: ignore[no-untyped-def]
    return lambda bits: _bitcast_to_float(bits)  # noqa: PLW0108


@overload(either)
def _either(condition, number, other):  # type: ignore[no-untyped-def]
    return lambda condition, number, other: number if condition else other


@register_jitable(forceinline=True)
def exponential(exponent: Numeric) -> Numeric:
    """e^x; 0 where that is below the normal numbers, x < -708, and as if x were 709 above that."""
    limited = np.minimum(np.maximum(exponent, _LEAST_EXPONENT), _GREATEST_EXPONENT)
    shifted = limited * _LOG2_E + _ROUNDING
    twos = shifted - _ROUNDING
    rest = (limited - twos * _LN_2_HIGH) - twos * _LN_2_LOW
    # The series of e^r, |r| <= ln(2)/2, up to r^11/11!, in pairs that do not wait for each other.
    square = rest * rest
    fourth = square * square
    low = (1.0 + rest) + (1.0 / 2.0 + rest * (1.0 / 6.0)) * square
    middle = (1.0 / 24.0 + rest * (1.0 / 120.0)) + (1.0 / 720.0 + rest * (1.0 / 5040.0)) * square
    high = (1.0 / 40320.0 + rest * (1.0 / 362880.0)) + (
        1.0 / 3628800.0 + rest * (1.0 / 39916800.0)
    ) * square
    series = low + fourth * (middle + fourth * high)
    # The whole number of twos, in the last bits, moves up to where the exponent is.
    scaled = number_of(bits_of(series) + (bits_of(shifted) << _FRACTION_BITS))
    return either(exponent < _LEAST_EXPONENT, 0.0, scaled)


@register_jitable(forceinline=True)
def _parts_of_logarithm(number: Numeric) -> tuple[Numeric, Numeric]:
    """K and ln(m) of a normal number 2^k m > 0 with m between sqrt(1/2) and sqrt(2)."""
    moved = bits_of(number) + (_EXPONENT_OF_ONE - _SQRT_HALF_BITS)
    twos = number_of((moved >> _FRACTION_BITS) + (_ROUNDING_BITS - 1023)) - _ROUNDING
    above_one = number_of((moved & _FRACTION) + _SQRT_HALF_BITS) - 1.0
    # ln(1 + f) = 2 artanh(s) with s = f / (2 + f), |s| <= 0.1716: its series up to s^19.
    root = above_one / (2.0 + above_one)
    square = root * root
    fourth = square * square
    low = (2.0 / 3.0 + square * (2.0 / 5.0)) + (2.0 / 7.0 + square * (2.0 / 9.0)) * fourth
    high = (2.0 / 11.0 + square * (2.0 / 13.0)) + (2.0 / 15.0 + square * (2.0 / 17.0)) * fourth
    series = low + fourth * fourth * (high + fourth * fourth * (2.0 / 19.0))
    return twos, 2.0 * root + root * square * series


@register_jitable(forceinline=True)
def logarithm(number: Numeric) -> Numeric:
    """ln(x) of a normal number > 0."""
    twos, rest = _parts_of_logarithm(number)
    return twos * _LN_2_HIGH + (twos * _LN_2_LOW + rest)


@register_jitable(forceinline=True)
def logarithm_2(number: Numeric) -> Numeric:
    """log2(x) of a normal number > 0."""
    twos, rest = _parts_of_logarithm(number)
    return twos + rest * _LOG2_E


@register_jitable(forceinline=True)
def logarithm_10(number: Numeric) -> Numeric:
    """log10(x) of a normal number > 0."""
    return logarithm_2(number) * _LOG10_2


@register_jitable(forceinline=True)
def arcsine(number: Numeric) -> Numeric:
    """arcsin(x) in radians, 0 <= x <= 1.

    From 1/2 on it is pi/2 - 2 arcsin(sqrt((1 - x) / 2)). The rational function is that of Sun's
    fdlibm, (arcsin(s) - s) / s^3 for s^2 <= 1/4 within 2^-58.75.
    """
    is_small = number < 0.5
    square = either(is_small, number * number, 0.5 - 0.5 * number)
    sine = either(is_small, number, np.sqrt(np.maximum(square, 0.0)))
    fourth = square * square
    over = (
        (1.66666666666666657415e-01 - 3.25565818622400915405e-01 * square)
        + (2.01212532134862925881e-01 - 4.00555345006794114027e-02 * square) * fourth
        + (7.91534994289814532176e-04 + 3.47933107596021167570e-05 * square) * (fourth * fourth)
    )
    under = (
        (1.0 - 2.40339491173441421878e00 * square)
        + (2.02094576023350569471e00 - 6.88283971605453293030e-01 * square) * fourth
        + 7.70381505559019352791e-02 * (fourth * fourth)
    )
    angle = sine + sine * (square * (over / under))
    return either(is_small, angle, 0.5 * np.pi - 2.0 * angle)
