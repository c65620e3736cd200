"""The worlds that imitation learns in: another network in every one of its flights."""

from typing import Any, NamedTuple

import numpy as np

from orchid_uav.envs.parameters import Parameters


class Variety(NamedTuple):
    """What the flights differ in; pairs are the ends of uniform draws."""

    uavs: tuple[int, int] = (4, 10)
    users: tuple[int, int] = (50, 200)
    clustered: float = 0.7
    """Share of flights whose users come from a Thomas process, not from all over the area."""
    standing: float = 0.2
    """Share of flights whose users stand still."""
    speed_mps: tuple[float, float] = (0.0, 15.0)
    heading_hold_s: tuple[float, float] = (1.0, 40.0)
    balanced: float = 0.75
    """Share of flights that begin balanced; the others begin where Phase I puts them, or anywhere,
    half each."""
    balanced_restarts: int = 5
    """Fewer than in evaluations, as these starts take a large part of the time."""
    sensing_error_std_m: tuple[float, float] = (0.0, 150.0)
    """Of Phase I."""
    wrong: float = 0.7
    """Share of flights in which users are not where UAVs believe them."""
    flight_error_std_m: tuple[float, float] = (0.0, 200.0)
    late: float = 0.7
    """Share of flights in which UAVs know where users were."""
    delay_s: tuple[float, float] = (0.0, 25.0)
    failing: float = 0.15
    """Share of flights in which a UAV fails."""


DRAWN = (
    "network.uav_count",
    "network.user_count",
    "network.failures",
    "network.distribution",
    "network.user_speed_mps",
    "network.heading_hold_s",
    "network.sensing_error_std_m",
    "deployment.init",
    "deployment.balanced_restarts",
    "sensing.flight_error_std_m",
    "sensing.delay_s",
)
"""Keys of the configuration that are drawn anew for every flight."""


def draw_task(world: Parameters, generator: np.random.Generator, variety: Variety) -> Parameters:
    """The parameters of one flight.

    Args:
        world: the configured network, from which everything but :data:`DRAWN` is taken.
        generator: of the draw.
        variety: what is drawn.
    """
    uavs = int(generator.integers(variety.uavs[0], variety.uavs[1] + 1))
    stands, begins, is_wrong, is_late, fails = generator.random(5)
    init = "balanced" if begins < variety.balanced else "kmeans"
    if begins > 0.5 * (1.0 + variety.balanced):
        init = "random"
    users = int(generator.integers(variety.users[0], variety.users[1] + 1))
    values: dict[str, Any] = {
        "network.uav_count": uavs,
        "network.user_count": max(users, uavs + len(world.gbs_positions_m)),
        "network.failures": [],  # those of the configuration may name UAVs that are not there
        "network.distribution": "tcp" if generator.random() < variety.clustered else "uniform",
        "network.user_speed_mps": float(generator.uniform(*variety.speed_mps))
        if stands >= variety.standing
        else 0.0,
        "network.heading_hold_s": float(generator.uniform(*variety.heading_hold_s)),
        "network.sensing_error_std_m": float(generator.uniform(*variety.sensing_error_std_m)),
        "deployment.init": init,
        "deployment.balanced_restarts": variety.balanced_restarts,
        "sensing.flight_error_std_m": float(generator.uniform(*variety.flight_error_std_m))
        if is_wrong < variety.wrong
        else 0.0,
        "sensing.delay_s": float(generator.uniform(*variety.delay_s))
        if is_late < variety.late
        else 0.0,
    }
    failed, slot = generator.integers(uavs), generator.integers(world.network.episode_slots)
    if fails < variety.failing:
        values["network.failures"] = [f"{failed}@{slot}"]
    return world.with_overrides(values)
