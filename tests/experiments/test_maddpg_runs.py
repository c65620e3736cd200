"""MADDPG by configuration: what is built, Reset-and-Finetune, and run directories."""

import json
import math

import numpy as np
import pytest
import torch

from orchid_uav.agents import MADDPG, load_policy
from orchid_uav.callbacks import EpisodeLog, ProgressSchedules, ResetAndFinetune
from orchid_uav.envs import make_vec_env
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.experiments.configuration import Layer, RunConfig, file_layer, merge
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.training import loop as training
from tests.helpers.learners import small_maddpg
from tests.helpers.processes import (
    COLUMNS,
    TINY_FLAGS,
    assert_is_an_error,
    cells,
    columns,
    files_of,
    record_of,
)

EAGER = {"window": 2, "tolerance_jfi": 1e9, "tolerance_reward": 1e9}


def test_reset_and_finetune_clears_adam_and_lowers_both_rates():
    model, rows, callback = small_maddpg(), [], ResetAndFinetune(**EAGER)
    steps = []

    def take(new) -> None:
        rows.extend(new)
        steps.append({int(state["step"]) for state in model.policy.optimizer.state.values()})

    log = EpisodeLog(take, callback)
    model.learn(6 * 20, callback=[callback, log, ProgressSchedules(6, None)])
    assert callback.reset_episodes == [4]
    assert [row["actor_lr"] for row in rows] == [1e-4] * 3 + [5e-5] * 3
    assert [row["critic_lr"] for row in rows] == [1e-3] * 3 + [5e-4] * 3
    # Ten slots an episode, an update every four of all slots: the third ends in the eighth's.
    assert steps == [{3}, {5}, {8}, set(), {3}, {5}]
    assert [group["lr"] for group in model.policy.optimizer.param_groups] == [5e-5, 5e-4]
    assert model.replay_buffer.size() == 60
    assert [row["entropy_coef"] for row in rows] == [0.0] * 6


UNUSUAL = {
    "actor_learning_rate": 2e-4,
    "critic_learning_rate": 3e-3,
    "discount": 0.91,
    "batch_size": 33,
    "buffer_size": 444,
    "target_rate": 0.02,
    "exploration_std": 0.3,
    "update_every_slots": 7,
    "preactivation_penalty": 0.004,
    "max_grad_norm": 0.6,
    "hidden_sizes": [8, 9],
    "adam_epsilon": 1e-6,
}


class TestConfiguration:
    def built(self, **sections) -> MADDPG:
        config = RunConfig.model_validate(
            sections | {"training": {"algorithm": "maddpg", "worlds": 2, "seed": 3}}
        )
        return training.build_model(config, FleetVecEnv(config.network_parameters, 2))

    def test_every_number_is_used(self):
        model = self.built(maddpg=UNUSUAL, network={"episode_slots": 17})
        assert set(UNUSUAL) == set(type(RunConfig().maddpg).model_fields)
        assert model.learning_rates == (2e-4, 3e-3)
        assert (model.gamma, model.batch_size, model.buffer_size) == (0.91, 33, 444)
        assert len(model.replay_buffer.arrays[0]) == 444
        assert (model.tau, model.exploration_std, model.max_grad_norm) == (0.02, 0.3, 0.6)
        assert (model.train_freq.frequency, model.train_freq.unit.value) == (7, "step")
        assert model.preactivation_penalty == 0.004
        assert (model.gradient_steps, model.episode_steps, model.seed) == (2, 17, 3)
        assert [len(bias) for _, bias in model.policy.actor_layers()] == [8, 9, 4]
        groups = model.policy.optimizer.param_groups
        assert all(group["eps"] == 1e-6 and group["fused"] for group in groups)

    def test_what_the_class_begins_with_is_the_same_and_as_decided(self):
        by_hand, configured = MADDPG("JointCriticPolicy", make_vec_env(2)), self.built()
        for name in ("learning_rates", "batch_size", "buffer_size", "tau", "gamma", "train_freq"):
            assert getattr(by_hand, name) == getattr(configured, name), name
        for name in ("exploration_std", "max_grad_norm", "preactivation_penalty"):
            assert getattr(by_hand, name) == getattr(configured, name), name
        assert by_hand.policy.optimizer.defaults == configured.policy.optimizer.defaults
        shapes = [[p.shape for p in m.policy.parameters()] for m in (by_hand, configured)]
        assert shapes[0] == shapes[1]
        assert (by_hand.buffer_size, by_hand.tau, by_hand.exploration_std) == (100_000, 0.01, 0.1)
        assert (by_hand.batch_size, by_hand.train_freq.frequency) == (128, 4)
        assert by_hand.learning_rates == (1e-4, 1e-3)

    def test_reset_and_finetune_is_off_unless_it_is_asked_for(self, orchid, tmp_path):
        file = tmp_path / "lab.toml"
        file.write_text('[training]\nalgorithm = "maddpg"\n[reset]\nenabled = true\n')
        for arguments, value, source in (
            ([], "true", "default"),
            (["--algorithm=mappo"], "true", "default"),
            (["--algorithm=maddpg"], "false", "algorithm maddpg"),
            (["--set=training.algorithm=maddpg"], "false", "algorithm maddpg"),
            (["--algorithm=maddpg", "--set=reset.enabled=true"], "true", "--set"),
            (["--algorithm=maddpg", "--no-rf"], "false", "--no-rf"),
            (["--config", file], "true", str(file)),
            (["--config", file, "--no-rf"], "false", "--no-rf"),
        ):
            lines = orchid("config", "show", *arguments).out.splitlines()
            assert f"reset.enabled\t{value}\t\ttrue, false\t{source}" in lines, arguments

    def test_the_algorithm_that_counts_is_the_last_one_named(self, tmp_path):
        file = tmp_path / "lab.json"
        file.write_text('{"training": {"algorithm": "maddpg"}}')
        layers = [file_layer(file), Layer("--algorithm", {"training.algorithm": "mappo"})]
        assert merge(layers)[0] == RunConfig()
        assert not merge(layers[:1])[0].reset.enabled

    @pytest.mark.parametrize("wrong", ["madpg", 3, None, ["maddpg"]])
    def test_an_algorithm_that_is_none_is_an_error(self, wrong):
        with pytest.raises(InputError, match=r"training\.algorithm"):
            merge([Layer("--set", {"training.algorithm": wrong})])

    def test_a_buffer_of_one_batch_is_enough(self):
        sizes = {"maddpg.buffer_size": 8, "maddpg.batch_size": 8}
        assert merge([Layer("--set", sizes)])[0].maddpg.buffer_size == 8
        model = small_maddpg(buffer_size=8, batch_size=8)
        model.learn(2 * 20)
        assert model._n_updates == 4  # after eight slots of twenty, and every four from there

    @pytest.mark.parametrize(
        ("assignments", "parts"),
        [
            (["maddpg.buffer_size=100"], ["100", "batch_size", "128"]),
            (["maddpg.batch_size=1"], ["maddpg.batch_size", "1"]),
            (["maddpg.target_rate=0"], ["maddpg.target_rate", "0"]),
            (["maddpg.target_rate=1.5"], ["maddpg.target_rate", "1.5"]),
            (["maddpg.exploration_std=-0.1"], ["maddpg.exploration_std", "-0.1"]),
            (["maddpg.update_every_slots=0"], ["maddpg.update_every_slots", "0"]),
        ],
    )
    def test_wrong_numbers_are_named(self, orchid, assignments, parts):
        arguments = [f"--set={assignment}" for assignment in assignments]
        assert_is_an_error(orchid("train", "--algorithm=maddpg", *arguments), *parts)


