"""The deployed actor: same actions as in training, any number of UAVs, files that are checked."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load, save

from orchid_uav.agents import LocalActor, load_policy
from orchid_uav.agents.deployed_actor import policy_files
from tests.helpers.damage import reseal
from tests.helpers.learners import small_model


@pytest.fixture(scope="module")
def model():
    made = small_model()
    made.learn(60)
    return made


@pytest.fixture
def saved(model, tmp_path) -> Path:
    layers, log_std = model.policy.actor_layers(), model.policy.log_std.detach().numpy()
    for name, content in policy_files(layers, log_std, {"run": "here"}).items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


def observations(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(0, 1, (count, 16)).astype(np.float32)


def test_acts_as_the_policy_does_deterministically(model, saved):
    seen = observations(64)
    expected = model.policy.action_mean(torch.from_numpy(seen)).detach().numpy()
    np.testing.assert_allclose(load_policy(saved).act(seen), expected, atol=1e-6)


@pytest.mark.parametrize("uavs", [1, 4, 10])
def test_flies_any_number_of_uavs(saved, uavs):
    actor = load_policy(saved / "policy.safetensors")
    actions = actor.act(observations(uavs))
    assert actions.shape == (uavs, 4) and actions.dtype == np.float32
    assert np.abs(actions).max() <= 1.0
    # Decentralised: a UAV's action does not depend on who flies beside it.
    np.testing.assert_allclose(actor.act(observations(uavs)[:1]), actions[:1], atol=1e-6)


def test_needs_neither_torch_nor_sb3(saved):
    code = (
        "import sys, json, numpy; from orchid_uav.agents import load_policy;"
        f"load_policy({str(saved)!r}).act(numpy.zeros((2, 16), numpy.float32));"
        "print(json.dumps([m for m in ('torch', 'stable_baselines3') if m in sys.modules]))"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert json.loads(finished.stdout) == []


def test_says_what_it_is(saved):
    actor = load_policy(saved)
    assert actor.description.run == "here"
    assert actor.description.layer_sizes == [16, 32, 32, 4]
    assert (actor.observation_size, actor.action_size) == (16, 4)
    assert actor.log_std.shape == (4,)


@pytest.mark.parametrize(
    ("seen", "message"),
    [
        (np.zeros((3, 15)), "shape"),
        (np.zeros(16), "shape"),
        (np.full((1, 16), np.nan), "finite"),
    ],
)
def test_refuses_what_is_no_observation(saved, seen, message):
    with pytest.raises(ValueError, match=message):
        load_policy(saved).act(seen)


class TestDamage:
    def rewrite(self, saved: Path, **changes: object) -> None:
        reseal(saved / "policy.json", **changes)

    def test_missing_files(self, saved, tmp_path):
        with pytest.raises(FileNotFoundError, match="nowhere"):
            load_policy(tmp_path / "nowhere")
        (saved / "policy.json").unlink()
        with pytest.raises(FileNotFoundError, match=r"policy\.json"):
            load_policy(saved)

    def test_any_flipped_byte_is_noticed(self, saved):
        path = saved / "policy.safetensors"
        content = bytearray(path.read_bytes())
        for position in (0, 20, len(content) // 2, len(content) - 1):
            damaged = content.copy()
            damaged[position] ^= 1
            path.write_bytes(damaged)
            with pytest.raises(ValueError, match="sha256"):
                load_policy(saved)

    def test_weights_of_other_shapes_or_not_finite(self, saved):
        import hashlib

        tensors = load((saved / "policy.safetensors").read_bytes())
        for change, message in (
            ({"actor.0.bias": np.zeros(31, np.float32)}, "shape"),
            ({"actor.0.bias": np.zeros(32, np.float64)}, "F64"),
            ({"extra": np.zeros(1, np.float32)}, "other tensors"),
            ({"log_std": np.full(4, np.nan, np.float32)}, "finite"),
        ):
            content = save({**tensors, **change})
            (saved / "policy.safetensors").write_bytes(content)
            self.rewrite(saved, sha256=hashlib.sha256(content).hexdigest())
            with pytest.raises(ValueError, match=message):
                load_policy(saved)

    @pytest.mark.parametrize(
        "changes",
        [
            {"schema": 2},
            {"hidden_activation": "gelu"},
            {"layer_sizes": [16]},
            {"layer_sizes": [16, 10**12, 4]},
            {"layer_sizes": "16"},
        ],
    )
    def test_descriptions_of_something_else(self, saved, changes):
        self.rewrite(saved, **changes)
        with pytest.raises(ValueError, match=r"policy\.json"):
            load_policy(saved)

    def test_a_description_that_is_no_json(self, saved):
        (saved / "policy.json").write_text("{")
        with pytest.raises(ValueError, match=r"policy\.json is not valid JSON"):
            load_policy(saved)


def test_layers_are_applied_in_order_by_hand():
    one = (np.array([[2.0], [-1.0]], np.float32), np.array([0.0, 1.0], np.float32))
    two = (np.array([[1.0, 0.5]], np.float32), np.array([-1.0], np.float32))
    actor = LocalActor([one, two], np.zeros(1, np.float32))
    # x = 1: relu(2, 0) -> 2 + 0 - 1 = 1; x = -1: relu(-2, 2) -> 0 + 1 - 1 = 0.
    np.testing.assert_allclose(actor.act([[1.0], [-1.0]]), np.tanh([[1.0], [0.0]]), rtol=1e-6)
