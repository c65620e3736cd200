"""A replay's document unpacked, for pictures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.replay.document import ReplayDocument, ReplayFlight
from orchid_uav.experiments.replay.packing import Packed

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True)
class SceneFlight:
    """How one method flew; states that stay are repeated for every slot."""

    label: str
    drones_m: Floats
    """(T + 1, N, 3)."""
    powers_w: Floats
    """(T + 1, N)."""
    stations_m: Floats | None
    """(T + 1, N, 2)."""
    radius_m: float
    association: Whole
    """(T + 1, M)."""
    rates_bps: Floats
    """(T + 1, M)."""
    metrics: dict[str, Floats]
    """(T,)."""

    def worst_off(self, slot: int, users_m: Floats, targets: NDArray[np.bool_]) -> int | None:
        """Who of the drones' people has the least rate; None if there are none.

        Where people of one drone have equal rates it is the farthest of them, whom the drone gives
        most of its band.

        Args:
            slot: from 0.
            users_m: where they are then, (M, 2).
            targets: the drones' people, (M,).
        """
        chosen = np.flatnonzero(targets)
        if not len(chosen):
            return None
        rates_bps, server = self.rates_bps[slot, chosen], self.association[slot, chosen]
        away_m = np.linalg.norm(users_m[chosen] - self.drones_m[slot, server, :2], axis=1)
        return int(chosen[np.lexsort((-away_m, rates_bps))[0]])


@dataclass(frozen=True)
class Scene:
    """A replay with its arrays."""

    document: ReplayDocument
    users_m: Floats
    """(T + 1, M, 2)."""
    targets: NDArray[np.bool_]
    """(M,)."""
    flights: list[SceneFlight]

    @property
    def slots(self) -> int:
        """The last state's slot."""
        return self.document.slots


def unpack(document: ReplayDocument) -> Scene:
    """Unpack a document.

    Raises:
        ValueError: its arrays do not fit.
    """
    states = document.slots + 1
    users = document.users
    return Scene(
        document=document,
        users_m=_states(users.positions, states),
        targets=users.targets.numbers().astype(np.bool_),
        flights=[_flight(flight, states) for flight in document.flights],
    )


def _flight(flight: ReplayFlight, states: int) -> SceneFlight:
    stations = flight.drones.stations
    return SceneFlight(
        label=flight.label,
        drones_m=_states(flight.drones.positions, states),
        powers_w=_states(flight.drones.powers_w, states),
        stations_m=None if stations is None else _states(stations.centres, states),
        radius_m=0.0 if stations is None else stations.radius_m,
        association=_states(flight.association, states).astype(np.int64),
        rates_bps=_states(flight.rates, states),
        metrics={name: packed.values() for name, packed in flight.metrics.items()},
    )


def _states(packed: Packed, states: int) -> Floats:
    values = packed.values()
    return np.broadcast_to(values, (states, *values.shape[1:]))
