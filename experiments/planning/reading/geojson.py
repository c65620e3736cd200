"""GeoJSON (RFC 7946), read strictly, and people from it.

A file may say ``"units": "m"`` beside its ``type``: its positions are then x and y of a site in
local metres. RFC 7946 leaves other members to whoever writes a file.
"""

import codecs
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.cells import (
    check_position,
    named_once,
    number_of_json,
    shown,
    weight_of,
)
from orchid_uav.experiments.planning.reading.table import (
    MOST_ROWS,
    PEOPLE_NAMES,
    PeopleTable,
    Rows,
)
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import read_bytes

LARGEST = 32 * 2**20
"""Bytes of a file that is read as a whole."""
_GEOMETRIES = (
    *("Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"),
    "GeometryCollection",
)
_WGS84 = (
    "urn:ogc:def:crs:OGC:1.3:CRS84",
    "urn:ogc:def:crs:OGC::CRS84",
    "urn:ogc:def:crs:EPSG::4326",
    "EPSG:4326",
    "OGC:CRS84",
)
"""Names of WGS 84 from the time before RFC 7946; longitude stood first with all of them."""


class Feature(NamedTuple):
    """A feature as it stands in the file, nothing in it checked."""

    source: str
    """What it is called in messages."""
    geometry: object
    properties: dict[str, Any]


class GeoJson(NamedTuple):
    """A file of GeoJSON."""

    features: list[Feature]
    on_earth: bool


def load_geojson(path: Path) -> GeoJson:
    """Read a FeatureCollection, a Feature, or a geometry by itself.

    Raises:
        InputError: the file cannot be read, or is no GeoJSON in WGS 84 or in metres.
    """
    document = _load_json(path)
    if not isinstance(document, dict):
        raise InputError(f"{path} is not GeoJSON: it has {shown(document)} instead of an object")
    units = document.get("units")
    if "units" in document and units != "m":
        raise InputError(
            f"{path} has \"units\": {shown(units)}: write 'm' for metres, or leave it away for "
            "degrees (WGS 84)"
        )
    if "crs" in document:
        _check_crs(path, document["crs"], in_metres=units == "m")
    kind = document.get("type")
    if kind == "FeatureCollection":
        features = document.get("features")
        if not isinstance(features, list):
            raise InputError(f"{path} is a FeatureCollection without a list of features")
        if len(features) > MOST_ROWS:
            raise InputError(f"{path} has {len(features):,} features, more than {MOST_ROWS:,}")
        found = [
            _feature(f"{path.name}, feature {number}", feature)
            for number, feature in enumerate(features, 1)
        ]
    elif kind == "Feature":
        found = [_feature(path.name, document)]
    elif kind in _GEOMETRIES:
        found = [Feature(path.name, document, {})]
    else:
        raise InputError(
            f"{path} is not GeoJSON: its type is {shown(kind)}, not 'FeatureCollection' or "
            "'Feature'"
        )
    return GeoJson(found, on_earth=units != "m")


def _load_json(path: Path) -> object:
    try:
        content = read_bytes(path, LARGEST)
    except OSError as error:
        raise InputError(f"cannot read {path}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(str(error)) from error
    try:
        text = content.removeprefix(codecs.BOM_UTF8).decode("utf-8")
        return json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_without_twins)
    except UnicodeError as error:
        raise InputError(f"{path} is not UTF-8, as GeoJSON has to be ({error})") from error
    except RecursionError as error:
        raise InputError(f"{path} is nested too deeply for GeoJSON") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON: {error}") from error


def _refuse_constant(constant: str) -> None:
    raise ValueError(f"it holds {constant}, which is no number of JSON")


