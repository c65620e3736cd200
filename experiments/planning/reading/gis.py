"""People from formats of geographic information systems, by GDAL through the extra ``[gis]``."""

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.cells import check_position, named_once, weight_of
from orchid_uav.experiments.planning.reading.geojson import (
    check_weight_is_of_one,
    note_on_weights,
)
from orchid_uav.experiments.planning.reading.table import (
    MOST_ROWS,
    PEOPLE_NAMES,
    PeopleTable,
    Rows,
)
from orchid_uav.extras import install_command
from orchid_uav.notices import in_one_line, reason_of

FORMATS = {
    ".gpkg": ("GeoPackage", b"SQLite format 3\0"),
    ".shp": ("Shapefile", b"\x00\x00\x27\x0a"),
    ".fgb": ("FlatGeobuf", b"fgb"),
    ".gpx": ("GPX", b"<gpx"),
}
"""Name of a format by a file's ending, and bytes near the file's beginning.

GDAL decides by content, and some of what it opens refers to other files or to the network.
"""
_BEGINNING = 4096
_WGS84 = ("EPSG:4326", "OGC:CRS84")
_LAYER_OF_GPX = "waypoints"


class _Layer(NamedTuple):
    """What GDAL read."""

    system: str | None
    """The coordinate system."""
    fields: list[str]
    values: list[Any]
    """An array per field."""
    geometries: Any
    """Of shapely."""
    notes: list[str]


def read_gis_people(path: Path) -> PeopleTable:
    """Read people from the points of a GeoPackage, Shapefile, FlatGeobuf or GPX file.

    Raises:
        InputError: pyogrio is not installed, the file cannot be read, or has wrong features.
    """
    _check_beginning(path)
    try:
        import pyogrio
    except ImportError as error:
        raise InputError(
            f"{path} is read by pyogrio, which cannot be imported ({in_one_line(error)}).\n"
            f"To install it: {install_command('gis')}; or save the file as GeoJSON"
        ) from error
    layer = _read_layer(path, pyogrio)
    if layer.system not in _WGS84:
        raise InputError(
            f"{path} is in the coordinate system {layer.system or 'that it does not name'}: "
            "convert it to WGS 84 (EPSG:4326)"
        )
    try:
        name = named_once(layer.fields, PEOPLE_NAMES)
    except ValueError as error:
        raise InputError(f"{path}: the fields {error}") from error
    rows = Rows(path, on_earth=True)
    for place, geometry in enumerate(layer.geometries):
        source = f"{path.name}, feature {place + 1}"
        try:
            points = _points_of(geometry)
            weight = 1
            if name is not None:
                weight = weight_of(_plain(layer.values[layer.fields.index(name)][place]))
                check_weight_is_of_one(weight, points)
        except ValueError as error:
            rows.count()
            rows.problems.add(source, str(error))
            continue
        for longitude, latitude in points:
            rows.count()
            try:
                check_position(latitude, longitude, on_earth=True)
            except ValueError as error:
                rows.problems.add(source, str(error))
                continue
            rows.add(source, (latitude, longitude), weight)
    count = len(layer.geometries)
    notes = note_on_weights(path, 0 if name is None else count, count, "feature")
    return rows.table([*layer.notes, *notes])


def _check_beginning(path: Path) -> None:
    name, mark = FORMATS[path.suffix.lower()]
    try:
        if not path.is_file():
            raise InputError(f"{path} is not a file")
        with path.open("rb") as file:
            beginning = file.read(_BEGINNING)
    except OSError as error:
        raise InputError(f"cannot read {path}: {reason_of(error)}") from error
    is_text = mark.startswith(b"<")
    if not (mark in beginning if is_text else beginning.startswith(mark)):
        raise InputError(f"{path} is not the {name} file that its name says")


def _read_layer(path: Path, pyogrio: Any) -> _Layer:
    # An absolute path cannot be mistaken for one of GDAL's own addresses.
    where = path.resolve()
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            layer = _layer_of(path, pyogrio.list_layers(where).tolist())
            meta, _, geometry, values = pyogrio.raw.read(
                where, layer=layer, force_2d=True, max_features=MOST_ROWS + 1
            )
            geometries = shapely.from_wkb(geometry)
    except InputError:
        raise
    except Exception as error:  # damaged files bring up all kinds, UnboundLocalError too
        raise InputError(f"cannot read {path}: {in_one_line(error)}") from error
    notes = [f"{path}: {' '.join(str(one.message).split())}" for one in told]
    return _Layer(meta["crs"], list(meta["fields"]), values, geometries, notes)


def _layer_of(path: Path, layers: list[list[str | None]]) -> str | None:
    names = [str(name) for name, kind in layers if kind is not None]
    if path.suffix.lower() == ".gpx":
        return _LAYER_OF_GPX
    if len(names) != 1:
        listed = f"several layers, {', '.join(names)}" if names else "no layer with places"
        raise InputError(f"{path} has {listed}: save the one with people as a file of its own")
    return names[0]


def _points_of(geometry: Any) -> list[tuple[float, float]]:
    if geometry is None or geometry.is_empty:
        raise ValueError("it has no geometry; would be right: Point or MultiPoint")
    if geometry.geom_type not in ("Point", "MultiPoint"):
        raise ValueError(
            f"its geometry is {geometry.geom_type!r}; would be right: Point or MultiPoint"
        )
    points = shapely.get_coordinates(geometry).tolist()
    if not np.isfinite(points).all():
        raise ValueError("its position is not finite")
    return [(longitude, latitude) for longitude, latitude in points]


def _plain(value: Any) -> object:
    """A value of an array as a number or text; None where it is missing."""
    plain = value.item() if isinstance(value, np.generic) else value
    return None if plain != plain else plain  # noqa: PLR0124 - NaN is how a missing number is read
