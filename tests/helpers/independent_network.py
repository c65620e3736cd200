"""One time slot of the UAV network, written a second time: slow, literal and independent.

It is derived only from the paper (Sections III, IV-C and V, Table I, Evaluation Metrics) and the
project's decisions M1 to M33, M44 and M45. It must not share code with the simulator: the tests
compare the two, so that a misreading in either shows as a difference. It uses pure Python, nested
loops and `math`.
"""

import math
from dataclasses import dataclass

SPEED_OF_LIGHT_MPS = 299_792_458.0
GRAVITY_MPS2 = 9.80665
NOT_SERVED = -1

Vector = tuple[float, float, float]
Point = tuple[float, float]
Pair = tuple[float, float]


@dataclass(frozen=True)
class Setting:
    """Table I and the decisions; a pair (start, end) is linear in the training progress."""

    area_m: Pair = (2000.0, 2000.0)  # M44: east, north
    slot_s: float = 1.0

    altitude_min_m: float = 80.0
    altitude_max_m: float = 120.0
    v_max_mps: float = 15.0
    displacement_scale_m: Vector = (15.0, 15.0, 5.0)  # M5
    min_separation_m: float = 5.0
    power_min_w: float = 0.1
    power_max_w: float = 0.2
    power_step_w: float = 0.01

    blade_profile_power_w: float = 79.856
    induced_power_w: float = 314.15
    tip_speed_mps: float = 120.0
    induced_velocity_mps: float = 4.03
    fuselage_drag_ratio: float = 0.6
    air_density_kgpm3: float = 1.225
    rotor_solidity: float = 0.05
    rotor_disc_area_m2: float = 0.503
    climb_mass_kg: float = 0.0  # M24: 0 is the paper's formula as written

    carrier_hz: float = 2.4e9
    s_curve_a: float = 9.61
    s_curve_b: float = 0.16
    eta_los_db: float = 1.0
    eta_nlos_db: float = 20.0
    antenna_gain_dbi: float = 0.0  # M3: the same for all four antennas
    noise_density_dbm_per_hz: float = -174.0
    bandwidth_hz: float = 10e6  # M2: per UAV
    required_snr_db: float = 6.0

    masts_m: tuple[Vector, ...] = ((1000.0, 1000.0, 30.0),)  # M45: q_0 = [D/2, D/2, H_GBS]
    gbs_power_dbm: float = 30.0
    gbs_path_loss_exponent: float = 3.5  # M4
    gbs_bandwidth_hz: float = 10e6  # M4: of each mast
    backhaul_bandwidth_hz: float = 20e6
    backhaul_threshold_db: float = 10.0

    coverage_weight: Pair = (0.5, 0.5)
    efficiency_weight: Pair = (0.2, 0.5)
    load_weight: Pair = (0.8, 0.5)
    rate_weight: Pair = (0.8, 0.5)
    penalty_weight: Pair = (0.1, 0.3)
    collision_penalty: float = 2.5
    boundary_penalty: float = 1.0
    backhaul_penalty: Pair = (0.0, 45.0)  # M8

    objective: str = "mmf"  # the reward's rate term: 'mmf' or 'pf' (M13)
    shares: str = "mmf"  # 'mmf', 'pf' or 'se' (M12)
    log_rate_floor_bps: float = 10e3  # R_lo of M13
    power_epsilon_w: float = 1e-9

    histogram_cells: int = 10  # M19, per axis
    backhaul_observation_scale_db: float = 40.0  # M18


@dataclass
class Slot:
    """The world before the slot, except that the users have already moved in it."""

    uav_positions_m: list[Vector]
    transmit_powers_w: list[float]
    users_m: list[Point]
    target_users: list[bool]
    actions: list[tuple[float, float, float, float]]
    past_violation_slots: list[tuple[int, int, int]]  # per UAV: collision, boundary, backhaul
    past_slots: int
    progress: float


@dataclass
class Outcome:
    """The world after the slot, and what the agents are told about it."""

    uav_positions_m: list[Vector]
    uav_velocities_mps: list[Vector]
    transmit_powers_w: list[float]
    association: list[int]
    rates_bps: list[float]
    loads: list[int]
    rewards: list[float]
    metrics: dict[str, float]
    observations: list[list[float]]
    state: list[float]


