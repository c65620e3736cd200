"""Checks the fence of a mission, and the mission against it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon

from orchid_uav.experiments.planning.missions.fence import MOST_CORNERS
from orchid_uav.experiments.planning.missions.findings import Findings, is_number, position_of
from orchid_uav.experiments.planning.missions.plan_file import FENCE_VERSION, SHAPE_VERSION
from orchid_uav.experiments.planning.site import Place, Site

_CIRCLE_CORNERS = 72


class Shape(NamedTuple):
    """A part of a fence, in degrees: longitude is x, latitude is y, as autopilots compare them."""

    where: str
    inclusion: bool
    polygon: Polygon


class Route(NamedTuple):
    """What a mission flies along, in degrees."""

    where: str
    line: LineString
    """Longitudes and latitudes; of one point, if it is but a place."""
    what: str


def fence_shapes(findings: Findings, document: dict[str, Any]) -> list[Shape]:
    """The usable polygons and circles of a ``.plan`` file's fence."""
    fence = findings.member(document, "", "geoFence", "an object")
    if fence is None:
        return []
    findings.version(fence, "geoFence", FENCE_VERSION)
    polygons = findings.member(fence, "geoFence", "polygons", "a list") or []
    circles = findings.member(fence, "geoFence", "circles", "a list") or []
    shapes = []
    corners = len(circles)
    for index, polygon in enumerate(polygons):
        shape = _polygon(findings, polygon, f"geoFence.polygons[{index}]")
        if shape is not None:
            shapes.append(shape)
            corners += len(shape.polygon.exterior.coords) - 1
    for index, circle in enumerate(circles):
        shape = _circle(findings, circle, f"geoFence.circles[{index}]")
        if shape is not None:
            shapes.append(shape)
    if corners > MOST_CORNERS:
        findings.warning(
            "geoFence",
            f"the fence has {corners} corners; PX4 stores {MOST_CORNERS}, common boards with "
            "ArduPilot about 80: it would be refused there. Fewer corners load everywhere",
        )
    return shapes


def check_routes(
    findings: Findings, shapes: Sequence[Shape], home: Place | None, routes: Sequence[Route]
) -> None:
    """Check that home and all routes lie inside inclusions and outside of exclusions."""
    for shape in shapes:
        shapely.prepare(shape.polygon)
        if home is not None:
            at_home = shape.polygon.contains(Point(home.longitude_deg, home.latitude_deg))
            if at_home != shape.inclusion:
                side = "outside of this inclusion" if shape.inclusion else "inside this exclusion"
                findings.error(
                    shape.where,
                    f"home lies {side}: PX4 drops it, ArduPilot does not arm; it has to be on the "
                    "other side, or the shape has to go",
                )
                continue
        for route in routes:
            if shape.inclusion and not shape.polygon.covers(route.line):
                findings.error(route.where, f"{route.what} leaves the inclusion {shape.where}")
            elif not shape.inclusion and shape.polygon.intersects(route.line):
                findings.error(route.where, f"{route.what} enters the exclusion {shape.where}")


def _polygon(findings: Findings, polygon: Any, where: str) -> Shape | None:
    if not isinstance(polygon, dict):
        findings.error(where, "this is no object; it has to hold inclusion, polygon and version")
        return None
    findings.version(polygon, where, SHAPE_VERSION)
    inclusion = findings.member(polygon, where, "inclusion", "true or false")
    written = findings.member(polygon, where, "polygon", "a list")
    shape = None if written is None else _shape(findings, written, f"{where}.polygon")
    return None if shape is None or inclusion is None else Shape(where, inclusion, shape)


def _shape(findings: Findings, written: list[Any], where: str) -> Polygon | None:
    read = [
        position_of(findings, corner, f"{where}[{index}]", 2)
        for index, corner in enumerate(written)
    ]
    corners = [corner for corner in read if corner is not None]
    if len(corners) < len(read):
        return None
    if len(corners) > 1 and corners[0] == corners[-1]:
        findings.error(
            where,
            "the last corner repeats the first; leave it out, programs close polygons themselves",
        )
        corners.pop()
    if len(corners) < 3:
        findings.error(where, f"it has {len(corners)} corners; a polygon has three at least")
        return None
    degrees = np.array(corners)[:, ::-1]
    if np.ptp(degrees[:, 0]) > 180.0:
        findings.error(where, "it crosses longitude 180, which autopilots cannot fence")
        return None
    shape = Polygon(degrees)
    if not shape.is_valid:
        findings.error(
            where, "its edges cross or touch each other; corners have to follow one another"
        )
        return None
    return shape


def _circle(findings: Findings, circle: Any, where: str) -> Shape | None:
    if not isinstance(circle, dict):
        findings.error(where, "this is no object; it has to hold inclusion, circle and version")
        return None
    findings.version(circle, where, SHAPE_VERSION)
    inclusion = findings.member(circle, where, "inclusion", "true or false")
    inner = findings.member(circle, where, "circle", "an object")
    if inner is None or inclusion is None:
        return None
    center = position_of(findings, inner.get("center"), f"{where}.circle.center", 2)
    radius_m = inner.get("radius")
    if not is_number(radius_m) or radius_m <= 0.0:
        findings.error(f"{where}.circle.radius", "it has to be a number of metres above 0")
        return None
    if center is None:
        return None
    return Shape(where, inclusion, Polygon(ring(Place(*center), float(radius_m))))


def ring(center: Place, radius_m: float) -> np.ndarray[Any, Any]:
    """Longitudes and latitudes of a circle, (K, 2)."""
    turns = 2.0 * np.pi * np.arange(_CIRCLE_CORNERS) / _CIRCLE_CORNERS
    points_m = radius_m * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return Site(center).to_places(points_m)[:, ::-1]
