"""The ``orchid`` command."""

import sys
from typing import Annotated

import typer

from orchid_uav import __version__
from orchid_uav.cli import config
from orchid_uav.cli.console import INTERRUPTED, WRONG_INPUT, print_error
from orchid_uav.cli.train import train

app = typer.Typer(
    help="ORCHID: fairness-aware orchestration of UAV base stations.",
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    add_completion=True,
)
app.command()(train)
app.add_typer(config.app, name="config")

# The class of all of Typer's own complaints about a command line, which it does not export.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"orchid-uav {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _orchid(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """ORCHID: fairness-aware orchestration of UAV base stations."""
    if context.invoked_subcommand is None:
        print(context.get_help())


def main(arguments: list[str] | None = None) -> int:
    """Run the command and return its exit code."""
    try:
        return app(args=arguments, prog_name="orchid", standalone_mode=False) or 0
    except _UsageError as error:
        print_error(error.format_message())  # type: ignore[attr-defined]
        return WRONG_INPUT
    except (KeyboardInterrupt, typer.Abort):
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
