"""Methods over an axis: users (Fig. 4), UAVs (Fig. 5) and speeds (Fig. 6)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D

from orchid_uav.experiments.figures.side_by_side import PanelSize, Value, draw_side_by_side
from orchid_uav.experiments.figures.style import (
    PAGE_IN,
    STYLE,
    bounds_of,
    clusters,
    identity_marks,
    is_rule,
    legend_shape,
    limits_of,
    line_styles,
    set_ticks,
    wrap,
)
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.checks import MARGINS
from orchid_uav.experiments.reproduction.figures.drawn import (
    DrawnFigure,
    extremes_text,
    missing_text,
    save,
    told_together,
    value_text,
)
from orchid_uav.experiments.reproduction.rows import FlownCase, Row
from orchid_uav.experiments.reproduction.settings import Case

METRICS_SHOWN = ("coverage", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi")
"""What the paper shows over an axis."""
FAMILIES: Mapping[str, Sequence[str]] = {
    "The paper's methods": ("orchid", "orchid-no-rf", "maddpg-pf", "maddpg-mmf", "static-pf"),
    "Beside their twins, which do nothing (-zero)": (
        *("orchid", "orchid-zero", "maddpg-pf", "maddpg-pf-zero"),
        *("maddpg-mmf", "maddpg-mmf-zero"),
    ),
    "Other trainings": (
        *("orchid-pf", "orchid-pf-zero", "orchid-random-init", "orchid-random-init-zero"),
        *("maddpg-pf-paper", "maddpg-mmf-paper", "orchid-tuned"),
        *("orchid-uniform", "orchid-no-rf-uniform"),
    ),
    "Rules, and what this project adds; orchid to compare": (
        *("static-pf", "static-mmf", "loiter-mmf", "balanced-loiter", "track"),
        *("balanced-loiter-120", "best-response", "orchid-informed", "orchid"),
    ),
}
"""Rows of panels. Uniform users are flown by what was trained on hotspots, too."""
_CLOSE = tuple(FAMILIES)[:2]
"""Rows with a scale of their own: among the others' values theirs could not be told apart."""
_PANEL_IN = 1.3
_LEAST_SPAN = 5.0
"""An axis is at least so many margins long: what does not count does not fill it."""


class Axis(NamedTuple):
    """What a figure shows."""

    key: str
    title: str
    label: str
    """Of the axis."""
    at: str
    """How a place on it is said, such as "{:g} users"."""
    places: Mapping[float, Case]


class _Point(NamedTuple):
    """A method in a case: over seeds the mean of its means and of its deviations."""

    mean: float
    std: float
    """Over topologies."""
    between: float
    """Standard deviation over seeds; 0 where there is one."""


_Curves = Mapping[str, Mapping[float, _Point]]


def draw_scaling(axis: Axis, rows: Sequence[Row], seeds: int, folder: Path) -> DrawnFigure | None:
    """Draw every method over an axis.

    Args:
        axis: what is drawn.
        rows: all rows.
        seeds: how many seeds each method should have.
        folder: where the file is written.

    Returns:
        The figure; None if no method was flown at two places of the axis.
    """
    sheet = _Sheet(axis, rows)
    if not any(len(curve) > 1 for curve in sheet.curves[METRICS_SHOWN[0]].values()):
        return None
    with style.context(["default", STYLE]):
        figure = sheet.draw()
    return DrawnFigure(
        axis.key,
        axis.title,
        save(figure, folder / f"{axis.key}.svg"),
        sheet.in_words(),
        f"{sheet.caption()} {sheet.missing(seeds)}".strip(),
    )