def clip(value: float, low: float, high: float) -> float:
    """The value, or the nearer end if it lies outside [low, high]."""
    if value < low:
        return low
    if value > high:
        return high
    return value


def fraction_of_range(value: float, low: float, high: float) -> float:
    """(value - low) / (high - low); 0 where the range is empty (M26: finite numbers)."""
    if high == low:
        return 0.0
    return (value - low) / (high - low)


def decibel_to_ratio(value_db: float) -> float:
    """10^(x/10)."""
    return 10 ** (value_db / 10)


def dbm_to_watt(value_dbm: float) -> float:
    """10^(x/10) milliwatts."""
    return 10 ** (value_dbm / 10) / 1000


def distance(first: Vector, second: Vector) -> float:
    """Euclidean distance in three dimensions."""
    total = 0.0
    for axis in range(3):
        total += (first[axis] - second[axis]) ** 2
    return math.sqrt(total)


def speed_of(velocity_mps: Vector) -> float:
    """The norm of a velocity."""
    return distance(velocity_mps, (0.0, 0.0, 0.0))


def scheduled(pair: Pair, progress: float) -> float:
    """A weight linear in tau, tau clipped to [0, 1] (IV-C.3, M8, M9)."""
    tau = clip(progress, 0.0, 1.0)
    return pair[0] + (pair[1] - pair[0]) * tau


def line_of_sight_probability(setting: Setting, elevation_deg: float) -> float:
    """Pr_LoS, the sigmoid of the elevation angle in degrees (III-C.1)."""
    a = setting.s_curve_a
    b = setting.s_curve_b
    return 1 / (1 + a * math.exp(-b * (elevation_deg - a)))


def elevation_deg(uav_m: Vector, user_m: Point) -> float:
    """theta = 180/pi * arcsin(z/d) (III-C.1)."""
    d = distance(uav_m, (user_m[0], user_m[1], 0.0))
    return 180 / math.pi * math.asin(min(1.0, uav_m[2] / d))


def path_loss_db(setting: Setting, uav_m: Vector, user_m: Point) -> float:
    """L^A2G: LoS and NLoS losses weighted by their probabilities (III-C.1)."""
    d = distance(uav_m, (user_m[0], user_m[1], 0.0))
    free_space_db = (
        20 * math.log10(d)
        + 20 * math.log10(setting.carrier_hz)
        + 20 * math.log10(4 * math.pi / SPEED_OF_LIGHT_MPS)
    )
    los = line_of_sight_probability(setting, elevation_deg(uav_m, user_m))
    los_loss_db = free_space_db + setting.eta_los_db
    nlos_loss_db = free_space_db + setting.eta_nlos_db
    return los * los_loss_db + (1 - los) * nlos_loss_db


def received_power_w(setting: Setting, uav_m: Vector, power_w: float, user_m: Point) -> float:
    """P_n G_tx G_rx 10^(-L/10), the numerator of the access SNR (III-D, M3)."""
    gain = decibel_to_ratio(setting.antenna_gain_dbi)
    return power_w * gain * gain * 10 ** (-path_loss_db(setting, uav_m, user_m) / 10)


def access_snr(setting: Setting, uav_m: Vector, power_w: float, user_m: Point) -> float:
    """gamma_{n,m}, a ratio, over the entire sub-band (III-D)."""
    noise_w = dbm_to_watt(setting.noise_density_dbm_per_hz) * setting.bandwidth_hz
    return received_power_w(setting, uav_m, power_w, user_m) / noise_w


def backhaul_snr(setting: Setting, uav_m: Vector) -> float:
    """gamma_n^BH of the best mast, a ratio, by free-space propagation (III-C.3, M45).

    Without masts, what lies above the threshold as far as the observation's scale reaches.
    """
    gain = decibel_to_ratio(setting.antenna_gain_dbi)
    noise_w = dbm_to_watt(setting.noise_density_dbm_per_hz) * setting.backhaul_bandwidth_hz
    numerator = dbm_to_watt(setting.gbs_power_dbm) * gain * gain * SPEED_OF_LIGHT_MPS**2
    if not setting.masts_m:
        return decibel_to_ratio(
            setting.backhaul_threshold_db + setting.backhaul_observation_scale_db
        )
    best = 0.0
    for mast_m in setting.masts_m:
        d = distance(uav_m, mast_m)
        best = max(best, numerator / ((4 * math.pi * setting.carrier_hz * d) ** 2 * noise_w))
    return best


