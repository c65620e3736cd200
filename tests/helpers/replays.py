"""A replay that nobody flew, small, with everything that a page can show."""

import json
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.replay.document import (
    DRONE_SCALE_M,
    POWER_SCALE_W,
    RATE_RATIO,
    SCHEMA,
    USER_SCALE_M,
    ReplayDocument,
    ReplayDrones,
    ReplayFlight,
    ReplayMast,
    ReplayMetric,
    ReplayStations,
    ReplayUsers,
)
from orchid_uav.experiments.replay.packing import pack, pack_magnitudes, pack_states

AREA_M = (2000.0, 1500.0)
METRICS = tuple(
    ReplayMetric(key=key, label=label, unit=unit, better=better, digits=digits)
    for key, label, unit, better, digits in (
        ("coverage", "coverage", "", "higher", 3),
        ("worst_rate_bps", "worst user's rate", "Mbit/s", "higher", 2),
        ("propulsion_power_w", "propulsion power", "W", "lower", 0),
    )
)


class MadeUp(NamedTuple):
    """A document, and what was packed into it."""

    document: ReplayDocument
    positions_m: list[NDArray[np.float64]]
    """Of each flight, (T + 1, N, 3)."""
    association: list[NDArray[np.int64]]
    metrics: list[dict[str, NDArray[np.float32]]]

    @property
    def json(self) -> str:
        return json.dumps(self.document.to_json())


def made_up_replay(
    slots: int = 40, drones: int = 4, users: int = 30, flights: int = 2, seed: int = 0
) -> MadeUp:
    """People stroll, drones dart about, and anybody may serve anybody."""
    draw = np.random.default_rng(seed)
    walks_m = draw.uniform(0, AREA_M, (users, 2)) + draw.normal(0, 2, (slots + 1, users, 2)).cumsum(
        0
    )
    made = MadeUp(None, [], [], [])
    shown = []
    for index in range(flights):
        ways_m = draw.normal(0, 12, (slots + 1, drones, 3)).cumsum(axis=0)
        ways_m += np.array([*AREA_M, 200.0]) * draw.uniform(0.2, 0.8, (drones, 3))
        ways_m[..., 2] = np.clip(ways_m[..., 2], 80.0, 120.0)
        powers_w = draw.uniform(0.05, 0.2, (slots + 1, drones))
        powers_w[slots // 2 :, drones - 1] = 0.0
        servers = draw.integers(-2, drones, (slots + 1, users))
        rates_bps = np.where(servers == -1, 0.0, draw.lognormal(14, 1, (slots + 1, users)))
        metrics = {
            "coverage": draw.uniform(0.7, 1.0, slots).astype(np.float32),
            "worst_rate_bps": draw.uniform(0.0, 3.0, slots).astype(np.float32),
            "propulsion_power_w": draw.uniform(150, 190, slots).astype(np.float32),
        }
        metrics["worst_rate_bps"][2] = np.nan
        stations = ReplayStations(
            centres=pack_states(ways_m[:1, :, :2], DRONE_SCALE_M), radius_m=40.0
        )
        shown.append(
            ReplayFlight(
                key=f"method-{index}",
                label=f"method {index}",
                note=f"the way number {index}",
                drones=ReplayDrones(
                    count=drones,
                    names=[f"uav_{number}" for number in range(drones)],
                    positions=pack_states(ways_m, DRONE_SCALE_M),
                    powers_w=pack_states(powers_w, POWER_SCALE_W),
                    stations=stations if index else None,
                ),
                association=pack_states(servers, 1.0),
                rates=pack_magnitudes(rates_bps, RATE_RATIO),
                metrics={key: pack(values, "float32") for key, values in metrics.items()},
            )
        )
        made.positions_m.append(ways_m)
        made.association.append(servers)
        made.metrics.append(metrics)
    document = ReplayDocument(
        schema=SCHEMA,
        title="method 0 beside method 1",
        subtitle="4 UAVs, 30 users",
        slot_s=1.0,
        slots=slots,
        area_m=list(AREA_M),
        altitudes_m=[80.0, 120.0],
        users=ReplayUsers(
            count=users,
            names=None,
            weights=None,
            targets=pack(np.ones(users, np.uint8), "uint8"),
            positions=pack_states(walks_m, USER_SCALE_M),
        ),
        masts=[ReplayMast(name="mast_0", position_m=[900.0, 700.0, 30.0])],
        metrics=list(METRICS),
        flights=shown,
        place=None,
    )
    return made._replace(document=document)
