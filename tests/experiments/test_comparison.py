"""Comparisons over seeds against hand calculation, brute force and SciPy's other tests."""

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.statistics.comparison import (
    FLIPS,
    Equivalence,
    compare_families,
    compare_pairs,
    describe_seeds,
    equivalence,
    holm,
    interquartile_mean,
    judge,
    least_detectable_effect,
    p_value_above,
    probability_of_improvement,
    sign_flip_p_value,
)
from orchid_uav.experiments.statistics.intervals import interval
from tests.experiments.test_statistics import assert_close, bca

NAN = math.nan
figures = st.integers(-1000, 1000).map(lambda value: value / 8)  # sums of them are exact
pairs = st.lists(st.tuples(figures, figures), min_size=5, max_size=9)
few = settings(max_examples=30, deadline=None)


def split(seeds):
    return tuple(np.array(values) for values in zip(*seeds, strict=True))


def as_valid_json(found):
    written = json.dumps(found.to_json(), allow_nan=False)
    assert type(found).from_json(json.loads(written)) == found


class TestInterquartileMean:
    @pytest.mark.parametrize(
        ("values", "expected"),
        [
            (range(1, 9), 4.5),  # of 3, 4, 5, 6
            ([7.0], 7.0),
            ([1.0, 2.0, 9.0], 4.0),
            ([-50.0, 1.0, 3.0, 90.0], 2.0),
            ([9.0, 2.0, -7.0, 4.0, 3.0], 3.0),  # of 2, 3, 4
            ([0.0, 1.0, 2.0, 3.0, 5.0, 99.0], 2.75),
            ([0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 99.0], 3.6),
            ([0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 9.0, 80.0, 90.0], 4.0),  # of 1, 2, 3, 4, 5, 9
        ],
    )
    def test_by_hand(self, values, expected):
        assert interquartile_mean(np.array(values)) == pytest.approx(expected, rel=1e-15)

    def test_along_an_axis(self):
        table = np.array([[1.0, 5.0, 6.0, 90.0], [4.0, 3.0, 2.0, 1.0]])
        np.testing.assert_array_equal(interquartile_mean(table), [5.5, 2.5])
        np.testing.assert_array_equal(interquartile_mean(table.T, axis=0), [5.5, 2.5])

    @given(st.lists(figures, min_size=4, max_size=30), st.floats(0, 1e9))
    def test_neither_the_luckiest_nor_the_worst_seed_moves_it(self, values, shift):
        ordered = np.sort(values)
        moved = ordered.copy()
        moved[0] -= shift
        moved[-1] += shift
        assert interquartile_mean(moved) == interquartile_mean(ordered)

    def test_does_not_trim_what_is_no_number(self):
        assert np.isnan(interquartile_mean(np.array([1.0, 2.0, 3.0, 4.0, NAN])))


