"""The map of a plan as inline SVG, which needs no tiles and no program."""

import math
import re
from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.planning.maps.colours import colour_numbers
from orchid_uav.experiments.planning.maps.dots import (
    diameter_px,
    grown,
    served_people,
    size_texts,
    unserved_people,
)
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.frame import WIDTH, Frame, frame_of, round_length_m
from orchid_uav.experiments.planning.maps.on_earth import circle_m, polygons_of
from orchid_uav.experiments.planning.maps.wording import (
    length_text,
    number_text,
    people_text,
    rate_text,
)
from orchid_uav.experiments.planning.model import Floats, Station

SHAPES = (
    "M-9 0a9 9 0 1 1 18 0a9 9 0 1 1-18 0z",  # circle
    "M-8.5-8.5h17v17h-17z",  # square
    "M0-12L12 0L0 12L-12 0z",  # diamond
    "M-6-10H6L12 0L6 10H-6L-12 0z",  # hexagon
    "M0-11L11-3L7 10H-7L-11-3z",  # pentagon
)
"""Forms of the marks of drones, in pixels: another one each time that a colour comes again."""
MAST_SHAPE = (
    "M-1.3-4H1.3L6.5 12H3.6L2.6 8.4H-2.6L-3.6 12H-6.5zM0 0.6L-1.7 5.9H1.7z"
    "M0-9.2a2.4 2.4 0 1 1-.1 0z"
    "M-5.6-11.2l-1.7-1.3a8.6 8.6 0 0 0 0 11.3l1.7-1.3a6.5 6.5 0 0 1 0-8.7z"
    "M5.6-11.2l1.7-1.3a8.6 8.6 0 0 1 0 11.3l-1.7-1.3a6.5 6.5 0 0 0 0-8.7z"
)
HOME_SHAPE = "M0-9L10 0H7V8H2V2H-2V8H-7V0H-10z"
CROSS_SHAPE = "M-4.2-4.2L4.2 4.2M-4.2 4.2L4.2-4.2"
_MANY_DRONES = 30
"""With more drones than these their marks are smaller."""
_HATCH_PX = 7
_BESIDE_UNITS = 250.0
"""If home is nearer to a mast than this, its mark is drawn at the side of the mast's."""


def map_svg(plan: MappedPlan) -> Markup:
    """The map; its styles are in the page's style sheet."""
    frame = frame_of(plan)
    colours = colour_numbers(plan.stations)
    return element(
        "svg",
        element("title", "Map of the plan", id="map-title"),
        element("desc", _described(plan), id="map-desc"),
        _definitions(plan),
        element("rect", class_="ground", width=WIDTH, height=frame.height),
        _zones(plan, frame),
        _cells(plan, frame, colours),
        _circles(plan, frame, colours),
        _ways(plan, frame, colours),
        served_people(plan, frame, colours),
        unserved_people(plan, frame),
        _closed_border(plan, frame),
        _masts_and_home(plan, frame),
        _stations(plan, frame, colours),
        _scale_bar(frame),
        _north_arrow(),
        viewBox=Markup(f"0 0 {WIDTH} {frame.height}"),
        class_="map",
        role="img",
        aria_labelledby="map-title map-desc",
    )


def shapes_of(colours: Sequence[int]) -> list[str]:
    """The form of the mark of each drone, by the number of its colour."""
    return [
        SHAPES[list(colours[:place]).count(colour) % len(SHAPES)]
        for place, colour in enumerate(colours)
    ]


def label_of(station: Station, index: int) -> str:
    """The number at the end of a drone's name, else its place."""
    found = re.search(r"[0-9]{1,4}$", station.name)
    return found.group() if found else str(index)


def _described(plan: MappedPlan) -> str:
    unserved = plan.served_by(NOBODY)
    return (
        f"{number_text(len(plan.stations), 'drone', 'drones')}, the people whom each serves, "
        f"{number_text(len(plan.surroundings.masts), 'mast', 'masts')}, and crosses for the "
        f"{people_text(unserved)} whom nobody serves. The tables below give the same in numbers."
    )


