"""Where the ground users are, and how they walk (Section III-A; decisions M6 and M16)."""

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.elementary import Numeric
from orchid_uav.envs.parameters import NetworkParameters, Parameters

Positions = NDArray[np.float64]


def draw_user_positions(network: NetworkParameters, generator: np.random.Generator) -> Positions:
    """Positions (M, 2) in m of one topology, drawn from ``network.distribution``."""
    if network.distribution == "uniform":
        return generator.uniform(0.0, network.area_size_m, (network.user_count, 2))
    return thomas_cluster_process(
        network.user_count,
        network.hotspot_count,
        network.scatter_std_m,
        network.area_size_m,
        generator,
    )


def thomas_cluster_process(
    user_count: int,
    hotspot_count: int,
    scatter_std_m: float,
    area_size_m: tuple[float, float],
    generator: np.random.Generator,
) -> Positions:
    """A Thomas process with its numbers of parents and of users given (decision M6).

    Parents are uniform over the area, every user belongs to a parent drawn uniformly and lies
    around it with a Gaussian offset; a point outside the area is reflected back in.

    Returns:
        Positions (M, 2) in m.
    """
    parents = generator.uniform(0.0, area_size_m, (hotspot_count, 2))
    parent_of_user = generator.integers(hotspot_count, size=user_count)
    offsets = generator.normal(0.0, scatter_std_m, (user_count, 2))
    return reflect_into(parents[parent_of_user] + offsets, np.array(area_size_m))


def check_user_positions(positions_m: ArrayLike, parameters: Parameters) -> Positions:
    """The caller's own positions as an array (M, 2), or a ValueError that says what is wrong."""
    positions = np.array(positions_m, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 2:
        raise ValueError(f"user positions have shape {positions.shape}, not (users, 2)")
    uavs, masts = parameters.network.uav_count, len(parameters.gbs_positions_m)
    if len(positions) < uavs + masts:
        raise ValueError(
            f"{len(positions)} user positions for {uavs} UAVs and {masts} masts: at least "
            f"{uavs + masts} are needed"
        )
    east_m, north_m = parameters.network.area_size_m
    bad = ~np.all((positions >= 0.0) & (positions <= (east_m, north_m)), axis=1)
    if bad.any():  # NaN compares false, so it is bad too
        first = int(np.argmax(bad))
        raise ValueError(
            f"user {first} is at ({positions[first, 0]:g}, {positions[first, 1]:g}) m, outside the "
            f"area of 0..{east_m:g} x 0..{north_m:g} m ({int(bad.sum())} such users)"
        )
    return positions


@register_jitable
def reflect_into(coordinate_m: Numeric, side_m: Numeric) -> Numeric:
    """Fold a coordinate back into [0, ``side_m``] by reflection at both borders, however far."""
    folded = coordinate_m % (2.0 * side_m)
    return side_m - np.abs(side_m - folded)


@register_jitable
def reflection_sign(coordinate_m: Numeric, side_m: Numeric) -> Numeric:
    """-1 where :func:`reflect_into` turns the direction of travel round, else 1."""
    return 1.0 - 2.0 * (np.floor(coordinate_m / side_m) % 2.0)


_GOLDEN_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MULTIPLIER_1 = np.uint64(0xBF58476D1CE4E5B9)
_MULTIPLIER_2 = np.uint64(0x94D049BB133111EB)
_SHIFT_1, _SHIFT_2, _SHIFT_3 = np.uint64(30), np.uint64(27), np.uint64(31)
_MANTISSA_SHIFT = np.uint64(11)
_ULP = 2.0**-53


@register_jitable
def counter_uniform(key: Numeric, counter: Numeric) -> Numeric:
    """Number ``counter`` of the SplitMix64 sequence seeded with ``key``, as uniform in [0, 1).

    Steele, Lea, Flood: Fast splittable pseudorandom number generators (2014). Both arguments are
    uint64. Stateless, hence a world's walk depends on its key and the slot alone, and many worlds
    draw at once without one generator object each.
    """
    mixed = key + (counter + np.uint64(1)) * _GOLDEN_GAMMA
    mixed = (mixed ^ (mixed >> _SHIFT_1)) * _MULTIPLIER_1
    mixed = (mixed ^ (mixed >> _SHIFT_2)) * _MULTIPLIER_2
    return ((mixed ^ (mixed >> _SHIFT_3)) >> _MANTISSA_SHIFT) * _ULP
