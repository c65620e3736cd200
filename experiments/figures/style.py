"""The style of all figures: sizes for a paper, type, axes, and the look of every method."""

import hashlib
import itertools
import math
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, SubFigure
from matplotlib.textpath import TextPath
from matplotlib.ticker import FuncFormatter, MaxNLocator, ScalarFormatter
from matplotlib.transforms import ScaledTranslation, Transform

from orchid_uav.experiments.metrics import HEADROOM, METRICS, UNBREAKABLE

COLUMN_IN, PAGE_IN = 3.5, 7.16
"""Widths of a column and of a page of an IEEE paper, in inches."""
SHIFT_PT = 4.0
"""Sideways distance between the markers of curves that lie on each other, in points."""

# Okabe and Ito's colours and grey, without yellow, which is too faint for lines.
_BLUE, _SKY, _VERMILLION, _ORANGE = "#0072B2", "#56B4E9", "#D55E00", "#E69F00"
_GREEN, _PURPLE, _BLACK, _GREY = "#009E73", "#CC79A7", "#000000", "#7F7F7F"
_SOLID, _DASHED, _LONG = (0, ()), (0, (4, 1.5)), (0, (8, 2))
_DOT, _TWO_DOTS = (0, (5, 1.5, 1, 1.5)), (0, (5, 1.5, 1, 1.5, 1, 1.5))
_TWO_DASHES, _SPARSE = (0, (4, 1.5, 4, 1.5, 1, 1.5)), (0, (1.5, 2.5))
_THREE_DOTS, _SHORT = (0, (5, 1.5, 1, 1.5, 1, 1.5, 1, 1.5)), (0, (2.5, 1))
_LONG_DOT, _LONG_SHORT = (0, (10, 2, 2, 2)), (0, (10, 2, 4, 2))
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
    "orchid-tuned": (_BLACK, (8, 1, 0), _SPARSE),
    "orchid-informed": (_GREEN, (12, 1, 0), _LONG_SHORT),
    "orchid-distilled": (_BLUE, (9, 1, 0), _LONG_DOT),
    "maddpg-pf-paper": (_SKY, (5, 1, 180), _THREE_DOTS),
    "maddpg-mmf-paper": (_VERMILLION, (3, 1, 180), _SHORT),
    "orchid-long": (_BLUE, (4, 1, 0), _LONG),
    "orchid-uniform": (_PURPLE, (6, 0, 0), _SOLID),
    "orchid-no-rf-uniform": (_BLACK, (8, 0, 0), _LONG),
}
_RULES: dict[str, _Look] = {
    "static-pf": (_BLACK, "X", _SPARSE),
    "static-mmf": (_GREY, "P", _DASHED),
    "static-mmf-uniform": (_GREY, "P", _DASHED),
    "static-pf-full-power": (_SKY, "X", _TWO_DOTS),
    "static-mmf-full-power": (_ORANGE, "P", _TWO_DASHES),
    "loiter-mmf": (_VERMILLION, "<", _LONG),
    "loiter-pf": (_PURPLE, ">", _DOT),
    "balanced-loiter": (_SKY, "h", _DASHED),
    "balanced-loiter-retargeted": (_PURPLE, "h", _TWO_DOTS),
    "track": (_GREEN, "d", _SPARSE),
    "planner": (_ORANGE, "*", _LONG),
    "planner-retargeted": (_VERMILLION, "*", _DOT),
    "track-120": (_GREEN, (7, 1, 0), _LONG),
    "balanced-loiter-120": (_GREY, (5, 0, 180), _LONG),
    "balanced-loiter-120-sensed": (_GREY, (5, 0, 180), _DOT),
    "forces": (_PURPLE, (7, 0, 0), _TWO_DASHES),
    "forces-sensed": (_PURPLE, (7, 0, 0), _SHORT),
    "best-response": (_VERMILLION, (6, 1, 30), _SOLID),
    "best-response-sensed": (_VERMILLION, (6, 1, 30), _SHORT),
    "receding-horizon": (_BLACK, (4, 1, 45), _DASHED),
    "receding-horizon-sensed": (_BLACK, (4, 1, 45), _SHORT),
}
_VARIANTS: dict[str, _Look] = {"base": _LEARNED["orchid"], "no-rf": _LEARNED["orchid-no-rf"]}
"""The names of these two in an ablation."""
_KNOWN = _LEARNED | _RULES | _VARIANTS
_HOLLOW = ("-zero", "-full-power", "-retargeted", "-sensed")
# Without the colours of an ablation's base and of its variant without resets.
_RUN_COLOURS = (_PURPLE, _GREEN, _VERMILLION, _ORANGE, _GREY, _BLACK)
_RUN_MARKERS = ((4, 1, 0), (6, 1, 0), "8", (3, 1, 0), "H")
_RUN_LINES = (_SOLID, _LONG, _DASHED, _DOT, _TWO_DOTS, _TWO_DASHES)

