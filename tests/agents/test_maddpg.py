"""MADDPG: who sees what, values, exploration, budgets, learning, files, environments."""

import math

import numpy as np
import pytest
import torch
from mpe2 import simple_spread_v3
from torch import nn

from orchid_uav.agents import MADDPG, JointCriticPolicy
from orchid_uav.callbacks import EpisodeLog
from orchid_uav.envs import make_supersuit_vec_env, make_vec_env, parallel_env
from tests.helpers.learners import MADDPG_NETWORKS, SMALL, ConstantReward, Wishes, small_maddpg
from tests.helpers.processes import NEEDS_SUPERSUIT


def weights(module: nn.Module) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten() for parameter in module.parameters()])


class TestWhoSeesWhat:
    def rows(self, model: MADDPG) -> dict[str, torch.Tensor]:
        model.env.reset()
        observation, *_ = model.env.step(np.full((model.n_envs, 4), 0.5))
        return {key: torch.from_numpy(array).requires_grad_() for key, array in observation.items()}

    def test_the_actor_reads_the_own_observation_and_nothing_else(self):
        model = small_maddpg(worlds=2)
        rows = self.rows(model)
        model.policy(rows)[0].sum().backward()
        assert rows["state"].grad is None
        assert rows["observation"].grad[0].abs().sum() > 0
        assert rows["observation"].grad[1:].abs().sum() == 0
        seen = {key: tensor.detach().numpy() for key, tensor in rows.items()}
        actions, _ = model.predict(seen)
        elsewhere, _ = model.predict(seen | {"state": seen["state"] + 7.0})
        np.testing.assert_array_equal(actions, elsewhere)

    @pytest.mark.parametrize("name", ["critic", "critic_target"])
    def test_the_critic_reads_every_agents_part_of_the_state_and_every_action(self, name):
        policy = small_maddpg().policy
        state = torch.rand(3, 2 * 16 + 101, requires_grad=True)
        actions = torch.rand(3, 2, 4, requires_grad=True)
        inputs = torch.cat([state, actions.reshape(3, 8)], dim=1)
        getattr(policy, name)(inputs)[0].sum().backward()
        parts = state.grad[0, :16], state.grad[0, 16:32], state.grad[0, 32:]
        assert all((part != 0).any() for part in (*parts, *actions.grad[0]))
        assert actions.grad[1:].abs().sum() == state.grad[1:].abs().sum() == 0

    def test_the_value_distinguishes_who_acts(self):
        policy = small_maddpg().policy
        state, actions = torch.rand(1, 2 * 16 + 101), torch.rand(1, 2, 4)
        assert policy.joint_value(state, actions) != policy.joint_value(state, actions.flip(1))

    def test_networks_and_how_they_begin(self):
        policy = MADDPG("JointCriticPolicy", make_vec_env(), seed=0).policy
        for name, inputs, outputs, gain in (
            ("actor", 16, 4, 0.01),
            ("critic", 197 + 6 * 4, 1, 1.0),
        ):
            network = getattr(policy, name)
            linear = [layer for layer in network if isinstance(layer, nn.Linear)]
            sizes = [(layer.in_features, layer.out_features) for layer in linear]
            assert sizes == [(inputs, 256), (256, 256), (256, 256), (256, outputs)]
            others = [layer for layer in network if not isinstance(layer, nn.Linear)]
            assert all(isinstance(layer, nn.ReLU) for layer in others)
            last = linear[-1].weight.detach()
            torch.testing.assert_close(last @ last.T, gain**2 * torch.eye(outputs))
            assert torch.equal(weights(network), weights(getattr(policy, f"{name}_target")))
        actions = policy.action_mean(100.0 * torch.randn(50, 16))
        assert actions.abs().max() <= 1.0


class TestValue:
    """A constant reward of 2 for ever is worth 2 / (1 - gamma), the reward itself if all ends."""

    @pytest.mark.parametrize(
        ("truncates", "length", "expected"), [(True, 3, 4.0), (True, 1, 4.0), (False, 1, 2.0)]
    )
    def test_time_limits_are_bootstrapped_and_ends_are_not(self, truncates, length, expected):
        model = MADDPG(
            "JointCriticPolicy",
            ConstantReward(2.0, length, truncates),
            critic_learning_rate=1e-2,
            batch_size=16,
            target_rate=0.2,
            gamma=0.5,
            update_every=1,
            seed=0,
            policy_kwargs={"net_arch": [16]},
        )
        model.learn(2 * 300)
        batch = model.replay_buffer.sample(1)
        learned = model.policy.joint_value(batch.states, batch.actions).detach()
        assert float(learned) == pytest.approx(expected, rel=0.03)


