"""Where a command prints, and how it fails."""

import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Raising, interruption_requests

FAILED, WRONG_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes besides 0."""

OUTPUT_PANEL = "Output"
JsonOption = Annotated[
    bool,
    typer.Option(
        "--json",
        help="One JSON document on stdout, everything else on stderr.",
        rich_help_panel=OUTPUT_PANEL,
    ),
]
QuietOption = Annotated[
    bool, typer.Option("--quiet", help="No progress.", rich_help_panel=OUTPUT_PANEL)
]
DebugOption = Annotated[
    bool,
    typer.Option("--debug", help="Show the traceback of an error.", rich_help_panel=OUTPUT_PANEL),
]


def console(stderr: bool = False) -> Console:
    """A console whose lines are never cut to a width off a terminal."""
    made = Console(stderr=stderr, highlight=False)
    if not made.is_terminal:
        made = Console(stderr=stderr, highlight=False, soft_wrap=True)
    return made


def has_cursor(out: Console) -> bool:
    """Whether a display can be drawn over again there."""
    return out.is_terminal and not out.is_dumb_terminal


def print_error(message: str) -> None:
    """One error on stderr."""
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        f"[bold red]error:[/] {_escaped(message)}"
    )


def print_warning(message: str) -> None:
    """One warning on stderr."""
    print_line(console(stderr=True), f"warning: {message}")


def print_note(message: str) -> None:
    """One note on stderr."""
    print_line(console(stderr=True), f"note: {message}")


def print_table(out: Console, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table on a terminal, where long cells are folded, and tab-separated lines elsewhere."""
    if not out.is_terminal:
        for row in (columns, *rows):
            print("\t".join(row), file=out.file)
        return
    table = Table(box=None, pad_edge=False, header_style="bold")
    for index, column in enumerate(columns):
        table.add_column(column, overflow="fold", no_wrap=index == 0)
    for row in rows:
        table.add_row(*(_escaped(cell) for cell in row))
    out.print(table)


def print_line(out: Console, text: str) -> None:
    """A line that is neither broken nor read as markup, so that a path in it can be copied."""
    out.print(text, soft_wrap=True, markup=False)


@contextmanager
def stdout_for_json_alone(as_json: bool) -> Iterator[None]:
    """With ``--json``, send to stderr what anything else prints, trackers for example."""
    with redirect_stdout(sys.stderr) if as_json else nullcontext():
        yield


@contextmanager
def failing_well(debug: bool) -> Iterator[None]:
    """Turn errors and signals into one or two lines on stderr and an exit code."""
    try:
        with interruption_requests(Raising.AT_ONCE, b""):
            yield
    except (InputError, RunFailedError) as error:
        if debug:
            traceback.print_exc()
        print_error(str(error))
        code = WRONG_INPUT if isinstance(error, InputError) else FAILED
        raise typer.Exit(code) from error
    except EOFError as error:  # Typer would take it for an end of the terminal's input: 130
        raise RuntimeError(f"a file ended too early: {error}") from error
    except OSError as error:
        if error.filename is None:  # of the output, see main
            raise
        if debug:
            traceback.print_exc()
        print_error(f"{error.filename}: {error.strerror or error}")
        raise typer.Exit(FAILED) from error
    except KeyboardInterrupt as error:
        print("interrupted", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from error


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")
