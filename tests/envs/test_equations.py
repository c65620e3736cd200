"""Propulsion, fairness, shares, reward, kinematics against independent numbers."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog, minimize

import tests.helpers.independent_network as independent
from orchid_uav.envs import fairness, kinematics, propulsion, reward, sharing
from orchid_uav.envs.parameters import Parameters, RotorParameters

ZENG = RotorParameters(blade_profile_power_w=79.86, induced_power_w=88.63)
efficiencies = arrays(np.float64, st.integers(1, 12), elements=st.floats(0.05, 20.0))
rates = arrays(
    np.float64,
    st.integers(1, 30),
    elements=st.just(0.0) | st.floats(1.0, 1e8, allow_subnormal=False),
)


class TestPropulsion:
    def test_hover_costs_profile_and_induced_power(self):
        assert propulsion.propulsion_power_w(0.0) == pytest.approx(394.006)

    def test_least_power_of_table_i(self):
        speed_mps = propulsion.least_power_speed_mps(RotorParameters(), 15.0)
        assert speed_mps == pytest.approx(14.25, abs=0.05)
        assert propulsion.propulsion_power_w(speed_mps) == pytest.approx(198.5, abs=0.1)

    def test_zengs_own_rotor(self):
        curve = ZENG.power_curve()
        assert propulsion.propulsion_power_w(0.0, **curve) == pytest.approx(168.49)
        assert propulsion.propulsion_power_w(20.0, **curve) == pytest.approx(178.30, abs=0.01)
        speed_mps = propulsion.least_power_speed_mps(ZENG, 30.0)
        assert speed_mps == pytest.approx(10.21, abs=0.01)
        assert propulsion.propulsion_power_w(speed_mps, **curve) == pytest.approx(126.01, abs=0.01)

    def test_the_least_may_lie_at_the_speed_limit(self):
        assert propulsion.least_power_speed_mps(RotorParameters(), 5.0) == 5.0

    @given(st.floats(0.0, 100.0))
    def test_is_the_papers_formula(self, speed_mps):
        expected = independent.level_propulsion_power_w(independent.Setting(), speed_mps)
        assert propulsion.propulsion_power_w(speed_mps) == pytest.approx(expected, rel=1e-6)

    def test_stays_finite_where_the_papers_difference_of_roots_loses_its_digits(self):
        assert propulsion.propulsion_power_w(1e6) > 0.0

    def test_climbing_costs_work_against_gravity_and_sinking_returns_none(self):
        assert propulsion.climb_power_w(5.0, 2.0) == pytest.approx(98.0665)
        assert propulsion.climb_power_w(-5.0, 2.0) == 0.0


class TestJain:
    def test_by_hand(self):
        assert fairness.jain_index([1, 2, 3, 4]) == pytest.approx(100 / 120)

    @given(st.integers(1, 20), st.integers(1, 20))
    def test_k_of_n_served_equally_is_their_ratio(self, k, n):
        assume(k <= n)
        assert fairness.jain_index([7.5] * k + [0.0] * (n - k)) == pytest.approx(k / n)

    def test_serving_nobody_is_never_fair(self):
        assert fairness.jain_index([]) == 0.0
        assert fairness.jain_index([0.0, 0.0]) == 0.0
        assert fairness.jain_index([3.0, 4.0], where=[False, False]) == 0.0

    def test_where_chooses(self):
        assert fairness.jain_index([1, 2, 3, 4, 0], where=[1, 1, 1, 1, 0]) == pytest.approx(5 / 6)

    def test_tiny_numbers_are_as_fair_as_large_ones(self):
        assert fairness.jain_index([1e-170] * 3) == pytest.approx(1.0)

    @given(rates, st.floats(1e-3, 1e3))
    def test_lies_between_one_nth_and_one_and_knows_no_scale(self, values, factor):
        index = fairness.jain_index(values)
        if values.sum() > 0:
            assert 1 / len(values) - 1e-9 <= index <= 1 + 1e-9
        assert fairness.jain_index(values * factor) == pytest.approx(index, rel=1e-6, abs=1e-12)


class TestShares:
    cell = np.array([0.5, 1.0, 2.0, 4.0])

    def test_max_min_by_hand(self):
        rates_bps = 10e6 * self.cell * sharing.max_min_shares(self.cell)
        np.testing.assert_allclose(rates_bps, 2.66667e6, rtol=1e-5)

    def test_proportional_by_hand(self):
        rates_bps = 10e6 * self.cell * sharing.proportional_shares(self.cell)
        np.testing.assert_allclose(rates_bps, [1.25e6, 2.5e6, 5e6, 10e6])
        assert fairness.jain_index(rates_bps) == pytest.approx(0.66176, abs=1e-5)

    def test_in_proportion_to_efficiency_by_hand(self):
        shares = sharing.spectral_efficiency_shares(self.cell)
        np.testing.assert_allclose(shares, self.cell / 7.5)

    @given(efficiencies)
    def test_all_divide_the_whole_band(self, cell):
        for rule in (
            sharing.max_min_shares,
            sharing.proportional_shares,
            sharing.spectral_efficiency_shares,
        ):
            shares = rule(cell)
            assert shares.sum() == pytest.approx(1.0)
            assert (shares > 0).all()

    @given(arrays(np.float64, st.integers(1, 6), elements=st.floats(0.1, 20.0)))
    def test_max_min_is_the_optimum_of_a_linear_programme(self, cell):
        # max t subject to share_m * efficiency_m >= t and shares summing to at most 1.
        users = len(cell)
        found = linprog(
            c=[0.0] * users + [-1.0],
            A_ub=np.vstack(
                [np.column_stack([-np.diag(cell), np.ones(users)]), [*np.ones(users), 0.0]]
            ),
            b_ub=[0.0] * users + [1.0],
        )
        worst = (sharing.max_min_shares(cell) * cell).min()
        assert worst == pytest.approx(-found.fun, rel=1e-6)

    def test_equal_shares_maximise_the_sum_of_logarithms(self):
        found = minimize(
            lambda shares: -np.log(shares * self.cell).sum(),
            x0=[0.4, 0.3, 0.2, 0.1],
            constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1},
            bounds=[(1e-6, 1)] * 4,
            options={"ftol": 1e-12},
        )
        np.testing.assert_allclose(sharing.proportional_shares(self.cell), found.x, atol=1e-4)

    @given(efficiencies)
    def test_proportional_throughput_is_never_below_max_min(self, cell):
        max_min = (sharing.max_min_shares(cell) * cell).sum()
        proportional = (sharing.proportional_shares(cell) * cell).sum()
        assert proportional >= max_min * (1 - 1e-9)  # arithmetic against harmonic mean

    def test_refuses_what_is_no_cell(self):
        with pytest.raises(ValueError, match="> 0"):
            sharing.max_min_shares([1.0, 0.0])


class TestReward:
    def test_weights_move_in_a_straight_line(self):
        weights = Parameters().reward
        for pair, middle in (
            (weights.efficiency_weight, 0.35),
            (weights.load_fairness_weight, 0.65),
            (weights.rate_fairness_weight, 0.65),
            (weights.penalty_weight, 0.2),
            (weights.backhaul_penalty, 22.5),
        ):
            assert reward.linear_schedule(*pair, 0.5) == pytest.approx(middle)

    def test_coverage(self):
        assert reward.coverage_ratio(3, 4) == 0.75
        assert reward.coverage_ratio(0, 0) == 1.0  # nobody is left behind where nobody is

    def test_energy_efficiency_scale_of_table_i(self):
        scale = reward.energy_efficiency_scale(Parameters())
        assert scale == pytest.approx(independent.ee_max(independent.Setting()), rel=1e-6)
        assert scale == pytest.approx(0.8e6, rel=0.01)

    def test_normalisation_is_clipped(self):
        values = np.array([-1.0, 2.0, 4.0, 9.0])
        normalised = reward.normalised_energy_efficiency(values, 4.0)
        np.testing.assert_allclose(normalised, [0.0, 0.5, 1.0, 1.0])

    def test_log_rate_utility(self):
        values = reward.log_rate_utility(np.array([0.0, 1e4, 1e5, 1e6, 1e7]), 1e4, 1e6)
        np.testing.assert_allclose(values, [0.0, 0.0, 0.5, 1.0, 1.0])

    def test_penalty_by_hand(self):
        assert reward.penalty(2, True, True, 2.5, 1.0, 22.5) == pytest.approx(28.5)
        assert reward.penalty(0, False, False, 2.5, 1.0, 22.5) == 0.0


class TestKinematics:
    def test_long_displacements_are_scaled_to_the_limit(self):
        length_m = math.sqrt(15**2 + 15**2 + 5**2)
        assert kinematics.displacement_factor(length_m, 15.0) * length_m == pytest.approx(15.0)
        assert kinematics.displacement_factor(10.0, 15.0) == 1.0
        assert kinematics.displacement_factor(0.0, 15.0) == 1.0

    def test_a_range_without_extent_is_zero(self):
        assert kinematics.relative(100.0, 100.0, 100.0) == 0.0
        assert kinematics.relative(100.0, 80.0, 120.0) == 0.5
