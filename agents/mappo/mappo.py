"""Multi-agent PPO with a centralised critic on top of SB3's PPO (Section IV-C4)."""

import warnings
from typing import Any, ClassVar, cast, get_args

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv, Schedule
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv
from torch.nn import functional

from orchid_uav.agents.centralized_training import CentralizedTraining, Rows
from orchid_uav.agents.mappo.policy import (
    CentralizedCriticPolicy,
    gaussian_entropy,
    gaussian_log_density,
)
from orchid_uav.agents.mappo.rollout_buffer import (
    CentralizedRolloutBuffer,
    MiniBatch,
    MiniBatchUnit,
)
from orchid_uav.agents.networks import check_spaces

_METRICS = ("policy_gradient_loss", "value_loss", "entropy", "approx_kl", "clip_fraction")
_KL_METRIC = _METRICS.index("approx_kl")
_ROWS_PER_FORWARD = 8192
"""Rows of one forward pass without gradients, which bounds the memory of large batches."""


class MAPPO(CentralizedTraining, PPO):
    """PPO with one actor shared by all agents and a critic that sees the global state.

    Runs on any SB3 ``VecEnv`` whose observations are {"observation", "state"} and whose rows are
    ordered world by world: :func:`orchid_uav.envs.make_vec_env`, or any PettingZoo environment
    through :func:`orchid_uav.envs.make_supersuit_vec_env`.

    What differs from SB3's PPO: the critic's own learning rate, gradients of actor and critic
    clipped each by itself (else the scale of the rewards decides how much of the actor's gradient
    is left), the value of a state computed once per world and step, after the rollout, and a
    sample budget kept to the world: where fewer rollouts are left than worlds, the surplus worlds'
    rows are neither counted nor learned from (decision M33). ``total_timesteps`` counts rows, that
    is agent steps.

    Args:
        policy: "CentralizedCriticPolicy" or a subclass of it.
        env: the vector environment; its attribute ``agents_per_world``, if it has one, says how
            many rows share a state.
        learning_rate: of the actor, eta_actor.
        critic_learning_rate: of the critic, eta_critic.
        n_steps: steps per rollout and world; an episode by default.
        batch_size: rows or slots of a mini-batch.
        minibatch: what ``batch_size`` counts, "rows" (one step of one agent) or "slots" (one step
            of all agents of a world) (M34).
        center_rewards: take their running mean off the rewards that are learned from, so that
            values stay near 0 (M37); episodes then have to end by time limit alone.
        kwargs: further arguments of SB3's PPO.
    """

    policy: CentralizedCriticPolicy
    rollout_buffer: CentralizedRolloutBuffer
    minibatch: MiniBatchUnit = "rows"  # of models that were saved before there was a choice
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "CentralizedCriticPolicy": CentralizedCriticPolicy
    }

    def __init__(
        self,
        policy: str | type[CentralizedCriticPolicy],
        env: GymEnv | str,
        learning_rate: float | Schedule = 1e-4,
        critic_learning_rate: float | Schedule = 1e-3,
        n_steps: int = 200,
        batch_size: int = 128,
        minibatch: MiniBatchUnit = "slots",
        n_epochs: int = 4,
        ent_coef: float = 0.01,
        center_rewards: bool = False,
        device: torch.device | str = "cpu",
        _init_setup_model: bool = True,
        **kwargs: Any,
    ) -> None:
        if minibatch not in get_args(MiniBatchUnit):
            raise ValueError(f"minibatch is {minibatch!r}: rows or slots")
        self.critic_learning_rate = critic_learning_rate
        self.minibatch = minibatch
        self.center_rewards = center_rewards
        with warnings.catch_warnings():
            # A rollout of T·N samples is what the paper updates on, whether 128 divides it or not.
            warnings.filterwarnings("ignore", message=".*truncated mini-batch.*")
            super().__init__(
                policy,
                env,
                learning_rate=learning_rate,
                n_steps=n_steps,
                batch_size=batch_size,
                n_epochs=n_epochs,
                ent_coef=ent_coef,
                device=device,
                rollout_buffer_class=CentralizedRolloutBuffer,
                _init_setup_model=_init_setup_model,
                **kwargs,
            )

    def _setup_model(self) -> None:
        check_spaces(self.observation_space, self.action_space)
        self._find_agents_per_world()
        self.rollout_buffer_kwargs = {"agents_per_world": self.agents_per_world}
        super()._setup_model()
        self._update_learning_rate(self.policy.optimizer)

    def exploration_log_std(self) -> NDArray[np.float32]:
        """Log standard deviation (A,) of the noise on actions in [-1, 1]."""
        return self.policy.log_std.detach().cpu().numpy()

    def collect_rollouts(
        self,
        env: VecEnv,
        callback: BaseCallback,
        rollout_buffer: RolloutBuffer,
        n_rollout_steps: int,
    ) -> bool:
        """Fill the buffer; False if a callback asked to stop.

        Only the actor runs in the loop. Values follow in one batch: the weights do not change
        meanwhile. Log probabilities follow from the noise that was drawn.
        """
        buffer = self.rollout_buffer
        buffer.reset()
        self.policy.set_training_mode(False)
        callback.on_rollout_start()
        rows = self._rows_within_budget(env.num_envs, n_rollout_steps)
        buffer.limit_rows(rows)
        deviations = torch.randn(
            n_rollout_steps, env.num_envs, self.policy.log_std.numel(), device=self.device
        )
        noise = (deviations * self.policy.log_std.detach().exp()).cpu().numpy()
        time_limits: list[tuple[int, int, NDArray[np.float32]]] = []
        for step in range(n_rollout_steps):
            observation, starts = self._last_rows()
            with torch.inference_mode():
                local = torch.as_tensor(observation["observation"], device=self.device)
                actions = self.policy.action_mean(local).cpu().numpy() + noise[step]
            self._check_actions(actions)
            new_observation, rewards, dones, infos = env.step(self.policy.unscale_action(actions))
            buffer.add(observation, actions, rewards, starts)
            self._last_obs, self._last_episode_starts = cast(Rows, new_observation), dones
            self.num_timesteps += rows
            if dones.any():
                ends = _ends_by_time_limit(step, dones, infos)
                self._check_ends(len(ends) < dones.sum())
                time_limits += ends
                infos, dones = infos[:rows], dones[:rows]
                self._update_info_buffer(infos, dones)
            callback.update_locals(locals())
            if not callback.on_step():
                return False
        self._evaluate_rollout(deviations, time_limits)
        callback.update_locals(locals())
        callback.on_rollout_end()
        return True

    def _evaluate_rollout(
        self,
        deviations: torch.Tensor,
        time_limits: list[tuple[int, int, NDArray[np.float32]]],
    ) -> None:
        """Values, log probabilities, advantages; a time limit is no end of the return (M15)."""
        buffer = self.rollout_buffer
        if self.center_rewards:
            self._average_rewards(buffer.rewards[:, : buffer.rows])
            buffer.rewards -= self.reward_mean
        last_observation, starts = self._last_rows()
        last_states = last_observation["state"][:: self.agents_per_world]
        states = [buffer.states.reshape(-1, buffer.states.shape[-1]), last_states]
        if time_limits:
            states.append(np.stack([state for _, _, state in time_limits]))
        values = self._state_values(np.concatenate(states))
        stored, last, limits = np.split(values, [len(states[0]), len(states[0]) + len(last_states)])
        for (step, row, _), value in zip(time_limits, limits, strict=True):
            buffer.rewards[step, row] += self.gamma * value
        with torch.inference_mode():
            log_probs = gaussian_log_density(deviations, self.policy.log_std).cpu().numpy()
        buffer.finish(
            stored.reshape(buffer.states.shape[:2]),
            log_probs,
            torch.from_numpy(last),
            starts,
        )

    def _state_values(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        with torch.inference_mode():
            chunks = [
                self.policy.state_value(rows.to(self.device)).cpu().numpy()
                for rows in torch.from_numpy(states).split(_ROWS_PER_FORWARD)
            ]
        return np.concatenate(chunks)

    def train(self) -> None:
        """Update actor and critic on the collected rollout."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        measured: list[torch.Tensor] = []
        for _ in range(self.n_epochs):
            if not self._train_epoch(measured):
                break
            self._n_updates += 1
        metrics = dict(zip(_METRICS, torch.stack(measured).mean(dim=0).tolist(), strict=True))
        self._check_losses(metrics)
        self._log_update(metrics)

    def _train_epoch(self, measured: list[torch.Tensor]) -> bool:
        """One pass over the rollout; False if ``target_kl`` was exceeded."""
        groups = self.policy.actor_parameters(), self.policy.critic_parameters()
        for batch in self.rollout_buffer.get(self.batch_size, self.minibatch):
            loss, metrics = self._loss(batch)
            measured.append(metrics)
            if self.target_kl is not None and metrics[_KL_METRIC] > 1.5 * self.target_kl:
                return False
            self.policy.optimizer.zero_grad()
            loss.backward()
            for parameters in groups:
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
            self.policy.optimizer.step()
        return True

    def _loss(self, batch: MiniBatch) -> tuple[torch.Tensor, torch.Tensor]:
        """Loss to minimise, and the metrics named ``_METRICS``."""
        progress = self._current_progress_remaining
        clip_range = cast(Schedule, self.clip_range)(progress)
        log_std = self.policy.log_std
        mean = self.policy.action_mean(batch.observations)
        log_prob = gaussian_log_density((batch.actions - mean) * torch.exp(-log_std), log_std)
        entropy = gaussian_entropy(log_std)
        advantages = batch.advantages
        if self.normalize_advantage and len(advantages) > 1:
            advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        log_ratio = log_prob - batch.old_log_prob
        ratio = log_ratio.exp()
        clipped_ratio = ratio.clamp(1.0 - clip_range, 1.0 + clip_range)
        policy_loss = -torch.min(advantages * ratio, advantages * clipped_ratio).mean()
        values = self.policy.state_value(batch.states).index_select(0, batch.state_of_row)
        if self.clip_range_vf is not None:
            limit = cast(Schedule, self.clip_range_vf)(progress)
            values = batch.old_values + (values - batch.old_values).clamp(-limit, limit)
        value_loss = functional.mse_loss(values, batch.returns)
        loss = policy_loss - self.ent_coef * entropy + self.vf_coef * value_loss
        with torch.no_grad():
            divergence = (ratio - 1.0 - log_ratio).mean()  # Schulman's low-variance estimate
            clip_fraction = ((ratio - 1.0).abs() > clip_range).float().mean()
            metrics = torch.stack([policy_loss, value_loss, entropy, divergence, clip_fraction])
        return loss, metrics

    def _log_update(self, metrics: dict[str, float]) -> None:
        self._log_learning_rates()
        for name, metric in metrics.items():
            self.logger.record(f"train/{name}", metric)
        rows = self.rollout_buffer.rows
        values, returns = self.rollout_buffer.values, self.rollout_buffer.returns
        self.logger.record(
            "train/explained_variance",
            explained_variance(values[:, :rows].flatten(), returns[:, :rows].flatten()),
        )
        self._log_values(float(values[:, :rows].mean()))
        self.logger.record("train/std", self.policy.log_std.detach().exp().mean().item())
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")


def _ends_by_time_limit(
    step: int, dones: NDArray[np.bool_], infos: list[dict[str, Any]]
) -> list[tuple[int, int, NDArray[np.float32]]]:
    """(step, row, last state) of the rows whose episode ended by truncation alone."""
    return [
        (step, int(row), np.asarray(infos[row]["terminal_observation"]["state"], np.float32))
        for row in np.flatnonzero(dones)
        if infos[row].get("TimeLimit.truncated", False)
    ]
