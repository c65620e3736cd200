"""The learner: what actor and critic see, what is bootstrapped, what a budget means."""

import math

import numpy as np
import pytest
import torch
from mpe2 import simple_spread_v3
from stable_baselines3.common.callbacks import BaseCallback
from torch import nn

from orchid_uav.agents import MAPPO, CentralizedCriticPolicy
from orchid_uav.callbacks import EpisodeLog, ProgressSchedules, ResetAndFinetune
from orchid_uav.envs import make_supersuit_vec_env, make_vec_env, parallel_env
from orchid_uav.envs.interfaces.global_state_wrapper import CentralizedState
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.training.builders import build_model, build_reset_and_finetune
from tests.helpers.learners import SMALL, ConstantReward, small_model
from tests.helpers.processes import NEEDS_SUPERSUIT


def rows_of(model: MAPPO) -> dict[str, torch.Tensor]:
    model.env.reset()
    observation, *_ = model.env.step(np.full((model.n_envs, 4), 0.5))
    return {key: torch.from_numpy(array).requires_grad_() for key, array in observation.items()}


class TestWhoSeesWhat:
    def test_the_actors_gradient_with_respect_to_the_state_is_exactly_zero(self):
        model = small_model(worlds=2)
        rows = rows_of(model)
        distribution = model.policy.get_distribution(rows)
        (distribution.log_prob(torch.zeros(4, 4)).sum() + distribution.mode().sum()).backward()
        assert rows["state"].grad is None
        assert rows["observation"].grad.abs().sum() > 0

    def test_the_critic_sees_the_other_uavs_observations(self):
        model = small_model()
        rows = rows_of(model)
        # Row 0 is UAV 0; UAV 1's observation is numbers 16..31 of the state.
        model.policy.predict_values(rows)[0].sum().backward()
        assert rows["state"].grad[0, 16:32].abs().sum() > 0
        assert rows["observation"].grad is None

    def test_an_actor_knows_nothing_of_its_neighbours(self):
        model = small_model()
        rows = {key: tensor.detach() for key, tensor in rows_of(model).items()}
        mean = model.policy.action_mean(rows["observation"])
        changed = rows["observation"].clone()
        changed[1] += 1.0
        torch.testing.assert_close(model.policy.action_mean(changed)[0], mean[0])

    def test_networks_are_the_papers(self):
        model = MAPPO("CentralizedCriticPolicy", make_vec_env())
        for network, inputs, outputs in (
            (model.policy.actor, 16, 4),
            (model.policy.critic, 197, 1),
        ):
            sizes = [
                (layer.in_features, layer.out_features)
                for layer in network
                if isinstance(layer, nn.Linear)
            ]
            assert sizes == [(inputs, 256), (256, 256), (256, 256), (256, outputs)]
            activations = [layer for layer in network if not isinstance(layer, nn.Linear)]
            assert all(isinstance(layer, nn.ReLU) for layer in activations)

    def test_means_lie_within_the_action_space_and_noise_is_added_outside_the_tanh(self):
        model = small_model(policy_kwargs={"log_std_init": -1.0})
        rows = {key: tensor.detach() * 1e3 for key, tensor in rows_of(model).items()}
        distribution = model.policy.get_distribution(rows)
        assert distribution.mode().abs().max() <= 1.0
        assert distribution.distribution.stddev.flatten().tolist() == pytest.approx(
            [math.exp(-1.0)] * 8
        )

    def test_refuses_an_environment_without_a_state(self):
        class Stateless:
            possible_agents = ("a",)

        with pytest.raises(TypeError, match="state_space"):
            CentralizedState(Stateless())


