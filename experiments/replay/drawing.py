"""Draws single slots of a replay: a map for each flight, and the metrics below.

What stays is drawn once; the rest is drawn over it for each picture, so that a picture takes some
hundredths of a second, and animations change only where something moves.
"""

import math
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from orchid_uav.experiments.figures.style import STYLE, limits_of, line_styles, set_ticks
from orchid_uav.experiments.planning.maps.colours import MAST, ON_WHITE, UNSERVED
from orchid_uav.experiments.planning.maps.wording import clock_text, length_text
from orchid_uav.experiments.replay.document import UNSERVED as NOBODY
from orchid_uav.experiments.replay.document import ReplayMetric
from orchid_uav.experiments.replay.scene import Scene, SceneFlight

Pixels = NDArray[np.uint8]
"""(height, width, 3)."""

DPI = 100
CURVES = 3
"""Metrics below the maps, at most."""
TRAIL_SLOTS = 60
_GROUND, _LINE, _QUIET, _ALARM = "#F6F6F3", "#777777", "#5A6169", "#C00000"
_TITLE_IN, _LEGEND_IN, _CURVES_IN, _MARGIN_IN = 0.62, 0.3, 1.5, 0.12
_NUMBERS_IN = 0.2
_PERSON_PT2, _LARGEST_PERSON = 20.0, 6.0
"""Area of a person's mark, and how much larger one is at most that stands for many."""
_LEAST_ASPECT, _GREATEST_ASPECT = 0.4, 1.6
"""Height over width of a map; areas that are longer get empty margins."""


