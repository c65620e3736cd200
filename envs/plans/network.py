"""What a plan is judged by: plain numbers of the parameters, and what lies on the ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.channel import best_case_gain_m2, ground_path_loss_db, received_power_w
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.reward import energy_efficiency_scale
from orchid_uav.envs.sharing import SHARE_RULES
from orchid_uav.envs.units import dbm_to_watt

NOBODY = -1
"""Server of those whom nobody reaches."""


class Rules(NamedTuple):
    """Plain numbers that the judging of plans needs, of :class:`Parameters`."""

    link: tuple[float, ...]
    """Arguments of ``air_to_ground_path_loss_db`` after distance and altitude, in its order."""
    access_gain_db: float
    best_case_gain_m2: float
    """Received over transmitted power of a certain line of sight, times the distance squared."""
    required_power_w: float
    """Least received power that a drone's link needs (M11)."""
    noise_power_w: float
    """Of a drone's band."""
    bandwidth_hz: float
    """Of a drone (P4)."""
    mast_noise_power_w: float
    mast_bandwidth_hz: float
    share_rule: int
    """By which drones and masts share their band (P1)."""
    coverage_weight: float
    efficiency_weight: float
    load_weight: float
    rate_weight: float
    """Weights at training progress 1 (P3)."""
    efficiency_scale_bit_per_joule: float
    power_epsilon_w: float

    @classmethod
    def of(cls, parameters: Parameters, drones: int) -> "Rules":
        """The rules for so many drones, which matter where they share a total bandwidth."""
        network, channel, reward = parameters.network, parameters.channel, parameters.reward
        bandwidth_hz = network.subband_bandwidth_hz
        if network.total_bandwidth_hz is not None:
            bandwidth_hz = network.total_bandwidth_hz / drones
        noise_w = channel.noise_power_w(bandwidth_hz)
        mast_bandwidth_hz = parameters.gbs.access_bandwidth_hz
        link = channel.air_to_ground()
        return cls(
            link=tuple(link[name] for name in LINK_ARGUMENTS),
            access_gain_db=channel.access_gain_db,
            best_case_gain_m2=best_case_gain_m2(
                channel.access_gain_db, channel.carrier_frequency_hz, channel.excess_loss_los_db
            ),
            required_power_w=parameters.required_snr * noise_w,
            noise_power_w=noise_w,
            bandwidth_hz=bandwidth_hz,
            mast_noise_power_w=channel.noise_power_w(mast_bandwidth_hz),
            mast_bandwidth_hz=mast_bandwidth_hz,
            share_rule=SHARE_RULES[parameters.share_rule],
            coverage_weight=reward.coverage_weight,
            efficiency_weight=reward.efficiency_weight[1],
            load_weight=reward.load_fairness_weight[1],
            rate_weight=reward.rate_fairness_weight[1],
            efficiency_scale_bit_per_joule=energy_efficiency_scale(parameters),
            power_epsilon_w=reward.power_epsilon_w,
        )


LINK_ARGUMENTS = (
    *("carrier_frequency_hz", "s_curve_a", "s_curve_b"),
    *("excess_loss_los_db", "excess_loss_nlos_db"),
)


class Ground(NamedTuple):
    """People and what they receive of masts."""

    coordinates_m: Floats
    """East of all people, then north, (2, P)."""
    weights: Floats
    """People that each position stands for, (P,)."""
    mast_power_w: Floats
    """Received of the strongest mast, (P,); 0 where that is less than a link needs."""
    mast: NDArray[np.int64]
    """The strongest mast, (P,); 0 where there is none."""
    mast_count: int

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        positions_m: ArrayLike,
        weights: ArrayLike,
        masts_m: ArrayLike,
        shadowing_db: ArrayLike = 0.0,
    ) -> "Ground":
        """People (P, 2) in m with weights (P,), and masts (G, 3) in m.

        Args:
            parameters: of the network; the masts' link is that of the GBS (M4).
            positions_m: east and north.
            weights: people that each position stands for.
            masts_m: east, north, and height of each mast.
            shadowing_db: of the masts' links, (G, P) or one number (P1: its median, 0, for a plan).
        """
        people_m = np.asarray(positions_m, np.float64)
        masts = np.asarray(masts_m, np.float64).reshape(-1, 3)
        channel, gbs = parameters.channel, parameters.gbs
        strongest_w = np.zeros(len(people_m))
        strongest = np.zeros(len(people_m), np.int64)
        if len(masts):
            apart_m = people_m[None] - masts[:, None, :2]
            distance_m = np.sqrt((apart_m**2).sum(axis=2) + masts[:, 2:] ** 2)
            loss_db = ground_path_loss_db(
                distance_m,
                channel.carrier_frequency_hz,
                gbs.path_loss_exponent,
                np.broadcast_to(shadowing_db, distance_m.shape),
            )
            transmit_w = float(dbm_to_watt(gbs.transmit_power_dbm))
            received_w = received_power_w(transmit_w, 0.0, loss_db)
            strongest = received_w.argmax(axis=0)
            strongest_w = received_w.max(axis=0)
            noise_w = channel.noise_power_w(gbs.access_bandwidth_hz)
            strongest_w[strongest_w < parameters.required_snr * noise_w] = 0.0
        return cls(
            np.ascontiguousarray(people_m.T),
            np.asarray(weights, np.float64),
            strongest_w,
            strongest,
            len(masts),
        )
