"""Who flies. Loading a released actor needs neither SB3 nor torch, hence the late imports."""

from typing import TYPE_CHECKING, Any

from orchid_uav.agents.actor import LocalActor, load_policy

if TYPE_CHECKING:
    from orchid_uav.agents.mappo import MAPPO
    from orchid_uav.agents.policies import CentralizedCriticPolicy

__all__ = ["MAPPO", "CentralizedCriticPolicy", "LocalActor", "load_policy"]


def __getattr__(name: str) -> Any:
    if name == "MAPPO":
        from orchid_uav.agents.mappo import MAPPO

        return MAPPO
    if name == "CentralizedCriticPolicy":
        from orchid_uav.agents.policies import CentralizedCriticPolicy

        return CentralizedCriticPolicy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
