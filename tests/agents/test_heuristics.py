"""Topologies that methods begin on, the rules that fly them, and learned policies as methods."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

import tests.helpers.independent_network as independent
from orchid_uav.agents import LocalActor
from orchid_uav.agents.controllers.controller import Controller, act_towards
from orchid_uav.agents.controllers.heuristics import (
    BalancedLoiter,
    Hover,
    Loiter,
    Track,
    bank_angle_deg,
)
from orchid_uav.agents.controllers.learned import ExplorationNoise, Learned, ZeroAction
from orchid_uav.envs import Parameters, WorldBatch, evaluation_seeds, kinematics
from orchid_uav.envs.deployment import kmeans_centroids
from orchid_uav.envs.metrics import (
    BOUNDARY_VIOLATIONS,
    COLLISIONS,
    ENERGY_EFFICIENCY,
    LOAD_JFI,
    RATE_JFI,
)
from orchid_uav.envs.propulsion import circling_speed_mps
from orchid_uav.envs.starts.topologies import Topologies

WALKING = {"network.user_speed_mps": 15.0, "network.heading_hold_s": 20.0}
CIRCLE_SLOTS = 20


def drawn(
    worlds: int = 1, overrides: dict | None = None, seed: int = 0, users_m: object = None
) -> WorldBatch:
    """Worlds at the start of an episode, on held-out topologies."""
    parameters = Parameters().with_overrides(overrides or {})
    world = WorldBatch(parameters, worlds, evaluation_seeds(seed, worlds), users_m)
    world.set_progress(1.0)
    world.reset()
    return world


def fly(method: Controller, world: WorldBatch, slots: int) -> None:
    method.begin(world)
    for _ in range(slots):
        world.step(method.act(world))


def contents(world: WorldBatch) -> list[np.ndarray]:
    return [*(array.copy() for array in world.arrays), world.gbs_rates_bps()]


def assert_same(first: list[np.ndarray], second: list[np.ndarray]) -> None:
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


class TestTopologies:
    def draw(self, overrides: dict, **options: object) -> Topologies:
        parameters = Parameters().with_overrides(overrides)
        return WorldBatch(parameters, worlds=4, seed=21, **options).draw_topologies()

    @pytest.mark.parametrize("sensing_error_std_m", [0.0, 150.0])
    @pytest.mark.parametrize(
        "overrides",
        [
            {"deployment.init": "random"},
            {"deployment.init": "random", "min_separation_m": 400.0},
            {"objective": "pf", "shares": "se"},
        ],
        ids=["random start", "random start that takes many tries", "reward and shares"],
    )
    def test_do_not_depend_on_the_start_or_the_reward(self, overrides, sensing_error_std_m):
        sensing = {"sensing_error_std_m": sensing_error_std_m}
        first, second = self.draw(sensing), self.draw(sensing | overrides)
        for name in ("users_m", "target_users", "shadowing_db", "walk_keys"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name), name)
        starts_differ = not np.array_equal(first.start_m, second.start_m)
        assert starts_differ == ("deployment.init" in overrides)

    @pytest.mark.parametrize("init", ["kmeans", "random"])
    def test_with_a_sensing_error_differ_in_start_and_targets_alone(self, init):
        exact = self.draw({"deployment.init": init})
        blurred = self.draw({"deployment.init": init, "sensing_error_std_m": 150.0})
        for name in ("users_m", "shadowing_db", "walk_keys"):
            np.testing.assert_array_equal(getattr(exact, name), getattr(blurred, name), name)
        assert (exact.target_users != blurred.target_users).any()
        assert np.array_equal(exact.start_m, blurred.start_m) == (init == "random")

    def test_with_the_callers_users_draw_the_rest_all_the_same(self):
        users_m = np.random.default_rng(0).uniform(0, 2000, (30, 2))
        first = self.draw({}, user_positions_m=users_m)
        second = self.draw({"deployment.init": "random"}, user_positions_m=users_m)
        np.testing.assert_array_equal(first.users_m, np.broadcast_to(users_m, (4, 30, 2)))
        np.testing.assert_array_equal(first.target_users, second.target_users)
        np.testing.assert_array_equal(first.walk_keys, second.walk_keys)
        assert len(set(first.walk_keys.tolist())) == 4

    def test_successive_ones_differ_in_everything(self):
        world = WorldBatch(worlds=2, seed=0)
        for one, other in zip(world.draw_topologies(), world.draw_topologies(), strict=True):
            assert (one != other).any(axis=tuple(range(1, one.ndim))).all()

    @pytest.mark.parametrize("overrides", [WALKING, {"deployment.init": "random"}])
    def test_begun_are_what_a_reset_begins(self, overrides):
        parameters = Parameters().with_overrides(overrides)
        by_reset, by_hand = (WorldBatch(parameters, worlds=3, seed=5) for _ in range(2))
        generator = np.random.default_rng(0)
        for _ in range(2):  # the second episode begins in worlds that have been used
            by_reset.reset()
            by_hand.use_topology(by_hand.draw_topologies())
            assert_same(contents(by_reset), contents(by_hand))
            for _ in range(10):
                actions = generator.uniform(-1, 1, (3, 6, 4))
                by_reset.step(actions)
                by_hand.step(actions)
                assert_same(contents(by_reset), contents(by_hand))

    def test_begun_are_all_that_counts_in_worlds_that_have_been_used(self):
        topologies = WorldBatch(worlds=2, seed=9).draw_topologies()
        used, fresh = WorldBatch(worlds=2, seed=1), WorldBatch(worlds=2, seed=2)
        used.reset()
        for _ in range(8):
            used.step(np.ones((2, 6, 4)))
        for world in (used, fresh):
            world.use_topology(topologies)
        assert_same(contents(used), contents(fresh))
        arrays = used.arrays
        np.testing.assert_array_equal(
            arrays.user_coordinates_m, topologies.users_m.transpose(0, 2, 1)
        )
        np.testing.assert_array_equal(arrays.positions_m[..., :2], topologies.start_m)
        assert (arrays.positions_m[..., 2] == 100.0).all()
        np.testing.assert_allclose(arrays.transmit_powers_w, 0.15)
        assert (arrays.velocities_mps == 0.0).all()

    def test_begun_shadow_the_links_of_the_gbs_as_drawn(self):
        world = WorldBatch(worlds=2, seed=9)
        topologies = world.draw_topologies()
        world.use_topology(topologies)
        users_m = topologies.users_m - 1000.0
        distances_m = np.sqrt((users_m**2).sum(axis=-1) + 30.0**2)
        reference_db = 20.0 * math.log10(4.0 * math.pi * 2.4e9 / 299_792_458.0)
        loss_db = reference_db + 35.0 * np.log10(distances_m) + topologies.shadowing_db[:, 0]
        snr = 10.0 ** (-loss_db / 10.0) / (10.0 ** (-17.4 - 3.0) * 10e6)  # 1 W, 10 MHz
        served = ~topologies.target_users & (snr >= 10.0**0.6)
        rates_bps = 10e6 * np.log2(1.0 + snr) / served.sum(axis=1, keepdims=True)
        np.testing.assert_allclose(world.gbs_rates_bps(), np.where(served, rates_bps, 0.0))
        assert 5.0 < topologies.shadowing_db.std() < 11.0

    def test_of_some_worlds_begin_there_alone(self):
        by_reset, by_hand = (WorldBatch(worlds=4, seed=5) for _ in range(2))
        for world in (by_reset, by_hand):
            world.reset()
            world.step(np.full((4, 6, 4), 0.5))
        by_reset.reset([3, 1])
        by_hand.use_topology(by_hand.draw_topologies([3, 1]), [3, 1])
        assert_same(contents(by_reset), contents(by_hand))
        assert by_hand.arrays.slot.tolist() == [1, 0, 1, 0]

    def test_chosen_begin_in_another_batch_as_they_do_in_their_own(self):
        world = WorldBatch(Parameters().with_overrides(WALKING), worlds=5, seed=5)
        topologies = world.draw_topologies()
        world.use_topology(topologies)
        part = WorldBatch(world.parameters, worlds=2, seed=77)
        part.use_topology(topologies.chosen(slice(2, 4)))
        for _ in range(5):
            world.step(np.full((5, 6, 4), 0.3))
            part.step(np.full((2, 6, 4), 0.3))
        assert_same([array[2:4] for array in contents(world)], contents(part))


class TestPlacing:
    @pytest.mark.parametrize("overrides", [{}, WALKING])
    def test_where_the_uavs_are_changes_nothing(self, overrides):
        placed, untouched = drawn(3, overrides), drawn(3, overrides)
        arrays = placed.arrays
        placed.place(arrays.positions_m, arrays.transmit_powers_w, arrays.target_users)
        placed.place(arrays.positions_m.tolist())
        assert_same(contents(placed), contents(untouched))
        for world in (placed, untouched):
            for _ in range(5):
                world.step(np.full((3, 6, 4), 0.3))
        assert_same(contents(placed), contents(untouched))

    def test_elsewhere_serves_from_there(self):
        world = drawn(2)
        positions_m = np.random.default_rng(0).uniform((0, 0, 80), (2000, 2000, 120), (2, 6, 3))
        powers_w = np.random.default_rng(1).uniform(0.1, 0.2, (2, 6))
        targets = np.random.default_rng(2).random((2, 100)) < 0.5
        world.place(positions_m, powers_w, targets)
        for index in range(2):
            snapshot = world.snapshot(index)
            expected = independent.associate(
                independent.Setting(),
                positions_m[index].tolist(),
                powers_w[index].tolist(),
                snapshot["users_m"].tolist(),
                targets[index].tolist(),
            )
            np.testing.assert_array_equal(snapshot["association"], expected)
        world.step(np.zeros((2, 6, 4)))
        np.testing.assert_array_equal(world.arrays.positions_m, positions_m)
        np.testing.assert_array_equal(world.arrays.transmit_powers_w, powers_w)
        np.testing.assert_array_equal(world.arrays.target_users, targets)

    def test_on_the_borders_is_allowed(self):
        world = drawn()
        for corner in itertools.product((0.0, 2000.0), (0.0, 2000.0), (80.0, 120.0)):
            for power_w in (0.1, 0.2):
                world.place(np.broadcast_to(corner, (1, 6, 3)), np.full((1, 6), power_w))
        assert world.arrays.slot.tolist() == [0]

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"positions_m": np.zeros((1, 6, 2))}, r"positions_m has shape \(1, 6, 2\)"),
            ({"positions_m": np.full((6, 3), 100.0)}, r"positions_m has shape \(6, 3\)"),
            ({"positions_m": np.full((1, 6, 3), 79.9)}, "positions_m is not everywhere within"),
            ({"positions_m": np.full((1, 6, 3), 120.1)}, "positions_m is not everywhere within"),
            ({"positions_m": np.full((1, 6, 3), np.nan)}, "positions_m is not everywhere within"),
            ({"transmit_powers_w": np.full(6, 0.15)}, r"transmit_powers_w has shape \(6,\)"),
            ({"transmit_powers_w": np.full((1, 6), 0.099)}, "transmit_powers_w is not everywhere"),
            ({"transmit_powers_w": np.full((1, 6), 0.201)}, "transmit_powers_w is not everywhere"),
            ({"transmit_powers_w": np.full((1, 6), np.nan)}, "transmit_powers_w is not everywhere"),
            ({"target_users": np.ones((1, 99))}, "shape"),
            ({"target_users": np.ones((2, 100))}, "shape"),
        ],
    )
    def test_where_no_uav_may_be_is_refused(self, change, message):
        world = drawn()
        before = contents(world)
        good = {"positions_m": np.full((1, 6, 3), 100.0)}
        with pytest.raises(ValueError, match=message):
            world.place(**good | change)
        assert_same(contents(world), before)

    def test_what_is_refused_leaves_the_powers_alone(self):
        world = drawn()
        before = contents(world)
        with pytest.raises(ValueError, match="shape"):
            world.place(
                world.arrays.positions_m, np.full((1, 6), 0.2), target_users=np.ones((1, 99))
            )
        assert_same(contents(world), before)

    def test_a_border_of_another_flight_box(self):
        world = drawn(overrides={"area_m": 500.0, "min_altitude_m": 100.0, "max_altitude_m": 100.0})
        with pytest.raises(ValueError, match="positions_m"):
            world.place(np.broadcast_to((501.0, 100.0, 100.0), (1, 6, 3)))
        with pytest.raises(ValueError, match="positions_m"):
            world.place(np.broadcast_to((499.0, 100.0, 100.1), (1, 6, 3)))

    def test_only_before_the_first_slot(self):
        world = WorldBatch(worlds=2, seed=0)
        positions_m = np.full((2, 6, 3), 100.0)
        with pytest.raises(RuntimeError, match="reset"):
            world.place(positions_m)
        world.reset()
        world.place(positions_m)
        world.step(np.zeros((2, 6, 4)))
        with pytest.raises(RuntimeError, match="reset"):
            world.place(positions_m)
        world.reset([0])  # the other one flies on
        with pytest.raises(RuntimeError, match="reset"):
            world.place(positions_m)


class TestActTowards:
    def test_by_hand(self):
        world = drawn(overrides={"uav_count": 1})
        actions = act_towards(world, np.array([[[7.5, -3.0, 1.0]]]), power_change=0.5)
        np.testing.assert_allclose(actions, [[[0.5, -0.2, 0.2, 0.5]]])
        np.testing.assert_allclose(
            act_towards(world, np.array([[[7.5, -3.0]]])), [[[0.5, -0.2, 0.0, 0.0]]]
        )

    def test_an_axis_along_which_nobody_moves_gets_no_action(self):
        world = drawn(overrides={"uav_count": 1, "displacement_scale_m": (0.0, 10.0, 0.0)})
        actions = act_towards(world, np.array([[[7.5, -3.0, 1.0]]]))
        np.testing.assert_allclose(actions, [[[0.0, -0.3, 0.0, 0.0]]])


class TestHover:
    @pytest.mark.parametrize("overrides", [{}, WALKING])
    def test_is_the_zero_action_to_the_last_bit(self, overrides):
        hovering, still = drawn(3, overrides), drawn(3, overrides)
        fly(Hover(), hovering, 10)
        fly(ZeroAction(), still, 10)
        assert_same(contents(hovering), contents(still))
        bare = drawn(3, overrides)
        for _ in range(10):
            bare.step(np.zeros((3, 6, 4)))
        assert_same(contents(hovering), contents(bare))

    def test_full_power_is_full_power_from_the_start_and_nothing_else(self):
        usual, strong = drawn(2), drawn(2)
        method = Hover(full_power=True)
        method.begin(strong)
        assert (strong.arrays.transmit_powers_w == 0.2).all()
        np.testing.assert_allclose(usual.arrays.transmit_powers_w, 0.15)
        fly(Hover(), usual, 3)
        for _ in range(3):
            strong.step(method.act(strong))
        assert (strong.arrays.transmit_powers_w == 0.2).all()
        np.testing.assert_array_equal(usual.arrays.positions_m, strong.arrays.positions_m)
        assert (strong.arrays.metrics[:, RATE_JFI] > 0).all()
        sums = [world.slot_metrics(0)["sum_rate_bps"] for world in (usual, strong)]
        assert sums[0] < sums[1]


class TestLoiter:
    def test_keeps_the_radius_and_the_speed_of_least_power(self):
        world = drawn(20)
        method = Loiter()
        fly(method, world, CIRCLE_SLOTS)
        for _ in range(40):
            world.step(method.act(world))
            relative_m = world.arrays.positions_m[..., :2] - method.centres_m
            distances_m = np.hypot(relative_m[..., 0], relative_m[..., 1])
            np.testing.assert_allclose(distances_m, 40.0, rtol=0, atol=1e-6)
            speeds_mps = np.linalg.norm(world.arrays.velocities_mps, axis=-1)
            np.testing.assert_allclose(speeds_mps, method.speed_mps, rtol=0, atol=1e-9)
        assert (world.arrays.positions_m[..., 2] == 100.0).all()
        assert (world.arrays.transmit_powers_w == 0.2).all()

    def test_the_speed_is_the_papers_least_power_speed(self):
        setting = independent.Setting()
        found = minimize_scalar(
            lambda speed: independent.level_propulsion_power_w(setting, speed),
            bracket=(10.0, 14.0, 18.0),
            tol=1e-10,
        )
        speed_mps = circling_speed_mps(drawn().parameters)
        assert speed_mps == pytest.approx(found.x, abs=1e-3)
        assert speed_mps == pytest.approx(14.25, abs=0.05)
        power_w = independent.level_propulsion_power_w(setting, speed_mps)
        assert power_w == pytest.approx(found.fun, rel=1e-12)

    def test_banks_by_27_degrees(self):
        assert bank_angle_deg(14.25, 40.0) == pytest.approx(27.4, abs=0.05)
        by_hand = math.degrees(math.atan(14.25**2 / (9.80665 * 40.0)))
        assert bank_angle_deg(14.25, 40.0) == pytest.approx(by_hand)

    def test_is_about_twice_as_efficient_as_hovering_and_adds_no_collisions(self):
        hovering, circling = drawn(100), drawn(100)
        fly(Hover(full_power=True), hovering, 60)
        fly(Loiter(), circling, 60)
        ratios = [
            circling.arrays.metrics[:, ENERGY_EFFICIENCY].mean()
            / hovering.arrays.metrics[:, ENERGY_EFFICIENCY].mean()
        ]
        # Power falls from 394.0 + 0.2 to 198.5 + 0.2 W; rates hardly change.
        assert ratios[0] == pytest.approx(394.2 / 198.7, rel=0.03)
        for world in (hovering, circling):
            assert world.arrays.episode_sums[:, 1 + COLLISIONS].sum() == 0
            assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0

    def test_never_leaves_the_flight_box_even_from_its_corners(self):
        world = drawn(4)
        corners = list(itertools.product((0.0, 2000.0), repeat=2))
        edges = [(0.0, 700.0), (2000.0, 1300.0), (1000.0, 0.0), (600.0, 2000.0), (2000.0, 1960.0)]
        starts_m = np.array([*corners, *edges, *np.full((15, 2), 39.0)]).reshape(4, 6, 2)
        altitudes_m = np.full((4, 6, 1), 100.0)
        world.place(np.concatenate([starts_m, altitudes_m], axis=-1))
        method = Loiter()
        fly(method, world, 100)
        assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0
        distances_m = np.linalg.norm(world.arrays.positions_m[..., :2] - method.centres_m, axis=-1)
        np.testing.assert_allclose(distances_m, 40.0, atol=1e-6)
        assert method.centres_m.min() == 40.0 and method.centres_m.max() == 1960.0

    @pytest.mark.parametrize(
        ("scale_m", "speed_mps"),
        [((5.0, 15.0, 5.0), 5.0), ((15.0, 3.0, 5.0), 3.0), ((15.0, 15.0, 0.0), None)],
    )
    def test_flies_no_faster_than_the_slowest_axis_lets_it(self, scale_m, speed_mps):
        world = drawn(2, {"displacement_scale_m": scale_m})
        method = Loiter()
        fly(method, world, 40)
        assert method.speed_mps == pytest.approx(
            speed_mps or circling_speed_mps(drawn().parameters)
        )
        relative_m = world.arrays.positions_m[..., :2] - method.centres_m
        np.testing.assert_allclose(np.linalg.norm(relative_m, axis=-1), 40.0, atol=1e-6)
        speeds_mps = np.linalg.norm(world.arrays.velocities_mps, axis=-1)
        np.testing.assert_allclose(speeds_mps, method.speed_mps, atol=1e-9)

    @pytest.mark.parametrize("scale_m", [(0.0, 15.0, 5.0), (15.0, 0.0, 5.0), (0.0, 0.0, 0.0)])
    def test_hovers_where_an_axis_does_not_move(self, scale_m):
        world = drawn(2, {"displacement_scale_m": scale_m})
        starts_m = world.arrays.positions_m.copy()
        fly(Loiter(), world, 10)
        np.testing.assert_array_equal(world.arrays.positions_m, starts_m)
        assert (world.arrays.transmit_powers_w == 0.2).all()

    def test_hovers_on_the_circle_where_an_axis_does_not_move(self):
        world = drawn(1, {"displacement_scale_m": (0.0, 15.0, 5.0)})
        world.place(np.broadcast_to((2000.0, 500.0, 100.0), (1, 6, 3)))
        fly(Loiter(), world, 2)
        assert (world.arrays.positions_m[..., :2] == (2000.0, 500.0)).all()

    def test_half_second_slots_are_half_as_long(self):
        world = drawn(2, {"slot_s": 0.5})
        method = Loiter()
        fly(method, world, 50)
        speeds_mps = np.linalg.norm(world.arrays.velocities_mps, axis=-1)
        np.testing.assert_allclose(speeds_mps, circling_speed_mps(drawn().parameters), atol=1e-6)

    @pytest.mark.parametrize("radius_m", [0.0, -1.0, float("nan")])
    def test_refuses_what_is_no_radius(self, radius_m):
        with pytest.raises(ValueError, match="radius_m"):
            Loiter(radius_m)

    @pytest.mark.parametrize("area_m", [80.0, 100.0])
    def test_a_circle_that_just_fits_stays_inside(self, area_m):
        world = drawn(3, {"area_m": area_m, "uav_count": 2})
        fly(Loiter(), world, 60)
        assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0

    def test_stays_inside_an_area_narrower_than_its_circle(self):
        world = drawn(3, {"area_m": 60.0, "uav_count": 2})
        fly(Loiter(), world, 60)
        assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0


def circling_displacement_m(relative_m, radius_m, step_m):
    """The move as one array (..., 2)."""
    moves_m = kinematics.circling_displacement_m(
        relative_m[..., 0], relative_m[..., 1], radius_m, *kinematics.chord(radius_m, step_m)
    )
    return np.stack(moves_m, axis=-1)


class TestCircling:
    @settings(max_examples=100, deadline=None)
    @given(
        st.floats(-200.0, 200.0),
        st.floats(-200.0, 200.0),
        st.floats(2.0, 100.0),
        st.floats(2.0, 30.0),
    )
    def test_comes_to_the_circle_from_anywhere_in_steps_no_longer_than_allowed(
        self, x_m, y_m, radius_m, step_m
    ):
        position_m = np.array([x_m, y_m])
        chord_m = min(step_m, 2.0 * radius_m)
        for _ in range(math.ceil((300.0 + 8.0 * radius_m) / chord_m) + 5):
            move_m = circling_displacement_m(position_m, radius_m, step_m)
            assert np.linalg.norm(move_m) <= chord_m * (1 + 1e-9)
            position_m = position_m + move_m
        assert np.linalg.norm(position_m) == pytest.approx(radius_m, rel=1e-9)
        move_m = circling_displacement_m(position_m, radius_m, step_m)
        assert np.linalg.norm(move_m) == pytest.approx(chord_m, rel=1e-9)

    def test_by_hand(self):
        # Four chords of a square; from the centre, a step towards the corner at 90 degrees.
        radius_m, side_m = 10.0, 10.0 * math.sqrt(2.0)
        corners_m = np.array([[10.0, 0.0], [0.0, 10.0], [-10.0, 0.0], [0.0, -10.0]])
        moves_m = circling_displacement_m(corners_m, radius_m, side_m)
        np.testing.assert_allclose(corners_m + moves_m, np.roll(corners_m, -1, axis=0), atol=1e-12)
        assert circling_displacement_m(np.zeros(2), radius_m, side_m) == pytest.approx([0.0, 10.0])
        far_m = circling_displacement_m(np.array([1000.0, 0.0]), 10.0, 5.0)
        assert far_m == pytest.approx([-5.0, 0.0], abs=0.1)


class TestBalancedLoiter:
    def balance(self, world: WorldBatch) -> np.ndarray:
        return world.arrays.metrics[:, LOAD_JFI] + world.arrays.metrics[:, RATE_JFI]

    @pytest.mark.parametrize("keeps_targets", [True, False])
    @pytest.mark.parametrize(
        "overrides",
        [{}, {"uav_count": 3, "user_count": 12}, {"distribution": "uniform", "shares": "pf"}],
    )
    def test_begins_no_less_balanced_than_phase_i(self, overrides, keeps_targets):
        world = drawn(8, overrides)
        own, targets = self.balance(world), world.arrays.target_users.copy()
        BalancedLoiter(restarts=10, keeps_targets=keeps_targets).begin(world)
        assert (self.balance(world) >= own).all()
        assert (self.balance(world) > own).any()
        assert np.array_equal(world.arrays.target_users, targets) == keeps_targets

    def test_begins_at_centroids_of_the_target_users(self):
        world = drawn(6)
        own_m = world.arrays.positions_m.copy()
        BalancedLoiter().begin(world)
        moved = (world.arrays.positions_m != own_m).any(axis=(1, 2))
        assert moved.any()
        for index in np.flatnonzero(moved):
            targets = world.arrays.target_users[index]
            users_m = world.users_m[index][targets]
            centres_m = world.arrays.positions_m[index, :, :2]
            nearest = np.linalg.norm(users_m[:, None] - centres_m, axis=-1).argmin(axis=1)
            for uav in range(6):
                mean_m = users_m[nearest == uav].mean(axis=0)
                np.testing.assert_allclose(centres_m[uav], mean_m, atol=1e-6)
        assert (world.arrays.positions_m[..., 2] == 100.0).all()

    def test_retargeted_leaves_the_gbs_the_cluster_nearest_to_it(self):
        world = drawn(6)
        targets = world.arrays.target_users.copy()
        BalancedLoiter(keeps_targets=False).begin(world)
        changed = (world.arrays.target_users != targets).any(axis=1)
        assert changed.any()
        for index in range(6):
            users_m = world.users_m[index]
            gbs_users_m = users_m[~world.arrays.target_users[index]]
            centroid_m = gbs_users_m.mean(axis=0)
            gbs_distance_m = np.linalg.norm(centroid_m - 1000.0)
            others_m = np.linalg.norm(world.arrays.positions_m[index, :, :2] - 1000.0, axis=1)
            assert gbs_distance_m <= others_m.min()

    def test_without_restarts_is_loiter(self):
        balanced, plain = drawn(2), drawn(2)
        fly(BalancedLoiter(restarts=0), balanced, 10)
        fly(Loiter(), plain, 10)
        assert_same(contents(balanced), contents(plain))

    def test_more_restarts_are_never_less_balanced(self):
        found = []
        for restarts in (0, 5, 20):
            world = drawn(8)
            BalancedLoiter(restarts).begin(world)
            found.append(self.balance(world))
        assert (found[0] <= found[1]).all() and (found[1] <= found[2]).all()

    @pytest.mark.parametrize("keeps_targets", [True, False])
    def test_does_the_same_again_alone_and_in_a_batch(self, keeps_targets):
        together, again = drawn(4), drawn(4)
        alone = WorldBatch(worlds=1, seed=evaluation_seeds(0, 4)[3:])
        alone.set_progress(1.0)
        alone.reset()
        for world in (together, again, alone):
            fly(BalancedLoiter(10, keeps_targets=keeps_targets), world, 5)
        assert_same(contents(together), contents(again))
        for one, array in zip(alone.arrays, together.arrays, strict=True):
            np.testing.assert_array_equal(one[0], array[3])

    def test_the_seed_decides_the_restarts(self):
        found = []
        for seed in (0, 0, 1):
            world = drawn(4)
            BalancedLoiter(3, seed=seed).begin(world)
            found.append(world.arrays.positions_m.copy())
        assert np.array_equal(found[0], found[1])
        assert not np.array_equal(found[0], found[2])

    def test_circles_where_it_was_placed(self):
        world = drawn(3)
        method = BalancedLoiter(5)
        method.begin(world)
        starts_m = world.arrays.positions_m[..., :2].copy()
        for _ in range(CIRCLE_SLOTS):
            world.step(method.act(world))
        distances_m = np.linalg.norm(world.arrays.positions_m[..., :2] - method.centres_m, axis=-1)
        np.testing.assert_allclose(distances_m, 40.0, atol=1e-6)
        np.testing.assert_array_equal(method.centres_m, np.clip(starts_m, 40.0, 1960.0))

    def test_fewer_users_than_uavs_or_none_at_all_are_no_trouble(self):
        for count in (0, 1, 3):
            world = drawn(2)
            targets = np.arange(100) < count
            world.place(world.arrays.positions_m, target_users=np.stack([targets, targets]))
            fly(BalancedLoiter(5), world, 5)
            assert np.isfinite(world.arrays.metrics).all()
            assert world.arrays.target_users.sum() == 2 * count

    @pytest.mark.parametrize("hotspots", [1, 2, 3])
    def test_begins_inside_the_area_on_users_at_few_places(self, hotspots):
        # scikit-learn has a cluster that lost its only user lie anywhere: 5 of 200 worlds failed.
        overrides = {"hotspot_count": hotspots, "scatter_std_m": 0.0, "user_count": 12}
        world = WorldBatch(Parameters().with_overrides(overrides), worlds=40, seed=range(40))
        world.reset()
        places_m = world.users_m[:, None]
        for _ in range(2):
            starts_m = world.arrays.positions_m[:, :, None, :2]
            assert np.linalg.norm(starts_m - places_m, axis=-1).min(axis=2).max() < 1e-6
            BalancedLoiter(restarts=5).begin(world)


class TestCentroids:
    def test_of_fewer_users_than_clusters_coincide(self):
        users_m = np.array([[100.0, 200.0], [300.0, 400.0]])
        centroids_m = kmeans_centroids(users_m, 5, seed=0)
        assert centroids_m.shape == (5, 2)
        assert {tuple(row) for row in centroids_m.tolist()} == {(100.0, 200.0), (300.0, 400.0)}

    def test_that_are_right_already_stay(self):
        users_m = np.random.default_rng(0).uniform(0, 2000, (60, 2))
        first = kmeans_centroids(users_m, 4, seed=3)
        np.testing.assert_allclose(kmeans_centroids(users_m, 4, start_m=first), first, atol=1e-9)

    def test_go_on_from_the_given_start_in_its_order(self):
        centres_m = np.array([[100.0, 100.0], [900.0, 100.0], [500.0, 900.0]])
        generator = np.random.default_rng(0)
        users_m = (centres_m[:, None] + generator.normal(0, 20, (3, 30, 2))).reshape(-1, 2)
        for order in itertools.permutations(range(3)):
            found = kmeans_centroids(users_m, 3, start_m=centres_m[list(order)] + 30.0)
            expected = users_m.reshape(3, 30, 2).mean(axis=1)[list(order)]
            np.testing.assert_allclose(found, expected, atol=1e-9)


class TestTrack:
    @pytest.mark.parametrize("seed", range(5))
    def test_sends_every_centre_the_uav_that_makes_the_sum_of_distances_least(self, seed):
        generator = np.random.default_rng(seed)
        users_m = generator.uniform(300, 1700, (60, 2))
        world = drawn(1, {**WALKING, "uav_count": 4}, seed, users_m)
        method = Track()
        fly(method, world, 10)
        world.arrays.positions_m[0, :, :2] = generator.uniform(300, 1700, (4, 2))
        method.act(world)
        positions_m, centres_m = world.arrays.positions_m[0, :, :2], method.centres_m[0]
        costs = {
            order: sum(math.dist(positions_m[i], centres_m[order[i]]) for i in range(4))
            for order in itertools.permutations(range(4))
        }
        assert costs[0, 1, 2, 3] == pytest.approx(min(costs.values()))
        # The centres are those of K-Means: each the mean of the target users nearest to it.
        targets_m = world.users_m[0][world.arrays.target_users[0]]
        nearest = np.linalg.norm(targets_m[:, None] - centres_m, axis=-1).argmin(axis=1)
        for uav in range(4):
            mean_m = targets_m[nearest == uav].mean(axis=0)
            np.testing.assert_allclose(centres_m[uav], mean_m, atol=1e-6)

    def test_is_loiter_where_users_stay(self):
        tracking, loitering = drawn(3), drawn(3)
        fly(Track(), tracking, 45)
        fly(Loiter(), loitering, 45)
        assert_same(contents(tracking), contents(loitering))

    def test_looks_again_after_a_period_and_not_before(self):
        world = drawn(2, WALKING)
        method = Track(period_s=3.0)
        method.begin(world)
        seen = []
        for _ in range(10):
            world.step(method.act(world))
            seen.append(method.centres_m.copy())
        changed = [not np.array_equal(*pair) for pair in itertools.pairwise(seen)]
        # Slots 3, 6 and 9 are planned by the fourth, the seventh and the tenth act.
        assert [index + 1 for index, is_new in enumerate(changed) if is_new] == [3, 6, 9]

    def test_period_is_in_seconds(self):
        world = drawn(1, {**WALKING, "slot_s": 0.5})
        method = Track(period_s=3.0)
        method.begin(world)
        first = method.centres_m.copy()
        for _ in range(6):
            world.step(method.act(world))
            np.testing.assert_array_equal(method.centres_m, first)
        method.act(world)
        assert not np.array_equal(method.centres_m, first)

    def test_is_nearer_to_users_who_walk_than_loiter_is(self):
        mean_m = {}
        for method in (Loiter(), Track()):
            world = drawn(6, WALKING, seed=3)
            method.begin(world)
            distances_m = []
            for _ in range(120):
                world.step(method.act(world))
                users_m = world.users_m
                relative_m = users_m[:, :, None] - world.arrays.positions_m[:, None, :, :2]
                nearest_m = np.linalg.norm(relative_m, axis=-1).min(axis=-1)
                distances_m.append(np.average(nearest_m, axis=1, weights=world.arrays.target_users))
            assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0
            mean_m[type(method)] = np.mean(distances_m, axis=0)
        assert (mean_m[Track] < mean_m[Loiter]).all()
        assert mean_m[Track].mean() < 0.95 * mean_m[Loiter].mean()

    def test_a_world_is_flown_alone_as_in_a_batch(self):
        together = drawn(3, WALKING)
        alone = WorldBatch(together.parameters, worlds=1, seed=evaluation_seeds(0, 3)[2:])
        alone.set_progress(1.0)
        alone.reset()
        for world in (together, alone):
            fly(Track(), world, 25)
        for one, array in zip(alone.arrays, together.arrays, strict=True):
            np.testing.assert_array_equal(one[0], array[2])

    def test_with_too_few_users_to_cluster_goes_on_where_it_is(self):
        world = drawn(2, WALKING)
        targets = np.arange(100) < 3
        world.place(world.arrays.positions_m, target_users=np.stack([targets, ~targets]))
        method = Track()
        method.begin(world)
        first = method.centres_m.copy()
        for _ in range(12):
            world.step(method.act(world))
        np.testing.assert_array_equal(method.centres_m[0], first[0])
        assert not np.array_equal(method.centres_m[1], first[1])

    def test_users_in_one_place_draw_all_uavs_there(self):
        world = drawn(1, WALKING, users_m=np.full((30, 2), 700.0))
        world.place(world.arrays.positions_m, target_users=np.ones((1, 30)))
        fly(Track(), world, 30)
        assert np.isfinite(world.arrays.metrics).all()


class TestLearned:
    SEEDS = (101, 102, 103, 104, 105)
    LOG_STD = np.array([-0.5, 0.0, -2.0, 0.3], np.float32)

    def actor(self) -> LocalActor:
        generator = np.random.default_rng(0)
        sizes = (16, 32, 32, 4)
        layers = [
            (
                generator.normal(0, 0.4, (outputs, inputs)).astype(np.float32),
                generator.normal(0, 0.1, outputs).astype(np.float32),
            )
            for inputs, outputs in itertools.pairwise(sizes)
        ]
        return LocalActor(layers, self.LOG_STD)

    def world(self, seeds: tuple[int, ...], uavs: int = 3) -> WorldBatch:
        parameters = Parameters().with_overrides({**WALKING, "uav_count": uavs, "user_count": 40})
        world = WorldBatch(parameters, len(seeds), seeds)
        world.reset()
        return world

    def noise_of(self, method: Learned | ZeroAction, seeds: tuple[int, ...]) -> np.ndarray:
        """The noise (T, B, N, A) of a short flight."""
        world = self.world(seeds)
        method.begin(world)
        found = []
        for _ in range(6):
            found.append(method.noise.now(world))
            world.step(method.act(world))
        return np.stack(found)

    def noise(self, seeds: tuple[int, ...]) -> ExplorationNoise:
        return ExplorationNoise(self.LOG_STD, seeds)

    def test_noise_of_a_world_depends_neither_on_the_batch_nor_on_the_policy(self):
        all_noise = self.noise_of(Learned(self.actor(), self.noise(self.SEEDS)), self.SEEDS)
        assert len(np.unique(all_noise)) == all_noise.size == 6 * 5 * 3 * 4
        for method in (Learned(self.actor(), self.noise((104,))), ZeroAction(self.noise((104,)))):
            alone = self.noise_of(method, (104,))
            np.testing.assert_array_equal(alone[:, 0], all_noise[:, 3])
        shuffled = (104, 101)
        part = self.noise_of(ZeroAction(self.noise(shuffled)), shuffled)
        np.testing.assert_array_equal(part, all_noise[:, [3, 0]])

    def test_noise_is_never_used_twice_and_a_new_draw_repeats_it(self):
        noise = self.noise(self.SEEDS)
        world = self.world(self.SEEDS)
        noise.draw(world)
        first = noise._noise.copy()
        assert first.shape == (200, 5, 3, 4)
        assert len(np.unique(first)) == first.size
        noise.draw(world)
        np.testing.assert_array_equal(noise._noise, first)

    def test_noise_has_the_standard_deviation_of_the_training(self):
        seeds = tuple(range(40))
        noise = self.noise(seeds)
        noise.draw(self.world(seeds))
        drawn_noise = noise._noise.reshape(-1, 4)
        np.testing.assert_allclose(drawn_noise.std(axis=0), np.exp(self.LOG_STD), rtol=0.03)
        np.testing.assert_allclose(drawn_noise.mean(axis=0), 0.0, atol=0.03)
        correlation = np.corrcoef(drawn_noise.T) - np.eye(4)
        assert np.abs(correlation).max() < 0.03

    def test_noise_is_not_what_the_topology_was_drawn_from(self):
        noise = self.noise((7,))
        noise.draw(self.world((7,)))
        drawn_alike = np.random.default_rng(7).standard_normal((200, 3, 4)) * np.exp(self.LOG_STD)
        assert not np.isclose(noise._noise[:, 0], drawn_alike).any(axis=(1, 2)).all()

    def test_sampled_actions_are_the_mean_plus_noise(self):
        world = self.world(self.SEEDS)
        sampled = Learned(self.actor(), self.noise(self.SEEDS))
        sampled.begin(world)
        for _ in range(3):
            plain = Learned(self.actor()).act(world)
            np.testing.assert_allclose(sampled.act(world), plain + sampled.noise.now(world))
            world.step(sampled.act(world))

    def test_actions_are_those_of_the_actor_for_every_uav(self):
        world = self.world(self.SEEDS)
        actor = self.actor()
        actions = Learned(actor).act(world)
        assert actions.shape == (5, 3, 4)
        for index, uav in itertools.product(range(5), range(3)):
            expected = actor.act(world.arrays.observations[index, uav][None])[0]
            np.testing.assert_allclose(actions[index, uav], expected, atol=1e-6)

    def test_flights_of_a_batch_are_those_of_single_worlds(self):
        together = self.world(self.SEEDS)
        fly(Learned(self.actor()), together, 50)
        for index, seed in enumerate(self.SEEDS):
            alone = self.world((seed,))
            fly(Learned(self.actor()), alone, 50)
            np.testing.assert_allclose(
                alone.arrays.positions_m[0], together.arrays.positions_m[index], atol=1e-2
            )
            np.testing.assert_allclose(
                alone.arrays.episode_sums[0, 1:],
                together.arrays.episode_sums[index, 1:],
                rtol=1e-4,
                atol=1e-6,
            )

    def test_zero_action_with_noise_flies_the_noise_alone(self):
        world, by_hand = self.world(self.SEEDS), self.world(self.SEEDS)
        noise = self.noise(self.SEEDS)
        fly(ZeroAction(self.noise(self.SEEDS)), world, 5)
        noise.draw(by_hand)
        for _ in range(5):
            by_hand.step(noise.now(by_hand))
        assert_same(contents(world), contents(by_hand))
        assert (world.arrays.velocities_mps != 0.0).any()
