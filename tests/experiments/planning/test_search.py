"""The planner's search."""

import time

import numpy as np
import pytest

from orchid_uav.experiments.planning.clusterings import best_clustering
from orchid_uav.experiments.planning.model import Budget
from orchid_uav.experiments.planning.search import search
from tests.helpers.sites import fleet_and_region


def check(fleet, region, plan):
    assert region.contains(plan[:, :2]).all()
    apart_m = np.linalg.norm(plan[:, None, :2] - plan[None, :, :2], axis=2)
    np.fill_diagonal(apart_m, np.inf)
    assert apart_m.min() >= region.spacing_m
    uav = fleet.parameters.uav
    assert (plan[:, 2] >= region.lowest_m).all() and (plan[:, 2] <= region.highest_m).all()
    assert (plan[:, 3] >= uav.min_transmit_power_w).all()
    assert (plan[:, 3] <= uav.max_transmit_power_w).all()


class TestSearch:
    def test_equal_numbers_of_evaluations_give_equal_plans(self):
        fleet, region = fleet_and_region()
        first = search(fleet, region, Budget(evaluations=3000), seed=3)
        again = search(fleet, region, Budget(evaluations=3000), seed=3)
        assert first.plan.tobytes() == again.plan.tobytes()
        assert first.evaluations == again.evaluations == 3000
        other = search(fleet, region, Budget(evaluations=3000), seed=4)
        assert other.plan.tobytes() != first.plan.tobytes()

    def test_what_seconds_found_the_recorded_number_finds_again(self):
        fleet, region = fleet_and_region()
        timed = search(fleet, region, Budget(seconds=0.3), seed=1)
        again = search(fleet, region, Budget(evaluations=timed.evaluations), seed=1)
        assert again.plan.tobytes() == timed.plan.tobytes()
        assert again.utility == timed.utility

    def test_seconds_do_not_count_what_is_compiled_at_the_first_move(self, monkeypatch):
        fleet, region = fleet_and_region()
        _, _, clusterings = best_clustering(fleet, region, 0)
        judge, calls = fleet.utilities_of_moves, []

        def slow_at_first(*arguments):
            calls.append(arguments)
            if len(calls) == 1:
                time.sleep(0.6)
            return judge(*arguments)

        monkeypatch.setattr(fleet, "utilities_of_moves", slow_at_first)
        found = search(fleet, region, Budget(seconds=0.5), 0)
        assert len(calls) > 1
        assert found.evaluations > clusterings

    @pytest.mark.parametrize("drones", [1, 2, 7])
    def test_it_is_never_worse_than_the_clusterings_and_keeps_all_limits(self, drones):
        fleet, region = fleet_and_region(drones=drones)
        started, utility, count = best_clustering(fleet, region, 0)
        check(fleet, region, started)
        found = search(fleet, region, Budget(evaluations=4000), 0)
        check(fleet, region, found.plan)
        assert found.utility > utility and count < 4000
        assert fleet.utility(found.plan) == pytest.approx(found.utility, rel=1e-9)

    def test_a_longer_search_finds_nothing_worse(self):
        fleet, region = fleet_and_region(seed=5, drones=5)
        utilities = [
            search(fleet, region, Budget(evaluations=count), 0).utility
            for count in (100, 1000, 8000)
        ]
        assert utilities == sorted(utilities)

    def test_only_those_that_may_move_do(self):
        fleet, region = fleet_and_region(drones=5)
        start, _, _ = best_clustering(fleet, region, 0)
        found = search(fleet, region, Budget(evaluations=600), 0, start=start, movers=[1, 3])
        moved = (found.plan != start).any(axis=1)
        assert moved.any() and not moved[[0, 2, 4]].any()

    def test_it_finds_the_best_place_for_one_drone(self):
        # One group of people and one drone that hovers: a grid of places knows no better one.
        fleet, region = fleet_and_region(drones=1, people=25, radius_m=0.0, masts=())
        found = search(fleet, region, Budget(evaluations=3000), 0)
        ticks_m = np.arange(20.0, 2000.0, 20.0)
        grid = np.array([[x, y, 120.0, 0.2] for x in ticks_m for y in ticks_m])
        ranking = fleet.rank(fleet.receive(grid[:1]))
        best = fleet.utilities_of_moves(grid[:1], ranking, 0, grid).max()
        assert found.utility >= best - 1e-3

    def test_progress_is_told_up_to_the_end(self):
        told = []
        fleet, region = fleet_and_region()
        search(fleet, region, Budget(evaluations=500), 0, lambda *one: told.append(one))
        shares, utilities = zip(*told, strict=True)
        assert list(shares) == sorted(shares) and list(utilities) == sorted(utilities)
        assert shares[-1] > 0.9