# Metrics that are shares of a whole, and metrics that may be below zero.
_SHARES = {"coverage", "total_coverage", "rate_jfi", "load_jfi", "gbs_coverage"}
_SIGNED = {"utility", HEADROOM, "reward"}

STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
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


def base_of(label: str) -> str:
    """The method of a label, without the marks of a twin and of sampled actions."""
    return label.removesuffix(", sampled").removesuffix("-zero")


def is_rule(label: str) -> bool:
    """Whether a method is a rule, for which nothing was learned."""
    return base_of(label) in _RULES


def line_styles(labels: Iterable[str]) -> dict[str, dict[str, Any]]:
    """The line style of each method.

    A built-in method always looks the same, whatever else is drawn. The look of a run comes from a
    digest of its name, so that it usually stays the same as well. If two runs of a figure would
    share a colour, a marker or a line, the later one by name takes another.
    """
    labels = list(labels)
    known = _KNOWN | _looks_of_runs({base_of(label) for label in labels} - set(_KNOWN))
    return {label: _drawn_as(label, *known[base_of(label)]) for label in labels}


def _looks_of_runs(names: set[str]) -> dict[str, _Look]:
    """For each run the least used look that is nearest to the one its name's digest gives."""
    choices: tuple[Sequence[Any], ...] = (_RUN_COLOURS, _RUN_MARKERS, _RUN_LINES)
    looks = list(itertools.product(*(range(len(choice)) for choice in choices)))
    uses: Counter[tuple[Any, ...]] = Counter()
    found: dict[str, _Look] = {}
    for name in sorted(names):
        digest = hashlib.sha256(name.encode("utf-8", "surrogateescape")).digest()
        costs = {}
        for look in looks:
            steps = [(at - digest[place]) % len(choices[place]) for place, at in enumerate(look)]
            costs[look] = (*(uses[trait] for trait in _traits(look)), *steps)
        look = min(looks, key=costs.__getitem__)
        uses.update(_traits(look))
        colour, marker, line = (choice[at] for choice, at in zip(choices, look, strict=True))
        found[name] = (colour, marker, line)
    return found


def _traits(look: tuple[int, ...]) -> list[tuple[Any, ...]]:
    """Traits that two runs should not share, the most important first."""
    colour, marker, line = look
    return [look, ("both", colour, marker), ("colour", colour), ("marker", marker), ("line", line)]


def _drawn_as(label: str, colour: str, marker: Any, line: Any) -> dict[str, Any]:
    look = {"color": colour, "marker": marker, "linestyle": line}
    look["zorder"] = 2.0 if line == _SOLID else 2.1  # its gaps show the solid lines below
    if marker == "*" or isinstance(marker, tuple):  # stars have a small area
        look["markersize"] = 6.5
    if label.endswith(_HOLLOW):
        look["markerfacecolor"] = "white"
    if label.endswith("-zero"):
        look["linestyle"] = _TWIN_LINE
    if label.endswith(", sampled"):
        look |= {"linestyle": _SAMPLED_LINE, "markerfacecolor": "#D0D0D0"}
    return look


def clusters(labels: Iterable[str], alike: Callable[[str, str], bool]) -> list[list[str]]:
    """Group labels: each joins the first group whose first label it is like."""
    found: list[list[str]] = []
    for label in labels:
        for cluster in found:
            if alike(cluster[0], label):
                cluster.append(label)
                break
        else:
            found.append([label])
    return found


def identity_marks(
    identical: Mapping[str, Sequence[Sequence[str]]],
) -> tuple[dict[str, str], list[str]]:
    """What legend and footnote say about identical curves.

    Args:
        identical: for each panel, the labels, in clusters of identical curves.

    Returns:
        The legend's marks, by label, of curves that are identical to others in all panels; and the
        sentences of the footnote.
    """
    panels: dict[tuple[str, ...], list[str]] = {}
    for panel, found in identical.items():
        for cluster in found:
            if len(cluster) > 1:
                panels.setdefault(tuple(cluster), []).append(panel)
    marks: dict[str, str] = {}
    sentences = []
    for cluster, where in panels.items():
        names = ", ".join(cluster)
        if len(where) == len(identical):
            mark = f"[{len(set(marks.values())) + 1}]"
            marks |= dict.fromkeys(cluster, mark)
            sentences.append(f"{mark} Identical curves: {names}.")
        else:
            sentences.append(f"Identical in {_which(where, identical)}: {names}.")
    return marks, sentences


def _which(panels: Sequence[str], of: Iterable[str]) -> str:
    """Name some of all panels by listing them or, if that is shorter, all the others.

    Semicolons separate the titles, which may contain commas.
    """
    others = [panel for panel in of if panel not in panels]
    if len(others) < len(panels):
        return f"all panels but {'; '.join(others)}"
    return f"{'; '.join(panels)} alone"


