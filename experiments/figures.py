"""Figures of an evaluation, one for each metric, sized for a column or a page of a paper."""

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath
from matplotlib.ticker import MaxNLocator

from orchid_uav.experiments.metrics import HEADROOM, METRICS, label_of

Results = Sequence[Mapping[str, Any]]

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths of a column and of a page of an IEEE paper."""
MOST_LINES = 8
"""In a panel, besides one to compare with. More methods get further rows of panels."""

_DIMENSIONS = {"uavs": "UAVs", "users": "users", "speed_mps": "users' greatest speed (m/s)"}
_SETTINGS = ("distribution", *_DIMENSIONS, "heading_hold_s")
_SHARES = {"coverage", "rate_jfi", "load_jfi", "gbs_coverage"}
_SIGNED = {"utility", HEADROOM, "reward"}
_UNBREAKABLE = "\N{NO-BREAK SPACE}"

# Okabe and Ito's colours without yellow, too faint for lines; and grey.
_BLUE, _SKY, _VERMILLION, _ORANGE = "#0072B2", "#56B4E9", "#D55E00", "#E69F00"
_GREEN, _PURPLE, _BLACK, _GREY = "#009E73", "#CC79A7", "#000000", "#7F7F7F"
_SOLID, _DASHED, _LONG = (0, ()), (0, (4, 1.5)), (0, (8, 2))
_DOT, _TWO_DOTS = (0, (5, 1.5, 1, 1.5)), (0, (5, 1.5, 1, 1.5, 1, 1.5))
_TWO_DASHES, _SPARSE = (0, (4, 1.5, 4, 1.5, 1, 1.5)), (0, (1.5, 2.5))
_TWIN_LINE, _SAMPLED_LINE = (0, (1, 1)), (0, (2, 1))

_Look = tuple[str, Any, Any]
"""Colour, marker and line style."""
_LEARNED: dict[str, _Look] = {
    "orchid": (_BLUE, "o", _SOLID),
    "orchid-no-rf": (_SKY, "s", _DASHED),
    "orchid-pf": (_ORANGE, "^", _DOT),
    "orchid-random-init": (_VERMILLION, "D", _TWO_DOTS),
    "maddpg-pf": (_GREEN, "v", _LONG),
    "maddpg-mmf": (_PURPLE, "p", _TWO_DASHES),
}
_RULES: dict[str, _Look] = {
    "static-pf": (_BLACK, "X", _SPARSE),
    "static-mmf": (_GREY, "P", _DASHED),
    "static-pf-full-power": (_SKY, "X", _TWO_DOTS),
    "static-mmf-full-power": (_ORANGE, "P", _TWO_DASHES),
    "loiter-mmf": (_VERMILLION, "<", _LONG),
    "loiter-pf": (_PURPLE, ">", _DOT),
    "balanced-loiter": (_SKY, "h", _DASHED),
    "balanced-loiter-retargeted": (_PURPLE, "h", _TWO_DOTS),
    "track": (_GREEN, "d", _SPARSE),
    "planner": (_ORANGE, "*", _LONG),
    "planner-retargeted": (_VERMILLION, "*", _DOT),
}
_HOVER = ("static-pf", "static-mmf")
_HOLLOW = ("-zero", "-full-power", "-retargeted")
# Lengths without a common divisor: it takes long until a run looks like another.
_RUN_COLOURS = (_PURPLE, _GREEN, _VERMILLION, _ORANGE, _SKY, _GREY, _BLACK)
_RUN_MARKERS = ((4, 1, 0), (6, 1, 0), "8", (3, 1, 0), "H")
_RUN_LINES = (_LONG, _DASHED, _DOT, _TWO_DOTS, _TWO_DASHES, _SPARSE)

STYLE = {
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8,
    "figure.labelsize": 6.5,
    "figure.titlesize": 8,
    "figure.titleweight": "bold",
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.columnspacing": 1.2,
    "legend.handlelength": 3.2,
    "lines.linewidth": 1.1,
    "lines.markeredgewidth": 0.8,
    "lines.markersize": 4.5,
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "svg.hashsalt": "orchid",
    "text.parse_math": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
}


def draw_figures(
    results: Results, directory: Path, metrics: Sequence[str] = tuple(METRICS)
) -> list[Path]:
    """Write a PNG and an SVG of each metric that was measured.

    Args:
        results: the "results" of an evaluation's ``summary.json``.
        directory: made where it is missing.
        metrics: names of ``METRICS``.

    Returns:
        The files. The same results give the same bytes.
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
    """A metric over the dimension with most values, or as dots where no dimension varies.

    Returns:
        The figure, or None where the metric was not measured at all.
    """
    sheet = _Sheet(results, metric)
    if not sheet.curves:
        return None
    with style.context(["default", STYLE]):
        return sheet.draw_lines() if sheet.dimension else sheet.draw_dots()


