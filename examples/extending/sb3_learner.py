"""A learner of your own on the SB3 interface: SB3's unchanged PPO, without a centralised critic.

python examples/extending/sb3_learner.py         # trains for minutes, writes ./sb3_ppo.safetensors
orchid eval --method examples/extending/sb3_learner.py:IndependentPPO --methods learned
"""

from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecExtractDictObs

from orchid_uav.agents.controllers.controller import Actions
from orchid_uav.envs import WorldBatch, make_vec_env

WEIGHTS = Path("sb3_ppo.safetensors")  # SB3's own format runs code that a file contains
LAYERS = {"net_arch": [64, 64]}


def train(episodes: int = 700, **world: int) -> None:
    """Train; every row of the vector environment is a UAV, and all learn one policy."""
    fleet = make_vec_env(**world)
    fleet.set_progress(1.0)  # reward weights as at the end of training
    env = VecExtractDictObs(fleet, "observation")  # a UAV sees no global state
    slots = fleet.parameters.network.episode_slots
    model = PPO("MlpPolicy", env, n_steps=slots, batch_size=slots, policy_kwargs=LAYERS, seed=0)
    model.learn(episodes * slots * env.num_envs)
    save_file(model.policy.state_dict(), WEIGHTS)


class IndependentPPO:
    """Flies the trained policy."""

    def begin(self, world: WorldBatch) -> None:
        """Build the network and read its weights."""
        env = make_vec_env(parameters=world.parameters)
        seen = env.observation_space["observation"]
        self.policy = ActorCriticPolicy(seen, env.action_space, lambda _: 0.0, **LAYERS)
        self.policy.load_state_dict(load_file(WEIGHTS))

    def act(self, world: WorldBatch) -> Actions:
        """The policy's mean for every UAV's observation."""
        seen = world.arrays.observations
        with torch.no_grad():
            actions, _ = self.policy.predict(seen.reshape(-1, seen.shape[2]), deterministic=True)
        return actions.reshape(*seen.shape[:2], 4)


if __name__ == "__main__":
    train()