def shifted(axes: Axes, turn: int, count: int, step_pt: float = SHIFT_PT) -> Transform:
    """The transform of data, moved sideways for one of several curves that lie on each other."""
    shift_in = (turn - (count - 1) / 2) * step_pt / 72
    assert isinstance(axes.figure, Figure | SubFigure)
    return axes.transData + ScaledTranslation(shift_in, 0.0, axes.figure.dpi_scale_trans)


def thicker_pt(turn: int, count: int) -> float:
    """Extra width, in points, that keeps such a curve visible below those drawn after it."""
    return min(1.4, 4.2 / max(1, count - 1)) * (count - 1 - turn)


def bounds_of(metric: str) -> tuple[float, float]:
    """The least and the greatest stored value that a metric can have."""
    return -math.inf if metric in _SIGNED else 0.0, 1.0 if metric in _SHARES else math.inf


def limits_of(
    name: str, low: float, high: float, limits: tuple[float, float]
) -> tuple[float, float]:
    """Limits of an axis of values, which do not magnify differences that do not matter.

    Differences too small to show in a table do not fill the axis, and impossible values get no more
    room than a marker takes.

    Args:
        name: a name in ``METRICS``, or another column of a run's episodes.
        low: the least value shown, scaled.
        high: the greatest value shown, scaled.
        limits: the limits that matplotlib would choose.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return limits
    described = METRICS.get(name)
    middle = (low + high) / 2
    unseen = 10.0**-described.digits if described else 1e-6 * abs(middle)
    if high - low <= unseen:
        half = max(0.05 * abs(middle), 5 * unseen) or 0.5
        limits = middle - half, middle + half
    if described is None:
        return limits
    margin = 0.03 * (limits[1] - limits[0])
    least, greatest = (bound * described.scale for bound in bounds_of(name))
    return (
        max(limits[0], min(least, low) - margin),
        min(limits[1], max(greatest, high) + margin),
    )


def set_ticks(axis: Axis) -> None:
    """Set a few ticks with complete numbers, without an offset or a factor above the axis."""
    axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
    greatest = max(map(abs, axis.get_view_interval()))
    if 1e-3 <= greatest < 1e7:
        formatter = ScalarFormatter(useOffset=False)
        formatter.set_scientific(False)
        axis.set_major_formatter(formatter)
    else:
        axis.set_major_formatter(
            FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}"))
        )


def setting_text(values: Mapping[str, Any]) -> str:
    """A setting, as far as it is known, as text for a title; no line break divides its parts.

    Args:
        values: those of "uavs", "users", "distribution", "speed_mps" and "heading_hold_s" that are
            known.
    """
    parts = []
    if "uavs" in values:
        parts.append(f"{values['uavs']} UAV" + "s" * (values["uavs"] != 1))
    kind = values.get("distribution", "")
    users = [
        *([str(values["users"])] if "users" in values else []),
        *([{"tcp": "clustered"}.get(kind, kind)] if kind else []),
        "user" if values.get("users") == 1 else "users",
    ]
    speed_mps = values.get("speed_mps")
    if len(users) > 1 or speed_mps == 0:
        parts.append(" ".join([*users, *(["at rest"] if speed_mps == 0 else [])]))
    if speed_mps:
        parts.append(f"up to {speed_mps:g} m/s")
    if "heading_hold_s" in values and speed_mps != 0:
        parts.append(f"heading held for {values['heading_hold_s']:g} s")
    return ", ".join(part.replace(" ", UNBREAKABLE) for part in parts)


def setting_of(configurations: Iterable[Mapping[str, Any]]) -> str:
    """The setting that configurations, by "section.key", have in common, for a title."""
    keys = {
        "uavs": "network.uav_count",
        "users": "network.user_count",
        "distribution": "network.distribution",
        "speed_mps": "network.user_speed_mps",
        "heading_hold_s": "network.heading_hold_s",
    }
    settings = [{name: one[key] for name, key in keys.items()} for one in configurations]
    shared = {
        name: value
        for name, value in settings[0].items()
        if all(other[name] == value for other in settings)
    }
    return setting_text(shared)


def width_of(text: str) -> float:
    """Width of a text in a legend's size of type, in inches."""
    return TextPath((0, 0), text, size=7).get_extents().width / 72


def wrap(text: str, width_in: float, points: float = 8) -> str:
    """Break a text into lines of a width in inches, in type of ``points`` points."""
    width = max(1, int(120 * width_in / points))
    wrapped = textwrap.fill(text, width, break_long_words=False, break_on_hyphens=False)
    return wrapped.replace(UNBREAKABLE, " ")


def legend_shape(labels: Sequence[str], width_in: float) -> tuple[int, int]:
    """The lines and columns of a legend, with as few lines as fit the width."""
    widths_in = [0.55 + width_of(label) for label in labels]
    for lines in range(1, len(labels)):
        columns = math.ceil(len(labels) / lines)
        # This is how matplotlib fills columns.
        if sum(map(max, np.array_split(widths_in, columns))) <= width_in:
            return lines, columns
    return len(labels), 1
