"""A rule of your own: every UAV flies to the middle of the users that it serves.

    orchid eval --method examples/extending/own_rule.py:FollowServed

A method has begin(world) and act(world). It may read everything in ``world.arrays``.
"""

import numpy as np

from orchid_uav.agents.controllers.controller import Actions, act_towards
from orchid_uav.envs import WorldBatch


class FollowServed:
    """This rule flies B worlds at once: every array has one row per world."""

    objective = "mmf"  # or "pf": the reward's rate term, and how a UAV's band is shared
    idea = "fly to the middle of the users that are served, at full power"

    def begin(self, world: WorldBatch) -> None:
        """Called once, when the worlds' episodes have begun; this rule remembers nothing."""

    def act(self, world: WorldBatch) -> Actions:
        """Actions (B, N, 4) in [-1, 1]: moves along x, y, z, and transmit power."""
        arrays = world.arrays
        serves = arrays.association[:, None, :] == np.arange(world.uav_count)[:, None]  # (B, N, M)
        users = serves.sum(axis=2)[..., None]
        middle_m = np.einsum("bnm,bma->bna", serves, world.users_m) / np.maximum(users, 1)
        move_m = np.where(users > 0, middle_m - arrays.positions_m[..., :2], 0.0)
        return act_towards(world, move_m, power_change=1.0)
