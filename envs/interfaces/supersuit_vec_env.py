"""SuperSuit's path from PettingZoo to SB3, made right.

SuperSuit 3.11 turns a parallel environment into rows, but its SB3 adapter raises on
``reset(seed=)`` and drops seeds, clones its worlds with one generator's state, never says
``TimeLimit.truncated``, and has no working ``get_attr`` or ``env_method``. The two classes here
change just that.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn
from supersuit.vector import ConcatVecEnv, MarkovVectorEnv
from supersuit.vector.sb3_vector_wrapper import SB3VecEnvWrapper

from orchid_uav.envs.interfaces.global_state_wrapper import CentralizedState
from orchid_uav.envs.seeds import world_seeds


class _DistinctWorlds(ConcatVecEnv):
    """Worlds made one by one instead of copied, each reset with its own seed."""

    def reset(self, seed: Sequence[int] | None = None, options: Any = None) -> Any:
        seeds = [None] * len(self.vec_envs) if seed is None else seed
        outcomes = [
            world.reset(seed=world_seed, options=options)
            for world, world_seed in zip(self.vec_envs, seeds, strict=True)
        ]
        infos = [info for _, world_infos in outcomes for info in world_infos]
        return self.concat_obs([observations for observations, _ in outcomes]), infos


class SuperSuitVecEnv(SB3VecEnvWrapper):
    """Rows ordered world by world over any PettingZoo environment with ``state()``.

    Args:
        env_makers: one function per world that makes its environment.
        seed: of all worlds, spread over them by :func:`world_seeds`.
    """

    def __init__(
        self, env_makers: Sequence[Callable[[], ParallelEnv[Any, Any, Any]]], seed: int | None = 0
    ) -> None:
        if not env_makers:
            raise ValueError("worlds is 0: at least 1 is needed")
        self.worlds = [CentralizedState(make()) for make in env_makers]
        self.agents_per_world = len(self.worlds[0].possible_agents)
        rows = _DistinctWorlds(
            [lambda world=world: MarkovVectorEnv(world) for world in self.worlds]
        )
        super().__init__(rows)
        self._next_seed = seed
        self._reset_seeds()
        self._reset_options()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed all worlds; takes effect at the next reset."""
        self._next_seed = seed
        return [seed] * self.num_envs

    def reset(self) -> Any:
        """Begin an episode in every world; a seed counts once, later resets go on from it."""
        seed, self._next_seed = self._next_seed, None
        seeds = None if seed is None else world_seeds(seed, len(self.worlds))
        observations, self.reset_infos = self.venv.reset(seed=seeds)
        return observations

    def step_wait(self) -> VecEnvStepReturn:
        """Step every world; an end by time limit alone is marked as truncation."""
        observations, rewards, terminations, truncations, infos = self.venv.step_wait()
        terminated, truncated = terminations.astype(bool), truncations.astype(bool)
        dones = terminated | truncated
        for row in np.flatnonzero(dones):
            infos[row]["TimeLimit.truncated"] = bool(truncated[row] and not terminated[row])
        return observations, rewards, dones, infos

    def has_attr(self, attr_name: str) -> bool:
        """Whether every row's world, or this adapter, has an attribute."""
        try:
            self.get_attr(attr_name)
        except AttributeError:
            return False
        return True

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of each row's world, or of this adapter."""
        rows = self._get_indices(indices)
        if attr_name == "agents_per_world":
            return [self.agents_per_world for _ in rows]
        return [getattr(self._world(row), attr_name) for row in rows]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of each row's world."""
        for row in self._get_indices(indices):
            setattr(self._world(row).unwrapped, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of each row's world."""
        return [
            getattr(self._world(row), method_name)(*method_args, **kwargs)
            for row in self._get_indices(indices)
        ]

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Whether each row's world is wrapped in ``wrapper_class``."""
        return [isinstance(self._world(row), wrapper_class) for row in self._get_indices(indices)]

    def _world(self, row: int) -> CentralizedState:
        return self.worlds[row // self.agents_per_world]
