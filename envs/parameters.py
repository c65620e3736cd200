"""Table I of the paper, and what it leaves open, as one validated and frozen object.

The sections are those of the configuration file, the field names its keys. A field's docstring is
its description here and in docs/configuration.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import ValidationError, model_validator

from orchid_uav.envs.keys import (
    Altitude,
    Bandwidth,
    Distance,
    ExcessLoss,
    Flag,
    Level,
    Pair,
    RequiredSnr,
    RotorPower,
    Section,
    TransmitPower,
    Weight,
    by_key,
    describe_error,
    fields_by_key,
    in_sections,
    with_current_keys,
    within,
)
from orchid_uav.envs.knowledge.outages import Failure, Outage
from orchid_uav.envs.starts.places import Area, Masts
from orchid_uav.suggestions import unknown

Distribution = Literal["tcp", "uniform"]
Start = Literal["kmeans", "balanced", "random"]
Objective = Literal["mmf", "pf"]
Observation = Literal["paper", "informed"]
Flight = Literal["direct", "station"]


_LONGEST_MEMORY_SLOTS = 1000


class NetworkParameters(Section):
    """The area, its users, and how long an episode is."""

    area_m: Area = 2000.0
    """Side D of the square service area, or `[east, north]`, the sides of a rectangle (M44)."""
    user_count: Annotated[int, within(2, 100_000), Flag("users", "world", "50..200:50")] = 100
    """Number M of ground users; there must be as many as UAVs and masts."""
    uav_count: Annotated[int, within(1, 1000), Flag("uavs", "world", "4..10")] = 6
    """Number N of UAVs."""
    total_bandwidth_hz: Bandwidth | None = None
    """B_total: if set, every UAV gets B = B_total / N instead of `subband_bandwidth_hz` (M2)."""
    subband_bandwidth_hz: Bandwidth = 10e6
    """Sub-band B of each UAV (M2)."""
    shares: Annotated[Literal["mmf", "pf", "se"] | None, Flag("shares", "method")] = None
    """Rule by which a UAV shares its band among its users; by default the objective's (M12)."""
    distribution: Annotated[Distribution, Flag("distribution", "world")] = "tcp"
    """How users are placed: by a Thomas cluster process (M6), or uniformly over the area."""
    hotspot_count: Annotated[int, within(1, 100_000)] = 5
    """Parent points K_p of the Thomas process."""
    scatter_std_m: Distance = 150.0
    """Standard deviation of the users around their parent point, per axis."""
    sensing_error_std_m: Distance = 0.0
    """Standard deviation of the error on the user positions that Phase I sees, per axis (M29)."""
    user_speed_mps: Annotated[
        float, within(0.0, 1000.0), Flag("speeds", "world", "0..15:2.5", is_of_runs=False)
    ] = 0.0
    """Greatest speed of users in their random walk; with 0 they stand still (M16)."""
    heading_hold_s: Annotated[
        float, within(1e-3, 1e9), Flag("heading-hold", "world", "1,20", is_of_runs=False)
    ] = 1.0
    """How long a user keeps its speed and heading (M16)."""
    slot_s: Annotated[float, within(1e-3, 86400.0)] = 1.0
    """Duration of a time slot."""
    episode_slots: Annotated[int, within(1, 1_000_000)] = 200
    """Number T of slots in an episode, which is a time limit (M15)."""
    failures: tuple[Failure, ...] = ()
    """UAVs that fail: `2@60` is UAV 2 from slot 60 on, `0@0-30` UAV 0 up to slot 30 (M42)."""

    @property
    def area_size_m(self) -> tuple[float, float]:
        """Sides of the area, east and north."""
        return self.area_m if isinstance(self.area_m, tuple) else (self.area_m, self.area_m)

    @property
    def outages(self) -> tuple[Outage, ...]:
        """The failures, read."""
        return tuple(Outage.read(text) for text in self.failures)

    @model_validator(mode="after")
    def _known_uavs(self) -> NetworkParameters:
        for outage in self.outages:
            if outage.uav >= self.uav_count:
                raise ValueError(
                    f"failures name UAV {outage.uav}, but there are only UAVs 0 to "
                    f"{self.uav_count - 1}"
                )
            if not outage.first_slot < outage.end_slot:
                raise ValueError(
                    f"UAV {outage.uav} cannot fail in slot {outage.first_slot} and join before it"
                )
        return self


