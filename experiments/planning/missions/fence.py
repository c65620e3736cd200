"""The fence that autopilots watch, and the same limits as GeoJSON.

PX4 and ArduPilot take a drone to be inside only where all inclusion polygons overlap, and PX4 drops
a polygon that home violates: a fence has one inclusion polygon, which holds home and all ways;
no-fly zones and holes are exclusion polygons.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from orchid_uav.experiments.planning.maps.on_earth import polygons_on_earth
from orchid_uav.experiments.planning.missions.items import places_of
from orchid_uav.experiments.planning.missions.routing import home_is_inside
from orchid_uav.experiments.planning.missions.transit import Transit
from orchid_uav.experiments.planning.model import Surroundings
from orchid_uav.experiments.planning.site import Place

MOST_CORNERS = 64
"""Of all polygons together: what PX4 stores; common boards with ArduPilot store some 80."""
CORRIDOR_M = 30.0
"""On both sides of a way outside of the area."""
_BEND_M = 0.03
"""Straight edges of the site's plane are straight in degrees as well up to this distance."""
_EARTH_RADIUS_M = 6.371e6
_TOLERANCES_M = (0.0, *(0.5 * 2.0**step for step in range(10)))


class Fence(NamedTuple):
    """Polygons that a drone must stay inside or outside of."""

    polygons: tuple[tuple[bool, tuple[Place, ...]], ...]
    """Whether it is an inclusion, and its corners, not closed."""
    note: str
    """What a crew should know of it, in plain words; empty if it is exact."""


def fence_of(surroundings: Surroundings, transit: Transit) -> Fence:
    """The fence of all drones."""
    outline = _outline(surroundings, transit)
    outside = _zones(surroundings, outline)
    outline = _inside_of_rings(surroundings, outline)
    edge_m = _longest_edge_m(surroundings)
    for tolerance_m in _TOLERANCES_M:
        shapes = _coarser(outline, outside, tolerance_m, edge_m)
        if _corners(shapes) <= MOST_CORNERS:
            break
    note = ""
    if tolerance_m:
        note = (
            f"The fence is up to {2.0 * tolerance_m:g} m wider than the area and the no-fly zones "
            f"allow, because autopilots store {MOST_CORNERS} corners of it."
        )
    if _corners(shapes) > MOST_CORNERS:
        left_out = 0
        while len(shapes) > 1 and _corners(shapes) > MOST_CORNERS:
            shapes.pop()
            left_out += 1
        note += f" {left_out} of the no-fly zones are not in it at all."
    polygons = [
        (index == 0, tuple(places_of(surroundings.site, np.array(shape.exterior.coords)[:-1])))
        for index, shape in enumerate(shapes)
    ]
    longitudes = [place.longitude_deg for place in polygons[0][1]]
    if max(longitudes) - min(longitudes) > 180.0:
        return Fence((), "Autopilots cannot fence across longitude 180: there is no fence.")
    return Fence(tuple(polygons), note)


def fence_geojson(surroundings: Surroundings) -> dict[str, Any]:
    """The area and the no-fly zones, as they are, in RFC 7946.

    The property ``kind`` of a feature is ``area`` or ``no-fly``.

    Raises:
        ValueError: the site has no place on earth.
    """
    features = []
    for kind, shape, colour in (
        ("area", surroundings.area, "#1b7837"),
        ("no-fly", surroundings.no_fly, "#b2182b"),
    ):
        for rings in polygons_on_earth(surroundings.site, shape):
            properties = {"kind": kind, "stroke": colour, "fill": colour, "fill-opacity": 0.1}
            geometry = {"type": "Polygon", "coordinates": rings}
            features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return {"type": "FeatureCollection", "features": features}


def _outline(surroundings: Surroundings, transit: Transit) -> Polygon:
    """Where drones may be, no-fly zones aside: the part around home."""
    home = Point(surroundings.home_m)
    area = surroundings.area
    if not home_is_inside(surroundings):
        ways = [LineString(way.outbound_m[1:, :2]) for way in transit.ways if way.length_m]
        corridor = shapely.union_all([home, *ways]).buffer(CORRIDOR_M, 2)
        area = area.union(corridor)
    return next(part for part in _polygons(area) if part.intersects(home))


def _zones(surroundings: Surroundings, outline: Polygon) -> list[Polygon]:
    """What is excluded, the nearest to home first, without their holes."""
    home = Point(surroundings.home_m)
    zones = [Polygon(part.exterior) for part in _polygons(surroundings.no_fly)]
    zones = [zone for zone in zones if zone.intersects(outline) and not zone.contains(home)]
    holes = [Polygon(ring) for ring in outline.interiors]
    return sorted([*zones, *holes], key=lambda zone: zone.distance(home))


def _inside_of_rings(surroundings: Surroundings, outline: Polygon) -> Polygon:
    """The outline without what lies beyond zones that enclose home like a ring."""
    home = Point(surroundings.home_m)
    inner: BaseGeometry = Polygon(outline.exterior)
    for part in _polygons(surroundings.no_fly):
        if Polygon(part.exterior).contains(home):
            inner = inner.difference(part)
    return Polygon(next(part for part in _polygons(inner) if part.intersects(home)).exterior)


def _coarser(
    outline: Polygon, outside: Sequence[Polygon], tolerance_m: float, edge_m: float
) -> list[Polygon]:
    """The polygons with fewer corners; no place that was allowed is forbidden by them."""
    shapes = [outline, *outside]
    if tolerance_m:
        shapes = []
        for shape, sign in ((outline, 1.0), *((zone, -1.0) for zone in outside)):
            coarse = shape.simplify(tolerance_m).buffer(sign * tolerance_m, join_style="mitre")
            shapes.extend(Polygon(part.exterior) for part in _polygons(coarse))
    return [shapely.segmentize(shape, edge_m) for shape in shapes]


def _corners(shapes: Sequence[Polygon]) -> int:
    return sum(len(shape.exterior.coords) - 1 for shape in shapes)


def _longest_edge_m(surroundings: Surroundings) -> float:
    """Length of an edge that is bent by no more than allowed, in degrees."""
    south, north = surroundings.site.to_places(np.array(surroundings.area.bounds).reshape(2, 2))[
        :, 0
    ]
    slope = math.tan(math.radians(min(max(abs(south), abs(north), 1.0), 89.0)))
    return math.sqrt(8.0 * _EARTH_RADIUS_M * _BEND_M / slope)


def _polygons(shape: BaseGeometry) -> Iterator[Polygon]:
    whole = shapely.union_all(shapely.get_parts(shape))
    return (part for part in shapely.get_parts(whole) if part.geom_type == "Polygon")
