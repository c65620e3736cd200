"""How far apart flying drones are kept, and at which starts two flights would come nearer.

A drone is kept horizontally or vertically apart from every other one. The distances leave room for
errors of position of both; they are not those of a drone that sees and avoids.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from orchid_uav.experiments.planning.model import Floats, Station, Surroundings

VERTICAL_M = 10.0
"""Between drones above one another: barometers drift by some metres in a flight, and a rotor's
downwash is felt some metres below."""
LEAST_HORIZONTAL_M = 20.0
"""Between drones on their ways, if the clearance of circles is less: GNSS errors of both, and
what they fly within a second."""
PADS_M = 10.0
"""Below this height drones are over their own pads at home, and in the hands of their crews."""
SLACK_S = 5
"""A launch or a return may come this much too early or too late."""
_ROUNDING_M = 1e-6


class Samples(NamedTuple):
    """Where a drone is at whole seconds."""

    seconds: Floats
    """(T,)"""
    points_m: Floats
    """East, north and altitude, (T, 3)."""

    def later(self, by_s: float) -> "Samples":
        """The same flight, started later."""
        return Samples(self.seconds + by_s, self.points_m)


class Occupied(NamedTuple):
    """A circle that is flown, or a place where a drone hovers."""

    center_m: Floats
    """East, north and altitude, (3,)."""
    radius_m: float
    """Of the circle and the clearance around it."""

    def meets(self, points_m: Floats) -> NDArray[np.int64]:
        """Which of some points, (T, 3), are too near, in their order."""
        offsets = points_m - self.center_m
        level = np.flatnonzero(np.abs(offsets[:, 2]) < VERTICAL_M - _ROUNDING_M)
        near = np.hypot(offsets[level, 0], offsets[level, 1]) < self.radius_m - _ROUNDING_M
        return level[near]


def occupied_by(station: Station, surroundings: Surroundings) -> Occupied:
    """The room of a drone on its station."""
    center_m = np.array([station.east_m, station.north_m, station.altitude_m])
    return Occupied(center_m, station.circle_radius_m + surroundings.clearance_m)


def sampled_apart_m(surroundings: Surroundings, cruise_mps: float) -> float:
    """Horizontal distance of positions each second, of two drones on their ways at one altitude.

    Positions lie up to half a second off the time at which two drones are nearest.
    """
    return math.hypot(max(surroundings.clearance_m, LEAST_HORIZONTAL_M), cruise_mps)


def above_pads(samples: Samples) -> Samples:
    """The part of a flight in which a drone is kept apart from others."""
    flying = samples.points_m[:, 2] >= PADS_M
    return Samples(samples.seconds[flying], samples.points_m[flying])


class Traffic:
    """Flights whose times are fixed."""

    def __init__(self, flights: Sequence[Samples], apart_m: float) -> None:
        """Gather flights.

        Args:
            flights: of any number of drones.
            apart_m: horizontal distance to keep where the vertical one is too small.
        """
        self._apart_m = apart_m
        self._seconds = np.concatenate([np.empty(0), *(flight.seconds for flight in flights)])
        points_m = np.concatenate([np.empty((0, 3)), *(flight.points_m for flight in flights)])
        self._scale = np.array([apart_m, apart_m, VERTICAL_M])
        self._points_m = points_m
        self._tree = cKDTree(points_m / self._scale)

    def forbids_s(self, flight: Samples) -> NDArray[np.int64]:
        """Whole seconds at which a flight must not start, its seconds counting from its start."""
        if not len(flight.seconds) or not len(self._seconds):
            return np.empty(0, np.int64)
        pairs = cKDTree(flight.points_m / self._scale).sparse_distance_matrix(
            self._tree, 1.0, p=np.inf, output_type="ndarray"
        )
        own, other = pairs["i"], pairs["j"]
        offsets = flight.points_m[own] - self._points_m[other]
        near = np.hypot(offsets[:, 0], offsets[:, 1]) < self._apart_m - _ROUNDING_M
        near &= np.abs(offsets[:, 2]) < VERTICAL_M - _ROUNDING_M
        starts = self._seconds[other[near]] - flight.seconds[own[near]]
        return np.unique(np.round(starts).astype(np.int64))


def with_slack(starts_s: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same, and what lies within the slack before and after."""
    around = np.arange(-SLACK_S, SLACK_S + 1)
    return np.unique((starts_s[:, None] + around).ravel())
