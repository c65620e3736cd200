"""The network as a simulator, and its PettingZoo, Gymnasium and SB3 faces.

What is here is loaded when it is first used: numba, scikit-learn and PettingZoo take seconds, and
most of the package needs nothing but :class:`Parameters`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orchid_uav.envs import channel, deployment, fairness, propulsion, sharing
    from orchid_uav.envs.centralized import CentralizedState
    from orchid_uav.envs.factory import make_supersuit_vec_env, make_vec_env, parallel_env
    from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS
    from orchid_uav.envs.parameters import Parameters
    from orchid_uav.envs.world import WorldBatch, evaluation_seeds, world_seeds

__all__ = [
    "EPISODE_METRICS",
    "SLOT_METRICS",
    "CentralizedState",
    "Parameters",
    "WorldBatch",
    "channel",
    "deployment",
    "evaluation_seeds",
    "fairness",
    "make_supersuit_vec_env",
    "make_vec_env",
    "parallel_env",
    "propulsion",
    "sharing",
    "world_seeds",
]

_HOMES = {
    "CentralizedState": "centralized",
    "EPISODE_METRICS": "metrics",
    "Parameters": "parameters",
    "SLOT_METRICS": "metrics",
    "WorldBatch": "world",
    "evaluation_seeds": "world",
    "make_supersuit_vec_env": "factory",
    "make_vec_env": "factory",
    "parallel_env": "factory",
    "world_seeds": "world",
}
"""The module of each name; the other names are modules themselves, those of the equations."""


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value  # from now on found without this function
        return value
    if name in __all__:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
