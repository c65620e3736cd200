"""Learning curves as a figure: a panel per metric, a colour per run or group."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from orchid_uav.experiments.figures.style import (
    COLUMN_IN,
    PAGE_IN,
    STYLE,
    clusters,
    identity_marks,
    legend_shape,
    limits_of,
    line_styles,
    set_ticks,
    shifted,
    thicker_pt,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS, heading_of
from orchid_uav.experiments.statistics.curves import (
    DEFAULT_COLUMNS,
    WINDOW,
    Curve,
    Row,
    group_curve,
    single_curve,
)
from orchid_uav.experiments.statistics.intervals import CONFIDENCE, MIN_SEEDS

Groups = Mapping[str, Sequence[Sequence[Row]]]
"""The rows of each run, by the name of its group."""

FORMATS = (".png", ".svg", ".pdf")
_PANEL_IN = 1.75
_MARKERS = 8
"""Number of markers along a line."""


def draw_learning_curves(
    groups: Groups,
    path: Path,
    columns: Sequence[str] = DEFAULT_COLUMNS,
    window: int = WINDOW,
    marks: bool = True,
    title: str = "",
) -> None:
    """Write a figure; the same rows give the same bytes.

    A group of one run is drawn as a line. For ``MIN_SEEDS`` runs or more, the interquartile mean is
    drawn with a bootstrap band; for fewer, every single run is drawn as a thin line. A footnote
    below the panels says what is drawn.

    Args:
        groups: the rows of each run, by the name of its group, which the legend shows.
        path: the file to write, whose name ends in one of ``FORMATS``.
        columns: columns of the rows; each gets a panel.
        window: episodes of the trailing mean.
        marks: whether ticks at the bottom show the episodes after which the optimizer was reset.
        title: the title, which should name the setting of the training.

    Raises:
        OSError: the file cannot be written.
        ValueError: there are no columns or no rows, or the window is less than one episode.
    """
    shown = {name: [rows for rows in runs if rows] for name, runs in groups.items()}
    shown = {name: runs for name, runs in shown.items() if runs}
    if not shown or not columns:
        raise ValueError("there is nothing to draw: no episodes, or no columns")
    with style.context(["default", STYLE]):
        figure = _Sheet(shown, columns, window, marks, title).draw()
        figure.savefig(path, metadata=_without_date(path))


class _Sheet:
    """The content of the figure."""

    def __init__(
        self, groups: Groups, columns: Sequence[str], window: int, marks: bool, title: str
    ) -> None:
        self.groups = groups
        self.columns = columns
        self.window = window
        self.longest = max(len(rows) for runs in groups.values() for rows in runs)
        self.every = max(1, self.longest // _MARKERS)
        """Episodes from one marker to the next."""
        self.title = title
        self.looks = line_styles(groups)
        self.curves = {
            column: {name: self._curves(runs, column) for name, runs in groups.items()}
            for column in columns
        }
        """One curve for each group, or one for each run."""
        self.resets = {
            name: [row["episode"] for rows in runs for row in rows if row.get("reset") == 1.0]
            for name, runs in groups.items()
            if marks
        }

    def _curves(self, runs: Sequence[Sequence[Row]], column: str) -> list[Curve]:
        if len(runs) >= MIN_SEEDS:
            return [group_curve(runs, column, self.window)]
        return [single_curve(rows, column, self.window) for rows in runs]

    def draw(self) -> Figure:
        """Draw the panels in rows, with the title above and the legend and a footnote below."""
        identical = {
            METRICS[column].title if column in METRICS else heading_of(column): clusters(
                self.groups, partial(self._are_identical, column)
            )
            for column in self.columns
        }
        marks, identities = identity_marks(identical)
        across = len(self.columns) if len(self.columns) < 3 else 2 + (len(self.columns) > 4)
        rows = math.ceil(len(self.columns) / across)
        width_in = COLUMN_IN if across == 1 else PAGE_IN
        labels = {
            name: f"{self._label(name)} {marks.get(name, '')}".strip() for name in self.groups
        }
        lines, count = legend_shape(list(labels.values()), width_in)
        footnote = wrap(" ".join([*self._footnotes(), *identities]), width_in, 6.5)
        title = wrap(self.title, width_in)
        height_in = rows * (_PANEL_IN + 0.2) + 0.14 * lines + 0.12 * footnote.count("\n") + 0.45
        height_in += 0.15 * (1 + title.count("\n")) * bool(title)
        figure = Figure((width_in, height_in), layout="constrained")
        figure.suptitle(title)
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
        first.set_xlim(0, 1.03 * max(self.longest, 2))  # a marker at the end is not cut off
        first.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10], integer=True))
        handles = [Line2D([], [], label=labels[name], **look) for name, look in self.looks.items()]
        block.legend(handles=handles, loc="outside lower center", ncols=count)
        return figure

    def _draw_panel(self, axes: Axes, column: str) -> None:
        for number, name in enumerate(self.groups):
            look, curves = self.looks[name], self.curves[column][name]
            same = [one for one in self.groups if self._are_identical(column, one, name)]
            turn, count = same.index(name), len(same)
            width = 0.6 if len(curves) > 1 else STYLE["lines.linewidth"]
            drawn: dict[str, Any] = {"linewidth": width + thicker_pt(turn, count)}
            if count > self.every:  # there is no room to stagger the markers of all
                drawn["transform"] = shifted(axes, turn, count)
            for nth, curve in enumerate(curves):
                if curve.band is not None:
                    axes.fill_between(
                        curve.episodes, *curve.band, color=look["color"], alpha=0.15, linewidth=0
                    )
                marked = self._marked(curve, number, only_lone=nth > 0)
                axes.plot(curve.episodes, curve.values, markevery=marked, **look, **drawn)
                # Lines that are shifted do not update the limits of the axes by themselves.
                axes.update_datalim(np.column_stack([curve.episodes, curve.values]))
            axes.autoscale_view()
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
        low, high = axes.dataLim.intervaly
        axes.set_ylim(*limits_of(column, low, high, axes.get_ylim()))
        set_ticks(axes.yaxis)

    def _are_identical(self, column: str, one: str, other: str) -> bool:
        pairs = zip(self.curves[column][one], self.curves[column][other], strict=False)
        return len(self.groups[one]) == len(self.groups[other]) and all(
            np.array_equal(mine.episodes, theirs.episodes)
            and np.allclose(mine.values, theirs.values, rtol=1e-9, atol=0.0, equal_nan=True)
            for mine, theirs in pairs
        )

    def _marked(self, curve: Curve, number: int, only_lone: bool) -> list[int]:
        """Indices of the points with markers: evenly spaced ones, and points without neighbours.

        The spaced ones are staggered from group to group, so that they do not hide each other. A
        point without neighbours has no line and shows only by its marker.
        """
        known = np.isfinite(curve.values)
        beside = np.pad(known, 1)
        lone = known & ~beside[:-2] & ~beside[2:]
        if only_lone:
            return np.flatnonzero(lone).tolist()
        chosen = np.zeros_like(known)
        chosen[number * self.every // len(self.groups) :: self.every] = True
        if not (chosen & known).any():
            chosen[np.flatnonzero(known)[-1:]] = True
        return np.flatnonzero(chosen | lone).tolist()

    def _label(self, name: str) -> str:
        runs = len(self.groups[name])
        return f"{name} ({runs} runs)" if runs > 1 else name

    def _footnotes(self) -> list[str]:
        counts = [len(runs) for runs in self.groups.values()]
        sentences = []
        if self.window > 1:
            sentences.append(f"Trailing means of {self.window} episodes.")
        if any(count >= MIN_SEEDS for count in counts):
            sentences.append(
                f"Line and band: interquartile mean over runs at each episode, and its "
                f"{CONFIDENCE:.0%} percentile-bootstrap interval."
            )
            if any(self._has_early_end(name) for name in self.groups):
                sentences.append(
                    "A run that ended early counts until its last episode; a line ends where "
                    f"fewer than {MIN_SEEDS} runs go on."
                )
        if any(1 < count < MIN_SEEDS for count in counts):
            sentences.append(f"Thin lines: single runs, where there are fewer than {MIN_SEEDS}.")
        if any(self.resets.values()):
            sentences.append("Ticks at the bottom: resets of the optimizer.")
        return sentences

    def _has_early_end(self, name: str) -> bool:
        runs = self.groups[name]
        return len(runs) >= MIN_SEEDS and len({len(rows) for rows in runs}) > 1


def _without_date(path: Path) -> dict[str, None]:
    """Metadata that leaves out the date, which would differ from call to call."""
    keys = {".svg": "Date", ".pdf": "CreationDate"}
    return {keys[path.suffix]: None} if path.suffix in keys else {}
