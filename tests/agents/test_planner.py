"""The planner: what it judges is what a flight gives, and it finds what is better."""

import math

import numpy as np
import pytest

import tests.helpers.independent_network as independent
from orchid_uav.agents.controllers import planner
from orchid_uav.agents.controllers.controller import Controller
from orchid_uav.agents.controllers.heuristics import BalancedLoiter, Loiter, candidate_starts
from orchid_uav.agents.controllers.planner import Planner
from orchid_uav.envs import Parameters, WorldBatch, evaluation_seeds
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.metrics import BOUNDARY_VIOLATIONS, COLLISIONS

SMALL = {"network.uav_count": 3, "network.user_count": 30}


def drawn(worlds: int = 1, overrides: dict | None = None, first: int = 0) -> WorldBatch:
    """Worlds at the start of an episode, on held-out topologies from the ``first`` on."""
    parameters = Parameters().with_overrides(overrides or {})
    seeds = evaluation_seeds(0, first + worlds)[first:]
    world = WorldBatch(parameters, worlds, seeds)
    world.set_progress(1.0)
    world.reset()
    return world


def fly(method: Controller, world: WorldBatch, slots: int) -> np.ndarray:
    """Utility (B,) of a flight."""
    method.begin(world)
    diagnostics = Diagnostics(world)
    for _ in range(slots):
        world.step(method.act(world))
        diagnostics.observe()
    return np.array(
        [diagnostics.episode_metrics(index)["utility"] for index in range(world.world_count)]
    )


class Record:
    """Everything that is judged, world by world."""

    def __init__(self) -> None:
        self.utilities: list[list[float]] = []
        self.plans: list[list[np.ndarray]] = []

    def best(self) -> np.ndarray:
        return np.array([max(world) for world in self.utilities])


@pytest.fixture
def record(monkeypatch):
    take, utilities = planner._Judge.take, planner._Judge.utilities
    made = Record()

    def taken(judge, world, index):
        made.utilities.append([])
        made.plans.append([])
        take(judge, world, index)

    def judged(judge, plans, target_users):
        found = utilities(judge, plans, target_users)
        made.utilities[-1].extend(found.tolist())
        made.plans[-1].extend(plans.copy())
        return found

    monkeypatch.setattr(planner._Judge, "take", taken)
    monkeypatch.setattr(planner._Judge, "utilities", judged)
    return made


def utility_by_hand(
    setting: independent.Setting,
    world: WorldBatch,
    index: int,
    centres_m: list[list[float]],
    powers_w: list[float],
) -> float:
    """Mean over four points of the circles, at the power of the least-power speed."""
    users = world.users_m[index].tolist()
    targets = world.arrays.target_users[index].tolist()
    propulsion_w = len(centres_m) * independent.least_propulsion_power_w(setting)
    total = 0.0
    for dx, dy in ((40.0, 0.0), (0.0, 40.0), (-40.0, 0.0), (0.0, -40.0)):
        uavs = [(x + dx, y + dy, z) for x, y, z in centres_m]
        association = independent.associate(setting, uavs, powers_w, users, targets)
        rates = independent.user_rates_bps(setting, uavs, powers_w, users, association)
        served = [rates[m] for m in range(len(users)) if association[m] >= 0]
        loads = [float(association.count(n)) for n in range(len(uavs))]
        efficiency = sum(served) / (propulsion_w + sum(powers_w)) / independent.ee_max(setting)
        fairness = independent.jain(served) + independent.jain(loads)
        total += 0.5 * (len(served) / sum(targets) + min(efficiency, 1.0) + fairness)
    return total / 4