class _Sheet:
    """The content of the figure."""

    def __init__(self, axis: Axis, rows: Sequence[Row]) -> None:
        self.axis = axis
        self.by_method: dict[str, list[Row]] = {}
        for row in rows:
            if row.flights:
                self.by_method.setdefault(row.method, []).append(row)
        wanted = dict.fromkeys(label for labels in FAMILIES.values() for label in labels)
        self.curves: dict[str, _Curves] = {
            metric: _known({label: self._curve(label, metric) for label in wanted})
            for metric in METRICS_SHOWN
        }
        """By metric, then by label."""
        drawn = self.curves[METRICS_SHOWN[0]]
        self.families = {
            title: [label for label in labels if label in drawn]
            for title, labels in FAMILIES.items()
            if any(label in drawn for label in labels)
        }
        self.looks = line_styles(drawn)

    def _curve(self, label: str, metric: str) -> dict[float, _Point]:
        key = label.removesuffix("-zero")
        curve = {}
        for place, case in self.axis.places.items():
            flown = _flown(self.by_method.get(key, []), case, is_zero=key != label)
            known = [pair for pair in (one.metrics[metric] for one in flown) if pair[0] is not None]
            if known:
                means, stds = np.array(known, np.float64).T
                between = float(np.std(means, ddof=1)) if len(means) > 1 else 0.0
                curve[place] = _Point(float(means.mean()), float(stds.mean()), between)
        return curve

    def draw(self) -> Figure:
        """Draw a row of panels for each family of methods."""
        heights_in = []
        shapes = {}
        for title, labels in self.families.items():
            shapes[title] = legend_shape([f"{label} [1]" for label in labels], PAGE_IN)
            heights_in.append(_PANEL_IN + 0.75 + 0.14 * shapes[title][0])
        marks = {
            title: identity_marks(self._identical(own)) for title, own in self.families.items()
        }
        notes = {
            title: wrap(" ".join(sentences), PAGE_IN, 6.5)
            for title, (_, sentences) in marks.items()
        }
        heights_in = [
            height + 0.12 * (1 + note.count("\n")) * bool(note)
            for height, note in zip(heights_in, notes.values(), strict=True)
        ]
        figure = Figure((PAGE_IN, sum(heights_in) + 0.25), layout="constrained")
        figure.suptitle(self.axis.title)
        blocks = figure.subfigures(len(heights_in), 1, squeeze=False, height_ratios=heights_in)
        for block, (title, labels) in zip(blocks[:, 0], self.families.items(), strict=True):
            limits = {metric: self._limits(metric, title in _CLOSE) for metric in METRICS_SHOWN}
            self._draw_family(block, title, labels, limits, marks[title][0], shapes[title][1])
            block.supxlabel(notes[title], x=0.01, ha="left")
        return figure

    def _draw_family(
        self,
        block: SubFigure,
        title: str,
        labels: Sequence[str],
        limits: Mapping[str, tuple[float, float]],
        marks: Mapping[str, str],
        columns: int,
    ) -> None:
        block.suptitle(title, x=0.01, ha="left")
        inner = block.subfigures(1, 1, squeeze=False)[0, 0]  # its legend stays above the footnote
        panels = inner.subplots(1, len(METRICS_SHOWN), sharex=True)
        places = sorted(self.axis.places)
        for axes, metric in zip(panels, METRICS_SHOWN, strict=True):
            curves = self.curves[metric]
            values = {
                label: {place: _shown(metric, point) for place, point in curves[label].items()}
                for label in labels
            }
            low, high = limits[metric]
            size = PanelSize(0.75 * PAGE_IN / len(panels), _PANEL_IN, high - low, len(places))
            draw_side_by_side(axes, values, self.looks, size)
            axes.set_title(METRICS[metric].heading)
            axes.set_xlabel(self.axis.label)
            axes.set_ylim(low, high)
            set_ticks(axes.yaxis)
        panels[0].set_xticks(places)
        room = 0.16 * (places[-1] - places[0])
        panels[0].set_xlim(places[0] - room, places[-1] + room)
        handles = [
            Line2D([], [], label=f"{label} {marks.get(label, '')}".strip(), **self.looks[label])
            for label in labels
        ]
        inner.legend(handles=handles, loc="outside lower center", ncols=columns)

    def _limits(self, metric: str, is_close: bool) -> tuple[float, float]:
        """Limits that several rows of panels share, so that they can be compared."""
        labels = {
            label
            for title, own in self.families.items()
            for label in own
            if (title in _CLOSE) == is_close
        }
        values = [
            _shown(metric, point)
            for label in labels
            for point in self.curves[metric][label].values()
        ]
        least, greatest = (bound * METRICS[metric].scale for bound in bounds_of(metric))
        low = max(min(min(one.low, one.mean - one.error) for one in values), least)
        high = min(max(max(one.high, one.mean + one.error) for one in values), greatest)
        low, high = _widened(low, high, _LEAST_SPAN * MARGINS[metric] * METRICS[metric].scale)
        if high > greatest:
            low, high = low - (high - greatest), greatest
        room = 0.05 * (high - low)
        return limits_of(metric, low, high, (low - room, high + room))

    def _identical(self, labels: Sequence[str]) -> dict[str, list[list[str]]]:
        found = {}
        for metric in METRICS_SHOWN:
            curves = self.curves[metric]

            def same(one: str, other: str, curves: _Curves = curves) -> bool:
                return curves[one].keys() == curves[other].keys() and all(
                    math.isclose(curves[one][place].mean, curves[other][place].mean, rel_tol=1e-9)
                    for place in curves[one]
                )

            found[METRICS[metric].title] = clusters(labels, same)
        return found

    def caption(self) -> str:
        """How the figure is read."""
        return (
            "Marker and line: mean over training seeds and topologies, flown without noise. Band: "
            "±1 standard deviation over topologies. Bar: ±1 standard deviation between seeds. "
            "The two upper panels of a column have the same scale, and so have those below them. "
            "A method that was not trained for an axis stands at the paper's network alone."
        )

    def missing(self, seeds: int) -> str:
        """What is not drawn; what nobody flies here by design is not missing."""
        drawn = self.curves[METRICS_SHOWN[0]]
        present = {
            label: len(self.by_method[label])
            for label in drawn
            if not label.endswith("-zero") and not is_rule(label)
        }
        rules = dict.fromkeys(filter(is_rule, drawn), seeds)
        wanted = [*self.families.get(next(iter(FAMILIES)), ()), *next(iter(FAMILIES.values()))]
        told = missing_text(present | rules, dict.fromkeys(wanted), seeds)
        places = [
            self.axis.at.format(place)
            for place in sorted(self.axis.places)
            if not any(place in curve for curve in drawn.values())
        ]
        return f"{told} Not flown: {', '.join(places)}.".strip() if places else told

    def in_words(self) -> str:
        """Text alternative."""
        sentences = []
        for metric in METRICS_SHOWN:
            curves = self.curves[metric]
            means = {
                label: float(np.mean([point.mean for point in curve.values()]))
                for label, curve in curves.items()
            }
            heading = METRICS[metric].title
            words = f"{heading[:1].upper()}{heading[1:]} in the mean over the axis: "
            words += extremes_text(metric, means)
            sentences.append(f"{words}{self._ends_in_words(metric)}.")
        return " ".join(sentences)

    def _ends_in_words(self, metric: str) -> str:
        """Where the curves of the paper's methods and of their twins begin and end."""
        begin, end = min(self.axis.places), max(self.axis.places)
        ends = {}
        for label in (own for title in _CLOSE for own in self.families.get(title, ())):
            curve = self.curves[metric][label]
            if begin in curve and end in curve:
                ends[label] = " to ".join(
                    value_text(metric, curve[place].mean) for place in (begin, end)
                )
        if not ends:
            return ""
        places = " to ".join(self.axis.at.format(place) for place in (begin, end))
        return f". From {places}: {'; '.join(told_together(ends))}"


def _widened(low: float, high: float, span: float) -> tuple[float, float]:
    """Two ends at least so far apart, about the same middle."""
    half = max(span - (high - low), 0.0) / 2.0
    return low - half, high + half


def _flown(rows: Iterable[Row], case: Case, is_zero: bool) -> list[FlownCase]:
    found = []
    for row in rows:
        try:
            found.append(row.find(case, is_zero=is_zero))
        except LookupError:
            continue
    return found


def _known(curves: Mapping[str, Mapping[float, _Point]]) -> _Curves:
    return {label: curve for label, curve in curves.items() if curve}


def _shown(metric: str, point: _Point) -> Value:
    scale = METRICS[metric].scale
    least, greatest = bounds_of(metric)
    low, high = max(point.mean - point.std, least), min(point.mean + point.std, greatest)
    return Value(point.mean * scale, low * scale, high * scale, point.between * scale)
