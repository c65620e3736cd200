"""From what was read to a site and its metres."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Mast, People
from orchid_uav.experiments.planning.reading.cells import check_position
from orchid_uav.experiments.planning.reading.nearness import (
    check_nearness_of_place,
    middle_of,
    middle_of_box,
)
from orchid_uav.experiments.planning.reading.places import GivenPlace
from orchid_uav.experiments.planning.reading.table import PeopleTable
from orchid_uav.experiments.planning.reading.zones import Zones
from orchid_uav.experiments.planning.site import MOST_ACROSS_M, Place, Site

Floats = NDArray[np.float64]

_REACH_M = 2 * MOST_ACROSS_M
"""Zones are cut off that far from the middle, where a plane no longer touches the earth."""
_METRES_PER_DEGREE = 111_000.0
_STEP_DEG = 0.009
"""A straight line on a map of degrees, of a kilometre, is straight on the ground within 0.3 m."""
_EXACT_M = 0.1


def locate(
    table: PeopleTable, zones: Sequence[Zones] = (), places: Sequence[GivenPlace] = ()
) -> Site:
    """The site in whose metres a plan is made: its centre is the middle of the people's box.

    Raises:
        InputError: zones and people are not of one kind, no polygon of a file is near to them, or
            a place is impossible or more than 50 km away from them.
    """
    for one in zones:
        if one.on_earth != table.on_earth:
            kinds = ("metres", "degrees")
            raise InputError(
                f"{table.path} has positions in {kinds[table.on_earth]}, and {one.path} in "
                f"{kinds[one.on_earth]}: give both in the same; a GeoJSON is in metres if it says "
                '"units": "m"'
            )
    middle = middle_of(table.coordinates, table.on_earth)
    for place in places:
        try:
            check_position(place.first, place.second, table.on_earth)
        except ValueError as error:
            raise InputError(f"{place.given} does not fit {table.path}: {error}") from error
        check_nearness_of_place(place.given, (place.first, place.second), middle)
    center = Place(*middle_of_box(table.coordinates, table.on_earth))
    site = Site(center if table.on_earth else None)
    for one in zones:
        _check_nearness_of_zones(one, people_of(table, site), site)
    return site


def _check_nearness_of_zones(zones: Zones, people: People, site: Site) -> None:
    middle_m = shapely.box(*_bounds(people.positions_m))
    found = zones_m(zones, site)
    if not found.is_empty and found.distance(middle_m) <= MOST_ACROSS_M:
        return
    swapped = tuple(
        shapely.transform(one, lambda corners: corners[:, ::-1]) for one in zones.polygons
    )
    near_m = zones_m(Zones(zones.path, swapped, zones.on_earth), site)
    because = (
        "; its longitudes and latitudes seem to be swapped"
        if site.center is not None and not near_m.is_empty
        else ""
    )
    raise InputError(
        f"{zones.path} has no polygon within {MOST_ACROSS_M / 1000:.0f} km of the people{because}"
    )


def people_of(table: PeopleTable, site: Site) -> People:
    """The people of a table, in a site's metres."""
    if site.center is None:
        return People(table.coordinates, table.weights)
    return People(site.to_local_m(table.coordinates), table.weights)


def place_m(place: GivenPlace, site: Site) -> tuple[float, float]:
    """East and north in m of a place."""
    if site.center is None:
        return place.first, place.second
    east_m, north_m = site.to_local_m([place.first, place.second])[0].tolist()
    return east_m, north_m


def mast_of(place: GivenPlace, site: Site, default_height_m: float) -> Mast:
    """The mast at a place."""
    height_m = default_height_m if place.height_m is None else place.height_m
    return Mast(*place_m(place, site), height_m)


def zones_m(zones: Zones, site: Site) -> BaseGeometry:
    """The union of zones in a site's metres, up to 100 km from its centre on earth.

    Lines between corners are straight in longitude and latitude, as GeoJSON has it; where that is
    not straight on the ground, corners are added.
    """
    if site.center is None:
        return shapely.union_all(list(zones.polygons))
    parts = [
        part
        for polygon in zones.polygons
        for near in _near(polygon, site.center)
        for part in shapely.get_parts(shapely.make_valid(_projected(near, site)))
        if isinstance(part, Polygon)
    ]
    return shapely.union_all(parts) if parts else Polygon()


def _near(polygon: Polygon, center: Place) -> list[Polygon]:
    """What of a polygon lies within reach, its longitudes within a turn around the centre."""
    south = max(center.latitude_deg - _REACH_M / _METRES_PER_DEGREE, -90.0)
    north = min(center.latitude_deg + _REACH_M / _METRES_PER_DEGREE, 90.0)
    narrowest = np.cos(np.radians(max(abs(south), abs(north))))
    wide_deg = 180.0
    if narrowest * _METRES_PER_DEGREE * 180.0 > _REACH_M:
        wide_deg = _REACH_M / (_METRES_PER_DEGREE * narrowest)
    west, east = center.longitude_deg - wide_deg, center.longitude_deg + wide_deg
    found = []
    for turn in (-720.0, -360.0, 0.0, 360.0, 720.0):
        least, _, most, _ = polygon.bounds
        if least + turn <= east and most + turn >= west:
            turned = shapely.transform(
                polygon, lambda corners, turn=turn: np.add(corners, [turn, 0.0])
            )
            cut = shapely.intersection(turned, shapely.box(west, south, east, north))
            found += [part for part in shapely.get_parts(cut) if isinstance(part, Polygon)]
    return found


def _projected(polygon: Polygon, site: Site) -> BaseGeometry:
    fine = shapely.segmentize(polygon, _STEP_DEG)
    on_ground = shapely.transform(fine, lambda corners: site.to_local_m(corners[:, ::-1]))
    return shapely.simplify(on_ground, _EXACT_M)


def notes_on_area(table: PeopleTable, area: Zones, site: Site) -> list[str]:
    """A note on how many people are outside the area where drones may be: they are still served."""
    points_m = people_of(table, site).positions_m
    inside = shapely.intersects_xy(zones_m(area, site), points_m)
    if inside.all():
        return []
    outside = int(table.weights[~inside].sum())
    return [
        f"{outside:,} of {int(table.weights.sum()):,} people are outside {area.path}: drones stay "
        "inside and serve them from there"
    ]


def notes_on_zones(zones: Zones, site: Site) -> list[str]:
    """A note on polygons that are too far away to matter."""
    far = 0
    if site.center is not None:
        far = sum(not _near(polygon, site.center) for polygon in zones.polygons)
    if not far:
        return []
    return [
        f"{far:,} of {len(zones.polygons):,} polygons of {zones.path} are more than "
        f"{_REACH_M / 1000:.0f} km away and were left out"
    ]


def default_area(people: People, margin_m: float) -> Polygon:
    """The box round all people, wider by a margin on every side."""
    west, south, east, north = _bounds(people.positions_m)
    return shapely.box(west - margin_m, south - margin_m, east + margin_m, north + margin_m)


def _bounds(points_m: Floats) -> tuple[float, float, float, float]:
    west, south = points_m.min(axis=0).tolist()
    east, north = points_m.max(axis=0).tolist()
    return west, south, east, north
