"""Built-in configurations, and other defaults that come with an algorithm."""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Preset(NamedTuple):
    """A built-in configuration."""

    idea: str
    """What it is for."""
    sections: Mapping[str, Mapping[str, Any]]
    """Differences from the defaults, which are the paper's."""


PRESETS = {
    "paper": Preset("the paper's run, one to three minutes of one core", {}),
    "quick": Preset(
        "a run of half a minute, on a slow core of one, for trying things: the paper's network, "
        "fewer episodes, and a Reset-and-Finetune that leaves more than half of them after a reset",
        {
            "reset": {"window": 20},
            "checkpoint": {"every_episodes": 20},
            "training": {"episodes": 100},
        },
    ),
    "informed": Preset(
        "the paper's method where it can move something: on stations, for users that walk, with an "
        "observation that says what a UAV on board knows; eight minutes of one core",
        {
            "network": {"user_speed_mps": 15.0, "heading_hold_s": 20.0},
            "uav": {"flight": "station", "observation": "informed"},
            "deployment": {"init": "balanced"},
            "ppo": {
                "actor_learning_rate": 3e-4,
                "discount": 0.9,
                "gae_lambda": 0.9,
                "batch_size": 512,
                "epochs": 3,
                "entropy_coef": (0.0, 0.0),
                "log_std_init": -1.0,
            },
            "checkpoint": {"every_episodes": 500},
            "training": {"episodes": 3000, "worlds": 20, "center_rewards": True},
        },
    ),
    "distilled": Preset(
        "a policy on stations that imitates best response and knows less than it, some twelve "
        "minutes of one core",
        {
            "uav": {"flight": "station", "observation": "informed"},
            "deployment": {"init": "balanced"},
            "training": {"algorithm": "dagger", "episodes": 400, "worlds": 20},
        },
    ),
}
"""Configurations to begin with, by name."""

ALGORITHM_DEFAULTS: dict[str, dict[str, Any]] = {
    "maddpg": {"reset.enabled": False},
    "dagger": {"reset.enabled": False},
}
"""Other defaults for an algorithm: Reset-and-Finetune belongs to ORCHID."""
