"""The ``orchid`` command."""

import os
import sys
from typing import Annotated

import typer

from orchid_uav import __version__
from orchid_uav.cli import config, runs
from orchid_uav.cli.ablate import ablate
from orchid_uav.cli.commands import Commands
from orchid_uav.cli.console import FAILED, INTERRUPTED, WRONG_INPUT, print_error
from orchid_uav.cli.eval import evaluate
from orchid_uav.cli.export import export
from orchid_uav.cli.plan import plan
from orchid_uav.cli.replay import replay
from orchid_uav.cli.reproduce import reproduce
from orchid_uav.cli.tensorboard import tensorboard
from orchid_uav.cli.train import train
from orchid_uav.experiments.output import lasting_output
from orchid_uav.notices import reason_of, show_on_stderr

app = Commands(help="ORCHID: fairness-aware orchestration of UAV base stations.")
app.command()(train)
app.command("eval")(evaluate)
app.command()(ablate)
app.command()(plan)
app.command()(replay)
app.command()(reproduce)
app.command()(export)
app.command()(tensorboard)
app.add_typer(config.app, name="config")
app.add_typer(runs.app, name="runs")

# The base class of Typer's own command-line errors, which Typer does not export.
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
    with lasting_output() as output:
        show_on_stderr()
        os.environ["MPLBACKEND"] = "Agg"  # a backend inherited from a notebook may be missing
        code = _run(sys.argv[1:] if arguments is None else arguments)
        loss = output.loss()
        if loss is not None:
            print_error(f"cannot write the output: {reason_of(loss)}")
        return FAILED if loss is not None and code == 0 else code


def _run(given: list[str]) -> int:
    recorded = [os.fsencode(argument).decode(errors="replace") for argument in given]
    try:
        code = app(args=given, prog_name="orchid", standalone_mode=False, obj=recorded) or 0
    except _UsageError as error:
        print_error(_describe(error, given))
        return WRONG_INPUT
    except (KeyboardInterrupt, typer.Abort):
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:  # commands turn errors of their own files into other errors
        print_error(str(error))
        return FAILED
    return int(code)


def _describe(error: Exception, given: list[str]) -> str:
    """Typer's message, with the value that it leaves out."""
    message: str = error.format_message()  # type: ignore[attr-defined]
    options = getattr(getattr(error, "param", None), "opts", [])
    for index, argument in enumerate(given):
        name, separator, value = argument.partition("=")
        if name in options:
            value = value if separator else "".join(given[index + 1 : index + 2])
            if value and value not in message:
                return f"{message} ({name} is {value!r})"
    return message