def _without_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        (twin, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        raise ValueError(f"an object has the key {shown(twin)} twice")
    return found


def _check_crs(path: Path, crs: object, in_metres: bool) -> None:
    if crs is None and in_metres:
        return
    properties = crs.get("properties") if isinstance(crs, dict) else None
    name = properties.get("name") if isinstance(properties, dict) else None
    if in_metres or name not in _WGS84:
        raise InputError(
            f"{path} has a coordinate system of its own, {shown(name or crs)}: "
            + (
                'leave "crs" away where "units" are metres'
                if in_metres
                else "convert it to WGS 84 (longitude and latitude), which is what GeoJSON has"
            )
        )


def _feature(source: str, value: object) -> Feature:
    if not isinstance(value, dict) or value.get("type") != "Feature":
        return Feature(source, value, {})  # refused with the geometry that it is not
    properties = value.get("properties")
    return Feature(
        source, value.get("geometry"), properties if isinstance(properties, dict) else {}
    )


def geometry_of(value: object, wanted: Sequence[str]) -> tuple[str, object]:
    """The type and the coordinates of a geometry of one of the wanted types.

    Raises:
        ValueError: it is none.
    """
    right = f"would be right: {' or '.join(wanted)}"
    if value is None:
        raise ValueError(f"it has no geometry; {right}")
    if not isinstance(value, dict):
        raise ValueError(f"{shown(value)} is no geometry; {right}")
    kind = value.get("type")
    if kind not in wanted:
        raise ValueError(f"its geometry is {shown(kind)}; {right}")
    return str(kind), value.get("coordinates")


def position_of(value: object) -> tuple[float, float]:
    """The first two numbers of a position, in the order of the file; a height is passed over.

    Raises:
        ValueError: it is no position.
    """
    if not isinstance(value, list) or not 2 <= len(value) <= 4:
        raise ValueError(f"{shown(value)} is not a position: write [longitude, latitude]")
    return number_of_json(value[0]), number_of_json(value[1])


def read_geojson_people(path: Path) -> PeopleTable:
    """Read people from Points and MultiPoints, and their numbers from properties.

    Raises:
        InputError: the file cannot be read, or has wrong features.
    """
    file = load_geojson(path)
    rows = Rows(path, file.on_earth)
    with_weight = 0
    for feature in file.features:
        try:
            positions = _positions_of(feature.geometry)
            name = named_once(list(feature.properties), PEOPLE_NAMES)
            weight = 1
            if name is not None:
                with_weight += 1
                weight = weight_of(feature.properties[name])
                check_weight_is_of_one(weight, positions)
        except ValueError as error:
            rows.count()
            rows.problems.add(feature.source, str(error))
            continue
        for position in positions:
            rows.count()
            try:
                coordinates = _coordinates_of(position, file.on_earth)
            except ValueError as error:
                rows.problems.add(feature.source, str(error))
                continue
            rows.add(feature.source, coordinates, weight)
    return rows.table(note_on_weights(path, with_weight, len(file.features), "feature"))


def _positions_of(geometry: object) -> list[Any]:
    kind, coordinates = geometry_of(geometry, ("Point", "MultiPoint"))
    if kind == "Point":
        return [coordinates]
    if not isinstance(coordinates, list) or not coordinates:
        raise ValueError("it is a MultiPoint without positions")
    return coordinates


def _coordinates_of(value: object, on_earth: bool) -> tuple[float, float]:
    first, second = position_of(value)
    coordinates = (second, first) if on_earth else (first, second)
    check_position(*coordinates, on_earth)
    return coordinates


def check_weight_is_of_one(weight: int, positions: Sequence[object]) -> None:
    """Raise ValueError for a number of people that several positions share: whose is it?"""
    if weight > 1 and len(positions) > 1:
        raise ValueError(
            f"{weight} people are given for {len(positions)} positions together: give each "
            "position and its people by themselves"
        )


def note_on_weights(path: Path, with_weight: int, count: int, unit: str) -> list[str]:
    """A note on how many features or placemarks do not say how many people they stand for."""
    if with_weight == count:
        return []
    names = f"{', '.join(PEOPLE_NAMES[:-1])} or {PEOPLE_NAMES[-1]}"
    which = f"no {unit}" if not with_weight else f"only {with_weight:,} of {count:,} {unit}s"
    verb = "has" if with_weight <= 1 else "have"
    return [
        f"{path}: {which} {verb} a property {names}; a position without it counts as one person"
    ]
