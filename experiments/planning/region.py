"""Where the centres of circles may be, so that drones break no limit wherever they circle."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry

from orchid_uav.envs.channel import backhaul_snr
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.units import dbm_to_watt, linear_to_decibel
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Floats, Mast, Surroundings

_QUARTER_SEGMENTS = 16
"""Of the corners of buffers."""
ROOM_FOR_ERRORS_M = 5.0
"""Kept from every border: what a drone's position may be wrong by before it trips the fence."""
_FARTHEST_M = 1e6


@dataclass(frozen=True)
class Region:
    """Centres of circles of one radius, and how far apart they have to be."""

    allowed: BaseGeometry
    """Polygons in the site's metres."""
    spacing_m: float
    """Least distance of two centres."""
    lowest_m: float
    highest_m: float

    def contains(self, points_m: Floats) -> NDArray[np.bool_]:
        """Whether a centre may be at points (C, 2), other drones aside."""
        inside: NDArray[np.bool_] = shapely.intersects_xy(
            self.allowed, points_m[:, 0], points_m[:, 1]
        )
        return inside

    def nearest(self, points_m: Floats) -> Floats:
        """The allowed places nearest to points, (..., 2)."""
        places_m = points_m.reshape(-1, 2).copy()
        outside = ~self.contains(places_m)
        if outside.any():
            lines = shapely.shortest_line(self.allowed, shapely.points(places_m[outside]))
            places_m[outside] = shapely.get_coordinates(lines)[::2]
        return places_m.reshape(points_m.shape)


def region_of(surroundings: Surroundings, circle_radius_m: float, parameters: Parameters) -> Region:
    """Where drones that circle with this radius may have their centres.

    Their circles lie inside the area and outside of no-fly zones, and near enough to a mast for
    the backhaul, if there is one.

    Raises:
        InputError: that is nowhere.
    """
    margin_m = circle_radius_m + ROOM_FOR_ERRORS_M
    # A round corner of a buffer's polygon lies inside the true one by up to this factor.
    outwards_m = margin_m / math.cos(math.pi / (4 * _QUARTER_SEGMENTS))
    inside = surroundings.area.buffer(-outwards_m, _QUARTER_SEGMENTS)
    if inside.is_empty:
        raise InputError(
            f"the area has no room for circles of {circle_radius_m:g} m radius; a larger --area, "
            "or --hover for drones that stand still in the air"
        )
    allowed = inside.difference(surroundings.no_fly.buffer(outwards_m, _QUARTER_SEGMENTS))
    if allowed.is_empty:
        raise InputError(
            f"the no-fly zones leave no place in the area for a circle of {circle_radius_m:g} m "
            "radius; smaller zones, or a larger --area"
        )
    if surroundings.masts:
        reach = shapely.union_all(
            [_within_reach(mast, surroundings, margin_m, parameters) for mast in surroundings.masts]
        )
        near = allowed.intersection(reach)
        if near.is_empty:
            raise InputError(
                "no mast is near enough to any place where drones may be: their link to it needs "
                f"{parameters.channel.backhaul_required_snr_db:g} dB "
                "(channel.backhaul_required_snr_db); without --mast, drones need no such link"
            )
        allowed = near
    shapely.prepare(allowed)
    return Region(
        allowed,
        2.0 * circle_radius_m + surroundings.clearance_m,
        surroundings.lowest_m,
        surroundings.highest_m,
    )


def _within_reach(
    mast: Mast, surroundings: Surroundings, margin_m: float, parameters: Parameters
) -> BaseGeometry:
    """Where all of a circle is near enough to a mast, from any altitude of the corridor."""
    climb_m = max(
        abs(altitude_m - mast.height_m)
        for altitude_m in (surroundings.lowest_m, surroundings.highest_m)
    )
    reach_m = _backhaul_reach_m(parameters)
    flat_m = math.sqrt(max(reach_m**2 - climb_m**2, 0.0)) - margin_m
    if flat_m <= 0.0:
        return Point()
    return Point(mast.east_m, mast.north_m).buffer(min(flat_m, _FARTHEST_M), 64)


def _backhaul_reach_m(parameters: Parameters) -> float:
    """Distance at which a link to a mast has just the SNR that the backhaul needs."""
    at_1_m_db = backhaul_snr_db(parameters, 1.0)
    spare_db = at_1_m_db - parameters.channel.backhaul_required_snr_db
    return float(10.0 ** (spare_db / 20.0))  # free space


def backhaul_snr_db(parameters: Parameters, distance_m: float) -> float:
    """SNR in dB of a drone's link to a mast (Section III-C3)."""
    channel = parameters.channel
    snr = backhaul_snr(
        distance_m,
        float(dbm_to_watt(parameters.gbs.transmit_power_dbm)),
        channel.backhaul_gain_db,
        channel.carrier_frequency_hz,
        channel.noise_power_w(channel.backhaul_bandwidth_hz),
    )
    return float(linear_to_decibel(snr))
