"""The arrays that B worlds consist of, and the constants that the compiled step reads."""

import inspect
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.channel import air_to_ground_path_loss_db, best_case_gain_m2
from orchid_uav.envs.kinematics import chord
from orchid_uav.envs.metrics import SLOT_METRICS
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.propulsion import circling_speed_mps, propulsion_power_w
from orchid_uav.envs.reward import best_rate_bps, energy_efficiency_scale
from orchid_uav.envs.sharing import SHARE_RULES
from orchid_uav.envs.units import dbm_to_watt

OBSERVATION_SIZE = 16
"""Numbers in one UAV's observation (decision M18)."""
HISTOGRAM_CELLS = 10
"""Cells per side of the users' histogram u_dist (decision M19)."""
ACTION_SIZE = 4
"""An action is (x, y, z, transmit power), each in [-1, 1]."""

Floats = NDArray[np.float64]


def state_size(uav_count: int) -> int:
    """Numbers in the global state: all observations, u_dist, J (decision M19)."""
    return uav_count * OBSERVATION_SIZE + HISTOGRAM_CELLS**2 + 1


class Constants(NamedTuple):
    """Plain numbers derived once from :class:`Parameters`, ratios and W instead of dB and dBm.

    A pair is a weight at training progress 0 and 1.
    """

    area_size_m: tuple[float, float]
    """Sides of the area, east and north."""
    slot_s: float
    heading_hold_slots: int
    user_speed_mps: float
    min_altitude_m: float
    max_altitude_m: float
    max_displacement_m: float
    displacement_scale_m: tuple[float, float, float]
    min_separation_m: float
    flies_stations: bool
    station_speed_limit_mps: float
    station_smoothing: float
    centre_spacing_m: float
    """Of stations; 0 in direct flight."""
    circle_radius_m: float
    circle_chord: tuple[float, float, float]
    """Length in m of a step along the circle, cosine and sine of its angle."""
    station_altitude_m: float
    """0 where an action decides."""
    station_power_w: float
    """0 where an action decides."""
    outages: NDArray[np.int64]
    """UAV, first slot and end of each failure, (failures, 3)."""
    delay_slots: int
    """Age of what UAVs know of the users' positions."""
    flight_error_std_m: float
    """Of what UAVs know of the users' positions."""
    senses_truth: bool
    """Whether UAVs know the users' present positions as they are."""
    min_transmit_power_w: float
    max_transmit_power_w: float
    start_power_w: float
    power_step_w: float
    rotor: tuple[float, ...]
    """Arguments of ``propulsion_power_w`` after the speed, in its order."""
    climbing_mass_kg: float
    link: tuple[float, ...]
    """Arguments of ``air_to_ground_path_loss_db`` after distance and altitude, in its order."""
    carrier_frequency_hz: float
    access_gain_db: float
    best_case_gain_m2: float
    access_noise_power_w: float
    required_snr: float
    bandwidth_hz: float
    share_rule: int
    gbs_positions_m: Floats
    """Antennas of the masts, (G, 3)."""
    gbs_transmit_power_w: float
    backhaul_gain_db: float
    backhaul_noise_power_w: float
    backhaul_required_snr_db: float
    coverage_weight: float
    efficiency_weight: tuple[float, float]
    load_fairness_weight: tuple[float, float]
    rate_fairness_weight: tuple[float, float]
    penalty_weight: tuple[float, float]
    collision_penalty: float
    boundary_penalty: float
    backhaul_penalty: tuple[float, float]
    rewards_log_rates: bool
    log_rate_floor_bps: float
    best_rate_bps: float
    power_epsilon_w: float
    efficiency_scale_bit_per_joule: float

    @classmethod
    def of(cls, parameters: Parameters) -> "Constants":
        """The constants of one set of parameters."""
        network, uav, rotor = parameters.network, parameters.uav, parameters.rotor
        channel, reward, sensing = parameters.channel, parameters.reward, parameters.sensing
        flies_stations = uav.flight == "station"
        return cls(
            area_size_m=network.area_size_m,
            slot_s=network.slot_s,
            heading_hold_slots=parameters.heading_hold_slots,
            user_speed_mps=network.user_speed_mps,
            min_altitude_m=uav.min_altitude_m,
            max_altitude_m=uav.max_altitude_m,
            max_displacement_m=uav.max_speed_mps * network.slot_s,
            displacement_scale_m=uav.displacement_scale_m,
            min_separation_m=uav.min_separation_m,
            flies_stations=flies_stations,
            station_speed_limit_mps=min(uav.station.speed_limit_mps, uav.max_speed_mps),
            station_smoothing=uav.station.smoothing,
            centre_spacing_m=parameters.centre_spacing_m if flies_stations else 0.0,
            circle_radius_m=parameters.circle_radius_m,
            circle_chord=chord(
                parameters.circle_radius_m, circling_speed_mps(parameters) * network.slot_s
            ),
            station_altitude_m=_within(
                uav.station.altitude_m, uav.min_altitude_m, uav.max_altitude_m
            ),
            station_power_w=_within(
                uav.station.transmit_power_w, uav.min_transmit_power_w, uav.max_transmit_power_w
            ),
            outages=np.array(network.outages, np.int64).reshape(-1, 3),
            delay_slots=parameters.delay_slots,
            flight_error_std_m=sensing.flight_error_std_m,
            senses_truth=parameters.delay_slots == 0 and sensing.flight_error_std_m == 0.0,
            min_transmit_power_w=uav.min_transmit_power_w,
            max_transmit_power_w=uav.max_transmit_power_w,
            start_power_w=uav.start_power_w,
            power_step_w=uav.power_step_w,
            rotor=_in_order_of(propulsion_power_w, rotor.power_curve()),
            climbing_mass_kg=rotor.mass_kg if rotor.climb_power else 0.0,
            link=_in_order_of(air_to_ground_path_loss_db, channel.air_to_ground()),
            carrier_frequency_hz=channel.carrier_frequency_hz,
            access_gain_db=channel.access_gain_db,
            best_case_gain_m2=best_case_gain_m2(
                channel.access_gain_db, channel.carrier_frequency_hz, channel.excess_loss_los_db
            ),
            access_noise_power_w=parameters.access_noise_power_w,
            required_snr=parameters.required_snr,
            bandwidth_hz=parameters.bandwidth_hz,
            share_rule=SHARE_RULES[parameters.share_rule],
            gbs_positions_m=np.array(parameters.gbs_positions_m).reshape(-1, 3),
            gbs_transmit_power_w=float(dbm_to_watt(parameters.gbs.transmit_power_dbm)),
            backhaul_gain_db=channel.backhaul_gain_db,
            backhaul_noise_power_w=channel.noise_power_w(channel.backhaul_bandwidth_hz),
            backhaul_required_snr_db=channel.backhaul_required_snr_db,
            coverage_weight=reward.coverage_weight,
            efficiency_weight=reward.efficiency_weight,
            load_fairness_weight=reward.load_fairness_weight,
            rate_fairness_weight=reward.rate_fairness_weight,
            penalty_weight=reward.penalty_weight,
            collision_penalty=reward.collision_penalty,
            boundary_penalty=reward.boundary_penalty,
            backhaul_penalty=reward.backhaul_penalty,
            rewards_log_rates=reward.objective == "pf",
            log_rate_floor_bps=reward.log_rate_floor_bps,
            best_rate_bps=best_rate_bps(parameters),
            power_epsilon_w=reward.power_epsilon_w,
            efficiency_scale_bit_per_joule=energy_efficiency_scale(parameters),
        )


