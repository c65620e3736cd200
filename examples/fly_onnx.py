"""Fly an exported policy with onnxruntime: ``python examples/fly_onnx.py actor.onnx``.

``orchid export orchid-distilled --onnx actor.onnx`` writes such a file. It flies beside the zero
action, with which every UAV stays where it starts, or circles there.
"""

import json
import sys

import numpy as np
import onnxruntime

from orchid_uav.envs import parallel_env

session = onnxruntime.InferenceSession(sys.argv[1])
about = session.get_modelmeta().custom_metadata_map
env = parallel_env(uavs=6, users=100, speed_mps=5.0, **json.loads(about["settings"]))


def fly(scale, seed):
    """The metrics of an episode, with the policy's actions times a scale."""
    observations, _ = env.reset(seed=seed)
    while env.agents:
        seen = np.stack([observations[agent] for agent in env.agents])
        (actions,) = session.run(["action"], {"observation": seen})
        moves = dict(zip(env.agents, scale * actions, strict=True))
        observations, _, _, _, infos = env.step(moves)
    return infos["uav_0"]["episode_metrics"]


flown = [(fly(1.0, seed), fly(0.0, seed)) for seed in range(5)]
print(f"{about['run']}, beside zero, means of {len(flown)} topologies")
for name in flown[0][0]:
    learned, still = (np.mean([pair[one][name] for pair in flown]) for one in (0, 1))
    print(f"{name:36}{learned:14.5g}{still:14.5g}")
