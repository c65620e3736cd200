"""What flies a batch of worlds: one small protocol for rules, planners and learned policies."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.world import WorldBatch

Actions = NDArray[np.float64]
"""(B, N, 4) in [-1, 1]: moves along x, y, z, and transmit power."""


class Controller(Protocol):
    """Given a batch of worlds, returns actions."""

    def begin(self, world: WorldBatch) -> None:
        """Prepare for the episodes that have just begun; may :meth:`WorldBatch.place` the UAVs."""

    def act(self, world: WorldBatch) -> Actions:
        """Actions (B, N, 4) for the next slot."""


def no_actions(world: WorldBatch) -> Actions:
    """Zero actions (B, N, 4): every UAV stays where it is, and its power as it is."""
    return np.zeros((world.world_count, world.uav_count, ACTION_SIZE))


def check_stations(world: WorldBatch, rule: str) -> None:
    """Raise ValueError where an action moves the UAVs themselves, and not their stations."""
    if not world.constants.flies_stations:
        raise ValueError(f"{rule} moves stations: it needs uav.flight = station")


def station_actions(world: WorldBatch, velocities_mps: NDArray[np.float64]) -> Actions:
    """Actions that give stations these velocities (B, N, 2), shortened to their limit (M38)."""
    actions = no_actions(world)
    limit_mps = world.constants.station_speed_limit_mps
    if limit_mps > 0.0:
        speeds_mps = np.linalg.norm(velocities_mps, axis=-1, keepdims=True)
        actions[..., :2] = velocities_mps / np.maximum(speeds_mps, limit_mps)
    return actions


def act_towards(
    world: WorldBatch, displacement_m: NDArray[np.float64], power_change: float = 0.0
) -> Actions:
    """Actions that move UAVs by (B, N, 2 or 3) in m, and all powers by ``power_change`` in [-1, 1].

    Axes along which the configuration lets no UAV move get no action.
    """
    actions = no_actions(world)
    axes = displacement_m.shape[-1]
    scale_m = np.array(world.parameters.uav.displacement_scale_m[:axes])
    np.divide(displacement_m, scale_m, out=actions[..., :axes], where=scale_m > 0.0)
    actions[..., 3] = power_change
    return actions
