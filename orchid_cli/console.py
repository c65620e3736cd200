"""Where a command prints, and how it fails."""

import shlex
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, redirect_stdout
from itertools import zip_longest
from typing import Annotated

import typer
from rich.cells import cell_len
from rich.console import Console

from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Raising, interruption_requests
from orchid_uav.experiments.metrics import UNBREAKABLE
from orchid_uav.notices import reason_of

FAILED, WRONG_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes besides 0."""
GAP = 2
"""Spaces between the columns of a table."""
_LEAST_TEXT = 20
"""A text column narrower than this moves to a table of its own."""

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
    """Make a console; when the output is not a terminal, its lines are never cut."""
    made = Console(stderr=stderr, highlight=False, emoji=False)
    if not made.is_terminal:
        made = Console(stderr=stderr, highlight=False, emoji=False, soft_wrap=True)
    return made


def has_cursor(out: Console) -> bool:
    """Whether a display can be redrawn in place there."""
    return out.is_terminal and not out.is_dumb_terminal


def print_error(message: str) -> None:
    """Print one error on stderr."""
    Console(stderr=True, highlight=False, emoji=False, soft_wrap=True).print(
        f"[bold red]error:[/] {_escaped(message)}"
    )


def print_warning(message: str) -> None:
    """Print one warning on stderr."""
    print_text(console(stderr=True), f"warning: {message}")


def print_note(message: str) -> None:
    """Print one note on stderr."""
    print_text(console(stderr=True), f"note: {message}")


def print_table(
    out: Console,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    wraps_last: bool = False,
) -> None:
    """Print a table on a terminal, and tab-separated lines elsewhere.

    On a terminal cells are never broken, and headings only between words. Columns for which there
    is no room go into a further table below, with the same first column.

    Args:
        out: where to print.
        columns: the headings.
        rows: the cells of each row.
        wraps_last: the last column is text, which may be broken between words to fit.
    """
    if not out.is_terminal:
        for row in (columns, *rows):
            print("\t".join(row).replace(UNBREAKABLE, " "), file=out.file)
        return
    table = [list(column) for column in zip(columns, *rows, strict=True)]
    if wraps_last:
        table[-1] = _wrapped(table, out.width)
    for number, part in enumerate(_parts(table, out.width)):
        if number:
            print_line(out, "")
        _print_part(out, part)


def _wrapped(table: Sequence[Sequence[str]], room: int) -> list[str]:
    """The last column, with its cells broken between words so that it fits if possible."""
    *others, (heading, *cells) = table
    beside = [least_width(column) + GAP for column in others]
    left = room - sum(beside)
    if left < _LEAST_TEXT:  # it goes into a table of its own
        left = max(room - sum(beside[:1]), _LEAST_TEXT)
    return [heading, *("\n".join(_broken(cell, left)) for cell in cells)]


def _parts(table: Sequence[list[str]], room: int) -> Iterator[list[list[str]]]:
    """Groups of columns that fit side by side, each group after the table's first column."""
    first, *others = table
    part, width = [first], least_width(first)
    for column in others:
        needed = GAP + least_width(column)
        if len(part) > 1 and width + needed > room:
            yield _fitted(part, room)
            part, width = [first], least_width(first)
        part.append(column)
        width += needed
    yield _fitted(part, room)


def least_width(column: Sequence[str]) -> int:
    """Width of a column in which only the heading is broken, and only between words."""
    heading, *cells = column
    lines = (line for cell in cells for line in cell.split("\n"))
    return max(map(cell_len, (*heading.split(" "), *lines, "")))


def _fitted(part: Sequence[list[str]], room: int) -> list[list[str]]:
    """The same columns, with headings broken where there is no room for them on one line."""
    widths = [least_width(column) for column in part]
    left = room - sum(widths) - GAP * (len(widths) - 1)
    lacking = [
        max(0, cell_len(heading) - width) for (heading, *_), width in zip(part, widths, strict=True)
    ]
    for index in sorted(range(len(widths)), key=lambda index: lacking[index]):
        if lacking[index] <= left:
            widths[index] += lacking[index]
            left -= lacking[index]
    return [
        ["\n".join(_broken(heading, width)), *cells]
        for (heading, *cells), width in zip(part, widths, strict=True)
    ]


def _broken(text: str, width: int) -> list[str]:
    """Break text between words only; some characters are two cells wide."""
    if cell_len(text) <= width:
        return [text]
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and cell_len(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _print_part(out: Console, part: Sequence[Sequence[str]]) -> None:
    """Print a table without Rich, which takes seconds for a thousand rows."""
    widths = [
        max(cell_len(line) for cell in column for line in cell.split("\n")) for column in part
    ]
    heading, *rows = (_lines(row, widths) for row in zip(*part, strict=True))
    out.print(heading, style="bold", markup=False, soft_wrap=True)
    if rows:
        out.print("\n".join(rows), markup=False, soft_wrap=True)


def _lines(cells: Sequence[str], widths: Sequence[int]) -> str:
    """One row of a table, with as many lines as its longest cell has."""
    return "\n".join(
        (" " * GAP)
        .join(
            text + " " * (width - cell_len(text)) for text, width in zip(line, widths, strict=True)
        )
        .rstrip()
        for line in zip_longest(*(cell.split("\n") for cell in cells), fillvalue="")
    )


def plain(text: str) -> str:
    """Remove control characters from text whose source is not trusted."""
    return "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in text)


def print_line(out: Console, text: str) -> None:
    """Print a line that is neither broken nor read as markup, so that a path can be copied."""
    out.print(text, soft_wrap=True, markup=False)


def print_text(out: Console, text: str) -> None:
    """Print a sentence, broken between words where the terminal is too narrow."""
    print_line(out, "\n".join(_broken(text, out.width)) if out.is_terminal else text)


def print_next(out: Console, *arguments: str) -> None:
    """Print the command that the user is likely to want next, ready to be copied."""
    print_line(out, plain(f"next: {shlex.join(['orchid', *arguments])}"))


def print_next_on_terminal(*arguments: str) -> None:
    """Print the next command on a terminal only, since programs also read the output."""
    out = console()
    if out.is_terminal:
        print_next(out, *arguments)


@contextmanager
def stdout_for_json_alone(as_json: bool) -> Iterator[None]:
    """With ``--json``, send all other output to stderr, for example that of trackers."""
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
    except EOFError as error:  # Typer would take it for Ctrl-D and exit with 130
        raise RuntimeError(f"a file ended too early: {error}") from error
    except OSError as error:
        if error.filename is None:  # the output's own error: see main
            raise
        if debug:
            traceback.print_exc()
        print_error(f"{error.filename}: {reason_of(error)}")
        raise typer.Exit(FAILED) from error
    except KeyboardInterrupt as error:
        print("interrupted", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from error


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")