class StationParameters(Section):
    """How a UAV's station moves, the place that its autopilot circles (M38)."""

    speed_limit_mps: Annotated[float, within(0.0, 1000.0)] = 8.0
    """Greatest speed of a station, V_max at most."""
    smoothing: Annotated[float, within(0.0, 0.99)] = 0.5
    """Share of its velocity that a station keeps from slot to slot; 0 follows every action."""
    centre_spacing_m: Distance = 90.0
    """Least distance of two stations, whatever the actions are; less where there is no room."""
    circle_radius_m: Annotated[float, within(0.1, 1e5)] = 40.0
    """Radius of the circles, less where the area has no room for it."""
    altitude_m: Altitude | None = 120.0
    """Altitude that UAVs go to and keep, within their limits; none leaves it to the actions."""
    transmit_power_w: TransmitPower | None = 0.2
    """Transmit power that UAVs go to and keep, within limits; none leaves it to the actions."""


class UavParameters(Section):
    """What a UAV may do."""

    initial_altitude_m: Altitude = 100.0
    """Altitude H_init of UAVs at the start of an episode."""
    min_altitude_m: Altitude = 80.0
    """Lowest altitude H_min."""
    max_altitude_m: Altitude = 120.0
    """Highest altitude H_max."""
    max_speed_mps: Annotated[float, within(0.01, 1000.0)] = 15.0
    """Greatest 3-D speed V_max (M5)."""
    displacement_scale_m: tuple[Distance, Distance, Distance] = (15.0, 15.0, 5.0)
    """V_scale: displacement per slot for an action of 1, along x, y and z (M5)."""
    min_separation_m: Distance = 5.0
    """Safety clearance d_min between two UAVs."""
    min_transmit_power_w: TransmitPower = 0.1
    """Least transmit power P_min."""
    max_transmit_power_w: TransmitPower = 0.2
    """Greatest transmit power P_max."""
    initial_transmit_power_w: TransmitPower | None = None
    """Transmit power at the start of an episode; by default midway between the limits (M10)."""
    power_step_w: Annotated[float, within(0.0, 1e4)] = 0.01
    """Change delta_p of the transmit power per slot for an action of 1."""
    observation: Observation = "paper"
    """Section IV-C1's 16 numbers (M18), or `informed`, 98 of own users and neighbours (M40)."""
    flight: Flight = "direct"
    """What an action moves: the UAV itself, as in the paper, or the station it circles (M38)."""
    station: StationParameters = StationParameters()
    """Stations, for `uav.flight = station`."""

    @model_validator(mode="after")
    def _ordered(self) -> UavParameters:
        if not self.min_altitude_m <= self.initial_altitude_m <= self.max_altitude_m:
            raise ValueError(
                f"initial_altitude_m is {self.initial_altitude_m:g}, outside min_altitude_m.."
                f"max_altitude_m = {self.min_altitude_m:g}..{self.max_altitude_m:g}"
            )
        if not self.min_transmit_power_w <= self.start_power_w <= self.max_transmit_power_w:
            raise ValueError(
                f"initial_transmit_power_w is {self.start_power_w:g}, outside min_transmit_power_w"
                f"..max_transmit_power_w = {self.min_transmit_power_w:g}"
                f"..{self.max_transmit_power_w:g}"
            )
        return self

    @property
    def start_power_w(self) -> float:
        """Transmit power at the start of an episode (M10)."""
        if self.initial_transmit_power_w is None:
            return 0.5 * (self.min_transmit_power_w + self.max_transmit_power_w)
        return self.initial_transmit_power_w


class RotorParameters(Section):
    """Aerodynamics of the rotary-wing UAV."""

    blade_profile_power_w: RotorPower = 79.856
    """Blade profile power P_0 in hover."""
    induced_power_w: RotorPower = 314.15
    """Induced power P_i in hover."""
    tip_speed_mps: Annotated[float, within(1.0, 1000.0)] = 120.0
    """Tip speed U_tip of the rotor blade."""
    induced_velocity_mps: Annotated[float, within(0.1, 100.0)] = 4.03
    """Mean rotor induced velocity v_0 in hover."""
    fuselage_drag_ratio: Annotated[float, within(0.0, 100.0)] = 0.6
    """Fuselage drag ratio d_fuse."""
    air_density_kg_per_m3: Annotated[float, within(1e-6, 100.0)] = 1.225
    """Air density rho."""
    solidity: Annotated[float, within(1e-6, 1.0)] = 0.05
    """Rotor solidity s."""
    disc_area_m2: Annotated[float, within(1e-4, 1000.0)] = 0.503
    """Rotor disc area A."""
    climb_power: bool = False
    """Whether to add the climb power m g max(v_z, 0), which the paper's formula omits (M24)."""
    mass_kg: Annotated[float, within(1e-3, 1e4)] = 4.7
    """Mass m for `climb_power`; in Table I, P_i corresponds to 4.7 kg and v_0 to 2 kg (M24)."""

    def power_curve(self) -> dict[str, float]:
        """The keyword arguments of :func:`orchid_uav.envs.propulsion.propulsion_power_w`."""
        return self.model_dump(exclude={"climb_power", "mass_kg"})


