"""Sections of the configuration and their keys: what a key may hold, its unit, its option."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Annotated, Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
)
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


Distance = Annotated[float, within(0.0, 1e6)]
"""In m, up to a thousand kilometres."""
Altitude = Annotated[float, within(0.01, 1e5)]
"""In m, up to the edge of space."""
TransmitPower = Annotated[float, within(1e-9, 1e4)]
"""In W."""
RotorPower = Annotated[float, within(1e-3, 1e6)]
"""In W."""
Bandwidth = Annotated[float, within(1.0, 1e12)]
"""In Hz."""
Level = Annotated[float, within(-200.0, 200.0)]
"""In dBm or dBi."""
ExcessLoss = Annotated[float, within(-100.0, 300.0)]
"""In dB."""
RequiredSnr = Annotated[float, within(-100.0, 200.0)]
"""In dB; far below, the spectral efficiency of a link that is served would round to 0."""
Weight = Annotated[float, within(0.0, 1e6)]
Pair = tuple[Weight, Weight]


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
    return _bare(next(kind for kind in kinds if kind is not type(None)))


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


def may_hold_several(field: FieldInfo) -> bool:
    """Whether a field holds a value or a list of them."""
    kinds = [_bare(kind) for kind in get_args(field.annotation)]
    return any(get_origin(kind) is tuple for kind in kinds)


def _bare(annotation: Any) -> Any:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation


def _values(annotation: Any, bounds: list[Any], quote: str) -> str:
    if get_origin(annotation) is Annotated:
        annotation, *items = get_args(annotation)
        own = (item.metadata if isinstance(item, FieldInfo) else [item] for item in items)
        bounds = [*bounds, *chain.from_iterable(own)]
    arguments = get_args(annotation)
    forms = [item.text for item in bounds if isinstance(item, Form)]
    if forms:
        return f"{quote}{forms[0]}{quote}"
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
    if arguments:  # of several types, perhaps of none
        kinds = [argument for argument in arguments if argument is not type(None)]
        return " or ".join(_values(kind, bounds, quote) for kind in kinds)
    return _range(bounds)


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


FORMER_KEYS = {"reward.shares": "network.shares"}
"""Names that keys had in earlier versions; files and commands may still have them."""


def with_current_keys(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by ``"section.key"``, or sections of values by key, under the names of today.

    Raises:
        ValueError: a key is given under its former and its present name, with different values.
    """
    renamed = dict(values)

    def move(source: dict[str, Any], former: str, target: dict[str, Any], key: str) -> None:
        value = source.pop(former)
        if target.setdefault(key, value) != value:
            raise ValueError(f"{former} is {key} now: {value!r} and {target[key]!r} are given")

    for former, key in FORMER_KEYS.items():
        if former in renamed:
            move(renamed, former, renamed, key)
        (old, old_field), (new, new_field) = former.split("."), key.split(".")
        source, target = renamed.get(old), renamed.get(new, {})
        if isinstance(source, Mapping) and old_field in source and isinstance(target, Mapping):
            renamed |= {old: dict(source), new: dict(target)}
            move(renamed[old], old_field, renamed[new], new_field)
    return renamed


def _renamed(values: Any) -> Any:
    return with_current_keys(values) if isinstance(values, Mapping) else values


CURRENT_KEYS = BeforeValidator(_renamed)
"""What a field is annotated with that holds keys and values: former keys are read as well."""


class Section(BaseModel):
    """One section of the configuration: frozen, without unknown keys, all numbers finite."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    @field_validator("*", mode="before")
    @classmethod
    def _truth_is_no_number(cls, value: Any, info: ValidationInfo) -> Any:
        # pydantic would take "uav_count = true" for 1.
        expects_truth = cls.model_fields[str(info.field_name)].annotation is bool
        if _holds_truth(value) and not expects_truth:
            raise ValueError("true and false are no values of this key")
        return value


def _holds_truth(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return any(map(_holds_truth, value))
    return isinstance(value, bool)


def fields_by_key(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """The fields of a model's sections, and of the sections in these, by ``"section.key"``."""
    found: dict[str, FieldInfo] = {}
    for name, field in model.model_fields.items():
        if isinstance(field.default, Section):
            inner = fields_by_key(type(field.default))
            found |= {f"{name}.{key}": one for key, one in inner.items()}
        else:
            found[name] = field
    return found


def by_key(sections: Mapping[str, Any]) -> dict[str, Any]:
    """Values by ``"section.key"`` of sections in each other."""
    flat: dict[str, Any] = {}
    for name, value in sections.items():
        if isinstance(value, Mapping):
            flat |= {f"{name}.{key}": inner for key, inner in by_key(value).items()}
        else:
            flat[name] = value
    return flat


def in_sections(values: Mapping[str, Any]) -> dict[str, Any]:
    """Sections in each other, of values by ``"section.key"``."""
    sections: dict[str, Any] = {}
    for key, value in values.items():
        *path, field = key.split(".")
        section = sections
        for name in path:
            section = section.setdefault(name, {})
        section[field] = value
    return sections


def describe_error(error: ValidationError, model: type[BaseModel]) -> tuple[str, str]:
    """The key that the first of pydantic's complaints is about, and the complaint in one line.

    Args:
        error: of validating a ``model``.
        model: consists of sections.

    Returns:
        The key is that of a section, or none, where the complaint is about several values.
    """
    first = error.errors()[0]
    location = [str(part) for part in first["loc"]]
    message = first["msg"].removeprefix("Value error, ")
    fields = fields_by_key(model)
    paths = (".".join(location[:count]) for count in range(len(location), 0, -1))
    key = next((path for path in paths if path in fields), "")
    if not key and (len(location) < 2 or first["type"] == "value_error"):
        section = ".".join(location)
        return section, f"{section}: {message}" if location else message
    told = message.lower()
    if key and first["type"] in _OUT_OF_RANGE:
        values = values_of(fields[key])
        if "than" in first["type"]:  # a number, perhaps one of several
            values = values.rpartition("× ")[2] if holds_several(fields[key]) else values
            values = f"within {values}"
        told = f"not {values} {unit_of(key)}".rstrip()
    key = key or ".".join(location)
    return key, f"{key} = {first['input']!r}: {told}"


_OUT_OF_RANGE = {
    *("greater_than", "greater_than_equal", "less_than", "less_than_equal"),
    *("missing", "too_short", "too_long"),
}
"""Pydantic's complaints about a number, or about how many there are."""
