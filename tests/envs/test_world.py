"""The batched world against an independent scalar version, and what must hold of it."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tests.helpers.independent_network as independent
from orchid_uav.envs import Parameters, WorldBatch, channel, evaluation_seeds, world_seeds
from orchid_uav.envs.keys import fields_by_key
from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS

CROWDED = {"network.area_m": 400.0, "uav.min_separation_m": 120.0}
WEAK_BACKHAUL = {"gbs.transmit_power_dbm": -12.0}
CASES = {
    "table I": {},
    "uniform, moving users": {"network.distribution": "uniform", "network.user_speed_mps": 15.0},
    "held headings": {"network.user_speed_mps": 10.0, "network.heading_hold_s": 20.0},
    "proportional fairness": {"reward.objective": "pf"},
    "equal shares, MMF reward": {"network.shares": "pf"},
    "shares by efficiency": {"network.shares": "se"},
    "collisions": CROWDED,
    "weak backhaul": WEAK_BACKHAUL,
    "nobody reaches the SNR": {"channel.required_snr_db": 60.0},
    "some reach the SNR": {"channel.required_snr_db": 22.0},
    "climb power": {"rotor.climb_power": True},
    "one UAV": {"network.uav_count": 1, "network.user_count": 5},
    "ten UAVs": {"network.uav_count": 10, "network.total_bandwidth_hz": 60e6},
    "half-second slots": {"network.slot_s": 0.5, "network.user_speed_mps": 5.0},
    "a rectangle": {"network.area_m": (900.0, 300.0), "network.user_speed_mps": 15.0},
    "no mast": {"gbs.positions_m": [], "network.area_m": (800.0, 1500.0)},
    "three masts": {
        "gbs.positions_m": [[0.0, 0.0], [2500.0, 300.0, 12.0], [900.0, 1400.0]],
        "network.area_m": (3000.0, 1400.0),
        "channel.backhaul_required_snr_db": 40.0,
    },
}


def setting_of(parameters: Parameters) -> independent.Setting:
    network, uav, rotor = parameters.network, parameters.uav, parameters.rotor
    radio, reward = parameters.channel, parameters.reward
    return independent.Setting(
        area_m=network.area_size_m,
        slot_s=network.slot_s,
        min_separation_m=uav.min_separation_m,
        required_snr_db=radio.required_snr_db,
        bandwidth_hz=parameters.bandwidth_hz,
        masts_m=parameters.gbs_positions_m,
        backhaul_threshold_db=radio.backhaul_required_snr_db,
        gbs_power_dbm=parameters.gbs.transmit_power_dbm,
        objective=reward.objective,
        shares=parameters.share_rule,
        climb_mass_kg=rotor.mass_kg if rotor.climb_power else 0.0,
    )


def fly_both(
    parameters: Parameters, seed: int, slots: int, progress: float, **extensions: Any
) -> None:
    """Fly random actions and compare every slot with the independent version."""
    world = WorldBatch(parameters, worlds=2, seed=seed, **extensions)
    world.set_progress(progress)
    world.reset()
    setting = setting_of(parameters)
    generator = np.random.default_rng(seed)
    past = [(0, 0, 0)] * world.uav_count
    for slot in range(slots):
        before = world.snapshot(1)
        actions = generator.uniform(-1.3, 1.3, (2, world.uav_count, 4))
        world.step(actions)
        after = world.snapshot(1)
        expected = independent.fly(
            setting,
            independent.Slot(
                uav_positions_m=[tuple(row) for row in before["uav_positions_m"].tolist()],
                transmit_powers_w=before["transmit_powers_w"].tolist(),
                users_m=[tuple(row) for row in after["users_m"].tolist()],
                target_users=before["target_users"].tolist(),
                actions=[tuple(row) for row in actions[1].tolist()],
                past_violation_slots=past,
                past_slots=slot,
                progress=progress,
            ),
        )
        assert_same_slot(world, after, expected)
        past = [tuple(row) for row in world.arrays.violation_slots[1].tolist()]


def assert_same_slot(world: WorldBatch, after: dict, expected: independent.Outcome) -> None:
    close = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(after["uav_positions_m"], expected.uav_positions_m, **close)
    np.testing.assert_allclose(after["uav_velocities_mps"], expected.uav_velocities_mps, **close)
    np.testing.assert_allclose(after["transmit_powers_w"], expected.transmit_powers_w, **close)
    np.testing.assert_array_equal(after["association"], expected.association)
    np.testing.assert_array_equal(world.arrays.loads[1], expected.loads)
    np.testing.assert_allclose(world.arrays.rates_bps[1], expected.rates_bps, **close)
    np.testing.assert_allclose(world.arrays.rewards[1], expected.rewards, **close)
    measured = world.slot_metrics(1)
    assert list(measured) == list(SLOT_METRICS)
    for name, value in expected.metrics.items():
        assert measured[name] == pytest.approx(value, rel=1e-9, abs=1e-9), name
    single = {"rtol": 1e-6, "atol": 1e-6}
    np.testing.assert_allclose(world.arrays.observations[1], expected.observations, **single)
    np.testing.assert_allclose(world.arrays.states[1], expected.state, **single)


@pytest.mark.parametrize("overrides", CASES.values(), ids=CASES.keys())
def test_flies_as_the_independent_version_does(overrides):
    parameters = Parameters().with_overrides(overrides)
    fly_both(parameters, seed=7, slots=12, progress=0.4)


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    uavs=st.integers(1, 8),
    extra_users=st.integers(1, 40),
    progress=st.floats(0.0, 1.0),
    distribution=st.sampled_from(["tcp", "uniform"]),
)
def test_flies_as_the_independent_version_does_anywhere(
    seed, uavs, extra_users, progress, distribution
):
    parameters = Parameters().with_overrides(
        {"uav_count": uavs, "user_count": uavs + extra_users, "distribution": distribution}
    )
    fly_both(parameters, seed, slots=3, progress=progress)


def test_the_cases_above_do_meet_collisions_walls_and_weak_backhaul():
    for overrides, metric in (
        (CROWDED, "collisions"),
        (CROWDED, "boundary_violations"),
        (WEAK_BACKHAUL, "backhaul_violations"),
    ):
        world = WorldBatch(Parameters().with_overrides(overrides), seed=7)
        world.reset()
        generator = np.random.default_rng(7)
        for _ in range(40):
            world.step(generator.uniform(-1.3, 1.3, (1, 6, 4)))
        assert world.episode_metrics(0)[metric] > 0


def test_uavs_begin_within_the_flight_box_though_their_users_stand_at_its_border():
    # The mean of three such numbers is above them.
    border_m = next(side for side in 2000.0 + np.arange(1000) / 7.0 if np.mean([side] * 3) > side)
    parameters = Parameters().with_overrides({"area_m": border_m, "uav_count": 1})
    users_m = [[border_m, border_m]] * 3 + [[0.5 * border_m, 0.5 * border_m]] * 2
    for seed in range(20):
        world = WorldBatch(parameters, seed=seed, user_positions_m=users_m)
        world.reset()
        assert (world.arrays.positions_m[..., :2] <= border_m).all()
        assert (world.arrays.observations >= 0.0).all()


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**31), uavs=st.integers(1, 12))
def test_association_is_an_exhaustive_search_whatever_altitudes_and_powers(seed, uavs):
    wide = {"min_altitude_m": 1.0, "max_altitude_m": 900.0, "power_step_w": 0.0}
    powers = {"min_transmit_power_w": 1e-4, "max_transmit_power_w": 10.0}
    anyone = {"required_snr_db": -100.0, "uav_count": uavs}
    parameters = Parameters().with_overrides({**wide, **powers, **anyone})
    world = WorldBatch(parameters, seed=seed)
    world.reset()
    generator = np.random.default_rng(seed)
    world.arrays.positions_m[0, :, :2] = generator.uniform(0, 2000, (uavs, 2))
    world.arrays.positions_m[0, :, 2] = generator.uniform(1, 900, uavs)
    world.arrays.transmit_powers_w[0] = 10.0 ** generator.uniform(-4, 1, uavs)
    world.step(np.zeros((1, uavs, 4)))
    snapshot = world.snapshot()
    ground_m = np.linalg.norm(
        snapshot["users_m"][:, None] - snapshot["uav_positions_m"][None, :, :2], axis=2
    )
    loss_db = channel.air_to_ground_path_loss_db(ground_m, snapshot["uav_positions_m"][:, 2])
    received_w = channel.received_power_w(snapshot["transmit_powers_w"], 0.0, loss_db)
    strongest = channel.strongest_transmitter(received_w.T)
    expected = np.where(snapshot["target_users"], strongest, -1)
    np.testing.assert_array_equal(snapshot["association"], expected)


class TestEpisodes:
    def test_figures_are_sums_or_means_over_slots(self):
        world = WorldBatch(Parameters().with_overrides(CROWDED), seed=3)
        world.reset()
        slots, rewards = [], []
        for _ in range(20):
            world.step(np.random.default_rng(len(slots)).uniform(-1, 1, (1, 6, 4)))
            slots.append(world.slot_metrics(0))
            rewards.append(world.arrays.rewards[0].mean())
        episode = world.episode_metrics(0)
        assert list(episode) == list(EPISODE_METRICS)
        assert episode["reward"] == pytest.approx(sum(rewards))
        for name in SLOT_METRICS:
            values = [slot[name] for slot in slots]
            counts = name in {"collisions", "boundary_violations", "backhaul_violations"}
            expected = sum(values) if counts else np.mean(values)
            assert episode[name] == pytest.approx(expected), name

    def test_hovering_costs_hover_power_and_circling_less(self):
        world = WorldBatch(seed=0)
        world.reset()
        world.step(np.zeros((1, 6, 4)))
        assert world.slot_metrics(0)["propulsion_power_w"] == pytest.approx(6 * 394.006)

    def test_reward_follows_progress(self):
        world = WorldBatch(seed=0)
        rewards = []
        for progress in (0.0, 1.0):
            world.seed(0)
            world.reset()
            world.set_progress(progress)
            world.step(np.zeros((1, 6, 4)))
            rewards.append(world.arrays.rewards[0, 0])
        assert rewards[0] != rewards[1]

    def test_progress_is_clipped_to_one_and_refused_below_zero(self):
        world = WorldBatch(seed=0)
        world.set_progress(3.0)
        assert world.progress == 1.0
        for wrong in (-0.1, float("nan")):
            with pytest.raises(ValueError, match="progress"):
                world.set_progress(wrong)

    def test_reset_of_some_worlds_leaves_the_others_alone(self):
        world = WorldBatch(worlds=3, seed=0)
        world.reset()
        for _ in range(5):
            world.step(np.full((3, 6, 4), 0.3))
        before = [array[[0, 2]].copy() for array in world.arrays]
        users = world.snapshot(1)["users_m"]
        world.reset([1])
        for array, kept in zip(world.arrays, before, strict=True):
            np.testing.assert_array_equal(array[[0, 2]], kept)
        assert world.arrays.slot.tolist() == [5, 0, 5]
        assert not np.array_equal(world.snapshot(1)["users_m"], users)
        assert world.arrays.episode_sums[1].tolist() == [0.0] * len(EPISODE_METRICS)


class TestSeeds:
    def course(self, worlds: int, which: int, seed: int = 11) -> list[np.ndarray]:
        parameters = Parameters().with_overrides({"network.user_speed_mps": 10.0})
        world = WorldBatch(parameters, worlds=worlds, seed=seed)
        generator = np.random.default_rng(1)
        found = []
        for _ in range(2):
            world.reset()
            for _ in range(5):
                action = generator.uniform(-1, 1, (6, 4))
                world.step(np.broadcast_to(action, (worlds, 6, 4)))
                found += [array[which].copy() for array in world.arrays]
        return found

    @pytest.mark.parametrize("which", [0, 2])
    def test_a_course_depends_on_its_own_seed_only(self, which):
        small, large = self.course(3, which), self.course(17, which)
        for first, second in zip(small, large, strict=True):
            np.testing.assert_array_equal(first, second)

    def test_two_seeds_never_give_the_same_users(self):
        users = []
        for seed in range(20):
            world = WorldBatch(worlds=4, seed=seed)
            world.reset()
            users += [world.snapshot(index)["users_m"].tobytes() for index in range(4)]
        assert len(set(users)) == len(users)

    def test_two_episodes_differ(self):
        world = WorldBatch(seed=0)
        world.reset()
        first = world.snapshot()["users_m"]
        world.reset()
        assert not np.array_equal(first, world.snapshot()["users_m"])

    def test_world_zero_takes_the_seed_itself_and_none_depends_on_their_number(self):
        assert world_seeds(5, 1) == [5]
        assert world_seeds(5, 8)[:3] == world_seeds(5, 3)
        assert not set(world_seeds(5, 100)) & set(world_seeds(6, 100))

    def test_held_out_topologies_are_none_of_the_training_worlds(self):
        assert evaluation_seeds(5, 10)[:4] == evaluation_seeds(5, 4)
        training = {seed for first in range(50) for seed in world_seeds(first, 100)}
        assert not training & {seed for first in range(50) for seed in evaluation_seeds(first, 100)}

    def test_seeds_must_be_as_many_as_worlds(self):
        with pytest.raises(ValueError, match="2 seeds for 3 worlds"):
            WorldBatch(worlds=3, seed=[1, 2])


class TestUsers:
    def test_the_callers_positions_are_kept(self):
        positions = np.random.default_rng(0).uniform(0, 2000, (30, 2))
        world = WorldBatch(seed=0, user_positions_m=positions)
        world.reset()
        np.testing.assert_array_equal(world.snapshot()["users_m"], positions)
        assert world.user_count == 30

    @pytest.mark.parametrize(
        ("positions", "message"),
        [
            ([[1.0, 2.0]] * 6, "6 user positions for 6 UAVs and 1 masts: at least 7"),
            ([[1.0, float("nan")]] * 9, r"user 0 is at \(1, nan\)"),
            ([[1.0, 2.0]] * 8 + [[1.0, 2001.0]], r"user 8 is at \(1, 2001\)"),
            ([1.0, 2.0], r"shape \(2,\)"),
        ],
    )
    def test_bad_positions_are_told(self, positions, message):
        with pytest.raises(ValueError, match=message):
            WorldBatch(user_positions_m=positions)

    def test_static_users_stay_and_moving_users_keep_to_the_area(self):
        for speed_mps, hold_s in ((0.0, 1.0), (15.0, 1.0), (15.0, 20.0)):
            parameters = Parameters().with_overrides(
                {"user_speed_mps": speed_mps, "heading_hold_s": hold_s, "area_m": 300.0}
            )
            world = WorldBatch(parameters, seed=0)
            world.reset()
            start = world.snapshot()["users_m"]
            for _ in range(100):
                before = world.snapshot()["users_m"]
                world.step(np.zeros((1, 6, 4)))
                after = world.snapshot()["users_m"]
                assert (after >= 0).all() and (after <= 300).all()
                assert np.linalg.norm(after - before, axis=1).max() <= speed_mps + 1e-9
            assert np.array_equal(start, after) == (speed_mps == 0.0)

    @pytest.mark.parametrize(("hold_s", "expected_m"), [(1.0, 119.0), (20.0, 490.0)])
    def test_how_far_users_stray_in_an_episode(self, hold_s, expected_m):
        # Root mean square of a walk of n legs, each of uniform speed and heading: an area without
        # borders in reach, and all users far from them.
        parameters = Parameters().with_overrides(
            {"user_speed_mps": 15.0, "heading_hold_s": hold_s, "area_m": 1e5, "uav_count": 1}
        )
        middle = np.full((4000, 2), 5e4) + np.random.default_rng(0).normal(0, 1, (4000, 2))
        world = WorldBatch(parameters, seed=0, user_positions_m=middle)
        world.reset()
        for _ in range(200):
            world.step(np.zeros((1, 1, 4)))
        stray_m = np.linalg.norm(world.snapshot()["users_m"] - middle, axis=1)
        legs, leg_m = 200 / hold_s, 15.0 * hold_s
        assert np.sqrt((stray_m**2).mean()) == pytest.approx(leg_m * np.sqrt(legs / 3), rel=0.05)
        assert np.sqrt((stray_m**2).mean()) == pytest.approx(expected_m, rel=0.15)

    def test_headings_are_held(self):
        parameters = Parameters().with_overrides({"user_speed_mps": 5.0, "heading_hold_s": 3.0})
        world = WorldBatch(parameters, seed=0)
        world.reset()
        velocities = []
        for _ in range(6):
            world.step(np.zeros((1, 6, 4)))
            velocities.append(np.abs(world.arrays.user_velocities_mps[0]))
        for first, second, same in ((0, 1, True), (1, 2, True), (2, 3, False), (3, 5, True)):
            assert np.array_equal(velocities[first], velocities[second]) == same


class TestOutOfTheOrdinary:
    def assert_finite(self, world: WorldBatch, actions: np.ndarray) -> None:
        world.reset()
        for _ in range(5):
            world.step(actions)
            for name, array in world.arrays._asdict().items():
                assert np.isfinite(array).all(), name
            assert np.isfinite(world.gbs_rates_bps()).all()

    def test_all_users_in_one_place(self):
        world = WorldBatch(seed=0, user_positions_m=np.full((20, 2), 500.0))
        self.assert_finite(world, np.zeros((1, 6, 4)))
        metrics = world.slot_metrics(0)
        if not world.snapshot()["target_users"].any():
            assert metrics["coverage"] == 1.0
            assert metrics["rate_jfi"] == metrics["load_jfi"] == metrics["worst_rate_bps"] == 0.0

    def test_nobody_to_serve_is_covered_but_never_fair(self):
        world = WorldBatch(seed=0)
        world.reset()
        world.arrays.target_users[:] = False
        world.step(np.zeros((1, 6, 4)))
        metrics = world.slot_metrics(0)
        assert metrics["coverage"] == 1.0
        assert metrics["rate_jfi"] == metrics["load_jfi"] == metrics["sum_rate_bps"] == 0.0

    def test_uavs_at_one_point_above_a_user(self):
        world = WorldBatch(seed=0)
        world.reset()
        world.arrays.positions_m[0, :, :2] = world.snapshot()["users_m"][0]
        world.step(np.zeros((1, 6, 4)))
        assert world.slot_metrics(0)["collisions"] == 15
        assert world.slot_metrics(0)["load_jfi"] == pytest.approx(1 / 6)
        assert all(np.isfinite(array).all() for array in world.arrays)

    def test_a_uav_at_the_antenna_of_the_gbs(self):
        parameters = Parameters().with_overrides(
            {"min_altitude_m": 30.0, "initial_altitude_m": 30.0}
        )
        world = WorldBatch(parameters, seed=0)
        world.reset()
        world.arrays.positions_m[0, 0] = parameters.gbs_positions_m[0]
        world.step(np.zeros((1, 6, 4)))
        assert all(np.isfinite(array).all() for array in world.arrays)

    def test_one_uav_that_serves_anyone_is_balanced(self):
        world = WorldBatch(Parameters().with_overrides({"uav_count": 1}), seed=0)
        world.reset()
        world.step(np.zeros((1, 1, 4)))
        assert world.slot_metrics(0)["load_jfi"] == 1.0
        assert world.slot_metrics(0)["collisions"] == 0

    def test_limits_without_extent(self):
        parameters = Parameters().with_overrides(
            {
                "min_altitude_m": 100.0,
                "max_altitude_m": 100.0,
                "min_transmit_power_w": 0.15,
                "max_transmit_power_w": 0.15,
            }
        )
        self.assert_finite(WorldBatch(parameters, seed=0), np.ones((1, 6, 4)))

    def test_pressing_against_a_wall_is_no_flight(self):
        world = WorldBatch(seed=0)
        world.reset()
        push = np.zeros((1, 6, 4))
        push[..., 0] = 1.0
        for _ in range(140):
            world.step(push)
        assert (world.arrays.positions_m[0, :, 0] == 2000.0).all()
        assert world.slot_metrics(0)["boundary_violations"] == 6
        assert world.slot_metrics(0)["propulsion_power_w"] == pytest.approx(6 * 394.006)

    def test_no_step_before_a_reset_or_beyond_the_end(self):
        world = WorldBatch(Parameters().with_overrides({"episode_slots": 3}), seed=0)
        with pytest.raises(RuntimeError, match="reset"):
            world.step(np.zeros((1, 6, 4)))
        world.reset()
        for _ in range(3):
            world.step(np.zeros((1, 6, 4)))
        with pytest.raises(RuntimeError, match="reset"):
            world.step(np.zeros((1, 6, 4)))

    @pytest.mark.parametrize(
        ("actions", "message"),
        [
            (np.zeros((1, 5, 4)), "shape"),
            (np.full((1, 6, 4), np.nan), "finite"),
            (np.full((1, 6, 4), np.inf), "finite"),
        ],
    )
    def test_bad_actions_are_refused_and_change_nothing(self, actions, message):
        world = WorldBatch(seed=0)
        world.reset()
        before = [array.copy() for array in world.arrays]
        with pytest.raises(ValueError, match=message):
            world.step(actions)
        for array, kept in zip(world.arrays, before, strict=True):
            np.testing.assert_array_equal(array, kept)


class TestSnapshot:
    def test_is_valid_at_slot_zero_and_a_copy(self):
        world = WorldBatch(seed=0)
        world.reset()
        snapshot = world.snapshot()
        assert snapshot["slot"] == 0
        assert snapshot["users_m"].shape == (100, 2)
        assert snapshot["gbs_position_m"].tolist() == [1000.0, 1000.0, 30.0]
        assert snapshot["gbs_positions_m"].tolist() == [[1000.0, 1000.0, 30.0]]
        assert (snapshot["association"][~snapshot["target_users"]] == -1).all()
        snapshot["uav_positions_m"][:] = 0.0
        assert (world.arrays.positions_m > 0).all()

    def test_gbs_users_get_the_gbs_rate(self):
        world = WorldBatch(seed=0)
        world.reset()
        snapshot = world.snapshot()
        served = snapshot["association"] >= 0
        gbs_users = ~snapshot["target_users"]
        assert not (served & gbs_users).any()
        assert (snapshot["rates_bps"][gbs_users] > 0).any()
        assert (snapshot["rates_bps"][served] > 0).all()

    def test_about_45_percent_of_the_gbs_users_reach_6_db(self):
        world = WorldBatch(worlds=200, seed=0)
        world.reset()
        users = ~world.arrays.target_users
        assert (world.gbs_rates_bps() > 0).sum() / users.sum() == pytest.approx(0.45, abs=0.05)


def test_every_parameter_of_the_network_acts():
    """Changing any parameter changes some number, so none is read from a default by mistake."""
    shown_elsewhere = {
        "network.episode_slots",  # the time limit: see the environments' tests
        "uav.observation",  # what is seen, not what happens: see the tests of observations
        "rotor.mass_kg",  # acts with climb_power: below
    }
    others = {  # where 1.3 times the value would be invalid, or too little to matter
        "network.hotspot_count": 3,
        "uav.min_separation_m": 250.0,
        "reward.power_epsilon_w": 1.0,
        "rotor.climb_power": True,
        "network.distribution": "uniform",
        "network.total_bandwidth_hz": 3e7,
        "uav.displacement_scale_m": (9.0, 9.0, 3.0),
        "uav.initial_transmit_power_w": 0.12,
        "uav.initial_altitude_m": 95.0,
        "deployment.init": "random",
        "deployment.n_init": 7,
        "reward.objective": "pf",
        "network.shares": "se",
        "network.user_count": 90,
        "network.uav_count": 5,
        "network.sensing_error_std_m": 80.0,
        "network.heading_hold_s": 4.0,
        "network.user_speed_mps": 4.0,
        "uav.max_altitude_m": 103.0,
        "uav.min_altitude_m": 96.0,
        "uav.max_transmit_power_w": 0.16,
        "uav.min_transmit_power_w": 0.145,
        "channel.required_snr_db": 45.0,
        "channel.backhaul_required_snr_db": 48.0,
        "network.failures": ["0@5"],
        "uav.flight": "station",
        "gbs.positions_m": [[100.0, 50.0]],
    }
    crowded = {"network.area_m": 2000.0, "network.sensing_error_std_m": 300.0}
    base = {
        "network.user_speed_mps": 2.0,
        "network.area_m": 300.0,
        "uav.min_separation_m": 60.0,
        "channel.backhaul_required_snr_db": 45.0,
        "channel.required_snr_db": 20.0,
    }

    def scaled(value: float | tuple[float, ...]) -> object:
        return tuple(x * 1.3 for x in value) if isinstance(value, tuple) else value * 1.3

    def fly(overrides: dict) -> bytes:
        world = WorldBatch(Parameters().with_overrides({**base, **overrides}), seed=1)
        world.set_progress(0.5)
        world.reset()
        generator = np.random.default_rng(0)
        for _ in range(20):
            world.step(generator.uniform(-1, 1, (1, world.uav_count, 4)))
        arrays = world.arrays._asdict()
        return b"".join(array.tobytes() for array in arrays.values()) + (
            world.gbs_rates_bps().tobytes()
        )

    reference = fly({})
    log_rates = fly({"reward.objective": "pf"})
    stations = {"uav.flight": "station", "network.area_m": 600.0}
    on_stations, balanced = fly(stations), fly({"deployment.init": "balanced", **crowded})
    for key, field in fields_by_key(Parameters).items():
        if key == "reward.log_rate_floor_bps":
            assert fly({"reward.objective": "pf", key: 2e4}) != log_rates, key
        elif key.startswith("uav.station."):
            new = 119.0 if key.endswith("altitude_m") else 0.9 * field.default
            assert fly({**stations, key: new}) != on_stations, key
        elif key.startswith("deployment.balanced_"):
            new = 0 if key.endswith("restarts") else "exact"
            assert fly({"deployment.init": "balanced", **crowded, key: new}) != balanced, key
        elif key not in shown_elsewhere:
            old = base.get(key, field.default)
            assert fly({key: others.get(key) or scaled(old) or 3.0}) != reference, key
    climbing = fly({"rotor.climb_power": True})
    assert fly({"rotor.climb_power": True, "rotor.mass_kg": 9.0}) != climbing