class TestJudge:
    def place_of(self, plans: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centres in m and powers in W of plans at Table I, by hand."""
        low, high = np.array([40.0, 40.0, 80.0, 0.1]), np.array([1960.0, 1960.0, 120.0, 0.2])
        values = low + plans * (high - low)
        return values[..., :3], values[..., 3]

    @pytest.mark.parametrize(
        ("overrides", "setting"),
        [
            ({}, independent.Setting()),
            ({"objective": "pf"}, independent.Setting(shares="pf")),
            ({"required_snr_db": 20.0}, independent.Setting(required_snr_db=20.0)),
        ],
        ids=["Table I", "equal shares", "not all served"],
    )
    def test_is_exact_at_the_points_that_it_looks_at(self, overrides, setting):
        world = drawn(2, {**SMALL, **overrides})
        judge = planner._Judge(world, 40.0)
        plans = np.random.default_rng(0).uniform(0, 1, (5, 3, 4))
        plans[0], plans[1] = 0.0, 1.0  # in the corners
        for index in range(2):
            judge.take(world, index)
            measured = judge.utilities(plans, world.arrays.target_users[index])
            centres_m, powers_w = self.place_of(plans)
            expected = [
                utility_by_hand(setting, world, index, centre.tolist(), power.tolist())
                for centre, power in zip(centres_m, powers_w, strict=True)
            ]
            np.testing.assert_allclose(measured, expected, rtol=1e-6)

    def test_places_plans_as_shares_of_the_ranges(self):
        judge = planner._Judge(drawn(1, SMALL), 40.0)
        plans = np.random.default_rng(0).uniform(0, 1, (5, 3, 4))
        for measured, expected in zip(judge.placements(plans), self.place_of(plans), strict=True):
            np.testing.assert_allclose(measured, expected)

    def test_a_start_is_a_plan_at_its_place_at_full_power(self):
        judge = planner._Judge(drawn(1, SMALL), 40.0)
        starts_m = np.array([[[700.0, 30.0], [1999.0, 1000.0], [50.0, 60.0]]])
        centres_m, powers_w = judge.placements(judge.plans_at(starts_m))
        expected = [[[700.0, 40.0, 100.0], [1960.0, 1000.0, 100.0], [50.0, 60.0, 100.0]]]
        np.testing.assert_allclose(centres_m, expected)
        np.testing.assert_allclose(powers_w, 0.2)

    def test_judges_each_plan_alone(self):
        world = drawn(1, SMALL)
        judge = planner._Judge(world, 40.0)
        judge.take(world, 0)
        targets = world.arrays.target_users[0]
        plans = np.random.default_rng(0).uniform(0, 1, (32, 3, 4))
        together = judge.utilities(plans, targets)
        for index in (0, 7, 31):
            assert judge.utilities(plans[index][None], targets) == together[index]
        np.testing.assert_array_equal(judge.utilities(plans[::-1], targets), together[::-1])

    @pytest.mark.parametrize("overrides", [{}, {"objective": "pf"}, {"uav_count": 4}])
    def test_foretells_the_flight(self, record, overrides):
        world = drawn(4, overrides)
        flown = fly(Planner(200), world, 200)
        np.testing.assert_allclose(flown, record.best(), atol=1e-2)
        assert world.arrays.episode_sums[:, 1 + COLLISIONS].sum() == 0
        assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0


class TestSearch:
    def placed_plans(self, world: WorldBatch) -> np.ndarray:
        """The plans (B, N, 4) that the UAVs were placed at, at Table I."""
        values = np.concatenate(
            [world.arrays.positions_m, world.arrays.transmit_powers_w[..., None]], axis=-1
        )
        return (values - (40.0, 40.0, 80.0, 0.1)) / (1920.0, 1920.0, 40.0, 0.1)

    def test_takes_the_best_that_it_has_judged(self, record):
        world = drawn(3, SMALL)
        Planner(150, restarts=10).begin(world)
        for index, plan in enumerate(self.placed_plans(world)):
            best = int(np.argmax(record.utilities[index]))
            np.testing.assert_allclose(plan, record.plans[index][best], atol=1e-12)

    @pytest.mark.parametrize("keeps_targets", [True, False])
    def test_is_never_worse_than_the_best_start(self, keeps_targets):
        world = drawn(4)
        own_targets = world.arrays.target_users.copy()
        judge = planner._Judge(world, 40.0)
        starts, planned = [], []
        for index in range(4):
            starts_m, candidates = candidate_starts(world, index, 10, 0, keeps_targets)
            judge.take(world, index)
            plans = judge.plans_at(starts_m)
            judged = [
                judge.utilities(plan[None], targets)[0]
                for plan, targets in zip(plans, candidates, strict=True)
            ]
            starts.append(max(judged))
        Planner(60, restarts=10, keeps_targets=keeps_targets).begin(world)
        for index, plan in enumerate(np.clip(self.placed_plans(world), 0.0, 1.0)):
            judge.take(world, index)
            planned.append(judge.utilities(plan[None], world.arrays.target_users[index])[0])
        assert (np.array(planned) >= np.array(starts) - 1e-9).all()
        assert (np.array(planned) > np.array(starts) + 1e-4).any()
        assert np.array_equal(world.arrays.target_users, own_targets) == keeps_targets

    def test_a_larger_budget_judges_the_same_and_then_more(self, record):
        for evaluations in (64, 128, 256):
            Planner(evaluations, restarts=4).begin(drawn(2, SMALL))
        best = record.best().reshape(3, 2)
        assert (best[0] <= best[1]).all() and (best[1] <= best[2]).all()
        assert (best[0] < best[2]).all()
        for index in range(2):
            small, middle, large = record.utilities[index::2]
            assert large[: len(middle)] == middle and middle[: len(small)] == small
            assert len(small) < len(middle) < len(large)

    @pytest.mark.parametrize(
        ("evaluations", "restarts"),
        [
            (1, 0),
            (5, 4),
            (5 + 2 * 32, 4),
            (60, 4),
        ],
    )
    def test_judges_no_more_than_it_may(self, record, evaluations, restarts):
        Planner(evaluations, restarts).begin(drawn(2, SMALL))
        assert [len(judged) for judged in record.utilities] == [evaluations] * 2

    @pytest.mark.parametrize(("evaluations", "restarts"), [(30, 30), (0, 0), (-5, 0)])
    def test_refuses_a_budget_that_the_starts_use_up(self, evaluations, restarts):
        with pytest.raises(ValueError, match=f"the {1 + restarts} starts need as many"):
            Planner(evaluations, restarts)

    def test_judges_only_what_lies_within_the_ranges(self, record):
        Planner(200, restarts=4).begin(drawn(2, SMALL))
        plans = np.array(record.plans)
        assert plans.min() >= 0.0 and plans.max() <= 1.0

    def test_without_search_is_the_best_start_at_full_power(self):
        world = drawn(3)
        own_m = world.arrays.positions_m.copy()
        Planner(1, restarts=0).begin(world)
        expected_m = np.clip(own_m, (40.0, 40.0, 80.0), (1960.0, 1960.0, 120.0))
        np.testing.assert_allclose(world.arrays.positions_m, expected_m, atol=1e-9)
        np.testing.assert_allclose(world.arrays.transmit_powers_w, 0.2)


class TestRepeatability:
    def plan(self, world: WorldBatch, **options: int) -> tuple[np.ndarray, np.ndarray]:
        Planner(100, restarts=4, **options).begin(world)
        return world.arrays.positions_m.copy(), world.arrays.transmit_powers_w.copy()

    def test_the_same_seed_gives_the_same_plan_and_another_another(self):
        first, again = (self.plan(drawn(2, SMALL)) for _ in range(2))
        other = self.plan(drawn(2, SMALL), seed=1)
        for one, two, three in zip(first, again, other, strict=True):
            np.testing.assert_array_equal(one, two)
            assert (one != three).any()

    def test_numpys_global_generator_neither_matters_nor_moves(self):
        plans = []
        for seed in (1, 2):
            np.random.seed(seed)  # noqa: NPY002
            before = np.random.get_state()  # noqa: NPY002
            plans.append(self.plan(drawn(1, SMALL)))
            after = np.random.get_state()  # noqa: NPY002
            assert before[0] == after[0] and before[2:] == after[2:]
            np.testing.assert_array_equal(before[1], after[1])
        for one, two in zip(*plans, strict=True):
            np.testing.assert_array_equal(one, two)

    @pytest.mark.parametrize("keeps_targets", [True, False])
    def test_a_world_gets_the_same_plan_alone_and_in_a_batch(self, keeps_targets):
        together = self.plan(drawn(3, SMALL), keeps_targets=keeps_targets)
        for index in range(3):
            alone = self.plan(drawn(1, SMALL, first=index), keeps_targets=keeps_targets)
            for one, all_worlds in zip(alone, together, strict=True):
                np.testing.assert_array_equal(one[0], all_worlds[index])

    def test_planning_leaves_users_and_the_walk_alone(self):
        planned, untouched = (drawn(2, {**SMALL, "network.user_speed_mps": 10.0}) for _ in range(2))
        fly(Planner(40, restarts=4), planned, 5)
        fly(Loiter(), untouched, 5)
        np.testing.assert_array_equal(
            planned.arrays.user_coordinates_m, untouched.arrays.user_coordinates_m
        )
        np.testing.assert_array_equal(planned.gbs_rates_bps(), untouched.gbs_rates_bps())


class TestFlight:
    def test_keeps_altitude_power_radius_and_speed(self):
        world = drawn(2, SMALL)
        method = Planner(100, restarts=4)
        method.begin(world)
        altitudes_m = world.arrays.positions_m[..., 2].copy()
        powers_w = world.arrays.transmit_powers_w.copy()
        assert np.ptp(altitudes_m) > 0.0
        for _ in range(30):
            world.step(method.act(world))
        np.testing.assert_array_equal(world.arrays.positions_m[..., 2], altitudes_m)
        np.testing.assert_array_equal(world.arrays.transmit_powers_w, powers_w)
        distances_m = np.linalg.norm(world.arrays.positions_m[..., :2] - method.centres_m, axis=-1)
        np.testing.assert_allclose(distances_m, 40.0, atol=1e-6)
        speeds_mps = np.linalg.norm(world.arrays.velocities_mps, axis=-1)
        np.testing.assert_allclose(speeds_mps, 14.25, atol=0.05)

    def test_beats_the_rules_on_static_users(self):
        planned = fly(Planner(600), drawn(20), 60)
        balanced = fly(BalancedLoiter(), drawn(20), 60)
        plain = fly(Loiter(), drawn(20), 60)
        assert (planned > balanced).sum() >= 19
        assert (planned > plain).sum() >= 19
        assert planned.mean() > balanced.mean() > plain.mean()


class TestOutOfTheOrdinary:
    @pytest.mark.parametrize(
        "overrides",
        [
            {"uav_count": 1, "user_count": 2},
            {"uav_count": 1, "user_count": 20, "user_speed_mps": 5.0},
            {"uav_count": 5, "user_count": 6},
            {"min_altitude_m": 100.0, "max_altitude_m": 100.0},
            {"min_transmit_power_w": 0.15, "max_transmit_power_w": 0.15},
            {"area_m": 80.0, "uav_count": 2},
            {"displacement_scale_m": (0.0, 15.0, 5.0)},
            {"required_snr_db": 80.0},
            {"min_altitude_m": 10.1, "initial_altitude_m": 26.2, "max_altitude_m": 26.2},
            {"min_transmit_power_w": 0.15, "max_transmit_power_w": 0.45},
        ],
        ids=lambda overrides: ", ".join(f"{key}={value}" for key, value in overrides.items()),
    )
    def test_is_planned_and_flown_within_the_limits(self, overrides):
        world = drawn(2, {"user_count": 30, **overrides})
        utility = fly(Planner(80, restarts=4), world, 10)
        assert np.isfinite(utility).all()
        uav, positions_m = world.parameters.uav, world.arrays.positions_m
        assert positions_m[..., :2].min() >= 0.0
        assert positions_m[..., :2].max() <= world.parameters.network.area_m
        assert positions_m[..., 2].min() >= uav.min_altitude_m
        assert positions_m[..., 2].max() <= uav.max_altitude_m
        assert world.arrays.transmit_powers_w.min() >= uav.min_transmit_power_w
        assert world.arrays.transmit_powers_w.max() <= uav.max_transmit_power_w
        assert world.arrays.episode_sums[:, 1 + BOUNDARY_VIOLATIONS].sum() == 0

    def test_nobody_to_serve(self):
        world = drawn(1, SMALL)
        world.place(world.arrays.positions_m, target_users=np.zeros((1, 30)))
        # Coverage alone counts, at 0.5: nobody is left behind, nothing is transmitted to anyone.
        assert fly(Planner(80, restarts=4), world, 5) == pytest.approx(0.5)

    def test_one_uav_above_one_user_finds_the_lowest_altitude(self):
        users_m = [[500.0, 500.0], [1000.0, 1000.0]]
        parameters = Parameters().with_overrides({"uav_count": 1})
        world = WorldBatch(parameters, 1, 0, users_m)
        world.reset()
        world.place([[[500.0, 500.0, 100.0]]], target_users=[[True, False]])
        Planner(600, restarts=4).begin(world)
        x_m, y_m, z_m = world.arrays.positions_m[0, 0]
        assert math.hypot(x_m - 500.0, y_m - 500.0) < 2.0
        assert z_m == pytest.approx(80.0, abs=0.5)
