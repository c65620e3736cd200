"""People from tables of text: columns have names, in the first row that is not blank."""

import codecs
import csv
import itertools
import re
import stat
import string
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.cells import (
    check_latitude,
    check_longitude,
    check_metres,
    cleaned,
    named_once,
    number_of_text,
    shown,
    weight_of,
)
from orchid_uav.experiments.planning.reading.table import (
    PEOPLE_NAMES,
    PeopleTable,
    Rows,
)
from orchid_uav.notices import reason_of
from orchid_uav.suggestions import did_you_mean, nearest

_LARGEST = 512 * 2**20
_LONGEST_LINE = 2**20
_MOST_LISTED = 12
_MOST_LINES = 2**20
"""Rows that a spreadsheet has."""
_NAMES = {
    "latitude": ("lat", "latitude"),
    "longitude": ("lon", "lng", "long", "longitude"),
    "x": ("x_m",),
    "y": ("y_m",),
    "people": PEOPLE_NAMES,
}
_KNOWN = tuple(itertools.chain.from_iterable(_NAMES.values()))
_PROJECTED = ("easting", "northing", "eastings", "northings", "utm_x", "utm_y")
_RIGHT = "name two columns lat and lon (degrees, WGS 84), or x_m and y_m (metres)"
_BLANK = string.whitespace + ',;"'
"""What lines without a value consist of."""
_NOT_UTF8 = re.compile("[\udc80-\udcff]")
"""Bytes that are not UTF-8, as they are carried along."""


class _Columns(NamedTuple):
    """Where in a row its values stand."""

    names: list[str]
    on_earth: bool
    first: int
    """Latitude, or x."""
    second: int
    """Longitude, or y."""
    people: int | None


class _Lines:
    """Lines of a file of text, read one after another and never many at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.is_utf8 = True

    def __iter__(self) -> Iterator[str]:
        with self._path.open("rb") as file:
            start = file.read(4)
        encoding = "utf-8-sig"
        if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            encoding = "utf-16"
        # Numbers are ASCII: other bytes, in names of places, need not be understood.
        errors = "surrogateescape" if encoding == "utf-8-sig" else "strict"
        with self._path.open(encoding=encoding, errors=errors, newline="") as text:
            for number in itertools.count(1):
                line = text.readline(_LONGEST_LINE + 1)
                if not line:
                    return
                self._check(line, number)
                yield line

    def _check(self, line: str, number: int) -> None:
        if "\0" in line:
            raise InputError(
                f"{self._path} is not a table of text: save it as CSV with the encoding UTF-8"
            )
        if len(line) > _LONGEST_LINE:
            raise InputError(
                f"{self._path} has more than {_LONGEST_LINE:,} characters in line {number}: "
                "it is not a table of people"
            )
        if number > _MOST_LINES:
            raise InputError(
                f"{self._path} has more than {_MOST_LINES:,} lines, more than a spreadsheet has"
            )
        if self.is_utf8 and not line.isascii() and _NOT_UTF8.search(line):
            self.is_utf8 = False


def read_csv(path: Path) -> PeopleTable:
    """Read a table whose delimiter is a comma, a semicolon or a tab.

    The file is UTF-8, or UTF-16 with a byte-order mark. Rows are numbered as a spreadsheet numbers
    them, blank ones included. Where the delimiter is not a comma, numbers may have decimal commas.

    Raises:
        InputError: the file cannot be read, has not the columns it needs, or has wrong rows.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise InputError(f"{path} is not a regular file: save the table in one")
        if status.st_size > _LARGEST:
            raise InputError(
                f"{path} has {status.st_size:,} bytes, more than the {_LARGEST:,} a table may have"
            )
        return _read_lines(path, _Lines(path))
    except OSError as error:
        raise InputError(f"cannot read {path}: {reason_of(error)}") from error
    except UnicodeError as error:
        raise InputError(
            f"{path} is not the UTF-16 that its first bytes announce: save it as UTF-8"
        ) from error


def _read_lines(path: Path, lines: _Lines) -> PeopleTable:
    source = iter(lines)
    blank, header = 0, ""
    for header in source:
        if header.strip(_BLANK):
            break
        blank += 1
    delimiter = _delimiter_of(header)
    records = _records(path, itertools.chain([header], source), delimiter, blank)
    _, names = next(records, (0, []))
    if not names:
        raise InputError(f"{path} is empty: {_RIGHT}")
    columns = _columns_of(path, names)
    rows = Rows(path, columns.on_earth)
    reader = _RowReader(columns, path, delimiter, rows)
    for number, cells in records:
        reader.read(number, cells)
    return rows.table(_notes(path, lines, columns))


def _notes(path: Path, lines: _Lines, columns: _Columns) -> list[str]:
    notes = []
    if columns.people is None:
        notes.append(
            f"{path} has no column {', '.join(PEOPLE_NAMES[:-1])} or {PEOPLE_NAMES[-1]}: "
            f"every row counts as one person{_unused(columns)}"
        )
    if not lines.is_utf8:
        notes.append(f"{path} is not UTF-8: its numbers were read, its other text was passed over")
    return notes


def _unused(columns: _Columns) -> str:
    """The columns that are not read, one of which may have been meant for people."""
    names = [
        shown(name)
        for place, name in enumerate(columns.names)
        if name and place not in (columns.first, columns.second)
    ]
    more = ", ..." if len(names) > _MOST_LISTED else ""
    return f" (not used: {', '.join(names[:_MOST_LISTED])}{more})" if names else ""


