"""People as dots: who serves them by colour and form, how fast by how full they are."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.frame import Frame
from orchid_uav.experiments.planning.maps.wording import rate_text
from orchid_uav.experiments.planning.model import Floats

CORES = (0.74, 0.5, 0.0)
"""Size of the hole in the dots of slow, middling and fast people, as a share of the dot."""
_WEIGHTS = (1, 10, 50)
"""From this many people on, a position gets a larger dot."""
_GROWTH = 1.45
"""Of the diameter from one of these sizes to the next."""


class Speeds(NamedTuple):
    """Classes of rates: slow, middling and fast."""

    middling_bps: float
    fast_bps: float

    def classes(self, rates_bps: Floats) -> NDArray[np.int64]:
        """0, 1 or 2 for each rate."""
        return np.searchsorted([self.middling_bps, self.fast_bps], rates_bps, side="right")

    @property
    def texts(self) -> tuple[str, str, str]:
        """What the classes are, in words."""
        middling, fast = rate_text(self.middling_bps), rate_text(self.fast_bps)
        return f"less than {middling}", f"{middling} to {fast}", f"{fast} or more"


def speeds_of(plan: MappedPlan) -> Speeds:
    """Half of the wanted rate and that itself; without one, a round rate above the median."""
    if plan.want is not None:
        return Speeds(plan.want.rate_bps / 2.0, plan.want.rate_bps)
    rates_bps = plan.rates_bps[plan.server != NOBODY]
    middle_bps = float(np.median(rates_bps)) if len(rates_bps) else 1e6
    fast_bps = _next_round_rate_bps(middle_bps)
    return Speeds(fast_bps / 2.0, fast_bps)


def diameter_px(plan: MappedPlan) -> float:
    """Of a dot for one person; the more dots, the smaller."""
    count = len(plan.people.weights)
    return 7.5 if count <= 500 else 5.5 if count <= 3_000 else 3.6


def size_classes(weights: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, … for each weight; the class of the size of its dot."""
    return np.searchsorted(_WEIGHTS, weights, side="right") - 1


def size_texts(plan: MappedPlan) -> dict[int, str]:
    """By class, how many people the dots of that size stand for."""
    texts = {0: "1 to 9 people", 1: "10 to 49 people", 2: "50 people or more"}
    found = sorted(set(size_classes(plan.people.weights).tolist()))
    return {size: texts[size] for size in found}


def grown(size: int) -> float:
    """How much larger a dot of a size class is than one of the first."""
    return float(_GROWTH**size)


def served_people(plan: MappedPlan, frame: Frame, colours: Sequence[int]) -> Markup:
    """Dots of all who are served: round ones for drones, square ones for masts.

    Args:
        plan: the plan.
        frame: the window of the map.
        colours: the number of each drone's colour.
    """
    speeds = speeds_of(plan).classes(plan.rates_bps)
    sizes = size_classes(plan.people.weights)
    units = frame.units(plan.people.positions_m)
    drones, diameter = len(plan.stations), diameter_px(plan)
    groups = []
    for server in np.unique(plan.server[plan.server != NOBODY]):
        layers = []
        for size in np.unique(sizes)[::-1]:  # small dots lie on large ones
            for speed, core in enumerate(CORES):
                here = (plan.server == server) & (sizes == size) & (speeds == speed)
                if not here.any():
                    continue
                dots = _dots(units[here])
                across = diameter * grown(int(size))
                layers.append(_layer(dots, across))
                if core:
                    layers.append(_layer(dots, across * core, class_="core"))
        kind = f"drone h{server} k{colours[server]}" if server < drones else "by-mast"
        groups.append(element("g", *layers, class_=f"dots {kind}"))
    return element("g", *groups, class_="people")


def unserved_people(plan: MappedPlan, frame: Frame) -> Markup:
    """A cross for each position that nobody serves; larger ones for more people."""
    units = frame.units(plan.people.positions_m)
    sizes = size_classes(plan.people.weights)
    lines = []
    for size in np.unique(sizes):
        places = np.unique(units[(plan.server == NOBODY) & (sizes == size)], axis=0)
        if len(places):
            corners = " ".join(f"{east:.0f} {south:.0f}" for east, south in places)
            cross = f"url(#cross-{size})"
            lines.append(
                element(
                    "path",
                    d=Markup(f"M{corners}"),
                    marker_start=cross,
                    marker_mid=cross,
                    marker_end=cross,
                )
            )
    return element("g", *lines, class_="people unserved")


def _dots(places: Floats) -> Markup:
    """A short line at each place; its round or square ends are the dot."""
    data, at = [], (0, 0)
    for east, south in np.unique(places, axis=0).astype(int).tolist():
        step_east, step_south = east - at[0], south - at[1]
        data.append(f"m{step_east}{'' if step_south < 0 else ' '}{step_south}h1")
        at = (east + 1, south)
    return Markup("".join(data))


def _layer(dots: Markup, across_px: float, class_: str | None = None) -> Markup:
    return element(
        "path",
        d=dots,
        class_=class_,
        style=Markup(f"stroke-width:calc(var(--k)*{across_px:.2f}px)"),
    )


def _next_round_rate_bps(rate_bps: float) -> float:
    """The least of 1, 2 and 5 times powers of ten that is above."""
    tens = 10.0 ** math.floor(math.log10(max(rate_bps, 1.0)))
    return next(tens * step for step in (1.0, 2.0, 5.0, 10.0) if tens * step > rate_bps)
