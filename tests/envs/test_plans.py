"""Plans judged by compiled code, against the paper's formulas written out number by number."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.envs import Parameters
from orchid_uav.envs.plans.clustering import weighted_centroids
from orchid_uav.envs.plans.network import NOBODY, Ground, Rules
from orchid_uav.envs.plans.service import Ranking, judge_moves, judge_plan, rank, receive, serve
from orchid_uav.envs.reward import energy_efficiency_scale
from tests.helpers.independent_network import (
    Setting,
    dbm_to_watt,
    received_power_w,
)

PARAMETERS = Parameters()
SETTING = Setting()
NOISE_W = dbm_to_watt(-174.0) * 10e6
REQUIRED = 10**0.6


def scene(seed, drones, people, masts, side_m=3000.0, heaviest=5):
    generator = np.random.default_rng(seed)
    positions_m = generator.uniform(0.0, side_m, (people, 2))
    weights = generator.integers(1, heaviest + 1, people)
    masts_m = np.column_stack([generator.uniform(0.0, side_m, (masts, 2)), np.full(masts, 30.0)])
    plan = np.column_stack(
        [
            generator.uniform(0.0, side_m, (drones, 2)),
            generator.uniform(80.0, 120.0, drones),
            generator.uniform(0.1, 0.2, drones),
        ]
    )
    offsets_m = 40.0 * np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    return positions_m, weights, masts_m, plan, offsets_m


def expected(parameters, positions_m, weights, masts_m, plan, offset_m):
    """Server and rate of everybody, and the utility, at one point of the circles."""
    drones = len(plan)
    servers, efficiencies = [], []
    for east_m, north_m in positions_m:
        powers = []
        for x, y, altitude_m, power_w in plan:
            uav_m = (x + offset_m[0], y + offset_m[1], altitude_m)
            powers.append(received_power_w(SETTING, uav_m, power_w, (east_m, north_m)))
        for x, y, height_m in masts_m:
            d = math.sqrt((x - east_m) ** 2 + (y - north_m) ** 2 + height_m**2)
            loss_db = 20 * math.log10(4 * math.pi * 2.4e9 / 299792458.0) + 35 * math.log10(d)
            powers.append(10 ** (-loss_db / 10))
        best = max(range(len(powers)), key=lambda index: powers[index])
        snr = powers[best] / NOISE_W
        servers.append(best if snr >= REQUIRED else NOBODY)
        efficiencies.append(math.log2(1 + snr) if snr >= REQUIRED else 0.0)
    rates = np.zeros(len(servers))
    loads, sums_bps = np.zeros(drones), 0.0
    for cell in range(drones + len(masts_m)):
        members = [person for person, server in enumerate(servers) if server == cell]
        count = sum(weights[person] for person in members)
        inverse = sum(weights[person] / efficiencies[person] for person in members)
        for person in members:
            share = 1 / count
            if parameters.share_rule == "mmf":
                share = 1 / (efficiencies[person] * inverse)
            rates[person] = share * 10e6 * efficiencies[person]
        if cell < drones:
            loads[cell] = count
            sums_bps += sum(weights[person] * rates[person] for person in members)
    total = weights.sum()
    covered = sum(w for w, server in zip(weights, servers, strict=True) if server != NOBODY)
    power_w = 200.0 * drones + plan[:, 3].sum()

    def jain(values):
        squares = (values**2).sum()
        return values.sum() ** 2 / (len(values) * squares) if squares else 0.0

    everyone = np.repeat(rates, weights)
    efficiency = min(sums_bps / power_w / energy_efficiency_scale(parameters), 1.0)
    utility = 0.5 * (covered / total + efficiency + jain(loads) + jain(everyone))
    return np.array(servers), rates, utility


def judged(parameters, positions_m, weights, masts_m, plan, offsets_m, without=NOBODY):
    rules = Rules.of(parameters, len(plan))
    ground = Ground.of(parameters, positions_m, weights, masts_m)
    received_w = np.empty((len(plan), len(offsets_m), len(weights)))
    receive(rules, plan, offsets_m, ground, received_w)
    ranking = Ranking.empty(len(offsets_m), len(weights))
    rank(rules, ground, received_w, NOBODY, ranking)
    servers = np.empty((len(offsets_m), len(weights)), np.int64)
    rates_bps = np.empty(servers.shape)
    serve(rules, ground, ranking, len(plan), without, servers, rates_bps)
    utilities = np.empty(len(offsets_m))
    fleet_w = (200.0 * len(plan), plan[:, 3].sum())
    judge_plan(rules, ground, ranking, len(plan), *fleet_w, utilities)
    return rules, ground, received_w, ranking, servers, rates_bps, utilities


class TestService:
    @pytest.mark.parametrize("masts", [0, 1, 3])
    @pytest.mark.parametrize("shares", ["mmf", "pf"])
    def test_it_is_what_the_formulas_say(self, masts, shares):
        parameters = PARAMETERS.with_overrides({"network.shares": shares})
        positions_m, weights, masts_m, plan, offsets_m = scene(masts, 5, 60, masts, side_m=6000.0)
        found = judged(parameters, positions_m, weights, masts_m, plan, offsets_m)
        servers, rates_bps, utilities = found[4:]
        assert (servers == NOBODY).any()  # so large a place is not served everywhere
        for point, offset_m in enumerate(offsets_m):
            of_formulas = expected(parameters, positions_m, weights, masts_m, plan, offset_m)
            assert servers[point].tolist() == of_formulas[0].tolist()
            assert rates_bps[point] == pytest.approx(of_formulas[1], rel=1e-9)
            assert utilities[point] == pytest.approx(of_formulas[2], rel=1e-9)

    def test_somebody_near_a_mast_is_served_by_it(self):
        plan = np.array([[2000.0, 0.0, 100.0, 0.2]])
        found = judged(
            PARAMETERS,
            [[5.0, 0.0], [2000.0, 0.0]],
            [1, 1],
            [[0.0, 0.0, 30.0]],
            plan,
            np.zeros((1, 2)),
        )
        assert found[4].tolist() == [[1, 0]]

    def test_a_row_that_stands_for_four_is_four_rows(self):
        positions_m, weights, masts_m, plan, offsets_m = scene(3, 4, 30, 1)
        as_one = judged(PARAMETERS, positions_m, weights, masts_m, plan, offsets_m)
        apart = judged(
            PARAMETERS,
            np.repeat(positions_m, weights, axis=0),
            np.ones(weights.sum(), int),
            masts_m,
            plan,
            offsets_m,
        )
        assert as_one[6] == pytest.approx(apart[6], rel=1e-12)
        assert np.repeat(as_one[5], weights, axis=1) == pytest.approx(apart[5], rel=1e-12)

    def test_without_a_drone_is_as_if_it_were_not_there(self):
        positions_m, weights, masts_m, plan, offsets_m = scene(4, 5, 80, 2)
        left_out = judged(PARAMETERS, positions_m, weights, masts_m, plan, offsets_m, without=2)
        others = np.delete(plan, 2, axis=0)
        gone = judged(PARAMETERS, positions_m, weights, masts_m, others, offsets_m)
        assert left_out[5] == pytest.approx(gone[5], rel=1e-12)
        as_before = np.where(gone[4] >= 2, gone[4] + 1, gone[4])  # the later ones move up
        assert left_out[4].tolist() == as_before.tolist()


class TestMoves:
    @settings(deadline=None)  # compiles at the first call
    @given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 40), st.integers(0, 2))
    def test_a_move_is_worth_what_the_moved_plan_is(self, seed, drones, people, masts):
        positions_m, weights, masts_m, plan, offsets_m = scene(seed, drones, people, masts, 5000.0)
        found = judged(PARAMETERS, positions_m, weights, masts_m, plan, offsets_m)
        rules, ground, received_w, ranking = found[:4]
        generator = np.random.default_rng(seed)
        drone = int(generator.integers(drones))
        moves = np.repeat(plan[drone][None], 5, axis=0)
        moves[1:, :2] += generator.normal(0.0, 600.0, (4, 2))
        utilities = np.empty(5)
        others_w = plan[:, 3].sum() - plan[drone, 3]
        judge_moves(
            rules, ground, ranking, drones, drone, moves, offsets_m, 200.0 * drones, others_w,
            utilities,
        )  # fmt: skip
        for move, utility in zip(moves, utilities, strict=True):
            moved = plan.copy()
            moved[drone] = move
            again = judged(PARAMETERS, positions_m, weights, masts_m, moved, offsets_m)
            assert utility == pytest.approx(again[6].mean(), rel=1e-9)
        # And what is kept when a drone moves is what would be made anew.
        moved = plan.copy()
        moved[drone] = moves[-1]
        receive(rules, moves[-1:], offsets_m, ground, received_w[drone : drone + 1])
        rank(rules, ground, received_w, drone, ranking)
        anew = judged(PARAMETERS, positions_m, weights, masts_m, moved, offsets_m)[3]
        assert all((kept == new).all() for kept, new in zip(ranking, anew, strict=True))


class TestClustering:
    def test_weights_pull_centroids(self):
        centroids_m = weighted_centroids(
            np.array([[0.0, 0.0], [10.0, 0.0]]), np.array([3.0, 1.0]), 1, seed=0
        )
        assert centroids_m == pytest.approx(np.array([[2.5, 0.0]]))

    def test_the_heaviest_cluster_comes_first(self):
        positions_m = np.array([[0.0, 0.0], [1000.0, 0.0]])
        centroids_m = weighted_centroids(positions_m, np.array([1.0, 9.0]), 2, seed=0)
        assert centroids_m.tolist() == [[1000.0, 0.0], [0.0, 0.0]]

    def test_fewer_places_than_clusters(self):
        centroids_m = weighted_centroids(np.array([[7.0, 8.0]]), np.array([2.0]), 3, seed=0)
        assert centroids_m.tolist() == [[7.0, 8.0]] * 3