class TestDescription:
    def test_by_hand(self):
        found = describe_seeds([9.0, 2.0, -7.0, 4.0, 2.5])
        assert (found.n, found.failed, found.ci95_of) == (5, 0, "iqm")
        assert found.mean == pytest.approx(2.1)
        assert found.median == 2.5
        assert found.iqm == pytest.approx(8.5 / 3)
        squares = 6.9**2 + 0.1**2 + 9.1**2 + 1.9**2 + 0.4**2
        assert found.std == pytest.approx(math.sqrt(squares / 4))

    def test_the_interval_is_a_second_bca_of_the_interquartile_mean(self):
        values = np.random.default_rng(4).normal(3.0, 1.0, 10)
        assert_close(describe_seeds(values).ci95, bca((values,), interquartile_mean))

    def test_the_interval_of_ten_seeds_covers_about_as_often_as_it_says(self):
        # About 0.93 in 600 trials with other seeds.
        generator = np.random.default_rng(11)
        trials, covered = 400, 0
        for _ in range(trials):
            low, high = describe_seeds(generator.normal(3.0, 1.0, 10)).ci95
            covered += low <= 3.0 <= high
        assert 0.88 <= covered / trials <= 0.98

    def test_the_interval_is_unknown_where_no_single_seed_matters(self):
        found = describe_seeds([0.0] * 9 + [1.0])
        assert (found.iqm, found.ci95) == (0.0, None)

    def test_failed_seeds_are_counted_and_not_averaged(self):
        whole = describe_seeds([1.0, 5.0, 2.0, 3.0, 8.0])
        assert whole.ci95 is not None
        found = describe_seeds([1.0, NAN, 5.0, 2.0, None, 3.0, 8.0])
        assert found == whole.model_copy(update={"failed": 2})

    @pytest.mark.parametrize("count", range(5))
    def test_fewer_than_five_seeds_have_no_interval(self, count):
        found = describe_seeds([1.0, 2.0, 4.0, 8.0][:count])
        assert found.n == count and found.ci95 is None
        assert (found.std is None) == (count < 2)
        assert (found.mean is None) == (count == 0)
        as_valid_json(found)

    @pytest.mark.parametrize("values", [[1.0, math.inf], [[1.0, 2.0]], 3.0, ["x"]])
    def test_what_is_no_list_of_figures_is_refused(self, values):
        with pytest.raises(InputError, match="finite numbers"):
            describe_seeds(values)


def brute_force_p_value(differences):
    """Share of all sign patterns with a sum as far from 0."""
    sums = [
        abs(sum(sign * abs(value) for sign, value in zip(signs, differences, strict=True)))
        for signs in itertools.product((-1, 1), repeat=len(differences))
    ]
    return sum(total >= abs(sum(differences)) for total in sums) / len(sums)


class TestSignFlips:
    @pytest.mark.parametrize(
        ("differences", "expected"),
        [
            ([0.3, 1.0, 2.0, 0.1, 5.0], 2 / 32),
            ([-0.3, -1.0, -2.0, -0.1, -5.0], 2 / 32),
            ([3.0, -1.0], 1.0),  # sums ±2 and ±4
            ([3.0, 2.0, -1.0], 4 / 8),  # 4 of ±6, ±4, ±2, ±0
            ([0.0, 1.0, 1.0, 1.0], 2 / 8),  # a difference of 0 says nothing
            ([0.0] * 6, 1.0),
            ([0.1] * 6, 2 / 64),
            ([2.0], 1.0),
        ],
    )
    def test_by_hand(self, differences, expected):
        assert sign_flip_p_value(np.array(differences)) == expected

    def test_of_nothing_is_unknown(self):
        assert sign_flip_p_value(np.array([])) is None

    @few
    @given(st.lists(figures, min_size=2, max_size=9))
    def test_is_that_of_all_patterns(self, differences):
        expected = brute_force_p_value(differences)
        assert sign_flip_p_value(np.array(differences)) == pytest.approx(expected, rel=1e-12)

    def test_finds_an_effect_where_there_is_none_no_more_often_than_it_says(self):
        sizes = np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0])  # no two sums of them are the same
        found = [sign_flip_p_value(sizes * signs) for signs in itertools.product((-1, 1), repeat=7)]
        for level in (0.05, 0.1, 0.5):
            share = np.mean(np.array(found) <= level)
            assert share == math.floor(level * 64) / 64

    def test_of_many_pairs_is_near_the_exact_one(self):
        differences = np.random.default_rng(2).integers(-40, 70, 24)
        counts = np.ones(1)  # of patterns by their sum, one pair after the other
        for size in np.abs(differences):
            counts = np.convolve(counts, [1.0, *[0.0] * (2 * size - 1), 1.0] if size else [2.0])
        sums = np.arange(len(counts)) - np.abs(differences).sum()
        exact = counts[np.abs(sums) >= abs(differences.sum())].sum() / counts.sum()
        assert 0.01 < exact < 0.2
        found = sign_flip_p_value(differences.astype(float))
        assert abs(found - exact) < 4 * math.sqrt(2 * exact / FLIPS)
        assert found == sign_flip_p_value(differences.astype(float))

    @pytest.mark.parametrize(
        ("count", "expected"),
        [(1, 1.0), (2, 0.5), (5, 2 / 32), (10, 2 / 1024), (14, 2 / 2**14), (40, 2 / (2**14 + 1))],
    )
    def test_the_smallest_is_that_of_a_variant_that_wins_every_pair(self, count, expected):
        found = compare_pairs(np.zeros(count), np.linspace(1.0, 2.0, count), "higher")
        assert found.p_value == pytest.approx(expected, rel=1e-12)
        assert found.smallest_p == pytest.approx(expected, rel=1e-12)


