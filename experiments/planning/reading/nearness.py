"""Whether people stand near to each other, measured on the earth and not in degrees."""

from typing import NamedTuple

import numpy as np
import pymap3d
from numpy.typing import NDArray

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.table import PeopleTable, Problems
from orchid_uav.experiments.planning.site import MOST_ACROSS_M, Place, Site

Floats = NDArray[np.float64]

_EARTH_RADIUS_M = 6_371_009.0
_DIRECTIONS = 720
"""In which points are looked at: the furthest two of 50 km are found to within 0.2 m."""


class Middle(NamedTuple):
    """The place that others are compared with: a point of space, or of the plane in m."""

    point_m: Floats
    on_earth: bool

    def distances_m(self, coordinates: Floats) -> Floats:
        """How far away positions are, (P,): along the earth, or in the plane."""
        points_m = _points_m(coordinates, self.on_earth)
        direct_m = np.linalg.norm(points_m - self.point_m, axis=1)
        if not self.on_earth:
            return direct_m
        return 2 * _EARTH_RADIUS_M * np.arcsin(np.minimum(direct_m / 2 / _EARTH_RADIUS_M, 1.0))


def middle_of(coordinates: Floats, on_earth: bool) -> Middle:
    """The median position: it lies among most, wherever a few lie."""
    point_m = np.median(_points_m(coordinates, on_earth), axis=0)
    if on_earth and np.linalg.norm(point_m) > _EARTH_RADIUS_M / 2:
        latitude, longitude, _ = pymap3d.ecef2geodetic(*point_m)  # the median of space is inside
        point_m = _points_m(np.array([[latitude, longitude]]), on_earth)[0]
    return Middle(point_m, on_earth)


def _points_m(coordinates: Floats, on_earth: bool) -> Floats:
    if not on_earth:
        return coordinates
    return np.stack(pymap3d.geodetic2ecef(coordinates[:, 0], coordinates[:, 1], 0.0), axis=1)


def middle_of_box(coordinates: Floats, on_earth: bool) -> tuple[float, float]:
    """The middle of the box round some positions, which may lie on both sides of the antimeridian.

    Longitudes are in [-180, 180].
    """
    first, second = coordinates[:, 0], coordinates[:, 1]
    origin = second[0] if on_earth else 0.0
    if on_earth:
        second = (second - origin + 180.0) % 360.0 - 180.0
    middle = origin + (second.min() + second.max()) / 2
    if on_earth:
        middle = (middle + 180.0) % 360.0 - 180.0
    return float((first.min() + first.max()) / 2), float(middle)


def check_nearness(table: PeopleTable) -> None:
    """Check that a site holds all people of a table.

    Raises:
        InputError: some are more than 50 km from the others. Where these are few they are named,
            else the two that are furthest apart.
    """
    middle = middle_of(table.coordinates, table.on_earth)
    distances_m = middle.distances_m(table.coordinates)
    far = np.flatnonzero(distances_m > MOST_ACROSS_M)
    if 0 < len(far) < len(distances_m) / 2:
        problems = Problems(table.path)
        for row in far[np.argsort(-distances_m[far], kind="stable")]:
            position = table.coordinates[row]
            problems.add(
                table.sources[row],
                f"{written(position)} is {distances_m[row] / 1000:,.0f} km from the others, and a "
                f"site may be {MOST_ACROSS_M / 1000:.0f} km across{hint(position, middle)}",
            )
        problems.raise_if_any()
    if len(far):
        furthest = int(np.argmax(distances_m))
        other = middle_of(table.coordinates[[furthest]], table.on_earth)
        _refuse(table, furthest, int(np.argmax(other.distances_m(table.coordinates))))
    pair = _furthest_pair(_in_plane(table))
    if pair is not None:
        _refuse(table, *pair)


def _refuse(table: PeopleTable, one: int, other: int) -> None:
    pair = table.coordinates[[one, other]]
    apart_m = middle_of(pair[:1], table.on_earth).distances_m(pair)[1]
    raise InputError(
        f"{table.path} has people {apart_m / 1000:,.1f} km apart, and a site may be "
        f"{MOST_ACROSS_M / 1000:.0f} km across: make a plan for each part, or correct positions\n"
        f"  {table.sources[one]}: {written(pair[0])}; {table.sources[other]}: {written(pair[1])}"
    )


def _in_plane(table: PeopleTable) -> Floats:
    if not table.on_earth:
        return table.coordinates
    center = Place(*middle_of_box(table.coordinates, on_earth=True))
    return Site(center).to_local_m(table.coordinates)


def _furthest_pair(points_m: Floats) -> tuple[int, int] | None:
    """The two points that are furthest apart; None if they may belong to one site."""
    if np.hypot(*np.ptp(points_m, axis=0)) <= MOST_ACROSS_M:
        return None
    furthest_m, pair = 0.0, (0, 0)
    for angle in np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS):
        along_m = points_m @ np.array([np.cos(angle), np.sin(angle)])
        if np.ptp(along_m) > furthest_m:
            furthest_m, pair = (
                float(np.ptp(along_m)),
                (int(along_m.argmin()), int(along_m.argmax())),
            )
    return pair if furthest_m > MOST_ACROSS_M else None


def check_nearness_of_place(given: str, position: tuple[float, float], middle: Middle) -> None:
    """Raise InputError if a place is more than 50 km from the middle of the people."""
    coordinates = np.array(position, np.float64)
    distance_m = middle.distances_m(coordinates[None])[0]
    if distance_m > MOST_ACROSS_M:
        raise InputError(
            f"{given} is {distance_m / 1000:,.0f} km from the people, and a site may be "
            f"{MOST_ACROSS_M / 1000:.0f} km across{hint(coordinates, middle)}"
        )


def written(position: Floats) -> str:
    """A position as it is given: latitude and longitude, or x and y in m."""
    return ", ".join(f"{float(value)!r}" for value in position)


def hint(position: Floats, middle: Middle) -> str:
    """What may have happened to a position that is too far away; begins with a colon if known."""
    first, second = (float(value) for value in position)
    if not middle.on_earth:
        return ""
    if first == second == 0:
        return ": devices write 0, 0 where they do not know their position"
    for text, variant in (
        ("latitude and longitude seem to be swapped", (second, first)),
        ("a sign of the longitude seems to be wrong", (first, -second)),
        ("a sign of the latitude seems to be wrong", (-first, second)),
    ):
        if abs(variant[0]) > 90:
            continue
        if middle.distances_m(np.array([variant]))[0] <= MOST_ACROSS_M:
            return f": {text}, for {written(np.array(variant))} lies among them"
    return ""
