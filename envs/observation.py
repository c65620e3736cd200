"""What a UAV sees and what the critic sees besides (Section IV-C1; decisions M18 and M19)."""

from orchid_uav.envs.arrays import HISTOGRAM_CELLS, Constants, Worlds
from orchid_uav.envs.compilation import inlined
from orchid_uav.envs.kinematics import relative
from orchid_uav.envs.metrics import RATE_JFI

BACKHAUL_SCALE_DB = 40.0
"""The backhaul SNR above its threshold is divided by this (M18)."""

OBSERVATION_NAMES = (
    "x / D",
    "y / D",
    "altitude within the flight box",
    "transmit power within its range",
    "horizontal distance to the nearest user / D",
    "served users / M",
    "margin to x = 0",
    "margin to x = D",
    "margin to y = 0",
    "margin to y = D",
    "margin to the lowest altitude",
    "margin to the highest altitude",
    "share of past slots with a collision",
    "share of past slots with a boundary violation",
    "share of past slots with a weak backhaul",
    "backhaul SNR above its threshold / 40 dB",
)
"""What the numbers of an observation are, in their order. Margins are divided by the extent of the
flight box along their axis. D is the side of the area along the axis, for distances the longer."""


@inlined
def count_users(constants: Constants, worlds: Worlds, world: int) -> None:
    """u_dist: the users' histogram, normalised to sum 1, into its place in the state (M19)."""
    uavs, users = worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2]
    first = uavs * worlds.observations.shape[2]
    histogram = worlds.states[world, first : first + HISTOGRAM_CELLS * HISTOGRAM_CELLS]
    histogram[:] = 0.0
    columns_per_m = HISTOGRAM_CELLS / constants.area_size_m[0]
    rows_per_m = HISTOGRAM_CELLS / constants.area_size_m[1]
    coordinates_m = worlds.user_coordinates_m[world]
    for user in range(users):
        column = min(int(coordinates_m[0, user] * columns_per_m), HISTOGRAM_CELLS - 1)
        row = min(int(coordinates_m[1, user] * rows_per_m), HISTOGRAM_CELLS - 1)
        histogram[column * HISTOGRAM_CELLS + row] += 1.0
    histogram /= users


@inlined
def observe(constants: Constants, worlds: Worlds, world: int) -> None:
    """Every UAV's observation, and the state but for u_dist (M18, M19)."""
    east_m, north_m = constants.area_size_m
    longer_side_m = max(east_m, north_m)
    uavs, users = worlds.positions_m.shape[1], worlds.user_coordinates_m.shape[2]
    past_slots = max(worlds.slot[world], 1)
    for uav in range(uavs):
        x_m, y_m, z_m = worlds.positions_m[world, uav]
        altitude = relative(z_m, constants.min_altitude_m, constants.max_altitude_m)
        seen = worlds.observations[world, uav]
        seen[0] = x_m / east_m
        seen[1] = y_m / north_m
        seen[2] = altitude
        power = relative(
            worlds.transmit_powers_w[world, uav],
            constants.min_transmit_power_w,
            constants.max_transmit_power_w,
        )
        seen[3] = max(power, 0.0)  # one that has failed sends nothing
        seen[4] = worlds.nearest_user_m[world, uav] / longer_side_m
        seen[5] = worlds.loads[world, uav] / users
        seen[6] = x_m / east_m
        seen[7] = 1.0 - x_m / east_m
        seen[8] = y_m / north_m
        seen[9] = 1.0 - y_m / north_m
        seen[10] = altitude
        seen[11] = 1.0 - altitude
        for kind in range(3):
            seen[12 + kind] = worlds.violation_slots[world, uav, kind] / past_slots
        margin_db = worlds.backhaul_snr_db[world, uav] - constants.backhaul_required_snr_db
        seen[15] = margin_db / BACKHAUL_SCALE_DB
    size = worlds.observations.shape[2]
    for uav in range(uavs):
        for number in range(size):
            worlds.states[world, uav * size + number] = worlds.observations[world, uav, number]
    worlds.states[world, -1] = worlds.metrics[world, RATE_JFI]
