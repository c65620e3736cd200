"""Small environments and models for tests of the learner."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from orchid_uav.agents import MAPPO
from orchid_uav.envs import make_vec_env

SMALL = {"uavs": 2, "users": 12, "episode_slots": 10}


def small_model(worlds: int = 1, seed: int = 0, n_steps: int = 10, **keywords: Any) -> MAPPO:
    """MAPPO with small networks on a small network, an episode being a rollout."""
    env = make_vec_env(worlds, seed=seed, **SMALL)
    policy = {"net_arch": [32, 32], **keywords.pop("policy_kwargs", {})}
    return MAPPO(
        "CentralizedCriticPolicy",
        env,
        n_steps=n_steps,
        seed=seed,
        policy_kwargs=policy,
        **keywords,
    )


class ConstantReward(VecEnv):
    """Two agents in one world that always see the same and always earn the same reward.

    Args:
        reward: per step.
        length: steps per episode.
        truncates: whether episodes end by a time limit rather than by termination.
    """

    agents_per_world = 2
    render_mode = None

    def __init__(self, reward: float, length: int, truncates: bool = True) -> None:
        box = spaces.Box(-1.0, 1.0, (3,), np.float32)
        super().__init__(
            2,
            spaces.Dict({"observation": box, "state": box}),
            spaces.Box(-1.0, 1.0, (1,), np.float32),
        )
        self.reward, self.length, self.truncates = reward, length, truncates
        self.step_in_episode = 0

    def _rows(self) -> dict[str, np.ndarray]:
        return {key: np.ones((2, 3), np.float32) for key in ("observation", "state")}

    def reset(self) -> dict[str, np.ndarray]:
        self.step_in_episode = 0
        return self._rows()

    def step_async(self, actions: np.ndarray) -> None:
        pass

    def step_wait(self) -> Any:
        self.step_in_episode += 1
        infos: list[dict[str, Any]] = [{}, {}]
        is_over = self.step_in_episode == self.length
        if is_over:
            for row, info in enumerate(infos):
                info["TimeLimit.truncated"] = self.truncates
                info["terminal_observation"] = {
                    key: array[row] for key, array in self._rows().items()
                }
            self.step_in_episode = 0
        return self._rows(), np.full(2, self.reward, np.float32), np.full(2, is_over), infos

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        return [None for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> Sequence[bool]:
        return [False for _ in self._get_indices(indices)]