def _delimiter_of(header: str) -> str:
    def columns(delimiter: str) -> tuple[int, int]:
        names = next(csv.reader([header[: csv.field_size_limit()]], delimiter=delimiter), [])
        known = [name for name in names if cleaned(name).casefold() in _KNOWN]
        return len(known), len(names)

    return max(",;\t", key=columns)


def _records(
    path: Path, lines: Iterator[str], delimiter: str, blank: int
) -> Iterator[tuple[int, list[str]]]:
    """Rows that are not blank, with the numbers that a spreadsheet gives them."""
    reader = csv.reader(lines, delimiter=delimiter, strict=True)
    for number in itertools.count(blank + 1):
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(
                f"{path} cannot be read from row {number} on ({error}): "
                "is a quotation mark not closed there?"
            ) from error
        if any(cell.strip() for cell in cells):
            yield number, cells


def _columns_of(path: Path, names: list[str]) -> _Columns:
    found: dict[str, int] = {}
    for role, known in _NAMES.items():
        try:
            name = named_once(names, known)
        except ValueError as error:
            raise InputError(f"{path}: the columns {error}") from error
        if name is not None:
            found[role] = names.index(name)
    degrees, metres = ("latitude", "longitude"), ("x", "y")
    if any(role in found for role in degrees) and any(role in found for role in metres):
        both = [names[found[role]] for role in (*degrees, *metres) if role in found]
        raise InputError(
            f"{path} has columns in degrees and in metres, {' and '.join(map(shown, both))}: "
            "keep those of one kind"
        )
    for pair in (degrees, metres):
        if all(role in found for role in pair):
            return _Columns(
                names, pair == degrees, found[pair[0]], found[pair[1]], found.get("people")
            )
    raise InputError(_missing_columns(path, names, found))


def _missing_columns(path: Path, names: list[str], found: dict[str, int]) -> str:
    plain = [cleaned(name).casefold() for name in names]
    if any(name in _PROJECTED for name in plain):
        return (
            f"{path} has eastings and northings, which mean nothing without their grid: convert "
            f"them to latitude and longitude (WGS 84), and {_RIGHT}"
        )
    if all(_is_number(name) for name in names):
        return f"{path} has numbers in its first row, not names of columns: {_RIGHT}"
    listed = ", ".join(map(shown, names[:_MOST_LISTED]))
    listed += ", ..." if len(names) > _MOST_LISTED else ""
    told = f"{path} has no columns for positions; it has {listed}"
    near = [nearest(name, _KNOWN) for name in plain if name and name not in _KNOWN]
    meant = list(dict.fromkeys(name for name in near if name))
    missing = [role for role in _NAMES if role not in found and role != "people"]
    if any(role in found for role in ("latitude", "longitude", "x", "y")):
        other = {"latitude": "longitude", "longitude": "latitude", "x": "y", "y": "x"}
        role = next(role for role in missing if other[role] in found)
        told = f"{path} has no column for {role}; it has {listed}"
        meant = [name for name in meant if name in _NAMES[role]]
    return f"{told}{' (' + did_you_mean(meant) + ')' if meant else ''}: {_RIGHT}"


def _is_number(text: str) -> bool:
    try:
        number_of_text(text.replace(",", "."))
    except ValueError:
        return False
    return True


class _RowReader:
    """Takes the values out of rows, and notes what is wrong with them."""

    def __init__(self, columns: _Columns, path: Path, delimiter: str, rows: Rows) -> None:
        self._columns = columns
        self._name = path.name
        self._has_decimal_commas = delimiter != ","
        self._rows = rows
        self._mark: tuple[str, int] | None = None
        """The first decimal mark, and its row."""

    def read(self, number: int, cells: Sequence[str]) -> None:
        """Add a row to the table, or its mistakes to the list of them."""
        self._rows.count()
        source = f"{self._name}, row {number}"
        columns = self._columns
        if any(cell.strip() for cell in cells[len(columns.names) :]):
            self._rows.problems.add(
                source,
                f"{len(cells)} cells are more than the {len(columns.names)} columns that have "
                "names: is a comma in a cell without quotation marks?",
            )
            return
        check_first, check_second = (
            (check_latitude, check_longitude) if columns.on_earth else (check_metres, check_metres)
        )
        values: list[float] = []
        for place, check in ((columns.first, check_first), (columns.second, check_second)):
            try:
                value = self._number(_cell(cells, place), number)
                check(value)
                values.append(value)
            except ValueError as error:
                self._add_problem(source, place, error)
        weight = 1
        if columns.people is not None:
            try:
                weight = weight_of(_cell(cells, columns.people))
            except ValueError as error:
                self._add_problem(source, columns.people, error)
                return
        if len(values) == 2:
            self._rows.add(source, (values[0], values[1]), weight)

    def _add_problem(self, source: str, place: int, error: ValueError) -> None:
        column = cleaned(self._columns.names[place])
        self._rows.problems.add(source, f"column {column}: {error}")

    def _number(self, text: str, number: int) -> float:
        mark = "," if "," in text else "."
        if not self._has_decimal_commas or mark not in text:
            return number_of_text(text)
        try:
            value = number_of_text(text.replace(",", ".") if text.count(",") == 1 else text)
        except ValueError:
            return number_of_text(text)  # whose message shows the text as it is
        if self._mark is None:
            self._mark = mark, number
        elif self._mark[0] != mark:
            raise ValueError(
                f"{shown(text)} has another decimal mark than row {self._mark[1]}: "
                "write all numbers with a decimal point, and without separators of thousands"
            )
        return value


def _cell(cells: Sequence[str], place: int) -> str:
    return cells[place] if place < len(cells) else ""
