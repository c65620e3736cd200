"""Users and Phase I."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from orchid_uav.envs import Parameters, WorldBatch
from orchid_uav.envs.deployment import (
    deploy,
    gbs_aware_kmeans,
    kmeans_centroids,
    random_start,
)
from orchid_uav.envs.users import (
    counter_uniform,
    draw_user_positions,
    reflect_into,
    reflection_sign,
    thomas_cluster_process,
)

GBS = (1000.0, 1000.0, 30.0)


def hotspots(centres: list[tuple[float, float]], users_each: int = 10) -> np.ndarray:
    generator = np.random.default_rng(0)
    return np.concatenate([generator.normal(centre, 5.0, (users_each, 2)) for centre in centres])


class TestKMeans:
    CENTRES = ((300.0, 300.0), (1700.0, 300.0), (1050.0, 980.0), (300.0, 1700.0))

    def test_separate_hotspots_get_a_uav_each_and_the_middle_one_the_gbs(self):
        users = hotspots(self.CENTRES)
        found = gbs_aware_kmeans(users, 3, GBS, seed=0, n_init=10)
        expected = {(300, 300), (1700, 300), (300, 1700)}
        assert {tuple(np.round(p, -2).astype(int)) for p in found.uav_positions_m} == expected
        assert not found.target_users[20:30].any()
        assert found.target_users.sum() == 30

    def test_every_user_belongs_to_its_nearest_centroid(self):
        users = np.random.default_rng(1).uniform(0, 2000, (100, 2))
        found = gbs_aware_kmeans(users, 6, GBS, seed=3)
        distances = np.linalg.norm(users[:, None] - found.centroids_m[None], axis=2)
        np.testing.assert_array_equal(found.labels, distances.argmin(axis=1))
        gbs_cluster = np.linalg.norm(found.centroids_m - GBS[:2], axis=1).argmin()
        np.testing.assert_array_equal(found.target_users, found.labels != gbs_cluster)
        assert len(found.uav_positions_m) == 6

    def test_same_seed_same_start_and_more_runs_are_no_worse(self):
        users = np.random.default_rng(2).uniform(0, 2000, (100, 2))

        def spread(found):
            return ((users - found.centroids_m[found.labels]) ** 2).sum()

        first, again = (gbs_aware_kmeans(users, 6, GBS, seed=1) for _ in range(2))
        np.testing.assert_array_equal(first.uav_positions_m, again.uav_positions_m)
        assert spread(gbs_aware_kmeans(users, 6, GBS, seed=1, n_init=20)) <= spread(first) + 1e-6

    def test_too_few_users(self):
        with pytest.raises(ValueError, match="4 users cannot form 5 clusters"):
            gbs_aware_kmeans(np.zeros((4, 2)), 4, GBS)

    @pytest.mark.parametrize(
        ("users", "uavs", "message"),
        [([[float("nan"), 0.0]] * 9, 3, "finite"), ([0.0] * 9, 3, "shape"), ([[0, 0]] * 9, 0, "1")],
    )
    def test_what_cannot_be_clustered(self, users, uavs, message):
        with pytest.raises(ValueError, match=message):
            gbs_aware_kmeans(users, uavs, GBS)

    def test_all_users_in_one_place_are_the_gbs_s(self):
        generator = np.random.default_rng(3)
        for seed, place in enumerate(generator.uniform(0.0, 2000.0, (30, 2))):
            found = gbs_aware_kmeans(np.tile(place, (10, 1)), 3, GBS, seed=seed)
            np.testing.assert_allclose(found.uav_positions_m, np.tile(place, (3, 1)))
            assert not found.target_users.any()
            assert found.spare_uavs == 3

    @pytest.mark.parametrize(
        "places",
        [
            ((1.8395782217315304, 840.3690693862609), (1262.8722122645802, 1869.9221883733005)),
            ((226.71178584315288, 819.6569800967486), (1602.2276659804616, 38.16692244872466)),
            ((510.52888147362506, 143.63497851338525), (624.8909859657317, 1121.0039367440042)),
            ((300.0, 300.0), (1700.0, 1400.0)),
        ],
    )
    def test_two_places_for_four_clusters_leave_the_farther_one_to_the_uavs(self, places):
        # Rounding had the GBS take a cluster without users: 20, 10, 10, 20, 20 targets by seed.
        users = np.repeat(np.array(places), 10, axis=0)
        farther = np.argmax([np.hypot(x - GBS[0], y - GBS[1]) for x, y in places])
        for seed in range(20):
            found = gbs_aware_kmeans(users, 3, GBS, seed=seed)
            np.testing.assert_array_equal(found.target_users, np.arange(20) // 10 == farther)
            assert found.spare_uavs == 2

    @settings(max_examples=100, deadline=None)
    @given(
        places=st.integers(2, 9),
        uavs=st.integers(1, 10),
        extra_users=st.integers(0, 40),
        seed=st.integers(0, 2**31 - 1),
    )
    def test_with_no_more_places_than_clusters_the_gbs_takes_the_nearest(
        self, places, uavs, extra_users, seed
    ):
        places = min(places, uavs + 1)
        generator = np.random.default_rng(seed)
        places_m = generator.uniform(0.0, 2000.0, (places, 2))
        rest = generator.integers(places, size=uavs + 1 - places + extra_users)
        at_place = generator.permutation(np.concatenate([np.arange(places), rest]))
        found = gbs_aware_kmeans(places_m[at_place], uavs, GBS, seed=seed)
        nearest = np.hypot(*(places_m - GBS[:2]).T).argmin()
        np.testing.assert_array_equal(found.target_users, at_place != nearest)
        assert found.spare_uavs == uavs + 1 - places
        to_places = np.linalg.norm(found.uav_positions_m[:, None] - places_m[None], axis=2)
        assert to_places.min(axis=1).max() < 1e-6

    def test_point_like_hotspots_never_leave_the_gbs_without_users(self):
        # 18 of these 200 worlds did.
        overrides = {"hotspot_count": 3, "scatter_std_m": 0.0}
        for init in ("kmeans", "random"):
            parameters = Parameters().with_overrides({**overrides, "deployment.init": init})
            drawn = WorldBatch(parameters, worlds=200, seed=range(200)).draw_topologies()
            assert drawn.target_users.sum(axis=1).max() < 100

    def test_uavs_to_spare_start_where_most_users_share_a_uav(self):
        # 9, 6 and 1 users, and 2 near the GBS. Users per UAV, UAV by UAV: 9, 6, 9/2, 3 | 1.
        places = np.array([(300.0, 300.0), (1700.0, 300.0), (300.0, 1700.0), (1010.0, 990.0)])
        users = np.repeat(places, (9, 6, 1, 2), axis=0)
        for seed in range(30):
            found = gbs_aware_kmeans(users, 6, GBS, seed=seed)
            started, uavs = np.unique(found.uav_positions_m.round(6), axis=0, return_counts=True)
            assert dict(zip(map(tuple, started.tolist()), uavs.tolist(), strict=True)) == {
                (300.0, 300.0): 3,
                (1700.0, 300.0): 2,
                (300.0, 1700.0): 1,
            }
            assert found.target_users.sum() == 16

    def test_nobody_forms_no_clusters(self):
        with pytest.raises(ValueError, match="no users"):
            kmeans_centroids(np.empty((0, 2)), 3)


class TestDeploy:
    def test_random_start_keeps_the_distance_and_the_targets_of_the_clustering(self):
        generator = np.random.default_rng(0)
        parameters = Parameters().with_overrides({"init": "random", "min_separation_m": 300.0})
        users = draw_user_positions(parameters.network, generator)
        found = deploy(users, parameters, generator)
        gaps = np.linalg.norm(found.uav_positions_m[:, None] - found.uav_positions_m[None], axis=2)
        assert gaps[~np.eye(6, dtype=bool)].min() >= 300.0
        np.testing.assert_array_equal(
            found.target_users,
            found.labels != np.linalg.norm(found.centroids_m - GBS[:2], axis=1).argmin(),
        )

    def test_no_room(self):
        with pytest.raises(ValueError, match="no room for 50 UAVs"):
            random_start(50, (100.0, 120.0), 90.0, np.random.default_rng(0))

    def test_sensing_error_moves_the_start_but_not_the_users(self):
        exact, blurred = Parameters(), Parameters().with_overrides({"sensing_error_std_m": 150.0})
        users = draw_user_positions(exact.network, np.random.default_rng(0))
        kept = users.copy()
        first = deploy(users, exact, np.random.default_rng(1))
        second = deploy(users, blurred, np.random.default_rng(1))
        np.testing.assert_array_equal(users, kept)
        assert not np.allclose(first.uav_positions_m, second.uav_positions_m)
        assert (second.uav_positions_m >= 0).all() and (second.uav_positions_m <= 2000).all()


class TestUsers:
    def test_thomas_process_has_the_spread_and_the_hotspots_it_was_asked_for(self):
        generator = np.random.default_rng(0)
        # One parent far from the borders: a Gaussian cloud of 150 m.
        users = thomas_cluster_process(20_000, 1, 150.0, (1e6, 1e6), generator)
        np.testing.assert_allclose(users.std(axis=0), 150.0, rtol=0.03)
        for axis in range(2):
            standard = (users[:, axis] - users[:, axis].mean()) / users[:, axis].std()
            assert stats.kstest(standard, "norm").pvalue > 1e-3
        apart = thomas_cluster_process(5000, 5, 0.0, (2000.0, 900.0), generator)
        assert len(np.unique(apart, axis=0)) == 5

    def test_each_parent_is_as_likely_as_any_other(self):
        users = thomas_cluster_process(50_000, 5, 0.0, (2000.0, 2000.0), np.random.default_rng(3))
        counts = np.unique(users, axis=0, return_counts=True)[1]
        assert stats.chisquare(counts).pvalue > 1e-3

    def test_uniform_users_are_uniform(self):
        network = (
            Parameters().with_overrides({"distribution": "uniform", "user_count": 5000}).network
        )
        users = draw_user_positions(network, np.random.default_rng(0))
        for axis in range(2):
            assert stats.kstest(users[:, axis] / 2000.0, "uniform").pvalue > 1e-3

    @given(st.floats(-1e5, 1e5), st.floats(1.0, 5000.0))
    def test_reflection_is_a_walk_between_two_mirrors(self, coordinate_m, area_m):
        folded = reflect_into(coordinate_m, area_m)
        assert 0.0 <= folded <= area_m
        if 0.0 <= coordinate_m <= area_m:
            assert folded == pytest.approx(coordinate_m, abs=1e-9)

    @pytest.mark.parametrize(
        ("coordinate_m", "folded_m", "sign"),
        [(-30.0, 30.0, -1.0), (130.0, 70.0, -1.0), (230.0, 30.0, 1.0), (40.0, 40.0, 1.0)],
    )
    def test_reflection_by_hand(self, coordinate_m, folded_m, sign):
        assert reflect_into(coordinate_m, 100.0) == pytest.approx(folded_m)
        assert reflection_sign(coordinate_m, 100.0) == sign


class TestCounterUniform:
    def test_is_splitmix64(self):
        # First outputs for seed 1234567, as published with the generator.
        published = [6457827717110365317, 3203168211198807973, 9817491932198370423]
        drawn = counter_uniform(np.uint64(1234567), np.arange(3, dtype=np.uint64))
        np.testing.assert_allclose(drawn, [(number >> 11) * 2.0**-53 for number in published])

    @settings(max_examples=20)
    @given(st.integers(0, 2**64 - 1))
    def test_is_uniform_for_any_key(self, key):
        drawn = counter_uniform(np.uint64(key), np.arange(4000, dtype=np.uint64))
        assert drawn.min() >= 0.0 and drawn.max() < 1.0
        assert stats.kstest(drawn, "uniform").pvalue > 1e-6
