"""What is not as it should be in flight: failed UAVs (M42), and what is known of users (M39)."""

import numpy as np

from orchid_uav.envs.arrays import Constants, Worlds
from orchid_uav.envs.compilation import inlined
from orchid_uav.envs.kinematics import clipped


@inlined
def fail_and_join(constants: Constants, worlds: Worlds, world: int) -> None:
    """Take UAVs out of service in the slot that is about to be judged, or back into it.

    A failed UAV stays where it is and sends with no power, so that no user is served by it.
    """
    slot = worlds.slot[world]
    for uav in range(worlds.in_service.shape[1]):
        is_out = False
        for row in range(len(constants.outages)):
            failed, first, end = constants.outages[row]
            is_out = is_out or (failed == uav and first <= slot < end)
        if is_out:
            worlds.transmit_powers_w[world, uav] = 0.0
            worlds.velocities_mps[world, uav] = 0.0
            worlds.station_velocities_mps[world, uav] = 0.0
        elif not worlds.in_service[world, uav]:
            worlds.transmit_powers_w[world, uav] = constants.start_power_w
        worlds.in_service[world, uav] = not is_out


@inlined
def sense_users(constants: Constants, worlds: Worlds, world: int) -> None:
    """Remember where the users are, and tell what UAVs know of it: later, and with an error."""
    ring, slot = worlds.past_users[world], worlds.slot[world]
    coordinates_m, velocities_mps = (
        worlds.user_coordinates_m[world],
        worlds.user_velocities_mps[world],
    )
    error_m = worlds.sensing_error_m[world]
    newest = slot % len(ring)
    seen = max(slot - constants.delay_slots, 0) % len(ring)
    for axis in range(2):
        for user in range(coordinates_m.shape[1]):
            ring[newest, axis, user] = coordinates_m[axis, user]
            ring[newest, 2 + axis, user] = velocities_mps[axis, user]
    for axis in range(2):
        for user in range(coordinates_m.shape[1]):
            worlds.known_coordinates_m[world, axis, user] = clipped(
                ring[seen, axis, user] + error_m[axis, user], 0.0, constants.area_size_m[axis]
            )
            worlds.known_velocities_mps[world, axis, user] = ring[seen, 2 + axis, user]
    known_m = worlds.known_coordinates_m[world]
    for uav in range(worlds.positions_m.shape[1]):
        x_m, y_m = worlds.positions_m[world, uav, 0], worlds.positions_m[world, uav, 1]
        least_m2 = np.inf
        for user in range(known_m.shape[1]):
            dx, dy = known_m[0, user] - x_m, known_m[1, user] - y_m
            least_m2 = min(least_m2, dx * dx + dy * dy)
        worlds.nearest_user_m[world, uav] = np.sqrt(least_m2)