class TestReturns:
    GAMMA = 0.9

    def learned_value(self, truncates: bool, length: int, n_steps: int) -> float:
        env = ConstantReward(reward=2.0, length=length, truncates=truncates)
        model = MAPPO(
            "CentralizedCriticPolicy",
            env,
            critic_learning_rate=1e-2,
            n_steps=n_steps,
            batch_size=64,
            n_epochs=10,
            gamma=self.GAMMA,
            seed=0,
            policy_kwargs={"net_arch": [16]},
        )
        model.learn(2 * n_steps * 50)
        return float(model.policy.state_value(torch.ones(1, 3)).detach())

    @pytest.mark.parametrize(("length", "n_steps"), [(8, 32), (32, 32), (50, 32)])
    def test_a_constant_reward_under_truncation_is_worth_r_over_one_minus_gamma(
        self, length, n_steps
    ):
        value = self.learned_value(truncates=True, length=length, n_steps=n_steps)
        assert value == pytest.approx(2.0 / (1 - self.GAMMA), rel=0.03)

    def test_termination_is_worth_less(self):
        # One step per episode: the value is the reward itself.
        assert self.learned_value(truncates=False, length=1, n_steps=32) == pytest.approx(
            2.0, rel=0.03
        )

    def test_advantages_are_generalised_advantage_estimation(self):
        model = small_model(worlds=2, gamma=0.9, gae_lambda=0.8, n_steps=7)
        model.learn(2 * 2 * 7)
        buffer = model.rollout_buffer
        last_values = model.policy.predict_values(
            {key: torch.from_numpy(array) for key, array in model._last_obs.items()}
        ).detach()
        # The rollout was evaluated with the weights of before the update: take its own values and
        # compare the recursion written out as a sum, all within one unfinished episode.
        deltas = np.empty((7, 4))
        values = np.concatenate([buffer.values, np.full((1, 4), np.nan)])
        for step in range(6):
            deltas[step] = buffer.rewards[step] + 0.9 * values[step + 1] - values[step]
        deltas[6] = buffer.advantages[6]
        for step in range(7):
            expected = sum((0.9 * 0.8) ** (k - step) * deltas[k] for k in range(step, 7))
            np.testing.assert_allclose(buffer.advantages[step], expected, rtol=2e-4, atol=1e-5)
        np.testing.assert_allclose(buffer.returns, buffer.advantages + buffer.values, rtol=1e-6)
        assert last_values.shape == (4, 1)

    def test_one_value_per_world_and_step(self):
        model = small_model(worlds=3)
        model.learn(3 * 2 * 10)
        values = model.rollout_buffer.values.reshape(10, 3, 2)
        np.testing.assert_array_equal(values[:, :, 0], values[:, :, 1])
        assert len(np.unique(values)) > 3


class TestLoss:
    """Against SB3's distribution, and a value computed for every row."""

    @pytest.mark.parametrize("unit", ["rows", "slots"])
    @pytest.mark.parametrize("value_clip", [None, 0.05])
    def test_and_its_gradient_are_the_plain_ones(self, unit, value_clip):
        model = small_model(worlds=3, minibatch=unit, clip_range_vf=value_clip, ent_coef=0.02)
        model.learn(3 * 2 * 10)
        policy = model.policy
        for batch in model.rollout_buffer.get(11, unit):
            policy.zero_grad()
            loss, _ = model._loss(batch)
            loss.backward()
            gradients = [parameter.grad.clone() for parameter in policy.parameters()]
            policy.zero_grad()
            plain = self.plain_loss(model, batch, value_clip)
            plain.backward()
            assert loss.item() == pytest.approx(plain.item(), rel=1e-5)
            for parameter, gradient in zip(policy.parameters(), gradients, strict=True):
                torch.testing.assert_close(gradient, parameter.grad, rtol=1e-4, atol=1e-6)

    @staticmethod
    def plain_loss(model, batch, value_clip):
        rows = {"observation": batch.observations, "state": batch.states[batch.state_of_row]}
        values, log_prob, entropy = model.policy.evaluate_actions(rows, batch.actions)
        values = values.flatten()
        if value_clip is not None:
            change = (values - batch.old_values).clamp(-value_clip, value_clip)
            values = batch.old_values + change
        advantages = (batch.advantages - batch.advantages.mean()) / (batch.advantages.std() + 1e-8)
        ratio = (log_prob - batch.old_log_prob).exp()
        policy_loss = torch.min(advantages * ratio, advantages * ratio.clamp(0.8, 1.2)).mean()
        return 0.5 * ((values - batch.returns) ** 2).mean() - policy_loss - 0.02 * entropy.mean()

    def test_log_densities_of_a_rollout_are_those_of_its_actions(self):
        model = small_model(worlds=2)
        _, callback = model._setup_learn(40, Count())
        model.collect_rollouts(model.env, callback, model.rollout_buffer, 10)
        (batch,) = model.rollout_buffer.get()
        expected = model.policy.distribution(batch.observations).log_prob(batch.actions)
        torch.testing.assert_close(batch.old_log_prob, expected.detach(), rtol=1e-5, atol=1e-5)