class TestExploration:
    def noise(self, std: float) -> np.ndarray:
        env = Wishes(worlds=2)
        model = MADDPG("JointCriticPolicy", env, batch_size=10_000, exploration_std=std, seed=0)
        model.learn(4 * 600)
        observations = torch.from_numpy(model.replay_buffer.arrays[0][:1200].reshape(600, 4, 2))
        with torch.no_grad():
            means = model.policy.action_mean(observations).numpy()
        return np.stack(env.flown) - means

    def test_is_gaussian_with_the_given_spread_for_each_agent_and_step_anew(self):
        noise = self.noise(0.1)[:, :, 0]
        assert noise.std() == pytest.approx(0.1, rel=0.05)
        assert abs(noise.mean()) < 0.01
        assert np.mean(np.abs(noise) < 0.1) == pytest.approx(0.683, abs=0.03)
        correlations = np.corrcoef(np.concatenate([noise[1:], noise[:-1]], axis=1).T)
        assert np.abs(correlations - np.eye(8)).max() < 0.15

    def test_may_be_none_or_larger_than_the_box(self):
        np.testing.assert_allclose(self.noise(0.0), 0.0, atol=1e-6)
        assert np.abs(self.noise(5.0)).max() <= 1.05

    @pytest.mark.parametrize("std", [0.1, 0.0])
    def test_its_logarithm_is_finite(self, std):
        model = small_maddpg(exploration_std=std)
        expected = math.log(max(std, 1e-12))
        np.testing.assert_allclose(model.exploration_log_std(), np.full(4, expected), rtol=1e-6)

    def test_asked_without_it_the_policy_acts_the_same_twice(self):
        model = small_maddpg()
        seen = model.env.reset()
        first, again = (model.predict(seen, deterministic=choice)[0] for choice in (True, False))
        np.testing.assert_array_equal(first, again)


class TestBudget:
    @pytest.mark.parametrize(("worlds", "episodes"), [(1, 3), (3, 7), (4, 4), (5, 2)])
    def test_exactly_the_episodes_asked_for_are_flown_and_learned_from(self, worlds, episodes):
        model, rows = small_maddpg(worlds=worlds), []
        model.learn(episodes * 10 * 2, callback=EpisodeLog(rows.extend))
        assert [row["episode"] for row in rows] == list(range(1, episodes + 1))
        assert model.num_timesteps == episodes * 10 * 2
        assert model.replay_buffer.size() == episodes * 10

    def test_one_of_no_whole_number_of_episodes_is_kept_to_the_step(self):
        model = small_maddpg(worlds=2)
        model.learn(30)  # an episode and a half: both worlds fly eight slots, four rows each
        assert (model.num_timesteps, model.replay_buffer.size()) == (32, 16)

    def test_learning_on_continues_where_it_ended(self):
        model, rows = small_maddpg(worlds=3), []
        for reset in (True, False):
            model.learn(4 * 20, callback=EpisodeLog(rows.extend), reset_num_timesteps=reset)
        assert [row["episode"] for row in rows] == [1, 2, 3, 4] * 2
        assert (model.num_timesteps, model.replay_buffer.size()) == (160, 80)

    @pytest.mark.parametrize(("worlds", "batch_size", "first"), [(1, 4, 1), (1, 10, 3), (3, 30, 3)])
    def test_updates_follow_every_four_slots_once_a_batch_is_stored(
        self, worlds, batch_size, first
    ):
        model = small_maddpg(worlds=worlds, batch_size=batch_size)
        begin, changes, train = weights(model.policy), [], model.train

        def note(gradient_steps: int, batch_size: int) -> None:
            assert model.num_timesteps == 4 * 2 * worlds * (len(changes) + 1)
            before = model._n_updates
            train(gradient_steps, batch_size)
            changes.append(model._n_updates - before)
            assert torch.equal(weights(model.policy), begin) == (len(changes) < first)
            assert bool(model.policy.optimizer.state) == (len(changes) >= first)

        model.train = note
        model.learn(2 * worlds * 20)  # 20 slots
        assert changes == [0] * (first - 1) + [worlds] * (5 - first + 1)

    @pytest.mark.parametrize("worlds", [1, 3])
    def test_same_seed_same_weights_other_seed_others(self, worlds):
        def learned(seed: int) -> torch.Tensor:
            model = small_maddpg(worlds=worlds, seed=seed)
            model.learn(7 * 20)
            return weights(model.policy)

        first = learned(3)
        torch.rand(5), np.random.default_rng().random()
        assert torch.equal(learned(3), first)
        assert not torch.equal(learned(4), first)


@pytest.mark.parametrize("worlds", [1, 3])
def test_learns_what_pleases_the_other_agent(worlds):
    env = Wishes(worlds)
    model = MADDPG(
        "JointCriticPolicy",
        env,
        learning_rate=2e-3,
        critic_learning_rate=4e-3,
        batch_size=64,
        gamma=0.5,
        gradient_steps=worlds,
        exploration_std=0.3,
        seed=0,
        policy_kwargs={"net_arch": [32]},
    )
    seen = np.random.default_rng(5).uniform(-1.0, 1.0, (600, 2)).astype(np.float32)

    def mean_reward() -> float:
        with torch.no_grad():
            actions = model.policy.action_mean(torch.from_numpy(seen)).numpy()
        return float(env.earned(seen, actions[:, 0]).mean())

    before = mean_reward()
    model.learn(2 * 3000)
    assert before < -0.2  # 0.64 / 3, as untrained actions are next to 0
    assert mean_reward() > -0.02


