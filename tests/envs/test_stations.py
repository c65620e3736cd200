"""Station flight: how stations move and keep apart, and how UAVs circle them (M38)."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from orchid_uav.envs import Parameters, WorldBatch, parallel_env
from orchid_uav.envs.kinematics import chord, circling_displacement_m
from orchid_uav.envs.propulsion import circling_speed_mps
from orchid_uav.envs.starts.stations import greatest_spacing_m, hexagonal_grid, spread_out

STATIONS = {"uav.flight": "station", "network.user_count": 30}
FAR = 1e9


def begun(worlds: int = 1, seed: int = 0, **overrides) -> WorldBatch:
    world = WorldBatch(Parameters().with_overrides({**STATIONS, **overrides}), worlds, seed)
    world.reset()
    return world


def distances_m(places_m: np.ndarray) -> np.ndarray:
    """Between all pairs, (..., N, N); far from itself."""
    gaps_m = places_m[..., :, None, :] - places_m[..., None, :, :]
    return np.linalg.norm(gaps_m, axis=-1) + FAR * np.eye(places_m.shape[-2])


def east(world: WorldBatch, share: float = 1.0) -> np.ndarray:
    actions = np.zeros((world.world_count, world.uav_count, 4))
    actions[..., 0] = share
    return actions


class TestStations:
    def test_their_velocity_is_low_passed_and_limited(self):
        world = begun(**{"network.uav_count": 1, "network.area_m": 5000.0})
        world.place(np.array([[[1000.0, 2500.0, 100.0]]]))
        seen = []
        for _ in range(3):
            world.step(east(world))
            seen.append(world.arrays.stations_m[0, 0].tolist())
        # 8 m/s, of which the low-pass lets through 1/2, 3/4, 7/8.
        np.testing.assert_allclose(seen, [[1004, 2500], [1010, 2500], [1017, 2500]], atol=1e-9)
        actions = east(world)
        actions[..., 1] = 1.0  # the diagonal is no faster
        for _ in range(60):
            world.step(actions)
        speed_mps = np.linalg.norm(world.arrays.station_velocities_mps)
        assert speed_mps == pytest.approx(8.0, abs=1e-6)

    def test_zero_actions_leave_them_where_they_are(self):
        world = begun(3)
        before_m = world.arrays.stations_m.copy()
        for _ in range(20):
            world.step(east(world, 0.0))
        assert (world.arrays.stations_m == before_m).all()

    @settings(max_examples=25, deadline=None)
    @given(
        st.integers(2, 12),
        st.integers(0, 2**32 - 1),
        st.sampled_from([90.0, 200.0]),
        st.sampled_from([0.0, 0.5, 0.9]),
    )
    def test_they_keep_their_distance_whatever_the_actions_are(
        self, uavs, seed, spacing_m, smoothing
    ):
        world = begun(
            2,
            seed,
            **{
                "network.uav_count": uavs,
                "network.area_m": 1000.0,
                "uav.station.centre_spacing_m": spacing_m,
                "uav.station.smoothing": smoothing,
                "uav.station.speed_limit_mps": 15.0,
            },
        )
        generator = np.random.default_rng(seed)
        for slot in range(40):
            if slot % 10 == 0:  # all towards one place, so that they meet
                place_m = generator.uniform(0.0, 1000.0, 2)
            actions = np.zeros((2, uavs, 4))
            actions[..., :2] = np.sign(place_m - world.arrays.stations_m)
            world.step(actions)
            assert distances_m(world.arrays.stations_m).min() >= spacing_m * (1 - 1e-9)
            assert (world.arrays.stations_m >= 40.0).all()
            assert (world.arrays.stations_m <= 960.0).all()

    def test_one_that_is_in_the_way_is_passed_along_its_side(self):
        world = begun(**{"network.uav_count": 2, "network.area_m": 3000.0})
        world.place(np.array([[[1000.0, 1500.0, 100.0], [1100.0, 1510.0, 100.0]]]))
        actions = east(world)
        actions[0, 1, 0] = 0.0  # the other one stays
        for _ in range(150):
            world.step(actions)
        assert world.arrays.stations_m[0, 0, 0] > 1500.0

    def test_starts_that_are_too_near_are_put_apart_and_it_is_told(self):
        world = begun(**{"network.uav_count": 3})
        wanted_m = np.array([[[500.0, 500.0, 100.0], [500.0, 500.0, 100.0], [900.0, 500.0, 100.0]]])
        world.place(wanted_m)
        assert distances_m(world.arrays.stations_m).min() >= 90.0
        np.testing.assert_allclose(world.start_shift_m[0], [45.0, 45.0, 0.0], atol=1e-3)
        assert (world.arrays.positions_m[..., :2] == world.arrays.stations_m).all()


class TestAutopilot:
    def test_it_circles_at_120_m_with_full_power_at_the_speed_of_least_power(self):
        world = begun(4)
        for _ in range(30):
            world.step(east(world, 0.0))
        arrays = world.arrays
        radii_m = np.linalg.norm(arrays.positions_m[..., :2] - arrays.stations_m, axis=-1)
        np.testing.assert_allclose(radii_m, 40.0, atol=1e-6)
        np.testing.assert_allclose(arrays.positions_m[..., 2], 120.0)
        np.testing.assert_allclose(arrays.transmit_powers_w, 0.2)
        speeds_mps = np.linalg.norm(arrays.velocities_mps, axis=-1)
        np.testing.assert_allclose(speeds_mps, circling_speed_mps(world.parameters), atol=1e-6)

    def test_it_keeps_its_circle_and_nearly_its_air_speed_while_the_station_moves(self):
        world = begun(**{"network.uav_count": 1, "network.area_m": 9000.0})
        world.place(np.array([[[1000.0, 2500.0, 100.0]]]))
        fastest_mps = circling_speed_mps(world.parameters)
        for slot in range(150):
            world.step(east(world))
            speed_mps = np.linalg.norm(world.arrays.velocities_mps[0, 0])
            away_m = world.arrays.positions_m[0, 0, :2] - world.arrays.stations_m[0, 0]
            if slot > 20:
                assert 0.9 * fastest_mps < speed_mps < fastest_mps + 1e-6
                assert 35.0 < np.linalg.norm(away_m) < 45.0

    def test_altitude_and_power_may_be_left_to_the_actions(self):
        free = {"uav.station.altitude_m": None, "uav.station.transmit_power_w": None}
        world = begun(**free)
        actions = east(world, 0.0)
        actions[..., 2], actions[..., 3] = 0.2, -0.5
        world.step(actions)
        np.testing.assert_allclose(world.arrays.positions_m[..., 2], 101.0)
        np.testing.assert_allclose(world.arrays.transmit_powers_w, 0.145)

    def test_the_climb_gets_what_the_circle_leaves_of_the_speed(self):
        world = begun(**{"uav.max_speed_mps": 9.0})
        world.step(east(world, 0.0))
        assert np.linalg.norm(world.arrays.velocities_mps, axis=-1).max() <= 9.0 * (1 + 1e-9)

    def test_no_uavs_collide_where_stations_press_against_each_other(self):
        world = begun(20, **{"network.uav_count": 8, "network.area_m": 1200.0})
        for _ in range(200):
            actions = np.zeros((20, 8, 4))
            actions[..., :2] = np.sign(600.0 - world.arrays.stations_m)
            world.step(actions)
        collisions = [world.episode_metrics(index)["collisions"] for index in range(20)]
        assert max(collisions) == 0


class TestChord:
    def test_the_compiled_equation_is_that_of_arrays(self):
        generator = np.random.default_rng(0)
        x_m, y_m = generator.uniform(-90, 90, (2, 50))
        arguments = (40.0, *chord(40.0, 14.0))
        together = circling_displacement_m(x_m, y_m, *arguments)
        one_by_one = [
            circling_displacement_m(x, y, *arguments) for x, y in zip(x_m, y_m, strict=True)
        ]
        np.testing.assert_array_equal(np.stack(together, axis=1), one_by_one)


class TestSpreading:
    @settings(max_examples=60, deadline=None)
    @given(
        st.integers(1, 40),
        st.integers(0, 2**32 - 1),
        st.sampled_from([1.0, 50.0, 400.0]),
        st.sampled_from([(900.0, 900.0), (1700.0, 400.0), (100.0, 5000.0)]),
    )
    def test_places_are_apart_and_inside_or_it_is_told(self, count, seed, spread_m, high_m):
        wanted_m = np.random.default_rng(seed).normal(500.0, spread_m, (count, 2))
        low_m = (100.0, 100.0)
        sides_m = (high_m[0] - 100.0, high_m[1] - 100.0)
        if greatest_spacing_m(count, 150.0, sides_m) < 150.0:
            with pytest.raises(ValueError, match="no room for"):
                spread_out(wanted_m, 150.0, low_m, high_m)
            return
        places_m = spread_out(wanted_m, 150.0, low_m, high_m)
        assert distances_m(places_m).min() >= 150.0
        assert (places_m >= low_m).all()
        assert (places_m <= high_m).all()

    def test_what_is_far_enough_apart_stays(self):
        corners_m = (0.0, 0.0), (500.0, 300.0)
        wanted_m = hexagonal_grid(100.0, *corners_m)
        assert (spread_out(wanted_m, 99.0, *corners_m) == wanted_m).all()

    def test_a_grid_by_hand(self):
        height_m = 100.0 * 0.75**0.5
        grid_m = hexagonal_grid(100.0, (0.0, 0.0), (120.0, 120.0))
        np.testing.assert_allclose(grid_m, [(0, 0), (100, 0), (50, height_m)])
        row_m = hexagonal_grid(100.0, (0.0, 7.0), (320.0, 7.0))
        np.testing.assert_allclose(row_m, [(0, 7), (100, 7), (200, 7), (300, 7)])

    @pytest.mark.parametrize(
        ("stations", "sides_m"),
        [
            (9, (170.0, 170.0)),
            (2, (20.0, 20.0)),
            (500, (1920.0, 1920.0)),
            (500, (9000.0, 400.0)),
            (9, (0.0, 700.0)),
        ],
    )
    def test_where_there_is_no_room_the_spacing_is_the_greatest_of_a_grid(self, stations, sides_m):
        found_m = greatest_spacing_m(stations, 500.0, sides_m)
        assert 0.0 < found_m < 500.0
        wanted_m = np.tile(0.5 * np.array(sides_m), (stations, 1))
        places_m = spread_out(wanted_m, found_m, (0.0, 0.0), sides_m)
        assert distances_m(places_m).min() >= found_m
        assert len(hexagonal_grid(1.01 * found_m, (0.0, 0.0), sides_m)) < stations

    @settings(deadline=None)
    @given(st.floats(0.0, 5000.0), st.floats(0.0, 5000.0), st.floats(1.0, 200.0))
    def test_where_no_grid_is_looked_at_a_thousand_have_room(self, east_m, north_m, spacing_m):
        assume(max(east_m, north_m, east_m * north_m / spacing_m) < 1e5)
        if greatest_spacing_m(1000, spacing_m, (east_m, north_m)) == spacing_m:
            grid_m = hexagonal_grid(spacing_m * (1.0 + 1e-9), (0.0, 0.0), (east_m, north_m))
            assert len(grid_m) >= 1000

    def test_all_of_a_point_is_no_room(self):
        assert greatest_spacing_m(3, 90.0, (0.0, 0.0)) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("overrides", "limits"),
    [
        ({"uav.station.altitude_m": 130.0}, (120.0, 0.2, 8.0)),
        ({"uav.max_altitude_m": 110.0, "uav.max_transmit_power_w": 0.18}, (110.0, 0.18, 8.0)),
        ({"uav.station.speed_limit_mps": 20.0}, (120.0, 0.2, 15.0)),
    ],
)
def test_what_uavs_cannot_fly_is_as_near_as_they_can(overrides, limits):
    world = begun(**overrides)
    for _ in range(60):
        world.step(east(world))
    arrays = world.arrays
    np.testing.assert_allclose(arrays.positions_m[..., 2], limits[0])
    np.testing.assert_allclose(arrays.transmit_powers_w, limits[1])
    assert world.constants.station_speed_limit_mps == limits[2]


def test_every_interface_flies_stations():
    env = parallel_env(uavs=3, users=20, flight="station", observation="informed")
    observations, _ = env.reset(seed=0)
    actions = {agent: np.array([1.0, 0.0, 0.0, 0.0], np.float32) for agent in env.agents}
    for _ in range(3):
        observations, *_ = env.step(actions)
    for agent, seen in observations.items():
        assert env.observation_space(agent).contains(seen)
    assert (env.world.arrays.station_velocities_mps[0, :, 0] > 0.0).any()


def test_a_state_goes_on_bit_for_bit():
    sensed = {"sensing.delay_s": 5.0, "sensing.flight_error_std_m": 50.0}
    moving = {"network.user_speed_mps": 10.0, "network.failures": ["1@8-14"]}
    first = begun(2, **sensed, **moving)
    actions = np.random.default_rng(0).uniform(-1, 1, (30, 2, first.uav_count, 4))
    for slot in range(10):
        first.step(actions[slot])
    document, arrays = first.state()
    second = begun(2, 7, **sensed, **moving)
    second.restore(document, arrays)
    for slot in range(10, 20):
        first.step(actions[slot])
        second.step(actions[slot])
    for name, array in first.arrays._asdict().items():
        np.testing.assert_array_equal(array, getattr(second.arrays, name), name)
    np.testing.assert_array_equal(first.informed_observations(), second.informed_observations())
