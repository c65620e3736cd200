"""What UAVs know in flight (M39, M40), failures (M42), balanced starts (M41)."""

import math

import numpy as np
import pytest

from orchid_uav.agents.controllers.heuristics import BalancedLoiter, Track
from orchid_uav.envs import Parameters, WorldBatch, make_vec_env
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.knowledge.counterfactuals import shifts_m
from orchid_uav.envs.knowledge.informed import INFORMED_NAMES, INFORMED_SIZE
from orchid_uav.envs.knowledge.outages import Outage
from orchid_uav.envs.metrics import (
    COLLISIONS,
    COVERAGE,
    ENERGY_EFFICIENCY,
    LOAD_JFI,
    PROPULSION_POWER,
    RATE_JFI,
    SUM_RATE,
)
from orchid_uav.envs.propulsion import propulsion_power_w

WALKING = {"network.user_speed_mps": 10.0, "network.heading_hold_s": 5.0}


def begun(worlds: int = 1, seed: int = 0, **overrides) -> WorldBatch:
    world = WorldBatch(Parameters().with_overrides(overrides), worlds, seed)
    world.set_progress(1.0)
    world.reset()
    return world


def still(world: WorldBatch) -> np.ndarray:
    return np.zeros((world.world_count, world.uav_count, 4))


class TestSensing:
    def test_what_is_known_is_what_was_so_much_earlier_and_wrong_by_the_same_all_along(self):
        world = begun(3, **WALKING, **{"sensing.delay_s": 4.0, "sensing.flight_error_std_m": 30.0})
        seen, known = [world.users_m.copy()], [world.known_users_m.copy()]
        velocities = [world.arrays.user_velocities_mps.copy()]
        for slot in range(1, 13):
            world.step(still(world))
            seen.append(world.users_m.copy())
            known.append(world.known_users_m.copy())
            velocities.append(world.arrays.user_velocities_mps.copy())
            np.testing.assert_array_equal(
                world.arrays.known_velocities_mps, velocities[max(slot - 4, 0)]
            )
        error_m = world.arrays.sensing_error_m.transpose(0, 2, 1)
        for slot in range(13):
            expected_m = np.clip(seen[max(slot - 4, 0)] + error_m, 0.0, 2000.0)
            np.testing.assert_array_equal(known[slot], expected_m)
        assert error_m.std() == pytest.approx(30.0, rel=0.1)

    def test_links_and_rewards_stay_true(self):
        blind = {"sensing.delay_s": 60.0, "sensing.flight_error_std_m": 300.0}
        knowing, wrong = begun(4, **WALKING), begun(4, **WALKING, **blind)
        for _ in range(8):
            actions = np.random.default_rng(1).uniform(-1, 1, still(knowing).shape)
            knowing.step(actions)
            wrong.step(actions)
        for name in ("users_m", "association", "rates_bps", "rewards", "metrics"):
            mine = knowing.users_m if name == "users_m" else getattr(knowing.arrays, name)
            other = wrong.users_m if name == "users_m" else getattr(wrong.arrays, name)
            np.testing.assert_array_equal(mine, other, name)
        # But not the distance to the nearest user, which a UAV would have to know.
        assert (knowing.arrays.observations[..., 4] != wrong.arrays.observations[..., 4]).any()
        others = np.delete(np.arange(16), 4)
        np.testing.assert_array_equal(
            knowing.arrays.observations[..., others], wrong.arrays.observations[..., others]
        )

    def test_the_nearest_user_is_that_of_the_known_ones(self):
        world = begun(2, **{"sensing.flight_error_std_m": 200.0})
        gaps_m = world.known_users_m[:, None] - world.arrays.positions_m[:, :, None, :2]
        nearest_m = np.linalg.norm(gaps_m, axis=-1).min(axis=2)
        np.testing.assert_allclose(world.arrays.nearest_user_m, nearest_m)

    def test_every_episode_is_wrong_in_another_way_and_the_same_seed_in_the_same(self):
        first, second = (begun(2, **{"sensing.flight_error_std_m": 50.0}) for _ in range(2))
        np.testing.assert_array_equal(first.arrays.sensing_error_m, second.arrays.sensing_error_m)
        before_m = first.arrays.sensing_error_m.copy()
        first.reset()
        assert (first.arrays.sensing_error_m != before_m).all()
        assert (before_m[0] != before_m[1]).all()

    def test_what_is_true_costs_no_memory(self):
        world = begun()
        assert world.arrays.known_coordinates_m is world.arrays.user_coordinates_m
        assert world.arrays.past_users.size == 0

    def test_track_follows_what_is_known(self):
        late = begun(**WALKING, **{"sensing.delay_s": 1000.0})
        method = Track()
        method.begin(late)
        before_m = method.centres_m.copy()
        for _ in range(25):
            late.step(method.act(late))
        # Users seem to stand still. A clustering anew settles them once, and then moves nobody.
        after_m = method.centres_m.copy()
        for _ in range(10):
            late.step(method.act(late))
        np.testing.assert_allclose(method.centres_m, after_m)
        assert np.abs(after_m - before_m).max() < 500.0


