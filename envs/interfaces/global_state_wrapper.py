"""Centralised training for any PettingZoo environment that knows its global state."""

from typing import Any

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from orchid_uav.envs.interfaces.spaces import centralized_space


class CentralizedState(BaseParallelWrapper):
    """Gives each agent {"observation": its own, "state": the environment's ``state()``}.

    Both are float32, as networks are, whatever floating-point numbers the environment has.

    A critic can then read "state" while the actor reads "observation" alone, as
    :class:`orchid_uav.agents.CentralizedCriticPolicy` does.

    Args:
        env: a parallel environment with ``state()`` and ``state_space``.

    Raises:
        TypeError: the environment has no ``state_space``.
    """

    def __init__(self, env: ParallelEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        state_space = getattr(env, "state_space", None)
        if not isinstance(state_space, spaces.Space):
            raise TypeError(
                f"{env} has no state_space: a centralised critic needs state() and its space"
            )
        self._spaces = {
            agent: centralized_space(
                _single_precision(env.observation_space(agent)), _single_precision(state_space)
            )
            for agent in env.possible_agents
        }

    def observation_space(self, agent: str) -> spaces.Dict:
        """Dict of the agent's own space and the state's."""
        return self._spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Reset the wrapped environment."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._with_state(observations), infos

    def step(self, actions: dict[str, Any]) -> Any:
        """Step the wrapped environment."""
        observations, *rest = self.env.step(actions)
        return (self._with_state(observations), *rest)

    def _with_state(self, observations: dict[str, Any]) -> dict[str, dict[str, Any]]:
        state = self.env.state()
        return {
            agent: {
                "observation": _cast(observation, self._spaces[agent]["observation"]),
                "state": _cast(state, self._spaces[agent]["state"]),
            }
            for agent, observation in observations.items()
        }


def _single_precision(space: spaces.Space[Any]) -> spaces.Space[Any]:
    """A box of float32 for one of other floating-point numbers; other spaces as they are."""
    if not isinstance(space, spaces.Box) or not np.issubdtype(space.dtype, np.floating):
        return space
    with np.errstate(over="ignore"):  # beyond float32 there is no bound
        low, high = space.low.astype(np.float32), space.high.astype(np.float32)
    return spaces.Box(low, high, dtype=np.float32)


def _cast(value: Any, space: spaces.Space[Any]) -> Any:
    return np.asarray(value, space.dtype) if isinstance(space, spaces.Box) else value
