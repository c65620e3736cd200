"""The name, scale and direction of every metric of an episode, for tables, plots and pages."""

from typing import Literal, NamedTuple

from orchid_uav.envs.metrics import DIAGNOSTIC_METRICS, EPISODE_METRICS

HEADROOM = "headroom_share"
"""Utility gained over ``loiter-mmf``, as a share of what ``planner`` gains: a ratio of means."""
UNBREAKABLE = "\N{NO-BREAK SPACE}"
"""Joins words that a line break must not divide, such as a number and its unit."""


class Metric(NamedTuple):
    """A metric of evaluation."""

    title: str
    unit: str
    """Unit of the scaled value; empty for plain numbers."""
    scale: float
    """Factor from the stored value to the shown one."""
    digits: int
    """Digits shown after the decimal point."""
    better: Literal["higher", "lower"] | None
    """None if more is neither better nor worse, or if methods cannot be compared by the metric."""

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def text(self, value: float) -> str:
        """The value as it is shown, without its unit."""
        text = f"{value * self.scale:.{self.digits}f}"
        return text.lstrip("-") if float(text) == 0.0 else text


def heading_of(key: str) -> str:
    """A metric's title with its unit; any other key is returned unchanged."""
    return METRICS[key].heading if key in METRICS else key


def label_of(method: str, deterministic: bool) -> str:
    """A method's name, marked if its actions are sampled."""
    return method + ("" if deterministic else ", sampled")


METRICS: dict[str, Metric] = {
    "coverage": Metric("coverage", "", 1.0, 3, "higher"),
    "total_coverage": Metric("total coverage", "", 1.0, 3, "higher"),
    "energy_efficiency_bit_per_joule": Metric("energy efficiency", "Mbit/J", 1e-6, 3, "higher"),
    "rate_jfi": Metric("rate JFI", "", 1.0, 3, "higher"),
    "load_jfi": Metric("load JFI", "", 1.0, 3, "higher"),
    "worst_rate_bps": Metric("worst user's rate", "Mbit/s", 1e-6, 2, "higher"),
    "utility": Metric("utility", "", 1.0, 3, "higher"),
    HEADROOM: Metric("share of the headroom", "%", 100.0, 0, "higher"),
    "sum_rate_bps": Metric("sum rate", "Mbit/s", 1e-6, 0, "higher"),
    "propulsion_power_w": Metric("propulsion power", "W", 1.0, 0, "lower"),
    "thrust_energy_efficiency_bit_per_joule": Metric(
        "energy efficiency, thrust paid for", "Mbit/J", 1e-6, 3, "higher"
    ),
    "reward": Metric("reward", "", 1.0, 1, None),
    "collisions": Metric("collisions", "", 1.0, 2, "lower"),
    "boundary_violations": Metric("boundary violations", "", 1.0, 1, "lower"),
    "backhaul_violations": Metric("backhaul violations", "", 1.0, 1, "lower"),
    "nearest_uav_m": Metric("distance to the nearest UAV", "m", 1.0, 0, None),
    "displacement_m": Metric("distance from the start", "m", 1.0, 0, None),
    "user_snr_db": Metric("users' mean SNR", "dB", 1.0, 2, None),
    "gbs_rate_bps": Metric("GBS users' mean rate", "Mbit/s", 1e-6, 3, None),
    "gbs_coverage": Metric("GBS users' coverage", "", 1.0, 3, None),
    "blocking_pairs": Metric("blocking pairs", "", 1.0, 2, "lower"),
}
"""All metrics by name; those that distinguish methods best come first."""

HEADLINE = tuple(METRICS)[:8]
"""Metrics that are shown where there is no room for all."""

EVALUATION_METRICS = (*EPISODE_METRICS, *DIAGNOSTIC_METRICS)
"""Metrics that every single episode has."""

assert set(METRICS) == {*EVALUATION_METRICS, HEADROOM}
