"""Offline search over positions and powers for each topology, then loiter: near the ceiling."""

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents.controllers.controller import Actions, act_towards
from orchid_uav.agents.controllers.heuristics import (
    LOITER_RADIUS_M,
    RESTARTS,
    Loiter,
    candidate_starts,
    circle_radius_m,
    repeat_topology,
)
from orchid_uav.envs.metrics import COVERAGE, LOAD_JFI, RATE_JFI, SUM_RATE
from orchid_uav.envs.propulsion import circling_speed_mps, propulsion_power_w, total_power_w
from orchid_uav.envs.reward import energy_efficiency, final_utility
from orchid_uav.envs.world import WorldBatch

Floats = NDArray[np.float64]

EVALUATIONS = 3000
_POPULATION = 32
_CIRCLE_POINTS = 4
"""Points of the circle at which a plan is judged."""
_FIRST_STDS = (0.05, 0.05, 0.25, 0.25)
"""First standard deviations of x, y, altitude and power, each as a share of its range."""


class Planner(Loiter):
    """CMA-ES (Hansen's ``cma``) on the utility of loitering, one search per topology.

    Knows what no UAV does: where all users are, and every link. Plans once, for the users as they
    are at the start. The search begins at the best of the world's own Phase I and some K-Means
    restarts.

    Args:
        evaluations: plans judged per topology, those of the starts counted.
        restarts: K-Means runs over the target users.
        seed: of the restarts and of CMA-ES.
        keeps_targets: as in :class:`BalancedLoiter`; False takes the target users of the best
            restart of Phase I.
        radius_m: of the circles.
    """

    def __init__(
        self,
        evaluations: int = EVALUATIONS,
        restarts: int = RESTARTS,
        seed: int = 0,
        keeps_targets: bool = True,
        radius_m: float = LOITER_RADIUS_M,
    ) -> None:
        super().__init__(radius_m)
        if evaluations < 1 + restarts:
            raise ValueError(
                f"evaluations is {evaluations}: the {1 + restarts} starts need as many"
            )
        self.evaluations = evaluations
        self.restarts = restarts
        self.seed = seed
        self.keeps_targets = keeps_targets
        self.after_each: Callable[[], None] = lambda: None
        """Called whenever one world's plan is made."""

    def begin(self, world: WorldBatch) -> None:
        """Plan for every world, and place its UAVs."""
        judge = _Judge(world, self.radius_m)
        positions_m = world.arrays.positions_m.copy()
        powers_w = world.arrays.transmit_powers_w.copy()
        targets = world.arrays.target_users.copy()
        for index in range(world.world_count):
            starts_m, candidates = candidate_starts(
                world, index, self.restarts, self.seed, self.keeps_targets
            )
            starts = judge.plans_at(starts_m)
            judge.take(world, index)
            utilities = [
                judge.utilities(start[None], target_users)[0]
                for start, target_users in zip(starts, candidates, strict=True)
            ]
            best = int(np.argmax(utilities))
            targets[index] = candidates[best]
            plan = self._search(judge, starts[best], utilities[best], candidates[best])
            positions_m[index], powers_w[index] = (part[0] for part in judge.placements(plan[None]))
            self.after_each()
        world.place(positions_m, powers_w, targets)
        super().begin(world)

    def act(self, world: WorldBatch) -> Actions:
        """On along the circle, at the altitude and power that were planned."""
        step_m = self.speed_mps * world.parameters.network.slot_s
        return act_towards(world, self._displacement_m(world, step_m))

    def _search(
        self, judge: "_Judge", start: Floats, utility: float, target_users: NDArray[np.bool_]
    ) -> Floats:
        """The best plan found, (N, 4), from a start of known utility."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # cma tells of optional packages that it can do without
            import cma

        plan = start
        generator = np.random.default_rng(self.seed)
        strategy = cma.CMAEvolutionStrategy(
            plan.ravel(),
            1.0,
            {
                "bounds": [0.0, 1.0],
                "CMA_stds": np.tile(_FIRST_STDS, len(plan)),
                "popsize": _POPULATION,
                "randn": lambda *shape: generator.standard_normal(shape),
                "seed": np.nan,  # leaves NumPy's global generator alone
                "verbose": -9,
            },
        )
        left = self.evaluations - 1 - self.restarts
        while left > 0 and not strategy.stop():
            candidates = strategy.ask()[:left]
            found = judge.utilities(np.stack(candidates).reshape(-1, *plan.shape), target_users)
            left -= len(found)
            if left > 0:  # else it may be but a part of a population
                strategy.tell(candidates, (-found).tolist())
            if found.max() > utility:
                plan, utility = candidates[int(found.argmax())].reshape(plan.shape), found.max()
        return plan


class _Judge:
    """Utility of loitering at a plan, on one topology at a time.

    A plan is (N, 4) in [0, 1]: x, y, altitude and power as shares of their ranges.
    """

    def __init__(self, world: WorldBatch, radius_m: float) -> None:
        parameters = world.parameters
        uav, (east_m, north_m) = parameters.uav, parameters.network.area_size_m
        margin_m = circle_radius_m(world, radius_m)
        low = (margin_m, margin_m, uav.min_altitude_m, uav.min_transmit_power_w)
        high = (
            east_m - margin_m,
            north_m - margin_m,
            uav.max_altitude_m,
            uav.max_transmit_power_w,
        )
        self._low, self._high = np.array(low), np.array(high)
        self._range = self._high - self._low
        self._trial = WorldBatch(
            parameters,
            worlds=_POPULATION * _CIRCLE_POINTS,
            seed=0,
            threads=world.threads,
            air_to_ground_path_loss_db=world.air_to_ground_path_loss_db,
        )
        angles = 2.0 * np.pi * np.arange(_CIRCLE_POINTS) / _CIRCLE_POINTS
        self._circle_m = np.zeros((_CIRCLE_POINTS, 3))
        self._circle_m[:, 0] = margin_m * np.cos(angles)
        self._circle_m[:, 1] = margin_m * np.sin(angles)
        speed_mps = circling_speed_mps(parameters)
        self._propulsion_w = world.uav_count * float(
            propulsion_power_w(speed_mps, **parameters.rotor.power_curve())
        )

    def take(self, world: WorldBatch, index: int) -> None:
        """Judge on the topology of one world from now on."""
        self._trial.use_topology(repeat_topology(world, index, self._trial.world_count))

    def plans_at(self, starts_m: Floats) -> Floats:
        """Plans (starts, N, 4) at horizontal positions (starts, N, 2), with full power."""
        uav = self._trial.parameters.uav
        plans = np.empty((*starts_m.shape[:-1], 4))
        plans[..., :2] = starts_m
        plans[..., 2] = uav.initial_altitude_m
        plans[..., 3] = uav.max_transmit_power_w
        degenerate = self._range <= 0.0
        shares = (plans - self._low) / np.where(degenerate, 1.0, self._range)
        return np.clip(shares, 0.0, 1.0)

    def placements(self, plans: Floats) -> tuple[Floats, Floats]:
        """Centres (plans, N, 3) in m and powers (plans, N) in W."""
        values = np.minimum(self._low + plans * self._range, self._high)
        return values[..., :3], values[..., 3]

    def utilities(self, plans: Floats, target_users: NDArray[np.bool_]) -> Floats:
        """Utility (plans,) at training progress 1, a mean over points of the circle.

        Args:
            plans: (plans, N, 4), a population at most.
            target_users: whom the UAVs are there for, (M,).
        """
        count = len(plans)
        padded = np.concatenate([plans, np.repeat(plans[-1:], _POPULATION - count, axis=0)])
        centres_m, powers_w = self.placements(padded)
        positions_m = centres_m[:, None] + self._circle_m[:, None, :]
        self._trial.place(
            positions_m.reshape(-1, *centres_m.shape[1:]),
            np.repeat(powers_w, _CIRCLE_POINTS, axis=0),
            target_users,
        )
        metrics = self._trial.arrays.metrics
        power_w = total_power_w(
            self._propulsion_w, self._trial.arrays.transmit_powers_w.sum(axis=1)
        )
        reward = self._trial.parameters.reward
        utility = final_utility(
            reward,
            self._trial.constants.efficiency_scale_bit_per_joule,
            metrics[:, COVERAGE],
            energy_efficiency(metrics[:, SUM_RATE], power_w, reward.power_epsilon_w),
            metrics[:, LOAD_JFI],
            metrics[:, RATE_JFI],
        )
        return utility.reshape(_POPULATION, _CIRCLE_POINTS).mean(axis=1)[:count]