def brute_force_share(base, variant, better):
    """Every run of the variant against every run of the base, one by one."""
    total = 0.0
    for one, other in itertools.product(base, variant):
        if np.isnan(one) or np.isnan(other):
            total += 0.5 * (1 + bool(np.isnan(one)) - bool(np.isnan(other)))
        elif one == other:
            total += 0.5
        else:
            total += (other > one) == (better != "lower")
    return total / (len(base) * len(variant))


class TestProbabilityOfImprovement:
    def test_by_hand(self):
        base, variant = np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.0, 4.0])
        # 2 > 1, 3 > 1, 3 > 2, 4 > 1, 4 > 2, 4 > 3, and two ties.
        assert probability_of_improvement(base, variant, "higher") == (pytest.approx(7 / 9), None)
        assert probability_of_improvement(base, variant, None) == (pytest.approx(7 / 9), None)
        assert probability_of_improvement(base, variant, "lower") == (pytest.approx(2 / 9), None)

    def test_a_failed_run_is_worse_than_any_other_and_ties_with_a_failed_one(self):
        base, variant = np.array([1.0, NAN, 3.0]), np.array([NAN, 9.0, NAN])
        # 9 beats all three; each failed one loses twice and ties once.
        assert probability_of_improvement(base, variant, "higher")[0] == pytest.approx(4 / 9)
        # 9 beats the failed one alone.
        assert probability_of_improvement(base, variant, "lower")[0] == pytest.approx(2 / 9)
        assert probability_of_improvement(base, variant, None) == (None, None)
        variant[0] = 0.0  # now the first pair is complete
        assert probability_of_improvement(base, variant, None) == (0.0, None)

    @few
    @given(pairs, st.data(), st.sampled_from(["higher", "lower"]))
    def test_is_that_of_all_pairs_of_seeds(self, seeds, data, better):
        base, variant = split(seeds)
        for values in (base, variant):
            failed = st.lists(st.booleans(), min_size=len(base), max_size=len(base))
            values[data.draw(failed)] = NAN
        expected = brute_force_share(base, variant, better)
        assert probability_of_improvement(base, variant, better)[0] == pytest.approx(expected)

    @few
    @given(pairs)
    def test_is_u_of_mann_and_whitney(self, seeds):
        base, variant = split(seeds)
        expected = stats.mannwhitneyu(variant, base).statistic / len(base) ** 2
        assert probability_of_improvement(base, variant, "higher")[0] == pytest.approx(expected)

    def test_the_interval_is_a_second_bca(self):
        def share(base, variant, axis):
            one, other = base[..., :, None], variant[..., None, :]
            return ((other > one) + 0.5 * (other == one)).mean(axis=(-1, -2))

        generator = np.random.default_rng(6)
        base, variant = generator.normal(0.0, 1.0, 10), generator.normal(0.7, 1.0, 10)
        found = probability_of_improvement(base, variant, "higher")[1]
        expected = bca((base, variant), share)
        # A share of 100 comparisons is a coarse number.
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.03)
        assert 0.0 < found[0] < float(share(base, variant, -1)) < found[1] <= 1.0

    @pytest.mark.parametrize("variant", [np.arange(10.0, 16.0), np.full(6, -1.0), np.zeros(6)])
    def test_without_overlap_resampling_cannot_say_how_sure_it_is(self, variant):
        base = np.zeros(6) if not variant.any() else np.arange(6.0)
        share, ends = probability_of_improvement(base, variant, "higher")
        assert share in (0.0, 0.5, 1.0) and ends is None


