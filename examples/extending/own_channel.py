"""A channel of your own: free space, and trees that absorb signals from low elevations.

    python examples/extending/own_channel.py

flies the same rule through this channel and through the built-in one. The function is compiled with
the simulator's step, so it may only use what numba compiles: numbers, NumPy, ``math``.
"""

import numpy as np

from orchid_uav.agents.controllers.heuristics import Loiter
from orchid_uav.envs import Parameters, WorldBatch
from orchid_uav.envs.channel import free_space_path_loss_db
from orchid_uav.envs.diagnostics import Diagnostics

TREE_HEIGHT_M = 15.0
TREE_LOSS_DB_PER_M = 0.2


def woodland_path_loss_db(ground_distance_m, altitude_m, carrier_frequency_hz):
    """Loss in dB; the arguments are the first of ``channel.air_to_ground_path_loss_db``."""
    distance_m = np.sqrt(ground_distance_m**2 + altitude_m**2)
    through_trees_m = distance_m * min(TREE_HEIGHT_M / altitude_m, 1.0)
    return free_space_path_loss_db(distance_m, carrier_frequency_hz) + (
        TREE_LOSS_DB_PER_M * through_trees_m
    )


def fly(path_loss_db=None, worlds: int = 100, **overrides: int) -> dict[str, float]:
    """Fly one episode of circling the K-Means centroids; return means over the worlds."""
    world = WorldBatch(
        Parameters().with_overrides(overrides),
        worlds,
        seed=0,
        air_to_ground_path_loss_db=path_loss_db,  # None: the built-in channel
    )
    world.reset()
    rule, diagnostics = Loiter(), Diagnostics(world)
    rule.begin(world)
    diagnostics.begin()
    while not world.finished.any():
        world.step(rule.act(world))
        diagnostics.observe()
    episodes = [world.episode_metrics(i) | diagnostics.episode_metrics(i) for i in range(worlds)]
    return {name: float(np.mean([one[name] for one in episodes])) for name in episodes[0]}


if __name__ == "__main__":
    for name, path_loss_db in (("built-in", None), ("woodland", woodland_path_loss_db)):
        metrics = fly(path_loss_db)
        print(name, *(f"{key} {metrics[key]:.4g}" for key in ("coverage", "sum_rate_bps")))
