"""How long each drone stays, so that on the way back none come too near either.

No drone stays longer than its battery allows. The one that may stay longest is given its time
first; each further one leaves as late as it can without meeting a drone on its way.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.separation import (
    SLACK_S,
    Samples,
    Traffic,
    occupied_by,
    sampled_apart_m,
    with_slack,
)
from orchid_uav.experiments.planning.missions.transit import Transit
from orchid_uav.experiments.planning.model import Station, Surroundings


class Stay(NamedTuple):
    """When a drone leaves its station again."""

    turns: int
    """Whole circles until then; 0 for one that hovers."""
    hold_s: int
    """How long it hovers after its circles, until its way is free."""
    seconds: float
    """On station, both together."""
    leaves_s: float
    """After the first drone took off."""
    lands_s: float
    """After the first drone took off, if it lands without slowing down."""


def plan_stays(
    surroundings: Surroundings,
    stations: Sequence[Station],
    transit: Transit,
    longest_s: Sequence[float],
    turn_s: Sequence[float],
) -> tuple[Stay, ...]:
    """How long each drone stays.

    Args:
        surroundings: limits of drones.
        stations: of all drones.
        transit: their ways.
        longest_s: how long the battery of each lasts on station, (N,).
        turn_s: how long each flies one circle, (N,); 0 for drones that hover.

    Raises:
        InputError: a drone would have to come back before it has flown one circle.
    """
    limits = np.array([way.arrives_s for way in transit.ways]) + longest_s
    # Where ways have to pass circles, those who fly farther have to be given their times first.
    launches_s = np.array([way.launch_s for way in transit.ways])
    for order in (np.argsort(-limits, kind="stable"), np.argsort(launches_s)):
        scheduler = _Scheduler(surroundings, stations, transit, limits, turn_s)
        stuck = [int(drone) for drone in order if not scheduler.add(int(drone))]
        if not stuck:
            return tuple(scheduler.stays[drone] for drone in range(len(stations)))
    first = min(stuck, key=lambda drone: limits[drone])
    raise InputError(
        f"{stations[first].name} could not come back between the other drones before its battery "
        f"is empty ({longest_s[first]:.0f} s on station); a larger --battery-wh, fewer drones, or "
        "a higher --altitude, which leaves room for ways below the circles"
    )


class _Scheduler:
    """Gives each further drone the latest return on which it meets none of those before."""

    def __init__(
        self,
        surroundings: Surroundings,
        stations: Sequence[Station],
        transit: Transit,
        limits: NDArray[np.float64],
        turn_s: Sequence[float],
    ) -> None:
        self._ways, self._turn_s = transit.ways, turn_s
        self._rooms = [occupied_by(station, surroundings) for station in stations]
        self._apart_m = sampled_apart_m(surroundings, transit.speeds.cruise_mps)
        self._limits_s = limits
        self._out = [way.out().later(way.launch_s) for way in transit.ways]
        self._back: dict[int, Samples] = {}
        self.stays: dict[int, Stay] = {}

    def add(self, drone: int) -> bool:
        """Whether it was given a time."""
        way = self._ways[drone]
        leaves_s = self._last_leave_s(drone)
        if leaves_s is None:
            return False
        turn_s, longest_s = self._turn_s[drone], leaves_s - way.arrives_s
        turns = int(longest_s / turn_s) if turn_s else 0
        hold_s = int(longest_s - turns * turn_s)
        stays_s = turns * turn_s + hold_s  # up to a second less, which the slack covers
        leaves_s = way.arrives_s + stays_s
        self.stays[drone] = Stay(turns, hold_s, stays_s, leaves_s, leaves_s + way.inbound_s)
        self._back[drone] = way.back().later(leaves_s)
        return True

    def _last_leave_s(self, drone: int) -> float | None:
        way = self._ways[drone]
        back = way.back()
        # A drone that is on its way out still while this one can already be on its way back.
        late = [
            flight
            for flight, other in zip(self._out, self._ways, strict=True)
            if other.arrives_s > way.arrives_s
        ]
        traffic = Traffic([*late, *self._back.values()], self._apart_m)
        taken = set(with_slack(traffic.forbids_s(back)).tolist())
        bars = self._circles_in_the_way(back)
        latest_s = self._limits_s[drone]
        for flown in self._back.values():  # it must be away before another comes past
            passing = self._rooms[drone].meets(flown.points_m)
            if len(passing) and flown.seconds[passing[-1]] + SLACK_S > way.arrives_s:
                latest_s = min(latest_s, flown.seconds[passing[0]] - SLACK_S - 1.0)
        shortest_s = math.ceil(max(self._turn_s[drone], 1.0))
        for stays_s in range(int(latest_s - way.arrives_s), shortest_s - 1, -1):
            leaves_s = way.arrives_s + stays_s
            if round(leaves_s) not in taken and not any(
                start <= leaves_s <= end for start, end in bars
            ):
                return float(leaves_s)
        return None

    def _circles_in_the_way(self, back: Samples) -> list[tuple[float, float]]:
        """Between which seconds a drone must not leave, because of those on their stations."""
        bars = []
        for other, stay in self.stays.items():
            passing = self._rooms[other].meets(back.points_m)
            if len(passing):
                first_s, last_s = back.seconds[passing[0]], back.seconds[passing[-1]]
                slack_s = SLACK_S + 1.0
                begins_s = self._ways[other].arrives_s - slack_s - last_s
                bars.append((begins_s, stay.leaves_s + slack_s - first_s))
        return bars
