"""MAPPO and MADDPG of this project with the interface of this folder, and two variants.

"ippo" is MAPPO whose critic sees what the agent itself observes. "maddpg-tripled" is MADDPG with
three times the gradient steps, at each of which targets follow a third as far. These are as many
steps as AgileRL takes, whose agents learn in turn.
"""

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from orchid_uav.agents.centralized_training import CentralizedTraining
from orchid_uav.agents.maddpg.maddpg import MADDPG
from orchid_uav.agents.mappo.mappo import MAPPO
from orchid_uav.envs import make_supersuit_vec_env
from orchid_uav.experiments.provenance import describe_versions
from studies.simple_spread.task import (
    AGENTS,
    STEPS,
    Learned,
    Policy,
    Progress,
    Settings,
    make_spread,
)


class LocalState(VecEnvWrapper):
    """Gives each agent its own observation as the state, so that MAPPO is independent PPO."""

    agents_per_world = 1

    def __init__(self, env: VecEnv) -> None:
        own = env.observation_space["observation"]
        space = spaces.Dict({"observation": own, "state": own})
        super().__init__(env, observation_space=space)

    def reset(self) -> Any:
        """Begin an episode in every world."""
        return _own(self.venv.reset())

    def step_wait(self) -> Any:
        """Step every world."""
        observation, rewards, dones, infos = self.venv.step_wait()
        for row in np.flatnonzero(dones):
            infos[row]["terminal_observation"] = _own(infos[row]["terminal_observation"])
        return _own(observation), rewards, dones, infos

    def has_attr(self, attr_name: str) -> bool:
        """Whether this wrapper or the wrapped environment has an attribute."""
        return attr_name == "agents_per_world" or self.venv.has_attr(attr_name)

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of each row."""
        if attr_name == "agents_per_world":
            return [1 for _ in self._get_indices(indices)]
        return self.venv.get_attr(attr_name, indices)


def _own(rows: dict[str, Any]) -> dict[str, Any]:
    return {"observation": rows["observation"], "state": rows["observation"]}


class _Judging(BaseCallback):
    def __init__(self, progress: Progress) -> None:
        super().__init__()
        self.progress = progress

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self.judge_if_due()

    def judge_if_due(self) -> None:
        """Judge the policy if due; also called after training, when no further rollout starts."""
        frames = self.model.num_timesteps // AGENTS
        if frames > 0 and self.progress.due(frames):
            self.progress.judge(frames, deterministic_policy(self.model))


def deterministic_policy(model: CentralizedTraining) -> Policy:
    """The actor of a learner without its noise."""

    def act(observations: np.ndarray) -> np.ndarray:
        with torch.inference_mode():
            mean = model.policy.action_mean(torch.from_numpy(observations)).numpy()
        return model.policy.unscale_action(mean)

    return act


def make_learner(name: str, seed: int, settings: Settings) -> CentralizedTraining:
    """One of the learners, ready to learn."""
    env = make_supersuit_vec_env(make_spread, settings.worlds, seed)
    steps = settings.frames_per_iteration // settings.worlds
    policy = {
        "net_arch": settings.hidden_sizes,
        "ortho_init": False,
        "optimizer_kwargs": {"eps": settings.adam_epsilon, "fused": True},
    }
    shared = {
        "learning_rate": settings.learning_rate,
        "critic_learning_rate": settings.learning_rate,
        "gamma": settings.gamma,
        "max_grad_norm": settings.max_grad_norm,
        "seed": seed,
        "policy_kwargs": policy,
    }
    if name.startswith("maddpg"):
        times = 3 if name == "maddpg-tripled" else 1
        special = {
            "buffer_size": settings.buffer_frames,
            "batch_size": settings.batch_frames,
            "target_rate": settings.target_rate / times,
            "update_every": steps,
            "gradient_steps": settings.updates_per_iteration * times,
            "exploration_std": 2.0 * settings.exploration_std,  # on actions in [-1, 1]
            "preactivation_penalty": 0.0,
            "episode_steps": STEPS,
        }
        return MADDPG("JointCriticPolicy", env, **shared, **special)
    special = {
        "n_steps": steps,
        "batch_size": settings.minibatch_frames * AGENTS,
        "minibatch": "rows",
        "n_epochs": settings.epochs,
        "gae_lambda": settings.gae_lambda,
        "clip_range": settings.clip_range,
        "ent_coef": settings.entropy_coefficient,
        "vf_coef": 1.0,
        "normalize_advantage": False,
    }
    return MAPPO(
        "CentralizedCriticPolicy",
        LocalState(env) if name == "ippo" else env,
        **shared,
        **special,
    )


def learn(name: str, seed: int, settings: Settings) -> Learned:
    """Train one of the learners."""
    model = make_learner(name, seed, settings)
    judging = _Judging(Progress(settings))
    model.learn(settings.frames * AGENTS, callback=judging)
    training_s = judging.progress.training_s
    judging.judge_if_due()
    return Learned(deterministic_policy(model), judging.progress, training_s, describe_versions())
