"""A configuration reaches the learner number by number."""

import random
import sys

import numpy as np
import pytest
import torch

from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.training.builders import (
    build_model,
    build_reset_and_finetune,
    torch_settings,
)

UNUSUAL = RunConfig.model_validate(
    {
        "network": {"episode_slots": 17, "uav_count": 2, "user_count": 9},
        "ppo": {
            "actor_learning_rate": 2e-4,
            "critic_learning_rate": 3e-3,
            "discount": 0.91,
            "gae_lambda": 0.83,
            "clip_ratio": 0.13,
            "batch_size": 33,
            "epochs": 3,
            "entropy_coef": [0.03, 0.01],
            "value_coef": 0.7,
            "max_grad_norm": 0.3,
            "hidden_sizes": [8, 9],
            "log_std_init": -1.5,
            "adam_epsilon": 1e-6,
        },
        "reset": {
            "window": 7,
            "tolerance_jfi": 0.01,
            "tolerance_reward": 0.02,
            "kappa": 0.1,
            "max_resets": 3,
        },
    }
)


def test_every_number_of_ppo_is_used():
    model = build_model(UNUSUAL, FleetVecEnv(UNUSUAL.network_parameters))
    assert model.learning_rates == (2e-4, 3e-3)
    assert (model.gamma, model.gae_lambda) == (0.91, 0.83)
    assert (model.rollout_buffer.gamma, model.rollout_buffer.gae_lambda) == (0.91, 0.83)
    assert model.clip_range(1.0) == 0.13
    assert (model.batch_size, model.n_epochs, model.n_steps) == (33, 3, 17)
    assert (model.ent_coef, model.vf_coef, model.max_grad_norm) == (0.03, 0.7, 0.3)
    assert [len(bias) for _, bias in model.policy.actor_layers()] == [8, 9, 4]
    assert model.policy.log_std.tolist() == [-1.5] * 4
    optimizer = model.policy.optimizer
    assert all(group["eps"] == 1e-6 and group["fused"] for group in optimizer.param_groups)


def test_every_number_of_the_reset_is_used():
    callback = build_reset_and_finetune(UNUSUAL)
    assert callback.window == 7
    assert callback.tolerances == {"rate_jfi": 0.01, "reward": 0.02}
    assert (callback.kappa, callback.max_resets) == (0.1, 3)
    off = UNUSUAL.model_copy(update={"reset": UNUSUAL.reset.model_copy(update={"enabled": False})})
    assert build_reset_and_finetune(off) is None


def reset_episodes(seed: int, episodes: int, **reset) -> list[int] | None:
    """Those that a configuration with R&F at random episodes draws; 2W is 4."""
    config = RunConfig.model_validate(
        {
            "reset": {"window": 2, "trigger": "random"} | reset,
            "training": {"seed": seed, "episodes": episodes},
        }
    )
    return build_reset_and_finetune(config).at_episodes


class TestRandomTrigger:
    def test_only_the_trigger_named_random_draws(self):
        assert reset_episodes(0, 8, trigger="plateau") is None

    def test_draws_any_episode_from_two_windows_on_but_not_the_last(self):
        drawn = [reset_episodes(seed, 8) for seed in range(100)]
        assert {len(episodes) for episodes in drawn} == {1}
        assert {episodes[0] for episodes in drawn} == {4, 5, 6, 7}

    def test_is_decided_by_the_seed(self):
        first, again = ([reset_episodes(seed, 1000) for seed in range(20)] for _ in range(2))
        assert first == again
        assert len({episodes[0] for episodes in first}) > 15

    @pytest.mark.parametrize(
        ("episodes", "count"), [(50, 3), (9, 2), (6, 1), (5, 1), (4, 0), (1, 0)]
    )
    def test_draws_as_many_as_allowed_and_possible(self, episodes, count):
        drawn = reset_episodes(1, episodes, max_resets=3)
        assert len(drawn) == len(set(drawn)) == count
        assert all(distance >= 4 for distance in np.diff(drawn)), "as plateaus are"
        assert all(4 <= episode < episodes for episode in drawn)

    def test_of_a_run_that_is_extended_stays(self):
        config = RunConfig.model_validate({"reset": {"trigger": "random"}, "training": {"seed": 5}})
        first = build_reset_and_finetune(config).at_episodes
        assert build_reset_and_finetune(config.extended_to(9000)).at_episodes == first

    def test_takes_no_random_number_of_the_run(self):
        def states():
            name, keys, *rest = np.random.get_state()  # noqa: NPY002
            return torch.get_rng_state().tolist(), random.getstate(), name, keys.tolist(), rest

        before = states()
        reset_episodes(3, 100)
        assert states() == before


def test_a_reset_that_keeps_the_optimizer_is_built_from_its_key():
    kept = UNUSUAL.reset.model_copy(update={"clear_optimizer": False})
    assert build_reset_and_finetune(UNUSUAL).clear_optimizer is True
    callback = build_reset_and_finetune(UNUSUAL.model_copy(update={"reset": kept}))
    assert callback.clear_optimizer is False


def test_defaults_are_table_i():
    config = RunConfig()
    assert (config.ppo.actor_learning_rate, config.ppo.critic_learning_rate) == (1e-4, 1e-3)
    assert (config.ppo.discount, config.ppo.gae_lambda, config.ppo.clip_ratio) == (0.99, 0.95, 0.2)
    assert (config.ppo.batch_size, config.ppo.epochs) == (128, 4)
    assert config.ppo.entropy_coef == (0.01, 0.0)
    assert config.ppo.hidden_sizes == (256, 256, 256)
    assert (config.reset.window, config.reset.kappa, config.reset.max_resets) == (50, 0.5, 1)
    assert config.reset.tolerance_jfi == config.reset.tolerance_reward == 0.05
    assert config.training.episodes == 700


class TestSettingsOfTorch:
    """The process of a program that trains from Python is its own."""

    @pytest.fixture(params=[True, False])
    def flushed(self, request):
        """Whether the program computes without denormal numbers anyway."""
        if not torch.set_flush_denormal(request.param):
            pytest.skip("torch cannot flush denormal numbers on this processor")
        yield request.param
        torch.set_flush_denormal(False)

    @staticmethod
    def in_force():
        return torch.get_num_threads(), sys.float_info.min / 2 == 0

    @pytest.mark.parametrize("error", [None, RuntimeError])
    def test_hold_within_and_are_as_before_afterwards(self, flushed, error):
        before = self.in_force()
        assert before == (1, flushed)
        try:
            with torch_settings(threads=2):
                assert self.in_force() == (2, True)
                if error:
                    raise error
        except RuntimeError:
            pass
        assert self.in_force() == before
