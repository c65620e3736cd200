"""Areas that are no square (M44), and no mast, one or several (M45)."""

import itertools

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from pettingzoo.test import parallel_api_test, parallel_seed_test
from scipy import stats
from stable_baselines3.common.env_checker import check_env as check_sb3_env

import tests.helpers.independent_network as independent
from orchid_uav.envs import Parameters, WorldBatch, make_vec_env, parallel_env
from orchid_uav.envs.deployment import gbs_aware_kmeans
from orchid_uav.envs.diagnostics import Diagnostics

ELONGATED = (3000.0, 700.0)
MASTS = [[2500.0, 100.0], [400.0, 600.0, 12.0], [-500.0, 300.0, 50.0]]
NUMBERS_OF_MASTS = pytest.mark.parametrize("masts", [[], MASTS[:1], MASTS], ids=len)
STATIONS = {"uav.flight": "station", "uav.observation": "informed"}


def begun(worlds: int = 1, seed: int = 0, users_m=None, **overrides) -> WorldBatch:
    parameters = Parameters().with_overrides(overrides)
    world = WorldBatch(parameters, worlds, seed, user_positions_m=users_m)
    world.set_progress(0.5)
    world.reset()
    return world


def place(masts: list, area_m=ELONGATED) -> dict:
    return {"network.area_m": area_m, "gbs.positions_m": masts}


def fly(world: WorldBatch, slots: int, seed: int = 0) -> list[np.ndarray]:
    """All arrays in all slots under random actions."""
    generator = np.random.default_rng(seed)
    found = []
    for _ in range(slots):
        world.step(generator.uniform(-1.3, 1.3, (world.world_count, world.uav_count, 4)))
        found += [array.copy() for array in [*world.arrays, world.gbs_rates_bps()]]
    return found


class TestConfiguration:
    @pytest.mark.parametrize(
        ("value", "size_m"),
        [(900, (900.0, 900.0)), ([900, 50.5], (900.0, 50.5)), ((1, 1e6), (1.0, 1e6))],
    )
    def test_an_area_has_a_side_or_two(self, value, size_m):
        network = Parameters().with_overrides({"area_m": value}).network
        assert network.area_size_m == size_m

    @pytest.mark.parametrize(
        "value", [[900], [900, 900, 900], [900, 0.5], ["wide", 900], [900, True], None, [[9], 9]]
    )
    def test_an_area_that_is_none_is_told(self, value):
        with pytest.raises(ValueError, match=r"^network\.area_m = .*: (not .* m|input|true)"):
            Parameters().with_overrides({"area_m": value})

    @pytest.mark.parametrize(
        ("value", "places_m"),
        [
            ("middle", ((1500.0, 350.0, 30.0),)),
            ([], ()),
            ([[1, 2]], ((1.0, 2.0, 30.0),)),
            ([[1, 2, 3], (-4000.0, 5)], ((1.0, 2.0, 3.0), (-4000.0, 5.0, 30.0))),
        ],
    )
    def test_masts_have_the_usual_height_or_their_own(self, value, places_m):
        parameters = Parameters().with_overrides(place(value))
        assert parameters.gbs_positions_m == places_m

    @pytest.mark.parametrize(
        ("value", "message"),
        [
            (None, r"\[\] for none"),
            ([100, 200], r"\[\[500, 800\]\] for one"),
            ([[1, 2, 3, 4]], "masts are written"),
            ("center", "masts are written"),
            ([[1, "a"]], "valid number"),
            ([[1, 2], [float("nan"), 2]], "finite number"),
            ([[1, 2], [1, 2e6]], r"mast 1 is farther than 1e\+06 m"),
            ([[1, 2, 0]], "the height of mast 0"),
            ([[1, False]], "true and false"),
        ],
    )
    def test_masts_that_are_none_are_told(self, value, message):
        with pytest.raises(ValueError, match=rf"^gbs\.positions_m = .*{message}"):
            Parameters().with_overrides({"gbs.positions_m": value})

    @NUMBERS_OF_MASTS
    def test_every_uav_and_mast_needs_a_user(self, masts):
        enough = 4 + len(masts)
        Parameters().with_overrides({**place(masts), "uav_count": 4, "user_count": enough})
        with pytest.raises(ValueError, match=f"at least {enough} users"):
            Parameters().with_overrides({**place(masts), "uav_count": 4, "user_count": enough - 1})

    def test_what_is_written_is_read_again(self):
        parameters = Parameters().with_overrides(place(MASTS))
        assert Parameters.model_validate_json(parameters.model_dump_json()) == parameters
        assert Parameters.model_validate(parameters.model_dump()) == parameters


