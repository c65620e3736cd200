"""A plan as GeoJSON (RFC 7946), with colours that maps read (simplestyle).

Altitudes are above home, which no third coordinate could say: they are properties.
"""

from typing import Any

import shapely

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.maps.colours import HOME, MAST, UNSERVED, colours_on_white
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.on_earth import (
    circle_m,
    lines_on_earth,
    point_on_earth,
    points_on_earth,
    polygons_on_earth,
)

Feature = dict[str, Any]


def stations_geojson(plan: MappedPlan) -> dict[str, Any]:
    """Stations, their circles, the ways there, masts and home.

    The property ``kind`` of a feature is ``station``, ``circle``, ``way``, ``mast`` or ``home``.

    Raises:
        ValueError: the site has no place on earth.
    """
    return _collection([*_stations(plan), *_circles(plan), *_ways(plan), *_grounded(plan)])


def people_geojson(plan: MappedPlan) -> dict[str, Any]:
    """Each position of people: how many they are, who serves them and how fast.

    Raises:
        ValueError: the site has no place on earth.
    """
    names, drones = plan.servers, len(plan.stations)
    colours = [*colours_on_white(plan.stations), *(MAST for _ in plan.surroundings.masts)]
    points = points_on_earth(plan.surroundings.site, plan.people.positions_m)
    features = []
    for place, point in enumerate(points):
        server = int(plan.server[place])
        is_served = server != NOBODY
        properties = {
            "people": int(plan.people.weights[place]),
            "served_by": names[server] if is_served else None,
            "served_by_kind": ("drone" if server < drones else "mast") if is_served else None,
            "rate_bps": round(float(plan.rates_bps[place])),
            "marker-color": colours[server] if is_served else UNSERVED,
            "marker-size": "small",
        }
        features.append(_feature("Point", point, properties))
    return _collection(features)


def _stations(plan: MappedPlan) -> list[Feature]:
    site = plan.surroundings.site
    return [
        _feature(
            "Point",
            point_on_earth(site, drone.east_m, drone.north_m),
            {
                "kind": "station",
                "id": drone.id,
                "altitude_above_home_m": drone.altitude_m,
                "transmit_power_w": drone.transmit_power_w,
                "circle_radius_m": drone.circle_radius_m,
                "speed_mps": drone.speed_mps,
                "people": drone.people,
                "endurance_minutes": drone.endurance_minutes,
                "backhaul_snr_db": drone.backhaul_snr_db,
                "marker-color": colour,
            },
        )
        for drone, colour in zip(plan.document.drones, colours_on_white(plan.stations), strict=True)
    ]


def _circles(plan: MappedPlan) -> list[Feature]:
    features = []
    for station, colour in zip(plan.stations, colours_on_white(plan.stations), strict=True):
        if station.circle_radius_m == 0.0:
            continue
        shape = shapely.Polygon(circle_m(station))
        polygons = polygons_on_earth(plan.surroundings.site, shape)
        properties = {
            "kind": "circle",
            "id": station.name,
            "altitude_above_home_m": station.altitude_m,
            "stroke": colour,
            "fill": colour,
            "fill-opacity": 0.15,
        }
        features.append(_one_or_several("Polygon", polygons, properties))
    return features


def _ways(plan: MappedPlan) -> list[Feature]:
    features = []
    colours = colours_on_white(plan.stations)
    drawn = zip(plan.stations, colours, plan.ways_m, strict=True) if plan.ways_m else ()
    for station, colour, way_m in drawn:
        lines = lines_on_earth(plan.surroundings.site, way_m[:, :2])
        if not lines:
            continue  # straight up
        properties = {
            "kind": "way",
            "id": station.name,
            "highest_above_home_m": round(float(way_m[:, 2].max()), 2),
            "stroke": colour,
            "stroke-width": 1,
        }
        features.append(_one_or_several("LineString", lines, properties))
    return features


def _grounded(plan: MappedPlan) -> list[Feature]:
    surroundings = plan.surroundings
    names = plan.servers[len(plan.stations) :]
    features = [
        _feature(
            "Point",
            point_on_earth(surroundings.site, mast.east_m, mast.north_m),
            {
                "kind": "mast",
                "id": name,
                "height_m": mast.height_m,
                "people": plan.served_by(len(plan.stations) + index),
                "marker-color": MAST,
            },
        )
        for index, (mast, name) in enumerate(zip(surroundings.masts, names, strict=True))
    ]
    home = point_on_earth(surroundings.site, *surroundings.home_m)
    return [*features, _feature("Point", home, {"kind": "home", "marker-color": HOME})]


def _one_or_several(kind: str, parts: list[Any], properties: dict[str, Any]) -> Feature:
    if len(parts) == 1:
        return _feature(kind, parts[0], properties)
    return _feature(f"Multi{kind}", parts, properties)


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> Feature:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _collection(features: list[Feature]) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": features}
