"""Multi-agent DDPG with a shared local actor on SB3's off-policy base (Baselines 1 and 2)."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import (
    GymEnv,
    RolloutReturn,
    Schedule,
    TrainFreq,
)
from stable_baselines3.common.vec_env import VecEnv
from torch.nn import functional

from orchid_uav.agents.centralized_training import CentralizedTraining, Rows, single_precision
from orchid_uav.agents.maddpg.policy import JointCriticPolicy
from orchid_uav.agents.maddpg.replay_buffer import JointBatch, JointReplayBuffer
from orchid_uav.agents.networks import check_spaces
from orchid_uav.storage.tensors import Tensors, TensorSpec

_SMALLEST_STD = 1e-12
_REPLAY = "replay"


class MADDPG(CentralizedTraining, OffPolicyAlgorithm):
    """Deterministic actor shared by all agents, critic on the global state and the joint action.

    After Lowe et al., Multi-agent actor-critic for mixed cooperative-competitive environments
    (2017), for a cooperative fleet: one critic learns the value of the agents' mean reward, and the
    actor follows its gradient through the actions of all agents at once. Runs on the same
    environments as :class:`orchid_uav.agents.MAPPO`. ``total_timesteps`` counts rows, that is
    agent steps.

    Args:
        policy: "JointCriticPolicy" or a subclass of it.
        env: the vector environment; its attribute ``agents_per_world``, if it has one, says how
            many rows share a state.
        learning_rate: of the actor.
        critic_learning_rate: of the critic.
        buffer_size: whole-fleet transitions that are kept (decision M32, as all that follow).
        batch_size: transitions of one update; updates begin as soon as so many are stored.
        target_rate: share of the networks that their targets take over at an update.
        gamma: discount factor.
        update_every: steps of the environment from one update to the next.
        gradient_steps: updates then, fewer where surplus worlds idle; as many as there are worlds
            keeps their number per transition.
        exploration_std: standard deviation of the Gaussian noise on actions in [-1, 1].
        preactivation_penalty: weight of the mean squared actor's output before tanh in its loss, as
            in the authors' code: a saturated tanh has no gradient left to learn from.
        max_grad_norm: gradient norm at which actor and critic are clipped, each by itself.
        episode_steps: steps of an episode, if it is always the same: where fewer episodes are left
            than worlds, the surplus worlds' steps are neither counted nor learned from (M33).
        center_rewards: take their running mean off the rewards that the critic learns from, so that
            its values stay near 0 (M37); episodes then have to end by time limit alone.
        policy_kwargs: further arguments of the policy.
        kwargs: further arguments of SB3's ``OffPolicyAlgorithm``.
    """

    policy: JointCriticPolicy
    replay_buffer: JointReplayBuffer  # type: ignore[assignment]
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {"JointCriticPolicy": JointCriticPolicy}
    ent_coef = 0.0
    """A deterministic policy has no entropy to reward; the episode log records it as 0."""

    def __init__(
        self,
        policy: str | type[JointCriticPolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-4,
        critic_learning_rate: float | Schedule = 1e-3,
        buffer_size: int = 100_000,
        batch_size: int = 128,
        target_rate: float = 0.01,
        gamma: float = 0.99,
        update_every: int = 4,
        gradient_steps: int = 1,
        exploration_std: float = 0.1,
        preactivation_penalty: float = 1e-3,
        max_grad_norm: float = 0.5,
        episode_steps: int | None = None,
        center_rewards: bool = False,
        policy_kwargs: dict[str, Any] | None = None,
        device: torch.device | str = "cpu",
        _init_setup_model: bool = True,
        **kwargs: Any,
    ) -> None:
        for name in ("action_noise", "use_sde", "replay_buffer_class"):
            if kwargs.get(name):
                raise ValueError(
                    f"{name} is not supported: exploration and replay are MADDPG's own"
                )
        self.critic_learning_rate = critic_learning_rate
        self.exploration_std = exploration_std
        self.preactivation_penalty = preactivation_penalty
        self.max_grad_norm = max_grad_norm
        self.episode_steps = episode_steps
        self.center_rewards = center_rewards
        super().__init__(
            policy,
            env,
            learning_rate,
            buffer_size=buffer_size,
            learning_starts=0,
            batch_size=batch_size,
            tau=target_rate,
            gamma=gamma,
            train_freq=update_every,
            gradient_steps=gradient_steps,
            replay_buffer_class=cast(type[ReplayBuffer], JointReplayBuffer),
            policy_kwargs=policy_kwargs,
            support_multi_env=True,
            sde_support=False,
            device=device,
            **kwargs,
        )
        if _init_setup_model:
            self._setup_model()

    def _setup_model(self) -> None:
        check_spaces(self.observation_space, self.action_space)
        self._find_agents_per_world()
        self.replay_buffer_kwargs = {"agents_per_world": self.agents_per_world}
        self.policy_kwargs = {**self.policy_kwargs, "agents_per_world": self.agents_per_world}
        super()._setup_model()
        self._update_learning_rate(self.policy.optimizer)
        self._rows = self.n_envs

    def exploration_log_std(self) -> NDArray[np.float32]:
        """Log standard deviation (A,) of the noise on actions in [-1, 1]; finite without any."""
        std = max(self.exploration_std, _SMALLEST_STD)
        return np.full(spaces.flatdim(self.action_space), math.log(std), np.float32)

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        train_freq: TrainFreq,
        replay_buffer: ReplayBuffer,
        action_noise: ActionNoise | None = None,
        learning_starts: int = 0,
        log_interval: int | None = None,
    ) -> RolloutReturn:
        """Fly until the next update is due, and store what happened."""
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        for step in range(train_freq.frequency):
            observation, starts = self._last_rows()
            if self.episode_steps is not None and starts.all():
                self._rows = self._rows_within_budget(env.num_envs, self.episode_steps)
            rows = self._rows
            actions = self._explore(observation)
            self._check_actions(actions)
            new_observation, rewards, dones, infos = env.step(self.policy.unscale_action(actions))
            rows_seen = single_precision(cast(Rows, new_observation))
            following, terminated = _before_new_episodes(rows_seen, dones, infos)
            self._check_ends(bool(terminated.any()))
            if self.center_rewards:
                self._average_rewards(rewards[None, :rows])
            self.replay_buffer.add(rows, observation, actions, rewards, following, terminated)
            self._last_obs, self._last_episode_starts = cast(Rows, new_observation), dones
            self.num_timesteps += rows
            if dones.any():
                infos, dones = infos[:rows], dones[:rows]
                self._update_info_buffer(infos, dones)
                self._count_episodes(int(dones.sum()) // self.agents_per_world, log_interval)
            callback.update_locals(locals())
            if not callback.on_step():
                return RolloutReturn(step + 1, 0, continue_training=False)
            if self.num_timesteps >= self._total_timesteps:
                break
        self._update_current_progress_remaining(self.num_timesteps, self._total_timesteps)
        callback.on_rollout_end()
        return RolloutReturn(step + 1, 0, continue_training=True)

    def _count_episodes(self, ended: int, log_interval: int | None) -> None:
        before = self._episode_num
        self._episode_num += ended
        if log_interval and self._episode_num // log_interval > before // log_interval:
            self.dump_logs()

    def _explore(self, observation: Rows) -> NDArray[np.float32]:
        with torch.inference_mode():
            local = torch.as_tensor(observation["observation"], device=self.device)
            mean = self.policy.action_mean(local)
            noise = self.exploration_std * torch.randn_like(mean)
            return (mean + noise).clamp(-1.0, 1.0).cpu().numpy()

    def train(self, gradient_steps: int, batch_size: int) -> None:
        """Update critic, actor and their targets on transitions from the replay buffer."""
        if self.replay_buffer.size() < batch_size:
            return
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        policy, updates = self.policy, max(1, gradient_steps * self._rows // self.n_envs)
        actor, critic = list(policy.actor.parameters()), list(policy.critic.parameters())
        sources: list[torch.Tensor] = [*actor, *critic]
        targets: list[torch.Tensor] = [
            *policy.actor_target.parameters(),
            *policy.critic_target.parameters(),
        ]
        for _ in range(updates):
            batch = self.replay_buffer.sample(batch_size)
            wanted = self.target_values(batch)
            critic_loss = self.critic_loss(batch, wanted)
            self._descend(critic_loss, critic)
            actor_loss = self.actor_loss(batch)
            self._descend(actor_loss, actor)
            with torch.no_grad():  # SB3's polyak_update, for all tensors at once
                torch._foreach_mul_(targets, 1.0 - self.tau)
                torch._foreach_add_(targets, sources, alpha=self.tau)
        self._n_updates += updates
        losses = {"critic_loss": critic_loss.item(), "actor_loss": actor_loss.item()}
        self._check_losses(losses)
        self._log_learning_rates()
        for name, loss in losses.items():
            self.logger.record(f"train/{name}", loss)
        self._log_values(wanted.mean().item())
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")

    def target_values(self, batch: JointBatch) -> torch.Tensor:
        """What the critic's values (rows,) should be: nothing follows an end by no time limit."""
        with torch.no_grad():
            following = self.policy.target_value(batch.next_states, batch.next_observations)
            rewards = batch.rewards - self.reward_mean if self.center_rewards else batch.rewards
            return rewards + self.gamma * (1.0 - batch.terminated) * following

    def critic_loss(self, batch: JointBatch, wanted: torch.Tensor) -> torch.Tensor:
        """Mean squared temporal-difference error against :meth:`target_values`."""
        return functional.mse_loss(self.policy.joint_value(batch.states, batch.actions), wanted)

    def actor_loss(self, batch: JointBatch) -> torch.Tensor:
        """Minus the mean value of the joint action that the actor would take, plus the penalty."""
        preactivations = self.policy.actor(batch.observations)
        value = self.policy.joint_value(batch.states, torch.tanh(preactivations)).mean()
        return self.preactivation_penalty * preactivations.square().mean() - value

    def _descend(self, loss: torch.Tensor, parameters: list[torch.nn.Parameter]) -> None:
        """A step of Adam on these parameters alone: those without a gradient stay as they are."""
        self.policy.optimizer.zero_grad(set_to_none=True)
        loss.backward(inputs=parameters)
        torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
        self.policy.optimizer.step()

    def training_state(self) -> tuple[dict[str, Any], dict[str, Tensors]]:
        """The state of every learner, and the stored transitions."""
        document, tensors = super().training_state()
        document |= {"rows": self._rows, "replay": self.replay_buffer.place()}
        return document, tensors | {_REPLAY: self.replay_buffer.stored()}

    def training_state_specs(self, document: Mapping[str, Any]) -> dict[str, dict[str, TensorSpec]]:
        """As :class:`CentralizedTraining` does it, with the replay buffer."""
        specs = self.replay_buffer.stored_specs(document["replay"])
        return super().training_state_specs(document) | {_REPLAY: specs}

    def restore_training_state(
        self, document: Mapping[str, Any], tensors: Mapping[str, Tensors]
    ) -> None:
        """As :class:`CentralizedTraining` does it, with the replay buffer."""
        rows = document["rows"]
        if type(rows) is not int or not 0 < rows <= self.n_envs or rows % self.agents_per_world:
            raise ValueError(f"{rows!r} rows of {self.n_envs}")
        super().restore_training_state(document, tensors)
        self._rows = rows
        self.replay_buffer.restore(document["replay"], tensors[_REPLAY])

    def save_replay_buffer(self, path: Any) -> None:
        """Not supported: SB3's format is a pickle, and to read one is to run it."""
        raise NotImplementedError("SB3's format is a pickle, which is not used here")

    def load_replay_buffer(self, path: Any, truncate_last_traj: bool = True) -> None:
        """Not supported, see :meth:`save_replay_buffer`."""
        self.save_replay_buffer(path)

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        return ["policy", "policy.optimizer"], []


def _before_new_episodes(
    observation: Rows, dones: NDArray[np.bool_], infos: list[dict[str, Any]]
) -> tuple[Rows, NDArray[np.bool_]]:
    """What followed a step, of ended episodes their last view; and which ended by themselves."""
    terminated = np.zeros(len(dones), np.bool_)
    if not dones.any():
        return observation, terminated
    following = {key: rows.copy() for key, rows in observation.items()}
    for row in np.flatnonzero(dones):
        terminated[row] = not infos[row].get("TimeLimit.truncated", False)
        for key, last in infos[row]["terminal_observation"].items():
            following[key][row] = last
    return following, terminated
