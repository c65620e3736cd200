"""Ways to make an environment from a few keywords."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.interfaces.pettingzoo_env import FleetParallelEnv
from orchid_uav.envs.parameters import Distribution, Objective, Observation, Parameters, Start
from orchid_uav.extras import import_extra

if TYPE_CHECKING:
    from pettingzoo import ParallelEnv
    from stable_baselines3.common.vec_env import VecEnv

    from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
    from orchid_uav.envs.world import WorldBatch


def fleet_parameters(
    uavs: int | None = None,
    users: int | ArrayLike | None = None,
    distribution: Distribution | None = None,
    objective: Objective | None = None,
    speed_mps: float | None = None,
    observation: Observation | None = None,
    init: Start | None = None,
    parameters: Parameters | None = None,
    air_to_ground_path_loss_db: Callable[..., Any] | None = None,
    observe: Callable[["WorldBatch"], NDArray[Any]] | None = None,
    extra_reward: Callable[["WorldBatch"], NDArray[Any]] | None = None,
    **overrides: Any,
) -> dict[str, Any]:
    """The keywords of every environment, as arguments of :class:`WorldBatch`.

    Args:
        uavs: ``network.uav_count``.
        users: ``network.user_count``, or the users' positions (M, 2) in m.
        distribution: ``network.distribution``.
        objective: ``reward.objective``.
        speed_mps: ``network.user_speed_mps``.
        observation: ``uav.observation``.
        init: ``deployment.init``.
        parameters: what the other keywords are applied to; Table I by default.
        air_to_ground_path_loss_db: the caller's own channel, see :class:`Extensions`.
        observe: the caller's own observations.
        extra_reward: the caller's own term of the reward.
        overrides: any other parameter by its name, ``heading_hold_s=20.0``, or with its section,
            ``**{"network.heading_hold_s": 20.0}``.

    Raises:
        ValueError: an unknown name, or a value that does not fit.
    """
    named: dict[str, Any] = {
        "network.uav_count": uavs,
        "network.distribution": distribution,
        "reward.objective": objective,
        "network.user_speed_mps": speed_mps,
        "uav.observation": observation,
        "deployment.init": init,
    }
    positions = None
    if users is None or isinstance(users, int | np.integer):
        named["network.user_count"] = users
    else:
        positions = np.asarray(users, dtype=np.float64)
        named["network.user_count"] = len(positions) if positions.ndim else None
    chosen = {name: value for name, value in named.items() if value is not None}
    return {
        "parameters": (parameters or Parameters()).with_overrides({**chosen, **overrides}),
        "user_positions_m": positions,
        "air_to_ground_path_loss_db": air_to_ground_path_loss_db,
        "observe": observe,
        "extra_reward": extra_reward,
    }


def parallel_env(**keywords: Any) -> FleetParallelEnv:
    """A PettingZoo environment, one agent per UAV; keywords: :func:`fleet_parameters`."""
    return FleetParallelEnv(**fleet_parameters(**keywords))


def make_vec_env(worlds: int = 1, seed: int | None = 0, **keywords: Any) -> "FleetVecEnv":
    """An SB3 ``VecEnv`` that steps all worlds at once, a row per UAV.

    Row = world·N + UAV. Observations are {"observation": (rows, O), "state": (rows, S)}.

    Args:
        worlds: number of parallel worlds.
        seed: of all worlds; see :func:`orchid_uav.envs.world.world_seeds`.
        keywords: :func:`fleet_parameters`.
    """
    from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv

    return FleetVecEnv(worlds=worlds, seed=seed, **fleet_parameters(**keywords))


def make_supersuit_vec_env(
    make_env: "Callable[[], ParallelEnv[Any, Any, Any]]", worlds: int = 1, seed: int | None = 0
) -> "VecEnv":
    """An SB3 ``VecEnv`` over any PettingZoo environment with ``state()``, through SuperSuit.

    Args:
        make_env: makes one world; called once for each.
        worlds: number of worlds, stepped one after the other.
        seed: of all worlds, spread over them like that of :func:`make_vec_env`.

    Raises:
        ImportError: SuperSuit, the extra ``supersuit``, is not installed.
    """
    import_extra("supersuit")
    from orchid_uav.envs.interfaces.supersuit_vec_env import SuperSuitVecEnv

    return SuperSuitVecEnv([make_env] * worlds, seed=seed)
