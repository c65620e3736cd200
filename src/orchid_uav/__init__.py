"""ORCHID: fairness-aware orchestration of UAV base stations.

Importing the package registers the joint problem with Gymnasium:
``gymnasium.make("orchid/Fleet-v0")`` and ``gymnasium.make_vec("orchid/Fleet-v0", num_envs=8)``.
"""

from orchid_uav.python_version import complaint

if complaint():
    # With a name, ``python -m orchid_uav`` shows the message without a traceback.
    raise ImportError(complaint(), name=__name__)

from importlib.metadata import version

import gymnasium

__version__ = version("orchid-uav")

gymnasium.register(
    id="orchid/Fleet-v0",
    entry_point="orchid_uav.envs.interfaces.gymnasium_env:FleetEnv",
    vector_entry_point="orchid_uav.envs.interfaces.gymnasium_env:FleetVectorEnv",
)