class TestRates:
    def test_actor_and_critic_have_their_own(self):
        model = small_model()
        model.learn(20)
        rates = {group["name"]: group["lr"] for group in model.policy.optimizer.param_groups}
        assert rates == {"actor": 1e-4, "critic": 1e-3}
        groups = model.policy.optimizer.param_groups
        assert sum(len(group["params"]) for group in groups) == len(list(model.policy.parameters()))

    def test_schedules_reach_the_optimizer(self):
        model = small_model(learning_rate=lambda left: 1e-4 * left, critic_learning_rate=2e-3)
        model.learn(2 * 20)  # two rollouts: after the second nothing is left
        assert model.policy.optimizer.param_groups[0]["lr"] == 0.0
        assert model.policy.optimizer.param_groups[1]["lr"] == 2e-3

    def test_a_larger_reward_leaves_the_actors_gradient_alone(self):
        # One clip over both would divide the actor's gradient by the critic's norm.
        norms = {}
        for reward in (1.0, 1000.0):
            model = MAPPO(
                "CentralizedCriticPolicy",
                ConstantReward(reward, 8),
                n_steps=16,
                seed=0,
                max_grad_norm=1e-3,
                n_epochs=1,
                ent_coef=0.01,
                policy_kwargs={"net_arch": [16]},
            )
            model.learn(32)
            norms[reward] = math.sqrt(
                sum(float((p.grad**2).sum()) for p in model.policy.actor_parameters())
            )
        assert norms[1000.0] == pytest.approx(norms[1.0], rel=1e-3)
        assert norms[1.0] == pytest.approx(1e-3, rel=1e-3)


class Count(BaseCallback):
    def __init__(self) -> None:
        super().__init__()
        self.episodes = 0

    def _on_step(self) -> bool:
        self.episodes += sum("episode_metrics" in info for info in self.locals["infos"])
        return True


class TestBudget:
    @pytest.mark.parametrize(("worlds", "episodes"), [(1, 3), (3, 7), (4, 4), (5, 2)])
    def test_exactly_the_episodes_asked_for_are_flown_and_learned_from(self, worlds, episodes):
        model, count = small_model(worlds=worlds), Count()
        samples = []
        original = model.train

        def train() -> None:
            samples.append(sum(len(batch.actions) for batch in model.rollout_buffer.get(7)))
            original()

        model.train = train
        model.learn(episodes * 10 * 2, callback=count)
        assert count.episodes == episodes * 2  # one info per UAV
        assert model.num_timesteps == sum(samples) == episodes * 10 * 2

    @pytest.mark.parametrize(("unit", "most"), [("rows", 7), ("slots", 7 * 2)])
    def test_mini_batches_hold_every_sample_once_with_its_own_state(self, unit, most):
        model = small_model(worlds=3)
        model.learn(3 * 2 * 10)
        seen, sizes = [], []
        for batch in model.rollout_buffer.get(7, unit):
            sizes.append(len(batch.observations))
            assert len(torch.unique(batch.states, dim=0)) == len(batch.states)
            assert torch.equal(batch.state_of_row.unique(), torch.arange(len(batch.states)))
            states = batch.states[batch.state_of_row]
            for observation, state in zip(batch.observations, states, strict=True):
                both = state[:32].reshape(2, 16)
                assert any(torch.equal(observation, own) for own in both)
                seen.append(observation.numpy().tobytes() + state.numpy().tobytes())
        assert len(set(seen)) == len(seen) == 60
        assert set(sizes[:-1]) == {most}

    def test_slots_hold_all_agents_of_a_world_and_step(self):
        model = small_model(worlds=3)
        model.learn(3 * 2 * 10)
        for batch in model.rollout_buffer.get(7, "slots"):
            both = batch.observations.reshape(len(batch.states), 2 * 16)
            torch.testing.assert_close(both, batch.states[:, :32], rtol=0, atol=0)

    def test_a_unit_is_rows_or_slots(self):
        with pytest.raises(ValueError, match="rows or slots"):
            small_model(minibatch="episodes")

    def test_same_seed_same_weights_other_seed_others(self):
        def weights(seed: int) -> np.ndarray:
            model = small_model(seed=seed, worlds=2)
            model.learn(6 * 20)
            return torch.cat([p.detach().flatten() for p in model.policy.parameters()]).numpy()

        np.testing.assert_array_equal(weights(3), weights(3))
        assert not np.array_equal(weights(3), weights(4))


def test_learns_to_please():
    """A task with a known optimum: reward for action 1 of the first number, against its start."""

    class Wish(ConstantReward):
        def step_async(self, actions: np.ndarray) -> None:
            self.wish = -((actions[:, 0] - 0.7) ** 2)

        def step_wait(self):
            rows, _, dones, infos = super().step_wait()
            return rows, self.wish.astype(np.float32), dones, infos

    model = MAPPO(
        "CentralizedCriticPolicy",
        Wish(0.0, 8),
        learning_rate=3e-3,
        n_steps=64,
        batch_size=64,
        gamma=0.5,
        seed=0,
        policy_kwargs={"net_arch": [16], "log_std_init": -1.0},
    )
    model.learn(2 * 64 * 40)
    assert float(model.policy.action_mean(torch.ones(1, 3)).detach()) == pytest.approx(0.7, abs=0.1)


