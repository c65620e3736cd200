"""Who flies. Loading a released actor needs neither SB3 nor torch, hence the late imports."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from orchid_uav.agents.actor import LocalActor, load_policy

if TYPE_CHECKING:
    from orchid_uav.agents.deterministic_policy import JointCriticPolicy
    from orchid_uav.agents.maddpg import MADDPG
    from orchid_uav.agents.mappo import MAPPO
    from orchid_uav.agents.policies import CentralizedCriticPolicy

__all__ = [
    "MADDPG",
    "MAPPO",
    "CentralizedCriticPolicy",
    "JointCriticPolicy",
    "LocalActor",
    "load_policy",
]

_NEEDING_TORCH = {
    "MADDPG": "maddpg",
    "MAPPO": "mappo",
    "CentralizedCriticPolicy": "policies",
    "JointCriticPolicy": "deterministic_policy",
}


def __getattr__(name: str) -> Any:
    if name in _NEEDING_TORCH:
        return getattr(import_module(f"orchid_uav.agents.{_NEEDING_TORCH[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
