"""Areas where drones may be, and zones where they may not: polygons from GeoJSON and KML."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from shapely.geometry import Polygon

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.cells import shown
from orchid_uav.experiments.planning.reading.geojson import (
    geometry_of,
    load_geojson,
    position_of,
)
from orchid_uav.experiments.planning.reading.kml import (
    descendants,
    geometries_of,
    load_kml,
    local_name,
    tuples_of,
)
from orchid_uav.experiments.planning.reading.polygons import corner_count, polygon_of
from orchid_uav.experiments.planning.reading.table import Problems

_MOST_CORNERS = 100_000


@dataclass(frozen=True)
class Zones:
    """Polygons of a file; where they overlap they are one."""

    path: Path
    """The file."""
    polygons: tuple[Polygon, ...]
    """At least one: longitude and latitude in degrees, or x and y in m. Longitudes of a polygon
    across the antimeridian go on beyond 180, or below -180."""
    on_earth: bool
    """Whether the coordinates are degrees (WGS 84)."""


def read_zones(path: Path) -> Zones:
    """Read the polygons of a GeoJSON, KML or KMZ file; its ending says its format.

    Raises:
        InputError: the file cannot be read, has none, or some that are not valid; the message
            names up to twenty of them.
    """
    suffix = path.suffix.lower()
    problems = Problems(path)
    if suffix in (".geojson", ".json"):
        polygons, on_earth = _geojson_polygons(path, problems)
    elif suffix in (".kml", ".kmz"):
        polygons, on_earth = _kml_polygons(path, problems), True
    else:
        what = "is a table, which has no polygons" if suffix in (".csv", ".tsv", ".txt") else ""
        raise InputError(
            f"{path} {what or 'ends in none of .geojson, .json, .kml, .kmz'}: "
            "give areas and zones as GeoJSON or KML"
        )
    problems.raise_if_any()
    if not polygons:
        raise InputError(f"{path} has no polygon: draw at least one")
    if corner_count(polygons) > _MOST_CORNERS:
        raise InputError(
            f"{path} has polygons with {corner_count(polygons):,} corners together, more than "
            f"{_MOST_CORNERS:,}: simplify them, or keep those near the site"
        )
    return Zones(path, tuple(polygons), on_earth)


def _geojson_polygons(path: Path, problems: Problems) -> tuple[list[Polygon], bool]:
    file = load_geojson(path)
    polygons = []
    for feature in file.features:
        try:
            kind, coordinates = geometry_of(feature.geometry, ("Polygon", "MultiPolygon"))
            parts = _list(coordinates) if kind == "MultiPolygon" else [coordinates]
            if not parts:
                raise ValueError("it is a MultiPolygon without polygons")
        except ValueError as error:
            problems.add(feature.source, str(error))
            continue
        for number, part in enumerate(parts, 1):
            try:
                rings = [[position_of(one) for one in _list(ring)] for ring in _list(part)]
                polygons.append(polygon_of(rings, file.on_earth))
            except ValueError as error:
                problems.add(_part(feature.source, number, len(parts)), str(error))
    return polygons, file.on_earth


def _list(value: object) -> list[object]:
    if not isinstance(value, list):
        raise ValueError(f"{shown(value)} stands where a list of coordinates belongs")
    return value


def _part(source: str, number: int, count: int) -> str:
    return source if count == 1 else f"{source}, polygon {number}"


def _kml_polygons(path: Path, problems: Problems) -> list[Polygon]:
    polygons = []
    for placemark in load_kml(path):
        try:
            parts = geometries_of(placemark, "Polygon")
        except ValueError as error:
            problems.add(placemark.source, str(error))
            continue
        for number, part in enumerate(parts, 1):
            try:
                polygons.append(polygon_of(list(_kml_rings(part)), on_earth=True))
            except ValueError as error:
                problems.add(_part(placemark.source, number, len(parts)), str(error))
    return polygons


def _kml_rings(polygon: Element) -> Iterator[list[tuple[float, float]]]:
    """The exterior ring and then the holes."""
    for name in ("outerBoundaryIs", "innerBoundaryIs"):
        rings = [
            ring
            for boundary in polygon
            if local_name(boundary) == name
            for ring in descendants(boundary, "LinearRing")
        ]
        if name == "outerBoundaryIs" and len(rings) != 1:
            raise ValueError(f"a Polygon has {len(rings)} outer rings: it must have one")
        yield from map(tuples_of, rings)
