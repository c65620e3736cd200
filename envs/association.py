"""Which UAV each user receives best, without looking at most of the links (Section III-D).

Users are taken in tiles, whose links to all UAVs stay in the processor's cache. The loops over the
users of a tile are written so that they vectorise: no branches, and no indices but the loop's.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.channel import (
    LOSS_ALLOWS_PRUNING,
    air_to_ground_gain,
    received_power_w,
)
from orchid_uav.envs.compilation import inlined
from orchid_uav.envs.elementary import bits_of, number_of

TILE_USERS = 256
"""Users of a tile: with 200 UAVs their squared distances take 400 kB."""

Integers = NDArray[np.int64]
_TOGETHER = 8
"""Numbers that a processor computes at once, at most."""
_INFINITY_BITS = 0x7FF0000000000000


class Scratch(NamedTuple):
    """Memory for one world, and one tile of its users, at a time; N UAVs, T users."""

    cell_sum: Floats
    """Sum of the spectral efficiencies of a UAV's users, (N,), and of their inverses."""
    cell_inverse_sum: Floats

    distance_squared_m2: Floats
    """Of every UAV and user in 3-D, (N, T)."""
    near_distance_squared_m2: Floats
    """Of the nearest UAV by transmit power over squared distance, (T,), as the two that follow."""
    near_altitude_m: Floats
    near_power_w: Floats
    rivals: Floats
    """Number of UAVs that might be received better than the nearest, (T,)."""
    rival_uav: Integers
    """UAV of such a link, (N T,) at most, as what follows of it."""
    rival_user: Integers
    rival_distance_squared_m2: Floats
    rival_altitude_m: Floats
    rival_power_w: Floats


@register_jitable
def make_scratch(uavs: int, users: int) -> Scratch:
    """Memory for worlds of so many UAVs and users."""
    tile = min(users, TILE_USERS)
    links = uavs * tile + _TOGETHER
    return Scratch(
        np.empty(uavs),
        np.empty(uavs),
        np.empty((uavs, tile)),
        np.empty(tile),
        np.empty(tile),
        np.empty(tile),
        np.empty(tile),
        np.empty(links, np.int64),
        np.empty(links, np.int64),
        np.empty(links),
        np.empty(links),
        np.empty(links),
    )


@inlined
def associate(
    positions_m: Floats,
    powers_w: Floats,
    user_coordinates_m: Floats,
    target_users: NDArray[np.bool_],
    link: tuple[float, ...],
    antenna_gain_db: float,
    best_case_gain_m2: float,
    scratch: Scratch,
    nearest_user_m: Floats,
    strongest: Integers,
    strongest_power_w: Floats,
    own_path_loss_db: Callable[..., float] | None = None,
) -> None:
    """The UAV that each user receives best, the first of equals, and the received power.

    Args:
        positions_m: UAVs, (N, 3).
        powers_w: transmit powers, (N,).
        user_coordinates_m: x of all users, then y, (2, M).
        target_users: (M,); for the others the power means nothing.
        link: arguments of ``air_to_ground_path_loss_db`` after distance and altitude.
        antenna_gain_db: of both antennas.
        best_case_gain_m2: received over transmitted power with a line of sight, times distance².
        scratch: of :func:`make_scratch`.
        nearest_user_m: result, each UAV's horizontal distance to the nearest user, (N,).
        strongest: result, (M,).
        strongest_power_w: result in W, (M,).
        own_path_loss_db: used instead of ``air_to_ground_path_loss_db``, for every link.
    """
    nearest_user_m[:] = np.inf
    for first in range(0, len(strongest), TILE_USERS):
        last = min(first + TILE_USERS, len(strongest))
        _measure_distances(positions_m, user_coordinates_m[:, first:last], scratch, nearest_user_m)
        _find_strongest(
            positions_m,
            powers_w,
            target_users[first:last],
            link,
            antenna_gain_db,
            best_case_gain_m2,
            scratch,
            strongest[first:last],
            strongest_power_w[first:last],
            own_path_loss_db,
        )
    for uav in range(len(nearest_user_m)):
        nearest_user_m[uav] = np.sqrt(nearest_user_m[uav])


