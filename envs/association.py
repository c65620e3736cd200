"""Which UAV each user receives best, without looking at most of the links (Section III-D).

The loops over users are written so that they vectorise: no branches, no indices that are not the
loop's, and numbers of UAVs kept as floats.
"""

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.channel import (
    LOSS_ALLOWS_PRUNING,
    air_to_ground_path_loss_db,
    received_power_w,
)


@njit(error_model="numpy")
def measure_distances(
    positions_m: Floats,
    user_coordinates_m: Floats,
    distance_squared_m2: Floats,
    nearest_user_m: Floats,
) -> None:
    """Squared 3-D distance of every UAV and user, and each UAV's horizontally nearest user.

    Args:
        positions_m: UAVs, (N, 3).
        user_coordinates_m: x of all users, then y, (2, M).
        distance_squared_m2: result, (N, M).
        nearest_user_m: result, (N,).
    """
    uavs, users = distance_squared_m2.shape
    for uav in range(uavs):
        x_m, y_m, altitude_m = positions_m[uav]
        row = distance_squared_m2[uav]
        for user in range(users):
            dx, dy = user_coordinates_m[0, user] - x_m, user_coordinates_m[1, user] - y_m
            row[user] = dx * dx + dy * dy
        nearest = np.inf
        for user in range(users):
            nearest = min(nearest, row[user])
        nearest_user_m[uav] = np.sqrt(nearest)
        for user in range(users):
            row[user] += altitude_m * altitude_m


@njit(error_model="numpy")
def find_strongest(
    positions_m: Floats,
    powers_w: Floats,
    target_users: NDArray[np.bool_],
    distance_squared_m2: Floats,
    link: tuple[float, ...],
    antenna_gain_db: float,
    best_case_gain_m2: float,
    strongest: Floats,
    strongest_power_w: Floats,
    own_path_loss_db: Callable[..., float] | None = None,
) -> None:
    """The UAV that each target user receives best, the first of equals, and the received power.

    Begins with the nearest UAV (power over squared distance) and leaves out every other that cannot
    be received better, before any logarithm or exponential is taken for it: because it is also seen
    no higher, or because even with a line of sight it would be weaker.

    Args:
        positions_m: (N, 3).
        powers_w: transmit powers, (N,).
        target_users: (M,); for the others no power is computed.
        distance_squared_m2: (N, M).
        link: arguments of ``air_to_ground_path_loss_db`` after distance and altitude.
        antenna_gain_db: of both antennas.
        best_case_gain_m2: received over transmitted power with a line of sight, times distance².
        strongest: result, (M,).
        strongest_power_w: result in W, (M,); infinite for users that are no targets.
        own_path_loss_db: used instead of ``air_to_ground_path_loss_db``, for every link.
    """
    uavs, users = distance_squared_m2.shape
    # First pass: the nearest UAV of each user, the strongest of most. It computes no link.
    near_distance_squared, near_altitude_squared = np.empty(users), np.empty(users)
    nearness = strongest_power_w  # the same memory: it is not needed any more once powers come
    nearness[:] = -1.0
    for uav in range(uavs):
        row, power_w, index = distance_squared_m2[uav], powers_w[uav], float(uav)
        altitude_squared = positions_m[uav, 2] * positions_m[uav, 2]
        for user in range(users):
            ratio = power_w / row[user]
            is_nearer = ratio > nearness[user]
            nearness[user] = ratio if is_nearer else nearness[user]
            strongest[user] = index if is_nearer else strongest[user]
            near_distance_squared[user] = row[user] if is_nearer else near_distance_squared[user]
            near_altitude_squared[user] = (
                altitude_squared if is_nearer else near_altitude_squared[user]
            )
    # Second pass: what it is received with. Infinity lets no UAV be stronger for other users.
    for user in range(users):
        strongest_power_w[user] = np.inf
        if target_users[user]:
            uav = int(strongest[user])
            strongest_power_w[user] = link_power_w(
                powers_w[uav],
                near_distance_squared[user],
                positions_m[uav, 2],
                link,
                antenna_gain_db,
                own_path_loss_db,
            )

    # Third pass: the other UAVs, but only links that can be stronger. The loss grows with distance
    # and falls with elevation, so a farther UAV has to be seen higher (the sine of the elevation is
    # altitude over distance, compared in squares and without division), and it has to be stronger
    # with a certain line of sight, which no link exceeds.
    evaluates_all = own_path_loss_db is not None or not LOSS_ALLOWS_PRUNING
    may_be_stronger = np.empty(users, np.bool_)
    for uav in range(uavs):
        row, power_w, altitude_m = distance_squared_m2[uav], powers_w[uav], positions_m[uav, 2]
        best_case_w_m2 = power_w * best_case_gain_m2
        altitude_squared = altitude_m * altitude_m
        for user in range(users):
            is_higher = (
                altitude_squared * near_distance_squared[user]
                > near_altitude_squared[user] * row[user]
            )
            can_reach = best_case_w_m2 >= strongest_power_w[user] * row[user]
            may_be_stronger[user] = (is_higher & can_reach) | evaluates_all
        for user in range(users):
            if may_be_stronger[user]:
                received_w = link_power_w(
                    power_w, row[user], altitude_m, link, antenna_gain_db, own_path_loss_db
                )
                best_w = strongest_power_w[user]
                if received_w > best_w or (received_w == best_w and uav < strongest[user]):
                    strongest[user], strongest_power_w[user] = float(uav), received_w


@njit(error_model="numpy")
def link_power_w(
    transmit_power_w: float,
    distance_squared_m2: float,
    altitude_m: float,
    link: tuple[float, ...],
    antenna_gain_db: float,
    own_path_loss_db: Callable[..., float] | None = None,
) -> float:
    """Power in W that a user receives over one access link, from squared 3-D distance in m²."""
    ground_m = np.sqrt(max(distance_squared_m2 - altitude_m * altitude_m, 0.0))
    if own_path_loss_db is None:  # decided when compiled, as it is the argument's type
        path_loss_db = air_to_ground_path_loss_db(ground_m, altitude_m, *link)
    else:
        path_loss_db = own_path_loss_db(ground_m, altitude_m, *link)
    return received_power_w(transmit_power_w, antenna_gain_db, path_loss_db)