class TestEquivalence:
    # Mean 3, variance 2.5, standard error √(2.5 / 5) = 1/√2, four degrees of freedom.
    DIFFERENCES = np.array([1.0, 2.0, 3.0, 4.0, 5.0])

    @staticmethod
    def tail(t):
        """P(T > t) of Student's t with four degrees of freedom, in closed form."""
        root = 1.0 + t * t / 4.0
        return 0.5 - 0.375 * t / math.sqrt(root) * (1.0 - t * t / (12.0 * root))

    @pytest.mark.parametrize(
        ("margin", "p_value", "shown"), [(5.0, 0.02371, True), (4.0, 0.11510, False)]
    )
    def test_by_hand(self, margin, p_value, shown):
        expected = self.tail((margin - 3.0) * math.sqrt(2.0))
        assert expected == pytest.approx(p_value, abs=5e-6)
        for differences in (self.DIFFERENCES, -self.DIFFERENCES):
            found = equivalence(differences, margin)
            assert found.p_value == pytest.approx(expected, rel=1e-12)
            assert (found.margin, found.equivalent) == (margin, shown)

    @few
    @given(st.lists(figures, min_size=5, max_size=12), st.floats(0.1, 200.0))
    def test_is_whether_the_90_percent_interval_lies_within_the_margin(self, values, margin):
        values = np.array(values)
        if np.ptp(values) == 0.0:
            values[0] += 1.0
        low, high = stats.t.interval(0.9, len(values) - 1, values.mean(), stats.sem(values))
        found = equivalence(values, margin)
        assert found.equivalent == (-margin <= low and high <= margin)
        tests = [
            stats.ttest_1samp(values, -margin, alternative="greater").pvalue,
            stats.ttest_1samp(values, margin, alternative="less").pvalue,
        ]
        assert found.p_value == pytest.approx(max(tests), rel=1e-9)

    @pytest.mark.parametrize(
        ("difference", "p_value"), [(0.0, 0.0), (-0.5, 0.0), (1.0, 1.0), (2.0, 1.0)]
    )
    def test_differences_that_are_all_the_same_are_exact(self, difference, p_value):
        found = equivalence(np.full(5, difference), 1.0)
        assert found == Equivalence(margin=1.0, p_value=p_value, equivalent=p_value == 0.0)

    def test_needs_a_margin_and_five_pairs(self):
        assert equivalence(self.DIFFERENCES, None) is None
        assert equivalence(self.DIFFERENCES[:4], 100.0) is None

    @pytest.mark.parametrize("margin", [0.0, -1.0, NAN, math.inf])
    def test_a_margin_that_is_none_is_refused(self, margin):
        with pytest.raises(InputError, match="above 0"):
            equivalence(self.DIFFERENCES, margin)


class TestBeingAboveABound:
    @pytest.mark.parametrize("bound", [-0.4, 0.0, 1.3])
    def test_is_a_one_sided_t_test(self, bound):
        differences = np.array([0.3, -0.2, 1.1, 0.9, -0.6, 0.5, 0.1])
        reference = stats.ttest_1samp(differences, bound, alternative="greater").pvalue
        assert p_value_above(differences, bound) == pytest.approx(reference)

    def test_equal_differences_are_exact(self):
        assert p_value_above(np.full(10, -0.25), -0.5) == 0.0
        assert p_value_above(np.full(10, -0.75), -0.5) == 1.0


