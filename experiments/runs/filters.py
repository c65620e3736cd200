"""Filters and sorts runs by anything that is known about them."""

import json
import operator
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from orchid_uav.envs.keys import FORMER_KEYS
from orchid_uav.experiments.configuration import assignment_layer, configuration_keys
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.index import (
    RECORD_KEYS,
    TRAINING_METRICS,
    Run,
    is_number,
    value_text,
)
from orchid_uav.suggestions import nearest, unknown

_CONDITION = re.compile(r"\s*([\w.-]+?)\s*(<=|>=|!=|==|=|<|>|~)\s*(.*?)\s*", re.DOTALL)


class Condition(NamedTuple):
    """A condition of ``--where``."""

    text: str
    key: str
    operator: str
    value: str
    """The text that was given."""

    def fits(self, run: Run) -> bool:
        """Whether a run fulfils the condition.

        Text is compared with text, in alphabetical order, and numbers with numbers. A missing value
        equals only ``none``, and is neither greater nor less than anything.

        Raises:
            InputError: a number is to be compared with something that is not a number.
        """
        found = run.values.get(self.key)
        if self.operator == "~":
            return self.value.casefold() in value_text(found).casefold()
        wanted = _value(self.value)
        if isinstance(found, str):
            wanted = wanted if isinstance(wanted, str) else self.value
        if self.operator in ("=", "!="):
            # In Python, True equals 1.
            is_same = found == wanted and isinstance(found, bool) == isinstance(wanted, bool)
            return is_same is (self.operator == "=")
        if found is None or isinstance(found, bool | list):
            return False
        if is_number(found) and not is_number(wanted):
            raise InputError(f"--where {self.text}: '{self.value}' is not a number")
        return bool(_ORDER[self.operator](found, wanted))


_ORDER: dict[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def _value(text: str) -> Any:
    """The value, read as ``--set`` reads it."""
    return assignment_layer([f"value={text}"]).values["value"]


class Keys:
    """Keys by which runs can be filtered: of configurations, of records, and final metrics.

    Args:
        runs: runs whose own keys, perhaps of another version, are accepted as well.
    """

    def __init__(self, runs: Iterable[Run]) -> None:
        known = dict.fromkeys([*RECORD_KEYS, *TRAINING_METRICS, *configuration_keys()])
        for run in runs:
            known |= run.values
        self.known = list(known)
        self._fields: dict[str, list[str]] = {}
        for key in self.known:
            section, _, field = key.rpartition(".")
            if section not in ("", "host", "versions"):
                self._fields.setdefault(field, []).append(key)

    def find(self, name: str) -> str:
        """Find the key of that name, or the configuration key that ends in it.

        Raises:
            InputError: there is no such key, or several end in the name.
        """
        name = FORMER_KEYS.get(name, name)
        if name in self.known:
            return name
        ending = self._fields.get(name, [])
        if len(ending) == 1:
            return ending[0]
        if ending:
            raise InputError(f"'{name}' may be any of {', '.join(ending)}: give one of these")
        field = name.rpartition(".")[2]  # the field may be right and only its section wrong
        similar = nearest(name, [*self.known, *self._fields])
        near = self._fields.get(field) or self._fields.get(similar or "") or [similar or ""]
        if near[0]:
            raise InputError(unknown("key", name, self.known, near=near[:1]))
        raise InputError(
            f"unknown key '{name}': known are those of 'orchid config show', the final "
            f"metrics {', '.join(TRAINING_METRICS)}, and {', '.join(RECORD_KEYS)}"
        )

    def condition(self, text: str) -> Condition:
        """Parse a condition KEY OP VALUE.

        Raises:
            InputError: the text is no condition, or its key is unknown.
        """
        match = _CONDITION.fullmatch(text)
        if match is None:
            raise InputError(
                f"--where {text} is not of the form KEY OP VALUE, OP being one of "
                "= != < <= > >= ~; for example reset.kappa=0.1 (in quotes where it has < or >)"
            )
        key, sign, value = match.groups()
        return Condition(text, self.find(key), "=" if sign == "==" else sign, value)

    def columns(self, text: str) -> list[str]:
        """Find keys that are separated by commas."""
        return list(dict.fromkeys(self.find(name.strip()) for name in text.split(",")))


def select(
    runs: Sequence[Run], keys: Keys, conditions: Iterable[Condition] = (), order: str = ""
) -> list[Run]:
    """Return the runs that fulfil all conditions, sorted.

    Args:
        runs: the runs, latest first.
        keys: the keys of these runs.
        conditions: conditions that must all be fulfilled.
        order: keys separated by commas, the most important first; "-" before a key puts the
            greatest value first. Runs without a value come last either way; runs of equal values
            keep their order.
    """
    chosen = [run for run in runs if all(condition.fits(run) for condition in conditions)]
    names = [name.strip() for name in order.split(",")] if order else []
    for name in reversed(names):
        key = keys.find(name.removeprefix("-"))
        known = [run for run in chosen if run.values.get(key) is not None]
        missing = [run for run in chosen if run.values.get(key) is None]
        known.sort(key=lambda run: _sortable(run.values[key]), reverse=name.startswith("-"))
        chosen = known + missing
    return chosen


def _sortable(value: Any) -> tuple[int, Any]:
    """A sort key that puts numbers before text, and text before the rest."""
    if isinstance(value, int | float):
        return 0, value
    return (1, value) if isinstance(value, str) else (2, json.dumps(value))


def found_values(runs: Iterable[Run], key: str, most: int = 6) -> str:
    """List the values that a key has, to help correct a condition that no run fulfils."""
    found = sorted({value_text(run.values.get(key)) for run in runs})
    return ", ".join(found[:most]) + (" ..." if len(found) > most else "")
