"""Learning curves over seeds: the paper's Fig. 3, and Fig. 7 from random starts."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from orchid_uav.experiments.figures.style import (
    PAGE_IN,
    STYLE,
    clusters,
    identity_marks,
    is_rule,
    legend_shape,
    limits_of,
    line_styles,
    set_ticks,
    thicker_pt,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.figures.drawn import (
    PANELS,
    DrawnFigure,
    listed_text,
    missing_text,
    save,
    value_text,
)
from orchid_uav.experiments.reproduction.rows import Row
from orchid_uav.experiments.reproduction.settings import CURVE_TOPOLOGIES
from orchid_uav.experiments.runs.directory import FINAL_EPISODES
from orchid_uav.experiments.statistics.curves import (
    Curve,
    group_curve,
    scale_of,
)
from orchid_uav.experiments.statistics.intervals import CONFIDENCE, MIN_SEEDS

_PANEL_IN = 1.35
_MARKERS = 6
"""Number of markers along a line."""
_TRAINED, _FLOWN = "in training, with noise", "flown without noise"


class Convergence(NamedTuple):
    """What a figure of learning curves shows."""

    key: str
    title: str
    methods: Sequence[str]


def draw_convergence(
    wanted: Convergence, rows: Sequence[Row], seeds: int, folder: Path
) -> DrawnFigure | None:
    """Draw each metric while it is trained, and the policy without its noise below.

    Args:
        wanted: what is drawn.
        rows: all rows.
        seeds: how many seeds each method should have.
        folder: where the file is written.

    Returns:
        The figure; None if none of its methods has a training.
    """
    by_method = {
        method: [row for row in rows if row.method == method and row.curve]
        for method in wanted.methods
    }
    by_method = {method: own for method, own in by_method.items() if own}
    if not by_method:
        return None
    sheet = _Sheet(by_method, wanted.title)
    with style.context(["default", STYLE]):
        figure = sheet.draw()
    return DrawnFigure(
        wanted.key,
        wanted.title,
        save(figure, folder / f"{wanted.key}.svg"),
        sheet.in_words(),
        f"{sheet.caption()} "
        + missing_text(
            {method: len(own) for method, own in by_method.items()}, wanted.methods, seeds
        ),
    )


class _Sheet:
    """The content of the figure."""

    def __init__(self, by_method: Mapping[str, Sequence[Row]], title: str) -> None:
        self.by_method = by_method
        self.title = title
        self.looks = line_styles(by_method)
        self.trained = {
            metric: {method: _trained(own, metric) for method, own in by_method.items()}
            for metric in PANELS
        }
        self.flown = {
            metric: {method: _flown(own, metric) for method, own in by_method.items()}
            for metric in PANELS
        }
        self.longest = max(row.episodes for own in by_method.values() for row in own)
        self.is_flown = any(len(curve.values) for curve in self.flown[PANELS[0]].values())

    def draw(self) -> Figure:
        """Draw the panels, a column for each metric, with the legend below."""
        identical = {
            METRICS[metric].title: clusters(self.by_method, self._are_identical(metric))
            for metric in PANELS
        }
        marks, identities = identity_marks(identical)
        labels = {method: self._label(method, marks.get(method, "")) for method in self.by_method}
        lines, columns = legend_shape(list(labels.values()), PAGE_IN)
        footnote = wrap(" ".join(identities), PAGE_IN, 6.5)
        rows = 1 + self.is_flown
        height_in = rows * (_PANEL_IN + 0.2) + 0.14 * lines + 0.5
        height_in += 0.12 * (1 + footnote.count("\n")) * bool(footnote)
        figure = Figure((PAGE_IN, height_in), layout="constrained")
        figure.suptitle(self.title)
        figure.supxlabel(footnote, x=0.01, ha="left")
        block = figure.subfigures(1, 1, squeeze=False)[0, 0]
        panels = block.subplots(rows, len(PANELS), sharex=True, sharey="col", squeeze=False)
        for column, metric in enumerate(PANELS):
            self._draw_panel(panels[0, column], metric, self.trained[metric])
            self._draw_resets(panels[0, column])
            panels[0, column].set_title(METRICS[metric].heading)
            if self.is_flown:
                self._draw_panel(panels[1, column], metric, self.flown[metric])
            self._set_limits(panels[0, column], metric)
            panels[-1, column].set_xlabel("episode")
        panels[0, 0].set_ylabel(_TRAINED)
        if self.is_flown:
            panels[1, 0].set_ylabel(_FLOWN)
        handles = [Line2D([], [], label=labels[name], **look) for name, look in self.looks.items()]
        block.legend(handles=handles, loc="outside lower center", ncols=columns)
        return figure

    def _label(self, method: str, mark: str) -> str:
        count = len(self.by_method[method])
        runs = "topologies of" if is_rule(method) else "trained with"
        return f"{method} ({runs} {count} seed{'s' * (count != 1)}) {mark}".strip()

    def _draw_panel(self, axes: Axes, metric: str, curves: Mapping[str, Curve]) -> None:
        alike = clusters(curves, self._are_identical(metric))
        for number, (method, curve) in enumerate(curves.items()):
            if not len(curve.values):
                continue
            look = self.looks[method]
            if curve.band is not None:
                axes.fill_between(
                    curve.episodes, *curve.band, color=look["color"], alpha=0.15, linewidth=0
                )
            every = max(1, len(curve.values) // _MARKERS)
            start = number * every // len(curves)
            [same] = [cluster for cluster in alike if method in cluster]
            width = STYLE["lines.linewidth"] + thicker_pt(same.index(method), len(same))
            axes.plot(
                curve.episodes,
                curve.values,
                markevery=(min(start, len(curve.values) - 1), every),
                linewidth=width,
                **look,
            )

    def _draw_resets(self, axes: Axes) -> None:
        for number, (method, own) in enumerate(self.by_method.items()):
            episodes = [episode for row in own for episode in row.reset_episodes]
            axes.plot(
                episodes,
                [0.03 + 0.04 * number] * len(episodes),
                transform=axes.get_xaxis_transform(),
                linestyle="none",
                marker="|",
                color=self.looks[method]["color"],
                scalex=False,
                scaley=False,
            )

    def _set_limits(self, axes: Axes, metric: str) -> None:
        drawn = [*self.trained[metric].values(), *self.flown[metric].values()]
        values = np.concatenate(
            [end for curve in drawn for end in (curve.values, *(curve.band or ()))]
        )
        axes.set_ylim(*limits_of(metric, float(values.min()), float(values.max()), axes.get_ylim()))
        axes.set_xlim(0, 1.03 * self.longest)
        set_ticks(axes.yaxis)
        axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))

    def _are_identical(self, metric: str) -> Callable[[str, str], bool]:
        def same(one: str, other: str) -> bool:
            return all(
                len(curves[one].values) == len(curves[other].values)
                and np.allclose(curves[one].values, curves[other].values, rtol=1e-9, atol=0.0)
                for curves in (self.trained[metric], self.flown[metric])
            )

        return same

    def caption(self) -> str:
        """How the figure is read."""
        blocks = {row.curve.block for own in self.by_method.values() for row in own if row.curve}
        block = " or ".join(map(str, sorted(blocks)))
        sentences = [
            f"Upper row: while it is trained, with exploration noise, as means of {block} episodes "
            "in a row; hovering flies the same topologies as the trainings and learns nothing."
        ]
        if self.is_flown:
            sentences.append(
                f"Lower row: the policy of the moment without noise, on {CURVE_TOPOLOGIES} other "
                "topologies, at the training's progress; hovering flies these as well."
            )
        if any(len(own) >= MIN_SEEDS for own in self.by_method.values()):
            sentences.append(
                "Line and band: interquartile mean over seeds, and its "
                f"{CONFIDENCE:.0%} bootstrap interval."
            )
        if any(row.reset_episodes for own in self.by_method.values() for row in own):
            sentences.append("Ticks at the bottom: resets of the optimizer.")
        if len({objective_of(method) for method in self.by_method}) > 1:
            sentences.append(
                "Rewards of the two objectives (names with -pf, and the others) measure different "
                "things."
            )
        return " ".join(sentences)

    def in_words(self) -> str:
        """Text alternative."""
        first = next(iter(self.by_method))
        sentences = ["Interquartile means over seeds."]
        for metric in PANELS:
            ends = {method: _end(curve, metric) for method, curve in self.trained[metric].items()}
            curve = self.trained[metric][first]
            begin = value_text(metric, curve.values[0] / scale_of(metric))
            heading = METRICS[metric].title
            sentences.append(
                f"{heading[:1].upper()}{heading[1:]} over the last {FINAL_EPISODES} episodes of "
                f"training: {listed_text(metric, ends)}; {first} begins at {begin}."
            )
            flown = {
                method: curve.values[-1] / scale_of(metric)
                for method, curve in self.flown[metric].items()
                if len(curve.values)
            }
            if flown:
                sentences.append(f"At last, without noise: {listed_text(metric, flown)}.")
        return " ".join(sentences)


def objective_of(method: str) -> str:
    """The objective of whose rewards a method's are, in words."""
    return "proportional" if "-pf" in method else "max-min"


def _trained(rows: Sequence[Row], metric: str) -> Curve:
    return group_curve([_blocks(row, metric) for row in rows], metric, window=1)


def _blocks(row: Row, metric: str) -> list[dict[str, float]]:
    """A row's means over blocks, each at its middle episode."""
    assert row.curve is not None
    block = row.curve.block
    return [
        {"episode": (number + 0.5) * block, metric: value}
        for number, value in enumerate(row.curve.mean[metric])
    ]


def _flown(rows: Sequence[Row], metric: str) -> Curve:
    runs = [
        [
            {"episode": float(episodes), metric: row.evaluations[str(episodes)][metric]}
            for episodes in sorted(map(int, row.evaluations))
        ]
        for row in rows
        if row.evaluations
    ]
    return group_curve(runs, metric, window=1)


def _end(curve: Curve, metric: str) -> float:
    """Mean over the last ``FINAL_EPISODES`` episodes, in the stored unit."""
    late = curve.episodes > curve.episodes[-1] - FINAL_EPISODES
    return float(np.mean(curve.values[late])) / scale_of(metric)