def mast_rates_bps(
    setting: Setting,
    users_m: list[Point],
    target_users: list[bool],
    shadowing_db: list[list[float]],
) -> tuple[list[float], list[int]]:
    """Rates of the users that are no targets, 0 for others, and the mast of each (III-C.2, M45).

    The mast is -1 where none reaches the SNR; a mast's band is shared equally by its users (M4).
    ``shadowing_db`` holds a list for each mast.
    """
    noise_w = dbm_to_watt(setting.noise_density_dbm_per_hz) * setting.gbs_bandwidth_hz
    servers, snrs = [], []
    for m in range(len(users_m)):
        best, best_snr = NOT_SERVED, 0.0
        for g in range(len(setting.masts_m)):
            d = distance(setting.masts_m[g], (users_m[m][0], users_m[m][1], 0.0))
            loss_db = (
                20 * math.log10(4 * math.pi * setting.carrier_hz / SPEED_OF_LIGHT_MPS)
                + 10 * setting.gbs_path_loss_exponent * math.log10(d)
                + shadowing_db[g][m]
            )
            snr = dbm_to_watt(setting.gbs_power_dbm) * 10 ** (-loss_db / 10) / noise_w
            if snr > best_snr:
                best, best_snr = g, snr
        is_served = not target_users[m] and best_snr >= decibel_to_ratio(setting.required_snr_db)
        servers.append(best if is_served else NOT_SERVED)
        snrs.append(best_snr)
    rates = [0.0 for _ in users_m]
    for m in range(len(users_m)):
        if servers[m] != NOT_SERVED:
            members = sum(1 for server in servers if server == servers[m])
            rates[m] = setting.gbs_bandwidth_hz / members * math.log2(1 + snrs[m])
    return rates, servers


def level_propulsion_power_w(setting: Setting, speed_mps: float) -> float:
    """P_prop at the speed ||v|| (III-E)."""
    v = speed_mps
    v0 = setting.induced_velocity_mps
    blade = setting.blade_profile_power_w * (1 + 3 * v**2 / setting.tip_speed_mps**2)
    induced = setting.induced_power_w * (
        (math.sqrt(1 + v**4 / (4 * v0**4)) - v**2 / (2 * v0**2)) ** 0.5
    )
    parasite = (
        0.5
        * setting.fuselage_drag_ratio
        * setting.air_density_kgpm3
        * setting.rotor_solidity
        * setting.rotor_disc_area_m2
        * v**3
    )
    return blade + induced + parasite


def propulsion_power_w(setting: Setting, velocity_mps: Vector) -> float:
    """P_prop of the 3-D speed, plus m g max(v_z, 0) if a mass is set (III-E, M24)."""
    climb = setting.climb_mass_kg * GRAVITY_MPS2 * max(velocity_mps[2], 0.0)
    return level_propulsion_power_w(setting, speed_of(velocity_mps)) + climb


def least_propulsion_power_w(setting: Setting) -> float:
    """The least of P_prop over 0..V_max: a dense grid, then a ternary search around its best."""
    steps = 1500
    best = 0
    for step in range(steps + 1):
        here = level_propulsion_power_w(setting, setting.v_max_mps * step / steps)
        if here < level_propulsion_power_w(setting, setting.v_max_mps * best / steps):
            best = step
    low = setting.v_max_mps * max(best - 1, 0) / steps
    high = setting.v_max_mps * min(best + 1, steps) / steps
    for _ in range(100):
        left = low + (high - low) / 3
        right = high - (high - low) / 3
        if level_propulsion_power_w(setting, left) < level_propulsion_power_w(setting, right):
            high = right
        else:
            low = left
    return min(
        level_propulsion_power_w(setting, (low + high) / 2),
        level_propulsion_power_w(setting, 0.0),
        level_propulsion_power_w(setting, setting.v_max_mps),
    )


def best_rate(setting: Setting) -> float:
    """B log2(1 + SNR straight below a UAV at H_min and P_max), in bit/s (M7, M13)."""
    uav_m = (0.0, 0.0, setting.altitude_min_m)
    snr = access_snr(setting, uav_m, setting.power_max_w, (0.0, 0.0))
    return setting.bandwidth_hz * math.log2(1 + snr)