class TestRun:
    FLAGS = (*TINY_FLAGS, "--algorithm=maddpg", "--quiet", "--set=maddpg.hidden_sizes=[16,16]")

    @pytest.fixture
    def run(self, orchid, runs_dir, new_runs):
        def make(*arguments):
            there_before = set(new_runs())
            finished = orchid("train", *self.FLAGS, "--runs-dir", runs_dir, *arguments)
            assert (finished.code, finished.err) == (0, "")
            [made] = set(new_runs()) - there_before
            return made

        return make

    def test_directory_is_complete_and_its_policy_flies(self, run):
        path = run("--episodes=5", "--set=maddpg.batch_size=8", "--worlds=2")
        assert files_of(path) == {
            *("run.json", "config.json", "episodes.csv", "policy.safetensors", "policy.json"),
            *("events.out.tfevents", "checkpoints", ".lock"),
        }
        assert (record_of(path)["status"], record_of(path)["episodes"]) == ("completed", 5)
        assert cells(path)[0] == COLUMNS
        logged = columns(path)
        assert logged["episode"] == [1, 2, 3, 4, 5]
        assert logged["entropy_coef"] == logged["reset"] == [0] * 5
        assert (logged["actor_lr"], logged["critic_lr"]) == ([1e-4] * 5, [1e-3] * 5)
        policy = load_policy(path)
        assert policy.description.algorithm == "maddpg"
        np.testing.assert_allclose(policy.log_std, np.full(4, math.log(0.1)), rtol=1e-6)
        actions = policy.act(np.random.default_rng(0).random((7, 16), dtype=np.float32))
        assert actions.shape == (7, 4)
        assert np.abs(actions).max() <= 1.0

    def test_policy_is_the_learners(self, run, monkeypatch):
        made, build = [], training.build_model
        monkeypatch.setattr(
            training, "build_model", lambda *given: made.append(build(*given)) or made[-1]
        )
        path = run("--episodes=4", "--set=maddpg.batch_size=8")
        [model] = made
        assert model._n_updates == 9  # forty slots, and eight before the first
        seen = np.random.default_rng(0).random((5, 16), dtype=np.float32)
        with torch.no_grad():
            expected = model.policy.action_mean(torch.from_numpy(seen)).numpy()
        np.testing.assert_allclose(load_policy(path).act(seen), expected, rtol=1e-5, atol=1e-6)

    def test_the_same_seed_gives_the_same_bits_and_so_does_its_configuration(self, run):
        flags = ("--episodes=4", "--set=maddpg.batch_size=8")
        first = run(*flags, "--seed=1")
        again, other = run(*flags, "--seed=1"), run(*flags, "--seed=2")
        by_file = run("--config", first / "config.json")
        for name in ("episodes.csv", "policy.safetensors"):
            content = (first / name).read_bytes()
            assert content == (again / name).read_bytes() == (by_file / name).read_bytes()
            assert content != (other / name).read_bytes()
        assert json.loads((first / "config.json").read_text())["reset"]["enabled"] is False

    def test_reset_and_finetune_acts_where_it_is_asked_for(self, run):
        flags = [f"--set=reset.{key}={value}" for key, value in EAGER.items()]
        path = run("--episodes=6", "--set=reset.enabled=true", "--kappa=0.1", *flags)
        assert record_of(path)["reset_episodes"] == [4]
        assert columns(path)["critic_lr"] == pytest.approx([1e-3] * 3 + [1e-4] * 3)
