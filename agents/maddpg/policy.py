"""A deterministic actor on local observations, a critic on global state and joint action."""

from collections.abc import Sequence
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.type_aliases import PyTorchObs, Schedule

from orchid_uav.agents.networks import (
    ADAM,
    HIDDEN_SIZES,
    LAST_ACTOR_GAIN,
    LAST_CRITIC_GAIN,
    LocalActorPolicy,
    check_spaces,
    initialise_orthogonally,
    perceptron,
)


class JointCriticPolicy(LocalActorPolicy):
    """MADDPG's networks: one actor for all agents, one critic for the fleet, and their targets.

    The critic estimates the discounted sum of the agents' mean reward from the global state and
    the actions of all agents. The optimizer has two parameter groups, "actor" and "critic", in
    this order; fused Adam by default.

    Args:
        observation_space: Dict with the flat boxes "observation" and "state".
        action_space: flat, bounded box of one agent.
        lr_schedule: learning rate of both groups until :class:`MADDPG` sets each its own.
        agents_per_world: number N of agents whose actions the critic sees.
        net_arch: hidden layers of all networks.
        ortho_init: orthogonal weights, gain sqrt(2), 0.01 for the actor's and 1 for the critic's
            last layer; else torch's own.
        optimizer_kwargs: of Adam.
        kwargs: further arguments of SB3's ``BasePolicy``.
    """

    observation_space: spaces.Dict

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        agents_per_world: int = 1,
        net_arch: Sequence[int] = HIDDEN_SIZES,
        ortho_init: bool = True,
        optimizer_kwargs: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        check_spaces(observation_space, action_space)
        super().__init__(
            observation_space,
            action_space,
            optimizer_kwargs=optimizer_kwargs or ADAM,
            squash_output=True,
            **kwargs,
        )
        self.agents_per_world = agents_per_world
        self.net_arch = list(net_arch)
        action_size = spaces.flatdim(action_space)
        critic_inputs = spaces.flatdim(observation_space["state"]) + agents_per_world * action_size
        actor_sizes = spaces.flatdim(observation_space["observation"]), self.net_arch, action_size
        critic_sizes = critic_inputs, self.net_arch, 1
        self.actor, self.critic = perceptron(*actor_sizes), perceptron(*critic_sizes)
        self.ortho_init = ortho_init
        if ortho_init:
            initialise_orthogonally(self.actor, LAST_ACTOR_GAIN)
            initialise_orthogonally(self.critic, LAST_CRITIC_GAIN)
        self.actor_target, self.critic_target = perceptron(*actor_sizes), perceptron(*critic_sizes)
        self.actor_target.load_state_dict(self.actor.state_dict())
        self.critic_target.load_state_dict(self.critic.state_dict())
        self.optimizer = self.make_optimizer(
            self.actor.parameters(), self.critic.parameters(), lr_schedule
        )

    def joint_value(self, state: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Q (rows,) of states (rows, S) and joint actions (rows, N, A)."""
        return _joint_value(self.critic, state, actions)

    def target_value(self, next_state: torch.Tensor, observation: torch.Tensor) -> torch.Tensor:
        """Target networks' Q (rows,) of states (rows, S), acting on observations (rows, N, O)."""
        actions = torch.tanh(self.actor_target(observation))
        return _joint_value(self.critic_target, next_state, actions)

    # What SB3 calls.

    def forward(self, obs: dict[str, torch.Tensor], deterministic: bool = True) -> torch.Tensor:
        """Actions (rows, A) in [-1, 1]; reads ``obs["observation"]`` alone."""
        return self.action_mean(obs["observation"].float())

    def _predict(self, observation: PyTorchObs, deterministic: bool = True) -> torch.Tensor:
        return self(observation)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return {
            "observation_space": self.observation_space,
            "action_space": self.action_space,
            "lr_schedule": self._dummy_schedule,
            "agents_per_world": self.agents_per_world,
            "net_arch": self.net_arch,
            "optimizer_class": self.optimizer_class,
            "ortho_init": self.ortho_init,
            "optimizer_kwargs": self.optimizer_kwargs,
        }


def _joint_value(
    critic: torch.nn.Sequential, state: torch.Tensor, actions: torch.Tensor
) -> torch.Tensor:
    return critic(torch.cat([state, actions.flatten(start_dim=1)], dim=1)).squeeze(-1)
