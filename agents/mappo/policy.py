"""Actor on local observations, critic on the global state."""

import math
from collections.abc import Sequence
from typing import Any, cast

import torch
from gymnasium import spaces
from stable_baselines3.common.distributions import DiagGaussianDistribution, Distribution
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

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

Observations = dict[str, torch.Tensor]
_HALF_LOG_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class CentralizedCriticPolicy(LocalActorPolicy, ActorCriticPolicy):
    """Two separate networks: the actor reads "observation", the critic "state".

    SB3's own ``MultiInputPolicy`` lets the actor see both, so that it could not fly without the
    global state. Here the actor is ``tanh(MLP(observation))``, the mean of a Gaussian whose
    log standard deviation is learned and independent of the state (decisions M20, M31).

    The optimizer has two parameter groups, "actor" and "critic", in this order; fused Adam by
    default.

    Args:
        observation_space: Dict with the flat boxes "observation" and "state".
        action_space: flat, bounded box.
        lr_schedule: learning rate of both groups until :class:`MAPPO` sets each its own.
        net_arch: hidden layers of both networks.
        log_std_init: first value of the log standard deviation.
        ortho_init: orthogonal weights, gain sqrt(2), 0.01 for the actor's and 1 for the critic's
            last layer; else torch's own.
        kwargs: further arguments of SB3's ``ActorCriticPolicy``.
    """

    observation_space: spaces.Dict

    def __init__(
        self,
        observation_space: spaces.Dict,
        action_space: spaces.Box,
        lr_schedule: Schedule,
        net_arch: Sequence[int] = HIDDEN_SIZES,
        log_std_init: float = 0.0,
        ortho_init: bool = True,
        optimizer_kwargs: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> None:
        check_spaces(observation_space, action_space)
        if kwargs.get("use_sde"):
            raise ValueError("use_sde is not supported: the noise does not depend on the state")
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=list(net_arch),
            ortho_init=ortho_init,
            log_std_init=log_std_init,
            optimizer_kwargs=optimizer_kwargs or ADAM,
            **{**kwargs, "activation_fn": nn.ReLU},  # a saved policy comes with its own
        )
        self._squash_output = True  # has SB3's predict() call unscale_action

    def _build(self, lr_schedule: Schedule) -> None:
        observation_size = spaces.flatdim(self.observation_space["observation"])
        state_size = spaces.flatdim(self.observation_space["state"])
        action_size = spaces.flatdim(self.action_space)
        hidden_sizes = cast(list[int], self.net_arch)
        self.actor = perceptron(observation_size, hidden_sizes, action_size)
        self.critic = perceptron(state_size, hidden_sizes, 1)
        self.log_std = nn.Parameter(torch.full((action_size,), float(self.log_std_init)))
        if self.ortho_init:
            initialise_orthogonally(self.actor, LAST_ACTOR_GAIN)
            initialise_orthogonally(self.critic, LAST_CRITIC_GAIN)
        self.optimizer = self.make_optimizer(
            self.actor_parameters(), self.critic_parameters(), lr_schedule
        )

    def actor_parameters(self) -> list[nn.Parameter]:
        """The actor's weights and its log standard deviation."""
        return [*self.actor.parameters(), self.log_std]

    def critic_parameters(self) -> list[nn.Parameter]:
        """The critic's weights."""
        return list(self.critic.parameters())

    def state_value(self, state: torch.Tensor) -> torch.Tensor:
        """Value (rows,) of global states (rows, S)."""
        return self.critic(state).squeeze(-1)

    def distribution(self, observation: torch.Tensor) -> Distribution:
        """Gaussian over actions given local observations (rows, O)."""
        # A new one each time: a second call would change the result of the first.
        gaussian = DiagGaussianDistribution(self.log_std.numel())
        return gaussian.proba_distribution(self.action_mean(observation), self.log_std)

    # What SB3 calls, in terms of the above; in single precision, whatever the observations are of.

    def forward(  # type: ignore[override]
        self, obs: Observations, deterministic: bool = False
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Actions, values (rows, 1) and log probabilities."""
        distribution = self.get_distribution(obs)
        actions = distribution.get_actions(deterministic=deterministic)
        return actions, self.predict_values(obs), distribution.log_prob(actions)

    def evaluate_actions(  # type: ignore[override]
        self, obs: Observations, actions: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor | None]:
        """Values (rows, 1), log probabilities of the actions, and entropies."""
        distribution = self.get_distribution(obs)
        return self.predict_values(obs), distribution.log_prob(actions), distribution.entropy()

    def get_distribution(self, obs: Observations) -> Distribution:  # type: ignore[override]
        """Gaussian over actions; reads ``obs["observation"]`` alone."""
        return self.distribution(obs["observation"].float())

    def predict_values(self, obs: Observations) -> torch.Tensor:  # type: ignore[override]
        """Values (rows, 1); reads ``obs["state"]`` alone."""
        return self.critic(obs["state"].float())


# The same as torch.distributions.Normal, without the checks and objects that take a tenth of the
# time of an update.


def gaussian_log_density(deviations: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Log density (...,) of actions that are ``deviations`` (..., A) std from their mean."""
    return -(0.5 * deviations.square() + log_std + _HALF_LOG_TWO_PI).sum(dim=-1)


def gaussian_entropy(log_std: torch.Tensor) -> torch.Tensor:
    """Entropy, a scalar, of a Gaussian over actions with log standard deviations (A,)."""
    return (log_std + 0.5 + _HALF_LOG_TWO_PI).sum()