def test_saves_and_loads_like_any_sb3_model(tmp_path):
    model = small_model()
    model.learn(40)
    model.learning_rate_scale = 0.5
    model.save(tmp_path / "model")
    loaded = MAPPO.load(tmp_path / "model", env=make_vec_env(1, **SMALL))
    for first, second in zip(model.policy.parameters(), loaded.policy.parameters(), strict=True):
        assert torch.equal(first, second)
    assert loaded.learning_rates == model.learning_rates == (5e-5, 5e-4)
    loaded.learn(40)


class TestOtherEnvironments:
    @NEEDS_SUPERSUIT
    def test_native_and_supersuit_learn_the_same(self):
        native = small_model(worlds=2)
        native.learn(5 * 20)
        # Built after that: building a model seeds torch's one generator.
        through_supersuit = MAPPO(
            "CentralizedCriticPolicy",
            make_supersuit_vec_env(lambda: parallel_env(**SMALL), 2, seed=0),
            n_steps=10,
            seed=0,
            policy_kwargs={"net_arch": [32, 32]},
        )
        through_supersuit.learn(5 * 20)
        for first, second in zip(
            native.policy.parameters(), through_supersuit.policy.parameters(), strict=True
        ):
            assert torch.equal(first, second)

    @NEEDS_SUPERSUIT
    def test_actions_reach_bounds_other_than_plus_and_minus_one(self):
        env = make_supersuit_vec_env(
            lambda: simple_spread_v3.parallel_env(continuous_actions=True), 2, seed=0
        )
        model = MAPPO("CentralizedCriticPolicy", env, n_steps=25, policy_kwargs={"net_arch": [16]})
        model.learn(2 * 3 * 25)
        assert model.num_timesteps == 150
        assert model.rollout_buffer.rows == 6
        # The box is 0..1: its middle is the policy's zero, and nothing lies outside.
        np.testing.assert_allclose(model.policy.unscale_action(np.zeros(5)), 0.5)
        np.testing.assert_allclose(model.policy.unscale_action(np.full(5, 9.0)), 1.0)
        actions, _ = model.predict(env.reset(), deterministic=False)
        assert env.action_space.contains(actions[0])

    @NEEDS_SUPERSUIT
    def test_refuses_what_it_cannot_act_in(self):
        env = make_supersuit_vec_env(simple_spread_v3.parallel_env, 1)
        with pytest.raises(TypeError, match="bounded Box"):
            MAPPO("CentralizedCriticPolicy", env)
        with pytest.raises(ValueError, match="use_sde"):
            small_model(use_sde=True)

    def test_loaded_without_an_environment_it_still_knows_its_agents(self, tmp_path):
        small_model().save(tmp_path / "model")
        model = MAPPO.load(tmp_path / "model")
        model.set_env(make_vec_env(1, **SMALL))
        rows = []
        model.learn(4 * 20, callback=EpisodeLog(rows.extend))
        assert [row["episode"] for row in rows] == [1, 2, 3, 4]


def test_the_policy_alone_saves_and_loads(tmp_path):
    policy = small_model().policy
    policy.save(tmp_path / "policy")
    loaded = CentralizedCriticPolicy.load(tmp_path / "policy")
    for first, second in zip(policy.parameters(), loaded.parameters(), strict=True):
        assert torch.equal(first, second)


def test_defaults_are_the_configurations():
    """Table I stands in the configuration; what the classes begin with must be the same."""
    config = RunConfig()
    by_hand = MAPPO("CentralizedCriticPolicy", make_vec_env())
    configured = build_model(config, make_vec_env())
    for name in ("learning_rates", "n_steps", "batch_size", "minibatch", "n_epochs"):
        assert getattr(by_hand, name) == getattr(configured, name), name
    for name in ("gamma", "gae_lambda"):
        assert getattr(by_hand, name) == getattr(configured, name), name
    for name in ("ent_coef", "vf_coef", "max_grad_norm", "normalize_advantage"):
        assert getattr(by_hand, name) == getattr(configured, name), name
    assert by_hand.clip_range(1.0) == configured.clip_range(1.0)
    assert by_hand.policy.optimizer.defaults == configured.policy.optimizer.defaults
    shapes = [[p.shape for p in model.policy.parameters()] for model in (by_hand, configured)]
    assert shapes[0] == shapes[1]
    callback, reset = ResetAndFinetune(), build_reset_and_finetune(config)
    for name in ("window", "tolerances", "kappa", "max_resets"):
        assert getattr(callback, name) == getattr(reset, name), name
    assert ProgressSchedules(1).entropy_coef == config.ppo.entropy_coef