class Painter:
    """Draws slots of one replay.

    Args:
        scene: the replay.
        width_px: of the pictures.
    """

    def __init__(self, scene: Scene, width_px: int) -> None:
        self.scene = scene
        with style.context(["default", STYLE]), _without_glyph_warnings():
            width_in = max(width_px / DPI, 4.0)
            self._scale = width_px / (DPI * width_in)
            self._figure = Figure((width_in, 1.0), dpi=DPI * self._scale, facecolor="white")
            self._canvas = FigureCanvasAgg(self._figure)
            self._lay_out(width_in)
            self._canvas.draw()
            self._background = self._canvas.copy_from_bbox(self._figure.bbox)

    def paint(self, slot: int) -> Pixels:
        """The picture of one slot, from 0 to the replay's last."""
        with style.context(["default", STYLE]), _without_glyph_warnings():
            self._canvas.restore_region(self._background)
            for part in self._parts:
                for artist in part.moved_to(slot):
                    self._figure.draw_artist(artist)
            return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()

    def _lay_out(self, width_in: float) -> None:
        document = self.scene.document
        count = len(self.scene.flights)
        map_in = (width_in - (count + 1) * _MARGIN_IN) / count
        east_m, north_m = document.area_m
        aspect = min(max(north_m / east_m, _LEAST_ASPECT), _GREATEST_ASPECT)
        if count == 1:  # not higher than wide, so that it fits on a slide
            aspect = min(aspect, 0.8)
        shown = document.metrics[:CURVES]
        are_curves = any(_changes(flight, one) for flight in self.scene.flights for one in shown)
        curves_in = _CURVES_IN if are_curves else _NUMBERS_IN
        map_height_in = map_in * aspect
        titles_in = _TITLE_IN + 0.26
        height_in = titles_in + map_height_in + _LEGEND_IN + curves_in + _MARGIN_IN
        # Encoders of pictures want even sides.
        dots = 2.0 / self._figure.dpi
        height_in = math.ceil(height_in / dots) * dots
        self._figure.set_size_inches(width_in, height_in)

        def box(left: float, top: float, width: float, height: float) -> Any:
            low = (height_in - top - height) / height_in
            return left / width_in, low, width / width_in, height / height_in

        self._parts: list[_Part] = [self._heading(width_in, height_in)]
        colours = _colours(self.scene.flights)
        for number, flight in enumerate(self.scene.flights):
            left = _MARGIN_IN + number * (map_in + _MARGIN_IN)
            axes = self._figure.add_axes(box(left, titles_in, map_in, map_height_in))
            label = _shortened(flight.label, 12.0 * map_in)
            axes.set_title(label, fontsize=9, weight="bold", pad=4)
            self._parts.append(_Map(axes, self.scene, flight))
            if are_curves and count > 1:  # which map is whose curve
                axes.spines["top"].set(color=colours[number], linewidth=3.0)
        top = titles_in + map_height_in
        self._legend(0.5, 1.0 - (top + _LEGEND_IN / 2.0) / height_in)
        if not are_curves:
            line = 0.5 * (_NUMBERS_IN + _MARGIN_IN) / height_in
            self._figure.text(0.5, line, self._numbers(), fontsize=8, ha="center", va="center")
            return
        left_in, gap_in = 0.5, 0.55
        panel_in = (width_in - left_in - _MARGIN_IN - gap_in * (len(shown) - 1)) / len(shown)
        for number, metric in enumerate(shown):
            left = left_in + number * (panel_in + gap_in)
            area = box(left, top + _LEGEND_IN + 0.42, panel_in, curves_in - 0.8)
            axes = self._figure.add_axes(area)
            self._parts.append(_Curves(axes, self.scene, metric, colours))

    def _heading(self, width_in: float, height_in: float) -> "_Heading":
        document, left = self.scene.document, _MARGIN_IN / width_in
        line = 1.0 - 0.24 / height_in
        title = _shortened(document.title, 10.0 * (width_in - 1.2))
        self._figure.text(left, line, title, fontsize=11, weight="bold", va="center")
        line = 1.0 - 0.48 / height_in
        subtitle = _shortened(document.subtitle, 15.0 * width_in)
        self._figure.text(left, line, subtitle, fontsize=8, color=_QUIET, va="center")
        clock = self._figure.text(
            1.0 - left, 1.0 - 0.24 / height_in, "", fontsize=11, va="center", ha="right"
        )
        return _Heading(clock, document.slot_s)

    def _numbers(self) -> str:
        """Metrics that do not change, of the first flight."""
        metrics = self.scene.flights[0].metrics
        return "   ".join(
            f"{one.label} {metrics[one.key][0]:.{one.digits}f} {one.unit}".strip()
            for one in self.scene.document.metrics
        )

    def _legend(self, x: float, y: float) -> None:
        look: dict[str, Any] = {"linestyle": "", "markersize": 5.5}
        entries = [Line2D([], [], marker="o", color=ON_WHITE[0], label="served by a drone", **look)]
        if self.scene.document.masts:
            entries.append(Line2D([], [], marker="s", color=MAST, label="served by a mast", **look))
        entries.append(Line2D([], [], marker="x", color=UNSERVED, label="not served", **look))
        ring: dict[str, Any] = {
            "markerfacecolor": "none",
            "markeredgecolor": _ALARM,
            "markeredgewidth": 1.6,
            "markersize": 9,
        }
        label = "worst off" if self.scene.targets.all() else "worst off of the drones' people"
        entries.append(Line2D([], [], marker="o", label=label, **(look | ring)))
        self._figure.legend(
            handles=entries,
            loc="center",
            bbox_to_anchor=(x, y),
            ncols=len(entries),
            handletextpad=0.1,
            handlelength=1.6,
        )


class _Part:
    """A part of the picture that changes from slot to slot."""

    def moved_to(self, slot: int) -> Iterator[Artist]:
        """The artists to draw, as they are in this slot."""
        raise NotImplementedError


class _Heading(_Part):
    def __init__(self, clock: Any, slot_s: float) -> None:
        self._clock, self._slot_s = clock, slot_s
        clock.set_animated(True)

    def moved_to(self, slot: int) -> Iterator[Artist]:
        self._clock.set_text(f"{clock_text(slot * self._slot_s)} min")
        yield self._clock


