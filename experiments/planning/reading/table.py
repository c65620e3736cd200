"""What was read of where people are, and the list of what is wrong with a file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.errors import InputError

MOST_ROWS = 20_000
"""Rows, features or placemarks with people; a row that stands for forty people is one."""
MOST_OF_ONE_ROW = 100_000
"""People that a row may stand for."""
MOST_PEOPLE = 10_000_000
"""People of a file, weights counted."""
_MOST_SHOWN = 20
_MANY_REPEATED = 0.05
PEOPLE_NAMES = ("people", "weight", "count")
"""Of the column or property that says how many people a row stands for."""


@dataclass(frozen=True)
class PeopleTable:
    """Where people are, as their file has it."""

    path: Path
    """The file."""
    coordinates: NDArray[np.float64]
    """Latitude and longitude in degrees, or x and y in m, (P, 2)."""
    on_earth: bool
    """Whether the coordinates are degrees (WGS 84)."""
    weights: NDArray[np.int64]
    """People that each row stands for, (P,), at least 1."""
    sources: tuple[str, ...]
    """What each row is called in messages: ``people.csv, row 17``."""
    notes: tuple[str, ...]
    """Decisions that were taken in reading, in plain words."""


class Problems:
    """Collects what is wrong with a file, so that all of it can be told at once."""

    def __init__(self, path: Path) -> None:
        """Begin an empty list of the problems of a file."""
        self._path = path
        self._lines: list[str] = []
        self._count = 0

    def add(self, source: str, text: str) -> None:
        """Add a problem: where it is, and a value with what would be right."""
        self._count += 1
        if self._count <= _MOST_SHOWN:
            self._lines.append(f"  {source}: {text}")

    def raise_if_any(self) -> None:
        """Raise InputError with a line that sums up, twenty problems, and how many more."""
        if not self._count:
            return
        mistakes = "1 mistake" if self._count == 1 else f"{self._count:,} mistakes"
        lines = [f"{self._path} has {mistakes}; correct the file and try again:", *self._lines]
        if self._count > _MOST_SHOWN:
            lines.append(f"  and {self._count - _MOST_SHOWN:,} more")
        raise InputError("\n".join(lines))


class Rows:
    """Rows of people as they are read, up to as many as a plan may have."""

    def __init__(self, path: Path, on_earth: bool) -> None:
        """Begin a table without rows."""
        self.problems = Problems(path)
        self._path = path
        self._on_earth = on_earth
        self._coordinates: list[tuple[float, float]] = []
        self._weights: list[int] = []
        self._sources: list[str] = []
        self._count = 0

    def count(self) -> None:
        """Count a row, right or wrong, before it is looked at.

        Raises:
            InputError: that is one row too many.
        """
        self._count += 1
        if self._count > MOST_ROWS:
            raise InputError(
                f"{self._path} has more than {MOST_ROWS:,} positions: join neighbours into one, "
                f"and give their number as '{PEOPLE_NAMES[0]}'"
            )

    def add(self, source: str, coordinates: tuple[float, float], weight: int) -> None:
        """Add a row: latitude and longitude in degrees or x and y in m, and its people."""
        self._sources.append(source)
        self._coordinates.append(coordinates)
        self._weights.append(weight)

    def table(self, notes: Sequence[str]) -> PeopleTable:
        """The table of all rows.

        Raises:
            InputError: a row is wrong, there is none, or they are too many people.
        """
        self.problems.raise_if_any()
        if not self._sources:
            raise InputError(f"{self._path} has nobody in it: give at least one position")
        if sum(self._weights) > MOST_PEOPLE:
            raise InputError(
                f"{self._path} has {sum(self._weights):,} people, more than the {MOST_PEOPLE:,} "
                "that a plan may have"
            )
        coordinates = np.array(self._coordinates, np.float64)
        return PeopleTable(
            path=self._path,
            coordinates=coordinates,
            on_earth=self._on_earth,
            weights=np.array(self._weights, np.int64),
            sources=tuple(self._sources),
            notes=(*notes, *_note_on_repeated(coordinates)),
        )


def _note_on_repeated(coordinates: NDArray[np.float64]) -> list[str]:
    repeated = len(coordinates) - len(np.unique(coordinates, axis=0))
    if repeated <= _MANY_REPEATED * len(coordinates):
        return []
    return [
        f"{repeated:,} of {len(coordinates):,} rows repeat the position of another row; all are "
        "kept, as each may be another person"
    ]