class TestRectangle:
    @pytest.mark.parametrize("more", [{}, STATIONS, {"deployment.init": "random"}])
    def test_equal_sides_are_a_square_to_the_last_bit(self, more):
        more = {"network.user_speed_mps": 15.0, **more}
        square = begun(3, **{"network.area_m": 700.0}, **more)
        sides = begun(3, **{"network.area_m": (700.0, 700.0)}, **more)
        for one, other in zip(fly(square, 8), fly(sides, 8), strict=True):
            np.testing.assert_array_equal(one, other)

    def exchanged(self, **more) -> list[WorldBatch]:
        """Two worlds of the same users, masts and UAVs, the second with its axes exchanged."""
        generator = np.random.default_rng(4)
        users_m = generator.uniform(0.0, ELONGATED, (30, 2))
        positions_m = generator.uniform((50, 50, 90), (2950, 650, 110), (1, 5, 3))
        worlds = []
        for east, north in ((0, 1), (1, 0)):
            masts = [[mast[east], mast[north], *mast[2:]] for mast in MASTS]
            world = begun(
                users_m=users_m[:, (east, north)],
                **place(masts, (ELONGATED[east], ELONGATED[north])),
                **{"network.uav_count": 5, "gbs.shadowing_std_db": 0.0, **more},
            )
            world.place(positions_m[..., (east, north, 2)], target_users=np.arange(30) > 5)
            worlds.append(world)
        return worlds

    def test_exchanging_the_axes_exchanges_them_in_what_happens_and_nothing_else(self):
        worlds = self.exchanged()
        generator = np.random.default_rng(5)
        for _ in range(9):
            actions = generator.uniform(-1.3, 1.3, (1, 5, 4))
            for world, order in zip(worlds, ((0, 1, 2, 3), (1, 0, 2, 3)), strict=True):
                world.step(actions[..., order])
            one, other = (world.arrays for world in worlds)
            np.testing.assert_allclose(one.positions_m, other.positions_m[..., (1, 0, 2)])
            np.testing.assert_array_equal(one.association, other.association)
            np.testing.assert_allclose(one.metrics, other.metrics)
            np.testing.assert_allclose(one.rewards, other.rewards)
            order = (1, 0, 2, 3, 4, 5, 8, 9, 6, 7, *range(10, 16))
            np.testing.assert_allclose(one.observations, other.observations[..., order], 1e-6)
            np.testing.assert_allclose(worlds[0].gbs_rates_bps(), worlds[1].gbs_rates_bps())

    def test_exchanging_the_axes_exchanges_them_in_the_moves_of_stations(self):
        worlds = self.exchanged(**STATIONS)
        action = np.random.default_rng(6).uniform(-1.0, 1.0, (1, 5, 4))
        for _ in range(9):  # circles are turned round, and so are not compared
            for world, order in zip(worlds, ((0, 1, 2, 3), (1, 0, 2, 3)), strict=True):
                world.step(action[..., order])
            one, other = (world.arrays for world in worlds)
            np.testing.assert_allclose(one.stations_m, other.stations_m[..., ::-1])

    @pytest.mark.parametrize("distribution", ["tcp", "uniform"])
    def test_users_are_all_over_it_and_stay_inside(self, distribution):
        world = begun(
            60,
            **place("middle"),
            **{"distribution": distribution, "user_speed_mps": 300.0, "network.user_count": 50},
        )
        for users_m in (world.users_m.copy(), [world.step(np.zeros((60, 6, 4))), world.users_m][1]):
            assert (users_m >= 0.0).all()
            assert (users_m <= ELONGATED).all()
            if distribution == "uniform":
                for axis in range(2):
                    shares = users_m[..., axis].ravel() / ELONGATED[axis]
                    assert stats.kstest(shares, "uniform").pvalue > 1e-3

    def test_random_starts_are_apart_and_all_over_it(self):
        apart = {"deployment.init": "random", "uav.min_separation_m": 200.0}
        world = begun(60, **place("middle"), **apart)
        starts_m = world.arrays.positions_m[..., :2]
        gaps_m = np.linalg.norm(starts_m[:, :, None] - starts_m[:, None], axis=-1)
        assert gaps_m[:, ~np.eye(6, dtype=bool)].min() >= 200.0
        assert starts_m[..., 0].max() > 2500.0 and starts_m[..., 1].max() <= 700.0

    def test_a_random_start_that_cannot_be_is_refused_at_once(self):
        # Oler's bound: two to a column of 1 m, by the side of each other 3000 of them.
        strip = {"init": "random", "min_separation_m": 1.0, "area_m": (200.0, 1.0)}
        Parameters().with_overrides({**strip, "uav_count": 400, "user_count": 401})
        with pytest.raises(ValueError, match=r"no room for 500 UAVs .* area_m = 200 x 1 m"):
            Parameters().with_overrides({**strip, "uav_count": 500, "user_count": 501})

    @pytest.mark.parametrize("area_m", [ELONGATED, (90.0, 2000.0), (60.0, 60.0), (5000.0, 80.0)])
    def test_stations_keep_their_distance_and_leave_room_for_circles(self, area_m):
        world = begun(2, **place([], area_m), **STATIONS, **{"network.user_speed_mps": 10.0})
        radius_m, spacing_m = world.constants.circle_radius_m, world.constants.centre_spacing_m
        assert radius_m == min(40.0, *(0.5 * side_m for side_m in area_m))
        assert 0.0 < spacing_m <= 90.0 or set(area_m) == {60.0}
        generator = np.random.default_rng(0)
        for _ in range(40):
            world.step(generator.uniform(-1, 1, (2, 6, 4)))
            stations_m = world.arrays.stations_m
            assert (stations_m >= radius_m).all()
            assert (stations_m <= np.array(area_m) - radius_m).all()
            gaps_m = np.linalg.norm(stations_m[:, :, None] - stations_m[:, None], axis=-1)
            assert gaps_m[:, ~np.eye(6, dtype=bool)].min() >= spacing_m * (1.0 - 1e-9)
            assert (world.arrays.positions_m[..., :2] <= area_m).all()

    def test_what_is_known_lies_inside(self):
        world = begun(2, **place([]), **{"sensing.flight_error_std_m": 500.0})
        known_m = world.known_users_m
        assert (known_m >= 0.0).all()
        assert (known_m <= ELONGATED).all()
        for axis in range(2):
            assert (known_m[..., axis] == ELONGATED[axis]).any()

    def test_the_informed_observation_has_places_as_shares_of_their_own_side(self):
        world = begun(2, **place([]), **STATIONS)
        shares = world.arrays.stations_m / ELONGATED
        np.testing.assert_allclose(world.observations()[..., :2], shares, rtol=1e-6)


