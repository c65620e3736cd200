"""What a new episode begins with: users, Phase I, shadowing, walks."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants
from orchid_uav.envs.deployment import deploy
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.seeds import MASTS_STREAM
from orchid_uav.envs.starts.balanced import balanced_start_m
from orchid_uav.envs.users import draw_user_positions

Floats = NDArray[np.float64]


class Topologies(NamedTuple):
    """What a new episode draws at random, for B worlds."""

    users_m: Floats
    """Horizontal user positions, (B, M, 2)."""
    target_users: NDArray[np.bool_]
    """True for G_UAV, (B, M)."""
    start_m: Floats
    """Horizontal start of every UAV, (B, N, 2)."""
    shadowing_db: Floats
    """Of the links from G masts, (B, G, M)."""
    walk_keys: NDArray[np.uint64]
    """Seeds of the users' random walks, (B,)."""

    def chosen(self, worlds: slice) -> "Topologies":
        """Those of some of the worlds."""
        return Topologies(*(array[worlds] for array in self))  # type: ignore[arg-type]

    @classmethod
    def joined(cls, parts: Sequence["Topologies"]) -> "Topologies":
        """Those of several batches."""
        return cls(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))

    @classmethod
    def empty(cls, worlds: int, uavs: int, users: int, masts: int) -> "Topologies":
        """Arrays of the right shapes and types, all zero."""
        return cls(
            np.zeros((worlds, users, 2)),
            np.zeros((worlds, users), np.bool_),
            np.zeros((worlds, uavs, 2)),
            np.zeros((worlds, masts, users)),
            np.zeros(worlds, np.uint64),
        )


def draw_topology(
    drawn: Topologies,
    row: int,
    parameters: Parameters,
    constants: Constants,
    given_users_m: Floats | None,
    generator: np.random.Generator,
    begin: Callable[..., None],
) -> None:
    """Draw the topology of one world.

    Args:
        drawn: result.
        row: of the result.
        parameters: of the world.
        constants: of the same parameters, perhaps with a channel of the caller's own.
        given_users_m: the caller's own users, (M, 2).
        generator: of the world.
        begin: :func:`orchid_uav.envs.dynamics.begin_episodes`, for the channel of ``constants``.
    """
    users_m = given_users_m
    if users_m is None:
        users_m = draw_user_positions(parameters.network, generator)
    deployment = deploy(users_m, parameters, generator)
    drawn.users_m[row] = users_m
    drawn.target_users[row] = deployment.target_users
    drawn.start_m[row] = deployment.uav_positions_m
    std_db, users = parameters.gbs.shadowing_std_db, len(users_m)
    first_db = generator.normal(0.0, std_db, users)
    walk_key = generator.integers(2**64, dtype=np.uint64)
    drawn.walk_keys[row] = walk_key
    drawn.shadowing_db[row, :1] = first_db  # of no mast where there is none
    others = drawn.shadowing_db[row, 1:]
    if len(others):  # drawn elsewhere, so that all else is the same for any number of masts
        of_others = np.random.default_rng([int(walk_key), MASTS_STREAM])
        others[:] = of_others.normal(0.0, std_db, others.shape)
    if parameters.deployment.init == "balanced":
        drawn.start_m[row] = balanced_start_m(
            parameters,
            constants,
            deployment.users_m if parameters.deployment.balanced_on == "sensed" else users_m,
            deployment.target_users,
            deployment.uav_positions_m,
            walk_key,
            begin,
        )
