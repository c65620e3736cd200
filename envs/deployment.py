"""Phase I: where UAVs start, and which users they are there for (Section IV-B)."""

import warnings
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import ThreadpoolController

from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.seeds import SENSING_STREAM, START_STREAM

_RANDOM_START_TRIES = 10_000


class Deployment(NamedTuple):
    """The outcome of Phase I."""

    uav_positions_m: NDArray[np.float64]
    """Horizontal start of every UAV, (N, 2)."""
    target_users: NDArray[np.bool_]
    """True for the users of G_UAV, (M,): all but those of the masts' clusters."""
    centroids_m: NDArray[np.float64]
    """All centroids, (N + G, 2)."""
    labels: NDArray[np.int32]
    """Cluster of every user, (M,)."""
    users_m: NDArray[np.float64]
    """Users' positions that it was made from, (M, 2)."""

    @property
    def spare_uavs(self) -> int:
        """UAVs whose cluster has no users, as there are too few distinct places (M36)."""
        return len(self.centroids_m) - len(np.unique(self.labels))


def gbs_aware_kmeans(
    users: ArrayLike, uavs: int, gbs: ArrayLike, seed: int | None = None, n_init: int = 1
) -> Deployment:
    """K-Means++ into N + 1 clusters; the one nearest the GBS is the GBS's (Section IV-B).

    With G masts there are N + G clusters, of which each mast gets one: those with which the sum of
    the distances from mast to centroid is least (M45). With none, all clusters are UAVs'.

    The seeding is scikit-learn's greedy K-Means++: each centre is the best of 2 + ln(N + 1) draws.
    Users at fewer than N + 1 distinct places leave clusters without any. The GBS gets one that has
    users; the UAVs to spare start where there are the most users per UAV (M36).

    Args:
        users: positions (M, 2) in m as Phase I sees them, at least N + G of them.
        uavs: number N of UAVs.
        gbs: position of the GBS, of which the first two coordinates count, or of G masts, (G, 2) or
            (G, 3); empty for none.
        seed: of the K-Means++ seeding.
        n_init: runs, of which the one with the least within-cluster sum of squares is kept (M27).
    """
    positions = np.asarray(users, dtype=np.float64)
    if uavs < 1:
        raise ValueError(f"uavs is {uavs}: at least 1 is needed")
    if positions.ndim != 2 or positions.shape[1] != 2 or not np.isfinite(positions).all():
        raise ValueError("user positions are not finite numbers of shape (users, 2)")
    masts_m = np.asarray(gbs, dtype=np.float64)
    masts_m = masts_m[None, :2] if masts_m.ndim == 1 and masts_m.size else masts_m[..., :2]
    clusters = uavs + len(masts_m)
    if len(positions) < clusters:
        raise ValueError(f"{len(positions)} users cannot form {clusters} clusters")
    centroids, labels = _fit(
        KMeans(n_clusters=clusters, init="k-means++", n_init=n_init, random_state=seed), positions
    )
    users_of = np.bincount(labels, minlength=clusters)
    is_spare = users_of == 0
    of_masts = _clusters_of_masts(masts_m, centroids, is_spare)
    if users_of[of_masts].sum() < len(positions):
        users_of[of_masts] = 0
    _settle(centroids, is_spare, users_of)
    starts_m = np.delete(centroids, of_masts, axis=0)
    return Deployment(starts_m, ~np.isin(labels, of_masts), centroids, labels, positions)


