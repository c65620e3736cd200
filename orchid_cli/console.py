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
"""Columns of a terminal for which a text stays beside the other columns of its table."""

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
    made = Console(stderr=stderr, highlight=False, emoji=False)
    if not made.is_terminal:
        made = Console(stderr=stderr, highlight=False, emoji=False, soft_wrap=True)
    return made


def has_cursor(out: Console) -> bool:
    """Whether a display can be drawn over again there."""
    return out.is_terminal and not out.is_dumb_terminal


def print_error(message: str) -> None:
    """One error on stderr."""
    Console(stderr=True, highlight=False, emoji=False, soft_wrap=True).print(
        f"[bold red]error:[/] {_escaped(message)}"
    )


def print_warning(message: str) -> None:
    """One warning on stderr."""
    print_text(console(stderr=True), f"warning: {message}")


def print_note(message: str) -> None:
    """One note on stderr."""
    print_text(console(stderr=True), f"note: {message}")


def print_table(
    out: Console,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    wraps_last: bool = False,
) -> None:
    """A table on a terminal, and tab-separated lines elsewhere.

    On a terminal no cell is broken, and headings only between words: columns for which there is no
    room go into a further table below, with the same first column.

    Args:
        out: where.
        columns: their headings.
        rows: of cells.
        wraps_last: the last column is text, which is broken between words where room is short.
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
    """The last column, its cells broken between words so that it fits, if it can."""
    *others, (heading, *cells) = table
    beside = [least_width(column) + GAP for column in others]
    left = room - sum(beside)
    if left < _LEAST_TEXT:  # it goes into a table of its own
        left = max(room - sum(beside[:1]), _LEAST_TEXT)
    return [heading, *("\n".join(_broken(cell, left)) for cell in cells)]


def _parts(table: Sequence[list[str]], room: int) -> Iterator[list[list[str]]]:
    """Columns that fit side by side, the first of all before each group of them."""
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
    """With headings broken where there is no room for the whole of them."""
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
    """Lines of text that is broken between words alone, some characters being two cells wide."""
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
    """Put together here: of a thousand rows rich makes a table in seconds."""
    widths = [
        max(cell_len(line) for cell in column for line in cell.split("\n")) for column in part
    ]
    heading, *rows = (_lines(row, widths) for row in zip(*part, strict=True))
    out.print(heading, style="bold", markup=False, soft_wrap=True)
    if rows:
        out.print("\n".join(rows), markup=False, soft_wrap=True)


def _lines(cells: Sequence[str], widths: Sequence[int]) -> str:
    """A row, of as many lines as its longest cell has."""
    return "\n".join(
        (" " * GAP)
        .join(
            text + " " * (width - cell_len(text)) for text, width in zip(line, widths, strict=True)
        )
        .rstrip()
        for line in zip_longest(*(cell.split("\n") for cell in cells), fillvalue="")
    )


def plain(text: str) -> str:
    """Text of a file that may come from anywhere, without what would steer a terminal."""
    return "".join(one if one.isprintable() else "\N{REPLACEMENT CHARACTER}" for one in text)


def print_line(out: Console, text: str) -> None:
    """A line that is neither broken nor read as markup, so that a path in it can be copied."""
    out.print(text, soft_wrap=True, markup=False)


def print_text(out: Console, text: str) -> None:
    """A sentence, which a terminal that is too narrow gets broken between words."""
    print_line(out, "\n".join(_broken(text, out.width)) if out.is_terminal else text)


def print_next(out: Console, *arguments: str) -> None:
    """The command that is likely to be wanted next, to be copied."""
    print_line(out, plain(f"next: {shlex.join(['orchid', *arguments])}"))


def print_next_on_terminal(*arguments: str) -> None:
    """The same of commands whose output is also read by programs."""
    out = console()
    if out.is_terminal:
        print_next(out, *arguments)


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
        print_error(f"{error.filename}: {reason_of(error)}")
        raise typer.Exit(FAILED) from error
    except KeyboardInterrupt as error:
        print("interrupted", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from error


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")
