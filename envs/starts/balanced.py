"""Phase I with several clusterings, of which the most balanced is flown (decision M41)."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants, Worlds
from orchid_uav.envs.deployment import kmeans_centroids
from orchid_uav.envs.dynamics import begin_episodes
from orchid_uav.envs.metrics import LOAD_JFI, RATE_JFI
from orchid_uav.envs.parameters import Parameters

Floats = NDArray[np.float64]
NO_OUTAGES = np.zeros((0, 3), np.int64)


def restarts_of(walk_key: np.uint64, count: int, seed: int = 0) -> list[int]:
    """Seeds of the K-Means++ restarts on one topology."""
    generator = np.random.default_rng([seed, int(walk_key >> np.uint64(1))])
    return [int(one) for one in generator.integers(2**31, size=count)]


def balanced_start_m(
    parameters: Parameters,
    constants: Constants,
    users_m: Floats,
    target_users: NDArray[np.bool_],
    start_m: Floats,
    walk_key: np.uint64,
    begin: Callable[..., None] = begin_episodes,
) -> Floats:
    """The most balanced of a start (N, 2) and of K-Means++ restarts over the target users.

    Args:
        parameters: of the world.
        constants: of the same parameters, perhaps with a channel of the user's own.
        users_m: positions (M, 2) as Phase I sees them.
        target_users: whom the UAVs are there for, (M,).
        start_m: where Phase I puts the UAVs.
        walk_key: the topology's, from which the restarts are seeded.
        begin: :func:`begin_episodes`, for the channel of ``constants``.
    """
    if not target_users.any():
        return start_m
    uavs = len(start_m)
    seeds = restarts_of(walk_key, parameters.deployment.balanced_restarts)
    restarts_m = (kmeans_centroids(users_m[target_users], uavs, seed) for seed in seeds)
    stacked_m = np.stack([start_m, *restarts_m])
    targets = np.broadcast_to(target_users, (len(stacked_m), len(users_m)))
    return stacked_m[most_balanced(parameters, constants, users_m, targets, stacked_m, begin)]


def most_balanced(
    parameters: Parameters,
    constants: Constants,
    users_m: Floats,
    target_users: NDArray[np.bool_],
    starts_m: Floats,
    begin: Callable[..., None] = begin_episodes,
) -> int:
    """Index of the start (K, N, 2) with the greatest sum of load JFI and rate JFI.

    ``target_users`` (K, M) go with the starts; the other arguments are as above.
    """
    candidates, uavs, _ = starts_m.shape
    trial = constants._replace(
        flies_stations=False, outages=NO_OUTAGES, senses_truth=True, delay_slots=0
    )
    worlds = Worlds.zeros(trial, candidates, uavs, len(users_m))
    worlds.user_coordinates_m[:] = users_m.T
    worlds.target_users[:] = target_users
    worlds.positions_m[..., :2] = np.clip(starts_m, 0.0, parameters.network.area_size_m)
    worlds.positions_m[..., 2] = parameters.uav.initial_altitude_m
    worlds.transmit_powers_w[:] = parameters.uav.start_power_w
    begin(trial, worlds, np.arange(candidates))
    return int(np.argmax(worlds.metrics[:, LOAD_JFI] + worlds.metrics[:, RATE_JFI]))
