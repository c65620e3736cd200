"""Learning curves drawn with characters, for terminals."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from rich.cells import cell_len
from rich.text import Text

HEIGHT = 12
"""Height of a plot in lines, without its axis and legend."""
SAMPLES = 10
"""Rows of the table that replaces a plot when the output is not a terminal."""
_COLOURS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#F0E442", "#0072B2")
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
_LEAST_COLUMNS = 12
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""What each dot, by row and column, adds to the code of the empty braille character."""


class Line(NamedTuple):
    """A curve to draw."""

    name: str
    episodes: Sequence[float]
    values: Sequence[float]
    """In the unit shown; values that are not finite leave a gap."""


def can_show_braille(encoding: str) -> bool:
    """Whether an output's encoding has the characters of which curves are drawn."""
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
        lines: the curves, the first in front.
        heading: the text above the plot.
        width: the width available, in characters.
        digits: decimals of the numbers at the axis.
        height: lines of the plot itself, without axis and legend.
        braille: draw with dots, and tell curves apart by colour; otherwise by letters, in ASCII.

    Returns:
        Lines of at most ``width`` characters, unless that leaves the plot less than 12 beside its
        axis; a plain sentence where there is nothing to draw.
    """
    finite = [
        (episode, value)
        for line in lines
        for episode, value in zip(line.episodes, line.values, strict=True)
        if math.isfinite(value)
    ]
    if not finite:
        return [Text(f"{heading}: nothing to draw")]
    low, high = _bounds([value for _, value in finite])
    last = max(2.0, *(episode for episode, _ in finite))
    marks = [f"{high - (high - low) * row / (height - 1):.{digits}f}" for row in range(height)]
    margin = max(map(len, marks))
    across = max(width - margin - 2, _LEAST_COLUMNS)
    # From 0 to 1, left to right and top to bottom.
    placed = [
        [
            ((episode - 1.0) / (last - 1.0), (high - value) / (high - low))
            for episode, value in zip(line.episodes, line.values, strict=True)
        ]
        for line in lines
    ]
    vertical, corner, horizontal = "┤└─" if braille else "|+-"
    plot = [Text(heading, style="bold")]
    for number, row in enumerate(_drawn(placed, across, height, braille)):
        mark = marks[number] if number in (0, height // 2, height - 1) else ""
        plot.append(Text(f"{mark:>{margin}} {vertical}").append_text(row))
    plot.append(Text(" " * (margin + 1) + corner + horizontal * across))
    plot.append(Text(" " * (margin + 2) + _episode_axis(last, across)))
    return [*plot, *_legend([line.name for line in lines], width, braille)]


def _bounds(values: Sequence[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    room = 0.5 * abs(high) or 0.5
    return (low, high) if low < high else (low - room, high + room)


def _drawn(
    curves: Sequence[Sequence[tuple[float, float]]], across: int, height: int, braille: bool
) -> list[Text]:
    """Draw the curves as rows of braille characters, two by four dots each, or of letters.

    A character has the colour of the first curve in it; letters alternate where curves meet.
    """
    wide, tall = (2, 4) if braille else (1, 1)
    dots = [[0] * across for _ in range(height)]
    owners = [[-1] * across for _ in range(height)]
    for number, points in enumerate(curves):
        for x, y in _strokes(points, wide * across, tall * height):
            row, column = y // tall, x // wide
            dots[row][column] |= _DOTS[y % tall][x % wide]
            if owners[row][column] < 0 or (not braille and x % len(curves) == number):
                owners[row][column] = number
    return [
        Text.assemble(
            *(
                (chr(0x2800 + dot) if braille else _letter(owner), _colour(owner)) if dot else " "
                for dot, owner in zip(row, numbers, strict=True)
            )
        )
        for row, numbers in zip(dots, owners, strict=True)
    ]


def _strokes(
    points: Sequence[tuple[float, float]], across: int, down: int
) -> Iterator[tuple[int, int]]:
    """Cells on the way from each point to the next, unless one of them is not finite."""
    before = None
    for x, y in points:
        if not math.isfinite(y):
            before = None
            continue
        right, bottom = round(x * (across - 1)), round(y * (down - 1))
        left, top = before or (right, bottom)
        steps = max(abs(right - left), abs(bottom - top), 1)
        for step in range(steps + 1):
            share = step / steps
            yield round(left + (right - left) * share), round(top + (bottom - top) * share)
        before = right, bottom


def _episode_axis(last: float, across: int) -> str:
    """First, middle and last episode, and the word "episode" where there is room."""
    middle, end = f"{(1 + last) / 2:.0f}", f"{last:.0f}"
    left = f"1{middle:>{across // 2 + len(middle) // 2 - 1}}"
    room = across - len(left) - len(end)
    title = "episode" if room > len("episode") + 1 else ""
    return f"{left}{title:^{max(room, 1)}}{end}"


def _legend(names: Sequence[str], width: int, braille: bool) -> list[Text]:
    rows = [Text()]
    for number, name in enumerate(names):
        sample = "━━" if braille else _letter(number)
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
    """Curves as a small table: its headings, and one row for each of a few episodes.

    The episodes are spread evenly up to the last of the longest curve.
    """
    episodes = max((line.episodes for line in lines), key=len, default=())
    places = {math.ceil(len(episodes) * part / SAMPLES) for part in range(1, SAMPLES + 1)}
    rows = [
        [
            f"{episodes[place - 1]:.0f}",
            *(
                f"{line.values[place - 1]:.{digits}f}" if place <= len(line.values) else "-"
                for line in lines
            ),
        ]
        for place in sorted(places - {0})
    ]
    return ["episode", *(line.name for line in lines)], rows
