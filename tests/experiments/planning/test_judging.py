"""How sure a plan is, and what keeps it in the air."""

import math

import numpy as np
import pytest

from orchid_uav.envs import Parameters
from orchid_uav.envs.propulsion import propulsion_power_w
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.judging import robustness
from orchid_uav.experiments.planning.judging.endurance import (
    Battery,
    Way,
    endurance_s,
    rotation_of,
)
from orchid_uav.experiments.planning.judging.robustness import check_robustness
from orchid_uav.experiments.planning.judging.served import count_served, weighted_median
from orchid_uav.experiments.planning.model import Budget, Station, Want
from orchid_uav.experiments.planning.network import Service
from orchid_uav.experiments.planning.search import search
from tests.helpers.sites import fleet_and_region, people_at

PARAMETERS = Parameters()


class TestServed:
    def test_people_are_counted_by_their_weights(self):
        people = people_at(0, 4)
        people.weights[:] = [40, 1, 2, 3]
        service = Service(np.array([0, 2, -1, 1]), np.array([1e6, 2e6, 0.0, 5e5]))
        served = count_served(service, people, 2, Want(1e6, 0.9))
        assert served.total == 46 and served.served_by_drones == 43
        assert served.served_by_masts == 1 and served.unserved == 2
        assert served.worst_rate_bps == 0.0 and served.median_rate_bps == 1e6
        assert served.share_above_want == pytest.approx(41 / 46)

    def test_the_median_is_that_of_all_people(self):
        generator = np.random.default_rng(1)
        values, weights = generator.random(31), generator.integers(1, 9, 31)
        everyone = np.sort(np.repeat(values, weights))
        assert weighted_median(values, weights) == everyone[(len(everyone) - 1) // 2]


@pytest.fixture(scope="module")
def planned():
    fleet, region = fleet_and_region(drones=4, people=80)
    plan = search(fleet, region, Budget(evaluations=2000), 0).plan
    names = [f"uav_{number}" for number in range(4)]
    return fleet, region, plan, check_robustness(fleet, region, plan, names, 0, Want(1e6, 0.9))


class TestRobustness:
    def test_the_worst_is_no_better_than_the_mean(self, planned):
        for name in (
            "position_error_50m",
            "position_error_150m",
            "shadowing",
            "walking_10_minutes",
        ):
            figures = getattr(planned[3], name)
            assert figures.draws == 100
            assert figures.share_served_worst <= figures.share_served <= 1.0
            assert figures.worst_rate_bps_worst <= figures.worst_rate_bps
            assert figures.median_rate_bps_worst <= figures.median_rate_bps
            assert figures.share_above_want_worst <= figures.share_above_want <= 1.0

    def test_larger_errors_cost_more(self, planned):
        small, large = planned[3].position_error_50m, planned[3].position_error_150m
        assert large.worst_rate_bps < small.worst_rate_bps

    def test_everybody_walks_as_far_as_said(self, planned, monkeypatch):
        fleet, _, plan, _ = planned
        seen = []
        monkeypatch.setattr(robustness, "_elsewhere", lambda *given: seen.append(given[2]))
        list(robustness._with_walks(fleet, plan, 0))
        walked_m = np.linalg.norm(np.array(seen) - fleet.people.positions_m, axis=2)
        # Ten legs of random headings: the mean square is that of ten lengths, uniform up to 84 m.
        assert (walked_m**2).mean() == pytest.approx(10 * 84.0**2 / 3, rel=0.05)
        assert walked_m.max() <= 840.0

    def test_links_in_sight_are_drawn_as_often_as_the_model_says(self, planned):
        fleet, _, plan, _ = planned
        rates = [service.rates_bps for service in robustness._with_shadowing(fleet, plan, 0)]
        sure = fleet.service(fleet.rank(fleet.receive(plan))).rates_bps
        # The mean over links of both kinds is near the rate of the mean loss, and hardly equal.
        ratio = np.mean(rates) / sure.mean()
        assert 0.7 < ratio < 1.3 and len({rate.tobytes() for rate in rates}) == 100

    def test_what_a_lost_drone_served_is_accounted_for(self, planned):
        fleet, _, _, checked = planned
        lost = checked.one_drone_lost
        assert [one.drone for one in lost.each] == ["uav_0", "uav_1", "uav_2", "uav_3"]
        for one in lost.each:
            assert one.left.total == one.regained.total == fleet.people.total
            taken = sum(one.taken_over.values())
            assert one.drone not in one.taken_over
            assert one.people_before - taken <= one.left.unserved
            assert 0.0 <= one.regained_after_s < 2000.0 * math.sqrt(2) / 8.0
        assert lost.share_served_worst <= lost.share_served
        assert lost.share_served_regained >= lost.share_served - 0.02

    def test_equal_seeds_give_equal_figures(self, planned):
        fleet, region, plan, checked = planned
        names = [one.drone for one in checked.one_drone_lost.each]
        again = check_robustness(fleet, region, plan, names, 0, Want(1e6, 0.9))
        assert again.to_json() == checked.to_json()

    def test_one_drone_alone_cannot_be_replaced(self):
        fleet, region = fleet_and_region(drones=1)
        plan = search(fleet, region, Budget(evaluations=50), 0).plan
        assert check_robustness(fleet, region, plan, ["uav_0"], 0, None).one_drone_lost is None


class TestEndurance:
    STATION = Station("uav_0", 0.0, 0.0, 100.0, 0.2, 40.0, 14.0)

    def test_energy_is_what_is_left_after_way_and_reserve(self):
        way = Way(level_s=120.0, vertical_s=80.0)
        stay_s = endurance_s(PARAMETERS, self.STATION, Battery(500.0, 0.2), way, 15.0)
        factor = math.sqrt(1.0 + (14.0**2 / 40.0 / 9.80665) ** 2)
        station_w = propulsion_power_w(14.0, load_factor=factor) + 0.2
        used_j = 120.0 * propulsion_power_w(15.0) + 80.0 * 394.006
        assert stay_s == pytest.approx((500.0 * 3600 * 0.8 - used_j) / station_w, rel=1e-9)

    def test_hovering_costs_what_the_paper_says(self):
        stay_s = endurance_s(
            PARAMETERS,
            self.STATION._replace(circle_radius_m=0.0, speed_mps=0.0),
            Battery(1000.0, 0.0),
            Way(0, 0),
            15.0,
        )
        assert stay_s == pytest.approx(3.6e6 / (394.006 + 0.2), rel=1e-9)

    def test_a_battery_that_is_too_small_is_an_error(self):
        with pytest.raises(InputError, match="uav_0 cannot stay: a battery of 5 Wh"):
            endurance_s(PARAMETERS, self.STATION, Battery(5.0, 0.2), Way(100.0, 80.0), 15.0)

    def test_rotation_by_hand(self):
        # 50 minutes on station, 5 on the way, 5 for the battery: 1.2 drones a station.
        found = rotation_of([3000.0] * 5, [Way(200.0, 100.0)] * 5, 300.0)
        assert found.drones_for_24_h == 6  # 5 x 1.2
        assert found.batteries_for_24_h == 5 * 29  # 86,400 / 3,000 = 28.8

    def test_one_station_needs_two_drones(self):
        assert rotation_of([80_000.0], [Way(10.0, 10.0)], 60.0).drones_for_24_h == 2
