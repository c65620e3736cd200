"""Learning curves drawn with characters, for terminals."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from rich.cells import cell_len
from rich.text import Text

HEIGHT = 12
"""Lines of a plot, without its axis and legend."""
SAMPLES = 10
"""Episodes of the table that stands for a plot where there is no terminal."""
_COLOURS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#F0E442", "#0072B2")
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
_LEAST_COLUMNS = 12
_BRAILLE = 0x2800
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of the dots of a braille character, by row and column."""


class Line(NamedTuple):
    """A curve to draw."""

    name: str
    episodes: Sequence[float]
    values: Sequence[float]
    """Scaled as shown; those that are not finite leave a gap."""


class Pens(NamedTuple):
    """What a plot is drawn with."""

    vertical: str
    corner: str
    horizontal: str
    uses_braille: bool


_UNICODE = Pens("┤", "└", "─", uses_braille=True)
_ASCII = Pens("|", "+", "-", uses_braille=False)


def can_show_braille(encoding: str) -> bool:
    """Whether an output's encoding has the characters that curves are drawn with."""
    try:
        "⣿┤└─".encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def terminal_curves(
    lines: Sequence[Line],
    heading: str,
    width: int,
    digits: int = 3,
    height: int = HEIGHT,
    braille: bool = True,
) -> list[Text]:
    """Curves over each other, with axes and a legend.

    Args:
        lines: curves, the first in front.
        heading: above the plot.
        width: characters that there are.
        digits: behind the point, of the numbers at the axis.
        height: lines of the plot itself.
        braille: draw with dots, and tell curves apart by colour; otherwise by letters, in ASCII.

    Returns:
        Lines of at most ``width`` characters, unless that leaves the plot less than 12 beside its
        axis; a plain sentence where there is nothing to draw.
    """
    points = [_finite_points(line) for line in lines]
    everything = [point for one in points for point in one]
    if not everything:
        return [Text(f"{heading}: nothing to draw")]
    pens = _UNICODE if braille else _ASCII
    low, high = _bounds([value for _, value in everything])
    last = max(2.0, *(episode for episode, _ in everything))
    marks = [f"{high - (high - low) * row / (height - 1):.{digits}f}" for row in range(height)]
    margin = max(map(len, marks))
    across = max(width - margin - 2, _LEAST_COLUMNS)
    draw = _draw_braille if pens.uses_braille else _draw_letters
    rows = draw([_placed(one, last, low, high) for one in points], across, height)
    plot = [Text(heading, style="bold")]
    for number, (mark, row) in enumerate(zip(marks, rows, strict=True)):
        shown = mark if number in (0, height // 2, height - 1) else ""
        plot.append(Text(f"{shown:>{margin}} {pens.vertical}").append_text(row))
    plot.append(Text(" " * (margin + 1) + pens.corner + pens.horizontal * across))
    plot.append(Text(" " * (margin + 2) + _episode_axis(last, across)))
    return [*plot, *_legend([line.name for line in lines], width, pens.uses_braille)]


def _finite_points(line: Line) -> list[tuple[float, float]]:
    return [
        (float(episode), float(value))
        for episode, value in zip(line.episodes, line.values, strict=True)
        if math.isfinite(value)
    ]


def _bounds(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    room = 0.5 * abs(high) or 0.5
    return (low, high) if low < high else (low - room, high + room)


def _placed(
    points: Sequence[tuple[float, float]], last: float, low: float, high: float
) -> list[tuple[float, float]]:
    """From 0 to 1, left to right and top to bottom."""
    return [
        ((episode - 1.0) / (last - 1.0), (high - value) / (high - low)) for episode, value in points
    ]


def _draw_braille(
    curves: Sequence[Sequence[tuple[float, float]]], across: int, height: int
) -> list[Text]:
    """Two by four dots a character, in the colour of the curve in front."""
    dots = [[0] * across for _ in range(height)]
    owners = [[-1] * across for _ in range(height)]
    for number, points in reversed(list(enumerate(curves))):
        for x, y in _strokes(points, 2 * across, 4 * height):
            dots[y // 4][x // 2] |= _DOTS[y % 4][x % 2]
            owners[y // 4][x // 2] = number
    return _coloured(
        lambda row, column: chr(_BRAILLE + dots[row][column]) if dots[row][column] else " ", owners
    )


def _draw_letters(
    curves: Sequence[Sequence[tuple[float, float]]], across: int, height: int
) -> list[Text]:
    """A letter a column; where curves meet, they take turns."""
    owners = [[-1] * across for _ in range(height)]
    for number, points in enumerate(curves):
        for x, y in _strokes(points, across, height):
            if owners[y][x] < 0 or x % len(curves) == number:
                owners[y][x] = number
    return _coloured(
        lambda row, column: _letter(owners[row][column]) if owners[row][column] >= 0 else " ",
        owners,
    )


def _coloured(character: Callable[[int, int], str], owners: Sequence[Sequence[int]]) -> list[Text]:
    rows = []
    for row, numbers in enumerate(owners):
        text = Text()
        for column, number in enumerate(numbers):
            text.append(character(row, column), style=_colour(number) if number >= 0 else "")
        rows.append(text)
    return rows


def _strokes(
    points: Sequence[tuple[float, float]], across: int, down: int
) -> Iterator[tuple[int, int]]:
    """Cells on the way from each point to the next."""
    cells = [(round(x * (across - 1)), round(y * (down - 1))) for x, y in points]
    yield from cells[:1]
    for (left, top), (right, bottom) in pairwise(cells):
        steps = max(abs(right - left), abs(bottom - top), 1)
        for step in range(1, steps + 1):
            share = step / steps
            yield round(left + (right - left) * share), round(top + (bottom - top) * share)


def _episode_axis(last: float, across: int) -> str:
    """First, middle and last episode, and what they are where there is room."""
    middle, end = f"{(1 + last) / 2:.0f}", f"{last:.0f}"
    left = f"1{middle:>{across // 2 + len(middle) // 2 - 1}}"
    room = across - len(left) - len(end)
    title = "episode" if room > len("episode") + 1 else ""
    return f"{left}{title:^{max(room, 1)}}{end}"


def _legend(names: Sequence[str], width: int, uses_braille: bool) -> list[Text]:
    rows = [Text()]
    for number, name in enumerate(names):
        sample = "━━" if uses_braille else _letter(number)
        entry = Text(sample, style=_colour(number)).append(f" {name}", style="default")
        if rows[-1] and cell_len(rows[-1].plain) + 3 + cell_len(entry.plain) > width:
            rows.append(Text())
        rows[-1].append("   " if rows[-1] else "").append_text(entry)
    return rows


def _letter(number: int) -> str:
    return _LETTERS[number % len(_LETTERS)]


def _colour(number: int) -> str:
    return _COLOURS[number % len(_COLOURS)]


def sampled_table(lines: Sequence[Line], digits: int = 3) -> tuple[list[str], list[list[str]]]:
    """Curves as a small table: its headings, and a row for each of some episodes.

    The episodes are spread evenly up to the last of the longest curve.
    """
    longest = max((len(line.episodes) for line in lines), default=0)
    places = sorted({math.ceil(longest * part / SAMPLES) for part in range(1, SAMPLES + 1)} - {0})
    reference = max(lines, key=lambda line: len(line.episodes), default=None)
    rows = []
    for place in places:
        assert reference is not None
        cells = [
            f"{line.values[place - 1]:.{digits}f}" if place <= len(line.values) else "-"
            for line in lines
        ]
        rows.append([f"{reference.episodes[place - 1]:.0f}", *cells])
    return ["episode", *(line.name for line in lines)], rows