class ChannelParameters(Section):
    """Radio propagation and receiver thresholds."""

    carrier_frequency_hz: Annotated[float, within(1e6, 1e12)] = 2.4e9
    """Carrier frequency f_c."""
    s_curve_a: Annotated[float, within(1e-6, 100.0)] = 9.61
    """S-curve parameter a of the LoS probability."""
    s_curve_b: Annotated[float, within(1e-6, 5.0)] = 0.16
    """S-curve parameter b of the LoS probability."""
    excess_loss_los_db: ExcessLoss = 1.0
    """Mean excess loss eta_LoS."""
    excess_loss_nlos_db: ExcessLoss = 20.0
    """Mean excess loss eta_NLoS, which may not be below eta_LoS."""
    noise_density_dbm_per_hz: Annotated[float, within(-300.0, 100.0)] = -174.0
    """Noise power density N_0."""
    required_snr_db: RequiredSnr = 6.0
    """Least SNR Gamma_req at which a user is served (M11)."""
    access_transmit_gain_dbi: Level = 0.0
    """UAV antenna gain G_tx towards users (M3)."""
    access_receive_gain_dbi: Level = 0.0
    """User antenna gain G_rx (M3)."""
    backhaul_bandwidth_hz: Bandwidth = 20e6
    """Backhaul bandwidth B_BH."""
    backhaul_required_snr_db: RequiredSnr = 10.0
    """Least backhaul SNR gamma_th."""
    backhaul_gbs_gain_dbi: Level = 0.0
    """GBS antenna gain G_GBS on the backhaul (M3)."""
    backhaul_uav_gain_dbi: Level = 0.0
    """UAV antenna gain G_UAV on the backhaul (M3)."""

    @model_validator(mode="after")
    def _obstacles_do_not_amplify(self) -> ChannelParameters:
        if self.excess_loss_nlos_db < self.excess_loss_los_db:
            raise ValueError(
                f"excess_loss_nlos_db is {self.excess_loss_nlos_db:g}, below excess_loss_los_db = "
                f"{self.excess_loss_los_db:g}"
            )
        return self

    @property
    def access_gain_db(self) -> float:
        """G_tx G_rx in dB."""
        return self.access_transmit_gain_dbi + self.access_receive_gain_dbi

    @property
    def backhaul_gain_db(self) -> float:
        """G_GBS G_UAV in dB."""
        return self.backhaul_gbs_gain_dbi + self.backhaul_uav_gain_dbi

    def air_to_ground(self) -> dict[str, float]:
        """The keyword arguments of :func:`orchid_uav.envs.channel.air_to_ground_path_loss_db`."""
        return self.model_dump(
            include={
                "carrier_frequency_hz",
                "s_curve_a",
                "s_curve_b",
                "excess_loss_los_db",
                "excess_loss_nlos_db",
            }
        )

    def noise_power_w(self, bandwidth_hz: float) -> float:
        """Thermal noise N_0 B in W."""
        from orchid_uav.envs.units import dbm_to_watt  # not before it is needed: it loads numba

        return float(dbm_to_watt(self.noise_density_dbm_per_hz)) * bandwidth_hz


class GbsParameters(Section):
    """The ground base station, or several, and its users' link (M4)."""

    positions_m: Masts = "middle"
    """Masts, in the area or beyond it; `[]` for none (M45)."""
    height_m: Altitude = 30.0
    """Antenna height H_GBS, of masts that have none of their own."""
    transmit_power_dbm: Level = 30.0
    """Transmit power P_GBS."""
    path_loss_exponent: Annotated[float, within(0.1, 10.0)] = 3.5
    """Exponent beta of the GBS-to-user path loss (M4)."""
    shadowing_std_db: Annotated[float, within(0.0, 100.0)] = 8.0
    """Standard deviation sigma_sh of the shadowing, drawn once per user and episode (M4)."""
    access_bandwidth_hz: Bandwidth = 10e6
    """Bandwidth that each mast divides equally among its users (M4)."""


