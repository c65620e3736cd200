"""The part of the report about places: the map, and the tables of drones and masts."""

import math
from typing import Any

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import Markup, element, joined, table
from orchid_uav.experiments.planning.maps.colours import colour_numbers
from orchid_uav.experiments.planning.maps.dots import CORES, grown, size_texts, speeds_of
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.map_svg import (
    CROSS_SHAPE,
    HOME_SHAPE,
    MAST_SHAPE,
    SHAPES,
    map_svg,
    shapes_of,
)
from orchid_uav.experiments.planning.maps.style import LAYERS
from orchid_uav.experiments.planning.maps.wording import (
    clock_text,
    duration_text,
    length_text,
    people_text,
)
from orchid_uav.experiments.planning.result import PlannedDrone


def where_drones_are(plan: MappedPlan) -> list[Markup]:
    """The section of the map and of each drone's place."""
    return [
        element(
            "p",
            "Each number is a drone’s ",
            element("dfn", "station"),
            ": the place that it circles or, if it hovers, where it stays. Each dot stands for "
            "people. It has the colour of the drone that serves them, and is the fuller, the "
            "faster their connection. A cross stands for people whom nobody serves.",
        ),
        _map(plan),
        *_drones(plan),
        *_masts(plan),
    ]


def _map(plan: MappedPlan) -> Markup:
    toggles = []
    for layer, name in LAYERS.items():
        identity = f"show-{layer}"
        box = Markup(f'<input type="checkbox" class="toggle" id="{identity}" checked>')
        toggles += [box, element("label", name, for_=identity)]
    return element(
        "figure",
        element(
            "div",
            *toggles,
            map_svg(plan),
            class_="map-box",
            role="group",
            aria_label="Map, and what it shows",
        ),
        _legend(plan),
        element("figcaption", *_about_the_map(plan)),
        class_="map-figure",
    )


def _about_the_map(plan: MappedPlan) -> list[str]:
    center = plan.surroundings.site.center
    told = ["North is up. Point at a drone, here or in the table, to see its people alone. "]
    screen = [element("span", told[0].partition(". ")[2], class_="on-screen")]
    middle = (
        "Positions are in the metres of the file of people, to the east and to the north."
        if center is None
        else f"The plan’s centre is {_degrees(*center)} (latitude and longitude, WGS 84)."
    )
    return ["North is up. ", *screen, middle]


def _degrees(latitude_deg: float, longitude_deg: float) -> str:
    return f"{latitude_deg:.5f}, {longitude_deg:.5f}"


def _legend(plan: MappedPlan) -> Markup:
    is_there = plan.server != NOBODY
    has_masts = bool((plan.server >= len(plan.stations)).any())
    keys = []
    if is_there.any():
        for core, text in zip(reversed(CORES), reversed(speeds_of(plan).texts), strict=True):
            keys.append((_dot(core), text))
    if has_masts:
        square = element("rect", x=-5, y=-5, width=10, height=10, fill="var(--mast)")
        keys.append((square, "served by a mast (square)"))
    if not is_there.all():
        cross = element("path", d=CROSS_SHAPE, stroke="currentColor", stroke_width=2.4)
        keys.append((cross, "not served by anybody"))
    sizes = size_texts(plan)
    if len(sizes) > 1:
        keys += [(_dot(0.0, 3.75 * grown(size)), text) for size, text in sizes.items()]
    keys.append((element("path", d=SHAPES[0], fill="var(--c0)"), "drone"))
    if any(station.circle_radius_m for station in plan.stations):
        circle = element("circle", r=9, fill="var(--c0)", fill_opacity=0.2, stroke="var(--c0)")
        keys.append((circle, "its circle, to scale"))
    outline = element(
        "rect",
        x=-10,
        y=-7,
        width=20,
        height=14,
        rx=5,
        fill="var(--c0)",
        fill_opacity=0.12,
        stroke="var(--c0)",
        stroke_opacity=0.6,
    )
    keys.append((outline, "round all people of a drone"))
    if plan.ways_m:
        way = element("path", d="M-10 0H10", stroke="var(--c0)", stroke_dasharray="2 3")
        keys.append((way, "way from home"))
    if plan.surroundings.masts:
        keys.append((element("path", d=MAST_SHAPE, fill="currentColor"), "mast"))
    keys.append((element("path", d=HOME_SHAPE, fill="currentColor"), "home: start and landing"))
    if not plan.surroundings.no_fly.is_empty:
        stripes = "M-9 3L3 -9M-9 9L9 -9M-3 9L9 -3"
        zone = element("path", d=stripes, stroke="var(--zone)", stroke_width=1.6)
        frame = element("rect", x=-9, y=-9, width=18, height=18, fill="none", stroke="var(--zone)")
        keys.append((joined([zone, frame]), "no-fly zone"))
    if not plan.surroundings.area.is_empty:
        line = element("path", d="M-10 0H10", stroke="var(--quiet)", stroke_dasharray="7 4")
        keys.append((line, "border of the area of flight"))
    return element(
        "ul", *(element("li", _symbol(drawn), text) for drawn, text in keys), class_="keys"
    )


