"""Single values of files and options: numbers, degrees, metres, and numbers of people.

What is wrong with a value is a ValueError whose text shows it and says what would be right.
"""

import math
import re
import reprlib
from collections.abc import Sequence

from orchid_uav.experiments.planning.reading.table import MOST_OF_ONE_ROW

MOST_POLAR_DEG = 89.9
"""Latitudes nearer to a pole have no usable east and west."""
_MOST_M = 1e7
"""Local coordinates at most; northings of national grids reach that far."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_OF_DEGREES = "°º′″"
"""Marks of angles; a plain apostrophe may part thousands."""
_WHOLE = re.compile(r"\+?(\d{1,18})(?:\.0)?", re.ASCII)
_UNSEEN = {ord("\u2212"): "-"} | dict.fromkeys(map(ord, "\ufeff\u200b\u200e\u200f\u2060"))
"""A typographic minus is meant as one; marks that have no width come along when text is copied."""
_SHOWN = reprlib.Repr()
_SHOWN.maxlevel, _SHOWN.maxstring, _SHOWN.maxother = 2, 60, 60


def shown(value: object) -> str:
    """A value as messages show it: in quotes if it is text, and never longer than a line."""
    return _SHOWN.repr(value)


def cleaned(text: str) -> str:
    """Text without blanks around it and without characters that nobody sees."""
    return text.translate(_UNSEEN).strip()


def named_once(names: Sequence[str], wanted: Sequence[str]) -> str | None:
    """The only one of some columns or properties that has a wanted name; None if there is none.

    Names are compared without regard to case and to blanks around them.

    Raises:
        ValueError: several have.
    """
    found = [name for name in names if cleaned(name).casefold() in wanted]
    if len(found) > 1:
        raise ValueError(f"{' and '.join(map(shown, found))} mean the same: keep one of them")
    return found[0] if found else None


def number_of_text(text: str) -> float:
    """The finite number that a cell or an option holds.

    Raises:
        ValueError: the text is empty, no number, or one that is not finite.
    """
    number = cleaned(text)
    if not number:
        raise ValueError("the value is missing")
    if not _NUMBER.fullmatch(number):
        right = "write it with a decimal point and without units, such as -62.7204"
        if any(mark in number for mark in _OF_DEGREES):
            right = (
                "write decimal degrees instead of minutes and seconds (degrees + minutes / 60 + "
                "seconds / 3600), positive in the north and the east, such as -62.7204"
            )
        raise ValueError(f"{shown(text)} is not a number: {right}")
    return _finite(float(number), text)


def number_of_json(value: object) -> float:
    """The finite number that a JSON value is.

    Raises:
        ValueError: it is something else.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{shown(value)} is not a number")
    try:
        return _finite(float(value), value)
    except OverflowError:
        return _finite(math.inf, value)


def _finite(number: float, value: object) -> float:
    if not math.isfinite(number):
        raise ValueError(f"{shown(value)} is not a finite number")
    return number


def check_latitude(latitude_deg: float) -> None:
    """Raise ValueError unless a site can lie there."""
    if not -90 <= latitude_deg <= 90:
        raise ValueError(
            f"{latitude_deg!r} is not a latitude, which lies between -90 and 90 degrees "
            "(are latitude and longitude swapped?)"
        )
    if abs(latitude_deg) > MOST_POLAR_DEG:
        raise ValueError(
            f"latitude {latitude_deg!r} is too near to a pole: plans are made between "
            f"-{MOST_POLAR_DEG} and {MOST_POLAR_DEG} degrees"
        )


def check_longitude(longitude_deg: float, most_deg: float = 180.0) -> None:
    """Raise ValueError unless it is a longitude."""
    if not -most_deg <= longitude_deg <= most_deg:
        raise ValueError(
            f"{longitude_deg!r} is not a longitude, which lies between "
            f"-{most_deg:g} and {most_deg:g} degrees"
        )


def check_metres(value_m: float) -> None:
    """Raise ValueError unless it can be a coordinate in metres."""
    if abs(value_m) > _MOST_M:
        raise ValueError(
            f"{value_m!r} is not a place of a site in metres: it is more than "
            f"{_MOST_M / 1000:,.0f} km from the origin"
        )


def check_position(first: float, second: float, on_earth: bool) -> None:
    """Raise ValueError unless latitude and longitude, or x and y in metres, can be a site's."""
    if on_earth:
        check_latitude(first)
        check_longitude(second)
    else:
        check_metres(first)
        check_metres(second)


def weight_of(value: object) -> int:
    """How many people a cell or a property says there are: a whole number from 1 to 100,000.

    Raises:
        ValueError: it is something else.
    """
    right = f"write a whole number from 1 to {MOST_OF_ONE_ROW:,}, without separators"
    if value is None or (isinstance(value, str) and not cleaned(value)):
        raise ValueError("the number of people is missing: write 1 for one person")
    weight = -1
    if isinstance(value, str):
        # "1.000" is a thousand to some and one to others.
        match = _WHOLE.fullmatch(cleaned(value))
        weight = int(match[1]) if match else -1
    elif isinstance(value, int | float) and not isinstance(value, bool) and value == value // 1:
        weight = int(value) if abs(value) < 2**53 else -1
    if not 1 <= weight <= MOST_OF_ONE_ROW:
        raise ValueError(f"{shown(value)} is not a number of people: {right}")
    return weight