class TestFailures:
    @pytest.mark.parametrize(("text", "outage"), [("2@60", (2, 60, 2**62)), ("0@0-30", (0, 0, 30))])
    def test_are_read(self, text, outage):
        assert Outage.read(text) == outage

    def test_a_failed_uav_serves_nobody_sends_nothing_and_moves_nowhere(self):
        world = begun(3, **{"network.failures": ["1@4-8"]})
        whole = begun(3)
        actions = np.random.default_rng(0).uniform(-1, 1, (12, *still(world).shape))
        for slot in range(12):
            world.step(actions[slot])
            whole.step(actions[slot])
            arrays = world.arrays
            is_out = 4 <= slot + 1 < 8
            assert (arrays.in_service[:, 1] != is_out).all()
            if slot + 1 < 4:
                np.testing.assert_array_equal(arrays.rewards, whole.arrays.rewards)
            if is_out:
                assert (arrays.loads[:, 1] == 0).all()
                assert (arrays.association != 1).all()
                assert (arrays.transmit_powers_w[:, 1] == 0.0).all()
                assert (arrays.velocities_mps[:, 1] == 0.0).all()
                assert (arrays.loads.sum(axis=1) == arrays.target_users.sum(axis=1)).all()
        assert (world.arrays.loads[:, 1] > 0).any()  # it is back

    def test_metrics_are_those_of_the_others(self):
        world = begun(**{"network.failures": ["0@1", "3@1"]})
        world.step(still(world))
        arrays, others = world.arrays, [1, 2, 4, 5]
        loads = arrays.loads[0, others].astype(float)
        jfi = loads.sum() ** 2 / (len(loads) * (loads**2).sum())
        assert arrays.metrics[0, LOAD_JFI] == pytest.approx(jfi)
        assert arrays.metrics[0, PROPULSION_POWER] == pytest.approx(4 * propulsion_power_w(0.0))
        rates = arrays.rates_bps[0, arrays.association[0] >= 0]
        assert arrays.metrics[0, SUM_RATE] == pytest.approx(rates.sum())

    def test_nobody_collides_with_one_that_has_failed(self):
        world = begun(**{"network.failures": ["0@3"], "network.uav_count": 2})
        world.place(np.array([[[500.0, 500.0, 100.0], [502.0, 500.0, 100.0]]]))
        collisions = []
        for _ in range(5):
            world.step(still(world))
            collisions.append(world.arrays.metrics[0, COLLISIONS])
        assert collisions == [1, 1, 0, 0, 0]

    def test_a_fleet_that_has_failed_as_a_whole_has_neither_rate_nor_power(self):
        world = begun(**{"network.failures": [f"{uav}@2" for uav in range(6)]})
        for _ in range(3):
            world.step(still(world))
        assert np.isfinite(world.arrays.rewards).all()
        assert (
            world.arrays.metrics[0, [SUM_RATE, PROPULSION_POWER, LOAD_JFI, RATE_JFI]] == 0
        ).all()
        assert np.isfinite(world.informed_observations()).all()

    def test_a_place_that_will_be_needed_again_stays_free(self):
        stations = {"uav.flight": "station", "network.uav_count": 2, "network.area_m": 3000.0}
        for failure, is_kept in (("1@1-500", True), ("1@1", False)):
            world = begun(**stations, **{"network.failures": [failure]})
            world.place(np.array([[[1000.0, 1500.0, 100.0], [1200.0, 1500.0, 100.0]]]))
            actions = still(world)
            actions[..., 0] = 1.0
            least_m = math.inf
            for _ in range(60):
                world.step(actions)
                gap_m = np.diff(world.arrays.stations_m[0], axis=0)
                least_m = min(least_m, float(np.linalg.norm(gap_m)))
            assert (least_m >= 90.0 - 1e-6) == is_kept

    @pytest.mark.parametrize(
        ("failures", "told"),
        [
            (["6@3"], "failures name UAV 6, but there are only UAVs 0 to 5"),
            (["1@7-7"], "cannot fail in slot 7 and join before it"),
            (["one@3"], "network.failures = 'one@3'"),
        ],
    )
    def test_what_cannot_be_is_told(self, failures, told):
        with pytest.raises(ValueError, match=told):
            begun(**{"network.failures": failures})