class TestLeastDetectableEffect:
    def test_is_that_of_published_power_tables(self):
        # G*Power: 34 pairs show an effect of 0.5 standard deviations with a power of 0.8077775.
        differences = stats.zscore(np.arange(34.0), ddof=1)
        assert least_detectable_effect(differences, 0.8077775) == pytest.approx(0.5, abs=1e-5)

    @pytest.mark.parametrize(("count", "power", "alpha"), [(5, 0.8, 0.05), (10, 0.5, 0.01)])
    def test_is_shown_that_often(self, count, power, alpha):
        generator = np.random.default_rng(8)
        spread = stats.zscore(np.arange(float(count)), ddof=1) * 3.0
        effect = least_detectable_effect(spread, power, alpha)
        runs = generator.normal(effect, 3.0, (40_000, count))
        shown = stats.ttest_1samp(runs, 0.0, axis=-1).pvalue <= alpha
        assert shown.mean() == pytest.approx(power, abs=0.01)

    def test_of_many_pairs_is_normal_theorys(self):
        differences = stats.zscore(np.arange(4000.0), ddof=1)
        expected = (1.959964 + 0.841621) / math.sqrt(4000)
        assert least_detectable_effect(differences) == pytest.approx(expected, rel=1e-3)

    def test_of_few_or_of_equal_differences(self):
        assert least_detectable_effect(np.arange(4.0)) is None
        assert least_detectable_effect(np.full(5, 0.25)) == 0.0

    @pytest.mark.parametrize(("power", "alpha"), [(1.0, 0.05), (0.8, 0.0), (0.04, 0.05)])
    def test_no_test_has_any_power_at_any_level(self, power, alpha):
        with pytest.raises(InputError, match="level"):
            least_detectable_effect(np.arange(6.0), power, alpha)


class TestHolm:
    def test_by_hand(self):
        # In order: 4 × 0.005, 3 × 0.01, 2 × 0.03, and 0.04, which is not below the one before.
        assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
        assert holm([0.4, 0.9]) == pytest.approx([0.8, 0.9])
        assert holm([0.6, 0.7]) == [1.0, 1.0]
        assert holm([]) == []

    def test_what_was_not_tested_does_not_count(self):
        assert holm([None, 0.02, None, 0.04]) == [None, 0.04, None, 0.04]

    @given(st.lists(st.floats(0, 1), min_size=1, max_size=12), st.floats(0.001, 0.5))
    def test_rejects_what_stepping_down_rejects(self, p_values, level):
        shown = set()
        for rank, index in enumerate(np.argsort(p_values, kind="stable")):
            if (len(p_values) - rank) * p_values[index] > level:
                break
            shown.add(int(index))
        assert {index for index, p in enumerate(holm(p_values)) if p <= level} == shown

    @pytest.mark.parametrize("p_value", [-0.1, 1.1, NAN])
    def test_what_is_no_p_value_is_refused(self, p_value):
        with pytest.raises(InputError, match="0 to 1"):
            holm([0.5, p_value])