def _clusters_of_masts(
    masts_m: NDArray[np.float64], centroids_m: NDArray[np.float64], is_spare: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """The clusters that masts get, (G,): those with users while there are any (M36, M45)."""
    occupied, spare = np.flatnonzero(~is_spare), np.flatnonzero(is_spare)
    if not len(masts_m):
        return occupied[:0]
    distances_m = np.linalg.norm(masts_m[:, None] - centroids_m[None, occupied], axis=2)
    chosen = linear_sum_assignment(distances_m)[1]
    return np.concatenate([occupied[chosen], spare[: len(masts_m) - len(chosen)]])


def kmeans_centroids(
    users_m: NDArray[np.float64],
    clusters: int,
    seed: int | None = None,
    start_m: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Centroids (clusters, 2) of one K-Means run over users (M, 2), all of them to be served.

    Args:
        users_m: positions in m, of one user at least.
        clusters: number of centroids; where there are fewer places, some centroids coincide.
        seed: of the K-Means++ seeding.
        start_m: centroids to go on from instead, (clusters, 2).
    """
    if len(users_m) == 0:
        raise ValueError("there are no users to form clusters of")
    if len(users_m) < clusters:
        users_m = np.resize(users_m, (clusters, 2))
    init = "k-means++" if start_m is None else start_m
    centroids, labels = _fit(KMeans(clusters, init=init, n_init=1, random_state=seed), users_m)
    users_of = np.bincount(labels, minlength=clusters)
    _settle(centroids, users_of == 0, users_of)
    return centroids


def _fit(
    clustering: KMeans, positions_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Centroids and labels; the centroid of a cluster without users means nothing yet."""
    with warnings.catch_warnings(), scikit_learn_threads().limit(limits=1, user_api="openmp"):
        # Fewer distinct positions than clusters is unusual but valid: some UAVs start together.
        warnings.simplefilter("ignore", ConvergenceWarning)
        clustering.fit(positions_m)
    centroids, labels = clustering.cluster_centers_, clustering.labels_
    occupied = np.unique(labels)
    if len(occupied) < len(centroids):
        # scikit-learn fills an empty cluster with a user of another, again and again, and leaves
        # the one that lost its only user a centroid that is nowhere, even outside the area.
        for cluster in occupied:
            centroids[cluster] = positions_m[labels == cluster].mean(axis=0)
    return centroids, labels


def _settle(
    centroids_m: NDArray[np.float64], is_spare: NDArray[np.bool_], users_of: NDArray[np.int64]
) -> None:
    """Put the centroid of each spare cluster on the one with the most users per centroid (M36)."""
    sharing = np.ones(len(centroids_m))
    for cluster in np.flatnonzero(is_spare):
        host = np.argmax(users_of / sharing)
        centroids_m[cluster] = centroids_m[host]
        sharing[host] += 1.0


@cache
def scikit_learn_threads() -> ThreadpoolController:
    """The threads of scikit-learn, kept to one: on so few points more only cost time.

    Looking for them takes longer than many a clustering, hence once.
    """
    return ThreadpoolController()


def random_start(
    uavs: int,
    area_size_m: tuple[float, float],
    min_separation_m: float,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """Horizontal positions (N, 2) uniform over the area, d_min apart from each other (M28).

    Raises:
        ValueError: no room found for so many UAVs at that distance.
    """
    chosen = np.empty((uavs, 2))
    for index in range(uavs):
        for _ in range(_RANDOM_START_TRIES):
            candidate = generator.uniform(0.0, area_size_m, 2)
            distances = np.linalg.norm(chosen[:index] - candidate, axis=1)
            if np.all(distances >= min_separation_m):
                chosen[index] = candidate
                break
        else:
            raise ValueError(
                f"no room for {uavs} UAVs {min_separation_m:g} m apart in {area_size_m[0]:g} m x "
                f"{area_size_m[1]:g} m"
            )
    return chosen


def deploy(
    users_m: NDArray[np.float64], parameters: Parameters, generator: np.random.Generator
) -> Deployment:
    """Phase I as configured, with the sensing error of M29 and the random start of M28.

    The choice of M41 comes after it: :func:`orchid_uav.envs.starts.balanced.balanced_start_m`.

    Takes one number from ``generator`` whatever is configured, so that the draws that follow, and
    with them the rest of the topology, are the same for every kind of start.
    """
    network = parameters.network
    seed = int(generator.integers(2**31))
    sensed_m = users_m
    if network.sensing_error_std_m > 0.0:
        error_m = np.random.default_rng([seed, SENSING_STREAM]).normal(
            0.0, network.sensing_error_std_m, users_m.shape
        )
        sensed_m = np.clip(users_m + error_m, 0.0, network.area_size_m)
    deployment = gbs_aware_kmeans(
        sensed_m,
        network.uav_count,
        parameters.gbs_positions_m,
        seed=seed,
        n_init=parameters.deployment.n_init,
    )
    if parameters.deployment.init == "random":
        start_m = random_start(
            network.uav_count,
            network.area_size_m,
            parameters.uav.min_separation_m,
            np.random.default_rng([seed, START_STREAM]),
        )
        deployment = deployment._replace(uav_positions_m=start_m)
    return deployment
