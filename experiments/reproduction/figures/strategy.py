"""Max-min beside proportional shares over 1,000 episodes: the paper's Fig. 8."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from orchid_uav.experiments.figures.style import (
    PAGE_IN,
    STYLE,
    legend_shape,
    line_styles,
    set_ticks,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.figures.drawn import (
    DrawnFigure,
    missing_text,
    save,
    value_text,
)
from orchid_uav.experiments.reproduction.rows import FlownCase, Row
from orchid_uav.experiments.reproduction.settings import base

Floats = NDArray[np.float64]

KEY, TITLE = "fig8", "Fig. 8: max-min and proportional shares over 1,000 episodes, three resets"
NAMES = {
    "orchid-long": "max-min (orchid-long)",
    "orchid-pf": "proportional (orchid-pf)",
    "static-mmf": "hovering, max-min shares (static-mmf)",
    "static-pf": "hovering, proportional shares (static-pf)",
}
"""What is drawn; hovering is what each of them is without learning."""
EFFICIENCY, RATE, WORST = "energy_efficiency_bit_per_joule", "rate_jfi", "worst_rate_bps"
BOXES = (EFFICIENCY, RATE, "load_jfi", WORST)
BY_SEED = ("nearest_uav_m", "user_snr_db")
"""Metrics of which rows keep means alone."""
_HEIGHTS_IN = (1.55, 1.55, 2.3)


def draw_strategy(rows: Sequence[Row], seeds: int, folder: Path) -> DrawnFigure | None:
    """Draw what the two objectives lead to, flown without noise in the paper's network.

    Args:
        rows: all rows.
        seeds: how many seeds each method should have.
        folder: where the file is written.

    Returns:
        The figure; None if neither of the two was trained.
    """
    flown = {method: _flown(rows, method) for method in NAMES}
    flown = {method: cases for method, cases in flown.items() if cases}
    if not {"orchid-long", "orchid-pf"} & set(flown):
        return None
    sheet = _Sheet(flown)
    with style.context(["default", STYLE]):
        figure = sheet.draw()
    counts = {method: len(flown.get(method, [])) for method in ("orchid-long", "orchid-pf")}
    present = {method: count for method, count in counts.items() if count}
    missing = missing_text(present | {name: seeds for name in flown if name not in counts},
                           NAMES, seeds)  # fmt: skip
    return DrawnFigure(
        KEY,
        TITLE,
        save(figure, folder / f"{KEY}.svg"),
        sheet.in_words(),
        "All topologies of all seeds, flown without noise in the paper's network. Box: middle half "
        "and median; whiskers: 5th to 95th percentile. For distance and signal-to-noise ratio: a "
        "point for each seed, the line their mean. Lower left: a point for each topology, the "
        "great mark their mean. Lower right: the share of topologies whose worst user gets less "
        f"than that. {missing}".strip(),
    )


class _Sheet:
    """The content of the figure."""

    def __init__(self, flown: Mapping[str, Sequence[FlownCase]]) -> None:
        self.flown = flown
        self.looks = line_styles(flown)

    def draw(self) -> Figure:
        """Draw boxes, means by seed, scatter and distribution."""
        labels = [NAMES[method] for method in self.flown]
        lines, columns = legend_shape(labels, PAGE_IN)
        figure = Figure((PAGE_IN, sum(_HEIGHTS_IN) + 0.14 * lines + 0.5), layout="constrained")
        figure.suptitle(TITLE)
        grid = figure.add_gridspec(3, 6, height_ratios=_HEIGHTS_IN)
        draws: list[tuple[str, Callable[[Axes, str], None]]] = [
            *((metric, self._draw_boxes) for metric in BOXES),
            *((metric, self._draw_seeds) for metric in BY_SEED),
        ]
        for number, (metric, draw) in enumerate(draws):
            row, column = divmod(number, 3)
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2])
            draw(axes, metric)
            axes.set_title(wrap(METRICS[metric].heading, PAGE_IN / 3))
            axes.set_xticks([])
            axes.set_xlim(-0.6, len(self.flown) - 0.4)
            set_ticks(axes.yaxis)
        self._draw_scatter(figure.add_subplot(grid[2, :3]))
        self._draw_distribution(figure.add_subplot(grid[2, 3:]))
        handles = [
            Line2D([], [], label=NAMES[method], **look) for method, look in self.looks.items()
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=columns)
        return figure

    def _draw_boxes(self, axes: Axes, metric: str) -> None:
        for place, method in enumerate(self.flown):
            colour = self.looks[method]["color"]
            line = {"color": colour, "linewidth": 1.0}
            axes.boxplot(
                [self._topologies(method, metric)],
                positions=[place],
                widths=0.55,
                whis=(5, 95),
                boxprops=line,
                whiskerprops=line,
                capprops=line,
                medianprops=line | {"linewidth": 2.0},
                flierprops={
                    "marker": ".",
                    "markersize": 2.0,
                    "markerfacecolor": colour,
                    "markeredgewidth": 0.0,
                },
            )

    def _draw_seeds(self, axes: Axes, metric: str) -> None:
        for place, (method, cases) in enumerate(self.flown.items()):
            look = _mark(self.looks[method])
            means = self._means(cases, metric)
            spread = 0.3 * np.linspace(-1.0, 1.0, len(means)) if len(means) > 1 else [0.0]
            axes.plot(place + np.array(spread), means, **look)
            if len(means):
                axes.hlines(means.mean(), place - 0.4, place + 0.4, colors=look["color"])

    def _draw_scatter(self, axes: Axes) -> None:
        for method in self.flown:
            efficiency, rates = (self._topologies(method, metric) for metric in (EFFICIENCY, RATE))
            look = _mark(self.looks[method])
            axes.plot(efficiency, rates, alpha=0.25, **look | {"markersize": 2.0})
        for method in self.flown:
            efficiency, rates = (self._topologies(method, metric) for metric in (EFFICIENCY, RATE))
            look = _mark(self.looks[method]) | {"markersize": 9.0, "markeredgecolor": "white"}
            axes.plot([efficiency.mean()], [rates.mean()], **look | {"zorder": 4.0})
        axes.set_xlabel(METRICS[EFFICIENCY].heading)
        axes.set_ylabel(METRICS[RATE].heading)
        axes.set_title("topologies, and their means")
        set_ticks(axes.xaxis)
        set_ticks(axes.yaxis)

    def _draw_distribution(self, axes: Axes) -> None:
        for number, method in enumerate(self.flown):
            values = np.sort(self._topologies(method, WORST))
            shares = np.arange(1, len(values) + 1) / len(values)
            every = max(1, len(values) // 6)
            start = min(number * every // len(self.flown), len(values) - 1)
            axes.plot(values, shares, markevery=(start, every), **self.looks[method])
        axes.set_xlabel(METRICS[WORST].heading)
        axes.set_ylabel("share of topologies")
        axes.set_title("distribution of the worst user's rate")
        axes.set_ylim(0.0, 1.02)
        set_ticks(axes.xaxis)

    def _topologies(self, method: str, metric: str) -> Floats:
        values = [value for case in self.flown[method] for value in case.topologies[metric]]
        return np.array(values, np.float64) * METRICS[metric].scale

    def _means(self, cases: Sequence[FlownCase], metric: str) -> Floats:
        means = (case.metrics[metric][0] for case in cases)
        return np.array([mean for mean in means if mean is not None]) * METRICS[metric].scale

    def in_words(self) -> str:
        """Text alternative."""
        sentences = []
        for metric in (*BOXES, *BY_SEED):
            values = {}
            for method, cases in self.flown.items():
                scaled = (
                    self._topologies(method, metric)
                    if metric in BOXES
                    else self._means(cases, metric)
                )
                if len(scaled):
                    stored = float(scaled.mean()) / METRICS[metric].scale
                    values[NAMES[method]] = value_text(metric, stored)
            heading = METRICS[metric].title
            told = ", ".join(f"{name} {value}" for name, value in values.items())
            sentences.append(f"Mean {heading}: {told}.")
        return " ".join(sentences)


def _mark(look: Mapping[str, Any]) -> dict[str, Any]:
    """The look of single points."""
    return {**look, "linestyle": "none"}


def _flown(rows: Sequence[Row], method: str) -> list[FlownCase]:
    """A method's flights in the paper's network, of which topologies are kept."""
    found = []
    for row in rows:
        if row.method == method:
            try:
                case = row.find(base("tcp"))
            except LookupError:
                continue
            if set(BOXES) <= set(case.topologies):
                found.append(case)
    return found
