"""Ways from home to the stations and back, and when drones start, so that none come too near.

All drones climb over home to the altitude of their way, fly there level, change to the altitude of
their station where the way meets the circle, and come back the same way. Where there is room for
it, ways lie below all circles. Drones start one after another, the one with the longest way first;
each takes the altitude that lets it start first.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import LineString, Point

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.routing import MAST_M, Router
from orchid_uav.experiments.planning.missions.separation import (
    PADS_M,
    SLACK_S,
    VERTICAL_M,
    Samples,
    Traffic,
    above_pads,
    occupied_by,
    sampled_apart_m,
    with_slack,
)
from orchid_uav.experiments.planning.model import Floats, Mast, Station, Surroundings

LOWEST_WAY_M = 30.0
"""Above home: over trees and most houses."""
TOUCHDOWN_MPS = 0.5
"""Speed of the last metres of a landing, at which autopilots come from the factory."""


class Speeds(NamedTuple):
    """How fast drones fly to their stations and back."""

    cruise_mps: float
    climb_mps: float
    descend_mps: float


class DroneWay(NamedTuple):
    """The way of one drone."""

    name: str
    outbound_m: Floats
    """Corners, (K, 3): home on the ground, home at the way's altitude, where it turns, the place
    on the circle that is nearest to the way, and the same at the station's altitude."""
    launch_s: float
    """When it takes off, after the first drone."""
    layer_m: float
    """Altitude of the way above home."""
    speeds: Speeds

    @property
    def inbound_m(self) -> Floats:
        """Corners of the way back, (K, 3)."""
        return self.outbound_m[::-1]

    @property
    def length_m(self) -> float:
        """Of the level part, one way."""
        return float(np.hypot(*np.diff(self.outbound_m[:, :2], axis=0).T).sum())

    @property
    def level_s(self) -> float:
        """Time in level flight, both ways."""
        return 2.0 * self.length_m / self.speeds.cruise_mps

    @property
    def vertical_s(self) -> float:
        """Time in which it climbs, descends and lands, both ways."""
        landing_s = PADS_M * (1.0 / TOUCHDOWN_MPS - 1.0 / self.speeds.descend_mps)
        return self.outbound_s + self.inbound_s - self.level_s + landing_s

    @property
    def seconds(self) -> float:
        """Both together."""
        return self.level_s + self.vertical_s

    @property
    def outbound_s(self) -> float:
        """From take-off until it is on its station."""
        return float(_times_s(self.outbound_m, self.speeds)[-1])

    @property
    def inbound_s(self) -> float:
        """From leaving the station until it touches down, if it landed without slowing down."""
        return float(_times_s(self.inbound_m, self.speeds)[-1])

    @property
    def arrives_s(self) -> float:
        """When it is on its station, after the first drone took off."""
        return self.launch_s + self.outbound_s

    def out(self) -> Samples:
        """The way there, above the pads, each second from take-off."""
        return sampled(self.outbound_m, self.speeds)

    def back(self) -> Samples:
        """The way back, above the pads, each second from leaving the station."""
        return sampled(self.inbound_m, self.speeds)


class Transit(NamedTuple):
    """The ways of all drones, in the order of their stations."""

    ways: tuple[DroneWay, ...]
    speeds: Speeds


def plan_transit(
    surroundings: Surroundings,
    stations: Sequence[Station],
    cruise_mps: float,
    climb_mps: float = 3.0,
    descend_mps: float = 2.0,
) -> Transit:
    """Plan ways to all stations and the times of take-off.

    Raises:
        InputError: a station cannot be reached, or no altitude lets a drone pass the others.
    """
    speeds = Speeds(cruise_mps, climb_mps, descend_mps)
    layers_m = _layers_m(surroundings, stations)
    highest = layers_m[0]
    towers = [mast for mast in surroundings.masts if mast.height_m > highest - VERTICAL_M]
    centers_m = [(station.east_m, station.north_m) for station in stations]
    router = Router(surroundings, centers_m, towers)
    level = [
        _onto_circle(router.way_to(center_m, station.name), station)
        for center_m, station in zip(centers_m, stations, strict=True)
    ]
    lengths_m = [float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in level]
    scheduler = _Scheduler(surroundings, stations, cruise_mps)
    for drone in np.argsort(np.negative(lengths_m), kind="stable"):
        lower = [mast for mast in surroundings.masts if mast not in towers]
        allowed = [layer_m for layer_m in layers_m if _clears(level[drone], layer_m, lower)]
        candidates = [
            DroneWay(
                stations[drone].name,
                _with_altitudes(level[drone], layer_m, stations[drone].altitude_m),
                0.0,
                layer_m,
                speeds,
            )
            for layer_m in allowed
        ]
        scheduler.add(int(drone), candidates)
    return Transit(tuple(scheduler.ways[drone] for drone in range(len(stations))), speeds)


def sampled(points_m: Floats, speeds: Speeds) -> Samples:
    """Where a drone is each second on a way through points, (K, 3), and at its end."""
    times_s = _times_s(points_m, speeds)
    seconds = np.append(np.arange(np.ceil(times_s[-1])), times_s[-1])
    places = [np.interp(seconds, times_s, points_m[:, axis]) for axis in range(3)]
    return above_pads(Samples(seconds, np.stack(places, axis=1)))