def ee_max(setting: Setting) -> float:
    """EE_max of M7, in bit per joule."""
    return best_rate(setting) / (least_propulsion_power_w(setting) + setting.power_max_w)


def jain(values: list[float]) -> float:
    """Jain's index; 0 for an empty or all-zero set (IV-C.3, M14)."""
    total = 0.0
    squares = 0.0
    for value in values:
        total += value
        squares += value * value
    if squares == 0:
        return 0.0
    return total**2 / (len(values) * squares)


def move(setting: Setting, position_m: Vector, action: tuple[float, ...]) -> tuple[Vector, bool]:
    """The next position, and whether the wanted one left the flight box (IV-C.2, M5, M20, M25)."""
    wanted_step = []
    for axis in range(3):
        wanted_step.append(setting.displacement_scale_m[axis] * clip(action[axis], -1.0, 1.0))
    length = math.sqrt(wanted_step[0] ** 2 + wanted_step[1] ** 2 + wanted_step[2] ** 2)
    longest = setting.v_max_mps * setting.slot_s
    if length > longest:
        for axis in range(3):
            wanted_step[axis] = wanted_step[axis] * longest / length
    lows = (0.0, 0.0, setting.altitude_min_m)
    highs = (setting.area_m[0], setting.area_m[1], setting.altitude_max_m)
    outside = False
    reached = []
    for axis in range(3):
        wanted = position_m[axis] + wanted_step[axis]
        if wanted < lows[axis] or wanted > highs[axis]:
            outside = True
        reached.append(clip(wanted, lows[axis], highs[axis]))
    return (reached[0], reached[1], reached[2]), outside


def change_power(setting: Setting, power_w: float, action: tuple[float, ...]) -> float:
    """P_n + delta_p * action, kept in [P_min, P_max] (IV-C.2, constraint of (P1), M20)."""
    wanted = power_w + setting.power_step_w * clip(action[3], -1.0, 1.0)
    return clip(wanted, setting.power_min_w, setting.power_max_w)


def strongest_uav(
    setting: Setting, uavs_m: list[Vector], powers_w: list[float], user_m: Point
) -> int:
    """The UAV whose received power is the greatest; the first of equals (Max-RSSI, III-D)."""
    best = 0
    best_power_w = received_power_w(setting, uavs_m[0], powers_w[0], user_m)
    for n in range(1, len(uavs_m)):
        here_w = received_power_w(setting, uavs_m[n], powers_w[n], user_m)
        if here_w > best_power_w:
            best = n
            best_power_w = here_w
    return best


def associate(
    setting: Setting,
    uavs_m: list[Vector],
    powers_w: list[float],
    users_m: list[Point],
    target_users: list[bool],
) -> list[int]:
    """Each target user's UAV, or -1 where its best one is below the required SNR (III-D, M11)."""
    association = []
    for m in range(len(users_m)):
        server = NOT_SERVED
        if target_users[m]:
            n = strongest_uav(setting, uavs_m, powers_w, users_m[m])
            snr = access_snr(setting, uavs_m[n], powers_w[n], users_m[m])
            if snr >= decibel_to_ratio(setting.required_snr_db):
                server = n
        association.append(server)
    return association


def bandwidth_shares(rule: str, efficiencies: list[float]) -> list[float]:
    """omega of one cell's users, given their log2(1 + SNR) (Proposition 1, eq. user_rate, M12)."""
    shares = []
    if rule == "mmf":
        inverses = 0.0
        for efficiency in efficiencies:
            inverses += 1 / efficiency
        for efficiency in efficiencies:
            shares.append(1 / efficiency / inverses)
    elif rule == "pf":
        for _ in efficiencies:
            shares.append(1 / len(efficiencies))
    elif rule == "se":
        total = 0.0
        for efficiency in efficiencies:
            total += efficiency
        for efficiency in efficiencies:
            shares.append(efficiency / total)
    else:
        raise ValueError(f"unknown bandwidth shares: {rule}")
    return shares


