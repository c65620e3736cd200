"""The network as a simulator, and its PettingZoo, Gymnasium and SB3 interfaces.

What is here is loaded when it is first used: numba, scikit-learn and PettingZoo take seconds, and
most of the package needs nothing but :class:`Parameters`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from orchid_uav.envs import channel, deployment, fairness, propulsion, sharing
    from orchid_uav.envs.interfaces.global_state_wrapper import CentralizedState
    from orchid_uav.envs.interfaces.make import make_supersuit_vec_env, make_vec_env, parallel_env
    from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS
    from orchid_uav.envs.parameters import Parameters
    from orchid_uav.envs.seeds import evaluation_seeds, world_seeds
    from orchid_uav.envs.world import WorldBatch

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
    "CentralizedState": "interfaces.global_state_wrapper",
    "EPISODE_METRICS": "metrics",
    "Parameters": "parameters",
    "SLOT_METRICS": "metrics",
    "WorldBatch": "world",
    "evaluation_seeds": "seeds",
    "make_supersuit_vec_env": "interfaces.make",
    "make_vec_env": "interfaces.make",
    "parallel_env": "interfaces.make",
    "world_seeds": "seeds",
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