class TestFiles:
    def test_a_model_saves_and_loads_with_its_targets_and_its_optimizer(self, tmp_path):
        model = small_maddpg(worlds=2)
        model.learn(4 * 20)
        model.learning_rate_scale = 0.5
        model.save(tmp_path / "model")
        loaded = MADDPG.load(tmp_path / "model", env=make_vec_env(2, **SMALL))
        for name in MADDPG_NETWORKS:
            expected, found = weights(getattr(model.policy, name)), getattr(loaded.policy, name)
            assert torch.equal(weights(found), expected)
        seen = model.env.reset()
        np.testing.assert_array_equal(loaded.predict(seen)[0], model.predict(seen)[0])
        states = [m.policy.optimizer.state_dict()["state"] for m in (model, loaded)]
        assert len(states[0]) == len(list(model.policy.actor.parameters())) * 2
        for index, state in states[0].items():
            assert state["step"] == model._n_updates == 10
            assert all(torch.equal(state[key], states[1][index][key]) for key in state)
        assert loaded.learning_rates == model.learning_rates == (5e-5, 5e-4)
        loaded.learn(2 * 20)
        assert loaded._n_updates > 10
        assert loaded.replay_buffer.size() == 20

    def test_loaded_without_an_environment_it_still_knows_its_agents(self, tmp_path):
        small_maddpg().save(tmp_path / "model")
        model, rows = MADDPG.load(tmp_path / "model"), []
        model.set_env(make_vec_env(1, **SMALL))
        model.learn(3 * 20, callback=EpisodeLog(rows.extend))
        assert [row["episode"] for row in rows] == [1, 2, 3]

    def test_the_policy_alone_saves_and_loads(self, tmp_path):
        policy = small_maddpg().policy
        policy.save(tmp_path / "policy")
        loaded = JointCriticPolicy.load(tmp_path / "policy")
        assert torch.equal(weights(policy), weights(loaded))


class TestOtherEnvironments:
    @NEEDS_SUPERSUIT
    def test_native_and_supersuit_learn_the_same(self):
        native = small_maddpg(worlds=2)
        native.learn(4 * 20)
        through_supersuit = MADDPG(
            "JointCriticPolicy",
            make_supersuit_vec_env(lambda: parallel_env(**SMALL), 2, seed=0),
            batch_size=4,
            buffer_size=1000,
            gradient_steps=2,
            seed=0,
            policy_kwargs={"net_arch": [32, 32]},
        )
        through_supersuit.learn(4 * 20)
        assert torch.equal(weights(native.policy), weights(through_supersuit.policy))

    @NEEDS_SUPERSUIT
    def test_actions_reach_bounds_other_than_plus_and_minus_one(self):
        env = make_supersuit_vec_env(
            lambda: simple_spread_v3.parallel_env(continuous_actions=True), 2, seed=0
        )
        kwargs = {"batch_size": 8, "policy_kwargs": {"net_arch": [16]}, "exploration_std": 3.0}
        model = MADDPG("JointCriticPolicy", env, **kwargs)
        model.learn(2 * 3 * 30)
        assert model.replay_buffer.size() == 60
        assert model._n_updates > 0
        # The box is 0..1: its middle is the policy's zero, and nothing lies outside.
        np.testing.assert_allclose(model.policy.unscale_action(np.zeros(5)), 0.5)
        assert np.abs(model.replay_buffer.arrays[2]).max() == 1.0
        seen = env.reset()
        with torch.no_grad():
            means = model.policy.action_mean(torch.from_numpy(seen["observation"])).numpy()
        np.testing.assert_allclose(model.predict(seen)[0], (means + 1.0) / 2.0, atol=1e-6)
        assert model.replay_buffer.arrays[6].sum() == 0  # 25 cycles are a time limit

    @NEEDS_SUPERSUIT
    def test_refuses_actions_that_are_no_bounded_numbers(self):
        with pytest.raises(TypeError, match="bounded Box"):
            MADDPG("JointCriticPolicy", make_supersuit_vec_env(simple_spread_v3.parallel_env, 1))


def test_surplus_worlds_get_no_updates():
    # Three worlds and four episodes: the last round has one world's transitions, and its updates.
    slots, agents = SMALL["episode_slots"], SMALL["uavs"]
    model = small_maddpg(worlds=3, update_every=2, batch_size=2)
    model.learn(4 * slots * agents)
    assert model._n_updates == (3 + 1) * slots // 2


@pytest.mark.parametrize(
    "keywords", [{"use_sde": True}, {"action_noise": object()}, {"replay_buffer_class": object}]
)
def test_what_would_be_ignored_is_refused(keywords):
    with pytest.raises(ValueError, match=f"{next(iter(keywords))} is not supported"):
        small_maddpg(**keywords)


def test_no_replay_buffer_is_pickled(tmp_path):
    model = small_maddpg()
    with pytest.raises(NotImplementedError):
        model.save_replay_buffer(tmp_path / "replay.pkl")
    with pytest.raises(NotImplementedError):
        model.load_replay_buffer(tmp_path / "replay.pkl")
    assert not list(tmp_path.iterdir())
