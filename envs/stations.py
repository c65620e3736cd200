"""Station flight: an action moves the place that a UAV's autopilot circles (decision M38).

Stations keep their spacing because each stays inside its own buffered Voronoi cell: of the line
between two stations, either may use up half of what they have more than the spacing. Zhou, Wang,
Bandyopadhyay, Schwager: Fast, on-line collision avoidance for dynamic vehicles using buffered
Voronoi cells (2017).
"""

import numpy as np

from orchid_uav.envs.arrays import Constants, Floats, Worlds
from orchid_uav.envs.compilation import inlined
from orchid_uav.envs.kinematics import circling_displacement_m, clipped, displacement_factor
from orchid_uav.envs.knowledge.outages import NEVER
from orchid_uav.envs.units import SMALLEST_NORMAL


@inlined
def move_stations(constants: Constants, worlds: Worlds, world: int, actions: Floats) -> None:
    """Set how the stations of one world move in a slot, from the actions' first two numbers.

    The autopilot then moves with them, and :func:`settle_stations` moves them themselves.
    """
    stations_m, velocities_mps = worlds.stations_m[world], worlds.station_velocities_mps[world]
    limit_mps, kept = constants.station_speed_limit_mps, constants.station_smoothing
    uavs = len(stations_m)
    for uav in range(uavs):
        east_mps = clipped(actions[uav, 0], -1.0, 1.0) * limit_mps
        north_mps = clipped(actions[uav, 1], -1.0, 1.0) * limit_mps
        speed_mps = np.sqrt(east_mps * east_mps + north_mps * north_mps)
        factor = displacement_factor(speed_mps, max(limit_mps, SMALLEST_NORMAL))
        velocity = velocities_mps[uav]
        velocity[0] = kept * velocity[0] + (1.0 - kept) * east_mps * factor
        velocity[1] = kept * velocity[1] + (1.0 - kept) * north_mps * factor
        if not worlds.in_service[world, uav]:
            velocity[0], velocity[1] = 0.0, 0.0
    for uav in range(uavs):
        # All move at once: nobody's new place depends on another's.
        _restrain(constants, worlds, world, uav)


@inlined
def settle_stations(constants: Constants, worlds: Worlds, world: int) -> None:
    """Move the stations of one world on by a slot."""
    stations_m, velocities_mps = worlds.stations_m[world], worlds.station_velocities_mps[world]
    margin_m = constants.circle_radius_m
    for uav in range(len(stations_m)):
        for axis in range(2):
            # A place inside and a move inside may add up to beyond by a rounding error.
            stations_m[uav, axis] = clipped(
                stations_m[uav, axis] + velocities_mps[uav, axis] * constants.slot_s,
                margin_m,
                constants.area_size_m[axis] - margin_m,
            )


@inlined
def _restrain(constants: Constants, worlds: Worlds, world: int, uav: int) -> None:
    """Change the velocity of a station so that it stays in its cell and in the area."""
    stations_m, velocity = worlds.stations_m[world], worlds.station_velocities_mps[world, uav]
    slot_s, margin_m = constants.slot_s, constants.circle_radius_m
    dx, dy = velocity[0] * slot_s, velocity[1] * slot_s
    x_m, y_m = stations_m[uav]
    # First slide along the borders of the cell, then along those of the area …
    for other in range(len(stations_m)):
        slack_m, east, north = _slack(constants, worlds, world, uav, other)
        excess_m = max(dx * east + dy * north - slack_m, 0.0)
        dx, dy = dx - excess_m * east, dy - excess_m * north
    east_m, north_m = constants.area_size_m
    dx = clipped(dx, margin_m - x_m, east_m - margin_m - x_m)
    dy = clipped(dy, margin_m - y_m, north_m - margin_m - y_m)
    # … and where that led over another border, stop there.
    share = 1.0
    for other in range(len(stations_m)):
        slack_m, east, north = _slack(constants, worlds, world, uav, other)
        along_m = dx * east + dy * north
        if along_m * share > slack_m:
            share = slack_m / along_m
    velocity[0], velocity[1] = dx * share / slot_s, dy * share / slot_s


@inlined
def _slack(
    constants: Constants, worlds: Worlds, world: int, uav: int, other: int
) -> tuple[float, float, float]:
    """How far in m a station may move towards another, and the direction in which that is."""
    if other == uav or not (
        worlds.in_service[world, other] or _returns(constants, other, worlds.slot[world])
    ):
        return np.inf, 0.0, 0.0
    east_m = worlds.stations_m[world, other, 0] - worlds.stations_m[world, uav, 0]
    north_m = worlds.stations_m[world, other, 1] - worlds.stations_m[world, uav, 1]
    distance_m = np.sqrt(east_m * east_m + north_m * north_m)
    if distance_m < SMALLEST_NORMAL:  # only where no spacing is wanted
        return np.inf, 0.0, 0.0
    slack_m = max(0.5 * (distance_m - constants.centre_spacing_m), 0.0)
    return slack_m, east_m / distance_m, north_m / distance_m


@inlined
def _returns(constants: Constants, uav: int, slot: int) -> bool:
    """Whether a UAV that is not in service joins later, and so needs its place."""
    outages = constants.outages
    for row in range(len(outages)):
        if outages[row, 0] == uav and outages[row, 1] <= slot < outages[row, 2]:
            return outages[row, 2] < NEVER
    return False


@inlined
def autopilot_displacement_m(
    constants: Constants, worlds: Worlds, world: int, uav: int, climb_action: float
) -> tuple[float, float, float]:
    """Move of a UAV in a slot, before its station has moved: with it and round it.

    The horizontal move comes first; the climb gets what it leaves of V_max.
    """
    velocity = worlds.station_velocities_mps[world, uav]
    position_m, station_m = worlds.positions_m[world, uav], worlds.stations_m[world, uav]
    dx, dy = circling_displacement_m(
        position_m[0] - station_m[0] - velocity[0] * constants.slot_s,
        position_m[1] - station_m[1] - velocity[1] * constants.slot_s,
        constants.circle_radius_m,
        *constants.circle_chord,
    )
    scale_x_m, scale_y_m, scale_z_m = constants.displacement_scale_m
    dx = clipped(dx, -scale_x_m, scale_x_m)
    dy = clipped(dy, -scale_y_m, scale_y_m)
    longest_m = constants.max_displacement_m
    factor = displacement_factor(np.sqrt(dx * dx + dy * dy), longest_m)
    dx, dy = dx * factor, dy * factor
    if constants.station_altitude_m > 0.0:
        climb_m = clipped(constants.station_altitude_m - position_m[2], -scale_z_m, scale_z_m)
    else:
        climb_m = climb_action * scale_z_m
    left_m = np.sqrt(max(longest_m * longest_m - dx * dx - dy * dy, 0.0))
    return dx, dy, clipped(climb_m, -left_m, left_m)
