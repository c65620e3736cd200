"""Table I, and what is refused."""

import pytest
from pydantic import ValidationError

from orchid_uav.envs import Parameters


def test_defaults_are_table_i():
    parameters = Parameters()
    network, uav, rotor = parameters.network, parameters.uav, parameters.rotor
    radio, reward = parameters.channel, parameters.reward
    assert (network.area_m, network.user_count, network.uav_count) == (2000, 100, 6)
    assert (network.scatter_std_m, network.hotspot_count) == (150, 5)
    assert (network.slot_s, network.episode_slots) == (1, 200)
    assert parameters.gbs_position_m == (1000, 1000, 30)
    assert (uav.initial_altitude_m, uav.min_altitude_m, uav.max_altitude_m) == (100, 80, 120)
    assert (uav.max_speed_mps, uav.min_separation_m) == (15, 5)
    assert (uav.min_transmit_power_w, uav.max_transmit_power_w) == (0.1, 0.2)
    assert (uav.power_step_w, uav.start_power_w) == (0.01, pytest.approx(0.15))
    assert (rotor.blade_profile_power_w, rotor.induced_power_w) == (79.856, 314.15)
    assert (rotor.tip_speed_mps, rotor.induced_velocity_mps) == (120, 4.03)
    assert (rotor.fuselage_drag_ratio, rotor.air_density_kg_per_m3) == (0.6, 1.225)
    assert (rotor.solidity, rotor.disc_area_m2) == (0.05, 0.503)
    assert (radio.carrier_frequency_hz, parameters.bandwidth_hz) == (2.4e9, 10e6)
    assert (radio.backhaul_bandwidth_hz, parameters.gbs.transmit_power_dbm) == (20e6, 30)
    assert (radio.noise_density_dbm_per_hz, radio.required_snr_db) == (-174, 6)
    assert radio.backhaul_required_snr_db == 10
    assert (radio.s_curve_a, radio.s_curve_b) == (9.61, 0.16)
    assert (radio.excess_loss_los_db, radio.excess_loss_nlos_db) == (1, 20)
    assert reward.coverage_weight == 0.5
    assert reward.efficiency_weight == (0.2, 0.5)
    assert reward.load_fairness_weight == reward.rate_fairness_weight == (0.8, 0.5)
    assert reward.penalty_weight == (0.1, 0.3)
    assert (reward.collision_penalty, reward.boundary_penalty) == (2.5, 1.0)
    assert reward.backhaul_penalty == (0.0, 45.0)


def test_is_frozen():
    with pytest.raises(ValidationError):
        Parameters().network.uav_count = 3


@pytest.mark.parametrize(
    "overrides",
    [
        {"uav_count": 0},
        {"user_count": -1},
        {"user_count": 6},
        {"area_m": 0.0},
        {"area_m": float("nan")},
        {"area_m": float("inf")},
        {"min_altitude_m": 110.0},
        {"initial_transmit_power_w": 0.3},
        {"excess_loss_nlos_db": 0.0},
        {"distribution": "gauss"},
        {"efficiency_weight": [True, False]},
        {"noise_density_dbm_per_hz": -4000.0},
        {"no_such_parameter": 1},
        {"network.no_such": 1},
    ],
)
def test_what_cannot_be_is_refused(overrides):
    with pytest.raises(ValueError):
        Parameters().with_overrides(overrides)


def test_total_bandwidth_is_divided_among_the_uavs():
    assert Parameters().with_overrides({"total_bandwidth_hz": 60e6}).bandwidth_hz == 10e6
    ten = Parameters().with_overrides({"total_bandwidth_hz": 60e6, "uav_count": 10})
    assert ten.bandwidth_hz == 6e6


def test_objective_sets_the_shares_unless_they_are_given():
    assert Parameters().reward.share_rule == "mmf"
    assert Parameters().with_overrides({"objective": "pf"}).reward.share_rule == "pf"
    both = Parameters().with_overrides({"objective": "mmf", "shares": "pf"})
    assert both.reward.share_rule == "pf"
