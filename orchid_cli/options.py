"""The options that set a configuration, made from its fields in the same way for all commands."""

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from orchid_uav.cli import completion
from orchid_uav.cli.console import print_note
from orchid_uav.cli.ranges import parse_counts, parse_numbers
from orchid_uav.envs.keys import allows_zero, choices_of, holds_several, type_of, unit_of
from orchid_uav.experiments.configuration import (
    FLAGS,
    LEARNING_SECTIONS,
    Layer,
    RunConfig,
    assignment_layer,
    field_of,
    file_layer,
    merge,
    preset_layer,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.presets import PRESETS

_DECISIONS = re.compile(r" \(M\d+(, M\d+)*\)")
"""References to docs/model.md, which are useless on a terminal."""
WHERE_PANEL = "Where runs are trained"
VARIANTS_PANEL, SETTINGS_PANEL = "Variants, each compared with the base", "Settings"


def option(panel: str, text: str, *names: str, **more: Any) -> Any:
    """An option whose help text states its default itself."""
    return typer.Option(*names, help=text, rich_help_panel=panel, show_default=False, **more)


PresetOption = Annotated[
    str,
    option(
        "Configuration",
        f"Built-in configuration to start from: {', '.join(PRESETS)} (default: paper).",
        autocompletion=completion.presets,
    ),
]
ConfigOption = Annotated[
    Path | None,
    option(
        "Configuration",
        "TOML or JSON file, or a pipe; its values replace the preset's.",
        "--config",
    ),
]
SetOption = Annotated[
    list[str] | None,
    option(
        "Configuration",
        "section.key=value: replaces the file's value; may be repeated; lists as 1,2,3.",
        "--set",
        autocompletion=completion.assignments,
    ),
]
JobsOption = Annotated[
    int | None, option(WHERE_PANEL, "Runs trained at once (default: one per core).", "--jobs")
]
RayOption = Annotated[
    str | None,
    option(
        WHERE_PANEL,
        "Train on a Ray cluster: auto, the one of this machine; HOST:PORT; or local, one that ends "
        "with the command. Nothing else joins one (default: this machine, without Ray).",
        "--ray",
        metavar="ADDRESS",
    ),
]


@dataclass(frozen=True)
class _Flags:
    """One option for each of some keys, given to a command by :func:`with_flags`."""

    keys: tuple[str, ...]
    are_lists: bool = False
    panel: str = ""
    """The panel of the options; by default the panel of each key's section."""

    def parameters(self) -> list[inspect.Parameter]:
        """The options as parameters that a command could declare."""
        return [self._parameter(key) for key in self.keys]

    def _parameter(self, key: str) -> inspect.Parameter:
        kind: Any = type_of(field_of(key))
        default = False if kind is bool else None
        more = {}
        if kind is not bool:
            if self.are_lists:
                more["metavar"] = "LIST"
            kind = (str if self.are_lists or holds_several(field_of(key)) else kind) | None
        section = key.partition(".")[0]
        panel = self.panel or ("Learning" if section in LEARNING_SECTIONS else "Network")
        annotation = option(panel, _help(key, self.are_lists), f"--{FLAGS[key].name}", **more)
        return inspect.Parameter(
            _parameter_name(key),
            inspect.Parameter.KEYWORD_ONLY,
            default=default,
            annotation=Annotated[kind, annotation],
        )

    def taken_from(self, given: dict[str, Any]) -> dict[str, Any]:
        """Remove the options from a command's parameters, and return the given values by key."""
        taken = {key: given.pop(_parameter_name(key)) for key in self.keys}
        return {
            key: not field_of(key).default if value is True else value
            for key, value in taken.items()
            if value is not None and value is not False
        }


def _parameter_name(key: str) -> str:
    return FLAGS[key].name.replace("-", "_")


def _help(key: str, are_lists: bool) -> str:
    """The help text of an option: the field's docstring, unit, choices and default."""
    field, flag = field_of(key), FLAGS[key]
    if flag.help:
        return flag.help
    text = _DECISIONS.sub("", field.description or "").replace("`", "").removesuffix(".")
    facts = [unit_of(key)]
    if are_lists:
        facts += [", ".join(choices_of(field)), f"like {flag.like}" if flag.like else ""]
    if field.default is not None and type_of(field) is not bool:
        facts.append(f"default: {text_of(field.default)}")
    told = "; ".join(filter(None, facts))
    return f"{text} ({told})." if told else f"{text}."


RunFlags = Annotated[
    dict[str, Any], _Flags(tuple(key for key, flag in FLAGS.items() if flag.is_of_runs))
]
"""One value for every key of a run that has a flag."""
BaseFlags = Annotated[
    dict[str, Any],
    _Flags(
        tuple(
            key
            for key, flag in FLAGS.items()
            if flag.is_of_runs and flag.varies != "method" and key != "training.seed"
        )
    ),
]
"""The same for the base of an ablation, without the keys of its seeds and variants."""
VariantFlags = Annotated[
    dict[str, Any],
    _Flags(
        tuple(
            sorted(
                (key for key, flag in FLAGS.items() if flag.varies == "method"),
                key=lambda key: type_of(field_of(key)) is not bool,  # switches first
            )
        ),
        are_lists=True,
        panel=VARIANTS_PANEL,
    ),
]
"""Lists of values for the keys in which methods differ."""
SettingFlags = Annotated[
    dict[str, Any],
    _Flags(
        tuple(key for key, flag in FLAGS.items() if flag.varies == "world"),
        are_lists=True,
        panel=SETTINGS_PANEL,
    ),
]
"""Lists of values for the keys in which worlds differ."""
OneSettingFlags = Annotated[
    dict[str, Any],
    _Flags(
        tuple(key for key, flag in FLAGS.items() if flag.varies == "world"), panel=SETTINGS_PANEL
    ),
]
"""One value for each of the same keys."""


def with_flags(command: Callable[..., None]) -> Callable[..., None]:
    """Add options to a command, for its parameters annotated with one of the types above.

    Such a parameter receives the given values by ``"section.key"``; a list arrives as text.
    """
    hints = get_type_hints(command, include_extras=True)
    parameters: list[inspect.Parameter] = []
    flags: dict[str, _Flags] = {}
    for name, own in inspect.signature(command).parameters.items():
        found = [one for one in getattr(hints[name], "__metadata__", ()) if isinstance(one, _Flags)]
        if found:
            (flags[name],) = found
            parameters += flags[name].parameters()
        else:
            kind = inspect.Parameter.KEYWORD_ONLY
            parameters.append(own.replace(annotation=hints[name], kind=kind))

    @wraps(command)
    def called(**given: Any) -> None:
        for name, group in flags.items():
            given[name] = group.taken_from(given)
        command(**given)

    # Typer makes the command from this signature.
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in parameters}
    return called


