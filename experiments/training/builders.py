"""Builds the learner and the Reset-and-Finetune callback of a configuration."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch

from orchid_uav.agents.maddpg.maddpg import MADDPG
from orchid_uav.agents.mappo.mappo import MAPPO
from orchid_uav.callbacks import ResetAndFinetune
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.envs.seeds import RANDOM_RESETS_STREAM
from orchid_uav.experiments.configuration import RunConfig


def build_model(config: RunConfig, env: FleetVecEnv) -> MAPPO | MADDPG:
    """Build the learner of a configuration; SB3 seeds the worlds of ``env`` as it does so."""
    return _build_maddpg(config, env) if is_maddpg(config) else _build_mappo(config, env)


def is_maddpg(config: RunConfig) -> bool:
    """Whether the learner is MADDPG, which has no entropy bonus; otherwise it is MAPPO."""
    return config.training.algorithm == "maddpg"


def _build_mappo(config: RunConfig, env: FleetVecEnv) -> MAPPO:
    ppo, training = config.ppo, config.training
    return MAPPO(
        "CentralizedCriticPolicy",
        env,
        learning_rate=ppo.actor_learning_rate,
        critic_learning_rate=ppo.critic_learning_rate,
        n_steps=config.network.episode_slots,
        batch_size=ppo.batch_size,
        minibatch=ppo.minibatch,
        n_epochs=ppo.epochs,
        gamma=ppo.discount,
        gae_lambda=ppo.gae_lambda,
        clip_range=ppo.clip_ratio,
        ent_coef=ppo.entropy_coef[0],
        vf_coef=ppo.value_coef,
        max_grad_norm=ppo.max_grad_norm,
        policy_kwargs={
            "net_arch": ppo.hidden_sizes,
            "log_std_init": ppo.log_std_init,
            "optimizer_kwargs": {"eps": ppo.adam_epsilon, "fused": True},
        },
        center_rewards=training.center_rewards,
        seed=training.seed,
    )


def _build_maddpg(config: RunConfig, env: FleetVecEnv) -> MADDPG:
    maddpg, training = config.maddpg, config.training
    return MADDPG(
        "JointCriticPolicy",
        env,
        learning_rate=maddpg.actor_learning_rate,
        critic_learning_rate=maddpg.critic_learning_rate,
        buffer_size=maddpg.buffer_size,
        batch_size=maddpg.batch_size,
        target_rate=maddpg.target_rate,
        gamma=maddpg.discount,
        update_every=maddpg.update_every_slots,
        gradient_steps=training.worlds,
        exploration_std=maddpg.exploration_std,
        preactivation_penalty=maddpg.preactivation_penalty,
        max_grad_norm=maddpg.max_grad_norm,
        episode_steps=config.network.episode_slots,
        policy_kwargs={
            "net_arch": maddpg.hidden_sizes,
            "optimizer_kwargs": {"eps": maddpg.adam_epsilon, "fused": True},
        },
        center_rewards=training.center_rewards,
        seed=training.seed,
    )


def build_reset_and_finetune(config: RunConfig) -> ResetAndFinetune | None:
    """Build the callback of a configuration; None with ``--no-rf``."""
    reset = config.reset
    if not reset.enabled:
        return None
    return ResetAndFinetune(
        window=reset.window,
        tolerance_jfi=reset.tolerance_jfi,
        tolerance_reward=reset.tolerance_reward,
        kappa=reset.kappa,
        max_resets=reset.max_resets,
        at_episodes=_random_episodes(config) if reset.trigger == "random" else None,
        clear_optimizer=reset.clear_optimizer,
    )


def _random_episodes(config: RunConfig) -> list[int]:
    """Draw episodes at which a plateau could be seen and after which training still goes on.

    They are at least 2W apart, as resets at plateaus are.
    """
    distance, last = 2 * config.reset.window, schedule_episodes(config) - 1
    count = min(config.reset.max_resets, last // distance)
    generator = np.random.default_rng([config.training.seed, RANDOM_RESETS_STREAM])
    # Draw distinct numbers from a shortened range, then move them apart by the least distance.
    choices = np.arange(distance, last + 1 - (count - 1) * (distance - 1))
    drawn = np.sort(generator.choice(choices, count, replace=False))
    return (drawn + np.arange(count) * (distance - 1)).tolist()


def schedule_episodes(config: RunConfig) -> int:
    """Episodes over which schedules run: those planned at first, even if the run was extended."""
    return config.training.schedule_episodes or config.training.episodes


@contextmanager
def torch_settings(threads: int) -> Iterator[None]:
    """Within, torch computes with so many threads and without denormal numbers.

    Adam's averages of vanishing gradients decay into denormals, numbers below 1e-38, with which
    the processor computes several times slower. If they are kept, the updates of a run take up to
    half as long again (see docs/performance.md). Both settings hold for the whole process, Python's
    own floats included; afterwards they are what they were, for a program that trains and goes on.
    """
    threads_before, kept_denormals = torch.get_num_threads(), _keeps_denormals()
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_num_threads(threads_before)
        torch.set_flush_denormal(not kept_denormals)


def _keeps_denormals() -> bool:
    """Whether this thread computes with denormal numbers, which torch does not tell."""
    return sys.float_info.min / 2 > 0
