"""Storage of one rollout, with the global state kept once per world instead of once per UAV."""

from collections.abc import Generator
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import RolloutBuffer

Floats = NDArray[np.float32]


MiniBatchUnit = Literal["rows", "slots"]
"""What a batch size counts: rows (one step of one UAV), or slots (of all UAVs of a world)."""


class MiniBatch(NamedTuple):
    """Samples of one gradient step: a row per UAV and step, and the states that they share."""

    observations: torch.Tensor
    """(rows, O)."""
    states: torch.Tensor
    """(states, S), each once."""
    state_of_row: torch.Tensor
    """Index of every row's state, (rows,)."""
    actions: torch.Tensor
    """(rows, A)."""
    old_values: torch.Tensor
    """(rows,), as are those that follow."""
    old_log_prob: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor


class CentralizedRolloutBuffer(RolloutBuffer):
    """Rollout of T steps × rows, row = world·agents + agent.

    Values and log probabilities come in one batch at the end (:meth:`finish`); advantages are
    SB3's generalised advantage estimation.

    Args:
        agents_per_world: rows that share one global state.
        args: as SB3's ``RolloutBuffer``.
        kwargs: as SB3's ``RolloutBuffer``.
    """

    observation_space: spaces.Dict

    def __init__(self, *args: Any, agents_per_world: int = 1, **kwargs: Any) -> None:
        self.agents_per_world = agents_per_world
        super().__init__(*args, **kwargs)

    def reset(self) -> None:
        """Empty the buffer; all rows take part until :meth:`limit_rows`."""
        steps, rows = self.buffer_size, self.n_envs
        observation_size = spaces.flatdim(self.observation_space["observation"])
        state_size = spaces.flatdim(self.observation_space["state"])
        self.observations = np.zeros((steps, rows, observation_size), np.float32)
        self.states = np.zeros((steps, rows // self.agents_per_world, state_size), np.float32)
        self.actions = np.zeros((steps, rows, self.action_dim), np.float32)
        self.rewards, self.episode_starts, self.values, self.log_probs, self.advantages = (
            np.zeros((steps, rows), np.float32) for _ in range(5)
        )
        self.returns = np.zeros((steps, rows), np.float32)
        self.rows = rows
        self.pos, self.full, self.generator_ready = 0, False, False

    def limit_rows(self, rows: int) -> None:
        """Learn from the first ``rows`` rows only: the others' worlds have no episode left."""
        self.rows = rows

    def add(  # type: ignore[override]
        self,
        observation: dict[str, Floats],
        action: Floats,
        reward: Floats,
        episode_start: NDArray[np.bool_],
    ) -> None:
        """Store a step of all rows."""
        self.observations[self.pos] = observation["observation"]
        self.states[self.pos] = observation["state"][:: self.agents_per_world]
        self.actions[self.pos] = action
        self.rewards[self.pos] = reward
        self.episode_starts[self.pos] = episode_start
        self.pos += 1
        self.full = self.pos == self.buffer_size

    def finish(
        self,
        state_values: Floats,
        log_probs: Floats,
        last_state_values: torch.Tensor,
        dones: NDArray[np.bool_],
    ) -> None:
        """Complete a full buffer and estimate advantages and returns.

        Args:
            state_values: (T, worlds), values of the stored states.
            log_probs: (T, rows), of the stored actions.
            last_state_values: (worlds,), values of the states after the last step.
            dones: (rows,), whether the last step ended an episode.
        """
        self.values = np.repeat(state_values, self.agents_per_world, axis=1)
        self.log_probs = log_probs
        last_values = last_state_values.repeat_interleave(self.agents_per_world)
        self.compute_returns_and_advantage(last_values, dones)

    def get(  # type: ignore[override]
        self, batch_size: int | None = None, unit: MiniBatchUnit = "rows"
    ) -> Generator[MiniBatch, None, None]:
        """Random mini-batches that together hold every sample once.

        Args:
            batch_size: rows or slots of a mini-batch; by default all.
            unit: which of the two (M34).
        """
        if not self.full:
            raise RuntimeError("the rollout is not complete")
        agents = self.agents_per_world
        worlds = self.rows // agents
        # Row i of these arrays belongs to slot i // agents, whose state is that row of the states.
        states, *by_row = (
            torch.as_tensor(array.reshape(-1, *array.shape[2:]), device=self.device)
            for array in (
                self.states[:, :worlds],
                *(
                    array[:, : self.rows]
                    for array in (
                        self.observations,
                        self.actions,
                        self.values,
                        self.log_probs,
                        self.advantages,
                        self.returns,
                    )
                ),
            )
        )
        units = len(states) if unit == "slots" else len(states) * agents
        for drawn in torch.randperm(units).to(self.device).split(batch_size or units):
            if unit == "slots":
                slots = drawn
                rows = (
                    slots[:, None] * agents + torch.arange(agents, device=self.device)
                ).flatten()
                state_of_row = torch.arange(len(slots), device=self.device)
                state_of_row = state_of_row.repeat_interleave(agents)
            else:
                rows = drawn
                slots, state_of_row = torch.unique(rows // agents, return_inverse=True)
            observations, *others = (array[rows] for array in by_row)
            yield MiniBatch(observations, states[slots], state_of_row, *others)
