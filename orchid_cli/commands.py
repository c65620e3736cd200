"""What all commands share: the layout of their help, and the check for empty options."""

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup


def _below_2_to_the_63(value: int) -> int:
    if value >= 2**63:
        raise typer.BadParameter(f"{value} is too large: it must be below 2**63")
    return value


SEED: dict[str, Any] = {"min": 0, "metavar": "N", "callback": _below_2_to_the_63}
"""Settings of every topology seed option; showing its range would fill half a line of the help."""


_CALLED_OTHERWISE = {"--uavs": "--drones", "--drones": "--uavs"}
"""Planners say drones, the paper UAVs: who knows one command's option is told the other's."""


class Commands(typer.Typer):
    """A group of commands with the settings that every group of ``orchid`` shares."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            cls=_Group, rich_markup_mode="rich", pretty_exceptions_enable=False, **options
        )

    def command(self, name: str | None = None, **options: Any) -> Callable[[Any], Any]:
        """Register a function; its docstring is the help."""
        register = super().command

        def decorate(function: Any) -> Any:
            text = flowing(function.__doc__ or "")
            return register(name, cls=_Command, help=text, **options)(function)

        return decorate


def flowing(text: str) -> str:
    """Remove line breaks within paragraphs, since Typer would keep them at any terminal width."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _without_types_of_switches(parameters: Sequence[Any]) -> list[Any]:
    """Hide the type of every switch, since a switch takes no value."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return list(parameters)


class _Command(TyperCommand):
    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_switches(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        given = list(args)
        try:
            left: list[str] = super().parse_args(ctx, args)
        except Exception as error:  # click's NoSuchOption, of which newer Typers have their own
            own_name = _CALLED_OTHERWISE.get(getattr(error, "option_name", ""))
            if any(own_name in parameter.opts for parameter in self.params):
                vars(error)["possibilities"] = [own_name]
            raise
        if not ctx.resilient_parsing:
            _check_not_empty(given)
        return left


class _Group(TyperGroup):
    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_switches(super().get_params(ctx))


def _check_not_empty(arguments: Sequence[str]) -> None:
    """Refuse empty values: most likely a script's variable is not set, so no default is right.

    Raises:
        typer.BadParameter: an option or an argument is empty.
    """
    before = ""
    for argument in arguments:
        name, separator, value = argument.partition("=")
        is_option = argument.startswith("--") and bool(separator)
        if not (value if is_option else argument).strip():
            option = name if is_option else before if before.startswith("--") else ""
            if option:
                raise typer.BadParameter(
                    "the value is empty; give one, or leave the option out", param_hint=option
                )
            raise typer.BadParameter("an argument is empty")
        before = argument
