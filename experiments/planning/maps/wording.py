"""Numbers and names as people read them."""

import numpy as np

from orchid_uav.experiments.metrics import UNBREAKABLE


def rate_text(rate_bps: float) -> str:
    """Such as 12.3 Mbit/s or 840 kbit/s."""
    for unit, size_bps in (("Gbit/s", 1e9), ("Mbit/s", 1e6), ("kbit/s", 1e3)):
        if rate_bps >= 0.9995 * size_bps:
            return f"{_three_digits(rate_bps / size_bps)}{UNBREAKABLE}{unit}"
    return f"{_three_digits(rate_bps)}{UNBREAKABLE}bit/s"


def people_text(count: int) -> str:
    """Such as 1 person or 4,812 people."""
    return number_text(count, "person", "people")


def number_text(count: int, one: str, many: str) -> str:
    """A number and what it counts."""
    return f"{count:,}{UNBREAKABLE}{one if count == 1 else many}"


def share_text(share: float) -> str:
    """A share in percent; 0 % and 100 % are said of exactly none and all."""
    if share in (0.0, 1.0):
        return f"{100.0 * share:.0f}{UNBREAKABLE}%"
    for digits in (0, 1):
        text = f"{100.0 * share:.{digits}f}"
        if 0.0 < float(text) < 100.0:
            return f"{text}{UNBREAKABLE}%"
    sign, bound = ("<", "0.1") if share < 0.5 else (">", "99.9")
    return f"{sign}{UNBREAKABLE}{bound}{UNBREAKABLE}%"


def length_text(length_m: float) -> str:
    """Such as 85 m or 1.2 km."""
    if length_m < 999.5:
        return f"{length_m:.0f}{UNBREAKABLE}m"
    return f"{_three_digits(length_m / 1000.0)}{UNBREAKABLE}km"


def duration_text(seconds: float) -> str:
    """Such as 45 s, 31 min or 1 h 5 min."""
    whole = round(seconds)
    if whole < 120:
        return f"{whole}{UNBREAKABLE}s"
    minutes = round(seconds / 60.0)
    if minutes < 120:
        return f"{minutes}{UNBREAKABLE}min"
    return f"{minutes // 60}{UNBREAKABLE}h {minutes % 60}{UNBREAKABLE}min"


def clock_text(seconds: float) -> str:
    """Minutes and seconds, such as 2:30."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def _three_digits(value: float) -> str:
    text = np.format_float_positional(value, precision=3, fractional=False, trim="-")
    if value >= 1000.0:
        return f"{round(value):,}"
    return text
