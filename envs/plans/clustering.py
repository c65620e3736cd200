"""K-Means of people who may count as several."""

import warnings

import numpy as np
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning

from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.deployment import scikit_learn_threads


def weighted_centroids(positions_m: Floats, weights: Floats, clusters: int, seed: int) -> Floats:
    """Centroids (clusters, 2) of one K-Means++ run over weighted positions (P, 2).

    Where there are fewer places than clusters, some centroids coincide. The heaviest cluster comes
    first.
    """
    if len(positions_m) < clusters:
        positions_m = np.resize(positions_m, (clusters, 2))
        weights = np.resize(weights, clusters)
    clustering = KMeans(clusters, init="k-means++", n_init=1, random_state=seed)
    with warnings.catch_warnings(), scikit_learn_threads().limit(limits=1, user_api="openmp"):
        warnings.simplefilter("ignore", ConvergenceWarning)  # fewer places than clusters
        clustering.fit(positions_m, sample_weight=weights)
    centroids_m: Floats = clustering.cluster_centers_
    labels = clustering.labels_
    for cluster in np.unique(labels):  # the others' centroids may lie nowhere
        members = labels == cluster
        centroids_m[cluster] = np.average(positions_m[members], axis=0, weights=weights[members])
    loads = np.bincount(labels, weights, minlength=clusters)
    empty = loads == 0.0
    centroids_m[empty] = centroids_m[loads.argmax()]
    return centroids_m[np.argsort(-loads, kind="stable")]
