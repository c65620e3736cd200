"""The fleet as a PettingZoo parallel environment: one agent per UAV."""

from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray
from pettingzoo import ParallelEnv

from orchid_uav.envs.extensions import Extensions
from orchid_uav.envs.interfaces.spaces import action_space, observation_space, state_space
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.world import WorldBatch

Observation = NDArray[np.float32]
PerAgent = dict[str, Any]


class FleetParallelEnv(ParallelEnv[str, Observation, Observation]):
    """One world, an agent ``uav_0`` … ``uav_{N-1}`` per UAV.

    Episodes end by truncation alone, after ``network.episode_slots`` slots (decision M15). After
    each step ``infos[agent]["metrics"]`` holds the slot's fleet metrics, and after the last one
    ``infos[agent]["episode_metrics"]`` the episode's.

    Args:
        parameters: the network; Table I by default.
        user_positions_m: the caller's own users, (M, 2) in m.
        own: the caller's own parts, see :class:`Extensions`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "orchid_fleet_v0",
        "render_modes": [],
        "is_parallelizable": True,
    }

    def __init__(
        self,
        parameters: Parameters | None = None,
        user_positions_m: ArrayLike | None = None,
        **own: Unpack[Extensions],
    ) -> None:
        self.world = WorldBatch(parameters, worlds=1, user_positions_m=user_positions_m, **own)
        self.parameters = self.world.parameters
        self.render_mode = None
        self.possible_agents = [f"uav_{index}" for index in range(self.world.uav_count)]
        self.agents: list[str] = []
        self.state_space = state_space(self.parameters)
        # The API asks for the very same space object at every call.
        self.observation_spaces = {
            agent: observation_space(self.parameters, self.world.own_observation_size)
            for agent in self.possible_agents
        }
        self.action_spaces = {agent: action_space() for agent in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Box:
        """Box (O,), see :func:`orchid_uav.envs.interfaces.spaces.observation_space`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Box (4,) in [-1, 1]."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, PerAgent]]:
        """Draw a new topology and run Phase I; with a seed, the course begins anew."""
        if seed is not None:
            self.world.seed(seed)
        self.world.reset()
        self.agents = self.possible_agents[:]
        return self._observations(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Observation]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, PerAgent],
    ]:
        """Fly one slot; every living agent needs an action."""
        if not self.agents:
            raise RuntimeError("the episode is over or has not begun: call reset() first")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"no action for {', '.join(missing)}")
        self.world.step(np.stack([actions[agent] for agent in self.agents])[None])
        agents, observations = self.agents, self._observations()
        rewards = dict(zip(agents, self.world.arrays.rewards[0].tolist(), strict=True))
        metrics = self.world.slot_metrics(0)
        infos: dict[str, PerAgent] = {agent: {"metrics": dict(metrics)} for agent in agents}
        is_over = bool(self.world.finished[0])
        if is_over:
            episode = self.world.episode_metrics(0)
            for info in infos.values():
                info["episode_metrics"] = dict(episode)
            self.agents = []
        terminations = dict.fromkeys(agents, False)
        truncations = dict.fromkeys(agents, is_over)
        return observations, rewards, terminations, truncations, infos

    def state(self) -> NDArray[np.float32]:
        """Global state for a centralised critic, ``state_space``."""
        return self.world.arrays.states[0].copy()

    def snapshot(self) -> dict[str, Any]:
        """Copies of the physical state; see :meth:`WorldBatch.snapshot`."""
        return self.world.snapshot()

    def set_progress(self, progress: float) -> None:
        """Training progress tau of the weight schedules, kept across resets (default 0)."""
        self.world.set_progress(progress)

    def _observations(self) -> dict[str, Observation]:
        rows = self.world.observations()[0].copy()
        return dict(zip(self.possible_agents, rows, strict=True))
