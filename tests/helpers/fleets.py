"""Stations and their surroundings, for tests of missions."""

from typing import Any

import numpy as np
import shapely

from orchid_uav.experiments.planning.missions.fence import Fence, fence_of
from orchid_uav.experiments.planning.missions.fleet import FleetMissions, plan_missions
from orchid_uav.experiments.planning.missions.items import Firmware
from orchid_uav.experiments.planning.missions.transit import Transit, plan_transit
from orchid_uav.experiments.planning.model import Station, Surroundings
from orchid_uav.experiments.planning.site import Place, Site

UTUADO = Place(18.2655, -66.7005)
CRUISE_MPS = 12.0
LONGEST_S = 1500.0


def surroundings_of(across_m: float = 2400.0, **fields: Any) -> Surroundings:
    """A square, home near its southern edge, 80 to 120 m, no zones."""
    half_m = across_m / 2.0
    known: dict[str, Any] = {
        "site": Site(UTUADO),
        "area": shapely.box(-half_m, -half_m, half_m, half_m),
        "no_fly": shapely.Polygon(),
        "masts": (),
        "home_m": (0.0, -0.8 * half_m),
        "home_height_amsl_m": 150.0,
        "lowest_m": 80.0,
        "highest_m": 120.0,
        "clearance_m": 50.0,
    }
    return Surroundings(**known | fields)


def station_at(
    east_m: float,
    north_m: float,
    altitude_m: float = 100.0,
    *,
    name: str = "uav_0",
    radius_m: float = 48.0,
) -> Station:
    """A drone that circles, or hovers if the radius is 0."""
    return Station(name, east_m, north_m, altitude_m, 1.0, radius_m, 11.5 if radius_m else 0.0)


def stations_in(
    surroundings: Surroundings, drones: int, *, radius_m: float = 48.0, seed: int = 0
) -> list[Station]:
    """Up to so many stations, whose circles lie where they may, as far apart as they must."""
    generator = np.random.default_rng(seed)
    outwards_m = (radius_m + 0.05) / np.cos(np.pi / 64.0)
    allowed = surroundings.area.buffer(-outwards_m, 16)
    allowed = allowed.difference(surroundings.no_fly.buffer(outwards_m, 16))
    west, south, east, north = surroundings.area.bounds
    stations: list[Station] = []
    apart_m = 2.0 * radius_m + surroundings.clearance_m
    for _ in range(60 * drones):
        place = generator.uniform((west, south), (east, north))
        free = all(
            np.hypot(one.east_m - place[0], one.north_m - place[1]) > apart_m for one in stations
        )
        if free and len(stations) < drones and allowed.contains(shapely.Point(place)):
            altitude_m = float(generator.uniform(surroundings.lowest_m, surroundings.highest_m))
            name = f"uav_{len(stations)}"
            stations.append(
                station_at(*map(float, place), altitude_m, name=name, radius_m=radius_m)
            )
    return stations


def planned(
    firmware: Firmware,
    surroundings: Surroundings,
    stations: list[Station],
    longest_s: float = LONGEST_S,
) -> tuple[Transit, Fence, FleetMissions]:
    """Ways, fence and missions."""
    transit = plan_transit(surroundings, stations, CRUISE_MPS)
    fence = fence_of(surroundings, transit)
    fleet = plan_missions(
        firmware, surroundings, stations, transit, fence, [longest_s] * len(stations)
    )
    return transit, fence, fleet
