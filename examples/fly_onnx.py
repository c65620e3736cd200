"""Fly an exported policy with onnxruntime: ``python examples/fly_onnx.py actor.onnx``.

``orchid export orchid-distilled --onnx actor.onnx`` writes such a file. It flies beside the zero
action, which leaves every UAV where it starts, or circling there.
"""

import json
import sys

import numpy as np
import onnxruntime

from orchid_uav.envs import parallel_env

session = onnxruntime.InferenceSession(sys.argv[1])
about = session.get_modelmeta().custom_metadata_map
env = parallel_env(uavs=6, users=100, speed_mps=5.0, **json.loads(about["settings"]))


def policy(observations):
    return session.run(["action"], {"observation": observations})[0]


def zero(observations):
    return np.zeros((len(observations), 4), np.float32)


def fly(act, seed):
    observations, _ = env.reset(seed=seed)
    while env.agents:
        actions = act(np.stack([observations[agent] for agent in env.agents]))
        observations, _, _, _, infos = env.step(dict(zip(env.agents, actions, strict=True)))
    return infos["uav_0"]["episode_metrics"]


flown = [(fly(policy, seed), fly(zero, seed)) for seed in range(5)]
print(f"{about['run']}, beside zero, means of {len(flown)} topologies")
for name in flown[0][0]:
    learned, still = (np.mean([pair[one][name] for pair in flown]) for one in (0, 1))
    print(f"{name:36}{learned:14.5g}{still:14.5g}")
