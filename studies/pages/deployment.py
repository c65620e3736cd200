"""The picture of a deployment, from the committed flight."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.pages.markdown import FIGURES
from studies.recording import read

PICTURE = FIGURES / "deployment.png"
NAME = "deployment"
WIDTH_PX, HEIGHT_PX, DPI = 1600, 960, 200
"""Drawn to be shown 700 to 800 px wide, at twice that resolution."""

# Okabe and Ito's colours without yellow, with a shape for each, so nobody needs to see the colour.
LOOKS = (
    *(("#0072B2", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#CC79A7", "D"), ("#E69F00", "v")),
    *(("#56B4E9", "P"),),
)
GROUND, NOBODY = "#000000", "#8A8A8A"
_TEXT = {"fontsize": 9, "va": "center"}


def draw_deployment(path: Path = PICTURE) -> Path:
    """Draw a map with a legend beside it."""
    from matplotlib import style
    from matplotlib.figure import Figure

    document = read(NAME)
    with style.context("default"):
        figure = Figure((WIDTH_PX / DPI, HEIGHT_PX / DPI))
        area_km = document["area_m"] / 1000.0
        height = 0.86
        width = height * HEIGHT_PX / WIDTH_PX
        plan = figure.add_axes((0.065, 0.115, width, height))
        _draw_map(plan, document)
        plan.set(xlim=(0.0, area_km), ylim=(0.0, area_km), aspect="equal")
        _draw_scale(plan, area_km)
        legend = figure.add_axes((0.065 + width + 0.03, 0.115, 1.0 - width - 0.105, height))
        _draw_legend(legend, document)
        figure.savefig(path, dpi=DPI, facecolor="white")
    return path


def _draw_scale(axes: Any, area_km: float) -> None:
    ticks = [0.0, area_km / 2.0, area_km]
    labels = [f"{tick * 1000.0:,.0f} m" for tick in ticks]
    axes.set_xticks(ticks, labels, fontsize=8.5)
    axes.set_yticks(ticks, labels, fontsize=8.5, rotation=90)
    ends = (("left", "bottom"), ("center", "center"), ("right", "top"))  # stay within the map
    for along, up, (horizontal, vertical) in zip(
        axes.get_xticklabels(), axes.get_yticklabels(), ends, strict=True
    ):
        along.set_horizontalalignment(horizontal)
        up.set_verticalalignment(vertical)
    axes.set_facecolor("#F6F6F3")
    axes.tick_params(length=3, color="#777777")
    for side in axes.spines.values():
        side.set(color="#777777", linewidth=0.8)


def _draw_map(axes: Any, document: Mapping[str, Any]) -> None:
    from matplotlib.patches import Circle

    for uav, place in enumerate(document["uavs"]):
        colour, shape = LOOKS[uav]
        users = [user for user in document["users"] if user["uav"] == uav]
        here = _km(place["position_m"])
        for user in users:
            there = _km(user["position_m"])
            axes.plot(*zip(here, there, strict=True), color=colour, lw=0.7, alpha=0.45, zorder=1)
        _people(axes, users, shape, colour, colour)
        radius_km = document["circle_radius_m"] / 1000.0
        centre = _km(place["centre_m"])
        axes.add_patch(Circle(centre, radius_km, fill=False, color=colour, lw=1.0, zorder=4))
        _drone(axes, here, uav)
    ours = [user for user in document["users"] if not user["is_target"]]
    _people(axes, [user for user in ours if user["rate_bps"] > 0.0], "x", GROUND, GROUND)
    _people(axes, [user for user in document["users"] if _is_alone(user)], "o", "none", NOBODY)
    _station(axes, _km(document["gbs_position_m"]))


def _draw_legend(axes: Any, document: Mapping[str, Any]) -> None:
    users = document["users"]
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.axis("off")
    count = len(document["uavs"])
    flown = sum(user["uav"] >= 0 for user in users)
    title = f"{count} drones serve {flown} of {len(users)} people"
    axes.text(0.0, 0.97, title, **(_TEXT | {"fontsize": 10.5}), weight="bold")
    axes.text(0.16, 0.89, "serves", **_TEXT, color="#444444")
    axes.text(0.46, 0.89, "each of them gets", **_TEXT, color="#444444")
    rows = [0.82 - 0.075 * row for row in range(count + 2)]
    for uav, y in enumerate(rows[:count]):
        served = [user for user in users if user["uav"] == uav]
        colour, shape = LOOKS[uav]
        _drone(axes, (0.04, y), uav)
        axes.plot(0.13, y, shape, color=colour, ms=5.5, mec="white", mew=0.4)
        axes.text(0.18, y, f"{len(served)} people", **_TEXT)
        axes.text(0.46, y, _rates(served), **_TEXT)
    y = rows[count]
    served = [user for user in users if not user["is_target"] and user["rate_bps"] > 0.0]
    _station(axes, (0.04, y))
    axes.plot(0.13, y, "x", color=GROUND, ms=5)
    axes.text(0.18, y, f"{len(served)} people", **_TEXT)
    axes.text(0.46, y, _rates(served), **_TEXT)
    alone = sum(map(_is_alone, users))
    y = rows[count + 1]
    axes.plot(0.13, y, "o", mfc="none", mec=NOBODY, ms=5)
    axes.text(0.18, y, f"{alone} people", **_TEXT)
    axes.text(0.46, y, "not reached", **_TEXT)
    lines = (
        "The triangle is the ground station. It is left",
        "with the group of people around it. A drone",
        "divides its radio band so that all of its people",
        "get the same rate. Simulated.",
    )
    for number, line in enumerate(lines):
        axes.text(0.0, 0.19 - 0.055 * number, line, **_TEXT, color="#444444")


def _rates(served: Sequence[Mapping[str, Any]]) -> str:
    rates = sorted(user["rate_bps"] / 1e6 for user in served)
    low, high = f"{rates[0]:.1f}", f"{rates[-1]:.1f}"
    return f"{low} Mbit/s" if low == high else f"{low} to {high} Mbit/s"


def _is_alone(user: Mapping[str, Any]) -> bool:
    return user["rate_bps"] == 0.0


def _people(
    axes: Any, users: Sequence[Mapping[str, Any]], shape: str, face: str, edge: str
) -> None:
    points = [_km(user["position_m"]) for user in users]
    look: dict[str, Any] = {"mfc": face, "mec": "white", "mew": 0.5}
    if shape == "x" or face == "none":
        look = {"mfc": face, "mec": edge, "mew": 1.1}
    axes.plot(*zip(*points, strict=True), shape, ls="", ms=5, clip_on=False, **look)


def _drone(axes: Any, point: tuple[float, float], uav: int) -> None:
    colour = LOOKS[uav][0]
    axes.plot(*point, "o", ms=12, mfc="white", mec=colour, mew=1.8, zorder=5)
    axes.text(
        *point, str(uav + 1), fontsize=8, weight="bold", ha="center", va="center_baseline", zorder=6
    )


def _station(axes: Any, point: tuple[float, float]) -> None:
    axes.plot(*point, "^", ms=12, color=GROUND, mec="white", zorder=5)


def _km(position_m: Sequence[float]) -> tuple[float, float]:
    return position_m[0] / 1000.0, position_m[1] / 1000.0
