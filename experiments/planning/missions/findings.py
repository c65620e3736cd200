"""What a check of a mission file finds."""

import math
from typing import Any, Literal, NamedTuple

_KINDS: dict[str, tuple[type, ...]] = {
    "an object": (dict,),
    "a list": (list,),
    "a text": (str,),
    "true or false": (bool,),
}
_LONGEST_VALUE = 60


class Finding(NamedTuple):
    """Something in a file that is wrong or doubtful."""

    severity: Literal["error", "warning"]
    """An error keeps the file from loading or the mission from being flown as it should be."""
    where: str
    """A path in the JSON, or a row of a table."""
    what: str
    """What is wrong, and what would be right."""


class Findings:
    """Gathers findings."""

    def __init__(self) -> None:
        self.all: list[Finding] = []

    def error(self, where: str, what: str) -> None:
        """Note what keeps the file from being used."""
        self.all.append(Finding("error", where, what))

    def warning(self, where: str, what: str) -> None:
        """Note what a crew should know."""
        self.all.append(Finding("warning", where, what))

    def member(
        self, parent: dict[str, Any], where: str, key: str, kind: str, *, required: bool = True
    ) -> Any:
        """A member of a JSON object, or None if it is missing or, noted as an error, of no use.

        Args:
            parent: the object.
            where: its path.
            key: of the member.
            kind: "a number", "a number or null", or one of those in the table above.
            required: whether it is an error if it is missing.
        """
        place = f"{where}.{key}" if where else key
        if key not in parent:
            if required:
                self.error(where or "the file", f"there is no {key}; it has to be {kind}")
            return None
        value = parent[key]
        if kind.startswith("a number"):
            fits = is_number(value) or (value is None and kind.endswith("null"))
        else:
            fits = isinstance(value, _KINDS[kind])
        if not fits:
            self.error(place, f"this is {shown(value)}; it has to be {kind}")
            return None
        return value

    def version(self, parent: dict[str, Any], where: str, wanted: int) -> None:
        """Check the version of a part of a file."""
        found = self.member(parent, where, "version", "a number")
        if found is not None and found != wanted:
            place = f"{where}.version" if where else "version"
            self.error(place, f"this is version {found}; programs load version {wanted}")


def is_number(value: Any) -> bool:
    """Whether a JSON value is a number, and not infinite."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < 1e300 and not math.isnan(value)


def shown(value: Any) -> str:
    """A JSON value as it may stand in a sentence."""
    if isinstance(value, dict):
        return "an object"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if value is None:
        return "null"
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}…"


def position_of(findings: Findings, value: Any, where: str, length: int) -> list[float] | None:
    """A list of latitude, longitude and, if wanted, a height; None if it is none."""
    if (
        not isinstance(value, list)
        or len(value) != length
        or not all(is_number(number) for number in value)
    ):
        names = ["latitude", "longitude", "altitude"][:length]
        findings.error(where, f"this is {shown(value)}; it has to be [{', '.join(names)}]")
        return None
    if not check_degrees(findings, value[0], value[1], where):
        return None
    return [float(number) for number in value]


def check_degrees(
    findings: Findings, latitude_deg: float, longitude_deg: float, where: str
) -> bool:
    """Whether they can be degrees; if not, it is noted."""
    if abs(latitude_deg) > 90.0:
        hint = ""
        if abs(longitude_deg) <= 90.0:
            hint = ": latitude and longitude look swapped"
        findings.error(where, f"latitude {latitude_deg:g} is not between -90 and 90{hint}")
        return False
    if abs(longitude_deg) > 180.0:
        findings.error(where, f"longitude {longitude_deg:g} is not between -180 and 180")
        return False
    return True
