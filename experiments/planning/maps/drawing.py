"""What all maps of a plan are drawn from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.planning.model import Floats, People, Station, Surroundings, Want
from orchid_uav.experiments.planning.result import PlanDocument


@dataclass(frozen=True)
class MappedPlan:
    """A plan, and who is served by whom, person by person."""

    document: PlanDocument
    surroundings: Surroundings
    people: People
    stations: tuple[Station, ...]
    """In the order of ``document.drones``."""
    server: NDArray[np.int64]
    """The index of the drone, or N + the index of the mast, or ``NOBODY``, (P,)."""
    rates_bps: Floats
    """Rate of each single person at that position, (P,)."""
    want: Want | None
    ways_m: list[Floats]
    """Outbound way of each drone: east, north and altitude above home, (K, 3); may be empty."""

    @property
    def servers(self) -> list[str]:
        """Names of drones and masts, in the order of ``server``."""
        masts = range(len(self.surroundings.masts))
        return [station.name for station in self.stations] + [mast_name(mast) for mast in masts]

    def served_by(self, server: int) -> int:
        """How many people a server serves, weights counted."""
        return int(self.people.weights[self.server == server].sum())


def mast_name(mast: int) -> str:
    """``mast_0``, ``mast_1``, …, in the order of ``Surroundings.masts``."""
    return f"mast_{mast}"
