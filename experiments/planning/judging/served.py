"""How people are served, counted."""

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.planning.model import Floats, People, Want
from orchid_uav.experiments.planning.network import Service
from orchid_uav.experiments.planning.result import PeopleServed


def count_served(service: Service, people: People, drones: int, want: Want | None) -> PeopleServed:
    """Count people by who serves them, all by their weights."""
    weights = people.weights
    by_drone = (service.server >= 0) & (service.server < drones)
    served_by_drones = int(weights[by_drone].sum())
    served_by_masts = int(weights[service.server >= drones].sum())
    return PeopleServed(
        total=people.total,
        served_by_drones=served_by_drones,
        served_by_masts=served_by_masts,
        unserved=people.total - served_by_drones - served_by_masts,
        worst_rate_bps=float(service.rates_bps.min()),
        median_rate_bps=weighted_median(service.rates_bps, weights),
        share_above_want=share_above(service, people, want),
    )


def share_above(service: Service, people: People, want: Want | None) -> float | None:
    """Share of all people with the wanted rate."""
    if want is None:
        return None
    enough = service.rates_bps >= want.rate_bps
    return float(people.weights[enough].sum() / people.total)


def weighted_median(values: Floats, weights: NDArray[np.int64]) -> float:
    """The value that half of the people do not exceed; the lower one of two."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])
