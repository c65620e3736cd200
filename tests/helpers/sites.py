"""Made-up sites for tests of plans, in local metres."""

import numpy as np
from shapely.geometry import Polygon, box

from orchid_uav.envs import Parameters
from orchid_uav.experiments.planning.model import Mast, People, Surroundings
from orchid_uav.experiments.planning.network import Fleet
from orchid_uav.experiments.planning.region import region_of
from orchid_uav.experiments.planning.site import Site


def people_at(seed, count, side_m=2000.0, heaviest=3):
    """People in five groups and some between them."""
    generator = np.random.default_rng(seed)
    parents_m = generator.uniform(0.2 * side_m, 0.8 * side_m, (5, 2))
    around_m = generator.normal(0.0, 0.07 * side_m, (count, 2))
    positions_m = np.clip(parents_m[generator.integers(5, size=count)] + around_m, 0.0, side_m)
    return People(positions_m, generator.integers(1, heaviest + 1, count))


def surroundings_of(side_m=2000.0, masts=((1000.0, 1000.0, 30.0),), **changes):
    """A square with masts, without zones."""
    return Surroundings(
        **(
            {
                "site": Site(),
                "area": box(0.0, 0.0, side_m, side_m),
                "no_fly": Polygon(),
                "masts": tuple(Mast(*mast) for mast in masts),
                "home_m": (0.0, 0.0),
                "home_height_amsl_m": 0.0,
                "lowest_m": 80.0,
                "highest_m": 120.0,
                "clearance_m": 50.0,
            }
            | changes
        )
    )


def fleet_and_region(seed=0, drones=4, people=60, radius_m=40.0, **changes):
    """What a search needs."""
    surroundings, parameters = surroundings_of(**changes), Parameters()
    fleet = Fleet(parameters, people_at(seed, people), surroundings.masts, drones, radius_m)
    return fleet, region_of(surroundings, radius_m, parameters)
