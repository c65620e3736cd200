"""The batched worlds as an SB3 vector environment: one row per UAV."""

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from orchid_uav.envs.extensions import Extensions
from orchid_uav.envs.interfaces.spaces import (
    action_space,
    centralized_space,
    observation_space,
    state_space,
)
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.world import WorldBatch

Rows = dict[str, NDArray[np.float32]]


class FleetVecEnv(VecEnv):
    """B worlds × N UAVs as B·N rows, row = world·N + UAV, stepped as one batch.

    Observations are {"observation": (B·N, O), "state": (B·N, S)}, the state being the same for
    the rows of a world. A finished episode is a truncation: its rows' infos carry
    ``TimeLimit.truncated``, ``terminal_observation`` and the fleet's ``episode_metrics``; other
    infos are empty.

    Args:
        parameters: the network; Table I by default.
        worlds: number B of worlds.
        seed: of all worlds.
        user_positions_m: the caller's own users, (M, 2) in m.
        own: the caller's own parts, see :class:`Extensions`.
    """

    def __init__(
        self,
        parameters: Parameters | None = None,
        worlds: int = 1,
        seed: int | None = 0,
        user_positions_m: ArrayLike | None = None,
        **own: Unpack[Extensions],
    ) -> None:
        self.world = WorldBatch(parameters, worlds, seed, user_positions_m, **own)
        self.parameters = self.world.parameters
        self.agents_per_world = self.world.uav_count
        self.render_mode = None
        self._actions = np.zeros((worlds, self.agents_per_world, 4))
        super().__init__(
            worlds * self.agents_per_world,
            centralized_space(
                observation_space(self.parameters, self.world.own_observation_size),
                state_space(self.parameters),
            ),
            action_space(),
        )

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed all worlds; takes effect at the next reset."""
        self.world.seed(seed)
        return [seed] * self.num_envs

    def reset(self) -> Rows:
        """Begin an episode in every world."""
        self.world.reset()
        return self.rows()

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions (B·N, 4) for :meth:`step_wait`."""
        self._actions = actions.reshape(self.world.world_count, self.agents_per_world, -1)

    def step_wait(self) -> VecEnvStepReturn:
        """Fly one slot in every world; finished worlds begin a new episode at once."""
        self.world.step(self._actions)
        rewards = self.world.arrays.rewards.reshape(-1).astype(np.float32)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        finished = self.world.finished
        dones = np.repeat(finished, self.agents_per_world)
        if finished.any():
            self._describe_ends(np.flatnonzero(finished), infos)
            self.world.reset(np.flatnonzero(finished))
        return self.rows(), rewards, dones, infos

    def _describe_ends(self, finished: NDArray[np.int64], infos: list[dict[str, Any]]) -> None:
        observations = self.world.observations()
        for world in finished:
            state = self.world.arrays.states[world].copy()
            metrics = self.world.episode_metrics(int(world))
            for uav in range(self.agents_per_world):
                observation = observations[world, uav].copy()
                infos[world * self.agents_per_world + uav] |= {
                    "TimeLimit.truncated": True,
                    "terminal_observation": {"observation": observation, "state": state},
                    "episode_metrics": metrics,
                }

    def rows(self) -> Rows:
        """The latest observations, as ``reset`` or ``step`` gave them."""
        observations = self.world.observations().reshape(self.num_envs, -1).copy()
        return {
            "observation": observations,
            "state": np.repeat(self.world.arrays.states, self.agents_per_world, axis=0),
        }

    def set_progress(self, progress: float) -> None:
        """Training progress tau of the weight schedules."""
        self.world.set_progress(progress)

    def snapshot(self, row: int = 0) -> dict[str, Any]:
        """Physical state of the row's world; see :meth:`WorldBatch.snapshot`."""
        return self.world.snapshot(row // self.agents_per_world)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of this environment, once per row asked for."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Not supported: the rows are one object, and its parameters are frozen."""
        raise NotImplementedError("make a new environment to change its parameters")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call ``set_progress`` (once, for all worlds), or ``snapshot`` for each row asked for."""
        rows = list(self._get_indices(indices))
        if method_name == "snapshot":
            return [self.snapshot(row) for row in rows]
        if method_name == "set_progress":
            self.set_progress(*method_args, **kwargs)
            return [None] * len(rows)
        raise AttributeError(f"the environment has no method '{method_name}' per row")

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """No row is wrapped."""
        return [False for _ in self._get_indices(indices)]
