"""Where circles may be: nowhere near what is forbidden."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import Point, Polygon, box

from orchid_uav.envs import Parameters
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.clusterings import settled
from orchid_uav.experiments.planning.region import backhaul_snr_db, region_of
from tests.helpers.sites import surroundings_of

PARAMETERS = Parameters()
coordinates = st.floats(-1000.0, 3000.0)


class TestRegion:
    @settings(deadline=None)
    @given(
        st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=6), st.integers(0, 99)
    )
    def test_whole_circles_keep_out_of_zones_and_inside_the_area(self, corners, seed):
        zone = Polygon(corners).convex_hull
        surroundings = surroundings_of(no_fly=zone if zone.area else Polygon())
        try:
            region = region_of(surroundings, 40.0, PARAMETERS)
        except InputError:
            assert zone.buffer(50.0).area > 0.5 * surroundings.area.area
            return
        generator = np.random.default_rng(seed)
        for point_m in generator.uniform(-500.0, 2500.0, (20, 2)):
            center_m = region.nearest(point_m)
            circle = Point(center_m).buffer(40.0, 64)
            assert surroundings.area.covers(circle)
            assert not circle.intersects(surroundings.no_fly)

    def test_hardly_more_is_forbidden_than_has_to_be(self):
        region = region_of(surroundings_of(no_fly=box(900, 900, 1100, 1100)), 40.0, PARAMETERS)
        assert region.allowed.bounds == pytest.approx((45, 45, 1955, 1955), abs=0.1)
        assert region.contains(np.array([[854.0, 1000.0], [856.0, 1000.0]])).tolist() == [
            True,
            False,
        ]

    @pytest.mark.parametrize(
        ("changes", "told"),
        [
            ({"area": box(0, 0, 70, 500)}, "no room for circles of 40 m"),
            ({"no_fly": box(-10, -10, 2010, 2010)}, "leave no place"),
            ({"masts": [(40_000.0, 0.0, 30.0)]}, "no mast is near enough"),
        ],
    )
    def test_nowhere_is_an_error_that_says_why(self, changes, told):
        with pytest.raises(InputError, match=told):
            region_of(surroundings_of(**changes), 40.0, PARAMETERS)

    def test_the_backhaul_holds_all_round_the_circle(self):
        # 10 dB at 20 MHz: free space loses 30 + 101 - 10 = 121 dB after some 11 km.
        surroundings = surroundings_of(masts=[(-10_000.0, 1000.0, 30.0)])
        region = region_of(surroundings, 40.0, PARAMETERS)
        assert 500.0 < region.allowed.bounds[2] < 1960.0
        center_m = region.nearest(np.array([2000.0, 1000.0]))
        far_m = math.hypot(center_m[0] + 40.0 + 10_000.0, center_m[1] - 1000.0)
        snr_db = backhaul_snr_db(PARAMETERS, math.hypot(far_m, 120.0 - 30.0))
        assert 10.0 <= snr_db < 10.03


class TestSettled:
    @settings(deadline=None)
    @given(st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=30))
    def test_places_are_allowed_and_apart(self, wanted):
        region = region_of(surroundings_of(), 40.0, PARAMETERS)
        places_m = settled(np.array(wanted), region)
        assert shapely.intersects_xy(region.allowed.buffer(1e-6), places_m).all()
        apart_m = np.linalg.norm(places_m[:, None] - places_m[None], axis=2)
        assert (apart_m[~np.eye(len(wanted), dtype=bool)] >= region.spacing_m - 1e-6).all()

    def test_those_that_are_apart_stay(self):
        region = region_of(surroundings_of(), 40.0, PARAMETERS)
        wanted_m = np.array([[500.0, 500.0], [1500.0, 1500.0]])
        assert settled(wanted_m, region).tolist() == wanted_m.tolist()

    def test_no_room_names_how_many_there_is_room_for(self):
        region = region_of(surroundings_of(side_m=300.0, masts=()), 40.0, PARAMETERS)
        with pytest.raises(
            InputError, match=r"there is room for \d drones 130 m apart, not for 20"
        ):
            settled(np.full((20, 2), 150.0), region)
