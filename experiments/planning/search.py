"""The planner: one drone after the other is moved to where the plan gets better.

Moving one drone changes what people receive of it alone, so that a move is judged without looking
at the other drones' links again. That makes a move so cheap that this beats CMA-ES over all
coordinates at once from a handful of drones on (``docs/planning.md``).
"""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.planning.clusterings import best_clustering
from orchid_uav.experiments.planning.model import Budget, Floats
from orchid_uav.experiments.planning.network import Fleet
from orchid_uav.experiments.planning.region import Region

_LOCAL, _WIDE, _ELSEWHERE = 8, 2, 2
"""Moves that are tried for a drone at once: near its place, farther, and to people anywhere."""
_WIDE_FACTOR = 5.0
_GROWTH, _SHRINKAGE = 1.4, 0.8
_LEAST_STEP_M = 1.0
_FIRST_STEP = 0.25
"""Of the mean distance of drones, and of the ranges of altitude and power."""
_LEAST_GAIN = 1e-9


class Found(NamedTuple):
    """The best plan of a search."""

    plan: Floats
    """(N, 4): east, north, altitude, transmit power."""
    utility: float
    evaluations: int


Progress = Callable[[float, float], None]
"""Is told the share of the budget that is used, and the best utility."""


def search(
    fleet: Fleet,
    region: Region,
    budget: Budget,
    seed: int,
    progress: Progress = lambda share, utility: None,
    start: Floats | None = None,
    movers: Sequence[int] | None = None,
) -> Found:
    """The best plan that is found within a budget.

    Equal seeds and numbers of evaluations give equal plans. Begins at ``start`` (N, 4), or at the
    best of some clusterings, which are judged whatever the budget is; seconds count from then on,
    and do not count compilation. Only ``movers`` are moved, if they are given.

    Raises:
        InputError: there is no room for so many drones.
    """
    if start is None:
        plan, utility, used = best_clustering(fleet, region, seed)
    else:
        plan, utility, used = start.copy(), fleet.utility(start), 1
    movable = np.arange(fleet.drones) if movers is None else np.array(movers)
    climb = _Climb(fleet, region, plan, utility, movable, np.random.default_rng([seed, 1]))
    climb.compile()
    begun_s = perf_counter()
    while True:
        for drone in climb.order():
            shares = []
            if budget.seconds is not None:
                shares.append((perf_counter() - begun_s) / max(budget.seconds, 1e-9))
            if budget.evaluations is not None:
                shares.append(used / budget.evaluations)
            if max(shares) >= 1.0:
                return Found(climb.best, climb.best_utility, used)
            progress(max(shares), climb.best_utility)
            left = None if budget.evaluations is None else budget.evaluations - used
            used += climb.move(drone, left)
        climb.go_on()


class _Climb:
    """Hill climbing that begins anew, with some drones elsewhere, where it cannot get higher."""

    def __init__(
        self,
        fleet: Fleet,
        region: Region,
        plan: Floats,
        utility: float,
        movers: NDArray[np.int64],
        generator: np.random.Generator,
    ) -> None:
        self._fleet, self._region, self._generator = fleet, region, generator
        self._movers = movers
        uav = fleet.parameters.uav
        self._low = np.array([region.lowest_m, uav.min_transmit_power_w])
        self._high = np.array([region.highest_m, uav.max_transmit_power_w])
        self._first_step_m = _FIRST_STEP * float(np.sqrt(region.allowed.area / fleet.drones))
        self._first_step_m = max(self._first_step_m, _LEAST_STEP_M)
        self._take(plan, utility)
        self.best, self.best_utility = plan.copy(), utility

    def _take(self, plan: Floats, utility: float) -> None:
        self._plan, self._utility = plan.copy(), utility
        self._received_w = self._fleet.receive(plan)
        self._ranking = self._fleet.rank(self._received_w)
        self._steps_m = np.full(len(plan), self._first_step_m)

    def compile(self) -> None:
        """Compile what moves need, or load it, by a move that leaves a drone where it is."""
        drone = int(self._movers[0])
        place = self._plan[drone].copy()
        self._fleet.utilities_of_moves(self._plan, self._ranking, drone, place[None])
        self._fleet.move(self._received_w, self._ranking, drone, place)
        self._take(self._plan, self._utility)

    def order(self) -> list[int]:
        """All drones that are moved, in an order of chance."""
        return [int(drone) for drone in self._generator.permutation(self._movers)]

    def move(self, drone: int, left: int | None) -> int:
        """Try some places for a drone, take the best if it is better; returns how many."""
        moves = self._moves(drone)[:left]
        if not len(moves):
            self._steps_m[drone] = max(_SHRINKAGE * self._steps_m[drone], _LEAST_STEP_M)
            return 0
        found = self._fleet.utilities_of_moves(self._plan, self._ranking, drone, moves)
        best = int(found.argmax())
        if found[best] > self._utility + _LEAST_GAIN:
            self._plan[drone], self._utility = moves[best], float(found[best])
            self._fleet.move(self._received_w, self._ranking, drone, moves[best])
            self._steps_m[drone] = min(_GROWTH * self._steps_m[drone], self._first_step_m)
            if self._utility > self.best_utility:
                self.best, self.best_utility = self._plan.copy(), self._utility
        else:
            self._steps_m[drone] = max(_SHRINKAGE * self._steps_m[drone], _LEAST_STEP_M)
        return len(moves)

    def _moves(self, drone: int) -> Floats:
        """Allowed places to try for a drone, (C, 4); perhaps none."""
        generator, region, people = self._generator, self._region, self._fleet.people
        count = _LOCAL + _WIDE + _ELSEWHERE
        scale = np.full((count, 1), self._steps_m[drone])
        scale[_LOCAL:] *= _WIDE_FACTOR
        moves = np.repeat(self._plan[drone][None], count, axis=0)
        elsewhere = generator.integers(len(people.weights), size=_ELSEWHERE)
        moves[-_ELSEWHERE:, :2] = people.positions_m[elsewhere]
        noise = generator.standard_normal((count, 4))
        moves[:, :2] += scale * noise[:, :2]
        share = scale / self._first_step_m * _FIRST_STEP
        moves[:, 2:] += share * (self._high - self._low) * noise[:, 2:]
        moves[:, 2:] = np.clip(moves[:, 2:], self._low, self._high)
        moves[:, :2] = region.nearest(moves[:, :2])
        others_m = np.delete(self._plan[:, :2], drone, axis=0)
        apart_m = np.linalg.norm(moves[:, None, :2] - others_m[None], axis=2)
        return moves[(apart_m >= region.spacing_m).all(axis=1)]

    def go_on(self) -> None:
        """After all drones had a turn: where nothing got better at the least steps, begin anew."""
        if self._steps_m[self._movers].max() > 2.0 * _LEAST_STEP_M:
            return
        plan = self.best.copy()
        region, people = self._region, self._fleet.people
        count = min(2, len(self._movers))
        for drone in self._generator.choice(self._movers, size=count, replace=False):
            place_m = people.positions_m[self._generator.integers(len(people.weights))]
            place_m = region.nearest(place_m)
            others_m = np.delete(plan[:, :2], drone, axis=0)
            if (np.linalg.norm(others_m - place_m, axis=1) >= region.spacing_m).all():
                plan[drone, :2] = place_m
        self._take(plan, self._fleet.utility(plan))
