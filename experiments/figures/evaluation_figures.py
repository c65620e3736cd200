"""Figures of an evaluation, one for each metric, sized for a column or a page of a paper."""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D

from orchid_uav.experiments.figures.side_by_side import PanelSize, Value, draw_side_by_side
from orchid_uav.experiments.figures.style import (
    COLUMN_IN,
    PAGE_IN,
    STYLE,
    base_of,
    bounds_of,
    clusters,
    identity_marks,
    is_rule,
    legend_shape,
    limits_of,
    line_styles,
    set_ticks,
    setting_text,
    width_of,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.statistics.results import EvaluationResult

Results = Sequence[EvaluationResult]

MOST_LINES = 8
"""The most lines of a panel, besides one to compare with; more methods get further rows."""

_DIMENSIONS = {"uavs": "UAVs", "users": "users", "speed_mps": "users' greatest speed (m/s)"}
_SETTINGS = ("distribution", *_DIMENSIONS, "heading_hold_s")
_HOVER = ("static-pf", "static-mmf")


def draw_figures(
    results: Results, directory: Path, metrics: Sequence[str] = tuple(METRICS)
) -> list[Path]:
    """Write a PNG and an SVG of each metric that was measured.

    Args:
        results: the "results" of an evaluation's ``summary.json``.
        directory: directory for the files; it is made if it is missing.
        metrics: names in ``METRICS``.

    Returns:
        The paths of the files. The same results give the same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for metric in metrics:
        figure = draw_metric(results, metric)
        if figure is None:
            continue
        with style.context(["default", STYLE]):
            for suffix in ("png", "svg"):
                paths.append(directory / f"{metric}.{suffix}")
                figure.savefig(paths[-1], metadata={"Date": None})
                figure.set_layout_engine("none")  # the second file takes the first one's layout
    return paths


def draw_metric(results: Results, metric: str) -> Figure | None:
    """Draw a metric over the dimension with most values, or as dots if no dimension varies.

    Returns:
        The figure, or None if the metric was not measured at all.
    """
    sheet = _Sheet(results, metric)
    if not sheet.curves:
        return None
    with style.context(["default", STYLE]):
        return sheet.draw_lines() if sheet.dimension else sheet.draw_dots()


_Setting = tuple[Any, ...]
_Curve = dict[tuple[_Setting, float], Value]
"""The values of a method, by panel and place on the x axis."""


class _Sheet:
    """The content of a figure."""

    def __init__(self, results: Results, metric: str) -> None:
        self.metric = metric
        self.heading = METRICS[metric].heading
        self.dimension = _longest_dimension(results)
        self.looks = line_styles(result.label for result in results)
        self.topologies = {result.episodes for result in results}
        self.curves: dict[str, _Curve] = {}
        """Curves by the method's label, in the order of the results."""
        names = [name for name in _SETTINGS if name != self.dimension]
        for result in results:
            summary = result.metrics[metric]
            if summary.mean is not None:
                panel = tuple(getattr(result, name) for name in names)
                place = float(getattr(result, self.dimension)) if self.dimension else 0.0
                curve = self.curves.setdefault(result.label, {})
                curve[panel, place] = _shown(metric, summary.mean, summary.std or 0.0)
        self.panels = sorted({panel for curve in self.curves.values() for panel, _ in curve})
        self.title, self.titles = _titles(names, self.panels)
        self.places = sorted({place for curve in self.curves.values() for _, place in curve})
        values = [value for curve in self.curves.values() for value in curve.values()]
        self.low = min((value.low for value in values), default=0.0)
        self.high = max((value.high for value in values), default=0.0)
        self.has_spread = any(value.low < value.high for value in values)

    def draw_lines(self) -> Figure:
        """Draw a block for each family of methods, in which every setting has a panel."""
        marks, identities = identity_marks(self._identical())
        texts = {label: f"{label} {marks.get(label, '')}".strip() for label in self.looks}
        families = _families(list(self.curves))
        columns = _columns(len(self.panels))
        across = min(len(families), 2) if columns == 1 else 1
        width_in = COLUMN_IN if columns * across == 1 else PAGE_IN
        block_in = width_in / across
        panel_in = 2.3 if across == 2 else min(2.0, max(1.5, 0.55 * block_in / columns))
        legends = [legend_shape([texts[label] for label in own], block_in) for _, own in families]
        rows_in = math.ceil(len(self.panels) / columns) * (panel_in + 0.2)
        heights_in = [
            rows_in + 0.14 * max(lines for lines, _ in legends[begin : begin + across]) + 0.4
            for begin in range(0, len(legends), across)
        ]
        figure = self._begin_figure("Band", identities, width_in, sum(heights_in))
        grid = figure.add_gridspec(len(heights_in), across, height_ratios=heights_in)
        first: Axes | None = None
        for number, (title, labels) in enumerate(families):
            block = figure.add_subfigure(grid[divmod(number, across)])
            ylabel = wrap(self.heading, panel_in)
            panels = self._add_panels(
                block, columns, block_in, first, _DIMENSIONS[self.dimension or ""], ylabel
            )
            for axes, panel in zip(panels, self.panels, strict=True):
                self._draw_curves(axes, labels, panel, panel_in, block_in / columns)
            first = first or panels[0]
            block.suptitle(title)
            handles = [Line2D([], [], label=texts[label], **self.looks[label]) for label in labels]
            begin = number - number % across
            lines = max(lines for lines, _ in legends[begin : begin + across])
            blanks = lines * legends[number][1] - len(handles)  # makes panels of a row equally high
            handles += [Line2D([], [], label=" ", linestyle="none")] * max(0, blanks)
            block.legend(handles=handles, loc="outside lower center", ncols=legends[number][1])
        assert first is not None
        first.set_xticks(_far_apart(self.places, 9 if columns < 3 else 5))
        room = 0.07 * (self.places[-1] - self.places[0])
        first.set_xlim(self.places[0] - room, self.places[-1] + room)
        first.set_ylim(*limits_of(self.metric, self.low, self.high, first.get_ylim()))
        set_ticks(first.yaxis)
        return figure

    def _draw_curves(
        self, axes: Axes, labels: Sequence[str], panel: _Setting, height_in: float, width_in: float
    ) -> None:
        own = {
            label: {place: value for (where, place), value in self.curves[label].items()
                    if where == panel}
            for label in labels
        }  # fmt: skip
        size = PanelSize(width_in, height_in, self.high - self.low, len(self.places))
        draw_side_by_side(axes, own, self.looks, size)

    def draw_dots(self) -> Figure:
        """Draw a row for each method."""
        columns = min(3, len(self.panels))
        names_in = 0.3 + max(map(width_of, self.curves))
        width_in = max(PAGE_IN if columns > 1 else COLUMN_IN, names_in + 1.7 * columns)
        height_in = math.ceil(len(self.panels) / columns) * (0.4 + 0.15 * len(self.curves)) + 0.4
        figure = self._begin_figure("Bar", [], width_in, height_in)
        xlabel = wrap(self.heading, (width_in - names_in) / columns)
        panels = self._add_panels(figure, columns, width_in - names_in, None, xlabel, "")
        for axes, panel in zip(panels, self.panels, strict=True):
            for row, (label, curve) in enumerate(self.curves.items()):
                if (panel, 0.0) in curve:
                    mean, low, high, _ = curve[panel, 0.0]
                    look = self.looks[label] | {"linestyle": "none"}
                    axes.hlines(row, low, high, colors=look["color"], alpha=0.6)
                    axes.plot([mean], [row], label=label, **look)
        panels[0].set_xlim(*limits_of(self.metric, self.low, self.high, panels[0].get_xlim()))
        panels[0].set_ylim(len(self.curves) - 0.5, -0.5)
        panels[0].set_yticks(range(len(self.curves)), list(self.curves))
        set_ticks(panels[0].xaxis)
        return figure

    def _begin_figure(
        self, mark: str, identities: Sequence[str], width_in: float, height_in: float
    ) -> Figure:
        """Make an empty figure with its title and footnote."""
        sentences = []
        if self.has_spread:
            count = max(self.topologies)
            over = f" over {count} topologies" if len(self.topologies) == 1 and count > 1 else ""
            sentences.append(f"{mark}: ±1 standard deviation{over}.")
        footnote = wrap(" ".join([*sentences, *identities]), width_in, 6.5)
        title = wrap(self.title, width_in)
        height_in += 0.12 * (1 + footnote.count("\n")) + 0.15 * (1 + title.count("\n"))
        figure = Figure((width_in, height_in), layout="constrained")
        figure.suptitle(title)
        figure.supxlabel(footnote, x=0.01, ha="left")
        return figure

    def _add_panels(
        self,
        block: Figure | SubFigure,
        columns: int,
        width_in: float,
        first: Axes | None,
        xlabel: str,
        ylabel: str,
    ) -> list[Axes]:
        """Add empty panels that share the axes of the first, which may be in another block."""
        panels: list[Axes] = []
        rows = math.ceil(len(self.panels) / columns)
        for index, title in enumerate(self.titles):
            axes = block.add_subplot(rows, columns, index + 1, sharex=first, sharey=first)
            first = first or axes
            is_left, is_lowest = index % columns == 0, index + columns >= len(self.panels)
            axes.set_title(wrap(title, width_in / columns))
            axes.set_xlabel(xlabel if is_lowest else "")
            axes.set_ylabel(ylabel if is_left else "")
            axes.tick_params(left=is_left, labelleft=is_left)
            axes.tick_params(bottom=is_lowest, labelbottom=is_lowest)
            panels.append(axes)
        return panels

    def _identical(self) -> dict[str, list[list[str]]]:
        """For each panel, by title, the methods in clusters of identical curves."""
        found = {}
        for title, panel in zip(self.titles, self.panels, strict=True):
            own = {
                label: [(place, value) for (where, place), value in curve.items() if where == panel]
                for label, curve in self.curves.items()
            }

            def same(one: str, other: str, own: Mapping[str, Any] = own) -> bool:
                pairs = zip(own[one], own[other], strict=False)
                return len(own[one]) == len(own[other]) and all(
                    place == there and all(map(math.isclose, value, another))
                    for (place, value), (there, another) in pairs
                )

            found[title] = clusters([label for label in own if own[label]], same)
        return found


def _longest_dimension(results: Results) -> str | None:
    counts = {name: len({getattr(result, name) for result in results}) for name in _DIMENSIONS}
    longest = max(counts, key=lambda name: counts[name])
    return longest if counts[longest] > 1 else None


def _shown(metric: str, mean: float, std: float) -> Value:
    scale = METRICS[metric].scale
    least, greatest = bounds_of(metric)
    return Value(mean * scale, max(mean - std, least) * scale, min(mean + std, greatest) * scale)


def _titles(names: Sequence[str], panels: Sequence[_Setting]) -> tuple[str, list[str]]:
    """What the settings of all panels have in common, and how each one differs."""
    differing = {names[at] for at in range(len(names)) if len({panel[at] for panel in panels}) > 1}
    settings = [dict(zip(names, panel, strict=True)) for panel in panels]
    shared, own = (
        [
            setting_text({name: setting[name] for name in names if (name in differing) == is_own})
            for setting in settings
        ]
        for is_own in (False, True)
    )
    return shared[0] if shared else "", own


def _columns(panels: int) -> int:
    """Panels per row, 4 or 3, whichever leaves fewer gaps."""
    return panels if panels <= 4 else min((4, 3), key=lambda columns: -panels % columns)


def _far_apart(places: Sequence[float], most: int) -> list[float]:
    """Those of the sorted places whose numbers do not overlap."""
    chosen = [places[0]]
    for place in places:
        if place - chosen[-1] >= (places[-1] - places[0]) / most and place > chosen[-1]:
            chosen.append(place)
    return chosen


def _families(labels: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Titles and methods of the rows of panels; each has a method of the other family, to compare.

    A policy, its twin and its sampled actions are in the same row.
    """
    if len(labels) <= MOST_LINES:
        return [("", list(labels))]
    rules = [label for label in labels if is_rule(label)]
    learned = [label for label in labels if label not in rules]
    hover = next((label for label in _HOVER if label in rules), "")
    has_twins = any(label.endswith("-zero") for label in learned)
    families = []
    for title, own, reference in (
        ("Learned policies" + " and their zero-action twins" * has_twins, learned, hover),
        ("Rules and planners", [] if rules == [hover] else rules, "orchid"),
    ):
        kin = clusters(own, lambda one, other: base_of(one) == base_of(other))
        parts = _parts(kin)
        for number, part in enumerate(parts, start=1):
            shown = [*part, *(label for label in labels if label == reference)]
            suffix = f" ({number} of {len(parts)})" if len(parts) > 1 else ""
            families.append((title + suffix, shown))
    return families


def _parts(kin: Sequence[list[str]]) -> list[list[str]]:
    """Split labels into as few parts as ``MOST_LINES`` allows, and keep kin together."""
    count = math.ceil(sum(map(len, kin)) / MOST_LINES)
    while True:
        cut = np.linspace(0, len(kin), count + 1).round().astype(int)
        parts = [[*itertools.chain(*kin[begin:end])] for begin, end in itertools.pairwise(cut)]
        if count >= len(kin) or max(map(len, parts)) <= MOST_LINES:
            return parts
        count += 1
