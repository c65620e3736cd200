"""Means and intervals against SciPy, against a second BCa, and against coin tosses."""

import json
import math
import statistics

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from orchid_uav.experiments.statistics.intervals import (
    CONFIDENCE,
    INTERVAL,
    UNKNOWN,
    MetricSummary,
    interval,
    summarise,
)

samples = arrays(
    np.float64, st.integers(2, 12), elements=st.floats(-1e6, 1e6, allow_subnormal=False, width=32)
)


def mean(sample, axis):
    return np.mean(sample, axis=axis)


def share(own, low, high, axis):
    """As the share of the headroom: a ratio of differences of means."""
    room = np.mean(high, axis=axis) - np.mean(low, axis=axis)
    return (np.mean(own, axis=axis) - np.mean(low, axis=axis)) / room


def bca(samples: tuple[np.ndarray, ...], statistic, resamples: int = 20_000) -> list[float]:
    """Efron's bias-corrected and accelerated interval of paired samples, from the textbook."""
    count = len(samples[0])
    chosen = np.random.default_rng(99).integers(count, size=(resamples, count))
    replicates = statistic(*(sample[chosen] for sample in samples), axis=-1)
    observed = statistic(*samples, axis=-1)
    bias = stats.norm.ppf((replicates < observed).mean() + 0.5 * (replicates == observed).mean())
    left_out = np.array(
        [statistic(*(np.delete(s, index) for s in samples), axis=-1) for index in range(count)]
    )
    deviations = left_out.mean() - left_out
    acceleration = (deviations**3).sum() / (6.0 * (deviations**2).sum() ** 1.5)
    ends = []
    for probability in (0.025, 0.975):
        z = bias + stats.norm.ppf(probability)
        ends.append(stats.norm.cdf(bias + z / (1.0 - acceleration * z)))
    return np.quantile(replicates, ends).tolist()


def assert_close(measured: list[float], expected: list[float]) -> None:
    """Two intervals from different random numbers, apart by little of their width."""
    np.testing.assert_allclose(measured, expected, rtol=0, atol=0.06 * (expected[1] - expected[0]))


class TestSummary:
    def test_by_hand(self):
        found = summarise(np.array([2.0, 4.0, 9.0]))
        assert found.mean == 5.0
        assert found.std == pytest.approx(math.sqrt((9 + 1 + 16) / 2))
        low, high = found.ci95
        assert 2.0 <= low < 5.0 < high <= 9.0

    @given(samples)
    def test_is_that_of_the_standard_library(self, sample):
        found = summarise(sample)
        assert found.mean == pytest.approx(statistics.fmean(sample), rel=1e-9, abs=1e-6)
        assert found.std == pytest.approx(statistics.stdev(sample), rel=1e-6, abs=1e-6)

    @pytest.mark.parametrize("values", [[], [1.0, math.nan], [math.inf, 2.0], [-math.inf]])
    def test_of_nothing_or_of_what_is_no_number_is_unknown(self, values):
        assert summarise(np.array(values)) == UNKNOWN

    def test_of_one_value_is_that_value_alone(self):
        assert summarise(np.array([3.5])) == MetricSummary(mean=3.5, std=None, ci95=None)

    @pytest.mark.parametrize("value", [0.0, 3.5, -1e-300, 1e300])
    def test_of_equal_values_has_no_width(self, value):
        found = summarise(np.full(4, value))
        assert found == MetricSummary(mean=value, std=0.0, ci95=[value, value])

    @pytest.mark.parametrize("values", [[], [1.0], [1.0, 1.0], [1.0, 2.0], [math.nan]])
    def test_is_valid_json(self, values):
        found = summarise(np.array(values))
        written = json.dumps(found.to_json(), allow_nan=False)
        assert MetricSummary.from_json(json.loads(written)) == found