class TestBalancedStarts:
    def test_phase_one_begins_where_balanced_loiter_does(self):
        balanced = begun(4, **{"deployment.init": "balanced"})
        other = begun(4)
        BalancedLoiter().begin(other)
        np.testing.assert_array_equal(balanced.arrays.positions_m, other.arrays.positions_m)
        np.testing.assert_array_equal(balanced.arrays.target_users, other.arrays.target_users)

    def test_it_sees_the_users_as_phase_one_does_or_as_they_are(self):
        wrong = {"network.sensing_error_std_m": 200.0, "deployment.init": "balanced"}
        sensed, exact = begun(6, **wrong), begun(6, **wrong, **{"deployment.balanced_on": "exact"})
        np.testing.assert_array_equal(sensed.arrays.target_users, exact.arrays.target_users)
        np.testing.assert_array_equal(sensed.users_m, exact.users_m)

        def fairness(world: WorldBatch) -> float:
            return (world.arrays.metrics[:, LOAD_JFI] + world.arrays.metrics[:, RATE_JFI]).mean()

        assert fairness(exact) > fairness(sensed) + 0.03


class TestInformed:
    def test_it_has_a_name_for_every_number_and_one_size_for_every_fleet(self):
        assert len(set(INFORMED_NAMES)) == INFORMED_SIZE == 98
        for uavs, users in ((1, 5), (2, 60), (12, 200)):
            fleet = {"network.uav_count": uavs, "network.user_count": users}
            world = begun(2, **fleet)
            assert world.informed_observations().shape == (2, uavs, 98)

    def test_some_numbers_by_hand(self):
        world = begun(**{"network.uav_count": 3, "network.user_count": 40})
        arrays = world.arrays
        seen = dict(zip(INFORMED_NAMES, world.informed_observations()[0, 1], strict=True))
        own_m = world.users_m[0][arrays.association[0] == 1]
        station_m = arrays.positions_m[0, 1, :2]
        away_m = own_m - station_m
        mean_load = arrays.loads[0].mean()
        assert seen["own load / fleet's mean - 1"] == pytest.approx(len(own_m) / mean_load - 1)
        centroid_m = away_m.mean(axis=0) / 500.0
        assert seen["own users' centroid, x / 500 m"] == pytest.approx(centroid_m[0], abs=1e-5)
        spread_m = np.sqrt(((away_m - away_m.mean(axis=0)) ** 2).sum(axis=1).mean())
        name = "own users' root mean square distance from it / 500 m"
        assert seen[name] == pytest.approx(spread_m / 500.0, abs=1e-5)
        farthest_m = away_m[np.argmax(np.linalg.norm(away_m, axis=1))]
        assert seen["own farthest user, y / 500 m"] == pytest.approx(farthest_m[1] / 500, abs=1e-5)
        inverse = np.zeros(3)
        served = arrays.association[0] >= 0
        np.add.at(inverse, arrays.association[0][served], 1 / arrays.spectral_efficiency[0][served])
        airtime = inverse[1] / inverse.mean() - 1
        assert seen["own airtime / fleet's mean - 1"] == pytest.approx(airtime, abs=1e-5)
        shares = [value for name, value in seen.items() if name.startswith("own users in dir")]
        assert sum(shares) == pytest.approx(len(own_m) / mean_load, abs=1e-5)
        distance_m = np.linalg.norm(arrays.positions_m[0, :, :2] - station_m, axis=1)
        nearest = np.argsort(distance_m)[1]
        expected = (arrays.positions_m[0, nearest, 0] - station_m[0]) / 500.0
        assert seen["1. neighbour: station, x / 500 m"] == pytest.approx(
            np.clip(expected, -4, 4), abs=1e-5
        )
        assert [seen[f"{number}. neighbour: 1 if there is one"] for number in (1, 2, 3)] == [
            1,
            1,
            0,
        ]

    def test_users_are_seen_where_they_will_be_if_they_go_on(self):
        world = begun(**WALKING)
        world.step(still(world))
        seen = world.informed_observations()[0]
        ahead_m = np.clip(
            world.users_m[0] + 5.0 * world.arrays.user_velocities_mps[0].T, 0.0, 2000.0
        )
        for uav in range(6):
            own_m = ahead_m[world.arrays.association[0] == uav]
            expected_m = own_m.mean(axis=0) - world.arrays.positions_m[0, uav, :2]
            np.testing.assert_allclose(seen[uav, 10:12], expected_m / 500.0, atol=1e-5)

    def test_one_that_has_failed_is_no_neighbour(self):
        world = begun(**{"network.uav_count": 2, "network.failures": ["1@1"]})
        names = list(INFORMED_NAMES)
        assert world.informed_observations()[0, 0, names.index("1. neighbour: 1 if there is one")]
        world.step(still(world))
        seen = world.informed_observations()[0, 0]
        assert seen[names.index("1. neighbour: 1 if there is one")] == 0
        assert seen[names.index("log2 of the UAVs in service / 4")] == 0

    def test_vector_environments_give_it(self):
        env = make_vec_env(2, observation="informed", flight="station", users=20, uavs=3)
        rows = env.reset()
        assert rows["observation"].shape == (6, 98)
        assert rows["state"].shape == (6, 3 * 16 + 101)
        assert env.observation_space["observation"].contains(rows["observation"][0])

    def test_moves_that_are_judged_are_rings_and_staying(self):
        moves_m = shifts_m()
        lengths_m = np.linalg.norm(moves_m, axis=1)
        np.testing.assert_allclose(lengths_m, [0.0, *[60.0] * 8, *[180.0] * 8, *[400.0] * 8])


