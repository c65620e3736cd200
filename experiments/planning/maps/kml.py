"""A plan as KML 2.2, for Google Earth, ATAK and GIS programs."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

import numpy as np
import shapely

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import harmless
from orchid_uav.experiments.planning.maps.colours import (
    HOME,
    MAST,
    UNSERVED,
    ZONE,
    colours_on_white,
)
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.on_earth import (
    Ring,
    circle_m,
    lines_on_earth,
    point_on_earth,
    points_on_earth,
    polygons_on_earth,
)
from orchid_uav.experiments.planning.maps.wording import (
    duration_text,
    length_text,
    people_text,
    rate_text,
)
from orchid_uav.experiments.planning.result import PlannedDrone

_NAMESPACE = "http://www.opengis.net/kml/2.2"
_ABOUT = (
    "A plan by orchid plan. Altitudes are above home. They are written as above the ground, which "
    "is the same where the ground is as high as home."
)
_IN_THE_AIR, _ON_THE_GROUND = "relativeToGround", "clampToGround"


def plan_kml(plan: MappedPlan) -> bytes:
    """The whole plan; the same plan gives the same bytes.

    Raises:
        ValueError: the site has no place on earth.
    """
    root = ET.Element("kml", {"xmlns": _NAMESPACE})
    document = ET.SubElement(root, "Document")
    _text(document, "name", "Plan of " + people_text(plan.document.people.total))
    _text(document, "description", _ABOUT)
    _styles(document, plan)
    _stations(_folder(document, "Stations"), plan)
    _circles(_folder(document, "Circles"), plan)
    _people(_folder(document, "People"), plan)
    _masts_and_home(_folder(document, "Masts and home"), plan)
    _zones(_folder(document, "Zones"), plan)
    _ways(_folder(document, "Ways"), plan)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _styles(document: ET.Element, plan: MappedPlan) -> None:
    for index, colour in enumerate(colours_on_white(plan.stations)):
        _style(document, f"drone_{index}", colour, icon_scale=1.1)
        _style(document, f"person_{index}", colour, icon_scale=0.4)
    _style(document, "mast", MAST, icon_scale=1.1)
    _style(document, "mast_person", MAST, icon_scale=0.4)
    _style(document, "unserved", UNSERVED, icon_scale=0.4)
    _style(document, "home", HOME, icon_scale=1.1)
    _style(document, "area", HOME, icon_scale=1.0, fill_opacity=0.0)
    _style(document, "no_fly", ZONE, icon_scale=1.0)


def _style(
    document: ET.Element, name: str, colour: str, icon_scale: float, fill_opacity: float = 0.15
) -> None:
    style = ET.SubElement(document, "Style", {"id": name})
    icon = ET.SubElement(style, "IconStyle")
    _text(icon, "color", _abgr(colour, 1.0))
    _text(icon, "scale", f"{icon_scale:g}")
    line = ET.SubElement(style, "LineStyle")
    _text(line, "color", _abgr(colour, 1.0))
    _text(line, "width", "2")
    _text(ET.SubElement(style, "PolyStyle"), "color", _abgr(colour, fill_opacity))


def _abgr(colour: str, opacity: float) -> str:
    """KML's order of #RRGGBB."""
    red, green, blue = colour[1:3], colour[3:5], colour[5:7]
    return f"{round(255 * opacity):02x}{blue}{green}{red}".lower()


def _stations(folder: ET.Element, plan: MappedPlan) -> None:
    site = plan.surroundings.site
    for index, drone in enumerate(plan.document.drones):
        placemark = _placemark(folder, drone.id, f"drone_{index}", _told(drone))
        place = [*point_on_earth(site, drone.east_m, drone.north_m), drone.altitude_m]
        _point(placemark, place, _IN_THE_AIR)


def _told(drone: PlannedDrone) -> str:
    circle = (
        f"circles with {length_text(drone.circle_radius_m)} radius at {drone.speed_mps:g} m/s"
        if drone.circle_radius_m
        else "hovers"
    )
    return (
        f"{people_text(drone.people)}; {length_text(drone.altitude_m)} above home; {circle}; "
        f"transmits with {drone.transmit_power_w:g} W; "
        f"on station for {duration_text(60.0 * drone.endurance_minutes)}"
    )


