"""Replay of whole-fleet transitions."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import BaseBuffer

from orchid_uav.agents.centralized_training import Rows
from orchid_uav.storage.tensors import Tensors, TensorSpec

Floats = NDArray[np.float32]


class JointBatch(NamedTuple):
    """Transitions of one gradient step, a row per world and step; N agents."""

    observations: torch.Tensor
    """(rows, N, O)."""
    states: torch.Tensor
    """(rows, S)."""
    actions: torch.Tensor
    """(rows, N, A) in [-1, 1]."""
    rewards: torch.Tensor
    """Mean over the agents, (rows,)."""
    next_observations: torch.Tensor
    """(rows, N, O)."""
    next_states: torch.Tensor
    """(rows, S)."""
    terminated: torch.Tensor
    """1 where the episode ended by itself, 0 elsewhere, time limits included (M15); (rows,)."""


class JointReplayBuffer(BaseBuffer):
    """The last ``buffer_size`` transitions, each of one world with all of its agents.

    Args:
        buffer_size: transitions kept at most.
        observation_space: Dict with "observation" and "state".
        action_space: of one agent.
        device: where batches are put.
        n_envs: rows of the environment.
        optimize_memory_usage: not supported.
        agents_per_world: rows that make up one transition.
    """

    observation_space: spaces.Dict

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
        device: torch.device | str = "cpu",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        agents_per_world: int = 1,
    ) -> None:
        super().__init__(buffer_size, observation_space, action_space, device, n_envs=n_envs)
        if optimize_memory_usage:
            raise ValueError("optimize_memory_usage is not supported")
        self.agents_per_world = agents_per_world
        fleet = (buffer_size, agents_per_world)
        observation_size = spaces.flatdim(observation_space["observation"])
        state_size = spaces.flatdim(observation_space["state"])
        # Untouched pages of zeros take no memory, so a buffer costs what has been stored in it.
        self.arrays = [
            np.zeros(shape, np.float32)
            for shape in (
                (*fleet, observation_size),
                (buffer_size, state_size),
                (*fleet, self.action_dim),
                (buffer_size,),
                (*fleet, observation_size),
                (buffer_size, state_size),
                (buffer_size,),
            )
        ]
        """In the order of :class:`JointBatch`."""

    def add(
        self,
        rows: int,
        observation: Rows,
        action: Floats,
        reward: Floats,
        next_observation: Rows,
        terminated: NDArray[np.bool_],
    ) -> None:
        """Store one step of the worlds that the first ``rows`` rows belong to.

        Args:
            rows: a multiple of ``agents_per_world``.
            observation: what the agents saw, by row.
            action: (rows, A) in [-1, 1].
            reward: (rows,).
            next_observation: what they saw then, before an episode that ended was begun anew.
            terminated: (rows,), whether an episode ended other than by a time limit.
        """
        agents = self.agents_per_world
        worlds = rows // agents
        places = (self.pos + np.arange(worlds)) % self.buffer_size
        first_agents = slice(0, rows, agents)
        values = (
            observation["observation"][:rows].reshape(worlds, agents, -1),
            observation["state"][first_agents],
            action[:rows].reshape(worlds, agents, -1),
            reward[:rows].reshape(worlds, agents).mean(axis=1),
            next_observation["observation"][:rows].reshape(worlds, agents, -1),
            next_observation["state"][first_agents],
            terminated[:rows].reshape(worlds, agents).any(axis=1),
        )
        for array, value in zip(self.arrays, values, strict=True):
            array[places] = value
        self.full = self.full or self.pos + worlds >= self.buffer_size
        self.pos = (self.pos + worlds) % self.buffer_size

    def sample(self, batch_size: int, env: Any = None) -> JointBatch:
        """Transitions drawn uniformly, with replacement, by torch's generator."""
        places = torch.randint(self.size(), (batch_size,)).numpy()
        return JointBatch(
            *(torch.from_numpy(array[places]).to(self.device) for array in self.arrays)
        )

    def place(self) -> dict[str, Any]:
        """Where the next transition goes."""
        return {"pos": int(self.pos), "full": bool(self.full)}

    def stored(self) -> Tensors:
        """What is stored, by the names of :class:`JointBatch`."""
        size = self.size()
        return {
            name: array[:size] for name, array in zip(JointBatch._fields, self.arrays, strict=True)
        }

    def stored_specs(self, place: Mapping[str, Any]) -> dict[str, TensorSpec]:
        """Shapes and types of what is stored where the next transition goes to ``place``.

        Raises:
            ValueError: no such place.
        """
        pos, full = place["pos"], place["full"]
        if type(pos) is not int or not 0 <= pos < self.buffer_size or type(full) is not bool:
            raise ValueError(f"no place in a buffer of {self.buffer_size}: {pos!r}, {full!r}")
        size = self.buffer_size if full else pos
        return {
            name: TensorSpec((size, *array.shape[1:]), array.dtype)
            for name, array in zip(JointBatch._fields, self.arrays, strict=True)
        }

    def restore(self, place: Mapping[str, Any], stored: Tensors) -> None:
        """Hold what another buffer of this size held."""
        self.stored_specs(place)
        self.pos, self.full = place["pos"], place["full"]
        for name, array in zip(JointBatch._fields, self.arrays, strict=True):
            array[: self.size()] = stored[name]

    def _get_samples(self, batch_inds: np.ndarray, env: Any = None) -> Any:
        raise NotImplementedError  # SB3's sample() calls it; ours does not
