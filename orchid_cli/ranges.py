"""Parse lists of numbers such as ``4..10``, ``50..200:50``, ``4,6,8``, and mixtures of these."""

import re
from decimal import Decimal

from orchid_uav.experiments.errors import InputError

MOST_VALUES = 10_000
_LEAST_STEP, _GREATEST = Decimal("1e-9"), Decimal("1e9")
_NUMBER = r"[+-]?(?:\d+(?:\.\d+)?|\.\d+)(?:[eE][+-]?\d+)?"
_PART = re.compile(rf"({_NUMBER})(?:\.\.({_NUMBER})(?::({_NUMBER}))?)?")
_FORM = "like 6, 4,6,8, 4..10 or 50..200:50"


def parse_numbers(text: str, what: str) -> list[float]:
    """The numbers of a list, each once and in the order given; ranges include both ends.

    Steps are decimal, so 0..0.3:0.1 is 0, 0.1, 0.2, 0.3. If the steps do not meet the end, the last
    number is the one before it.

    Args:
        text: parts separated by commas: a number, FIRST..LAST, or FIRST..LAST:STEP.
        what: the option's name, for messages.

    Raises:
        InputError: the text is not of that form, is empty, or has more than 10,000 values.
    """
    values: dict[float, None] = {}
    for part in text.split(","):
        for value in _parse_part(part.strip(), what):
            values[float(value)] = None
        if len(values) > MOST_VALUES:
            raise InputError(f"{what} {text} has more than {MOST_VALUES:,} values")
    return list(values)


def parse_counts(text: str, what: str, least: int = 1) -> list[int]:
    """The whole numbers of a range, all at least ``least``; see :func:`parse_numbers`."""
    values = parse_numbers(text, what)
    for value in values:
        if value != int(value) or value < least:
            raise InputError(
                f"{what} {text} contains {value:g}, which is not a whole number of {least} or more"
            )
    return [int(value) for value in values]


def _parse_part(part: str, what: str) -> list[Decimal]:
    match = _PART.fullmatch(part)
    if match is None:
        raise InputError(f"{what} {part!r} is not a number or a range: write it {_FORM}")
    first_text, last_text, step_text = match.groups()
    first = _number(first_text, part, what)
    if last_text is None:
        return [first]
    last, step = _number(last_text, part, what), _number(step_text or "1", part, what)
    if step <= 0:
        raise InputError(f"{what} {part} has the step {step_text}: it must be above 0")
    if step < _LEAST_STEP:
        raise InputError(
            f"{what} {part} has the step {step_text}: it must be at least {_LEAST_STEP}"
        )
    if last < first:
        raise InputError(f"{what} {part} is empty: write the smaller number first")
    count = int((last - first) / step) + 1
    if count > MOST_VALUES:
        raise InputError(f"{what} {part} has {count:,} values, more than {MOST_VALUES:,}")
    return [first + index * step for index in range(count)]


def _number(text: str, part: str, what: str) -> Decimal:
    try:
        number = Decimal(text)
        if abs(number) <= _GREATEST:
            return number
    except ArithmeticError:  # the exponent is beyond the limits of Decimal
        pass
    raise InputError(f"{what} {part} is too large or too small a number")