class _Value(NamedTuple):
    """A mean as it is shown, and what lies a standard deviation below and above it, if known."""

    mean: float
    low: float
    high: float


_Setting = tuple[Any, ...]
_Curve = dict[tuple[_Setting, float], _Value]
"""By panel and place on the x axis."""


class _Sheet:
    """What a figure shows."""

    def __init__(self, results: Results, metric: str) -> None:
        self.metric = metric
        self.heading = METRICS[metric].heading
        self.dimension = _longest_dimension(results)
        self.looks = looks_of(label_of(result) for result in results)
        self.objectives = {label_of(result): result["objective"] for result in results}
        self.episodes = {result["episodes"] for result in results}
        self.curves: dict[str, _Curve] = {}
        """By the method's label, in the order of the results."""
        names = [name for name in _SETTINGS if name != self.dimension]
        for result in results:
            if result[metric]["mean"] is not None:
                panel = tuple(result[name] for name in names)
                place = float(result[self.dimension]) if self.dimension else 0.0
                curve = self.curves.setdefault(label_of(result), {})
                curve[panel, place] = _shown(metric, result[metric])
        self.panels = sorted({panel for curve in self.curves.values() for panel, _ in curve})
        self.titles = _titles(names, self.panels)

    def draw_lines(self) -> Figure:
        """Panels by setting side by side, by family of methods below each other."""
        twins = self._hovering_twins()
        families = _families([label for label in self.curves if label not in twins])
        columns = _columns(len(self.panels))
        rows = math.ceil(len(self.panels) / columns)
        width_in = COLUMN_IN if columns == 1 else PAGE_IN
        panel_in = min(2.0, max(1.5, 0.55 * width_in / columns))
        legends = [legend_shape(labels, width_in) for _, labels in families]
        heights_in = [rows * (panel_in + 0.2) + 0.14 * lines + 0.4 for lines, _ in legends]
        figure = self._begin_figure("Band", twins, width_in, sum(heights_in))
        blocks = figure.subfigures(len(families), squeeze=False, height_ratios=heights_in)[:, 0]
        first: Axes | None = None
        for block, (title, labels), (_, count) in zip(blocks, families, legends, strict=True):
            ylabel = wrap(self.heading, panel_in)
            panels = self._add_panels(
                block, columns, width_in, first, _DIMENSIONS[self.dimension or ""], ylabel
            )
            for axes, panel in zip(panels, self.panels, strict=True):
                for label in labels:
                    self._draw_line(axes, label, panel)
            first = first or panels[0]
            block.suptitle(title)
            handles = [Line2D([], [], label=label, **self.looks[label]) for label in labels]
            block.legend(handles=handles, loc="outside lower center", ncols=count)
        assert first is not None
        places = sorted({place for curve in self.curves.values() for _, place in curve})
        first.set_xticks(_far_apart(places, 9 if columns < 3 else 5))
        first.set_ylim(*_within_bounds(self.metric, first.get_ylim()))
        first.yaxis.set_major_locator(round_ticks())
        return figure

    def _draw_line(self, axes: Axes, label: str, panel: _Setting) -> None:
        points = sorted(
            (place, *value)
            for (where, place), value in self.curves[label].items()
            if where == panel
        )
        if not points:
            return
        places, means, lows, highs = zip(*points, strict=True)
        look = self.looks[label]
        axes.plot(places, means, label=label, **look)
        axes.fill_between(places, lows, highs, color=look["color"], alpha=0.1, linewidth=0)
        if len(points) == 1:  # a band has no width there
            axes.vlines(places, lows, highs, colors=look["color"], alpha=0.5)

    def draw_dots(self) -> Figure:
        """A method a row."""
        columns = min(3, len(self.panels))
        names_in = 0.3 + max(map(_width_in, self.curves))
        width_in = max(PAGE_IN if columns > 1 else COLUMN_IN, names_in + 1.7 * columns)
        height_in = math.ceil(len(self.panels) / columns) * (0.4 + 0.15 * len(self.curves)) + 0.4
        figure = self._begin_figure("Bar", {}, width_in, height_in)
        xlabel = wrap(self.heading, (width_in - names_in) / columns)
        panels = self._add_panels(figure, columns, width_in - names_in, None, xlabel, "")
        for axes, panel in zip(panels, self.panels, strict=True):
            for row, (label, curve) in enumerate(self.curves.items()):
                if (panel, 0.0) in curve:
                    mean, low, high = curve[panel, 0.0]
                    look = self.looks[label] | {"linestyle": "none"}
                    axes.hlines(row, low, high, colors=look["color"], alpha=0.6)
                    axes.plot([mean], [row], label=label, **look)
        panels[0].set_xlim(*_within_bounds(self.metric, panels[0].get_xlim()))
        panels[0].set_ylim(len(self.curves) - 0.5, -0.5)
        panels[0].set_yticks(range(len(self.curves)), list(self.curves))
        panels[0].xaxis.set_major_locator(round_ticks())
        return figure

    def _begin_figure(
        self, mark: str, twins: Mapping[str, str], width_in: float, height_in: float
    ) -> Figure:
        """An empty figure with its footnote."""
        sentences = []
        values = (value for curve in self.curves.values() for value in curve.values())
        if any(value.low < value.high for value in values):
            over = f" over {max(self.episodes)} episodes" if len(self.episodes) == 1 else ""
            sentences.append(f"{mark}: ±1 standard deviation{over}.")
        for static in dict.fromkeys(twins.values()):
            names = ", ".join(label for label, same in twins.items() if same == static)
            sentences.append(f"Not drawn, the same as {static}: {names}.")
        footnote = wrap(" ".join(sentences), width_in, 6.5)
        height_in += 0.12 * (1 + footnote.count("\n"))
        figure = Figure((width_in, height_in), layout="constrained")
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
        """Empty panels with the axes of the first, which may be in another block."""
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

    def _hovering_twins(self) -> dict[str, str]:
        """The static method by the twin of the same objective that does as it does."""
        twins = {}
        for label, curve in self.curves.items():
            static = f"static-{self.objectives[label]}"
            hover = self.curves.get(static, {})
            if label.endswith("-zero") and all(
                place in hover and all(map(math.isclose, value, hover[place]))
                for place, value in curve.items()
            ):
                twins[label] = static
        return twins


