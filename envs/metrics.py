"""Names of the metrics reported per slot and per episode, in the order of their columns."""

REWARD = "reward"
"""Reward averaged over UAVs."""

SLOT_METRICS = (
    "coverage",
    "energy_efficiency_bit_per_joule",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "sum_rate_bps",
    "propulsion_power_w",
    "collisions",
    "boundary_violations",
    "backhaul_violations",
)
"""Fleet metrics of a slot. Rates and power are sums over the fleet but for the worst user's rate;
collisions count pairs, the two kinds of violations UAVs."""

EPISODE_METRICS = (REWARD, *SLOT_METRICS)
"""An episode's metrics: the reward is summed over slots."""

DIAGNOSTIC_METRICS = (
    "utility",
    "thrust_energy_efficiency_bit_per_joule",
    "nearest_uav_m",
    "displacement_m",
    "user_snr_db",
    "blocking_pairs",
    "gbs_rate_bps",
    "gbs_coverage",
    "total_coverage",
)
"""Further metrics of an episode, all means over its slots; see :mod:`orchid_uav.envs.diagnostics`:
U_total at training progress 1; the energy efficiency with a load factor in the induced power; the
mean distance of UAVs to the nearest other one, and to where they were at slot 0; the mean SNR of
the users that UAVs serve, NaN where they serve none; user-UAV pairs that would both gain by
deviating; the mean rate of the GBS's users; the served share of them, and of all users."""

COUNTS = frozenset({"collisions", "boundary_violations", "backhaul_violations"})
"""Episode metrics that count slots."""
SUMMED_OVER_SLOTS = COUNTS | {REWARD}
"""Episode metrics that are sums over slots; the others are means over slots."""

(
    COVERAGE,
    ENERGY_EFFICIENCY,
    RATE_JFI,
    LOAD_JFI,
    WORST_RATE,
    SUM_RATE,
    PROPULSION_POWER,
    COLLISIONS,
    BOUNDARY_VIOLATIONS,
    BACKHAUL_VIOLATIONS,
) = range(len(SLOT_METRICS))
"""Columns of a slot's metrics, for the compiled step."""
