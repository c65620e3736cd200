"""Small charts of the report as inline SVG; each stands beside a table with the same numbers."""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.wording import people_text, rate_text, share_text
from orchid_uav.experiments.planning.model import Floats

_WIDTH = 380
_MOST_BINS = 6
_LINE_HEIGHT = 14
_WIDEST_BAR = 72


Counts = NDArray[np.int64]


class Range(NamedTuple):
    """A row of the chart of what may go otherwise than planned."""

    name: str
    mean: float
    worst: float


class FleetPoint(NamedTuple):
    """What a number of drones reaches."""

    drones: int
    served: float
    above_want: float | None


def rates_chart(plan: MappedPlan) -> Markup:
    """How many people have which rate, served by drones and by masts, and how many have none."""
    edges_bps, drones, masts = _counted(plan)
    unserved = plan.served_by(NOBODY)
    names = ["none", *_bin_names(edges_bps)]
    bars = [(unserved, 0), *zip(drones.tolist(), masts.tolist(), strict=True)]
    tallest = max(1, *(sum(bar) for bar in bars))
    left, top, height = 10, 44, 120
    step = min(_WIDEST_BAR, (_WIDTH - 2 * left) / len(bars))
    parts = []
    for place, ((lower, upper), name) in enumerate(zip(bars, names, strict=True)):
        x, across = left + place * step + 0.1 * step, 0.8 * step
        kinds = ("c-unserved",) if place == 0 else ("c-drone", "c-mast")
        y = float(top + height)
        for count, kind in zip((lower, upper), kinds, strict=False):
            tall = count / tallest * height
            y -= tall
            if count:
                parts.append(_bar(x, y, across, tall, kind))
        middle = x + across / 2
        if lower + upper:
            parts.append(_label(f"{lower + upper:,}", middle, y - 5, class_="value"))
        first, _, second = name.partition(" ")
        parts.append(_label(first, middle, top + height + 15))
        parts.append(_label(second, middle, top + height + 15 + _LINE_HEIGHT))
    base = f"M{left} {top + height}H{left + step * len(bars):.1f}"
    parts.append(element("path", d=base, class_="axis"))
    if plan.want is not None and edges_bps[0] <= plan.want.rate_bps <= edges_bps[-1]:
        x = left + (1.0 + _place_of(plan.want.rate_bps, edges_bps)) * step
        line = f"M{x:.1f} {top - 24}V{top + height}"
        parts.append(element("path", d=line, class_="want"))
        side, apart = ("end", -5) if x > 0.6 * _WIDTH else ("start", 5)
        wanted = f"wanted: {rate_text(plan.want.rate_bps)}"
        parts.append(_label(wanted, x + apart, top - 28, anchor=side))
    told = f"{people_text(unserved)} without service; " + "; ".join(
        f"{people_text(sum(bar))} with {name} per second"
        for bar, name in zip(bars[1:], names[1:], strict=True)
        if sum(bar)
    )
    return _chart("rates", "How many people have which rate", told, top + height + 36, parts)


def ranges_chart(planned: float, ranges: Sequence[Range]) -> Markup:
    """The share of people served as planned, and where things are otherwise: mean and worst."""
    start = _axis_start(min([planned, *(one.worst for one in ranges)]))
    left, right, top, step = 16, 124, 40, 36
    columns = (_WIDTH - 54, _WIDTH - 2)

    def across(share: float) -> float:
        return left + (share - start) / (1.0 - start) * (_WIDTH - left - right)

    bottom = top + step * len(ranges)
    parts = [
        _label(name, column, top - 16, anchor="end")
        for name, column in zip(("mean", "worst"), columns, strict=True)
    ]
    for tick in np.linspace(start, 1.0, 3).tolist():
        x = across(tick)
        parts.append(element("path", d=f"M{x:.1f} {top}V{bottom}", class_="grid"))
        parts.append(_label(f"{100.0 * tick:g} %", x, bottom + 16))
    x = across(planned)
    parts.append(element("path", d=f"M{x:.1f} {top - 10}V{bottom}", class_="want"))
    parts.append(_label(f"as planned: {share_text(planned)}", x, top - 16, anchor="end"))
    for place, one in enumerate(ranges):
        y = top + step * place + 26
        mean, worst = across(one.mean), across(one.worst)
        parts.append(_label(one.name, left, y - 11, anchor="start", class_="halo"))
        parts.append(_label(one.name, left, y - 11, anchor="start", class_="name"))
        line = f"M{worst:.1f} {y - 5}V{y + 5}M{worst:.1f} {y}H{mean:.1f}"
        parts.append(element("path", d=line, class_="range"))
        parts.append(element("circle", cx=round(mean, 1), cy=y, r=4.5, class_="c-drone"))
        for share, column, class_ in zip(
            (one.mean, one.worst), columns, ("value", "name"), strict=True
        ):
            parts.append(_label(share_text(share), column, y + 4, anchor="end", class_=class_))
    told = f"As planned {share_text(planned)}. " + " ".join(
        f"{one.name}: {share_text(one.mean)}, at worst {share_text(one.worst)}." for one in ranges
    )
    return _chart("ranges", "How many people stay served", told, bottom + 26, parts)