def _base(label: str) -> str:
    return label.removesuffix(", sampled").removesuffix("-zero")


def _longest_dimension(results: Results) -> str | None:
    counts = {name: len({result[name] for result in results}) for name in _DIMENSIONS}
    longest = max(counts, key=lambda name: counts[name])
    return longest if counts[longest] > 1 else None


def _bounds(metric: str) -> tuple[float, float]:
    """Between which a stored value lies."""
    return -math.inf if metric in _SIGNED else 0.0, 1.0 if metric in _SHARES else math.inf


def _shown(metric: str, summary: Mapping[str, Any]) -> _Value:
    scale = METRICS[metric].scale
    mean, std = summary["mean"], summary["std"] or 0.0
    least, greatest = _bounds(metric)
    return _Value(mean * scale, max(mean - std, least) * scale, min(mean + std, greatest) * scale)


def _within_bounds(metric: str, limits: tuple[float, float]) -> tuple[float, float]:
    """Limits of an axis that leave the values that cannot be no more room than a marker takes."""
    margin = 0.03 * (limits[1] - limits[0])
    least, greatest = (bound * METRICS[metric].scale for bound in _bounds(metric))
    return max(limits[0], least - margin), min(limits[1], greatest + margin)


def _titles(names: Sequence[str], panels: Sequence[_Setting]) -> list[str]:
    """What tells each panel from the others."""
    differing = [i for i in range(len(names)) if len({panel[i] for panel in panels}) > 1]
    return [
        ", ".join(_text(names[i], panel[i]).replace(" ", _UNBREAKABLE) for i in differing)
        for panel in panels
    ]


