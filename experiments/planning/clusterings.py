"""Where a search begins: the best of some clusterings of the people."""

import math

import numpy as np
import shapely
from shapely.geometry import Point

from orchid_uav.envs.plans.clustering import weighted_centroids
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Floats
from orchid_uav.experiments.planning.network import Fleet
from orchid_uav.experiments.planning.region import Region

_MOST_CLUSTERINGS, _FEWEST_CLUSTERINGS = 30, 4
_LINKS_AT_ONCE = 200_000
"""Drones times positions of all clusterings together: what a second or two can cluster."""
_DISC_SEGMENTS = 16


def best_clustering(fleet: Fleet, region: Region, seed: int) -> tuple[Floats, float, int]:
    """The plan (N, 4) of the best clustering, its utility, and how many were judged.

    Every other clustering leaves out the people that a mast reaches. Stations are put where the
    region allows them, at the greatest altitude and power.

    Raises:
        InputError: there is no room for so many drones.
    """
    positions_m, weights = fleet.people.positions_m, fleet.people.weights.astype(np.float64)
    unreached = fleet.ground.mast_power_w == 0.0
    links = fleet.drones * len(weights)
    count = min(max(_LINKS_AT_ONCE // links, _FEWEST_CLUSTERINGS), _MOST_CLUSTERINGS)
    generator = np.random.default_rng(seed)
    best: tuple[Floats, float] | None = None
    for number in range(count):
        own_seed = int(generator.integers(2**31))
        chosen = unreached if number % 2 and unreached.any() else np.ones(len(weights), np.bool_)
        centroids_m = weighted_centroids(
            positions_m[chosen], weights[chosen], fleet.drones, own_seed
        )
        plan = np.empty((fleet.drones, 4))
        plan[:, :2] = settled(centroids_m, region)
        plan[:, 2] = region.highest_m
        plan[:, 3] = fleet.parameters.uav.max_transmit_power_w
        utility = fleet.utility(plan)
        if best is None or utility > best[1]:
            best = plan, utility
    assert best is not None
    return *best, count


def settled(wanted_m: Floats, region: Region) -> Floats:
    """Allowed places (N, 2) near wanted ones, one after the other, each apart from those before.

    Raises:
        InputError: there is no room for so many.
    """
    places_m = np.empty_like(wanted_m)
    free = region.allowed
    around_m = region.spacing_m / math.cos(math.pi / (4 * _DISC_SEGMENTS))
    for drone, point_m in enumerate(wanted_m):
        if free.is_empty:
            raise InputError(
                f"there is room for {drone} drones {region.spacing_m:g} m apart, not for "
                f"{len(wanted_m)}; fewer --drones, a smaller --clearance-m, or a larger --area"
            )
        point = Point(point_m)
        if not free.intersects(point):
            point = Point(shapely.shortest_line(free, point).coords[0])
        places_m[drone] = point.x, point.y
        if around_m > 0.0:
            free = free.difference(point.buffer(around_m, _DISC_SEGMENTS))
    return places_m