def _times_s(points_m: Floats, speeds: Speeds) -> Floats:
    steps_m = np.diff(points_m, axis=0)
    level_s = np.hypot(steps_m[:, 0], steps_m[:, 1]) / speeds.cruise_mps
    rates = np.where(steps_m[:, 2] > 0.0, speeds.climb_mps, speeds.descend_mps)
    return np.append(0.0, np.cumsum(np.maximum(level_s, np.abs(steps_m[:, 2]) / rates)))


def _layers_m(surroundings: Surroundings, stations: Sequence[Station]) -> list[float]:
    """Altitudes of ways, the highest first: those below all circles, if there are any."""
    lowest_m = min(LOWEST_WAY_M, surroundings.highest_m)
    steps = int((surroundings.highest_m - lowest_m) / VERTICAL_M) + 1
    layers_m = [lowest_m + VERTICAL_M * step for step in range(steps)]
    below_m = min(station.altitude_m for station in stations) - VERTICAL_M
    return [layer_m for layer_m in layers_m if layer_m <= below_m][::-1] or layers_m[::-1]


def _clears(way_m: Floats, layer_m: float, masts: Sequence[Mast]) -> bool:
    line = LineString(way_m)
    return all(
        mast.height_m + VERTICAL_M <= layer_m
        or line.distance(Point(mast.east_m, mast.north_m)) >= MAST_M
        for mast in masts
    )


def _onto_circle(way_m: Floats, station: Station) -> Floats:
    """The way to a station's centre, cut off where it meets the circle."""
    radius_m = station.circle_radius_m
    offsets = way_m - (station.east_m, station.north_m)
    distances_m = np.hypot(offsets[:, 0], offsets[:, 1])
    outside = np.flatnonzero(distances_m > radius_m)
    if not len(outside):  # home lies in the circle
        out = offsets[0] / distances_m[0] if distances_m[0] else np.array([1.0, 0.0])
        return np.stack([way_m[0], way_m[0] - offsets[0] + radius_m * out])
    last = int(outside[-1])
    if radius_m == 0.0:
        return way_m
    start, step = offsets[last], offsets[last + 1] - offsets[last]
    a, b, c = step @ step, start @ step, start @ start - radius_m**2
    share = (-b - np.sqrt(b * b - a * c)) / a
    return np.concatenate([way_m[: last + 1], [way_m[last] + share * step]])


def _with_altitudes(way_m: Floats, layer_m: float, altitude_m: float) -> Floats:
    level = np.column_stack([way_m, np.full(len(way_m), layer_m)])
    return np.concatenate([[[*way_m[0], 0.0]], level, [[*way_m[-1], altitude_m]]])


class _Scheduler:
    """Gives each further drone the first start at which it meets none of those before."""

    def __init__(
        self, surroundings: Surroundings, stations: Sequence[Station], cruise_mps: float
    ) -> None:
        self._stations = stations
        self._rooms = [occupied_by(station, surroundings) for station in stations]
        self._apart_m = sampled_apart_m(surroundings, cruise_mps)
        self.ways: dict[int, DroneWay] = {}
        self._flown: dict[int, Samples] = {}

    def add(self, drone: int, candidates: Sequence[DroneWay]) -> None:
        candidates = [way for way in candidates if self._passes_no_circle(drone, way)] or candidates
        traffic = Traffic(list(self._flown.values()), self._apart_m)
        starts = [self._first_start_s(drone, way, traffic) for way in candidates]
        possible = [(start, index) for index, start in enumerate(starts) if start is not None]
        if not possible:
            raise InputError(
                f"{self._stations[drone].name} finds no altitude for its way on which it keeps "
                f"{VERTICAL_M:g} m above or below, or {self._apart_m:.0f} m beside, of the other "
                "drones and of masts; a wider --altitude, or fewer drones"
            )
        start, index = min(possible)
        self.ways[drone] = candidates[index]._replace(launch_s=float(start))
        self._flown[drone] = candidates[index].out().later(float(start))

    def _passes_no_circle(self, drone: int, way: DroneWay) -> bool:
        points_m = way.out().points_m
        return not any(
            len(room.meets(points_m)) for other, room in enumerate(self._rooms) if other != drone
        )

    def _first_start_s(self, drone: int, way: DroneWay, traffic: Traffic) -> int | None:
        flight = way.out()
        earliest, latest = 0.0, np.inf
        for other, flown in self._flown.items():
            passing = self._rooms[other].meets(flight.points_m)
            if len(passing):  # it has to be past before the other is there
                last_s = flight.seconds[passing[-1]]
                latest = min(latest, self.ways[other].arrives_s - SLACK_S - 1.0 - last_s)
            passing = self._rooms[drone].meets(flown.points_m)
            if len(passing):  # it must not be there before the other is past
                last_s = flown.seconds[passing[-1]]
                earliest = max(earliest, last_s + SLACK_S + 1.0 - way.outbound_s)
        return first_free_s(traffic.forbids_s(flight), earliest, latest)


def first_free_s(blocked: NDArray[np.int64], earliest: float, latest: float) -> int | None:
    """The first whole second between two others that is not blocked, nor near to one that is."""
    taken = set(with_slack(blocked).tolist())
    start = int(np.ceil(earliest))
    while start in taken:
        start += 1
    return start if start <= latest else None
