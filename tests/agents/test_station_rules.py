"""Rules on stations: best response against brute force, receding horizon, forces."""

import math

import numpy as np
import pytest

from orchid_uav.agents.controllers.best_response import BestResponse
from orchid_uav.agents.controllers.forces import GAINS, Forces, Gains
from orchid_uav.agents.controllers.heuristics import Track
from orchid_uav.agents.controllers.learned import ZeroAction
from orchid_uav.agents.controllers.receding_horizon import RecedingHorizon
from orchid_uav.envs import Parameters, WorldBatch, evaluation_seeds
from orchid_uav.envs.knowledge.counterfactuals import (
    TEMPERATURE,
    judge,
    make_scratch_of_group,
    shifts_m,
)
from orchid_uav.envs.metrics import COLLISIONS, LOAD_JFI, RATE_JFI
from orchid_uav.envs.propulsion import circling_speed_mps
from tests.helpers import independent_network as independent

SMALL = {"network.uav_count": 5, "network.user_count": 40, "uav.flight": "station"}
WALKING = {"network.user_speed_mps": 15.0, "network.heading_hold_s": 20.0}


def begun(worlds: int = 1, seed: int = 0, **overrides) -> WorldBatch:
    parameters = Parameters().with_overrides({**SMALL, **overrides})
    world = WorldBatch(parameters, worlds, evaluation_seeds(seed, worlds))
    world.set_progress(1.0)
    world.reset()
    return world


def fly(method, world: WorldBatch, slots: int) -> np.ndarray:
    """Load JFI + rate JFI, means over slots and worlds."""
    method.begin(world)
    fairness = []
    for _ in range(slots):
        world.step(method.act(world))
        metrics = world.arrays.metrics
        assert (metrics[:, COLLISIONS] == 0).all()
        fairness.append(metrics[:, LOAD_JFI] + metrics[:, RATE_JFI])
    return np.mean(fairness)


def utility_by_hand(world: WorldBatch, uav: int, move_m: np.ndarray, ahead_s: float) -> float:
    """U_total of a UAV and its three nearest after a move, from the scalar oracle."""
    setting, arrays = independent.Setting(), world.arrays
    stations_m = arrays.stations_m[0].copy()
    apart_m = np.linalg.norm(stations_m - stations_m[uav], axis=1)
    group = list(np.argsort(apart_m, kind="stable")[:4])
    users_m = np.clip(
        world.known_users_m[0] + ahead_s * arrays.known_velocities_mps[0].T, 0.0, 2000.0
    )
    users_m = users_m[np.isin(arrays.association[0], group)]
    stations_m[uav] = np.clip(stations_m[uav] + move_m, 40.0, 1960.0)
    efficiencies = {n: [] for n in group}
    for user_m in users_m:
        snr = {
            n: independent.access_snr(
                setting,
                (*stations_m[n], arrays.positions_m[0, n, 2]),
                arrays.transmit_powers_w[0, n],
                tuple(user_m),
            )
            for n in group
        }
        best = max(snr, key=snr.get)
        if snr[best] >= independent.decibel_to_ratio(6.0):
            efficiencies[best].append(math.log2(1.0 + snr[best]))
    rates = []
    for cell in efficiencies.values():
        shares = independent.bandwidth_shares("mmf", cell) if cell else []
        rates += [10e6 * share * one for share, one in zip(shares, cell, strict=True)]
    speed_mps = circling_speed_mps(world.parameters)
    power_w = sum(
        independent.level_propulsion_power_w(setting, speed_mps) + arrays.transmit_powers_w[0, n]
        for n in group
    )
    efficiency = min(sum(rates) / power_w / independent.ee_max(setting), 1.0)
    loads = [float(len(cell)) for cell in efficiencies.values()]
    coverage = len(rates) / len(users_m)
    return 0.5 * (coverage + efficiency + independent.jain(loads) + independent.jain(rates))


def judged(world: WorldBatch, uav: int, ahead_s: float) -> np.ndarray:
    utilities = np.zeros(25)
    scratch = make_scratch_of_group(world.user_count)
    judge(world.constants, world.arrays, 0, uav, shifts_m(), ahead_s, scratch, utilities, None)
    return utilities