@inlined
def _measure_distances(
    positions_m: Floats, user_coordinates_m: Floats, scratch: Scratch, nearest_squared_m2: Floats
) -> None:
    """Squared distances of a tile, and the least horizontal ones so far."""
    for uav in range(len(positions_m)):
        x_m, y_m, altitude_m = positions_m[uav]
        row = scratch.distance_squared_m2[uav]
        # Numbers >= 0 are ordered as their bits are, and the least of whole numbers vectorises.
        least = _INFINITY_BITS
        for user in range(user_coordinates_m.shape[1]):
            dx, dy = user_coordinates_m[0, user] - x_m, user_coordinates_m[1, user] - y_m
            squared = dx * dx + dy * dy
            least = min(least, bits_of(squared))
            row[user] = squared + altitude_m * altitude_m
        nearest_squared_m2[uav] = min(nearest_squared_m2[uav], number_of(least))


@inlined
def _find_strongest(
    positions_m: Floats,
    powers_w: Floats,
    target_users: NDArray[np.bool_],
    link: tuple[float, ...],
    antenna_gain_db: float,
    best_case_gain_m2: float,
    scratch: Scratch,
    strongest: Integers,
    strongest_power_w: Floats,
    own_path_loss_db: Callable[..., float] | None,
) -> None:
    """The strongest UAV of each user of a tile.

    Begins with the nearest UAV (power over squared distance). Most others cannot be received
    better: because they are also seen no higher, or because even with a line of sight they would be
    weaker. No logarithm or exponential is taken for these.
    """
    uavs, users = len(positions_m), len(strongest)
    distance_squared_m2 = scratch.distance_squared_m2
    near_distance_squared_m2 = scratch.near_distance_squared_m2
    near_altitude_m, near_power_w = scratch.near_altitude_m, scratch.near_power_w
    # First the nearest UAV of each user, the strongest of most. This computes no link.
    for user in range(users):
        strongest[user] = 0
        near_distance_squared_m2[user] = distance_squared_m2[0, user]
        near_altitude_m[user], near_power_w[user] = positions_m[0, 2], powers_w[0]
    for uav in range(1, uavs):
        row, altitude_m, power_w = distance_squared_m2[uav], positions_m[uav, 2], powers_w[uav]
        for user in range(users):
            near_m2, near_w = near_distance_squared_m2[user], near_power_w[user]
            is_nearer = power_w * near_m2 > near_w * row[user]
            near_distance_squared_m2[user] = row[user] if is_nearer else near_m2
            near_power_w[user] = power_w if is_nearer else near_w
            near_altitude_m[user] = altitude_m if is_nearer else near_altitude_m[user]
            strongest[user] = uav if is_nearer else strongest[user]
    for user in range(users):
        strongest_power_w[user] = link_power_w(
            near_power_w[user],
            near_distance_squared_m2[user],
            near_altitude_m[user],
            link,
            antenna_gain_db,
            own_path_loss_db,
        )
    count = _find_rivals(
        positions_m,
        powers_w,
        target_users,
        best_case_gain_m2,
        scratch,
        strongest_power_w,
        own_path_loss_db is not None or not LOSS_ALLOWS_PRUNING,
    )
    received_w = scratch.rival_power_w  # the same memory, from transmitted to received
    for rival in range((count + _TOGETHER - 1) // _TOGETHER * _TOGETHER):
        received_w[rival] = link_power_w(
            scratch.rival_power_w[rival],
            scratch.rival_distance_squared_m2[rival],
            scratch.rival_altitude_m[rival],
            link,
            antenna_gain_db,
            own_path_loss_db,
        )
    for rival in range(count):
        uav, user = scratch.rival_uav[rival], scratch.rival_user[rival]
        best_w = strongest_power_w[user]
        if received_w[rival] > best_w or (received_w[rival] == best_w and uav < strongest[user]):
            strongest[user], strongest_power_w[user] = uav, received_w[rival]


@inlined
def _find_rivals(
    positions_m: Floats,
    powers_w: Floats,
    target_users: NDArray[np.bool_],
    best_case_gain_m2: float,
    scratch: Scratch,
    near_received_w: Floats,
    all_are: bool,
) -> int:
    """List the links that might be stronger than that of the nearest UAV; return their number."""
    rivals = scratch.rivals
    uavs, users = len(positions_m), len(near_received_w)
    rivals[:users] = uavs if all_are else 0.0
    if not all_are:
        for uav in range(uavs):
            row, altitude_m = scratch.distance_squared_m2[uav], positions_m[uav, 2]
            best_case_w_m2 = powers_w[uav] * best_case_gain_m2
            for user in range(users):
                rivals[user] += (
                    1.0
                    if _may_be_stronger(
                        row[user],
                        altitude_m,
                        best_case_w_m2,
                        scratch.near_distance_squared_m2[user],
                        scratch.near_altitude_m[user],
                        near_received_w[user],
                    )
                    else 0.0
                )
    count = 0
    for user in range(users):
        if rivals[user] > 0.0 and target_users[user]:
            for uav in range(uavs):
                distance_squared_m2 = scratch.distance_squared_m2[uav, user]
                if all_are or _may_be_stronger(
                    distance_squared_m2,
                    positions_m[uav, 2],
                    powers_w[uav] * best_case_gain_m2,
                    scratch.near_distance_squared_m2[user],
                    scratch.near_altitude_m[user],
                    near_received_w[user],
                ):
                    scratch.rival_uav[count], scratch.rival_user[count] = uav, user
                    scratch.rival_distance_squared_m2[count] = distance_squared_m2
                    scratch.rival_altitude_m[count] = positions_m[uav, 2]
                    scratch.rival_power_w[count] = powers_w[uav]
                    count += 1
    # A few links are computed as fast as one if as many follow as are computed together.
    for rest in range(count, count + _TOGETHER):
        scratch.rival_distance_squared_m2[rest] = scratch.rival_altitude_m[rest] = 1.0
        scratch.rival_power_w[rest] = 0.0
    return count


@inlined
def _may_be_stronger(
    distance_squared_m2: float,
    altitude_m: float,
    best_case_w_m2: float,
    near_distance_squared_m2: float,
    near_altitude_m: float,
    near_received_w: float,
) -> bool:
    """Whether a UAV can be received better than one that is nearer (power over squared distance).

    The loss grows with distance and falls with elevation, so it has to be seen higher (the sine of
    the elevation is altitude over distance, compared in squares and without division), and it has
    to be stronger with a certain line of sight, which no link exceeds.
    """
    is_higher = (
        altitude_m * altitude_m * near_distance_squared_m2
        > near_altitude_m * near_altitude_m * distance_squared_m2
    )
    return is_higher & (best_case_w_m2 >= near_received_w * distance_squared_m2)


@inlined
def link_power_w(
    transmit_power_w: float,
    distance_squared_m2: float,
    altitude_m: float,
    link: tuple[float, ...],
    antenna_gain_db: float,
    own_path_loss_db: Callable[..., float] | None = None,
) -> float:
    """Power in W that a user receives over one access link, from squared 3-D distance in m²."""
    if own_path_loss_db is None:  # decided when compiled, as it is the argument's type
        gain = air_to_ground_gain(np.sqrt(distance_squared_m2), altitude_m, *link)
        return received_power_w(transmit_power_w * gain, antenna_gain_db, 0.0)
    ground_m = np.sqrt(max(distance_squared_m2 - altitude_m * altitude_m, 0.0))
    path_loss_db = own_path_loss_db(ground_m, altitude_m, *link)
    return received_power_w(transmit_power_w, antenna_gain_db, path_loss_db)
