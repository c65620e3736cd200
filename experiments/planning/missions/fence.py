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
from orchid_uav.experiments.planning.model import Floats, Surroundings
from orchid_uav.experiments.planning.site import Place

MOST_CORNERS = 64
"""Of all polygons together: what PX4 stores; common boards with ArduPilot store some 80."""
CORRIDOR_M = 30.0
"""On both sides of a way outside of the area."""
_BEND_M = 0.03
"""Straight edges of the site's plane are straight in degrees as well up to this distance."""
_EARTH_RADIUS_M = 6.371e6
_TOLERANCES_M = (0.0, *(0.1 * 2.0**step for step in range(10)))
_COARSEST_ZONES_M = 6.4
"""Coarser ones could vanish; from here on, those farther from ways are left out instead."""
_CORNERS_FOR_ZONES = 16
_WIDER = 4.0
"""Simplification, growth by twice as much, and bent edges, in tolerances."""


class Fence(NamedTuple):
    """Polygons that a drone must stay inside or outside of."""

    polygons: tuple[tuple[bool, tuple[Place, ...]], ...]
    """Whether it is an inclusion, and its corners, not closed."""
    note: str
    """What a crew should know of it, in plain words; empty if it is exact."""


def fence_of(surroundings: Surroundings, transit: Transit) -> Fence:
    """The fence of all drones: exact if autopilots can store it, else somewhat wider."""
    outline = _outline(surroundings, transit)
    zones = _zones(surroundings, transit, outline)
    outline = _inside_of_rings(surroundings, outline)
    for tolerance_m in _TOLERANCES_M:
        border, excluded = _coarser(surroundings, outline, zones, tolerance_m)
        outline_fits = _corners([border]) <= MOST_CORNERS - _CORNERS_FOR_ZONES
        if _corners([border, *excluded]) <= MOST_CORNERS:
            break
        if tolerance_m >= _COARSEST_ZONES_M and outline_fits:
            break
    kept = [border]
    for polygon in excluded:
        if _corners([*kept, polygon]) <= MOST_CORNERS:
            kept.append(polygon)
    polygons = [
        (polygon is border, tuple(places_of(surroundings.site, _open_ring(polygon))))
        for polygon in kept
    ]
    longitudes = [place.longitude_deg for place in polygons[0][1]]
    if max(longitudes) - min(longitudes) > 180.0:
        return Fence((), "Autopilots cannot fence across longitude 180: there is no fence.")
    return Fence(tuple(polygons), _note(tolerance_m, zones, kept[1:]))


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


def _note(tolerance_m: float, zones: Sequence[Polygon], kept: Sequence[Polygon]) -> str:
    if not tolerance_m:
        return ""
    note = (
        f"The fence is up to {_WIDER * tolerance_m:.1f} m wider than the area and the no-fly zones "
        f"allow, because autopilots store {MOST_CORNERS} corners of it."
    )
    left_out = sum(not any(zone.intersects(polygon) for polygon in kept) for zone in zones)
    if left_out:
        note += f" Of {len(zones)} no-fly zones, {left_out} are not in it at all."
    return note


def _outline(surroundings: Surroundings, transit: Transit) -> Polygon:
    """Where drones may be, no-fly zones aside: the part around home."""
    home = Point(surroundings.home_m)
    if home_is_inside(surroundings):
        return next(part for part in _polygons(surroundings.area) if part.intersects(home))
    corridor = shapely.union_all([home, *_ways(transit)]).buffer(CORRIDOR_M, 2)
    whole = surroundings.area.union(corridor)
    outline = next(part for part in _polygons(whole) if part.intersects(home))
    filled = shapely.union_all([Polygon(part.exterior) for part in _polygons(surroundings.area)])
    # What ways and the border enclose is no hole of the area.
    holes = [ring for ring in outline.interiors if filled.covers(Polygon(ring))]
    return Polygon(outline.exterior, holes)


def _ways(transit: Transit) -> list[LineString]:
    return [LineString(way.outbound_m[1:, :2]) for way in transit.ways if way.length_m]


def _zones(surroundings: Surroundings, transit: Transit, outline: Polygon) -> list[Polygon]:
    """What is excluded, the nearest to ways first, without their holes."""
    home = Point(surroundings.home_m)
    ways = shapely.union_all([home, *_ways(transit)])
    zones = [Polygon(part.exterior) for part in _polygons(surroundings.no_fly)]
    zones = [zone for zone in zones if zone.intersects(outline) and not zone.contains(home)]
    holes = [Polygon(ring) for ring in outline.interiors]
    return sorted([*zones, *holes], key=lambda zone: zone.distance(ways))


def _inside_of_rings(surroundings: Surroundings, outline: Polygon) -> Polygon:
    """The outline without what lies beyond zones that enclose home like a ring."""
    home = Point(surroundings.home_m)
    inner: BaseGeometry = Polygon(outline.exterior)
    for part in _polygons(surroundings.no_fly):
        if Polygon(part.exterior).contains(home):
            inner = inner.difference(part)
    return Polygon(next(part for part in _polygons(inner) if part.intersects(home)).exterior)


def _coarser(
    surroundings: Surroundings, outline: Polygon, zones: Sequence[Polygon], tolerance_m: float
) -> tuple[Polygon, list[Polygon]]:
    """The polygons with fewer corners; no place that was allowed is forbidden by them."""
    edge_m = _longest_edge_m(surroundings, max(tolerance_m, _BEND_M))
    if tolerance_m:
        (outline,) = _resized(outline, tolerance_m, 1.0)
        zones = [part for zone in zones for part in _resized(zone, tolerance_m, -1.0)]
    return shapely.segmentize(outline, edge_m), [shapely.segmentize(zone, edge_m) for zone in zones]


def _resized(shape: Polygon, tolerance_m: float, sign: float) -> list[Polygon]:
    """Simplified, and grown or shrunk by what that takes away and what edges bend."""
    coarse = shape.simplify(tolerance_m).buffer(2.0 * sign * tolerance_m, join_style="mitre")
    return [Polygon(part.exterior) for part in _polygons(coarse)]


def _open_ring(polygon: Polygon) -> Floats:
    return np.array(polygon.exterior.coords)[:-1]


def _corners(polygons: Sequence[Polygon]) -> int:
    return sum(len(_open_ring(polygon)) for polygon in polygons)


def _longest_edge_m(surroundings: Surroundings, bend_m: float) -> float:
    """Length of an edge whose straight lines in the plane and in degrees lie so far apart."""
    corners = np.array(surroundings.area.bounds).reshape(2, 2)
    latitude_deg = np.abs(surroundings.site.to_places(corners)[:, 0]).max()
    slope = math.tan(math.radians(min(max(latitude_deg, 1.0), 89.0)))
    return math.sqrt(8.0 * _EARTH_RADIUS_M * bend_m / slope)


def _polygons(shape: BaseGeometry) -> Iterator[Polygon]:
    whole = shapely.union_all(shapely.get_parts(shape))
    return (part for part in shapely.get_parts(whole) if part.geom_type == "Polygon")