class TestPhaseOne:
    @settings(max_examples=40, deadline=None)
    @given(st.integers(0, 2**31), st.integers(1, 5), st.integers(0, 4), st.integers(0, 30))
    def test_masts_get_the_clusters_with_the_least_sum_of_distances(self, seed, uavs, masts, more):
        generator = np.random.default_rng(seed)
        users_m = generator.uniform(0, 2000, (uavs + masts + more, 2))
        masts_m = generator.uniform(-300, 2300, (masts, 3))
        found = gbs_aware_kmeans(users_m, uavs, masts_m, seed=seed)
        assert len(found.centroids_m) == uavs + masts
        assert len(found.uav_positions_m) == uavs
        of_masts = set(found.labels[~found.target_users].tolist())
        gaps_m = np.linalg.norm(masts_m[:, None, :2] - found.centroids_m[None], axis=2)
        best = min(
            itertools.permutations(range(uavs + masts), masts),
            key=lambda chosen: gaps_m[np.arange(masts), list(chosen)].sum(),
        )
        assert of_masts == set(best)
        is_uavs = ~np.isin(np.arange(uavs + masts), best)
        np.testing.assert_array_equal(found.uav_positions_m, found.centroids_m[is_uavs])

    @pytest.mark.parametrize("gbs", [(700.0, 300.0), (700.0, 300.0, 30.0), [(700.0, 300.0, 30.0)]])
    def test_one_mast_is_the_gbs_however_it_is_given(self, gbs):
        users_m = np.random.default_rng(0).uniform(0, 2000, (80, 2))
        found = gbs_aware_kmeans(users_m, 6, gbs, seed=1)
        nearest = np.linalg.norm(found.centroids_m - (700.0, 300.0), axis=1).argmin()
        np.testing.assert_array_equal(found.target_users, found.labels != nearest)

    def test_masts_share_too_few_places_before_uavs_do(self):
        # Two places for two UAVs and three masts: all users are the masts'.
        users_m = np.repeat([(100.0, 100.0), (900.0, 500.0)], 5, axis=0)
        found = gbs_aware_kmeans(users_m, 2, [(0, 0), (500, 500), (1000, 0)], seed=0)
        assert not found.target_users.any()
        assert found.uav_positions_m.shape == (2, 2)
        assert {tuple(place) for place in found.uav_positions_m.tolist()} <= {
            (100.0, 100.0),
            (900.0, 500.0),
        }
        assert found.spare_uavs == 3
        # A third place is left for UAVs, both of them.
        more_m = np.concatenate([users_m, [(1900.0, 1900.0)] * 3])
        found = gbs_aware_kmeans(more_m, 3, [(0, 0), (1000, 400)], seed=0)
        assert found.target_users.tolist() == [False] * 10 + [True] * 3
        assert found.uav_positions_m.tolist() == [[1900.0, 1900.0]] * 3

    @pytest.mark.parametrize("init", ["kmeans", "balanced", "random"])
    def test_without_masts_all_users_are_targets_whatever_the_start(self, init):
        world = begun(3, **place([]), **{"deployment.init": init})
        assert world.arrays.target_users.all()

    def test_the_number_of_masts_changes_neither_users_nor_walks_nor_what_masts_share(self):
        drawn = {}
        for count in range(4):
            parameters = Parameters().with_overrides(place(MASTS[:count]))
            drawn[count] = WorldBatch(parameters, 5, 3).draw_topologies()
            assert drawn[count].shadowing_db.shape == (5, count, 100)
        for count in range(3):
            for name in ("users_m", "walk_keys"):
                few, many = getattr(drawn[count], name), getattr(drawn[3], name)
                np.testing.assert_array_equal(few, many)
            np.testing.assert_array_equal(
                drawn[count].shadowing_db, drawn[3].shadowing_db[:, :count]
            )
        flat = drawn[3].shadowing_db.swapaxes(0, 1).reshape(3, -1)
        assert np.abs(np.corrcoef(flat) - np.eye(3)).max() < 0.2
        np.testing.assert_allclose(flat.std(axis=1), 8.0, rtol=0.1)