class TestLaterSlots:
    def test_metrics_may_begin_later_than_the_episode(self):
        world = begun(2, **WALKING)
        diagnostics = Diagnostics(world)
        diagnostics.begin()
        flown = []
        for slot in range(10):
            if slot == 6:
                world.forget_metrics()
                diagnostics.begin()
            world.step(np.random.default_rng(slot).uniform(-1, 1, still(world).shape))
            diagnostics.observe()
            flown.append(world.arrays.metrics.copy())
        for index in range(2):
            metrics = world.episode_metrics(index)
            expected = np.mean(flown[6:], axis=0)[index]
            assert metrics["rate_jfi"] == pytest.approx(expected[RATE_JFI])
            assert metrics["collisions"] == np.sum(flown[6:], axis=0)[index, COLLISIONS]
            weights = [0.5 * one[index, [COVERAGE, LOAD_JFI, RATE_JFI]].sum() for one in flown[6:]]
            scale = world.constants.efficiency_scale_bit_per_joule
            efficiency = [0.5 * one[index, ENERGY_EFFICIENCY] / scale for one in flown[6:]]
            utility = diagnostics.episode_metrics(index)["utility"]
            assert utility == pytest.approx(np.mean(weights) + np.mean(efficiency))
        world.reset()
        world.step(still(world))
        assert world.episode_metrics(0)["rate_jfi"] == pytest.approx(
            world.arrays.metrics[0, RATE_JFI]
        )
