"""Proves missions by flying them all at once, from the items that are in their files.

It knows nothing of how they were planned: only where drones may be, which stations they are for,
when each takes off, and how fast it climbs and descends.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from orchid_uav.experiments.planning.missions.items import MissionItem, home_of
from orchid_uav.experiments.planning.missions.routing import home_is_inside
from orchid_uav.experiments.planning.missions.separation import PADS_M, VERTICAL_M
from orchid_uav.experiments.planning.missions.simulation import Track, fly
from orchid_uav.experiments.planning.missions.transit import Speeds
from orchid_uav.experiments.planning.model import Floats, Station, Surroundings

_ROUNDING_M = 0.03
"""Of positions and altitudes in files."""
_ON_CIRCLE_M = 2.5
"""Radially; PX4 circles on the chords of a polygon, ArduPilot with whole metres of radius."""
_AT_ALTITUDE_M = 0.5
_AT_HOME_M = 1.0


class Conflict(NamedTuple):
    """A limit that flights break."""

    second: float
    """The first time, after the first drone took off."""
    drones: tuple[str, ...]
    what: str


class FlightProof(NamedTuple):
    """What came of flying all missions."""

    seconds: float
    """Until the last drone is back."""
    least_horizontal_m: float
    """Between drones too near vertically; infinite if none ever are."""
    least_vertical_m: float
    """Between drones too near horizontally; infinite if none ever are."""
    highest_m: float
    on_station_s: tuple[float, ...]
    """How long each drone is on its station."""
    conflicts: tuple[Conflict, ...]


def prove(
    surroundings: Surroundings,
    stations: Sequence[Station],
    missions: Sequence[Sequence[MissionItem]],
    launches_s: Sequence[float],
    speeds: Speeds,
    step_s: float = 1.0,
) -> FlightProof:
    """Fly all missions and compare positions at every step.

    Drones lower than the height of pads are not compared: there they stand or land beside one
    another.

    Args:
        surroundings: limits of drones.
        stations: of all drones.
        missions: the items of each drone, as read from its file.
        launches_s: when each takes off.
        speeds: of which those upwards and downwards are used.
        step_s: between positions.
    """
    home = home_of(surroundings)
    tracks = [
        fly(items, surroundings.site, home, speeds.climb_mps, speeds.descend_mps)
        for items in missions
    ]
    ends_s = [
        launch_s + track.seconds[-1] for launch_s, track in zip(launches_s, tracks, strict=True)
    ]
    times_s = np.arange(0.0, max(ends_s) + step_s, step_s)
    points_m = np.stack(
        [track.at(times_s - launch_s) for track, launch_s in zip(tracks, launches_s, strict=True)]
    )
    nearest = _Nearest(surroundings, stations, times_s)
    conflicts = [*nearest.conflicts(points_m)]
    on_station_s = []
    for station, track, launch_s, places_m in zip(
        stations, tracks, launches_s, points_m, strict=True
    ):
        on_station = _is_on_station(station, places_m)
        on_station_s.append(step_s * int(on_station.sum()))
        conflicts.extend(_alone(surroundings, station, track, launch_s))
    return FlightProof(
        seconds=float(max(ends_s)),
        least_horizontal_m=nearest.least_horizontal_m,
        least_vertical_m=nearest.least_vertical_m,
        highest_m=float(points_m[:, :, 2].max()),
        on_station_s=tuple(on_station_s),
        conflicts=tuple(sorted(conflicts)),
    )


class _Nearest:
    """How near drones come to one another."""

    def __init__(
        self, surroundings: Surroundings, stations: Sequence[Station], times_s: Floats
    ) -> None:
        self._names = [station.name for station in stations]
        self._times_s = times_s
        self._apart_m = surroundings.clearance_m - _ROUNDING_M
        self.least_horizontal_m = self.least_vertical_m = math.inf

    def conflicts(self, points_m: Floats) -> Iterator[Conflict]:
        """Of drones at points, (N, T, 3)."""
        flying = points_m[:, :, 2] >= PADS_M
        for drone in range(len(points_m) - 1):
            offsets_m = points_m[drone + 1 :] - points_m[drone]
            both = flying[drone + 1 :] & flying[drone]
            level_m = np.where(both, np.hypot(offsets_m[..., 0], offsets_m[..., 1]), np.inf)
            up_m = np.where(both, np.abs(offsets_m[..., 2]), np.inf)
            stacked = level_m < self._apart_m
            beside = up_m < VERTICAL_M - _ROUNDING_M
            self.least_horizontal_m = min(self.least_horizontal_m, _least(level_m[beside]))
            self.least_vertical_m = min(self.least_vertical_m, _least(up_m[stacked]))
            for other in np.flatnonzero((stacked & beside).any(axis=1)):
                when = np.flatnonzero(stacked[other] & beside[other])
                yield Conflict(
                    float(self._times_s[when[0]]),
                    (self._names[drone], self._names[drone + 1 + other]),
                    f"come within {level_m[other][when].min():.1f} m beside and "
                    f"{up_m[other][when].min():.1f} m above one another",
                )


def _alone(
    surroundings: Surroundings, station: Station, track: Track, launch_s: float
) -> Iterator[Conflict]:
    """Limits that a drone breaks by itself."""
    corners_m, names = track.points_m, (station.name,)
    moves = np.flatnonzero(np.hypot(*np.diff(corners_m[:, :2], axis=0).T) > 0.0)
    lines = shapely.linestrings(np.stack([corners_m[moves, :2], corners_m[moves + 1, :2]], axis=1))
    on_station = _is_on_station(station, corners_m)
    within = np.ones(len(moves), np.bool_)
    if not home_is_inside(surroundings):  # then ways may lead through anywhere
        within = on_station[moves] & on_station[moves + 1]
    zones = surroundings.no_fly.buffer(-_ROUNDING_M)
    area = surroundings.area.buffer(_ROUNDING_M)
    shapely.prepare(zones)
    shapely.prepare(area)
    points = shapely.points(corners_m[:, :2])
    for broken, starts, what in (
        (shapely.intersects(zones, lines), moves, "flies through a no-fly zone"),
        (within & ~shapely.covers(area, lines), moves, "leaves the area"),
        (shapely.intersects(zones, points[:1]), np.zeros(1, np.int64), "starts in a no-fly zone"),
        (
            corners_m[:, 2] > surroundings.highest_m + _ROUNDING_M,
            np.arange(len(corners_m)),
            f"flies higher than {surroundings.highest_m:g} m",
        ),
    ):
        if broken.any():
            first = starts[np.flatnonzero(broken)[0]]
            yield Conflict(launch_s + float(track.seconds[first]), names, what)
    if not on_station.any():
        yield Conflict(launch_s, names, "never comes to its station")
    if np.hypot(*(corners_m[-1, :2] - surroundings.home_m)) > _AT_HOME_M or corners_m[-1, 2] != 0.0:
        yield Conflict(launch_s + float(track.seconds[-1]), names, "does not land at home")


def _is_on_station(station: Station, points_m: Floats) -> NDArray[np.bool_]:
    distances_m = np.hypot(*(points_m[:, :2] - (station.east_m, station.north_m)).T)
    on_circle: NDArray[np.bool_] = np.abs(distances_m - station.circle_radius_m) < _ON_CIRCLE_M
    return on_circle & (np.abs(points_m[:, 2] - station.altitude_m) < _AT_ALTITUDE_M)


def _least(values: Floats) -> float:
    return float(values.min()) if len(values) else math.inf
