"""The shortest ways from home that keep out of no-fly zones."""

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Floats, Mast, Surroundings

MARGINS_M = (20.0, 10.0, 5.0, 2.0)
"""Distances of a way to zones and borders; the next one is tried where the one before leaves no
way. Narrower gaps are not flown through."""
MAST_M = 20.0
"""Distance of a way to a mast that is as high as the way."""
_NEAR_ENDS_M = 0.03
"""Distance to zones near home and near stations, which may lie closer than the margins."""
_NEAR = 1.5
"""Margins around home and stations in which that holds."""
_COARSE = 0.2
"""Share of a margin by which corners of zones are rounded."""
_BORDER_M = 1.0
"""A home that is nearer to the border of the area than this counts as outside of it."""
_ROUNDING_M = 0.01


def home_is_inside(surroundings: Surroundings) -> bool:
    """Whether home lies in the area, so that ways may not leave it."""
    return bool(surroundings.area.buffer(-_BORDER_M).contains(Point(surroundings.home_m)))


class Router:
    """Finds the shortest ways from home, level, in a plane."""

    def __init__(
        self, surroundings: Surroundings, goals_m: Sequence[tuple[float, float]], masts: list[Mast]
    ) -> None:
        """Prepare ways.

        Args:
            surroundings: limits of drones.
            goals_m: all places to which ways are wanted.
            masts: those that ways have to keep away from.

        Raises:
            InputError: home lies in a no-fly zone.
        """
        self._surroundings = surroundings
        self._ends_m = [surroundings.home_m, *goals_m]
        self._masts = masts
        self._graphs: dict[float, _Graph] = {}
        home = Point(surroundings.home_m)
        if surroundings.no_fly.buffer(_NEAR_ENDS_M).intersects(home):
            raise InputError(
                f"home at {home.x:.1f} m east, {home.y:.1f} m north lies in a no-fly zone; "
                "another --home, or smaller zones"
            )

    def way_to(self, goal_m: tuple[float, float], name: str) -> Floats:
        """The corners of the shortest way to a place, (K, 2), home first.

        Raises:
            InputError: there is none.
        """
        for margin_m in MARGINS_M:
            if margin_m not in self._graphs:
                self._graphs[margin_m] = _Graph(self._free_space(margin_m))
            way = self._graphs[margin_m].shortest(self._surroundings.home_m, goal_m)
            if way is not None:
                return way
        inside = " within the area" if home_is_inside(self._surroundings) else ""
        raise InputError(
            f"{name} cannot be reached from home{inside}: no-fly zones leave no gap of "
            f"{2.0 * MARGINS_M[-1]:g} m for a way to it; smaller zones, or another --home"
        )

    def _free_space(self, margin_m: float) -> BaseGeometry:
        ends = shapely.union_all([Point(end).buffer(_NEAR * margin_m, 4) for end in self._ends_m])
        near_ends = self._room(_NEAR_ENDS_M, MARGINS_M[-1]).intersection(ends)
        coarse_m = _COARSE * margin_m  # fewer corners are searched faster
        coarse = self._room(margin_m + coarse_m, MAST_M + coarse_m).simplify(coarse_m)
        return coarse.union(near_ends)

    def _room(self, margin_m: float, mast_m: float) -> BaseGeometry:
        surroundings = self._surroundings
        if home_is_inside(surroundings):
            room = surroundings.area.buffer(-margin_m, join_style="mitre")
        else:
            everything = shapely.union_all(
                [surroundings.area, surroundings.no_fly, *map(Point, self._ends_m)]
            )
            west, south, east, north = everything.bounds
            beyond_m = 10.0 * MARGINS_M[0]
            room = shapely.box(west, south, east, north).buffer(beyond_m, join_style="mitre")
        zones = surroundings.no_fly.buffer(margin_m, join_style="mitre", mitre_limit=1.5)
        masts = [Point(mast.east_m, mast.north_m).buffer(mast_m, 4) for mast in self._masts]
        return room.difference(shapely.union_all([zones, *masts]))


class _Graph:
    """Corners that ways may turn at, and which of them see each other."""

    def __init__(self, free: BaseGeometry) -> None:
        self._corners_m = np.array(list(_inner_corners(free)), np.float64).reshape(-1, 2)
        # Ways run along borders; a little room keeps rounding from counting as crossing them.
        around = shapely.box(*free.bounds).buffer(1.0, join_style="mitre")
        self._blocked = around.difference(free.buffer(_ROUNDING_M, join_style="mitre"))
        shapely.prepare(self._blocked)
        self._seen: dict[tuple[float, float], NDArray[np.int64]] = {}

    def shortest(self, start_m: tuple[float, float], goal_m: tuple[float, float]) -> Floats | None:
        """The corners of the shortest way, (K, 2), or None (A*)."""
        goal = np.array(goal_m)
        to_goal_m = np.hypot(*(self._corners_m - goal).T)
        reached: dict[int, float] = {}
        before: dict[int, int] = {}
        start, end = -1, len(self._corners_m)
        waiting = [(0.0, 0.0, start, start)]
        while waiting:
            _, length_m, index, previous = heapq.heappop(waiting)
            if index in reached:
                continue
            reached[index], before[index] = length_m, previous
            if index == end:
                return self._traced(before, start_m, goal_m)
            place = np.array(start_m) if index == start else self._corners_m[index]
            if self._sees(place, goal[None])[0]:
                whole_m = length_m + math.dist(place, goal)
                heapq.heappush(waiting, (whole_m, whole_m, end, index))
            visible = self._visible_from(place)
            further_m = length_m + np.hypot(*(self._corners_m[visible] - place).T)
            for corner, to_corner_m in zip(visible, further_m, strict=True):
                guess_m = to_corner_m + to_goal_m[corner]
                heapq.heappush(waiting, (guess_m, to_corner_m, int(corner), index))
        return None

    def _traced(
        self, before: dict[int, int], start_m: tuple[float, float], goal_m: tuple[float, float]
    ) -> Floats:
        index = before[len(self._corners_m)]
        way = [np.array(goal_m)]
        while index != -1:
            way.append(self._corners_m[index])
            index = before[index]
        return np.array([np.array(start_m), *way[::-1]])

    def _visible_from(self, place: Floats) -> NDArray[np.int64]:
        key = (float(place[0]), float(place[1]))
        if key not in self._seen:
            self._seen[key] = np.flatnonzero(self._sees(place, self._corners_m))
        return self._seen[key]

    def _sees(self, place: Floats, points: Floats) -> NDArray[np.bool_]:
        ends = np.stack([np.broadcast_to(place, points.shape), points], axis=1)
        blocked: NDArray[np.bool_] = shapely.intersects(self._blocked, shapely.linestrings(ends))
        return ~blocked


def _inner_corners(free: BaseGeometry) -> Iterator[tuple[float, float]]:
    """The corners at which a shortest way may turn: those that reach into the free space."""
    for polygon in shapely.get_parts(free):
        if polygon.geom_type != "Polygon":
            continue
        outline = orient(polygon)
        for ring in (outline.exterior, *outline.interiors):
            corners = np.array(ring.coords)[:-1]
            arriving = corners - np.roll(corners, 1, axis=0)
            leaving = np.roll(corners, -1, axis=0) - corners
            turns = arriving[:, 0] * leaving[:, 1] - arriving[:, 1] * leaving[:, 0]
            yield from map(tuple, corners[turns < 0.0])  # free space lies to the left