class TestPairs:
    def test_by_hand(self):
        base, variant = [1.0, 2.0, 3.0, 4.0, 10.0], [2.0, 2.5, 5.0, 3.0, 18.0]
        found = compare_pairs(base, variant, "higher", margin=20.0)  # 1, 0.5, 2, -1, 8
        difference = found.difference
        assert (found.n, found.seeds, found.better) == (5, 5, "higher")
        assert difference.mean == pytest.approx(2.1)
        assert difference.median == 1.0
        assert difference.iqm == pytest.approx(3.5 / 3)
        assert difference.ci95_of == "mean"
        assert found.relative == pytest.approx(2.1 / 4.0)
        assert found.p_value == brute_force_p_value([1.0, 0.5, 2.0, -1.0, 8.0])
        assert found.equivalence.equivalent
        as_valid_json(found)

    def test_the_interval_is_that_of_the_mean_paired_difference(self):
        generator = np.random.default_rng(0)
        seeds = generator.normal(50.0, 20.0, 10)  # much more than the variant does
        variant = seeds + generator.normal(1.0, 0.5, 10)
        found = compare_pairs(seeds, variant, "higher").difference.ci95
        assert found == interval((variant - seeds,), np.mean)
        assert 0.0 < found[0] < 1.0 < found[1] < 2.0

    @pytest.mark.parametrize(("count", "least", "most"), [(5, 0.80, 0.88), (10, 0.88, 0.94)])
    def test_the_interval_covers_as_seldom_as_its_docstring_says(self, count, least, most):
        generator = np.random.default_rng(5)
        trials, covered = 1000, 0
        for _ in range(trials):
            low, high = interval((generator.normal(3.0, 1.0, count),), np.mean)
            covered += low <= 3.0 <= high
        assert least <= covered / trials <= most

    def test_failed_runs_are_told_and_never_imputed(self):
        base = [1.0, 2.0, NAN, 4.0, 5.0, NAN, 6.0, 9.0]
        variant = [1.5, 2.6, 3.0, NAN, 5.1, NAN, 5.0, 9.9]
        found = compare_pairs(base, variant, "higher", margin=1.0)
        assert (found.n, found.seeds) == (5, 8)
        assert (found.failed_base, found.failed_variant) == (2, 2)
        whole = [0, 1, 4, 6, 7]
        expected = compare_pairs(
            [base[seed] for seed in whole], [variant[seed] for seed in whole], "higher", margin=1.0
        )
        of_all = {"seeds", "failed_base", "failed_variant"}
        of_all |= {"probability_of_improvement", "probability_of_improvement_ci95"}
        for key in found.model_fields_set - of_all:
            assert getattr(found, key) == getattr(expected, key), key
        assert found.probability_of_improvement == brute_force_share(base, variant, "higher")
        as_valid_json(found)

    @pytest.mark.parametrize("count", range(7))
    @pytest.mark.parametrize("base", [0.0, 2.0, NAN])
    def test_any_number_of_pairs_is_valid_json(self, count, base):
        found = compare_pairs([base] * count, [float(k % 3) for k in range(count)], "lower", 0.1)
        as_valid_json(found)
        is_small = found.n < 5
        assert (found.difference.ci95 is None) == is_small
        assert (found.equivalence is None) == is_small
        assert (found.least_detectable_effect is None) == is_small
        assert (found.relative is None) == (base != 2.0 or not count)

    @few
    @given(pairs, st.sampled_from(["higher", "lower", None]))
    def test_swapped_is_the_same_the_other_way_round(self, seeds, better):
        base, variant = split(seeds)
        there = compare_pairs(base, variant, better, 9.0)
        back = compare_pairs(variant, base, better, 9.0)
        for statistic in ("mean", "median", "iqm"):
            assert getattr(back.difference, statistic) == pytest.approx(
                -getattr(there.difference, statistic), abs=1e-9
            )
        low, high = there.difference.ci95
        assert back.difference.ci95 == pytest.approx([-high, -low], abs=1e-9)
        share = there.probability_of_improvement
        assert back.probability_of_improvement == pytest.approx(1.0 - share)
        for key in ("p_value", "equivalence", "least_detectable_effect"):
            assert getattr(back, key) == getattr(there, key)
        opposite = {"better": "worse", "worse": "better", "higher": "lower", "lower": "higher"}
        assert judge(back) == opposite.get(judge(there), judge(there))

    @few
    @given(pairs, st.sampled_from(["higher", "lower"]), figures)
    def test_the_zero_of_the_scale_does_not_matter(self, seeds, better, shift):
        base, variant = split(seeds)
        found = compare_pairs(base, variant, better, 5.0)
        shifted = compare_pairs(base + shift, variant + shift, better, 5.0)
        assert shifted.model_copy(update={"relative": found.relative}) == found

    @few
    @given(pairs, st.sampled_from(["higher", "lower"]), st.integers(-8, 8))
    def test_the_unit_does_not_matter(self, seeds, better, exponent):
        base, variant = split(seeds)
        scale = 2.0**exponent  # exact in floating-point numbers
        found = compare_pairs(base, variant, better, 5.0)
        scaled = compare_pairs(base * scale, variant * scale, better, 5.0 * scale)
        for key in ("mean", "median", "iqm"):
            assert getattr(scaled.difference, key) == getattr(found.difference, key) * scale
        assert scaled.difference.ci95 == [end * scale for end in found.difference.ci95]
        effect = found.least_detectable_effect
        assert scaled.least_detectable_effect == pytest.approx(effect * scale)
        assert scaled.equivalence.p_value == pytest.approx(found.equivalence.p_value)
        for key in ("relative", "p_value", "probability_of_improvement_ci95"):
            assert getattr(scaled, key) == getattr(found, key)

    @few
    @given(pairs)
    def test_lower_is_better_is_higher_is_better_of_the_negative(self, seeds):
        base, variant = split(seeds)
        found = compare_pairs(base, variant, "lower")
        mirrored = compare_pairs(-base, -variant, "higher")
        for key in ("probability_of_improvement", "probability_of_improvement_ci95", "p_value"):
            assert getattr(found, key) == getattr(mirrored, key)
        assert judge(found) == judge(mirrored)

    def test_numpys_global_generator_neither_matters_nor_moves(self):
        base, variant = np.arange(20.0), np.sqrt(np.arange(20.0)) + 5.0
        found = []
        for seed in (1, 2):
            np.random.seed(seed)  # noqa: NPY002
            before = np.random.get_state()[1].copy()  # noqa: NPY002
            found.append(compare_pairs(base, variant, "higher"))
            np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
        assert found[0] == found[1]

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (([1.0], [1.0, 2.0], "higher"), "1 seeds of the base and 2 of the variant"),
            (([1.0], [math.inf], "higher"), "finite"),
            (([1.0], [2.0], "more"), "better is 'more'"),
            (([1.0], [2.0], "higher", 0.0), "margin is 0.0"),
        ],
    )
    def test_what_cannot_be_compared_is_refused(self, arguments, message):
        with pytest.raises(InputError, match=message):
            compare_pairs(*arguments)


