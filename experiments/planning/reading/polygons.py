"""Polygons of zones, checked: rings that are closed, do not cross, and know the antimeridian."""

import math
import re
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.polygon import orient
from shapely.validation import explain_validity

from orchid_uav.experiments.planning.reading.cells import (
    check_longitude,
    check_metres,
)

Floats = NDArray[np.float64]

_MOST_LONGITUDE_DEG = 360.0
"""Tools that draw across the antimeridian write longitudes beyond 180."""
_MOST_ACROSS_DEG = 180.0
_EXPLANATION = re.compile(r"(.*)\[(\S+) (\S+)\]")


def polygon_of(rings: Sequence[Sequence[tuple[float, float]]], on_earth: bool) -> Polygon:
    """The polygon of an exterior ring and its holes, exterior counter-clockwise.

    A ring that steps by more than 180 degrees of longitude crosses the antimeridian there; its
    longitudes are continued beyond 180.

    Args:
        rings: longitudes and latitudes in degrees, or x and y in m, the first like the last.
        on_earth: whether they are degrees.

    Raises:
        ValueError: they make no valid polygon; the text says why, and where.
    """
    if not rings:
        raise ValueError("a polygon has no ring: give its corners, the first again as the last")
    continued = [_ring(ring, on_earth) for ring in rings]
    exterior, holes = continued[0], continued[1:]
    if on_earth:
        if np.ptp(exterior[:, 0]) > _MOST_ACROSS_DEG:
            raise ValueError("a polygon spans more than 180 degrees of longitude: draw it smaller")
        middle = (exterior[:, 0].min() + exterior[:, 0].max()) / 2
        holes = [_beside(hole, middle) for hole in holes]
    polygon = Polygon(exterior, holes)
    if not polygon.is_valid:
        raise ValueError(_explain(polygon, on_earth))
    return orient(polygon)


def _ring(positions: Sequence[tuple[float, float]], on_earth: bool) -> Floats:
    if len(positions) < 4:
        raise ValueError(
            f"a ring has {len(positions)} positions: it needs at least three corners, and the "
            "first again as the last"
        )
    for first, second in positions:
        if on_earth:
            check_longitude(first, _MOST_LONGITUDE_DEG)
            if not -90 <= second <= 90:
                raise ValueError(
                    f"{second!r} is not a latitude, which lies between -90 and 90 degrees and "
                    "stands after the longitude"
                )
        else:
            check_metres(first)
            check_metres(second)
    ring = np.array(positions, np.float64)
    if on_earth:
        ring[:, 0] = _continued(ring[:, 0])
    if (ring[0] != ring[-1]).any():
        if on_earth and math.isclose(abs(ring[-1, 0] - ring[0, 0]), 360.0):
            raise ValueError("a ring goes round a pole, where plans are not made")
        raise ValueError(
            f"a ring is not closed: it begins at {_place(*positions[0], on_earth)} and ends at "
            f"{_place(*positions[-1], on_earth)}; repeat the first position as the last"
        )
    return ring


def _continued(longitudes_deg: Floats) -> Floats:
    """Longitudes whose steps are at most 180 degrees, by whole turns away from those given."""
    turns = np.zeros(len(longitudes_deg))
    turns[1:] = -np.cumsum(np.round(np.diff(longitudes_deg) / 360.0))
    return longitudes_deg + 360.0 * turns


def _beside(ring: Floats, middle_deg: float) -> Floats:
    """A ring by whole turns of longitude nearer to a middle."""
    own_deg = (ring[:, 0].min() + ring[:, 0].max()) / 2
    return np.add(ring, [360.0 * round((middle_deg - own_deg) / 360.0), 0.0])


def _explain(polygon: Polygon, on_earth: bool) -> str:
    explanation = explain_validity(polygon)
    match = _EXPLANATION.fullmatch(explanation)
    if not match:
        return f"a polygon is not valid: {explanation}"
    where = _place(float(match[2]), float(match[3]), on_earth)
    reason = match[1].strip().lower()
    if reason in ("self-intersection", "ring self-intersection"):
        return f"a polygon crosses or touches itself at {where} ({reason}): draw it without that"
    return f"a polygon is not valid at {where}: {reason}"


def _place(first: float, second: float, on_earth: bool) -> str:
    if not on_earth:
        return f"x {first:.10g}, y {second:.10g}"
    return f"latitude {second:.10g}, longitude {(first + 180.0) % 360.0 - 180.0:.10g}"


def corner_count(polygons: Sequence[Polygon]) -> int:
    """How many corners polygons have together, each ring's first counted twice."""
    return int(shapely.get_num_coordinates(list(polygons)).sum())
