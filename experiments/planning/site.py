"""Where a plan lies on earth: the one conversion between WGS 84 and local metres."""

from typing import NamedTuple

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

MOST_ACROSS_M = 50_000.0
"""Greatest distance of two points of a site; further apart, one of them is a mistake."""
_ROUNDS = 4
"""Corrections of the height above the tangent plane; each is thousands of times smaller."""


class Place(NamedTuple):
    """A place on earth, WGS 84."""

    latitude_deg: float
    longitude_deg: float


class Site(NamedTuple):
    """The frame of a plan: metres to the east and north of a centre.

    The frame is the plane that touches the earth at the centre; a point on the ground is its foot
    there. Without a centre the metres are the caller's own, and nothing has a place on earth.
    """

    center: Place | None = None

    def to_local_m(self, places: ArrayLike) -> Floats:
        """East and north in m, (P, 2), of latitudes and longitudes in degrees, (P, 2)."""
        center = self._on_earth()
        degrees = np.asarray(places, np.float64).reshape(-1, 2)
        east_m, north_m, _ = pymap3d.geodetic2enu(degrees[:, 0], degrees[:, 1], 0.0, *center, 0.0)
        return np.stack([east_m, north_m], axis=1)

    def to_places(self, points_m: ArrayLike) -> Floats:
        """Latitudes and longitudes in degrees, (P, 2), of points on the ground, (P, 2) in m.

        Longitudes lie in [-180, 180], also beyond the antimeridian.
        """
        center = self._on_earth()
        points = np.asarray(points_m, np.float64).reshape(-1, 2)
        up_m = np.zeros(len(points))
        for _ in range(_ROUNDS):  # the ground falls below the plane by d²/2R
            latitude, longitude, height_m = pymap3d.enu2geodetic(
                points[:, 0], points[:, 1], up_m, *center, 0.0
            )
            up_m = up_m - height_m
        return np.stack([latitude, (longitude + 180.0) % 360.0 - 180.0], axis=1)

    def _on_earth(self) -> Place:
        if self.center is None:
            raise ValueError("a site in local metres has no place on earth")
        return self.center