def _within(value: float | None, low: float, high: float) -> float:
    """The value kept within its limits, 0 for none."""
    return 0.0 if value is None else min(max(value, low), high)


def _in_order_of(function: Callable[..., object], arguments: dict[str, float]) -> tuple[float, ...]:
    names = inspect.signature(function).parameters
    return tuple(arguments[name] for name in names if name in arguments)


class Worlds(NamedTuple):
    """State and last metrics of B worlds with N UAVs and M users each."""

    slot: NDArray[np.int64]
    """Slots flown in this episode, (B,)."""
    walk_key: NDArray[np.uint64]
    """Seed of the users' random walk in this episode, (B,)."""
    user_coordinates_m: Floats
    """Horizontal user positions, (B, 2, M): x of all users, then y, in which order loops over users
    vectorise. :attr:`WorldBatch.users_m` is a view of them as (B, M, 2)."""
    user_velocities_mps: Floats
    """(B, 2, M)."""
    known_coordinates_m: Floats
    """The users' positions as UAVs know them in flight, (B, 2, M) (M39); where they know the truth,
    the same array as ``user_coordinates_m``."""
    known_velocities_mps: Floats
    """The users' velocities at the time of the known positions, (B, 2, M)."""
    sensing_error_m: Floats
    """Error on the known positions, (B, 2, M); without users where the truth is known."""
    past_users: Floats
    """Positions and velocities in the slots up to now, slot t at t modulo the ring's length,
    (B, delay + 1, 4, M); without users where the truth is known."""
    target_users: NDArray[np.bool_]
    """True for G_UAV, (B, M); fixed at reset (M11)."""
    in_service: NDArray[np.bool_]
    """False for UAVs that have failed, or not joined yet, (B, N) (M42)."""
    stations_m: Floats
    """Centres of the circles (M38), (B, N, 2); in direct flight where the UAVs are."""
    station_velocities_mps: Floats
    """Realised, (B, N, 2)."""
    positions_m: Floats
    """UAV positions, (B, N, 3)."""
    velocities_mps: Floats
    """Realised UAV velocities in the last slot, (B, N, 3)."""
    transmit_powers_w: Floats
    """(B, N)."""
    close_uavs: NDArray[np.int64]
    """Other UAVs nearer than d_min, (B, N)."""
    left_flight_box: NDArray[np.bool_]
    """Whether the last wanted position was outside the flight box, (B, N)."""
    weak_backhaul: NDArray[np.bool_]
    """Whether the backhaul SNR is below its threshold, (B, N)."""
    backhaul_snr_db: Floats
    """(B, N)."""
    violation_slots: NDArray[np.int64]
    """Slots of this episode with a collision, boundary or backhaul violation, (B, N, 3)."""
    nearest_user_m: Floats
    """Horizontal distance to the nearest user, (B, N)."""
    association: NDArray[np.int64]
    """UAV that serves each user, -1 if none, (B, M)."""
    spectral_efficiency: Floats
    """Spectral efficiency of each user's link to its UAV in bit/s/Hz, 0 if not served, (B, M)."""
    loads: NDArray[np.int64]
    """Users served by each UAV, K_n, (B, N)."""
    rates_bps: Floats
    """Rates of the users that UAVs serve, 0 for others, (B, M)."""
    rewards: Floats
    """r_n of the last slot, (B, N)."""
    metrics: Floats
    """Metrics of the last slot, (B, len(SLOT_METRICS))."""
    episode_sums: Floats
    """Mean reward and metrics summed over this episode's slots, (B, 1 + len(SLOT_METRICS))."""
    observations: NDArray[np.float32]
    """(B, N, OBSERVATION_SIZE)."""
    states: NDArray[np.float32]
    """(B, state_size(N))."""

    def part(self, worlds: slice) -> "Worlds":
        """Views of the arrays of some of the worlds."""
        return Worlds(*(array[worlds] for array in self))  # type: ignore[arg-type]

    @classmethod
    def zeros(cls, constants: Constants, worlds: int, uavs: int, users: int) -> "Worlds":
        """Arrays of the right shapes and types, all zero, with all UAVs in service."""
        fleet, crowd = (worlds, uavs), (worlds, users)
        coordinates_m, velocities_mps = np.zeros((2, worlds, 2, users))
        remembered = 0 if constants.senses_truth else users
        return cls(
            slot=np.zeros(worlds, np.int64),
            walk_key=np.zeros(worlds, np.uint64),
            user_coordinates_m=coordinates_m,
            user_velocities_mps=velocities_mps,
            known_coordinates_m=coordinates_m if not remembered else coordinates_m.copy(),
            known_velocities_mps=velocities_mps if not remembered else velocities_mps.copy(),
            sensing_error_m=np.zeros((worlds, 2, remembered)),
            past_users=np.zeros((worlds, constants.delay_slots + 1, 4, remembered)),
            in_service=np.ones(fleet, np.bool_),
            stations_m=np.zeros((*fleet, 2)),
            station_velocities_mps=np.zeros((*fleet, 2)),
            target_users=np.zeros(crowd, np.bool_),
            positions_m=np.zeros((*fleet, 3)),
            velocities_mps=np.zeros((*fleet, 3)),
            transmit_powers_w=np.zeros(fleet),
            close_uavs=np.zeros(fleet, np.int64),
            left_flight_box=np.zeros(fleet, np.bool_),
            weak_backhaul=np.zeros(fleet, np.bool_),
            backhaul_snr_db=np.zeros(fleet),
            violation_slots=np.zeros((*fleet, 3), np.int64),
            nearest_user_m=np.zeros(fleet),
            association=np.zeros(crowd, np.int64),
            spectral_efficiency=np.zeros(crowd),
            loads=np.zeros(fleet, np.int64),
            rates_bps=np.zeros(crowd),
            rewards=np.zeros(fleet),
            metrics=np.zeros((worlds, len(SLOT_METRICS))),
            episode_sums=np.zeros((worlds, 1 + len(SLOT_METRICS))),
            observations=np.zeros((*fleet, OBSERVATION_SIZE), np.float32),
            states=np.zeros((worlds, state_size(uavs)), np.float32),
        )
