"""Places for stations that are far enough apart, near those that are wanted (M38)."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Corner = tuple[float, float]

_ROUNDS = 200
_ROOM = 1.0 + 1e-9
"""Stations are put apart a little more than is wanted, so that rounding leaves them so."""
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


def spread_out(
    wanted_m: Floats, spacing_m: float, low_m: Corner | Floats, high_m: Corner | Floats
) -> Floats:
    """Places (N, 2) at least ``spacing_m`` apart, each near the one wanted.

    Pairs that are too near are pushed apart, half each, again and again. Where that does not end,
    as there is hardly room, they take the nearest places of a hexagonal grid.

    Args:
        wanted_m: (N, 2).
        spacing_m: least distance.
        low_m: least coordinates, (2,).
        high_m: greatest coordinates, (2,).

    Raises:
        ValueError: there is no room for so many.
    """
    places_m = np.clip(wanted_m, low_m, high_m)
    apart_m = spacing_m * _ROOM
    for _ in range(_ROUNDS):
        pairs = cKDTree(places_m).query_pairs(apart_m, output_type="ndarray")
        gaps_m = places_m[pairs[:, 1]] - places_m[pairs[:, 0]]
        distances_m = np.linalg.norm(gaps_m, axis=1)
        near = distances_m < spacing_m
        if not near.any():
            return places_m
        pairs, gaps_m, distances_m = pairs[near], gaps_m[near], distances_m[near]
        together = distances_m == 0.0
        angles = _GOLDEN_ANGLE * pairs[together, 1]
        gaps_m[together] = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        distances_m[together] = 1.0
        missing_m = apart_m - np.where(together, 0.0, distances_m)
        pushes_m = 0.5 * gaps_m * (missing_m / distances_m)[:, None]
        np.add.at(places_m, pairs[:, 1], pushes_m)
        np.subtract.at(places_m, pairs[:, 0], pushes_m)
        np.clip(places_m, low_m, high_m, out=places_m)
    grid_m = hexagonal_grid(apart_m, low_m, high_m)
    if len(grid_m) < len(wanted_m):
        raise ValueError(
            f"no room for {len(wanted_m)} stations {spacing_m:g} m apart within "
            f"{low_m[0]:g}..{high_m[0]:g} x {low_m[1]:g}..{high_m[1]:g} m"
        )
    squared_m2 = ((wanted_m[:, None] - grid_m[None]) ** 2).sum(axis=-1)
    return grid_m[linear_sum_assignment(squared_m2)[1]]


def hexagonal_grid(spacing_m: float, low_m: Corner | Floats, high_m: Corner | Floats) -> Floats:
    """Points (K, 2) of a rectangle, each ``spacing_m`` from its neighbours."""
    if spacing_m <= 0.0:
        raise ValueError(f"spacing_m is {spacing_m}: it is above 0")
    rows = int((high_m[1] - low_m[1]) / (spacing_m * math.sqrt(0.75))) + 1
    grid: list[tuple[float, float]] = []
    for row in range(rows):
        first_m = low_m[0] + 0.5 * spacing_m * (row % 2)
        columns = int((high_m[0] - first_m) / spacing_m) + 1 if first_m <= high_m[0] else 0
        north_m = low_m[1] + row * spacing_m * math.sqrt(0.75)
        grid += [(first_m + column * spacing_m, north_m) for column in range(columns)]
    return np.minimum(np.array(grid).reshape(-1, 2), high_m)


def greatest_spacing_m(stations: int, wanted_m: float, sides_m: Corner) -> float:
    """The spacing that is wanted, or the greatest with which a grid has room in a rectangle."""
    if _has_room(stations, wanted_m, sides_m):
        return wanted_m
    low_m, high_m = 0.0, wanted_m
    for _ in range(40):
        middle_m = 0.5 * (low_m + high_m)
        if _has_room(stations, middle_m, sides_m):
            low_m = middle_m
        else:
            high_m = middle_m
    return low_m


def _has_room(stations: int, spacing_m: float, sides_m: Corner) -> bool:
    """Whether :func:`spread_out` finds places for so many stations in a rectangle."""
    if stations == 1 or spacing_m <= 0.0:
        return True
    east, north = sides_m[0] / spacing_m, sides_m[1] / spacing_m
    # Forty by forty are more than a thousand, as many as there may be, and so is a strip in which
    # only every other row of the grid has room for a point.
    if east * north > 1600.0 or max(east, north) > 1800.0:
        return True
    return len(hexagonal_grid(spacing_m * _ROOM, (0.0, 0.0), sides_m)) >= stations