def fleet_chart(points: Sequence[FleetPoint], chosen: int, want: str | None) -> Markup:
    """The shares of people served, and of those with the wanted rate, by the number of drones."""
    left, right, top, height = 52, 84, 22, 150
    lines = [("line-served", "served", [one.served for one in points])]
    above = [one.above_want for one in points if one.above_want is not None]
    if len(above) == len(points):
        lines.append(("line-want", f"{want} or more", above))
    start = _axis_start(min(share for _, _, shares in lines for share in shares))
    room = (_WIDTH - left - right) / max(1, len(points) - 1)

    def height_of(share: float) -> float:
        return top + (1.0 - share) / (1.0 - start) * height

    parts = []
    for tick in np.linspace(start, 1.0, 3).tolist():
        y = height_of(tick)
        parts.append(element("path", d=f"M{left} {y:.1f}H{_WIDTH - right}", class_="grid"))
        parts.append(_label(f"{100.0 * tick:g} %", left - 12, y + 4, anchor="end"))
    for place, one in enumerate(points):
        x, class_ = left + place * room, None
        if one.drones == chosen:
            class_ = "value"
            band = f"M{x:.1f} {top - 6}V{top + height}"
            parts.append(element("path", d=band, class_="band"))
        parts.append(_label(f"{one.drones}", x, top + height + 18, class_=class_))
    middle = left + (_WIDTH - left - right) / 2
    parts.append(_label("number of drones", middle, top + height + 36))
    lowest = -math.inf
    for kind, name, shares in lines:
        places = [(left + place * room, height_of(share)) for place, share in enumerate(shares)]
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
        parts.append(element("path", d=path, class_=kind))
        parts += [
            element("circle", cx=round(x, 1), cy=round(y, 1), r=3.5, class_=kind) for x, y in places
        ]
        lowest = max(places[-1][1], lowest + 30.0)  # names stay apart where lines meet
        for row, text in enumerate(name.split(" or ")):
            label = f"or {text}" if row else text
            y = lowest + 4 + row * _LINE_HEIGHT
            parts.append(
                _label(label, _WIDTH - right + 10, y, anchor="start", class_=f"{kind} value")
            )
    told = " ".join(
        f"{one.drones} drones: {share_text(one.served)} served"
        + ("" if one.above_want is None else f", {share_text(one.above_want)} with {want} or more")
        + "."
        for one in points
    )
    title = "What more or fewer drones would reach"
    return _chart("fleet", title, told, top + height + 44, parts)


def _axis_start(lowest: float) -> float:
    """Where an axis of shares begins: at a tenth that is well below the lowest."""
    return max(0.0, math.floor(10.0 * lowest - 0.5) / 10.0)


def _counted(plan: MappedPlan) -> tuple[list[float], Counts, Counts]:
    """Edges of rates in bit/s, and between each two the people served by drones and by masts."""
    is_served = plan.server != NOBODY
    rates_bps, weights = plan.rates_bps[is_served], plan.people.weights[is_served]
    edges_bps = _edges_bps(rates_bps)
    by_mast = plan.server[is_served] >= len(plan.stations)
    bins = np.clip(np.searchsorted(edges_bps, rates_bps, side="right"), 1, len(edges_bps) - 1) - 1
    drones, masts = (
        np.bincount(bins[who], weights[who], len(edges_bps) - 1).astype(np.int64)
        for who in (~by_mast, by_mast)
    )
    return edges_bps, drones, masts


def _edges_bps(rates_bps: Floats) -> list[float]:
    """1, 2 and 5 times powers of ten, or powers of ten alone, round all rates."""
    if not len(rates_bps):
        return [1e5, 1e6]
    lowest, highest = max(float(rates_bps.min()), 1.0), max(float(rates_bps.max()), 1.0)
    tens = range(math.floor(math.log10(lowest)), math.ceil(math.log10(highest)) + 2)
    for steps in ((1.0, 2.0, 5.0), (1.0,)):
        edges = [step * 10.0**power for power in tens for step in steps]
        first = max(place for place, edge in enumerate(edges) if edge <= lowest)
        last = min(place for place, edge in enumerate(edges) if edge > highest)
        if last - first <= _MOST_BINS or len(steps) == 1:
            break
    edges = edges[first : last + 1]
    return [edges[0], *edges[-_MOST_BINS:]] if len(edges) > _MOST_BINS + 1 else edges


def _bin_names(edges_bps: Sequence[float]) -> list[str]:
    """Such as "200–500 kbit"."""
    names = []
    for low_bps, high_bps in itertools.pairwise(edges_bps):
        unit, size = ("Mbit", 1e6) if high_bps >= 1e6 else ("kbit", 1e3)
        is_wide = high_bps > 20.0 * low_bps  # what is slower than the steps of the chart
        low = "<" if is_wide else f"{low_bps / size:g}–"
        names.append(f"{low}{high_bps / size:g} {unit}")
    return names


def _place_of(rate_bps: float, edges_bps: Sequence[float]) -> float:
    """Where a rate lies between the edges, in bins."""
    return float(np.interp(math.log(rate_bps), np.log(edges_bps), np.arange(len(edges_bps))))


def _bar(x: float, y: float, across: float, tall: float, class_: str) -> Markup:
    return element(
        "rect",
        x=round(x, 1),
        y=round(y, 1),
        width=round(across, 1),
        height=round(tall, 1),
        class_=class_,
    )


def _label(
    text: str, x: float, y: float, anchor: str = "middle", class_: str | None = None
) -> Markup:
    at = {"x": round(x, 1), "y": round(y, 1)}
    return element("text", text, **at, text_anchor=anchor, class_=class_)


def _chart(name: str, title: str, told: str, height: int, parts: Sequence[Markup]) -> Markup:
    return element(
        "svg",
        element("title", title, id=f"{name}-title"),
        element("desc", told, id=f"{name}-desc"),
        *parts,
        viewBox=f"0 0 {_WIDTH} {height}",
        class_="chart",
        role="img",
        aria_labelledby=f"{name}-title {name}-desc",
    )