ZEROS = np.zeros(10)
SHOWN = np.linspace(1.0, 2.0, 10)
MIXED = np.array([1.0, -1.0] * 5)


def failing(values, *seeds):
    values = np.array(values)
    values[list(seeds)] = NAN
    return values


class TestVerdict:
    @pytest.mark.parametrize(
        ("base", "variant", "better", "margin", "expected"),
        [
            (ZEROS, SHOWN, "higher", None, "better"),
            (ZEROS, SHOWN, "lower", None, "worse"),
            (ZEROS, SHOWN, None, None, "higher"),
            (SHOWN, ZEROS, None, None, "lower"),
            (SHOWN, ZEROS, "lower", 0.5, "better"),
            (ZEROS, MIXED, "higher", None, "no difference shown"),
            (ZEROS, MIXED, "higher", 0.1, "no difference shown"),
            (ZEROS, MIXED, "higher", 2.0, "equivalent"),
            (ZEROS, SHOWN, "higher", 3.0, "equivalent"),
            (ZEROS, ZEROS, "higher", None, "no difference shown"),
            (ZEROS[:5], SHOWN[:5], "higher", None, "undecided"),  # no p below 2/32
            (ZEROS[:6], SHOWN[:6], "higher", None, "better"),
            ([], [], "higher", None, "undecided"),
            (ZEROS, failing(SHOWN, *range(10)), "higher", None, "undecided"),
            (ZEROS, failing(SHOWN, 3), "higher", None, "undecided"),
            (ZEROS, failing(SHOWN, 3), "higher", 3.0, "undecided"),
            (ZEROS, failing(SHOWN, 3), None, None, "undecided"),
            (ZEROS, failing(SHOWN, 3), "lower", None, "worse"),
            (ZEROS, failing(MIXED, 3), "lower", None, "no difference shown"),
            (failing(ZEROS, 3), SHOWN, "lower", None, "undecided"),
            (failing(ZEROS, 3), SHOWN, "higher", None, "better"),
            (failing(ZEROS, 3), failing(SHOWN, 5), "higher", None, "better"),
        ],
    )
    def test_in_a_word(self, base, variant, better, margin, expected):
        assert judge(compare_pairs(base, variant, better, margin)) == expected

    def test_goes_by_the_adjusted_p_value_where_there_is_one(self):
        found = compare_pairs(ZEROS, SHOWN, "higher")
        assert judge(found.model_copy(update={"p_holm": 0.05})) == "better"
        assert judge(found.model_copy(update={"p_holm": 0.06})) == "no difference shown"
        assert (
            judge(found.model_copy(update={"p_holm": 0.06, "smallest_p_holm": 0.06})) == "undecided"
        )


