"""From values per seed to findings, and from findings to verdicts."""

import numpy as np
import pytest
from scipy.stats import nct, t, ttest_1samp

from orchid_uav.experiments.reproduction.checks import MARGINS
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.verdicts import (
    Check,
    judge_checks,
    verdict_of,
)

SEEDS = range(10)


def _power(effect: float, alternative: str, alpha: float = 0.05) -> float:
    """Of a t-test of ten values with this effect in standard deviations, from its definition."""
    threshold = t.isf(alpha if alternative == "larger" else alpha / 2.0, 9)
    return float(nct.sf(threshold, 9, effect * np.sqrt(10.0)))


NOISE = np.array([-0.9, 0.4, 1.1, -0.3, 0.7, -1.2, 0.2, 0.9, -0.6, -0.3]) * 0.01


def judged(expected: str, difference, margin: float = 0.02, of: int = 10):
    """A check whose other side is 0.5 for all seeds."""
    one = 0.5 + np.broadcast_to(difference, 10).astype(float)
    one[of:] = np.nan
    check = Check(
        "one beside another",
        ("one", "other"),
        "rate_jfi",
        expected,
        margin,
        lambda _: one,
        lambda evidence: np.full(len(evidence.seeds), 0.5),
    )
    [found] = judge_checks([check], Evidence([], SEEDS))
    return found


class TestAFinding:
    @pytest.mark.parametrize(
        ("expected", "mean", "finding"),
        [
            ("higher", 0.1, "yes"),
            ("higher", -0.1, "no"),
            ("higher", 0.0, "no"),  # shown to be within the margin
            ("higher", 0.005, "no"),
            ("lower", -0.1, "yes"),
            ("lower", 0.1, "no"),
            ("lower", 0.0, "no"),
            ("equal", 0.0, "yes"),
            ("equal", 0.1, "no"),
            ("equal", -0.1, "no"),
            ("not lower", 0.1, "yes"),
            ("not lower", 0.0, "yes"),
            ("not lower", -0.1, "no"),
        ],
    )
    def test_of_a_clear_difference(self, expected, mean, finding):
        assert judged(expected, mean + NOISE).finding == finding

    @pytest.mark.parametrize("expected", ["higher", "lower", "equal", "not lower"])
    def test_is_open_where_seeds_scatter_far_more_than_the_margin(self, expected):
        found = judged(expected, 20.0 * NOISE)
        assert found.finding == "undecided"
        assert found.least_detectable_effect > 0.05

    def test_tells_the_distance_from_0_or_from_the_margin_that_would_be_decided(self):
        std = np.std(20.0 * NOISE, ddof=1)
        for expected, alternative in (("lower", "two-sided"), ("not lower", "larger")):
            least = judged(expected, 20.0 * NOISE).least_detectable_effect
            power = _power(least / std, alternative)
            assert power == pytest.approx(0.8, abs=1e-6), expected

    def test_a_greater_family_needs_a_greater_effect(self):
        def check(_):
            return 20.0 * NOISE

        one = Check("c", ("m",), "rate_jfi", "higher", 0.02, check, lambda _: np.zeros(10))
        [alone] = judge_checks([one], Evidence([], SEEDS))
        for found in judge_checks([one] * 4, Evidence([], SEEDS)):
            assert found.least_detectable_effect > alone.least_detectable_effect
            assert _power(
                found.least_detectable_effect / np.std(20.0 * NOISE, ddof=1), "two-sided", 0.05 / 4
            ) == pytest.approx(0.8, abs=1e-6)

    @pytest.mark.parametrize("expected", ["higher", "lower", "equal", "not lower"])
    def test_needs_ten_pairs(self, expected):
        found = judged(expected, 0.1 + NOISE, of=9)
        assert (found.finding, found.n, found.units) == ("undecided", 9, 10)

    def test_may_be_yes_though_its_mean_is_within_a_margin_that_is_not_shown(self):
        found = judged("higher", 0.018 + NOISE)
        assert found.finding == "yes"
        assert found.difference == pytest.approx(0.018)

    @pytest.mark.parametrize(
        ("expected", "mean"),
        [("equal", 0.018), ("equal", -0.018), ("not lower", -0.018)],
    )
    def test_is_no_where_a_shown_difference_is_not_shown_to_pass_the_margin(self, expected, mean):
        found = judged(expected, mean + NOISE)
        assert found.p_holm <= 0.05, "a difference is shown"
        assert found.finding == "undecided"
        beyond = ttest_1samp(abs(mean + 0.01 * np.sign(mean)) + NOISE, 0.02, alternative="greater")
        assert beyond.pvalue <= 0.05
        assert judged(expected, mean + 0.01 * np.sign(mean) + NOISE).finding == "no"

    def test_has_no_units_where_a_side_was_not_flown(self):
        check = Check(
            "c", ("m",), "rate_jfi", "lower", 0.1, lambda _: np.ones(100), lambda _: np.empty(0)
        )
        [found] = judge_checks([check], Evidence([], SEEDS))
        assert (found.finding, found.n, found.one) == ("undecided", 0, None)


def test_tests_of_a_claim_are_one_family():
    def check(number: float) -> Check:
        values = number + NOISE
        return Check(
            "c", ("m",), "rate_jfi", "higher", 1e-6, lambda _: values, lambda _: np.zeros(10)
        )

    [alone] = judge_checks([check(0.0065)], Evidence([], SEEDS))
    assert alone.finding == "yes"
    together = judge_checks([check(0.0065)] * 4, Evidence([], SEEDS))
    assert [one.p_holm for one in together] == [pytest.approx(4 * alone.p_holm)] * 4
    assert {one.finding for one in together} == {"undecided"}


@pytest.mark.parametrize(
    ("findings", "verdict"),
    [
        (["yes"], "holds"),
        (["yes", "yes"], "holds"),
        (["yes", "no"], "partly"),
        (["yes", "no", "undecided"], "partly"),
        (["no"], "does not hold"),
        (["no", "no"], "does not hold"),
        (["no", "undecided"], "undecided"),
        (["yes", "undecided"], "undecided"),
        (["undecided"], "undecided"),
        ([], "not testable in this model"),
    ],
)
def test_findings_make_a_verdict(findings, verdict):
    assert verdict_of(findings) == verdict


class TestTheClaims:
    def test_are_the_papers_and_ours(self):
        assert [claim.key for claim in CLAIMS] == [f"c{number}" for number in range(1, 32)]
        assert [claim.key for claim in QUESTIONS] == [f"q{number}" for number in range(1, 9)]

    @pytest.mark.parametrize("claim", [*CLAIMS, *QUESTIONS], ids=lambda claim: claim.key)
    def test_are_undecided_without_rows(self, claim):
        for distribution in ("tcp", "uniform"):
            found = judge_checks(list(claim.checks(distribution)), Evidence([]))
            assert {one.finding for one in found} <= {"undecided"}
            assert all(one.margin > 0.0 for one in found)
            assert len({(one.what, one.metric) for one in found}) == len(found)
        assert (len(found) == 0) == (claim.key == "c29")

    def test_margins_are_of_known_metrics(self):
        for claim in (*CLAIMS, *QUESTIONS):
            assert {check.metric for check in claim.checks("tcp")} <= set(MARGINS)
