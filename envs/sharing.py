"""How a cell's bandwidth is divided among its users (Proposition 1, decision M12).

The scalar rules are what the compiled step calls with a cell's sums; the functions on a whole cell
call the same rules. Shares are fractions of the sub-band and sum to 1.
"""

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.elementary import Numeric

MAX_MIN, PROPORTIONAL, SPECTRAL_EFFICIENCY = 0, 1, 2
SHARE_RULES = {"mmf": MAX_MIN, "pf": PROPORTIONAL, "se": SPECTRAL_EFFICIENCY}
"""Codes of the rules as the compiled step knows them, by their names in the configuration."""


@register_jitable
def max_min_share(spectral_efficiency: Numeric, cell_inverse_sum: Numeric) -> Numeric:
    """Share inverse to spectral efficiency, eq. (ebg_optimal_omega): equal rates within the cell.

    ``cell_inverse_sum`` is the sum of 1 / spectral efficiency over the cell.
    """
    return 1.0 / (spectral_efficiency * cell_inverse_sum)


@register_jitable
def equal_share(cell_count: Numeric) -> Numeric:
    """1 / K_n, eq. (user_rate), which also is the maximiser of the sum of log rates (PF)."""
    return 1.0 / cell_count


@register_jitable
def efficiency_share(spectral_efficiency: Numeric, cell_sum: Numeric) -> Numeric:
    """Share in proportion to spectral efficiency: the paper's description of PF in words."""
    return spectral_efficiency / cell_sum


@register_jitable
def bandwidth_share(
    rule: Numeric,
    spectral_efficiency: Numeric,
    cell_count: Numeric,
    cell_sum: Numeric,
    cell_inverse_sum: Numeric,
) -> Numeric:
    """Share of one user under ``rule``, one of MAX_MIN, PROPORTIONAL, SPECTRAL_EFFICIENCY."""
    if rule == MAX_MIN:
        return max_min_share(spectral_efficiency, cell_inverse_sum)
    if rule == PROPORTIONAL:
        return equal_share(cell_count)
    return efficiency_share(spectral_efficiency, cell_sum)


@register_jitable
def user_rate_bps(share: Numeric, bandwidth_hz: Numeric, spectral_efficiency: Numeric) -> Numeric:
    """R_m = omega B log2(1 + gamma), Section III-D; with equal shares it is eq. (user_rate)."""
    return share * bandwidth_hz * spectral_efficiency


@register_jitable
def cell_throughput_bps(
    rule: Numeric,
    bandwidth_hz: Numeric,
    cell_count: Numeric,
    cell_sum: Numeric,
    cell_inverse_sum: Numeric,
    cell_square_sum: Numeric,
) -> Numeric:
    """Sum of the rates in a cell under ``rule``, from the sums over its spectral efficiencies.

    The harmonic mean, the mean and the mean weighted with itself, times the bandwidth.
    """
    if rule == MAX_MIN:
        return bandwidth_hz * cell_count / cell_inverse_sum
    if rule == PROPORTIONAL:
        return bandwidth_hz * cell_sum / cell_count
    return bandwidth_hz * cell_square_sum / cell_sum


@register_jitable
def cell_squared_rates(
    rule: Numeric,
    bandwidth_hz: Numeric,
    cell_count: Numeric,
    cell_sum: Numeric,
    cell_inverse_sum: Numeric,
    cell_square_sum: Numeric,
    cell_fourth_sum: Numeric,
) -> Numeric:
    """Sum of the squared rates in a cell under ``rule``, for Jain's index, from the same sums.

    ``cell_fourth_sum`` is that of the fourth powers.
    """
    if rule == MAX_MIN:
        return cell_count * (bandwidth_hz / cell_inverse_sum) ** 2
    if rule == PROPORTIONAL:
        return cell_square_sum * (bandwidth_hz / cell_count) ** 2
    return cell_fourth_sum * (bandwidth_hz / cell_sum) ** 2


def _cell(spectral_efficiency: ArrayLike) -> NDArray[np.float64]:
    cell = np.asarray(spectral_efficiency, dtype=float)
    if cell.ndim != 1 or not np.all(cell > 0.0):
        raise ValueError("a cell is one dimension of spectral efficiencies > 0 (bit/s/Hz)")
    return cell


def max_min_shares(spectral_efficiency: ArrayLike) -> NDArray[np.float64]:
    """Shares (K,) that give every user of a cell the same rate; input bit/s/Hz, (K,), > 0."""
    cell = _cell(spectral_efficiency)
    return max_min_share(cell, np.sum(1.0 / cell))


def proportional_shares(spectral_efficiency: ArrayLike) -> NDArray[np.float64]:
    """Shares (K,) that maximise the sum of log rates in a cell: all equal."""
    cell = _cell(spectral_efficiency)
    return np.full(cell.shape, equal_share(cell.size) if cell.size else 0.0)


def spectral_efficiency_shares(spectral_efficiency: ArrayLike) -> NDArray[np.float64]:
    """Shares (K,) in proportion to spectral efficiency."""
    cell = _cell(spectral_efficiency)
    return efficiency_share(cell, np.sum(cell))