def _definitions(plan: MappedPlan) -> Markup:
    crosses = [
        element(
            "marker",
            element(
                "g",
                element("path", d=CROSS_SHAPE, class_="halo"),
                element("path", d=CROSS_SHAPE),
                class_="scaled",
                style=Markup(f"--size:{grown(size) * diameter_px(plan) / 7.5:.3f}"),
            ),
            id=f"cross-{size}",
            markerUnits="userSpaceOnUse",
            class_="cross",
        )
        for size in size_texts(plan)
    ]
    hatch = element(
        "pattern",
        element("path", d=f"M0 0V{_HATCH_PX}"),
        id="hatch",
        class_="hatch",
        width=_HATCH_PX,
        height=_HATCH_PX,
        patternUnits="userSpaceOnUse",
        patternTransform="scale(10) rotate(45)",
    )
    return element("defs", hatch, *crosses)


def _zones(plan: MappedPlan, frame: Frame) -> Markup:
    surroundings = plan.surroundings
    parts = []
    if not surroundings.area.is_empty:
        border = shapely.intersection(surroundings.area.boundary, frame.window_m)
        parts.append(element("path", d=_lines(frame, border), class_="area"))
    closed = shapely.intersection(surroundings.no_fly, frame.window_m)
    if not closed.is_empty:
        outline = _outlines(frame, closed)
        zone = element("title", "No-fly zone")
        parts.append(element("g", zone, element("path", d=outline), class_="no-fly"))
    return element("g", *parts)


def _closed_border(plan: MappedPlan, frame: Frame) -> Markup:
    """The border of no-fly zones once more, which many people would hide."""
    closed = shapely.intersection(plan.surroundings.no_fly.boundary, frame.window_m)
    return element("path", d=_lines(frame, closed), class_="no-fly-border")


def _cells(plan: MappedPlan, frame: Frame, colours: Sequence[int]) -> Markup:
    """The outline of the people of each drone."""
    room_m = 8.0 * WIDTH / 1000.0 / frame.units_per_m
    cells = []
    for index, colour in enumerate(colours):
        own_m = plan.people.positions_m[plan.server == index]
        if len(own_m):
            hull = shapely.buffer(shapely.convex_hull(shapely.MultiPoint(own_m)), room_m)
            outline = _outlines(frame, hull)
            cells.append(element("path", d=outline, class_=f"drone h{index} k{colour}"))
    return element("g", *cells, class_="cells")


def _circles(plan: MappedPlan, frame: Frame, colours: Sequence[int]) -> Markup:
    return element(
        "g",
        *(
            element(
                "path",
                d=_outlines(frame, shapely.Polygon(circle_m(station))),
                class_=f"drone h{index} k{colours[index]}",
            )
            for index, station in enumerate(plan.stations)
            if station.circle_radius_m > 0.0
        ),
        class_="circles",
    )


def _ways(plan: MappedPlan, frame: Frame, colours: Sequence[int]) -> Markup:
    return element(
        "g",
        *(
            element(
                "path",
                d=_path(frame.units(way_m[:, :2])),
                class_=f"drone h{index} k{colours[index]}",
            )
            for index, way_m in enumerate(plan.ways_m)
        ),
        class_="ways",
    )


def _masts_and_home(plan: MappedPlan, frame: Frame) -> Markup:
    drones, surroundings = len(plan.stations), plan.surroundings
    masts = surroundings.masts
    marks = []
    for index, mast in enumerate(masts):
        told = f"{plan.servers[drones + index]}: {people_text(plan.served_by(drones + index))}"
        place_m = (mast.east_m, mast.north_m)
        parts = _haloed(MAST_SHAPE)
        marks.append(_mark(frame, place_m, told, parts, class_="mast", size=1.25))
    home_m = surroundings.home_m
    apart_m = [math.hypot(mast.east_m - home_m[0], mast.north_m - home_m[1]) for mast in masts]
    is_beside = any(one_m * frame.units_per_m < _BESIDE_UNITS for one_m in apart_m)
    home = element("g", *_haloed(HOME_SHAPE), transform="translate(-21 4)" if is_beside else None)
    return element("g", *marks, _mark(frame, home_m, "Home", [home], class_="home"))