class SensingParameters(Section):
    """What UAVs know of the users in flight; links, loads and rewards stay true (M39)."""

    flight_error_std_m: Distance = 0.0
    """Standard deviation of an error that each user keeps for an episode, per axis."""
    delay_s: Annotated[float, within(0.0, 3600.0)] = 0.0
    """Age of the positions that are known."""


class DeploymentParameters(Section):
    """Phase I: where UAVs start."""

    init: Annotated[Start, Flag("init", "method")] = "kmeans"
    """Where UAVs start: K-Means++ centroids, the most balanced of some (M41), or random (M28)."""
    n_init: Annotated[int, within(1, 10_000)] = 1
    """Number of K-Means++ runs, of which the one with the least WCSS is kept (M27)."""
    balanced_restarts: Annotated[int, within(0, 10_000)] = 30
    """Clusterings besides Phase I's own that `init = balanced` chooses from (M41)."""
    balanced_on: Literal["sensed", "exact"] = "sensed"
    """Positions that these see: as `network.sensing_error_std_m` makes them, or as they are."""


class RewardParameters(Section):
    """The reward. A pair holds the values of a weight at training progress 0 and 1."""

    objective: Annotated[Objective, Flag("objective", "method")] = "mmf"
    """Rate term and shares: `mmf` (JFI, max-min) or `pf` (mean log rate, equal) (M12, M13)."""
    coverage_weight: Weight = 0.5
    """Weight w_1 of coverage."""
    efficiency_weight: Pair = (0.2, 0.5)
    """Weight w_2 of the energy efficiency."""
    load_fairness_weight: Pair = (0.8, 0.5)
    """Weight w_3 of the load JFI."""
    rate_fairness_weight: Pair = (0.8, 0.5)
    """Weight w_4 of the rate term."""
    penalty_weight: Pair = (0.1, 0.3)
    """Weight w_5 of the penalties."""
    collision_penalty: Weight = 2.5
    """Penalty lambda_c for each other UAV that is too close."""
    boundary_penalty: Weight = 1.0
    """Penalty lambda_b for an action that leads out of the flight box (M25)."""
    backhaul_penalty: Pair = (0.0, 45.0)
    """Penalty lambda_bh for a weak backhaul (M8)."""
    log_rate_floor_bps: Annotated[float, within(1e-3, 1e12)] = 10e3
    """R_lo of the PF reward: rates up to this one earn nothing (M13)."""
    power_epsilon_w: Annotated[float, within(0.0, 1e6)] = 1e-9
    """Constant epsilon in the denominator of the energy efficiency."""


