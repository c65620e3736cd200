"""Outlines and lines in degrees, as GeoJSON and KML want them."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from orchid_uav.experiments.planning.model import Floats, Station
from orchid_uav.experiments.planning.site import Site

DIGITS = 7
"""Of a degree: 1 cm, as much as autopilots use."""
CIRCLE_CORNERS = 72
"""Corners of a drawn circle, which so lies within 0.1 % of its radius."""
_LONGEST_EDGE_M = 2_000.0
"""Straight lines of the site's plane are bent in degrees: by some 0.2 m over this length."""

Ring = list[list[float]]
"""Longitudes, latitudes and, if any, altitudes; the last point is the first."""


def point_on_earth(site: Site, east_m: float, north_m: float) -> list[float]:
    """Longitude and latitude of a point."""
    latitude, longitude = site.to_places([east_m, north_m])[0]
    return [_rounded(longitude), _rounded(latitude)]


def points_on_earth(site: Site, points_m: Floats) -> list[list[float]]:
    """Longitudes and latitudes of points, (P, 2)."""
    return [
        [_rounded(longitude), _rounded(latitude)]
        for latitude, longitude in site.to_places(points_m)
    ]


def circle_m(station: Station) -> Floats:
    """The corners of a station's circle, counter-clockwise and closed, (K, 2)."""
    turns = np.arange(CIRCLE_CORNERS + 1) % CIRCLE_CORNERS * (2.0 * np.pi / CIRCLE_CORNERS)
    ring = station.circle_radius_m * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return ring + np.array([station.east_m, station.north_m])


def polygons_of(shape: BaseGeometry) -> list[Any]:
    """The polygons that a shape consists of, none of them empty."""
    parts = shapely.get_parts(shape)
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def polygons_on_earth(site: Site, shape: BaseGeometry) -> list[list[Ring]]:
    """The polygons of a shape in the site's metres: of each its outline, then its holes.

    Outlines run counter-clockwise, holes clockwise. What crosses the antimeridian is cut there.
    """
    if shape.is_empty:
        return []
    around = _middle(site)

    def to_degrees(points_m: Floats) -> Floats:
        return _continuous(site, points_m, around)

    bent = shapely.segmentize(shape, _LONGEST_EDGE_M)
    # To a grid of the digits that are written: afterwards, a rounded outline may cross itself.
    whole = shapely.set_precision(shapely.transform(bent, to_degrees), 10.0**-DIGITS)
    found = []
    for turn in (-360.0, 0.0, 360.0):
        part = shapely.intersection(whole, shapely.box(-180.0 + turn, -90.0, 180.0 + turn, 90.0))
        for polygon in polygons_of(part):
            rings = [orient(polygon).exterior, *orient(polygon).interiors]
            found.append([_ring(ring.coords, turn) for ring in rings])
    return found


def lines_on_earth(site: Site, points_m: ArrayLike) -> list[Ring]:
    """A line through points in the site's metres, (K, 2), or (K, 3) with an altitude each.

    It comes in one piece, or in several where it crosses the antimeridian. Points that are equal to
    the one before are left out, and nothing is returned if fewer than two are left.
    """
    points = np.asarray(points_m, np.float64)
    degrees = _continuous(site, points[:, :2], _middle(site))
    line = np.concatenate([degrees, np.round(points[:, 2:], 2)], axis=1)
    east = np.eye(line.shape[1])[0]
    turns = np.floor((line[:, 0] + 180.0) / 360.0) * 360.0
    pieces = [[line[0] - turns[0] * east]]
    for before, point, last_turn, turn in zip(line, line[1:], turns, turns[1:], strict=False):
        if turn != last_turn:
            share = (max(turn, last_turn) - 180.0 - before[0]) / (point[0] - before[0])
            crossing = before + share * (point - before)
            pieces[-1].append(crossing - last_turn * east)
            pieces.append([crossing - turn * east])
        pieces[-1].append(point - turn * east)
    written = [_without_repetition(piece) for piece in pieces]
    return [piece for piece in written if len(piece) > 1]


def _without_repetition(points: list[Floats]) -> Ring:
    kept: Ring = []
    for point in points:
        rounded = [_rounded(value) for value in point]
        if not kept or rounded != kept[-1]:
            kept.append(rounded)
    return kept


def _middle(site: Site) -> float:
    return float(site.to_places([0.0, 0.0])[0, 1])


def _continuous(site: Site, points_m: Floats, around: float) -> Floats:
    """Longitudes, without a leap at the antimeridian, and latitudes."""
    latitude, longitude = site.to_places(points_m).T
    return np.stack([around + (longitude - around + 180.0) % 360.0 - 180.0, latitude], axis=1)


def _ring(coordinates: Iterable[tuple[float, ...]], turn: float) -> Ring:
    return [[_rounded(longitude - turn), _rounded(latitude)] for longitude, latitude in coordinates]


def _rounded(degrees: float) -> float:
    return round(float(degrees), DIGITS) + 0.0  # never -0.0
