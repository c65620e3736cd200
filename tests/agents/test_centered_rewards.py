"""Rewards less their running mean (M37), of both learners."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.vec_env import VecEnvWrapper

from orchid_uav.agents import MADDPG, MAPPO, centralized_training
from tests.helpers.learners import ConstantReward, small_maddpg, small_model

LEARNERS = {"mappo": small_model, "maddpg": small_maddpg}
CONSTANT = 8.0


class Shifted(VecEnvWrapper):
    """Another environment, with a constant added to every reward."""

    def reset(self):
        return self.venv.reset()

    def step_wait(self):
        rows, rewards, dones, infos = self.venv.step_wait()
        return rows, rewards + np.float32(CONSTANT), dones, infos


def weights_after(learner: str, *, shifted: bool, **keywords) -> torch.Tensor:
    model = LEARNERS[learner](worlds=2, **keywords)
    if shifted:
        model.env = Shifted(model.env)
    model.learn(2 * 2 * 10 * 3)
    return torch.cat([p.detach().flatten() for p in model.policy.parameters()])


@pytest.mark.parametrize("learner", LEARNERS)
class TestAConstantOnEveryReward:
    def test_changes_what_is_learned_by_rounding_alone(self, learner):
        differences = {}
        for centered in (False, True):
            plain, other = (
                weights_after(learner, shifted=one, center_rewards=centered)
                for one in (False, True)
            )
            differences[centered] = (plain - other).abs().max().item()
        assert differences[True] < 0.02 * differences[False]

    def test_is_what_values_are_near_zero_without(self, learner):
        levels = {}
        for centered in (False, True):
            env = ConstantReward(reward=2.0, length=8, truncates=True)
            settings = {
                "critic_learning_rate": 1e-2,
                "batch_size": 64,
                "gamma": 0.9,
                "center_rewards": centered,
                "policy_kwargs": {"net_arch": [16]},
                "seed": 0,
            }
            if learner == "mappo":
                model = MAPPO("CentralizedCriticPolicy", env, n_steps=32, n_epochs=10, **settings)
                model.learn(2 * 32 * 40)
                level = model.policy.state_value(torch.ones(1, 3))
            else:
                model = MADDPG("JointCriticPolicy", env, target_rate=0.05, **settings)
                model.learn(2 * 32 * 40)
                level = model.policy.joint_value(torch.ones(1, 3), torch.zeros(1, 2, 1))
            levels[centered] = level.item()
            logged = model.logger.name_to_value["train/mean_value"]
            assert logged == pytest.approx(levels[centered], abs=2.0)
        assert levels[False] > 15.0  # 2 / (1 - 0.9) in the end
        assert abs(levels[True]) < 0.5

    def test_is_no_constant_where_episodes_end_by_themselves(self, learner):
        env = ConstantReward(reward=2.0, length=3, truncates=False)
        kind, policy = {
            "mappo": (MAPPO, "CentralizedCriticPolicy"),
            "maddpg": (MADDPG, "JointCriticPolicy"),
        }[learner]
        kind(policy, env, batch_size=4, policy_kwargs={"net_arch": [4]}).learn(16)
        model = kind(
            policy, env, batch_size=4, policy_kwargs={"net_arch": [4]}, center_rewards=True
        )
        with pytest.raises(ValueError, match="ended by itself"):
            model.learn(16)


def test_the_running_mean_forgets(monkeypatch):
    monkeypatch.setattr(centralized_training, "_STEPS_OF_MEAN", 4)
    model = small_model(center_rewards=True)
    rewards = np.random.default_rng(0).normal(3.0, 1.0, (9, 2)).astype(np.float32)
    model._average_rewards(rewards[:6])
    model._average_rewards(rewards[6:])
    steps = rewards.mean(axis=1, dtype=float)
    expected = steps[:4].mean()
    for reward in steps[4:]:
        expected = 0.75 * expected + 0.25 * reward
    assert model.reward_mean == pytest.approx(expected, rel=1e-12)


def test_surplus_worlds_are_not_averaged():
    """Three worlds, four episodes: of the last rollout only one world counts (M33)."""
    means = {}
    for learner, make in LEARNERS.items():
        model = make(worlds=3, center_rewards=True)
        model.learn(4 * 2 * 10)
        means[learner] = model._steps_averaged, model.reward_mean
    assert means["mappo"][0] == means["maddpg"][0] == 20
    seen = []
    model = small_model(worlds=3)
    collect = model._evaluate_rollout

    def remember(*arguments):
        seen.append(model.rollout_buffer.rewards[:, : model.rollout_buffer.rows].copy())
        collect(*arguments)

    model._evaluate_rollout = remember
    model.learn(4 * 2 * 10)
    assert [rewards.shape[1] for rewards in seen] == [6, 2]
    first, second = (rewards.mean(axis=1, dtype=float) for rewards in seen)
    assert means["mappo"][1] == pytest.approx(np.concatenate([first, second]).mean(), rel=0.05)