class _Map(_Part):
    """The map of one flight."""

    def __init__(self, axes: Axes, scene: Scene, flight: SceneFlight) -> None:
        self._scene, self._flight = scene, flight
        document = scene.document
        east_m, north_m = document.area_m
        axes.set(xlim=(0.0, east_m), ylim=(0.0, north_m), aspect="equal", xticks=[], yticks=[])
        axes.set_facecolor(_GROUND)
        axes.grid(visible=False)
        for spine in axes.spines.values():
            spine.set(visible=True, color=_LINE, linewidth=0.8)
        _draw_scale(axes, east_m, north_m)
        for mast in document.masts:
            axes.plot(*mast.position_m[:2], "^", ms=9, color=MAST, mec="white", zorder=6)
        drones = flight.drones_m.shape[1]
        self._colours = [ON_WHITE[index % len(ON_WHITE)] for index in range(drones)]
        # Somebody at the border is not cut through.
        still: dict[str, Any] = {"animated": True, "clip_on": False}
        self._links = LineCollection([], linewidths=0.6, alpha=0.3, zorder=2, **still)
        self._trails = LineCollection(
            [], colors=self._colours, linewidths=1.2, alpha=0.45, zorder=3, **still
        )
        self._circles = LineCollection(
            [], colors=self._colours, linewidths=0.7, linestyles="dotted", zorder=3, **still
        )
        for collection in (self._links, self._trails, self._circles):
            axes.add_collection(collection, autolim=False)
        kinds: tuple[tuple[str, dict[str, Any]], ...] = (
            ("o", {"edgecolors": "white", "linewidths": 0.4}),
            ("s", {"color": MAST, "edgecolors": "white", "linewidths": 0.4}),
            ("x", {"color": UNSERVED, "linewidths": 1.0}),
        )
        self._people = [
            axes.scatter([], [], marker=marker, zorder=4, **look, **still) for marker, look in kinds
        ]
        (self._worst,) = axes.plot(
            [], [], "o", ms=11, mfc="none", mec=_ALARM, mew=1.6, zorder=5, **still
        )
        self._drones = axes.scatter([], [], s=95, zorder=7, linewidths=1.6, **still)
        self._names = [
            axes.text(
                0.0,
                0.0,
                str(index),
                fontsize=7,
                weight="bold",
                ha="center",
                va="center_baseline",
                zorder=8,
                **still,
            )
            for index in range(drones)
        ]
        weights = scene.document.users.weights
        sizes = np.ones(scene.users_m.shape[1]) if weights is None else np.sqrt(weights)
        self._sizes = np.minimum(sizes, _LARGEST_PERSON)
        turn = np.linspace(0.0, 2.0 * np.pi, 49)
        self._circle_m = flight.radius_m * np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def moved_to(self, slot: int) -> Iterator[Artist]:
        flight = self._flight
        users_m, server = self._scene.users_m[slot], flight.association[slot]
        drones_m = flight.drones_m[slot, :, :2]
        of_drone, alone = server >= 0, server == NOBODY
        colours = np.array(self._colours)[server[of_drone]]
        self._links.set_segments(
            np.stack([drones_m[server[of_drone]], users_m[of_drone]], axis=1)  # type: ignore[arg-type]
        )
        self._links.set_color(colours.tolist())
        yield self._links
        since = max(0, slot - TRAIL_SLOTS)
        self._trails.set_segments(
            flight.drones_m[since : slot + 1, :, :2].transpose(1, 0, 2)  # type: ignore[arg-type]
        )
        yield self._trails
        if flight.stations_m is not None:
            self._circles.set_segments(flight.stations_m[slot][:, None] + self._circle_m)
            yield self._circles
        self._people[0].set_facecolor(colours.tolist())
        for people, chosen in zip(self._people, (of_drone, ~of_drone & ~alone, alone), strict=True):
            people.set_offsets(users_m[chosen])
            people.set_sizes(_PERSON_PT2 * self._sizes[chosen])
            yield people
        worst = flight.worst_off(slot, users_m, self._scene.targets)
        if worst is not None:
            self._worst.set_data(*users_m[worst][:, None])
            yield self._worst
        is_out = flight.powers_w[slot] == 0.0
        self._drones.set_offsets(drones_m)
        self._drones.set_facecolor(np.where(is_out, "#BBBBBB", "white").tolist())
        self._drones.set_edgecolor(np.where(is_out, _LINE, self._colours).tolist())
        yield self._drones
        for name, place_m in zip(self._names, drones_m, strict=True):
            name.set_position(place_m)
            yield name