class TestFamilies:
    def test_all_of_a_call_are_one_family(self):
        slight = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, -1.0, -2.0])
        base = {"reward": ZEROS, "power": ZEROS, "unjudged": ZEROS}
        variants = {
            "fast": {"reward": SHOWN, "power": slight},
            "slow": {"reward": failing(ZEROS, *range(10)), "power": MIXED, "unjudged": SHOWN},
        }
        found = compare_families(
            base, variants, {"reward": "higher", "power": "lower"}, {"power": 2.0}
        )
        assert list(found) == ["fast", "slow"]
        assert all(list(by_metric) == ["reward", "power"] for by_metric in found.values())
        least, second = 2 / 1024, brute_force_p_value(slight)
        assert 0.01 < second < 0.025
        # Three tests, for the fourth has no complete pair.
        assert found["fast"]["reward"].p_holm == pytest.approx(3 * least)
        assert found["fast"]["power"].p_holm == pytest.approx(2 * second)
        assert found["slow"]["power"].p_holm == 1.0
        assert found["slow"]["reward"].p_holm is None
        assert found["fast"]["reward"].smallest_p_holm == pytest.approx(3 * least)
        assert found["slow"]["reward"].smallest_p_holm is None
        verdicts = [found[name][metric].verdict for name in found for metric in found[name]]
        assert verdicts == ["better", "worse", "undecided", "equivalent"]
        own = compare_pairs(ZEROS, slight, "lower", 2.0)
        assert {
            key: found["fast"]["power"].to_json()[key] for key in own.to_json()
        } == own.to_json()
        for by_metric in found.values():
            for one in by_metric.values():
                as_valid_json(one)

    @pytest.mark.parametrize(("size", "expected"), [(25, "better"), (26, "undecided")])
    def test_ten_seeds_can_show_nothing_among_more_than_25(self, size, expected):
        variants = {str(index): {"reward": SHOWN} for index in range(size)}
        found = compare_families({"reward": ZEROS}, variants, {"reward": "higher"})
        assert {by_metric["reward"].verdict for by_metric in found.values()} == {expected}

    def test_of_no_variant_is_empty(self):
        assert compare_families({"reward": ZEROS}, {}, {"reward": "higher"}) == {}

    @pytest.mark.parametrize(
        ("base", "variant", "margins", "message"),
        [
            ({}, {"reward": ZEROS}, {}, "the base has no 'reward', only nothing"),
            ({"reward": ZEROS}, {"power": ZEROS}, {}, "'own' has no 'reward', only power"),
            ({"reward": ZEROS}, {"reward": ZEROS}, {"power": 1.0}, "only reward are judged"),
        ],
    )
    def test_what_is_missing_is_named(self, base, variant, margins, message):
        with pytest.raises(InputError, match=message):
            compare_families(base, {"own": variant}, {"reward": "higher"}, margins)
