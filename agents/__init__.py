"""Who flies. Loading a released actor needs neither SB3 nor torch, hence the late imports."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from orchid_uav.agents.deployed_actor import LocalActor, load_policy

if TYPE_CHECKING:
    from orchid_uav.agents.maddpg.maddpg import MADDPG
    from orchid_uav.agents.maddpg.policy import JointCriticPolicy
    from orchid_uav.agents.mappo.mappo import MAPPO
    from orchid_uav.agents.mappo.policy import CentralizedCriticPolicy

__all__ = [
    "MADDPG",
    "MAPPO",
    "CentralizedCriticPolicy",
    "JointCriticPolicy",
    "LocalActor",
    "load_policy",
]

_NEEDING_TORCH = {
    "MADDPG": "maddpg.maddpg",
    "MAPPO": "mappo.mappo",
    "CentralizedCriticPolicy": "mappo.policy",
    "JointCriticPolicy": "maddpg.policy",
}


def __getattr__(name: str) -> Any:
    if name in _NEEDING_TORCH:
        return getattr(import_module(f"orchid_uav.agents.{_NEEDING_TORCH[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
