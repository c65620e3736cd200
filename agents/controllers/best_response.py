"""Best response on stations: every UAV improves the utility of its neighbourhood (docs/flying.md).

A move that raises the neighbourhood's utility nearly always raises the fleet's: better-response
dynamics in an approximate potential game.
"""

import numpy as np

from orchid_uav.agents.controllers.controller import Actions, check_stations, station_actions
from orchid_uav.envs.arrays import Floats, Worlds
from orchid_uav.envs.knowledge.counterfactuals import TEMPERATURE, answer_worlds, shifts_m
from orchid_uav.envs.knowledge.neighbourhood import AHEAD_S
from orchid_uav.envs.world import WorldBatch

HASTE_PER_S = 0.3
"""Speed that is wanted for each metre of the move that is wanted."""


class BestResponse:
    """Every UAV moves its station to where its neighbourhood would be better off.

    Args:
        ahead_s: users are expected where they will be in this time, if they keep going.
        temperature: of the softmax over the moves, in units of utility.
        haste_per_s: speed that is wanted for each metre of the move that is wanted.
        knows_truth: see the users where they are, whatever UAVs know in flight: a teacher.
    """

    def __init__(
        self,
        ahead_s: float = AHEAD_S,
        temperature: float = TEMPERATURE,
        haste_per_s: float = HASTE_PER_S,
        knows_truth: bool = False,
    ) -> None:
        self.ahead_s = ahead_s
        self.temperature = temperature
        self.haste_per_s = haste_per_s
        self.knows_truth = knows_truth
        self._moves_m = shifts_m()

    def begin(self, world: WorldBatch) -> None:
        """Check that an action moves stations.

        Raises:
            ValueError: it moves the UAVs themselves.
        """
        check_stations(world, "best response")
        self._answer = world.specialised(answer_worlds)

    def wanted_moves_m(self, world: WorldBatch) -> Floats:
        """Mean of the moves, weighted by how good each would be, (B, N, 2)."""
        wanted_m = np.zeros((world.world_count, world.uav_count, 2))

        def answer(part: slice, worlds: Worlds) -> None:
            if self.knows_truth:
                worlds = worlds._replace(
                    known_coordinates_m=worlds.user_coordinates_m,
                    known_velocities_mps=worlds.user_velocities_mps,
                )
            self._answer(
                world.constants,
                worlds,
                self._moves_m,
                self.ahead_s,
                self.temperature,
                wanted_m[part],
            )

        world.divide(answer)
        return wanted_m

    def act(self, world: WorldBatch) -> Actions:
        """Towards the moves that are wanted."""
        return station_actions(world, self.wanted_moves_m(world) * self.haste_per_s)
