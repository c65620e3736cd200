"""Learning curves as a figure: a panel per figure of an episode, a colour per run or group."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from orchid_uav.experiments.curves import (
    CONFIDENCE,
    DEFAULT_COLUMNS,
    MIN_RUNS,
    WINDOW,
    Curve,
    Row,
    curve_table,
    group_curve,
    heading_of,
    single_curve,
    smoothed,
)
from orchid_uav.experiments.figures import (
    COLUMN_IN,
    PAGE_IN,
    STYLE,
    legend_shape,
    looks_of,
    round_ticks,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS

__all__ = ["curve_table", "draw_learning_curves", "smoothed"]

Groups = Mapping[str, Sequence[Sequence[Row]]]
"""Rows of each run, by the name of its group."""

FORMATS = (".png", ".svg", ".pdf")
_PANEL_IN = 1.75
_MARKERS = 8
"""Along a line."""


def draw_learning_curves(
    groups: Groups,
    path: Path,
    columns: Sequence[str] = DEFAULT_COLUMNS,
    window: int = WINDOW,
    marks: bool = True,
) -> None:
    """Write a figure; the same rows give the same bytes.

    A group of one run is a line. Of ``MIN_RUNS`` runs or more the interquartile mean is drawn with
    a bootstrap band, of fewer every single run, thin. What is drawn is said below the panels.

    Args:
        groups: rows of each run, by the name of its group, which is in the legend.
        path: ends in one of ``FORMATS``.
        columns: of the rows, a panel each.
        window: episodes of the trailing mean.
        marks: whether ticks at the bottom show the episodes after which the optimizer was reset.

    Raises:
        OSError: the file cannot be written.
        ValueError: no columns, no rows, or a window of no episode.
    """
    shown = {name: [rows for rows in runs if rows] for name, runs in groups.items()}
    shown = {name: runs for name, runs in shown.items() if runs}
    if not shown or not columns:
        raise ValueError("there is nothing to draw: no episodes, or no columns")
    with style.context(["default", STYLE]):
        figure = _Sheet(shown, columns, window, marks).draw()
        figure.savefig(path, metadata=_without_date(path))


class _Sheet:
    """What the figure shows."""

    def __init__(self, groups: Groups, columns: Sequence[str], window: int, marks: bool) -> None:
        self.groups = groups
        self.columns = columns
        self.window = window
        self.longest = max(len(rows) for runs in groups.values() for rows in runs)
        # Along a line of hundreds of episodes, dashes are noise.
        self.looks = {name: look | {"linestyle": "-"} for name, look in looks_of(groups).items()}
        self.resets = {
            name: [row["episode"] for rows in runs for row in rows if row.get("reset") == 1.0]
            for name, runs in groups.items()
            if marks
        }

    def draw(self) -> Figure:
        """Panels in rows, the legend and a footnote below."""
        across = len(self.columns) if len(self.columns) < 3 else 2 + (len(self.columns) > 4)
        rows = math.ceil(len(self.columns) / across)
        width_in = COLUMN_IN if across == 1 else PAGE_IN
        labels = {name: self._label(name) for name in self.groups}
        lines, count = legend_shape(list(labels.values()), width_in)
        footnote = wrap(" ".join(self._footnotes()), width_in, 6.5)
        height_in = rows * (_PANEL_IN + 0.2) + 0.14 * lines + 0.12 * footnote.count("\n") + 0.45
        figure = Figure((width_in, height_in), layout="constrained")
        figure.supxlabel(footnote, x=0.01, ha="left")
        block = figure.subfigures(1, 1, squeeze=False)[
            0, 0
        ]  # whose legend makes room for itself above the footnote
        first: Axes | None = None
        for index, column in enumerate(self.columns):
            axes = block.add_subplot(rows, across, index + 1, sharex=first)
            first = first or axes
            is_lowest = index + across >= len(self.columns)
            self._draw_panel(axes, column)
            axes.set_title(wrap(heading_of(column), width_in / across))
            axes.set_xlabel("episode" if is_lowest else "")
            axes.tick_params(bottom=is_lowest, labelbottom=is_lowest)
        assert first is not None
        first.set_xlim(0, max(self.longest, 2))
        first.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10], integer=True))
        handles = [Line2D([], [], label=labels[name], **look) for name, look in self.looks.items()]
        block.legend(handles=handles, loc="outside lower center", ncols=count)
        return figure

    def _draw_panel(self, axes: Axes, column: str) -> None:
        for number, (name, runs) in enumerate(self.groups.items()):
            look = self.looks[name]
            if len(runs) >= MIN_RUNS:
                curve = group_curve(runs, column, self.window)
                assert curve.band is not None
                axes.fill_between(
                    curve.episodes, *curve.band, color=look["color"], alpha=0.15, linewidth=0
                )
                self._draw_line(axes, curve, look, number)
            else:
                thin = {"linewidth": 0.6} if len(runs) > 1 else {}
                for turn, rows in enumerate(runs):
                    hidden = {"marker": ""} if turn else {}
                    curve = single_curve(rows, column, self.window)
                    self._draw_line(axes, curve, look | thin | hidden, number)
            episodes = self.resets.get(name, [])
            heights = [0.02 + 0.035 * number] * len(episodes)
            axes.plot(
                episodes,
                heights,
                transform=axes.get_xaxis_transform(),
                linestyle="none",
                marker="|",
                color=look["color"],
                scalex=False,
                scaley=False,
            )
        low, high = axes.get_ylim()
        least = 10.0 ** -METRICS[column].digits if column in METRICS else 0.0
        if high - low < least:  # differences that no table shows shall not fill a panel either
            axes.set_ylim((low + high - least) / 2, (low + high + least) / 2)
        axes.yaxis.set_major_locator(round_ticks())

    def _draw_line(self, axes: Axes, curve: Curve, look: Mapping[str, Any], number: int) -> None:
        """With a few markers, a part of their distance further on for each group."""
        every = max(1, self.longest // _MARKERS)
        begin = number * every // len(self.groups)
        axes.plot(curve.episodes, curve.values, markevery=(begin, every), **look)

    def _label(self, name: str) -> str:
        runs = len(self.groups[name])
        return f"{name} ({runs} runs)" if runs > 1 else name

    def _footnotes(self) -> list[str]:
        counts = [len(runs) for runs in self.groups.values()]
        sentences = []
        if self.window > 1:
            sentences.append(f"Trailing means of {self.window} episodes.")
        if any(count >= MIN_RUNS for count in counts):
            sentences.append(
                f"Line and band: interquartile mean over runs at each episode, and its "
                f"{CONFIDENCE:.0%} percentile-bootstrap interval."
            )
            if any(self._has_early_end(name) for name in self.groups):
                sentences.append(
                    "A run that ended early counts until its last episode; a line ends where "
                    f"fewer than {MIN_RUNS} runs go on."
                )
        if any(1 < count < MIN_RUNS for count in counts):
            sentences.append(f"Thin lines: single runs, where there are fewer than {MIN_RUNS}.")
        if any(self.resets.values()):
            sentences.append("Ticks at the bottom: resets of the optimizer.")
        return sentences

    def _has_early_end(self, name: str) -> bool:
        runs = self.groups[name]
        return len(runs) >= MIN_RUNS and len({len(rows) for rows in runs}) > 1


def _without_date(path: Path) -> dict[str, None]:
    """Metadata that would differ from call to call, in the formats that have it."""
    keys = {".svg": "Date", ".pdf": "CreationDate"}
    return {keys[path.suffix]: None} if path.suffix in keys else {}
