"""Curves over a few places, drawn side by side where their markers would hide each other."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from orchid_uav.experiments.figures.style import (
    SHIFT_PT,
    STYLE,
    clusters,
    shifted,
    thicker_pt,
)

_MOST_SHIFT_PT = 16.0
"""The most distance from the first to the last of the markers at one place."""


class Value(NamedTuple):
    """A mean as it is shown, with the values one standard deviation below and above, if known."""

    mean: float
    low: float
    high: float
    error: float = 0.0
    """Half the length of its error bar."""


class PanelSize(NamedTuple):
    """What tells how close two markers of a panel are."""

    width_in: float
    height_in: float
    span: float
    """From the least to the greatest value of the panel."""
    places: int


def draw_side_by_side(
    axes: Axes,
    curves: Mapping[str, Mapping[float, Value]],
    looks: Mapping[str, Mapping[str, Any]],
    size: PanelSize,
) -> None:
    """Draw curves side by side where markers would hide each other, and thicker below.

    Args:
        axes: the panel.
        curves: the values of each curve by place on the x axis, by label.
        looks: the look of each label; see ``line_styles``.
        size: the size of the panel.
    """
    marker = STYLE["lines.markersize"] / 72 / size.height_in * size.span
    apart_pt = 0.8 * 72 * size.width_in / max(1, size.places - 1)

    def close(one: str, other: str, markers: float) -> list[bool]:
        """At each place, whether two curves are closer than ``markers`` heights of a marker."""
        shared = [place for place in curves[one] if place in curves[other]]
        means = [(curves[one][place].mean, curves[other][place].mean) for place in shared]
        return [math.isclose(*pair, abs_tol=markers * marker) for pair in means]

    def hides(one: str, other: str) -> bool:
        found = close(one, other, 0.5)
        return 2 * sum(found) >= max(1, len(found))

    def coincides(one: str, other: str) -> bool:
        return all(close(one, other, 0.25))

    shown = [label for label, curve in curves.items() if curve]
    for cluster in clusters(shown, hides):
        count = len(cluster)
        step_pt = min(SHIFT_PT, _MOST_SHIFT_PT / max(1, count - 1), 0.6 * apart_pt / count)
        lines = {label: same for same in clusters(cluster, coincides) for label in same}
        for turn, label in enumerate(cluster):
            same = lines[label]
            thicker = thicker_pt(same.index(label), len(same))
            look = {
                **looks[label],
                "transform": shifted(axes, turn, count, step_pt),
                "linewidth": STYLE["lines.linewidth"] + thicker,
            }
            _draw_line(axes, label, curves[label], look)


def _draw_line(
    axes: Axes, label: str, curve: Mapping[float, Value], look: Mapping[str, Any]
) -> None:
    places = sorted(curve)
    means, lows, highs, errors = zip(*(curve[place] for place in places), strict=True)
    axes.plot(places, means, label=label, **look)
    axes.fill_between(places, lows, highs, color=look["color"], alpha=0.1, linewidth=0)
    bar = {"colors": look["color"], "transform": look["transform"]}
    if len(places) == 1:  # a band over one place would have no width
        axes.vlines(places, lows, highs, alpha=0.5, **bar)
    if any(errors):
        below, above = (np.array(means) + sign * np.array(errors) for sign in (-1.0, 1.0))
        axes.vlines(places, below, above, linewidth=STYLE["lines.linewidth"], **bar)
