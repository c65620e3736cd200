"""Forces on stations: six numbers instead of a model of the network (docs/flying.md)."""

from typing import NamedTuple

import numpy as np

from orchid_uav.agents.controllers.controller import Actions, check_stations, station_actions
from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.compilation import SOURCES, compiled
from orchid_uav.envs.knowledge.neighbourhood import NEIGHBOURS, nearest_stations, sum_up_cells
from orchid_uav.envs.world import WorldBatch


class Gains(NamedTuple):
    """How strongly what pulls at a station."""

    centroid_per_s: float
    """Towards the centroid of its own users, for each metre to it."""
    load_mps: float
    """Towards a neighbour that serves more users, for a difference of the fleet's mean load."""
    airtime_mps: float
    """Towards a neighbour whose cell needs more airtime, the sum of 1 / spectral efficiency."""
    repulsion_mps: float
    """Away from a neighbour that is very near."""
    range_m: float
    """Distance at which the repulsion has fallen to 1/e."""
    ahead_s: float
    """Users count where they will be in this time."""


GAINS = Gains(0.17, 24.0, -8.3, 22.0, 37.0, 10.0)
"""Found by ``python -m studies.forces``."""


class Forces:
    """Every UAV's station is pulled and pushed by its users and its nearest neighbours.

    Args:
        gains: the six numbers.
    """

    def __init__(self, gains: Gains = GAINS) -> None:
        self.gains = gains

    def begin(self, world: WorldBatch) -> None:
        """Check that an action moves stations.

        Raises:
            ValueError: it moves the UAVs themselves.
        """
        check_stations(world, "forces")

    def act(self, world: WorldBatch) -> Actions:
        """The sum of the forces as a velocity."""
        velocities_mps = np.zeros((world.world_count, world.uav_count, 2))
        gains = np.array(self.gains)
        world.divide(
            lambda part, worlds: pull_worlds(world.constants, worlds, gains, velocities_mps[part])
        )
        return station_actions(world, velocities_mps)


@compiled
def pull_worlds(
    constants: Constants,
    worlds: Worlds,
    gains: Floats,
    velocities_mps: Floats,
    sources: str = SOURCES,
) -> None:
    """Sum up the forces on every station.

    Args:
        constants: of the parameters that the worlds were made with.
        worlds: B worlds.
        gains: of :class:`Gains`, in their order.
        velocities_mps: result, (B, N, 2).
        sources: not used; see ``SOURCES``.
    """
    uavs = worlds.positions_m.shape[1]
    centroids_m, airtimes = np.empty((uavs, 2)), np.empty(uavs)
    group = np.empty(1 + NEIGHBOURS, np.int64)
    centroid_per_s, load_mps, airtime_mps, repulsion_mps, range_m, ahead_s = gains
    for world in range(len(worlds.slot)):
        sum_up_cells(constants, worlds, world, ahead_s, centroids_m, airtimes)
        loads, stations_m = worlds.loads[world], worlds.stations_m[world]
        flying = max(worlds.in_service[world].sum(), 1)
        mean_load = max(loads.sum() / flying, 1.0)
        mean_airtime = max(airtimes.sum() / flying, 1e-9)
        for uav in range(uavs):
            velocity = velocities_mps[world, uav]
            velocity[:] = 0.0
            if not worlds.in_service[world, uav]:
                continue
            for axis in range(2):
                missing_m = centroids_m[uav, axis] - stations_m[uav, axis]
                velocity[axis] += centroid_per_s * missing_m
            for place in range(1, nearest_stations(worlds, world, uav, group)):
                other = group[place]
                east_m = stations_m[other, 0] - stations_m[uav, 0]
                north_m = stations_m[other, 1] - stations_m[uav, 1]
                distance_m = max(np.sqrt(east_m * east_m + north_m * north_m), 1e-9)
                pull_mps = (
                    load_mps * (loads[other] - loads[uav]) / mean_load
                    + airtime_mps * (airtimes[other] - airtimes[uav]) / mean_airtime
                    - repulsion_mps * np.exp(-distance_m / range_m)
                )
                velocity[0] += pull_mps * east_m / distance_m
                velocity[1] += pull_mps * north_m / distance_m