def _stations(plan: MappedPlan, frame: Frame, colours: Sequence[int]) -> Markup:
    size = 1.0 if len(colours) <= _MANY_DRONES else 0.8
    marks = []
    for index, (station, shape) in enumerate(zip(plan.stations, shapes_of(colours), strict=True)):
        drone = plan.document.drones[index]
        rates_bps = plan.rates_bps[plan.server == index]
        slowest = f", the slowest with {rate_text(rates_bps.min())}" if len(rates_bps) else ""
        told = (
            f"{station.name}: {people_text(drone.people)}{slowest}; "
            f"{length_text(station.altitude_m)} above home"
        )
        parts = [
            element("path", d=shape, class_="pin"),
            element("text", label_of(station, index), dy="0.36em"),
        ]
        place_m = (station.east_m, station.north_m)
        kind = f"station point drone h{index} k{colours[index]}"
        marks.append(_mark(frame, place_m, told, parts, class_=kind, size=size))
    return element("g", *marks)


def _mark(
    frame: Frame,
    place_m: tuple[float, float],
    told: str,
    parts: Iterable[Markup],
    class_: str,
    size: float = 1.0,
) -> Markup:
    """Something that has the same size on every screen."""
    east, south = frame.units(np.array([place_m]))[0]
    scaled = element("g", *parts, class_="scaled", style=Markup(f"--size:{size:g}"))
    at = f"translate({east:.0f} {south:.0f})"
    return element("g", element("title", told), scaled, transform=at, class_=class_)


def _haloed(shape: str) -> list[Markup]:
    return [element("path", d=shape, class_="halo"), element("path", d=shape)]


def _scale_bar(frame: Frame) -> Markup:
    across_m = WIDTH / frame.units_per_m
    length_m = round_length_m(across_m / 4.0)
    length = length_m * frame.units_per_m
    text = element(
        "g",
        element("text", length_text(length_m), y=-5, class_="halo"),
        element("text", length_text(length_m), y=-5),
        class_="scaled",
    )
    line = f"M0-60V0H{length:.0f}V-60"
    bar = [element("path", d=line, class_="halo"), element("path", d=line)]
    at = f"translate(250 {frame.height - 250})"
    return element("g", *bar, text, transform=at, class_="scale-bar")


def _north_arrow() -> Markup:
    arrow = "M0 0L6 18L0 14L-6 18z"
    parts = [
        element("path", d=arrow, class_="halo"),
        element("path", d=arrow),
        element("text", "N", y=31, class_="halo"),
        element("text", "N", y=31),
    ]
    inner = element("g", *parts, class_="scaled")
    return element("g", inner, transform=f"translate({WIDTH - 450} 200)", class_="north")


def _outlines(frame: Frame, shape: BaseGeometry) -> Markup:
    """Path data of the polygons of a shape, holes included."""
    rings = [ring for part in polygons_of(shape) for ring in (part.exterior, *part.interiors)]
    data = [_path(frame.units(np.array(ring.coords)[:-1, :2])) + "z" for ring in rings]
    return Markup("".join(data))


def _lines(frame: Frame, shape: BaseGeometry) -> Markup:
    whole = shapely.line_merge(shape)
    parts = [
        part
        for part in shapely.get_parts(whole)
        if part.geom_type in ("LineString", "LinearRing") and not part.is_empty
    ]
    return Markup("".join(_path(frame.units(np.array(part.coords)[:, :2])) for part in parts))


def _path(units: Floats) -> Markup:
    corners = [f"{east:.0f} {south:.0f}" for east, south in units]
    return Markup("M" + "L".join(corners))
