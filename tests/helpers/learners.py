"""Small environments and models for tests of the learner."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv

from orchid_uav.agents import MADDPG, MAPPO
from orchid_uav.envs import make_vec_env

SMALL = {"uavs": 2, "users": 12, "episode_slots": 10}
MADDPG_NETWORKS = ("actor", "critic", "actor_target", "critic_target")
SIZES_OF_WISHES = {"observation": 2, "state": 4}


def small_model(worlds: int = 1, seed: int = 0, n_steps: int = 10, **keywords: Any) -> MAPPO:
    """MAPPO with small neural networks on a small UAV network; a rollout is one episode."""
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


def small_maddpg(worlds: int = 1, seed: int = 0, **keywords: Any) -> MADDPG:
    """MADDPG with small neural networks on a small UAV network; it learns from 4 transitions."""
    policy = {"net_arch": [32, 32], **keywords.pop("policy_kwargs", {})}
    defaults = {
        "batch_size": 4,
        "buffer_size": 1000,
        "gradient_steps": worlds,
        "episode_steps": SMALL["episode_slots"],
    }
    env = make_vec_env(worlds, seed=seed, **SMALL)
    return MADDPG("JointCriticPolicy", env, seed=seed, policy_kwargs=policy, **defaults | keywords)


class ConstantReward(VecEnv):
    """Two agents in one world that always see the same and always earn the same reward.

    Args:
        reward: the reward per step.
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


class Clock(ConstantReward):
    """Worlds of two agents whose observations tell agent and time; actions are two numbers in 0..4.

    Agents see (world, agent, episode, step), their state is (world, episode, step), and the reward
    of a step is 100 world + 10 agent + step.

    Args:
        lengths: steps per episode, by world.
        truncates: whether a world's episodes end by a time limit.
    """

    def __init__(self, lengths: Sequence[int], truncates: Sequence[bool]) -> None:
        self.lengths, self.limits = np.array(lengths), list(truncates)
        boxes = {"observation": (4,), "state": (3,)}
        VecEnv.__init__(
            self,
            2 * len(lengths),
            spaces.Dict({key: spaces.Box(-np.inf, np.inf, size) for key, size in boxes.items()}),
            spaces.Box(0.0, 4.0, (2,), np.float32),
        )
        self.world, self.agent = np.divmod(np.arange(self.num_envs), 2)
        self.time = np.zeros((len(lengths), 2))
        self.flown: list[np.ndarray] = []

    def _rows(self) -> dict[str, np.ndarray]:
        episode, step = self.time[self.world].T
        return {
            "observation": np.stack([self.world, self.agent, episode, step], 1).astype(np.float32),
            "state": np.stack([self.world, episode, step], 1).astype(np.float32),
        }

    def reset(self) -> dict[str, np.ndarray]:
        self.time[:] = 0
        return self._rows()

    def step_async(self, actions: np.ndarray) -> None:
        self.flown.append(actions.copy())

    def step_wait(self) -> Any:
        self.time[:, 1] += 1
        rows, is_over = self._rows(), self.time[:, 1] == self.lengths
        rewards = 100 * self.world + 10 * self.agent + self.time[self.world, 1]
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(is_over[self.world]):
            infos[row]["TimeLimit.truncated"] = self.limits[self.world[row]]
            infos[row]["terminal_observation"] = {key: array[row] for key, array in rows.items()}
        self.time[is_over] += [1, 0]
        self.time[is_over, 1] = 0
        return self._rows(), rewards.astype(np.float32), is_over[self.world], infos


class Wishes(ConstantReward):
    """Two agents per world that see two random numbers; the best action is 0.8 times the first.

    An agent's action is rewarded to the other agent, so only shared rewards can teach.
    """

    def __init__(self, worlds: int = 1) -> None:
        super().__init__(0.0, 8)
        box = {key: spaces.Box(-1.0, 1.0, (size,)) for key, size in SIZES_OF_WISHES.items()}
        VecEnv.__init__(self, 2 * worlds, spaces.Dict(box), self.action_space)
        self.random = np.random.default_rng(0)
        self.flown: list[np.ndarray] = []

    def _rows(self) -> dict[str, np.ndarray]:
        self.seen = self.random.uniform(-1.0, 1.0, (self.num_envs, 2)).astype(np.float32)
        return {"observation": self.seen, "state": np.repeat(self.seen.reshape(-1, 4), 2, axis=0)}

    def step_async(self, actions: np.ndarray) -> None:
        self.flown.append(actions.copy())
        self.paid = self.earned(self.seen, actions[:, 0])

    def earned(self, seen: np.ndarray, actions: np.ndarray) -> np.ndarray:
        """Rewards (rows,) of actions (rows,) on observations (rows, 2)."""
        paid = -((actions - 0.8 * seen[:, 0]) ** 2)
        return paid.reshape(-1, 2)[:, ::-1].reshape(-1)

    def step_wait(self) -> Any:
        self.step_in_episode = (self.step_in_episode + 1) % self.length
        is_over = self.step_in_episode == 0
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        rows = self._rows()
        if is_over:
            for row, info in enumerate(infos):
                info["TimeLimit.truncated"] = True
                info["terminal_observation"] = {key: array[row] for key, array in rows.items()}
            rows = self._rows()
        return rows, self.paid.astype(np.float32), np.full(self.num_envs, is_over), infos