class TestInterval:
    def test_says_what_it_is(self):
        assert CONFIDENCE == 0.95
        assert INTERVAL == "BCa bootstrap, 2000 resamples, 95%"

    @pytest.mark.parametrize("count", [5, 20, 100])
    @pytest.mark.parametrize("law", ["normal", "exponential"])
    def test_is_that_of_a_second_bca(self, count, law):
        sample = getattr(np.random.default_rng(count), law)(size=count)
        assert_close(interval((sample,), mean), bca((sample,), mean))

    def test_is_about_students_where_the_law_is_normal_and_the_sample_large(self):
        sample = np.random.default_rng(0).normal(10.0, 2.0, 200)
        expected = stats.t.interval(0.95, 199, sample.mean(), stats.sem(sample))
        assert_close(interval((sample,), mean), list(expected))

    def test_leans_to_the_long_tail(self):
        sample = np.random.default_rng(3).exponential(size=30)
        low, high = interval((sample,), mean)
        assert high - sample.mean() > 1.1 * (sample.mean() - low)

    def test_covers_the_mean_about_as_often_as_it_says(self):
        # BCa is known to cover a little less than it says in small samples.
        generator = np.random.default_rng(1)
        trials, covered = 200, 0
        for _ in range(trials):
            low, high = interval((generator.normal(3.0, 1.0, 25),), mean)
            covered += low <= 3.0 <= high
        assert 0.89 <= covered / trials <= 0.985

    def test_of_fewer_than_two_values_is_unknown(self):
        assert interval((np.array([1.0]),), mean) is None
        assert interval((np.array([]),), mean) is None

    @settings(max_examples=40, deadline=None)
    @given(samples)
    def test_lies_within_the_values_and_is_the_same_again(self, sample):
        low, high = interval((sample,), mean)
        assert low <= high
        slack = 1e-9 * np.abs(sample).max()
        assert sample.min() - slack <= low and high <= sample.max() + slack
        assert interval((sample,), mean) == [low, high]

    @settings(max_examples=20, deadline=None)
    @given(samples, st.integers(-20, 20))
    def test_grows_with_the_unit(self, sample, exponent):
        low, high = interval((sample,), mean)
        scale = 2.0**exponent  # exact in floating-point numbers
        assert interval((sample * scale,), mean) == [low * scale, high * scale]

    @pytest.mark.parametrize("count", [2, 3, 50])
    def test_of_values_that_differ_by_rounding_alone_is_a_point(self, count):
        sample = np.full(count, 0.3)
        sample[0] = np.nextafter(0.3, 1.0)
        low, high = interval((sample,), mean)
        assert low == pytest.approx(0.3, rel=1e-14) and high == pytest.approx(0.3, rel=1e-14)

    def test_numpys_global_generator_neither_matters_nor_moves(self):
        sample = np.arange(10.0)
        found = []
        for seed in (1, 2):
            np.random.seed(seed)  # noqa: NPY002
            before = np.random.get_state()[1].copy()  # noqa: NPY002
            found.append(interval((sample,), mean))
            np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
        assert found[0] == found[1]


class TestPairedRatio:
    def flights(self, count: int = 60) -> tuple[np.ndarray, ...]:
        """Own, floor and ceiling on the same topologies, which differ much more than methods do."""
        generator = np.random.default_rng(7)
        topology = generator.normal(1.5, 0.3, count)
        low = topology + generator.normal(0.0, 0.01, count)
        high = topology + 0.2 + generator.normal(0.0, 0.01, count)
        own = topology + 0.15 + generator.normal(0.0, 0.01, count)
        return own, low, high

    def test_is_that_of_a_second_bca(self):
        flights = self.flights()
        assert_close(interval(flights, share), bca(flights, share))
        uneven = tuple(np.exp(values[:12]) for values in flights)
        assert_close(interval(uneven, share), bca(uneven, share))

    def test_is_narrow_since_samples_are_drawn_together(self):
        own, low, high = self.flights()
        ends = interval((own, low, high), share)
        assert ends[0] < 0.75 < ends[1]
        assert ends[1] - ends[0] < 0.06
        apart = interval((own, np.roll(low, 1), np.roll(high, 2)), share)
        assert apart[1] - apart[0] > 5 * (ends[1] - ends[0])

    def test_of_the_floor_is_0_and_of_the_ceiling_1(self):
        _, low, high = self.flights()
        assert interval((low, low, high), share) == [0.0, 0.0]
        assert interval((high, low, high), share) == [1.0, 1.0]

    def test_of_constants_is_a_point(self):
        values = [np.full(5, value) for value in (0.3, 0.1, 0.5)]
        assert interval(tuple(values), share) == pytest.approx([0.5, 0.5])

    def test_one_of_the_samples_may_be_constant(self):
        own = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
        found = interval((own, np.zeros(5), np.full(5, 10.0)), share)
        assert_close(found, [end / 10.0 for end in bca((own,), mean)])

    def test_that_some_resamples_do_not_have_is_unknown(self):
        # Floor and ceiling are equal in two topologies of three: resamples of these have no ratio.
        own, low, high = ([0.5, 0.6, 0.7], [0.5, 0.5, 0.5], [0.5, 0.5, 0.9])
        assert interval((np.array(own), np.array(low), np.array(high)), share) is None

    def test_that_is_the_same_in_every_resample_but_for_rounding_is_a_point(self):
        low = np.array([0.0, 0.1, 0.3])
        assert interval((low + 0.1, low, low + 0.2), share) == pytest.approx([0.5, 0.5])
