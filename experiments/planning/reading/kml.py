"""KML (2.2, with or without its namespace) and KMZ, and people from it."""

import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, ParseError

import defusedxml.ElementTree
from defusedxml import DefusedXmlException

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.cells import (
    check_position,
    named_once,
    number_of_text,
    shown,
    weight_of,
)
from orchid_uav.experiments.planning.reading.geojson import (
    LARGEST,
    check_weight_is_of_one,
    note_on_weights,
)
from orchid_uav.experiments.planning.reading.table import (
    PEOPLE_NAMES,
    PeopleTable,
    Rows,
)
from orchid_uav.notices import in_one_line, reason_of
from orchid_uav.storage.files import read_bytes

_GEOMETRIES = ("Point", "LineString", "Polygon", "Model", "Track", "MultiTrack")
"""Geometries of placemarks; a LinearRing may also be part of a Polygon."""


class Placemark(NamedTuple):
    """A placemark of a file."""

    source: str
    """What it is called in messages."""
    element: Element


def load_kml(path: Path) -> list[Placemark]:
    """Read the placemarks of a KML, or of the first KML in a KMZ.

    Raises:
        InputError: the file cannot be read, is no KML, or has contents that lie elsewhere.
    """
    try:
        content = read_bytes(path, LARGEST)
    except OSError as error:
        raise InputError(f"cannot read {path}: {reason_of(error)}") from error
    except ValueError as error:
        raise InputError(str(error)) from error
    if content.startswith(b"PK\x03\x04"):
        content = _unzipped(path, content)
    try:
        root = defusedxml.ElementTree.fromstring(content, forbid_dtd=True)
    except DefusedXmlException as error:
        raise InputError(
            f"{path} declares a document type, entities or references to other files, which KML "
            "does not need: remove them"
        ) from error
    except (ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path} is not valid XML: {in_one_line(error)}") from error
    if local_name(root) != "kml":
        raise InputError(
            f"{path} is not KML: its outermost element is {shown(local_name(root))}, not 'kml'"
        )
    if next(descendants(root, "NetworkLink"), None) is not None:
        raise InputError(
            f"{path} links to contents that lie elsewhere (NetworkLink), which are not fetched: "
            "save what it shows as KML of its own"
        )
    return [
        Placemark(_source(path, number, element), element)
        for number, element in enumerate(descendants(root, "Placemark"), 1)
    ]


def _unzipped(path: Path, content: bytes) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            if not names:
                raise InputError(f"{path} is a zip file without a KML in it")
            with archive.open(names[0]) as file:
                found = file.read(LARGEST + 1)
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError) as error:
        raise InputError(f"{path} is a damaged KMZ: {in_one_line(error)}") from error
    except (RuntimeError, ValueError, LookupError) as error:  # encrypted, or packed otherwise
        raise InputError(f"{path} cannot be unpacked: {in_one_line(error)}") from error
    if len(found) > LARGEST:
        raise InputError(
            f"{path} holds a KML of more than the {LARGEST:,} bytes it may have: save it smaller"
        )
    return found


def local_name(element: Element) -> str:
    """The name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def descendants(element: Element, name: str) -> Iterator[Element]:
    """All elements of a name that lie in another, at any depth."""
    return (inner for inner in element.iter() if local_name(inner) == name)


def _source(path: Path, number: int, element: Element) -> str:
    name = next((text_of(inner) for inner in element if local_name(inner) == "name"), "")
    return f"{path.name}, placemark {number}" + (f" {shown(name)}" if name else "")


def text_of(element: Element) -> str:
    """The text of an element without blanks around it."""
    return (element.text or "").strip()


def geometries_of(placemark: Placemark, wanted: str) -> list[Element]:
    """The geometries of a placemark, which has at least one, and none that is not wanted.

    Raises:
        ValueError: it has none, or another one.
    """
    names = [local_name(inner) for inner in placemark.element.iter()]
    for name in names:
        if name in _GEOMETRIES and name != wanted:
            raise ValueError(f"its geometry is a {name}; would be right: {wanted}")
    found = list(descendants(placemark.element, wanted))
    if not found:
        what = "its geometry is a LinearRing" if "LinearRing" in names else "it has no geometry"
        raise ValueError(f"{what}; would be right: {wanted}")
    return found


def tuples_of(geometry: Element) -> list[tuple[float, float]]:
    """Longitudes and latitudes of the coordinates directly in a geometry; heights passed over.

    Raises:
        ValueError: there are none, or something else.
    """
    inner = [child for child in geometry if local_name(child) == "coordinates"]
    text = text_of(inner[0]) if len(inner) == 1 else ""
    if not text:
        raise ValueError(f"a {local_name(geometry)} has no coordinates: write longitude,latitude")
    found = []
    for part in re.sub(r"\s*,\s*", ",", text).split():
        numbers = part.split(",")
        if not 2 <= len(numbers) <= 3:
            raise ValueError(
                f"{shown(part)} is not a position: write longitude,latitude or "
                "longitude,latitude,height with commas, and a blank before the next position"
            )
        if len(numbers) == 3 and numbers[2]:
            number_of_text(numbers[2])
        found.append((number_of_text(numbers[0]), number_of_text(numbers[1])))
    return found


def read_kml_people(path: Path) -> PeopleTable:
    """Read people from Points, also those of a MultiGeometry, and their numbers from ExtendedData.

    Raises:
        InputError: the file cannot be read, or has wrong placemarks.
    """
    placemarks = load_kml(path)
    rows = Rows(path, on_earth=True)
    with_weight = 0
    for placemark in placemarks:
        try:
            points = geometries_of(placemark, "Point")
            data = _data_of(placemark.element)
            name = named_once([key for key, _ in data], PEOPLE_NAMES)
            weight = 1
            if name is not None:
                with_weight += 1
                weight = weight_of(dict(data)[name])
                check_weight_is_of_one(weight, points)
        except ValueError as error:
            rows.count()
            rows.problems.add(placemark.source, str(error))
            continue
        for point in points:
            rows.count()
            try:
                coordinates = _coordinates_of(point)
            except ValueError as error:
                rows.problems.add(placemark.source, str(error))
                continue
            rows.add(placemark.source, coordinates, weight)
    return rows.table(note_on_weights(path, with_weight, len(placemarks), "placemark"))


def _coordinates_of(point: Element) -> tuple[float, float]:
    tuples = tuples_of(point)
    if len(tuples) != 1:
        raise ValueError(f"a Point has {len(tuples)} positions: it must have one")
    longitude, latitude = tuples[0]
    check_position(latitude, longitude, on_earth=True)
    return latitude, longitude


def _data_of(element: Element) -> list[tuple[str, str]]:
    """Names and values of ``Data`` and ``SimpleData``."""
    found = []
    for inner in element.iter():
        if local_name(inner) == "SimpleData":
            found.append((inner.get("name", ""), text_of(inner)))
        elif local_name(inner) == "Data":
            value = "".join(text_of(child) for child in inner if local_name(child) == "value")
            found.append((inner.get("name", ""), value))
    return found