def _dot(core: float, radius: float = 5.0) -> Markup:
    dot = element("circle", r=radius, fill="var(--c0)")
    hole = element("circle", r=round(radius * core, 2), fill="var(--page)")
    return joined([dot, hole] if core else [dot])


def _symbol(drawn: Markup, class_: str | None = None) -> Markup:
    return element("svg", drawn, viewBox="-12 -12 24 24", aria_hidden="true", class_=class_)


def _drones(plan: MappedPlan) -> list[Markup]:
    document = plan.document
    launches = {launch.get("drone"): launch for launch in document.launches}
    is_on_earth = plan.surroundings.site.center is not None
    has_masts = bool(plan.surroundings.masts)
    colours = colour_numbers(plan.stations)
    heads = ["Drone", "Latitude, longitude"] if is_on_earth else ["Drone", "Metres east, north"]
    heads += ["Altitude above home", "Circle, speed", "People", "Time on station", "Transmits"]
    heads += ["Link to a mast"] if has_masts else []
    heads += ["Start, altitude of the way"] if launches else []
    rows = []
    for index, (drone, shape) in enumerate(zip(document.drones, shapes_of(colours), strict=True)):
        mark = element("path", d=shape, class_=f"k{colours[index]}", fill="var(--c)")
        row = [
            joined([_symbol(mark, "mark"), element("bdi", drone.id)]),
            _degrees(drone.lat, drone.lon)
            if drone.lat is not None and drone.lon is not None
            else f"{drone.east_m:,.0f}, {drone.north_m:,.0f}",
            length_text(drone.altitude_m),
            _circle(drone),
            f"{drone.people:,}",
            duration_text(60.0 * drone.endurance_minutes),
            f"{drone.transmit_power_w:.3g} W",
        ]
        row += [_link(plan, drone)] if has_masts else []
        row += [_launch(launches.get(drone.id))] if launches else []
        rows.append(row)
    classes = [f"point h{index}" for index in range(len(rows))]
    told = [
        "The altitude is above home, the place of start and landing; there is no terrain in this "
        "plan. The time on station is what one battery allows, the ways there and back and a "
        "reserve taken off."
    ]
    if has_masts:
        told.append(
            "The link to a mast (its backhaul) connects a drone to the rest of the world. It is "
            "told as signal-to-noise ratio at the worst point of the circle, in decibel (dB): 3 dB "
            "more is twice as strong. After it comes the distance to the nearest mast."
        )
        needed_db = document.settings.get("channel.backhaul_required_snr_db")
        if needed_db is not None:
            told.append(f"At least {needed_db:g} dB are needed.")
    else:
        told.append(
            "There is no mast in this plan: how the drones are connected to the rest of the world, "
            "by satellite for example, is not part of it."
        )
    if launches:
        told.append("Starts are told in minutes and seconds after the first.")
    caption = "The drones and their stations"
    return [table(caption, heads, rows, classes), element("p", " ".join(told), class_="quiet")]


def _circle(drone: PlannedDrone) -> str:
    if not drone.circle_radius_m:
        return "hovers"
    return f"{length_text(drone.circle_radius_m)} radius, {drone.speed_mps:.3g} m/s"


def _link(plan: MappedPlan, drone: PlannedDrone) -> str:
    told = "–" if drone.backhaul_snr_db is None else f"{drone.backhaul_snr_db:.1f} dB"
    nearest_m = min(
        math.hypot(mast.east_m - drone.east_m, mast.north_m - drone.north_m)
        for mast in plan.surroundings.masts
    )
    return f"{told}, {length_text(nearest_m)}"


def _launch(launch: dict[str, Any] | None) -> str:
    if launch is None:
        return "–"
    return f"{clock_text(launch['after_s'])}, {length_text(launch['way_altitude_m'])}"


def _masts(plan: MappedPlan) -> list[Markup]:
    surroundings, drones = plan.surroundings, len(plan.stations)
    if not surroundings.masts:
        return []
    is_on_earth = surroundings.site.center is not None
    rows = []
    for index, mast in enumerate(surroundings.masts):
        place_m = (mast.east_m, mast.north_m)
        place = (
            _degrees(*surroundings.site.to_places(place_m)[0])
            if is_on_earth
            else f"{mast.east_m:,.0f}, {mast.north_m:,.0f}"
        )
        people = people_text(plan.served_by(drones + index))
        rows.append([plan.servers[drones + index], place, length_text(mast.height_m), people])
    heads = ["Mast", "Latitude, longitude" if is_on_earth else "Metres east, north"]
    return [table("The masts on the ground that still work", [*heads, "Height", "Serves"], rows)]