class TestMasts:
    @NUMBERS_OF_MASTS
    @pytest.mark.parametrize("speed_mps", [0.0, 40.0])
    def test_serve_their_users_as_the_independent_version_says(self, masts, speed_mps):
        overrides = {**place(masts), "user_speed_mps": speed_mps, "network.user_count": 60}
        parameters = Parameters().with_overrides(overrides)
        world = WorldBatch(parameters, 4, 2)
        topologies = world.draw_topologies()
        world.use_topology(topologies)
        setting = independent.Setting(masts_m=parameters.gbs_positions_m)
        servers = set()
        for _ in range(3):
            rates_bps = world.gbs_rates_bps()
            for index in range(4):
                expected_bps, served_by = independent.mast_rates_bps(
                    setting,
                    [tuple(row) for row in world.users_m[index].tolist()],
                    world.arrays.target_users[index].tolist(),
                    topologies.shadowing_db[index].tolist(),
                )
                np.testing.assert_allclose(rates_bps[index], expected_bps, rtol=1e-9)
                snapshot = world.snapshot(index)
                np.testing.assert_allclose(
                    snapshot["rates_bps"], world.arrays.rates_bps[index] + expected_bps, rtol=1e-9
                )
                servers |= set(served_by)
            world.step(np.zeros((4, 6, 4)))
        assert servers >= set(range(len(masts)))  # each of them serves somebody

    @NUMBERS_OF_MASTS
    def test_are_seen_in_a_snapshot(self, masts):
        world = begun(**place(masts))
        snapshot = world.snapshot()
        assert snapshot["gbs_positions_m"].shape == (len(masts), 3)
        assert ("gbs_position_m" in snapshot) == (len(masts) == 1)
        for mast, seen in zip(masts, snapshot["gbs_positions_m"].tolist(), strict=True):
            assert seen == [*mast[:2], *(mast[2:] or [30.0])]
        snapshot["gbs_positions_m"][:] = -1.0
        assert (world.snapshot()["gbs_positions_m"] != -1.0).all()

    def test_no_mast_constrains_nothing_and_serves_nobody(self):
        world = begun(3, **place([]), **{"channel.backhaul_required_snr_db": 200.0})
        diagnostics = Diagnostics(world)
        diagnostics.begin()
        for _ in range(4):
            world.step(np.full((3, 6, 4), 0.5))
            diagnostics.observe()
        assert not world.arrays.weak_backhaul.any()
        np.testing.assert_allclose(world.arrays.observations[..., 15], 1.0, rtol=1e-6)
        assert not world.gbs_rates_bps().any()
        for index in range(3):
            figures = diagnostics.episode_metrics(index)
            assert (figures["gbs_rate_bps"], figures["gbs_coverage"]) == (0.0, 1.0)
            assert figures["total_coverage"] == world.episode_metrics(index)["coverage"]

    @NUMBERS_OF_MASTS
    def test_a_state_goes_on_bit_for_bit(self, masts):
        moving = {"network.user_speed_mps": 10.0}
        first, second = begun(2, **place(masts), **moving), begun(2, 9, **place(masts), **moving)
        fly(first, 5)
        document, arrays = first.state()
        second.restore(document, arrays)
        for one, other in zip(fly(first, 5, 1), fly(second, 5, 1), strict=True):
            np.testing.assert_array_equal(one, other)
        first.reset()
        second.reset()
        np.testing.assert_array_equal(first.users_m, second.users_m)

    def test_a_state_of_other_masts_is_refused(self):
        first = begun(**place(MASTS))
        for masts in (MASTS[:2], MASTS[:1], []):
            with pytest.raises(ValueError, match=r"shadowing|other worlds"):
                begun(**place(masts)).restore(*first.state())

    def test_one_masts_state_is_that_of_earlier_versions(self):
        assert begun(2).state()[1]["shadowing_db"].shape == (2, 100)


