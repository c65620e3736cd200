"""simple_spread for BenchMARL, in two forms: as TorchRL wraps it, and with all worlds in one batch.

TorchRL's wrapper of PettingZoo environments takes longer over a step than the environment itself,
and BenchMARL gives the same seed to all of its worlds, so they begin every episode alike. The batch
steps the worlds one after the other with less overhead, each with a seed of its own.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from benchmarl.environments.common import TaskClass
from benchmarl.environments.pettingzoo.common import PettingZooClass
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from studies.simple_spread.task import ACTIONS, AGENTS, OBSERVATION, STATE, STEPS, make_spread

GROUP = "agent"
_ENDS = ("done", "terminated", "truncated")


class SpreadWorlds(EnvBase):
    """Several worlds as one TorchRL environment with the batch size (worlds,).

    Args:
        worlds: the number of worlds.
        seed: the seed from which each world gets its own.
        lowest_action: the lowest action of the policy; the highest is 1. Actions are clipped to
            this range and scaled to that of the worlds, [0, 1].
    """

    def __init__(self, worlds: int, seed: int | None, lowest_action: float = 0.0) -> None:
        super().__init__(batch_size=torch.Size([worlds]))
        self.group_map = {GROUP: [f"agent_{index}" for index in range(AGENTS)]}
        self._lowest_action = lowest_action
        self._worlds = [make_spread() for _ in range(worlds)]
        self._seeds: list[int | None] = [None] * worlds
        self._set_seed(seed)
        fleet = (worlds, AGENTS)

        def of_agents(name: str, spec: Any) -> Composite:
            return Composite({GROUP: Composite({name: spec}, shape=fleet)}, shape=(worlds,))

        self.observation_spec = of_agents("observation", Unbounded((*fleet, OBSERVATION)))
        self.observation_spec["state"] = Unbounded((worlds, STATE))
        self.action_spec = of_agents("action", Bounded(lowest_action, 1.0, (*fleet, ACTIONS)))
        self.reward_spec = of_agents("reward", Unbounded((*fleet, 1)))
        ends = {name: Binary(1, (worlds, 1), dtype=torch.bool) for name in _ENDS}
        self.done_spec = Composite(ends, shape=(worlds,))

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            drawn = np.random.SeedSequence(seed).generate_state(len(self._worlds))
            self._seeds = [int(one) for one in drawn]

    def _reset(self, tensordict: TensorDictBase | None, **_: Any) -> TensorDictBase:
        # All episodes have the same length, so all worlds begin anew together.
        views = [
            world.reset(seed=seed)[0] for world, seed in zip(self._worlds, self._seeds, strict=True)
        ]
        self._seeds = [None] * len(self._worlds)
        first = self._seen(views)
        for name in _ENDS:
            first[name] = torch.zeros((*self.batch_size, 1), dtype=torch.bool)
        return first

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        actions = tensordict[GROUP, "action"].clamp(self._lowest_action, 1.0).numpy()
        actions = (actions - self._lowest_action) / (1.0 - self._lowest_action)
        views, rewards, ends = [], [], []
        for world, chosen in zip(self._worlds, actions, strict=True):
            agents = world.possible_agents
            view, reward, terminated, truncated, _ = world.step(
                dict(zip(agents, chosen, strict=True))
            )
            views.append(view)
            rewards.append([[reward[agent]] for agent in agents])
            ends.append([any(terminated.values()), any(truncated.values())])
        terminated, truncated = torch.tensor(ends).split(1, dim=1)
        following = self._seen(views)
        following[GROUP, "reward"] = torch.tensor(rewards, dtype=torch.float32)
        following["terminated"], following["truncated"] = terminated, truncated
        following["done"] = terminated | truncated
        return following

    def _seen(self, views: list[dict[str, Any]]) -> TensorDict:
        observations = torch.from_numpy(
            np.array([list(view.values()) for view in views], np.float32)
        )
        states = torch.from_numpy(np.array([world.state() for world in self._worlds], np.float32))
        agents = TensorDict({"observation": observations}, (*self.batch_size, AGENTS))
        return TensorDict({GROUP: agents, "state": states}, self.batch_size)


class SpreadTask(TaskClass):
    """simple_spread with all worlds in one batch; ``lowest_action`` as in :class:`SpreadWorlds`."""

    def __init__(self, lowest_action: float = 0.0) -> None:
        super().__init__("SIMPLE_SPREAD", {})
        self._lowest_action = lowest_action

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return a function that makes the worlds."""
        return lambda: SpreadWorlds(num_envs, seed, self._lowest_action)

    def supports_continuous_actions(self) -> bool:
        """Continuous actions are supported."""
        return True

    def supports_discrete_actions(self) -> bool:
        """Discrete actions are not supported."""
        return False

    def has_render(self, env: EnvBase) -> bool:
        """Do nothing: there is nothing to see."""
        return False

    def max_steps(self, env: EnvBase) -> int:
        """The number of steps of an episode."""
        return STEPS

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        """All agents form one group."""
        return env.group_map

    def observation_spec(self, env: EnvBase) -> Composite:
        """The observations of one world's agents."""
        return Composite({GROUP: env.full_observation_spec_unbatched[GROUP].clone()})

    def state_spec(self, env: EnvBase) -> Composite:
        """The state of one world."""
        return Composite({"state": env.full_observation_spec_unbatched["state"].clone()})

    def action_spec(self, env: EnvBase) -> Composite:
        """The actions of one world's agents."""
        return env.full_action_spec_unbatched

    def action_mask_spec(self, env: EnvBase) -> None:
        """Return None, since all actions are always allowed."""

    def info_spec(self, env: EnvBase) -> None:
        """Return None, since there are no infos."""

    @staticmethod
    def env_name() -> str:
        """The name of the suite of environments."""
        return "mpe2"


class StockSpreadTask(PettingZooClass):
    """simple_spread as TorchRL wraps it, one environment per world."""

    def __init__(self) -> None:
        super().__init__("SIMPLE_SPREAD", {"max_cycles": STEPS})

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return a function that makes one world."""
        return lambda: PettingZooWrapper(env=make_spread(), return_state=True, seed=seed)