def _text(name: str, value: Any) -> str:
    """A setting in a title."""
    match name:
        case "distribution":
            return "clustered users" if value == "tcp" else f"{value} users"
        case "speed_mps":
            return f"up to {value:g} m/s" if value else "users at rest"
        case "heading_hold_s":
            return f"heading held for {value:g} s"
        case _:
            return f"{value} {_DIMENSIONS[name]}" if value != 1 else f"1 {_DIMENSIONS[name][:-1]}"


def _columns(panels: int) -> int:
    """Of 4 or 3 those that leave fewest gaps."""
    return panels if panels <= 4 else min((4, 3), key=lambda columns: -panels % columns)


def _far_apart(places: Sequence[float], most: int) -> list[float]:
    """Those of sorted places that have room for their numbers."""
    chosen = [places[0]]
    for place in places:
        if place - chosen[-1] >= (places[-1] - places[0]) / most and place > chosen[-1]:
            chosen.append(place)
    return chosen


def round_ticks() -> MaxNLocator:
    """Few ticks at round numbers."""
    return MaxNLocator(6, steps=[1, 2, 2.5, 5, 10])


def _width_in(text: str) -> float:
    """In the size of a legend."""
    return TextPath((0, 0), text, size=7).get_extents().width / 72


def wrap(text: str, width_in: float, points: float = 8) -> str:
    """Text in lines of a width, in type of so many points."""
    width = max(1, int(120 * width_in / points))
    wrapped = textwrap.fill(text, width, break_long_words=False, break_on_hyphens=False)
    return wrapped.replace(_UNBREAKABLE, " ")


def legend_shape(labels: Sequence[str], width_in: float) -> tuple[int, int]:
    """Lines and columns: as few lines as there is room for."""
    widths_in = [0.55 + _width_in(label) for label in labels]
    for lines in range(1, len(labels)):
        columns = math.ceil(len(labels) / lines)
        # The way matplotlib fills columns.
        if sum(map(max, np.array_split(widths_in, columns))) <= width_in:
            return lines, columns
    return len(labels), 1


def looks_of(labels: Iterable[str]) -> dict[str, dict[str, Any]]:
    """How methods are drawn: the built-in ones always the same, runs in order of appearance."""
    looks = {}
    runs: dict[str, int] = {}
    for label in labels:
        base = _base(label)
        known = _LEARNED.get(base) or _RULES.get(base)
        turn = 0 if known else runs.setdefault(base, len(runs))
        choices = _RUN_COLOURS, _RUN_MARKERS, _RUN_LINES
        colour, marker, line = known or (choice[turn % len(choice)] for choice in choices)
        look = {"color": colour, "marker": marker, "linestyle": line}
        if marker == "*" or isinstance(marker, tuple):  # stars have little area
            look["markersize"] = 6.5
        if label.endswith(_HOLLOW):
            look["markerfacecolor"] = "white"
        if label.endswith("-zero"):
            look["linestyle"] = _TWIN_LINE
        if label.endswith(", sampled"):
            look |= {"linestyle": _SAMPLED_LINE, "markerfacecolor": "#D0D0D0"}
        looks[label] = look
    return looks


def _families(labels: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Titles and methods of the rows of panels, each with one of the other family to compare."""
    if len(labels) <= MOST_LINES:
        return [("", list(labels))]
    rules = [label for label in labels if _base(label) in _RULES]
    learned = [label for label in labels if label not in rules]
    hover = next((label for label in _HOVER if label in rules), "")
    families = []
    for title, own, reference in (
        ("Learned policies", learned, hover),
        ("Rules and planners", [] if rules == [hover] else rules, "orchid"),
    ):
        parts = math.ceil(len(own) / MOST_LINES)
        size = math.ceil(len(own) / max(parts, 1))
        for part in range(parts):
            shown = {*own[part * size : (part + 1) * size], reference}
            suffix = f" ({part + 1} of {parts})" if parts > 1 else ""
            families.append((title + suffix, [label for label in labels if label in shown]))
    return families