def user_rates_bps(
    setting: Setting,
    uavs_m: list[Vector],
    powers_w: list[float],
    users_m: list[Point],
    association: list[int],
) -> list[float]:
    """R_m = omega B log2(1 + SNR) of the users that a UAV serves, 0 for the others (III-D)."""
    rates = [0.0 for _ in users_m]
    for n in range(len(uavs_m)):
        members = []
        efficiencies = []
        for m in range(len(users_m)):
            if association[m] == n:
                members.append(m)
                snr = access_snr(setting, uavs_m[n], powers_w[n], users_m[m])
                efficiencies.append(math.log2(1 + snr))
        shares = bandwidth_shares(setting.shares, efficiencies)
        for k in range(len(members)):
            rates[members[k]] = shares[k] * setting.bandwidth_hz * efficiencies[k]
    return rates


def log_rate_term(setting: Setting, target_rates_bps: list[float]) -> float:
    """The PF reward: mean over target users of the scaled log rate; unserved counts 0 (M13)."""
    if not target_rates_bps:
        return 0.0
    floor = setting.log_rate_floor_bps
    total = 0.0
    for rate in target_rates_bps:
        if rate > 0:
            total += clip(math.log(rate / floor) / math.log(best_rate(setting) / floor), 0.0, 1.0)
    return total / len(target_rates_bps)


def collisions_of(setting: Setting, uavs_m: list[Vector], n: int) -> int:
    """How many other UAVs are nearer to UAV n than d_min (eq. penalty_reward)."""
    count = 0
    for j in range(len(uavs_m)):
        if j != n and distance(uavs_m[n], uavs_m[j]) < setting.min_separation_m:
            count += 1
    return count


def nearest_user_m(uav_m: Vector, users_m: list[Point]) -> float:
    """Horizontal distance to the nearest of all users (M18)."""
    nearest = math.inf
    for user in users_m:
        nearest = min(nearest, math.sqrt((uav_m[0] - user[0]) ** 2 + (uav_m[1] - user[1]) ** 2))
    return nearest


def histogram(setting: Setting, users_m: list[Point]) -> list[float]:
    """u_dist: fractions of all users in a grid of cells, x first (M19)."""
    cells = setting.histogram_cells
    counts = [0.0 for _ in range(cells * cells)]
    for user in users_m:
        column = int(clip(math.floor(cells * user[0] / setting.area_m[0]), 0, cells - 1))
        row = int(clip(math.floor(cells * user[1] / setting.area_m[1]), 0, cells - 1))
        counts[column * cells + row] += 1
    return [count / len(users_m) for count in counts]


def observe(
    setting: Setting,
    uav_m: Vector,
    power_w: float,
    users_m: list[Point],
    load: int,
    violation_slots: tuple[int, int, int],
    slots: int,
) -> list[float]:
    """o_n of IV-C.1 on the scales of M17 and M18: 16 numbers."""
    x, y, z = uav_m
    east, north = setting.area_m
    low = setting.altitude_min_m
    high = setting.altitude_max_m
    height = fraction_of_range(z, low, high)
    room_above = fraction_of_range(high - z, 0.0, high - low)
    margin_db = 10 * math.log10(backhaul_snr(setting, uav_m)) - setting.backhaul_threshold_db
    return [
        x / east,
        y / north,
        height,
        fraction_of_range(power_w, setting.power_min_w, setting.power_max_w),
        nearest_user_m(uav_m, users_m) / max(east, north),  # M44
        load / len(users_m),
        x / east,
        (east - x) / east,
        y / north,
        (north - y) / north,
        height,
        room_above,
        violation_slots[0] / slots,
        violation_slots[1] / slots,
        violation_slots[2] / slots,
        margin_db / setting.backhaul_observation_scale_db,
    ]


