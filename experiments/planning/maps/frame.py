"""The window of the map: which part of the site it shows, and how large."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.model import Floats

WIDTH = 10_000
"""Of the map in its own units, which are a tenth of a pixel on a laptop."""
_LEAST_ACROSS_M = 200.0
_MARGIN = 0.05
_LOWEST, _TALLEST = 0.5, 0.8
"""Bounds of height / width."""
_MOST_OF_AREA = 1.6
"""If the area is that many times as wide as all that is planned, the map does not show it all."""


class Frame(NamedTuple):
    """From metres to the map's units, whose second coordinate runs down."""

    west_m: float
    north_m: float
    units_per_m: float
    height: int

    def units(self, points_m: Floats) -> Floats:
        """Whole units, (P, 2), of points in metres, (P, 2)."""
        offsets_m = (np.asarray(points_m, np.float64) - (self.west_m, self.north_m)) * (1.0, -1.0)
        return np.round(offsets_m * self.units_per_m)

    @property
    def window_m(self) -> BaseGeometry:
        """What the map shows, in metres."""
        east_m = self.west_m + WIDTH / self.units_per_m
        return shapely.box(
            self.west_m, self.north_m - self.height / self.units_per_m, east_m, self.north_m
        )


def frame_of(plan: MappedPlan) -> Frame:
    """The window that shows all that is planned, and the area if that is not much larger."""
    surroundings = plan.surroundings
    reaches = [
        (station.east_m + sign * reach_m, station.north_m + sign * reach_m)
        for station in plan.stations
        for reach_m in [station.circle_radius_m]
        for sign in (-1.0, 1.0)
    ]
    masts = [(mast.east_m, mast.north_m) for mast in surroundings.masts]
    points_m = np.concatenate(
        [
            plan.people.positions_m,
            np.array([*reaches, *masts, surroundings.home_m]),
            *(way_m[:, :2] for way_m in plan.ways_m),
        ]
    )
    least_m, most_m = points_m.min(axis=0), points_m.max(axis=0)
    if not surroundings.area.is_empty:
        west_m, south_m, east_m, north_m = surroundings.area.bounds
        with_area = np.minimum(least_m, (west_m, south_m)), np.maximum(most_m, (east_m, north_m))
        across_m = np.maximum(most_m - least_m, _LEAST_ACROSS_M)
        if (with_area[1] - with_area[0] <= _MOST_OF_AREA * across_m).all():
            least_m, most_m = with_area
    width_m, height_m = np.maximum(most_m - least_m, _LEAST_ACROSS_M) * (1.0 + 2.0 * _MARGIN)
    height_m = max(height_m, _LOWEST * width_m)
    width_m = max(width_m, height_m / _TALLEST)
    middle_m = (least_m + most_m) / 2.0
    units_per_m = WIDTH / width_m
    return Frame(
        float(middle_m[0] - width_m / 2.0),
        float(middle_m[1] + height_m / 2.0),
        float(units_per_m),
        math.ceil(height_m * units_per_m),
    )


def round_length_m(longest_m: float) -> float:
    """The longest of 1, 2 and 5 m times powers of ten that is no longer."""
    size_m = 10.0 ** math.floor(math.log10(longest_m))
    return next(size_m * step for step in (5.0, 2.0, 1.0) if size_m * step <= longest_m)