def _circles(folder: ET.Element, plan: MappedPlan) -> None:
    for index, station in enumerate(plan.stations):
        if station.circle_radius_m == 0.0:
            continue
        polygons = polygons_on_earth(plan.surroundings.site, shapely.Polygon(circle_m(station)))
        placemark = _placemark(folder, station.name, f"drone_{index}")
        _polygons(placemark, polygons, station.altitude_m, _IN_THE_AIR)


def _people(folder: ET.Element, plan: MappedPlan) -> None:
    points = points_on_earth(plan.surroundings.site, plan.people.positions_m)
    drones = len(plan.stations)
    for server, name in [*enumerate(plan.servers), (NOBODY, "not served")]:
        places = np.flatnonzero(plan.server == server)
        if not len(places):
            continue
        own = _folder(folder, name)
        style = f"person_{server}" if server < drones else "mast_person"
        for place in places:
            told = people_text(int(plan.people.weights[place]))
            if server == NOBODY:
                style = "unserved"
            else:
                told += f", {rate_text(float(plan.rates_bps[place]))} each"
            _point(_placemark(own, None, style, told), points[place], _ON_THE_GROUND)


def _masts_and_home(folder: ET.Element, plan: MappedPlan) -> None:
    surroundings, drones = plan.surroundings, len(plan.stations)
    for index, mast in enumerate(surroundings.masts):
        told = f"{length_text(mast.height_m)} high; {people_text(plan.served_by(drones + index))}"
        placemark = _placemark(folder, plan.servers[drones + index], "mast", told)
        place = [*point_on_earth(surroundings.site, mast.east_m, mast.north_m), mast.height_m]
        _point(placemark, place, _IN_THE_AIR)
    home = point_on_earth(surroundings.site, *surroundings.home_m)
    _point(_placemark(folder, "home", "home"), home, _ON_THE_GROUND)


def _zones(folder: ET.Element, plan: MappedPlan) -> None:
    surroundings = plan.surroundings
    for name, style, shape in (
        ("area of flight", "area", surroundings.area),
        ("no-fly zones", "no_fly", surroundings.no_fly),
    ):
        polygons = polygons_on_earth(surroundings.site, shape)
        if polygons:
            _polygons(_placemark(folder, name, style), polygons, 0.0, _ON_THE_GROUND)


def _ways(folder: ET.Element, plan: MappedPlan) -> None:
    for index, way_m in enumerate(plan.ways_m):
        lines = lines_on_earth(plan.surroundings.site, way_m)
        if not lines:
            continue
        placemark = _placemark(folder, plan.stations[index].name, f"drone_{index}")
        parent = ET.SubElement(placemark, "MultiGeometry") if len(lines) > 1 else placemark
        for line in lines:
            element = ET.SubElement(parent, "LineString")
            _text(element, "altitudeMode", _IN_THE_AIR)
            _coordinates(element, line)


def _folder(parent: ET.Element, name: str) -> ET.Element:
    folder = ET.SubElement(parent, "Folder")
    _text(folder, "name", name)
    return folder


def _placemark(parent: ET.Element, name: str | None, style: str, told: str = "") -> ET.Element:
    placemark = ET.SubElement(parent, "Placemark")
    if name is not None:
        _text(placemark, "name", name)
    if told:
        _text(placemark, "description", told)
    _text(placemark, "styleUrl", f"#{style}")
    return placemark


def _point(placemark: ET.Element, place: Sequence[float], mode: str) -> None:
    point = ET.SubElement(placemark, "Point")
    _text(point, "altitudeMode", mode)
    _coordinates(point, [list(place)])


def _polygons(
    placemark: ET.Element, polygons: list[list[Ring]], altitude_m: float, mode: str
) -> None:
    parent = ET.SubElement(placemark, "MultiGeometry") if len(polygons) > 1 else placemark
    for outline, *holes in polygons:
        polygon = ET.SubElement(parent, "Polygon")
        _text(polygon, "altitudeMode", mode)
        for kind, ring in [("outer", outline), *(("inner", hole) for hole in holes)]:
            boundary = ET.SubElement(polygon, f"{kind}BoundaryIs")
            linear_ring = ET.SubElement(boundary, "LinearRing")
            _coordinates(linear_ring, [[*point, altitude_m] for point in ring])


def _coordinates(parent: ET.Element, points: Ring) -> None:
    """Longitude, latitude and altitude of each; 0 m for points without."""
    triples = [(*point, 0.0)[:3] for point in points]
    tuples = (f"{east:.7f},{north:.7f},{up_m:.2f}" for east, north, up_m in triples)
    ET.SubElement(parent, "coordinates").text = " ".join(tuples)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = harmless(text)
