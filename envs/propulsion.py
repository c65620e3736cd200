"""Power of a rotary-wing UAV (Section III-E, Zeng et al. 2019)."""

import numpy as np
from numba.extending import register_jitable
from scipy.constants import g as standard_gravity
from scipy.optimize import minimize_scalar

from orchid_uav.envs.elementary import Numeric
from orchid_uav.envs.parameters import Parameters, RotorParameters

_TABLE_I = RotorParameters()
_BLADE_PROFILE_POWER_W = _TABLE_I.blade_profile_power_w
_INDUCED_POWER_W = _TABLE_I.induced_power_w
_TIP_SPEED_MPS = _TABLE_I.tip_speed_mps
_INDUCED_VELOCITY_MPS = _TABLE_I.induced_velocity_mps
_FUSELAGE_DRAG_RATIO = _TABLE_I.fuselage_drag_ratio
_AIR_DENSITY_KG_PER_M3 = _TABLE_I.air_density_kg_per_m3
_SOLIDITY = _TABLE_I.solidity
_DISC_AREA_M2 = _TABLE_I.disc_area_m2


@register_jitable
def propulsion_power_w(
    speed_mps: Numeric,
    blade_profile_power_w: Numeric = _BLADE_PROFILE_POWER_W,
    induced_power_w: Numeric = _INDUCED_POWER_W,
    tip_speed_mps: Numeric = _TIP_SPEED_MPS,
    induced_velocity_mps: Numeric = _INDUCED_VELOCITY_MPS,
    fuselage_drag_ratio: Numeric = _FUSELAGE_DRAG_RATIO,
    air_density_kg_per_m3: Numeric = _AIR_DENSITY_KG_PER_M3,
    solidity: Numeric = _SOLIDITY,
    disc_area_m2: Numeric = _DISC_AREA_M2,
    load_factor: Numeric = 1.0,
) -> Numeric:
    """P_prop in W at a speed of ``speed_mps`` >= 0 (the 3-D speed, decision M24).

    Blade profile, induced and parasite power. The defaults are Table I, with which hovering
    costs P_0 + P_i = 394.006 W.

    The induced factor sqrt(1 + x^2) - x, x = v^2 / (2 v_0^2), is written as its equal
    1 / (sqrt(1 + x^2) + x): the difference loses every digit at high speed, and can turn negative.

    ``load_factor`` is thrust over weight, 1 in the paper. Zeng et al. have it in the induced power,
    P_i k sqrt(sqrt(k^2 + x^2) - x), which is what banking in a turn costs.
    """
    speed_squared = speed_mps * speed_mps
    blade_w = blade_profile_power_w * (1.0 + 3.0 * speed_squared / (tip_speed_mps * tip_speed_mps))
    ratio = speed_squared / (2.0 * induced_velocity_mps * induced_velocity_mps)
    squared = load_factor * load_factor
    induced_w = (
        induced_power_w
        * load_factor
        * np.sqrt(squared / (np.sqrt(squared + ratio * ratio) + ratio))
    )
    drag = 0.5 * fuselage_drag_ratio * air_density_kg_per_m3 * solidity * disc_area_m2
    return blade_w + induced_w + drag * speed_squared * speed_mps


@register_jitable
def climb_power_w(vertical_speed_mps: Numeric, mass_kg: Numeric) -> Numeric:
    """M g max(v_z, 0), the work against gravity that the paper's formula leaves out (M24)."""
    return mass_kg * standard_gravity * np.maximum(vertical_speed_mps, 0.0)


@register_jitable
def load_factor(acceleration_mps2: Numeric) -> Numeric:
    """Thrust over weight of a rotorcraft that holds its altitude: sqrt(1 + (a / g)^2).

    1 / cos(bank angle) in a level turn. Drag, which tilts the thrust as well, is left out.
    """
    return np.sqrt(1.0 + (acceleration_mps2 / standard_gravity) ** 2)


@register_jitable
def total_power_w(propulsion_w: Numeric, transmit_w: Numeric) -> Numeric:
    """P_total = P_n + P_prop (Section III-E)."""
    return propulsion_w + transmit_w


def least_power_speed_mps(rotor: RotorParameters, max_speed_mps: float) -> float:
    """Speed in [0, ``max_speed_mps``] that needs the least propulsion power."""
    optimum = minimize_scalar(
        lambda speed: propulsion_power_w(speed, **rotor.power_curve()),
        bounds=(0.0, max_speed_mps),
        method="bounded",
        options={"xatol": 1e-9},
    )
    # The bounded search never returns an end of the interval, though the least may lie there.
    candidates = (0.0, float(optimum.x), max_speed_mps)
    return min(candidates, key=lambda speed: propulsion_power_w(speed, **rotor.power_curve()))


def circling_speed_mps(parameters: Parameters) -> float:
    """Speed of least propulsion power that the UAVs can fly in every direction."""
    uav = parameters.uav
    slowest_axis_mps = min(uav.displacement_scale_m[:2]) / parameters.network.slot_s
    return least_power_speed_mps(parameters.rotor, min(uav.max_speed_mps, slowest_axis_mps))