class TestInterfaces:
    SHORT = {
        "uavs": 3,
        "users": 20,
        "episode_slots": 12,
        "area_m": [900, 400],
        **{"gbs.positions_m": [[100, 100], [1200, 300, 15]]},
    }

    def test_pettingzoo(self):
        parallel_api_test(parallel_env(**self.SHORT), num_cycles=30)
        parallel_seed_test(lambda: parallel_env(**self.SHORT, speed_mps=5.0), num_cycles=20)

    @pytest.mark.filterwarnings("ignore:.*unconventional shape.*:UserWarning")
    def test_gymnasium_and_sb3(self):
        check_env(gymnasium.make("orchid/Fleet-v0", **self.SHORT).unwrapped)
        check_sb3_env(gymnasium.make("orchid/Fleet-v0", **self.SHORT))

    @settings(max_examples=12, deadline=None)
    @given(
        seed=st.integers(0, 2**31),
        area_m=st.tuples(st.floats(1.0, 5000.0), st.floats(1.0, 5000.0)),
        masts=st.lists(
            st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.floats(1.0, 500.0)),
            max_size=3,
        ),
        flight=st.sampled_from(["direct", "station"]),
        observation=st.sampled_from(["paper", "informed"]),
    )
    def test_spaces_hold_what_is_observed(self, seed, area_m, masts, flight, observation):
        env = make_vec_env(
            2,
            seed,
            uavs=4,
            users=12,
            speed_mps=50.0,
            area_m=area_m,
            flight=flight,
            observation=observation,
            **{"gbs.positions_m": masts},
        )
        rows = env.reset()
        generator = np.random.default_rng(seed)
        for _ in range(4):
            for row in range(env.num_envs):
                assert env.observation_space.contains({k: v[row] for k, v in rows.items()})
            rows, *_ = env.step(generator.uniform(-1, 1, (env.num_envs, 4)))

    def test_bounds_of_the_backhaul_of_one_mast_are_reached(self):
        overrides = {"area_m": [900.0, 400.0], "gbs.positions_m": [[100.0, 500.0, 90.0]]}
        env = parallel_env(uavs=2, users=3, **overrides)
        env.reset(seed=0)
        env.world.place([[(900.0, 0.0, 120.0), (100.0, 400.0, 90.0)]])
        space, seen = env.observation_space("uav_0"), env.world.arrays.observations[0, :, 15]
        assert seen.tolist() == pytest.approx([space.low[15], space.high[15]], abs=1e-5)

    def test_the_callers_own_users_stand_where_they_are(self):
        users_m = np.random.default_rng(0).uniform(0.0, (900.0, 400.0), (5, 2))
        env = parallel_env(**{**self.SHORT, "users": users_m})
        env.reset(seed=0)
        snapshot = env.snapshot()
        np.testing.assert_array_equal(snapshot["users_m"], users_m)
        assert snapshot["gbs_positions_m"].tolist() == [[100, 100, 30], [1200, 300, 15]]

    @pytest.mark.parametrize(
        ("users_m", "message"),
        [
            ([[1.0, 2.0]] * 4, "user_count is 4, .* 3 UAVs .* 2 masts needs at least 5"),
            ([[1.0, 2.0]] * 5 + [[1.0, 401.0]], r"user 5 is at \(1, 401\) m, .* 0..900 x 0..400 m"),
        ],
    )
    def test_users_that_cannot_be_are_told(self, users_m, message):
        with pytest.raises(ValueError, match=message):
            parallel_env(**{**self.SHORT, "users": users_m})