class _Curves(_Part):
    """A metric of all flights over time."""

    def __init__(
        self, axes: Axes, scene: Scene, metric: ReplayMetric, colours: Sequence[str]
    ) -> None:
        self._scene, self._metric = scene, metric
        slot_s = scene.document.slot_s
        self._times_s = slot_s * np.arange(1, scene.slots + 1)
        unit = f" ({metric.unit})" if metric.unit else ""
        axes.set_title(f"{metric.label}{unit}", loc="left", fontsize=8, pad=14)
        self._values = [flight.metrics[metric.key] for flight in scene.flights]
        self._lines = []
        for number, (values, colour) in enumerate(zip(self._values, colours, strict=True)):
            axes.plot(self._times_s, values, color=colour, lw=0.8, alpha=0.25)
            (line,) = axes.plot([], [], color=colour, lw=1.3, animated=True)
            text = axes.text(
                0.25 * number,
                1.02,
                "",
                transform=axes.transAxes,
                va="bottom",
                fontsize=8,
                weight="bold",
                color=colour,
                animated=True,
            )
            self._lines.append((line, text))
        finite = [float(v) for values in self._values for v in values if math.isfinite(v)]
        low, high = (min(finite), max(finite)) if finite else (math.nan, math.nan)
        axes.set_ylim(*limits_of(metric.key, low, high, axes.get_ylim()))
        axes.set_xlim(0.0, max(slot_s * scene.slots, 1e-9))
        for axis in (axes.xaxis, axes.yaxis):
            set_ticks(axis)
        axes.locator_params(axis="y", nbins=4)
        axes.set_xlabel("s", labelpad=1, fontsize=7)
        self._cursor = axes.axvline(0.0, color=_LINE, lw=0.8, animated=True)

    def moved_to(self, slot: int) -> Iterator[Artist]:
        self._cursor.set_xdata([slot * self._scene.document.slot_s] * 2)
        yield self._cursor
        for (line, text), values in zip(self._lines, self._values, strict=True):
            line.set_data(self._times_s[:slot], values[:slot])
            text.set_text(f"{values[slot - 1]:.{self._metric.digits}f}" if slot else "")
            yield line
            yield text


def _shortened(text: str, characters: float) -> str:
    longest = max(int(characters), 2)
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def _changes(flight: SceneFlight, metric: ReplayMetric) -> bool:
    values = flight.metrics[metric.key]
    return bool((values != values[0]).any())


def _colours(flights: Sequence[SceneFlight]) -> list[str]:
    """The colour of each flight's curves, also where two methods have the same."""
    looks = line_styles([flight.label for flight in flights])
    found = [looks[flight.label]["color"] for flight in flights]
    return found if len(set(found)) == len(found) else [ON_WHITE[0], ON_WHITE[5]][: len(found)]


def _draw_scale(axes: Axes, east_m: float, north_m: float) -> None:
    """A bar of a round length in the map's lower left corner."""
    power = 10.0 ** math.floor(math.log10(0.3 * east_m))
    length_m = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= 0.3 * east_m)
    left_m, low_m = 0.03 * east_m, 0.03 * north_m
    axes.plot([left_m, left_m + length_m], [low_m, low_m], color="black", lw=1.5, zorder=9)
    text = {"fontsize": 7, "ha": "center", "va": "bottom", "zorder": 9}
    axes.text(left_m + length_m / 2.0, low_m + 0.012 * north_m, length_text(length_m), **text)  # type: ignore[arg-type]


def _without_glyph_warnings() -> Any:
    """Titles may have characters that no font here has: they are drawn as boxes."""
    return warnings.catch_warnings(action="ignore", category=UserWarning)
