"""What a key of the configuration may hold, its unit, and the option that sets it."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import Field
from pydantic.fields import FieldInfo

UNITS = {
    "bit_per_joule": "bit/J",
    "dbm_per_hz": "dBm/Hz",
    "kg_per_m3": "kg/m³",
    "bps": "bit/s",
    "dbi": "dBi",
    "dbm": "dBm",
    "deg": "°",
    "mps": "m/s",
    "db": "dB",
    "hz": "Hz",
    "kg": "kg",
    "m2": "m²",
    "m": "m",
    "s": "s",
    "w": "W",
}
"""Units by the ends of field names, longer ends first."""


def within(least: float, greatest: float) -> Any:
    """A number's range, both ends included."""
    return Field(ge=least, le=greatest)


@dataclass(frozen=True)
class Flag:
    """The option of the command line for a key; among what a field is annotated with.

    Whatever else an option needs is in the field: its type, default, choices, unit and help.
    """

    name: str
    """Without dashes before it. That of a switch, for a key that is true by default, says no."""
    varies: Literal["", "world", "method"] = ""
    """Whose lists can be given: of worlds in an evaluation, of methods in an ablation."""
    like: str = ""
    """A list as an example."""
    help: str = ""
    """What is said of a switch, instead of the field's docstring."""
    is_of_runs: bool = True
    """Whether a run can be given one value by this option."""


@dataclass(frozen=True)
class Form:
    """How a text is written; among what a field is annotated with."""

    text: str
    """As an example or with the names of its parts."""


def flag_of(field: FieldInfo) -> Flag | None:
    """The option that sets a field, if it has one."""
    return next((item for item in field.metadata if isinstance(item, Flag)), None)


def type_of(field: FieldInfo) -> Any:
    """What a field holds where it is not None: a class, or a Literal."""
    kinds = get_args(field.annotation) if allows_none(field) else [field.annotation]
    kind = next(kind for kind in kinds if kind is not type(None))
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def choices_of(field: FieldInfo) -> list[str]:
    """The words that a field may hold; none of a number."""
    return [word for word in get_args(type_of(field)) if isinstance(word, str)]


def allows_zero(field: FieldInfo) -> bool:
    """Whether a field of whole numbers may hold 0."""
    bounds: list[Any] = [item.ge for item in field.metadata if isinstance(item, Ge)]
    return all(bound <= 0 for bound in bounds)


def allows_none(field: FieldInfo) -> bool:
    """Whether a field may hold nothing."""
    return type(None) in get_args(field.annotation)


def unit_of(field: str) -> str:
    """The unit that a field's name ends with, or ''."""
    for suffix, unit in UNITS.items():
        if field.endswith("_" + suffix):
            return unit
    return ""


def values_of(field: FieldInfo, quote: str = "") -> str:
    """What a field may hold, without its unit: ``1..100``, ``> 0, < 1``, ``2 × 0..1``, ``a, b``.

    Args:
        field: of a section of the configuration.
        quote: put around words that can be chosen.
    """
    text = _values(field.annotation, list(field.metadata), quote)
    return f"{text} or {quote}none{quote}" if allows_none(field) else text


def holds_several(field: FieldInfo) -> bool:
    """Whether a field holds a list of values."""
    return get_origin(field.annotation) is tuple


def _values(annotation: Any, bounds: list[Any], quote: str) -> str:
    arguments = get_args(annotation)
    if get_origin(annotation) is tuple:
        count = str(len(arguments))
        if Ellipsis in arguments:
            count = _range(bounds) or "any number"
        return f"{count} × {_values(arguments[0], [], quote)}"
    if annotation is bool:
        return f"{quote}true{quote}, {quote}false{quote}"
    words = [argument for argument in arguments if isinstance(argument, str)]
    if words:
        return ", ".join(f"{quote}{word}{quote}" for word in words)
    own = [
        bound
        for item in getattr(annotation, "__metadata__", ())
        for bound in (item.metadata if isinstance(item, FieldInfo) else [item])
    ]
    for item in getattr(annotation, "__metadata__", ()):
        if isinstance(item, Form):
            return f"{quote}{item.text}{quote}"
    inner = [argument for argument in arguments if argument is not type(None)]
    if inner and not own:  # the one type of an optional value
        return _values(inner[0], bounds, quote)
    return _range([*bounds, *own])


def _range(bounds: list[Any]) -> str:
    found: dict[type, str] = {}
    for bound in bounds:
        for kind, name in _LIMITS.items():
            if isinstance(bound, kind):
                limit = getattr(bound, name)
                found[kind] = f"{limit:g}" if isinstance(limit, float) else str(limit)
    least = found.get(Ge, found.get(MinLen))
    greatest = found.get(Le, found.get(MaxLen))
    if least is not None and greatest is not None:
        return f"{least}..{greatest}"
    signs = {Gt: "> ", Ge: "≥ ", Lt: "< ", Le: "≤ "}
    return ", ".join(sign + found[kind] for kind, sign in signs.items() if kind in found)


_LIMITS = {
    Ge: "ge",
    Gt: "gt",
    Le: "le",
    Lt: "lt",
    MinLen: "min_length",
    MaxLen: "max_length",
}