def text_of(value: Any) -> str:
    """A value in the form that ``--set`` accepts."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    if isinstance(value, list | tuple):
        text = ",".join(f"[{text_of(one)}]" if _is_list(one) else text_of(one) for one in value)
        return f"[{text}]" if any(map(_is_list, value)) or not value else text
    return str(value)


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)


def listed(key: str, text: str) -> list[Any]:
    """The values of the list that the flag of ``key`` was given.

    Raises:
        InputError: a value is not a number where numbers are wanted, or not one of the choices.
    """
    field, option_name = field_of(key), f"--{FLAGS[key].name}"
    if type_of(field) is int:
        return parse_counts(text, option_name, least=0 if allows_zero(field) else 1)
    if type_of(field) is float:
        return parse_numbers(text, option_name)
    words = list(dict.fromkeys(word.strip() for word in text.split(",")))
    for word in words:
        if word not in choices_of(field):
            known = ", ".join(choices_of(field))
            raise InputError(f"{option_name} {word!r}: {key} is one of {known}")
    return words


def configuration(
    preset: str,
    config: Path | None,
    assignments: Iterable[str] | None,
    flags: Mapping[str, Any],
    set_option: str = "--set",
) -> tuple[RunConfig, dict[str, str]]:
    """Merge preset < file < assignments < flags, and also return the source of every key."""
    layers = [preset_layer(preset)]
    if config is not None:
        # before version 0.29 Typer leaves it a str
        layers.append(file_layer(Path(config), print_note))
    layers.append(assignment_layer(assignments or [], set_option))
    return merge([*layers, *flag_layers(flags)])


def flag_layers(flags: Mapping[str, Any]) -> list[Layer]:
    """The values of options, by key."""
    return [_layer_of(f"--{FLAGS[key].name}", key, value) for key, value in flags.items()]


def _layer_of(option_name: str, key: str, value: Any) -> Layer:
    if holds_several(field_of(key)):
        return assignment_layer([f"{key}={value}"], option_name)
    return Layer(option_name, {key: value})