class Parameters(Section):
    """Everything that defines the simulated network; the defaults are Table I."""

    network: NetworkParameters = NetworkParameters()
    """Area, users, episode."""
    uav: UavParameters = UavParameters()
    """Movement and transmit power."""
    rotor: RotorParameters = RotorParameters()
    """Propulsion power."""
    channel: ChannelParameters = ChannelParameters()
    """Radio links."""
    gbs: GbsParameters = GbsParameters()
    """Ground base station."""
    sensing: SensingParameters = SensingParameters()
    """What is known in flight."""
    deployment: DeploymentParameters = DeploymentParameters()
    """Phase I."""
    reward: RewardParameters = RewardParameters()
    """Reward terms, weights and penalties."""

    @model_validator(mode="before")
    @classmethod
    def _of_any_version(cls, values: Any) -> Any:
        return with_current_keys(values) if isinstance(values, Mapping) else values

    @model_validator(mode="after")
    def _room_for_a_random_start(self) -> Parameters:
        uavs, apart_m = self.network.uav_count, self.uav.min_separation_m
        if self.deployment.init == "random" and apart_m > 0.0:
            # Oler's bound on the points of a rectangle that lie so far apart (1961).
            east, north = (side_m / apart_m for side_m in self.network.area_size_m)
            if uavs > 2.0 / 3.0**0.5 * (east * north) + (east + north) + 1.0:
                sides_m = " x ".join(f"{side_m:g}" for side_m in self.network.area_size_m)
                raise ValueError(
                    f"there is no room for {uavs} UAVs min_separation_m = {apart_m:g} m apart, as "
                    f"init = random wants them, in area_m = {sides_m} m"
                )
        return self

    @model_validator(mode="after")
    def _enough_users(self) -> Parameters:
        uavs, masts = self.network.uav_count, len(self.gbs_positions_m)
        if self.network.user_count < uavs + masts:
            raise ValueError(
                f"user_count is {self.network.user_count}, but K-Means into a cluster for each of "
                f"{uavs} UAVs (uav_count) and {masts} masts needs at least {uavs + masts} users"
            )
        return self

    @model_validator(mode="after")
    def _memory_for_the_delay(self) -> Parameters:
        slots = self.sensing.delay_s / self.network.slot_s
        if slots > _LONGEST_MEMORY_SLOTS:
            raise ValueError(
                f"sensing.delay_s is {slots:.0f} slots, of which {_LONGEST_MEMORY_SLOTS} can be "
                "remembered"
            )
        return self

    @property
    def share_rule(self) -> str:
        """How bandwidth is shared: `network.shares` where given, else as the objective wants it."""
        return self.network.shares or self.reward.objective

    @property
    def bandwidth_hz(self) -> float:
        """Sub-band B of a UAV (M2)."""
        if self.network.total_bandwidth_hz is None:
            return self.network.subband_bandwidth_hz
        return self.network.total_bandwidth_hz / self.network.uav_count

    @property
    def access_noise_power_w(self) -> float:
        """N_0 B of a UAV's sub-band."""
        return self.channel.noise_power_w(self.bandwidth_hz)

    @property
    def required_snr(self) -> float:
        """Gamma_req as a ratio."""
        from orchid_uav.envs.units import decibel_to_linear

        return float(decibel_to_linear(self.channel.required_snr_db))

    @property
    def gbs_positions_m(self) -> tuple[tuple[float, float, float], ...]:
        """Antennas of the masts; by default q_0 alone, in the middle of the area."""
        masts = self.gbs.positions_m
        if masts == "middle":
            east_m, north_m = self.network.area_size_m
            masts = ((0.5 * east_m, 0.5 * north_m),)
        usual_m = self.gbs.height_m
        return tuple((mast[0], mast[1], mast[2] if len(mast) > 2 else usual_m) for mast in masts)

    @property
    def delay_slots(self) -> int:
        """Age of what UAVs know of the users' positions, an episode at most (M39)."""
        return min(round(self.sensing.delay_s / self.network.slot_s), self.network.episode_slots)

    @property
    def circle_radius_m(self) -> float:
        """Radius of the circles round stations, for which the area has room (M38)."""
        return min(self.uav.station.circle_radius_m, 0.5 * min(self.network.area_size_m))

    @property
    def centre_spacing_m(self) -> float:
        """Least distance of two stations, for which the area has room (M38)."""
        from orchid_uav.envs.starts.stations import greatest_spacing_m  # loads scipy

        east_m, north_m = self.network.area_size_m
        taken_m = 2.0 * self.circle_radius_m
        wanted_m = self.uav.station.centre_spacing_m
        sides_m = (east_m - taken_m, north_m - taken_m)
        return greatest_spacing_m(self.network.uav_count, wanted_m, sides_m)

    @property
    def heading_hold_slots(self) -> int:
        """Slots between two draws of a user's heading, at least 1 (M16)."""
        return max(1, round(self.network.heading_hold_s / self.network.slot_s))

    def with_overrides(self, overrides: dict[str, Any]) -> Parameters:
        """A validated copy with some fields replaced.

        Args:
            overrides: values by ``"section.field"``, or by ``"field"`` where only one section has
                a field of that name.

        Raises:
            ValueError: unknown or ambiguous name, or a value that does not fit, in one line.
        """
        merged = by_key(self.model_dump())
        for name, value in with_current_keys(overrides).items():
            merged[self.locate(name)] = value
        try:
            return Parameters.model_validate(in_sections(merged))
        except ValidationError as error:
            raise ValueError(describe_error(error, Parameters)[1]) from error

    @classmethod
    def locate(cls, name: str) -> str:
        """The key ``"section.field"`` of itself, or of a field name that is unique."""
        keys = list(fields_by_key(cls))
        found = [key for key in keys if name in (key.rpartition(".")[2], key)]
        if not found:
            names = keys + [key.rpartition(".")[2] for key in keys]
            raise ValueError(unknown("parameter", name, names, cutoff=0.6))
        if len(found) > 1:
            choices = ", ".join(f"'{key}'" for key in sorted(found))
            raise ValueError(f"'{name}' is one of several: {choices}")
        return found[0]
