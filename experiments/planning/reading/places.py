"""Values of the options of a plan: places, wanted rates, altitudes, budgets and reserves."""

import re
from typing import NamedTuple

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Budget, Want
from orchid_uav.experiments.planning.reading.cells import cleaned, number_of_text, shown

_MOST_HEIGHT_M = 1_000.0
_AMSL_M = (-500.0, 9_000.0)
_MOST_ALTITUDE_M = 10_000.0
_RATES = {"kbps": 1e3, "mbps": 1e6, "gbps": 1e9}
_MOST_RATE_BPS = 1e12
_SECONDS = {"ms": 1e-3, "s": 1.0, "min": 60.0}
_MOST_SECONDS = 86_400.0
_MOST_EVALUATIONS = 10**9
_NUMBER = r"(\d+(?:\.\d+)?)"
_WANT = re.compile(rf"{_NUMBER} ?([kKmMgG]bps) ?: ?{_NUMBER} ?(%?)", re.ASCII)
_BUDGET = re.compile(rf"{_NUMBER} ?(ms|s|min)", re.ASCII)
_SHARE = re.compile(rf"{_NUMBER} ?(%?)", re.ASCII)
_ALTITUDES = re.compile(rf"{_NUMBER}(?:\.\.{_NUMBER})?", re.ASCII)


class GivenPlace(NamedTuple):
    """A place as an option gives it, degrees or metres as the people are."""

    given: str
    """The option and its value, for messages."""
    first: float
    """Latitude in degrees, or x in m."""
    second: float
    """Longitude in degrees, or y in m."""
    height_m: float | None
    """A mast's height above the ground, or home's above mean sea level."""


class Altitudes(NamedTuple):
    """Between which altitudes above home stations may be."""

    lowest_m: float
    highest_m: float


def parse_mast(text: str) -> GivenPlace:
    """Parse ``LAT,LON[,HEIGHT_M]``, or ``X,Y[,HEIGHT_M]`` in local metres.

    Raises:
        InputError: it is not of that form, or the height is not above 0 and at most 1,000 m.
    """
    place = _place(text, "--mast", "HEIGHT_M", "17.2964,-62.7243,30")
    if place.height_m is not None and not 0 < place.height_m <= _MOST_HEIGHT_M:
        raise InputError(
            f"{place.given} has the height {place.height_m:g} m: a mast's height above the ground "
            f"is above 0 and at most {_MOST_HEIGHT_M:,.0f} m"
        )
    return place


def parse_home(text: str) -> GivenPlace:
    """Parse ``LAT,LON[,AMSL_M]``, or ``X,Y[,AMSL_M]`` in local metres.

    Raises:
        InputError: it is not of that form, or the height is none that land has.
    """
    place = _place(text, "--home", "AMSL_M", "17.2964,-62.7243,12")
    least_m, most_m = _AMSL_M
    if place.height_m is not None and not least_m <= place.height_m <= most_m:
        raise InputError(
            f"{place.given} has the height {place.height_m:g} m: home's height above mean sea "
            f"level is between {least_m:g} and {most_m:,.0f} m"
        )
    return place


def _place(text: str, option: str, height: str, example: str) -> GivenPlace:
    given = f"{option} {text}"
    right = f"write LAT,LON or LAT,LON,{height}, such as {example} (X,Y in metres for a local site)"
    parts = text.split(",")
    if not 2 <= len(parts) <= 3:
        raise InputError(f"{given} is not a place: {right}")
    try:
        numbers = [number_of_text(part) for part in parts]
    except ValueError as error:
        raise InputError(f"{given} is not a place: {error};\n{right}") from error
    return GivenPlace(given, numbers[0], numbers[1], numbers[2] if len(parts) == 3 else None)


def parse_want(text: str) -> Want:
    """Parse a rate and a share, such as ``1Mbps:95%`` or ``500 kbps : 0.9``.

    Raises:
        InputError: it is not of that form, the rate is 0, or the share is not in (0, 1].
    """
    right = "write a rate in kbps, Mbps or Gbps, a colon and a share, such as 1Mbps:95%"
    match = _WANT.fullmatch(_single_spaced(text))
    if match is None or match[2][1:] != "bps":
        bytes_meant = re.search(r"[kKmMgG]i?B", text)
        because = " (B stands for bytes, b for bits)" if bytes_meant else ""
        raise InputError(f"--want {shown(text)} is not understood{because}: {right}")
    rate_bps = float(match[1]) * _RATES[match[2].lower()]
    if not 0 < rate_bps <= _MOST_RATE_BPS:
        raise InputError(f"--want {shown(text)} has a rate that nobody can have: {right}")
    share = _share(match[3], match[4])
    if not 0 < share <= 1:
        raise InputError(
            f"--want {shown(text)} has the share {match[3]}{match[4]}: write one above 0, "
            "and at most 100% or 1, such as 95% or 0.95"
        )
    return Want(rate_bps, share)


def parse_altitudes(text: str) -> Altitudes:
    """Parse altitudes above home in m: ``80..120``, or ``100`` for one altitude alone.

    Raises:
        InputError: it is not of that form, or the altitudes are none to fly at.
    """
    match = _ALTITUDES.fullmatch(cleaned(text))
    if match is None:
        raise InputError(
            f"--altitude {shown(text)} is not understood: write metres above home, such as 100 or "
            "80..120"
        )
    lowest_m, highest_m = float(match[1]), float(match[2] or match[1])
    if lowest_m > highest_m:
        raise InputError(
            f"--altitude {text} is empty: write the lower altitude first, {match[2]}..{match[1]}"
        )
    if not (lowest_m >= 1 and highest_m <= _MOST_ALTITUDE_M):
        raise InputError(
            f"--altitude {text} is not between 1 and {_MOST_ALTITUDE_M:,.0f} m above home"
        )
    return Altitudes(lowest_m, highest_m)


def parse_budget(text: str) -> Budget:
    """Parse a time, such as ``5s``, ``500ms`` or ``2min``, or a number of evaluations.

    Raises:
        InputError: it is not of that form, 0, longer than a day, or above a billion evaluations.
    """
    plain = _single_spaced(text)
    match = _BUDGET.fullmatch(plain)
    if match:
        seconds = float(match[1]) * _SECONDS[match[2]]
        if 0 < seconds <= _MOST_SECONDS:
            return Budget(seconds, None)
        raise InputError(f"--budget {text} is not a time above 0 and up to a day (1440min)")
    if re.fullmatch(r"\d{1,18}", plain, re.ASCII):
        if 1 <= int(plain) <= _MOST_EVALUATIONS:
            return Budget(None, int(plain))
        raise InputError(
            f"--budget {text} is not a number of evaluations from 1 to {_MOST_EVALUATIONS:,}"
        )
    raise InputError(
        f"--budget {shown(text)} is not understood: write a time such as 5s, 500ms or 2min, or a "
        "number of evaluations such as 5000"
    )


def parse_reserve(text: str) -> float:
    """Parse the share of a battery that is kept, such as ``20%`` or ``0.2``.

    Raises:
        InputError: it is not of that form, or not from 0 to below 1.
    """
    match = _SHARE.fullmatch(_single_spaced(text))
    share = _share(match[1], match[2]) if match else -1.0
    if not 0 <= share < 1:
        raise InputError(
            f"--reserve {shown(text)} is not a share of the battery from 0 to below 100%: "
            "write it such as 20% or 0.2"
        )
    return share


def _share(number: str, percent: str) -> float:
    return float(number) / (100 if percent else 1)


def _single_spaced(text: str) -> str:
    return " ".join(cleaned(text).split())
