"""Table I, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from orchid_uav.envs import Parameters, WorldBatch
from orchid_uav.envs.interfaces.spaces import observation_space, state_space
from orchid_uav.envs.keys import fields_by_key, values_of

FEW = {
    "deployment.balanced_restarts": 3,
    "network.user_count": 6,
    "network.uav_count": 3,
    "deployment.n_init": 3,
}
"""Greatest numbers of what only costs time."""


def test_defaults_are_table_i():
    parameters = Parameters()
    network, uav, rotor = parameters.network, parameters.uav, parameters.rotor
    radio, reward = parameters.channel, parameters.reward
    assert (network.area_m, network.user_count, network.uav_count) == (2000, 100, 6)
    assert (network.scatter_std_m, network.hotspot_count) == (150, 5)
    assert (network.slot_s, network.episode_slots) == (1, 200)
    assert parameters.gbs_positions_m == ((1000, 1000, 30),)
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
        {"init": "random", "min_separation_m": 5000.0},
        {"no_such_parameter": 1},
        {"network.no_such": 1},
    ],
)
def test_what_cannot_be_is_refused(overrides):
    with pytest.raises(ValueError):
        Parameters().with_overrides(overrides)


def test_as_many_uavs_as_corners_have_room_for_a_random_start():
    corners = {"init": "random", "uav_count": 4, "area_m": 100.0, "min_separation_m": 100.0}
    assert Parameters().with_overrides(corners).deployment.init == "random"


@pytest.mark.parametrize("apart_m", [1.5e-198, 5e-324])
def test_a_random_start_may_be_as_narrow_as_numbers_are(apart_m):
    overrides = {"deployment.init": "random", "uav.min_separation_m": apart_m}
    assert Parameters().with_overrides(overrides).uav.min_separation_m == apart_m


def test_total_bandwidth_is_divided_among_the_uavs():
    assert Parameters().with_overrides({"total_bandwidth_hz": 60e6}).bandwidth_hz == 10e6
    ten = Parameters().with_overrides({"total_bandwidth_hz": 60e6, "uav_count": 10})
    assert ten.bandwidth_hz == 6e6


def test_objective_sets_the_shares_unless_they_are_given():
    assert Parameters().share_rule == "mmf"
    assert Parameters().with_overrides({"objective": "pf"}).share_rule == "pf"
    both = Parameters().with_overrides({"objective": "mmf", "shares": "pf"})
    assert both.share_rule == "pf"


def values_within(key: str, text: str) -> st.SearchStrategy[Any]:
    """What a key may hold, from the text that tells its range: often an end of it."""
    if key == "network.failures":
        slots = st.tuples(st.integers(0, 2), st.integers(0, 3), st.integers(4, 9))
        return st.lists(slots.map(lambda one: f"{one[0]}@{one[1]}-{one[2]}"), max_size=3)
    if key == "gbs.positions_m":
        place_m = st.sampled_from([-1e6, 0.0, 1e6]) | st.floats(-1e6, 1e6)
        height_m = st.sampled_from([0.01, 1e5]) | st.floats(0.01, 1e5)
        mast = st.tuples(place_m, place_m) | st.tuples(place_m, place_m, height_m)
        return st.just("middle") | st.lists(mast, max_size=3)
    if " or " in text:
        return st.one_of(*(values_within(key, one) for one in text.split(" or ")))
    count, _, inner = text.rpartition(" × ")
    if count:
        one = values_within(key, inner)
        return st.tuples(*[one] * int(count))
    least_text, dots, greatest_text = text.partition("..")
    if not dots:
        words = [True, False] if text == "true, false" else text.split(", ")
        found: st.SearchStrategy[Any] = st.none() if text == "none" else st.sampled_from(words)
    elif type(default_of(key)) is int:
        least, greatest = int(least_text), int(greatest_text)
        greatest = FEW.get(key, greatest)
        found = st.sampled_from([least, greatest]) | st.integers(least, greatest)
    else:
        low, high = float(least_text), float(greatest_text)
        found = st.sampled_from([low, high]) | st.floats(low, high)
        if low > 0.0:  # as likely near one end as near the other
            exponents = st.floats(math.log(low), math.log(high))
            found |= exponents.map(lambda power: min(max(math.exp(power), low), high))
    return found


def default_of(key: str) -> Any:
    return fields_by_key(Parameters)[key].default


RANGES = {key: values_of(field) for key, field in fields_by_key(Parameters).items()}


class TestExtremes:
    @settings(max_examples=80, deadline=None)
    @given(st.data())
    def test_whatever_is_accepted_flies_to_finite_numbers(self, data):
        chosen = data.draw(st.sets(st.sampled_from(sorted(RANGES)), min_size=1))
        overrides = {key: data.draw(values_within(key, RANGES[key]), key) for key in sorted(chosen)}
        self.fly({"network.user_count": 6, "network.uav_count": 3, **overrides})

    @settings(max_examples=40, deadline=None)
    @given(st.data())
    def test_all_keys_at_once(self, data):
        values = {key: data.draw(values_within(key, text), key) for key, text in RANGES.items()}
        for key in ("altitude_m", "transmit_power_w"):  # in order, lest most be refused
            names = [f"uav.{place}_{key}" for place in ("min", "initial", "max")]
            present = sorted(values[name] or values[names[0]] for name in names)
            values |= dict(zip(names, present, strict=True))
        losses = ["channel.excess_loss_los_db", "channel.excess_loss_nlos_db"]
        values |= dict(zip(losses, sorted(values[loss] for loss in losses), strict=True))
        masts = 1 if values["gbs.positions_m"] == "middle" else len(values["gbs.positions_m"])
        values["network.user_count"] = max(
            values["network.user_count"], values["network.uav_count"] + masts
        )
        self.fly(values)

    def fly(self, overrides: dict[str, Any]) -> None:
        try:
            world = WorldBatch(parameters := Parameters().with_overrides(overrides), seed=0)
            world.reset()
        except ValueError as error:  # limits in the wrong order, no room
            assert "not within" not in str(error) and len(str(error).splitlines()) == 1
            return
        own, joint = observation_space(parameters), state_space(parameters)
        generator = np.random.default_rng(0)
        for slot in range(3):
            if slot > 0 and not world.finished.any():
                actions = generator.choice([-1.0, 0.3, 1.0], (1, world.uav_count, 4))
                world.step(actions)
            for name, array in world.arrays._asdict().items():
                assert np.isfinite(array).all(), name
            assert all(own.contains(row) for row in world.observations()[0])
            assert joint.contains(world.arrays.states[0])
            for name, array in world.snapshot().items():
                assert np.isfinite(array).all(), name
