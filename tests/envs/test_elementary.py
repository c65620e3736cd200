"""Elementary functions against mpmath, which computes with as many digits as it is told to."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from orchid_uav.envs import elementary

PROMISED = 1e-14

EXPONENTS = st.floats(-708.0, 709.0)
NORMAL_NUMBERS = st.floats(np.finfo(float).tiny, np.finfo(float).max)
SINES = st.floats(0.0, 1.0)
CASES = {
    "exponential": (mpmath.exp, EXPONENTS),
    "logarithm": (mpmath.log, NORMAL_NUMBERS | st.floats(0.5, 2.0)),
    "logarithm_2": (lambda x: mpmath.log(x, 2), NORMAL_NUMBERS | st.floats(0.5, 2.0)),
    "logarithm_10": (mpmath.log10, NORMAL_NUMBERS | st.floats(0.5, 2.0)),
    "arcsine": (mpmath.asin, SINES),
}


def compiled(name):
    function = getattr(elementary, name)

    @njit(error_model="numpy")
    def loop(numbers, results):
        for index in range(len(numbers)):
            results[index] = function(numbers[index])

    return loop


COMPILED = {name: compiled(name) for name in CASES}


def of_array(name, numbers):
    results = np.empty_like(numbers)
    COMPILED[name](numbers, results)
    return results


@pytest.mark.parametrize("name", CASES)
class TestElementary:
    def test_are_right_over_all_of_their_range(self, name):
        true, numbers = CASES[name]

        @settings(max_examples=400, deadline=None)
        @given(numbers)
        def check(number):
            with mpmath.workdps(40):
                expected = true(mpmath.mpf(number))
                found = mpmath.mpf(float(getattr(elementary, name)(number)))
                assert abs(found - expected) <= PROMISED * abs(expected)

        check()

    def test_are_the_same_of_numbers_arrays_and_compiled(self, name):
        """Sizes beside those of vectors, whose rests are computed one by one."""
        generator = np.random.default_rng(0)
        function = getattr(elementary, name)
        for size in (1, 3, 8, 31, 100):
            numbers = generator.uniform(0.0, 1.0, size)
            results = of_array(name, numbers)
            np.testing.assert_array_equal(function(numbers), results)
            assert [float(function(number)) for number in numbers] == results.tolist()
            np.testing.assert_array_equal(function(numbers[::-1].reshape(-1, 1))[::-1, 0], results)


def test_exponentials_too_small_are_zero_and_too_large_stay_finite():
    numbers = np.array([-np.inf, -1e300, -708.0001, -708.0, 709.0, 1e300, np.inf])
    for found in (elementary.exponential(numbers), of_array("exponential", numbers)):
        assert found[:3].tolist() == [0.0, 0.0, 0.0]
        assert 0.0 < found[3] < 1e-307
        assert 1e307 < found[4] == found[5] == found[6] < np.inf


def test_ends_are_exact():
    assert elementary.exponential(0.0) == 1.0
    assert elementary.logarithm(1.0) == elementary.logarithm_2(1.0) == 0.0
    assert [elementary.logarithm_2(2.0**power) for power in (-1022, -3, 1, 10, 1023)] == [
        -1022.0,
        -3.0,
        1.0,
        10.0,
        1023.0,
    ]
    assert elementary.arcsine(0.0) == 0.0
    assert elementary.arcsine(1.0) == 0.5 * np.pi
