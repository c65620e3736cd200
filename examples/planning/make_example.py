"""Make the files of the worked example: ``python examples/planning/make_example.py``.

The place is real, Basseterre on Saint Kitts, and the zone lies round its airport. Everything else
is made up: nobody was asked where people are, and the zone is not the one that the airport has.
The files are written beside this one, the same whenever they are made.
"""

import csv
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

SEED = 2022
HOUSEHOLDS, MOST_IN_A_HOUSEHOLD = 208, 6
LEAST_IN_A_SHELTER, MOST_IN_A_SHELTER = 20, 80
SHELTERS = (
    *("Church hall", "Clinic", "College", "Community centre", "Cricket ground", "Ferry hall"),
    *("Fire station", "High school", "Library", "Market hall", "Primary school", "Warehouse"),
)
METRES_PER_DEGREE = 111_195.0
WEST, SOUTH, EAST, NORTH = -62.7385, 17.2925, -62.7102, 17.3150
SHORE = 17.2946
"""People are north of it."""


class Quarter(NamedTuple):
    """A part of the town: its middle, how far it reaches, and its share of the people."""

    latitude: float
    longitude: float
    reach_m: float
    share: float


QUARTERS = (
    Quarter(17.2966, -62.7243, 260.0, 0.34),
    Quarter(17.2990, -62.7332, 220.0, 0.22),
    Quarter(17.3052, -62.7300, 240.0, 0.16),
    Quarter(17.2985, -62.7150, 230.0, 0.18),
    Quarter(17.3112, -62.7352, 180.0, 0.10),
)
RUNWAY = ((17.3083, -62.7285), (17.3136, -62.7085))
ZONE_HALF_WIDTH_M = 220.0


def main(folder: Path) -> None:
    """Write the three files into a folder."""
    write_people(folder / "people.csv")
    west_east = [WEST, EAST, EAST, WEST, WEST]
    south_north = [SOUTH, SOUTH, NORTH, NORTH, SOUTH]
    area = list(zip(west_east, south_north, strict=True))
    write_polygon(folder / "area.geojson", "Where drones may be (made up)", area)
    write_polygon(folder / "airport.geojson", "Airport, no drones (made up)", airport())


def write_people(path: Path) -> None:
    """Write a table of shelters and households."""
    chance = np.random.Generator(np.random.PCG64(SEED))
    range_of_shelters = MOST_IN_A_SHELTER - LEAST_IN_A_SHELTER + 1
    rows = []
    for name in SHELTERS:
        people = LEAST_IN_A_SHELTER + int(chance.random() * range_of_shelters)
        rows.append((*somewhere(chance), people, name))
    for number in range(1, HOUSEHOLDS + 1):
        people = 1 + int(chance.random() * MOST_IN_A_HOUSEHOLD)
        rows.append((*somewhere(chance), people, f"Household {number}"))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("lat", "lon", "people", "name"))
        for latitude, longitude, people, name in rows:
            writer.writerow((f"{latitude:.6f}", f"{longitude:.6f}", people, name))


def somewhere(chance: np.random.Generator) -> tuple[float, float]:
    """A latitude and a longitude where people may be: in a quarter, ashore, not on the airport."""
    while True:
        place, turn, distance = chance.random(3).tolist()
        shares = np.cumsum([quarter.share for quarter in QUARTERS])
        quarter = QUARTERS[int(np.searchsorted(shares[:-1], place, side="right"))]
        # Two normal numbers, from uniform ones that are the same with every version of NumPy.
        reach_m = quarter.reach_m * math.sqrt(-2.0 * math.log(1.0 - distance))
        north_m = reach_m * math.sin(2.0 * math.pi * turn)
        east_m = reach_m * math.cos(2.0 * math.pi * turn)
        latitude = quarter.latitude + north_m / METRES_PER_DEGREE
        longitude = quarter.longitude + east_m / east_metres_per_degree()
        ashore = SHORE < latitude < NORTH and WEST < longitude < EAST
        if ashore and from_runway_m(latitude, longitude) > ZONE_HALF_WIDTH_M:
            return latitude, longitude


def from_runway_m(latitude: float, longitude: float) -> float:
    """How far a place lies to the side of the runway's line."""
    ahead_east, ahead_north = direction_of_runway()
    east_m = (longitude - RUNWAY[0][1]) * east_metres_per_degree()
    north_m = (latitude - RUNWAY[0][0]) * METRES_PER_DEGREE
    return abs(ahead_east * north_m - ahead_north * east_m)


def airport() -> list[tuple[float, float]]:
    """The corners of a strip round the runway, counter-clockwise and closed."""
    ahead_east, ahead_north = direction_of_runway()
    corners = []
    for end, side in ((0, -1.0), (1, -1.0), (1, 1.0), (0, 1.0), (0, -1.0)):
        latitude, longitude = RUNWAY[end]
        aside_m = side * ZONE_HALF_WIDTH_M
        corners.append(
            (
                longitude - ahead_north * aside_m / east_metres_per_degree(),
                latitude + ahead_east * aside_m / METRES_PER_DEGREE,
            )
        )
    return corners


def direction_of_runway() -> tuple[float, float]:
    """Its direction to the east and to the north."""
    (south, west), (north, east) = RUNWAY
    east_m = (east - west) * east_metres_per_degree()
    north_m = (north - south) * METRES_PER_DEGREE
    length_m = math.hypot(east_m, north_m)
    return east_m / length_m, north_m / length_m


def east_metres_per_degree() -> float:
    """Metres to the east in a degree of longitude, here."""
    return METRES_PER_DEGREE * math.cos(math.radians((SOUTH + NORTH) / 2))


def write_polygon(path: Path, name: str, corners: list[tuple[float, float]]) -> None:
    """Write a polygon as GeoJSON."""
    ring = [[round(longitude, 6), round(latitude, 6)] for longitude, latitude in corners]
    feature: dict[str, Any] = {
        "type": "Feature",
        "properties": {"name": name},
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }
    document = {"type": "FeatureCollection", "features": [feature]}
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(__file__).parent)
