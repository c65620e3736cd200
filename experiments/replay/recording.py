"""Records a flight slot by slot, flown by the same code as an evaluation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents.controllers.controller import Controller
from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.replay.document import UNSERVED

MOST_NUMBERS = 20_000_000
"""Numbers of a flight at most; a page with more would neither open nor be sent to anybody."""


@dataclass(frozen=True)
class Recording:
    """States 0 … T of one world, and its metrics in the slots 1 … T."""

    users_m: Floats
    """(T + 1, M, 2)."""
    target_users: NDArray[np.bool_]
    """(M,)."""
    positions_m: Floats
    """Of the drones, (T + 1, N, 3)."""
    powers_w: Floats
    """(T + 1, N); 0 out of service."""
    stations_m: Floats | None
    """Centres of the circles, (T + 1, N, 2); None in direct flight."""
    association: NDArray[np.int64]
    """As in :class:`ReplayFlight`, (T + 1, M)."""
    rates_bps: Floats
    """(T + 1, M)."""
    masts_m: Floats
    """(G, 3)."""
    metrics: dict[str, Floats]
    """By name, (T,)."""


def record(
    world: WorldBatch, method: Controller, slot_flown: Callable[[], None] = lambda: None
) -> Recording:
    """Fly an episode that is about to begin in a batch of one world, and record it.

    Args:
        world: before the first slot.
        method: who has begun there.
        slot_flown: called after every slot.

    Raises:
        InputError: there are too many slots, users and drones to show.
    """
    slots = world.parameters.network.episode_slots
    check_size(slots, world.uav_count, world.user_count)
    diagnostics = Diagnostics(world)
    states, metrics = [_state(world)], []
    for _ in range(slots):
        diagnostics.begin()  # so that they are those of one slot
        world.step(method.act(world))
        diagnostics.observe()
        states.append(_state(world))
        metrics.append(world.slot_metrics(0) | diagnostics.episode_metrics(0))
        slot_flown()
    columns = {name: np.array([state[name] for state in states]) for name in states[0]}
    stations_m = columns["stations_m"] if world.constants.flies_stations else None
    return Recording(
        users_m=columns["users_m"],
        target_users=columns["target_users"][0],
        positions_m=columns["uav_positions_m"],
        powers_w=columns["transmit_powers_w"],
        stations_m=stations_m,
        association=columns["association"],
        rates_bps=columns["rates_bps"],
        masts_m=world.constants.gbs_positions_m.copy(),
        metrics={name: np.array([one[name] for one in metrics]) for name in metrics[0]},
    )


def check_size(slots: int, drones: int, users: int) -> None:
    """Raise InputError where a flight has more numbers than can be shown."""
    numbers = (slots + 1) * (4 * users + 6 * drones)
    if numbers > MOST_NUMBERS:
        raise InputError(
            f"{slots:,} slots of {drones:,} drones and {users:,} users are too many to show: "
            f"{numbers:,} numbers, more than {MOST_NUMBERS:,}"
        )


def _state(world: WorldBatch) -> dict[str, NDArray[np.generic]]:
    state = {name: np.asarray(value) for name, value in world.snapshot(0).items()}
    masts = world.mast_service()[0][0]
    state["association"] = np.where(
        masts >= 0, UNSERVED - 1 - masts, state["association"].astype(np.int64)
    )
    state["stations_m"] = world.arrays.stations_m[0].copy()
    return state
