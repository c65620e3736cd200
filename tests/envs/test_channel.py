"""Radio links against numbers worked out by hand and against their own laws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.envs import channel
from orchid_uav.envs.parameters import ChannelParameters, Parameters
from orchid_uav.envs.units import dbm_to_watt, decibel_to_linear, linear_to_decibel

URBAN = {
    "carrier_frequency_hz": 2e9,
    "s_curve_a": 9.61,
    "s_curve_b": 0.16,
    "excess_loss_los_db": 1.0,
    "excess_loss_nlos_db": 20.0,
}
distances = st.floats(0.0, 3000.0)
altitudes = st.floats(1.0, 500.0)


@pytest.mark.parametrize(
    ("elevation_deg", "expected"),
    [(15.0, 0.19775), (30.0, 0.73098), (45.0, 0.96769), (60.0, 0.99698)],
)
def test_line_of_sight_probability_of_the_urban_curve(elevation_deg, expected):
    assert channel.line_of_sight_probability(elevation_deg, 9.61, 0.16) == pytest.approx(
        expected, abs=5e-6
    )


@pytest.mark.parametrize(("ground_m", "expected_db"), [(0.0, 79.469), (500.0, 110.335)])
def test_path_loss_of_the_urban_curve_at_2_ghz(ground_m, expected_db):
    loss_db = channel.air_to_ground_path_loss_db(ground_m, 100.0, **URBAN)
    assert loss_db == pytest.approx(expected_db, abs=5e-4)


def test_elevation_is_in_degrees():
    assert channel.elevation_angle_deg(100.0, 200.0) == pytest.approx(30.0)
    assert channel.elevation_angle_deg(80.0, 80.0) == pytest.approx(90.0)


def test_free_space_loss_is_friis():
    wavelength_m = 299_792_458.0 / 2.4e9
    expected_db = 20 * math.log10(4 * math.pi * 1000.0 / wavelength_m)
    assert channel.free_space_path_loss_db(1000.0, 2.4e9) == pytest.approx(expected_db, abs=1e-9)


def test_ground_loss_by_hand():
    # 20 lg(4 pi f / c) = 20 lg 100.6005 = 40.0520 dB at 2.4 GHz; 35 dB per decade: 70 dB.
    loss_db = channel.ground_path_loss_db(100.0, 2.4e9, 3.5, shadowing_db=-4.0)
    assert loss_db == pytest.approx(40.0520 + 70.0 - 4.0, abs=1e-3)


def test_backhaul_snr_is_the_closed_form_of_the_paper():
    radio = ChannelParameters()
    noise_w = 1e-3 * 10 ** (-174 / 10) * 20e6
    expected = 1.0 * 299_792_458.0**2 / ((4 * math.pi * 2.4e9 * 700.0) ** 2 * noise_w)
    snr = channel.backhaul_snr(700.0, 1.0, 0.0, 2.4e9, radio.noise_power_w(20e6))
    assert snr == pytest.approx(expected, rel=1e-12)
    assert math.isfinite(channel.backhaul_snr(0.0, 1.0, 0.0, 2.4e9, noise_w))


def test_backhaul_of_the_flight_box_lies_where_the_design_says():
    # Farthest corner at H_max, nearest point straight above the antenna at H_min.
    noise_w = Parameters().channel.noise_power_w(20e6)
    far_m = math.sqrt(1000**2 + 1000**2 + 90**2)
    snr_db = [
        linear_to_decibel(channel.backhaul_snr(distance_m, 1.0, 0.0, 2.4e9, noise_w))
        for distance_m in (far_m, 50.0)
    ]
    assert snr_db == pytest.approx([27.9, 57.0], abs=0.05)


def test_decibels_come_and_go():
    assert decibel_to_linear(6.0) == pytest.approx(3.98107, abs=1e-5)
    assert decibel_to_linear(-30.0) == pytest.approx(1e-3)
    assert dbm_to_watt(30.0) == pytest.approx(1.0)
    assert linear_to_decibel(1000.0) == pytest.approx(30.0)


def test_spectral_efficiency_counts_bits():
    assert channel.spectral_efficiency(3.0) == pytest.approx(2.0)


@given(distances, distances, altitudes)
def test_loss_grows_with_ground_distance(first_m, second_m, altitude_m):
    near_m, far_m = sorted((first_m, second_m))
    near_db = channel.air_to_ground_path_loss_db(near_m, altitude_m)
    far_db = channel.air_to_ground_path_loss_db(far_m, altitude_m)
    assert near_db <= far_db + 1e-9


@given(st.floats(50.0, 3000.0), st.floats(0.01, 1.0), st.floats(0.01, 1.0))
def test_loss_falls_with_elevation_at_equal_distance(distance_m, first_sine, second_sine):
    def loss_db(sine):
        ground_m = distance_m * math.sqrt(1.0 - sine * sine)
        return channel.air_to_ground_path_loss_db(ground_m, distance_m * sine)

    low, high = sorted((first_sine, second_sine))
    assert loss_db(high) <= loss_db(low) + 1e-9


@given(distances, altitudes)
def test_loss_is_never_below_that_of_a_line_of_sight(ground_m, altitude_m):
    best_case = channel.best_case_gain_m2(0.0, 2.4e9, 1.0) / (ground_m**2 + altitude_m**2)
    loss_db = channel.air_to_ground_path_loss_db(ground_m, altitude_m)
    assert channel.received_power_w(1.0, 0.0, loss_db) <= best_case * (1 + 1e-12)
    # With the two above, what association relies on.
    assert channel.LOSS_ALLOWS_PRUNING


@given(st.lists(st.tuples(distances, altitudes), min_size=1, max_size=5))
def test_arrays_give_what_scalars_give(links):
    ground_m, altitude_m = np.array(links).T
    together = channel.air_to_ground_path_loss_db(ground_m, altitude_m)
    one_by_one = [channel.air_to_ground_path_loss_db(*link) for link in links]
    np.testing.assert_allclose(together, one_by_one, rtol=1e-12)