def fly(setting: Setting, slot: Slot) -> Outcome:
    """One slot: UAVs move, powers change, (users have moved), associate, rates, reward (M25)."""
    uavs = len(slot.uav_positions_m)
    users = len(slot.users_m)
    if uavs == 0 or users == 0:
        raise ValueError("a slot needs at least one UAV and one user")
    if setting.objective not in ("mmf", "pf"):
        raise ValueError(f"unknown objective: {setting.objective}")

    # UAVs move; the velocity is the realised displacement over the slot (M25).
    positions: list[Vector] = []
    velocities: list[Vector] = []
    left_box: list[bool] = []
    for n in range(uavs):
        before = slot.uav_positions_m[n]
        after, outside = move(setting, before, slot.actions[n])
        positions.append(after)
        left_box.append(outside)
        velocities.append(
            (
                (after[0] - before[0]) / setting.slot_s,
                (after[1] - before[1]) / setting.slot_s,
                (after[2] - before[2]) / setting.slot_s,
            )
        )

    powers = []
    for n in range(uavs):
        powers.append(change_power(setting, slot.transmit_powers_w[n], slot.actions[n]))

    association = associate(setting, positions, powers, slot.users_m, slot.target_users)
    rates = user_rates_bps(setting, positions, powers, slot.users_m, association)
    loads = [0 for _ in range(uavs)]
    for m in range(users):
        if association[m] != NOT_SERVED:
            loads[association[m]] += 1

    # Sums over the users; coverage of no targets is 1, the worst of no targets is 0 (M14).
    served_rates = []
    target_rates = []
    for m in range(users):
        if association[m] != NOT_SERVED:
            served_rates.append(rates[m])
        if slot.target_users[m]:
            target_rates.append(rates[m])
    coverage = len(served_rates) / len(target_rates) if target_rates else 1.0
    worst_rate = min(target_rates) if target_rates else 0.0
    sum_rate = 0.0
    for rate in served_rates:
        sum_rate += rate
    rate_jfi = jain(served_rates)
    load_jfi = jain([float(load) for load in loads])

    # Energy efficiency over the total power (eq. ee_reward, M7, M30).
    propulsion_w = 0.0
    total_power_w = 0.0
    for n in range(uavs):
        propulsion_w += propulsion_power_w(setting, velocities[n])
        total_power_w += powers[n] + propulsion_power_w(setting, velocities[n])
    efficiency = sum_rate / total_power_w
    efficiency_term = clip(
        sum_rate / (total_power_w + setting.power_epsilon_w) / ee_max(setting), 0.0, 1.0
    )
    rate_term = rate_jfi
    if setting.objective == "pf":
        rate_term = log_rate_term(setting, target_rates)

    # Penalties and rewards (eq. hybrid_reward, eq. penalty_reward).
    tau = slot.progress
    rewards = []
    near_counts = []
    weak_links = []
    for n in range(uavs):
        near = collisions_of(setting, positions, n)
        threshold = decibel_to_ratio(setting.backhaul_threshold_db)
        weak = backhaul_snr(setting, positions[n]) < threshold
        near_counts.append(near)
        weak_links.append(weak)
        penalty = (
            setting.collision_penalty * near
            + setting.boundary_penalty * (1 if left_box[n] else 0)
            + scheduled(setting.backhaul_penalty, tau) * (1 if weak else 0)
        )
        rewards.append(
            scheduled(setting.coverage_weight, tau) * coverage
            + scheduled(setting.efficiency_weight, tau) * efficiency_term
            + scheduled(setting.load_weight, tau) * load_jfi
            + scheduled(setting.rate_weight, tau) * rate_term
            - scheduled(setting.penalty_weight, tau) * penalty
        )

    # Observations, with this slot counted among the episode's (M17, M18), and the state (M19).
    observations = []
    for n in range(uavs):
        past = slot.past_violation_slots[n]
        violation_slots = (
            past[0] + (1 if near_counts[n] > 0 else 0),
            past[1] + (1 if left_box[n] else 0),
            past[2] + (1 if weak_links[n] else 0),
        )
        observations.append(
            observe(
                setting,
                positions[n],
                powers[n],
                slot.users_m,
                loads[n],
                violation_slots,
                slot.past_slots + 1,
            )
        )
    state: list[float] = []
    for observation in observations:
        state.extend(observation)
    state.extend(histogram(setting, slot.users_m))
    state.append(rate_jfi)

    metrics = {
        "coverage": coverage,
        "energy_efficiency_bit_per_joule": efficiency,
        "rate_jfi": rate_jfi,
        "load_jfi": load_jfi,
        "worst_rate_bps": worst_rate,
        "sum_rate_bps": sum_rate,
        "propulsion_power_w": propulsion_w,
        "collisions": sum(near_counts) // 2,
        "boundary_violations": sum(1 for outside in left_box if outside),
        "backhaul_violations": sum(1 for weak in weak_links if weak),
    }
    return Outcome(
        uav_positions_m=positions,
        uav_velocities_mps=velocities,
        transmit_powers_w=powers,
        association=association,
        rates_bps=rates,
        loads=loads,
        rewards=rewards,
        metrics=metrics,
        observations=observations,
        state=state,
    )