class TestBestResponse:
    @pytest.mark.parametrize("seed", [0, 1])
    def test_moves_are_judged_as_the_scalar_oracle_judges_them(self, seed):
        world = begun(seed=seed, **WALKING)
        for _ in range(25):
            world.step(np.zeros((1, 5, 4)))
        for uav in range(5):
            expected = [utility_by_hand(world, uav, move_m, 5.0) for move_m in shifts_m()]
            np.testing.assert_allclose(judged(world, uav, 5.0), expected, rtol=1e-9)

    def test_the_answer_is_the_softmax_mean_towards_which_it_flies(self):
        world = begun(**WALKING)
        method = BestResponse(haste_per_s=0.01)
        method.begin(world)
        wanted_m = method.wanted_moves_m(world)[0]
        for uav in range(5):
            utilities = judged(world, uav, 5.0)
            weights = np.exp((utilities - utilities.max()) / TEMPERATURE)
            expected_m = weights @ shifts_m() / weights.sum()
            np.testing.assert_allclose(wanted_m[uav], expected_m, atol=1e-6)
        actions = method.act(world)
        np.testing.assert_allclose(actions[0, :, :2], wanted_m * 0.01 / 8.0, atol=1e-9)
        hasty = BestResponse(haste_per_s=1e6)
        hasty.begin(world)
        np.testing.assert_allclose(np.linalg.norm(hasty.act(world)[..., :2], axis=-1), 1.0)

    def test_it_is_fairer_than_its_twin_for_users_that_walk_and_that_stand(self):
        for users in ({}, WALKING):
            twin = fly(ZeroAction(), begun(12, **users, **{"deployment.init": "balanced"}), 120)
            found = fly(BestResponse(), begun(12, **users, **{"deployment.init": "balanced"}), 120)
            assert found > twin + 0.01

    def test_a_teacher_sees_the_truth(self):
        blind = {"sensing.flight_error_std_m": 200.0}
        wrong, exact = begun(3, **blind), begun(3)
        teacher, pupil, other = BestResponse(knows_truth=True), BestResponse(), BestResponse()
        for method, world in ((teacher, wrong), (pupil, wrong), (other, exact)):
            method.begin(world)
        np.testing.assert_array_equal(teacher.act(wrong), other.act(exact))
        assert (pupil.act(wrong) != teacher.act(wrong)).any()

    def test_one_that_has_failed_wants_nothing_and_is_asked_nothing(self):
        world = begun(**{"network.failures": ["2@0"]})
        method = BestResponse()
        method.begin(world)
        assert (method.wanted_moves_m(world)[0, 2] == 0.0).all()
        assert np.isfinite(method.act(world)).all()

    def test_threads_change_no_bit(self):
        one, two = begun(60, **WALKING), begun(60, **WALKING)
        two.threads = 3
        found = []
        for world in (one, two):
            method = BestResponse()
            method.begin(world)
            world.step(method.act(world))
            found.append(method.act(world))
        np.testing.assert_array_equal(*found)


class TestRecedingHorizon:
    def test_it_is_fairer_than_its_twin(self):
        twin = fly(ZeroAction(), begun(6, **WALKING, **{"deployment.init": "balanced"}), 60)
        method = RecedingHorizon(trials=200)
        found = fly(method, begun(6, **WALKING, **{"deployment.init": "balanced"}), 60)
        assert found > twin + 0.01

    def test_a_search_never_wants_what_it_expects_to_be_worse(self):
        world = begun(4)
        few, many = RecedingHorizon(trials=1), RecedingHorizon(trials=500)
        fairness = [fly(method, begun(4), 40) for method in (few, many)]
        assert fairness[1] > fairness[0]
        many.begin(world)
        many.act(world)
        apart_m = np.linalg.norm(many._wanted_m[:, :, None] - many._wanted_m[:, None], axis=-1)
        assert (apart_m + 1e9 * np.eye(5) >= 90.0).all()

    def test_a_world_is_searched_alike_whatever_stands_beside_it(self):
        alone, together = begun(1), begun(3)
        found = []
        for world in (alone, together):
            method = RecedingHorizon(trials=50)
            method.begin(world)
            found.append(method.act(world)[0])
        np.testing.assert_array_equal(*found)

    def test_a_fleet_that_has_failed_is_not_searched(self):
        world = begun(**{"network.failures": [f"{uav}@0" for uav in range(5)]})
        method = RecedingHorizon(trials=5)
        method.begin(world)
        assert (method.act(world) == 0.0).all()


class TestForces:
    def test_each_force_by_hand(self):
        world = begun(**{"network.uav_count": 2})
        stations_m, arrays = world.arrays.stations_m[0], world.arrays
        own = [world.users_m[0][arrays.association[0] == uav].mean(axis=0) for uav in range(2)]
        towards = (stations_m[1] - stations_m[0]) / np.linalg.norm(stations_m[1] - stations_m[0])
        mean_load = arrays.loads[0].mean()
        difference = (arrays.loads[0, 1] - arrays.loads[0, 0]) / mean_load
        for gains, expected in (
            (Gains(0.001, 0, 0, 0, 100, 0), 0.001 * (own[0] - stations_m[0])),
            (Gains(0, 0.5, 0, 0, 100, 0), 0.5 * difference * towards),
            (Gains(0, 0, 0, 0, 100, 0), np.zeros(2)),
        ):
            method = Forces(gains)
            method.begin(world)
            np.testing.assert_allclose(method.act(world)[0, 0, :2], expected / 8.0, atol=1e-9)

    def test_those_that_were_found_are_fairer_than_the_twin(self):
        twin = fly(ZeroAction(), begun(12, **WALKING, **{"deployment.init": "balanced"}), 120)
        found = fly(Forces(GAINS), begun(12, **WALKING, **{"deployment.init": "balanced"}), 120)
        assert found > twin + 0.01


@pytest.mark.parametrize("rule", [BestResponse, RecedingHorizon, Forces])
def test_rules_that_move_stations_say_so(rule):
    with pytest.raises(ValueError, match=r"uav\.flight = station"):
        rule().begin(begun(**{"uav.flight": "direct"}))


def test_track_climbs_where_it_is_told_to():
    world = begun(**{"uav.flight": "direct"})
    method = Track(altitude_m=120.0)
    method.begin(world)
    for _ in range(10):
        world.step(method.act(world))
    np.testing.assert_allclose(world.arrays.positions_m[..., 2], 120.0)
