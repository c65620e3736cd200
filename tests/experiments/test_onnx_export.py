"""``orchid export``: the file is valid, flies as the policy does, and appears whole or not."""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from orchid_uav import envs
from orchid_uav.agents.deployed_actor import LocalActor, policy_files
from orchid_uav.envs import WorldBatch, parallel_env
from orchid_uav.envs.interfaces.spaces import observation_space
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.evaluation.methods import read_released
from orchid_uav.experiments.exporting import onnx_file
from orchid_uav.experiments.exporting.graph import actor_graph
from orchid_uav.experiments.exporting.parity import check_parity
from orchid_uav.extras import install_command
from tests.helpers.processes import assert_is_an_error
from tests.helpers.run_directories import begin_run, make_run

EXAMPLE = Path(__file__).parents[2] / "examples" / "fly_onnx.py"
KINDS = ("orchid", "orchid-informed", "orchid-distilled", "maddpg-mmf-paper")
"""Released policies of each observation, flight and algorithm."""


def session_of(model: bytes | Path) -> onnxruntime.InferenceSession:
    source = str(model) if isinstance(model, Path) else model
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


def actions_of(session: onnxruntime.InferenceSession, observations: np.ndarray) -> np.ndarray:
    return session.run(["action"], {"observation": observations})[0]


def graph_of(policy) -> bytes:
    return actor_graph(policy.actor, policy.run, "0", onnx_file.metadata(policy))


def exact(policy, observations: np.ndarray) -> np.ndarray:
    """Actions in double precision, by torch instead of NumPy."""
    hidden = torch.from_numpy(observations).double()
    *inner, last = [
        (torch.from_numpy(np.ascontiguousarray(weight)).double(), torch.from_numpy(bias).double())
        for weight, bias in policy.actor.layers
    ]
    for weight, bias in inner:
        hidden = torch.relu(hidden @ weight.T + bias)
    return torch.tanh(hidden @ last[0].T + last[1]).numpy()


@pytest.fixture(scope="module", params=KINDS)
def kind(request):
    """A policy, and a session of its file."""
    policy = read_released(request.param)
    return policy, session_of(graph_of(policy))


@pytest.fixture
def small_run(tmp_path):
    """The id of a run of random weights, in the default directory for runs."""
    path = make_run(tmp_path / "runs", "small")
    generator = np.random.default_rng(5)
    layers = [
        (generator.normal(0, 0.3, (o, i)).astype(np.float32), np.ones(o, np.float32) / 8)
        for i, o in ((16, 8), (8, 4))
    ]
    for name, content in policy_files(layers, np.zeros(4, np.float32), {"run": path.name}).items():
        (path / name).write_bytes(content)
    return path.name


@pytest.fixture
def written(orchid, small_run, tmp_path, monkeypatch):
    """Calls export to a file in an empty directory, and give its model."""
    monkeypatch.chdir(tmp_path)

    def export(run=small_run, name="actor.onnx", *options):
        finished = orchid("export", run, "--onnx", name, *options)
        assert finished.code == 0, finished.err
        return onnx.load(tmp_path / name)

    return export


class TestParity:
    def test_within_1e_5_on_10_000_observations_in_flight(self, kind):
        policy, session = kind
        parameters = policy.config.network_parameters.with_overrides({"network.user_count": 20})
        world = WorldBatch(parameters, worlds=17, seed=3)
        world.reset()
        seen = []
        for _ in range(100):
            observations = world.observations().reshape(17 * 6, -1)
            seen.append(observations.copy())
            world.step(policy.actor.act(observations).reshape(17, 6, 4))
        flown = np.concatenate(seen)
        assert len(flown) >= 10_000
        difference = np.abs(actions_of(session, flown) - policy.actor.act(flown)).max()
        assert difference <= 1e-5

    def test_at_the_ends_of_what_can_be_observed_only_rounding_is_left(self, kind):
        policy, session = kind
        space = observation_space(policy.config.network_parameters)
        ends = np.random.default_rng(1).integers(0, 2, (10_000, *space.shape))
        seen = np.where(ends, space.high, space.low).astype(np.float32)
        true, own = exact(policy, seen), policy.actor.act(seen)
        rounding = np.abs(own - true).max()
        assert rounding < 1e-4
        assert np.abs(actions_of(session, seen) - own).max() <= max(1e-5, 2 * rounding)

    @pytest.mark.parametrize("batch", [1, 7, 1000])
    def test_of_any_number_of_uavs_at_once(self, kind, batch):
        policy, session = kind
        seen = np.random.default_rng(2).uniform(-1, 1, (batch, policy.actor.observation_size))
        seen = seen.astype(np.float32)
        actions = actions_of(session, seen)
        assert actions.shape == (batch, 4) and actions.dtype == np.float32
        np.testing.assert_allclose(actions, policy.actor.act(seen), atol=1e-5)

    def test_actions_never_leave_their_range(self, kind):
        policy, session = kind
        seen = np.random.default_rng(4).normal(0, 1, (1000, policy.actor.observation_size))
        for scale in (1e2, 1e6, 1e30):
            actions = actions_of(session, (seen * scale).astype(np.float32))
            assert np.abs(actions).max() <= 1.0

    def test_the_check_finds_another_policy_and_a_changed_weight(self):
        policy, other = read_released("orchid"), read_released("orchid-no-rf")
        space = observation_space(policy.config.network_parameters)
        assert check_parity(graph_of(policy), policy.actor, space.low, space.high)
        with pytest.raises(RunFailedError, match="flies otherwise than the policy"):
            check_parity(graph_of(other), policy.actor, space.low, space.high)
        model = onnx.load_from_string(graph_of(policy))
        bias = next(one for one in model.graph.initializer if one.name == "layer_3.bias")
        changed = onnx.numpy_helper.to_array(bias) + np.float32(1e-4)
        bias.CopyFrom(onnx.numpy_helper.from_array(changed, bias.name))
        with pytest.raises(RunFailedError, match=r"differ by up to 1\.0e-04, more than 1e-05"):
            check_parity(model.SerializeToString(), policy.actor, space.low, space.high)

    def test_the_check_forgives_rounding_of_large_weights_and_says_so(self, small_run):
        generator = np.random.default_rng(6)
        sizes = ((16, 64), (64, 64), (64, 4))
        layers = [
            (generator.normal(0, 3, (o, i)).astype(np.float32), np.zeros(o, np.float32))
            for i, o in sizes
        ]
        actor = LocalActor(layers, np.zeros(4, np.float32))
        model = actor_graph(actor, "large", "0", {})
        parity = check_parity(model, actor, *np.array([[-4.0] * 16, [4.0] * 16], np.float32))
        assert 1e-5 < parity.largest_difference <= 2 * parity.rounding < 1e-2


class TestFile:
    def test_it_is_valid_and_old_runtimes_read_it(self, written):
        model = written()
        onnx.checker.check_model(model, full_check=True)
        assert [(one.domain, one.version) for one in model.opset_import] == [("", 11)]
        assert model.ir_version == 6  # onnxruntime 1.0 reads both
        for end, name, size in (
            (model.graph.input, "observation", 16),
            (model.graph.output, "action", 4),
        ):
            (one,) = end
            batch, numbers = one.type.tensor_type.shape.dim
            assert (one.name, batch.dim_param, numbers.dim_value) == (name, "batch", size)
            assert one.type.tensor_type.elem_type == onnx.TensorProto.FLOAT

    def test_it_says_what_it_is(self, written):
        written("orchid-distilled")
        told = session_of(Path("actor.onnx")).get_modelmeta().custom_metadata_map
        policy = read_released("orchid-distilled")
        assert told["run"] == policy.run and told["sha256"] == policy.actor.description.sha256
        assert (told["observation"], told["flight"]) == ("informed", "station")
        assert (told["algorithm"], told["opset"], told["episodes"]) == ("dagger", "11", "400")
        assert len(json.loads(told["observation_names"])) == 98
        assert len(json.loads(told["action_names"])) == 4
        settings = json.loads(told["settings"])
        assert settings["deployment.init"] == policy.config.deployment.init
        assert settings["uav.station.speed_limit_mps"] == 8.0
        # An environment of these settings is one that it was made for.
        env = parallel_env(**settings)
        assert env.observation_space("uav_0").shape == (98,)
        assert env.parameters.uav == policy.config.uav

    def test_json_tells_what_was_written_and_compared(self, orchid, tmp_path):
        finished = orchid("export", "orchid-informed", "--onnx", tmp_path / "actor.onnx", "--json")
        document = json.loads(finished.out)
        assert (finished.code, finished.err) == (0, "")
        assert document["run"] == read_released("orchid-informed").run
        assert document["bytes"] == (tmp_path / "actor.onnx").stat().st_size
        shape = ["batch", 98]
        assert document["input"] == {"name": "observation", "shape": shape, "type": "float32"}
        assert document["output"]["shape"] == ["batch", 4]
        assert document["parity"]["runtime"] == onnxruntime.__version__
        assert document["parity"]["observations"] == 10_000
        assert 0 < document["parity"]["largest_difference"] <= 1e-5

    @pytest.mark.parametrize(
        "name", ["a b.onnx", "[red]x", "-x.onnx", "ü 无人机.onnx", "x\n\x1b[31m"]
    )
    def test_names_are_taken_as_they_are(self, orchid, small_run, tmp_path, monkeypatch, name):
        if sys.platform == "win32" and not name.isprintable():
            pytest.skip("Windows allows no such names")
        monkeypatch.chdir(tmp_path)
        finished = orchid("export", small_run, f"--onnx={name}")
        assert finished.code == 0, finished.err
        assert {path.name for path in tmp_path.iterdir()} == {"runs", name}
        assert "\x1b" not in finished.out and len(finished.out.splitlines()) == 2

    def test_a_trained_run_is_exported(self, orchid, runs_dir, tmp_path, new_runs):
        settings = ("network.episode_slots=10", "ppo.hidden_sizes=[8]", "uav.max_altitude_m=150")
        options = [f"--set={one}" for one in settings]
        assert orchid("train", "--episodes=1", *options, "--runs-dir", runs_dir).code == 0
        (run,) = new_runs()
        target = tmp_path / "own.onnx"
        finished = orchid("export", run.name[:20], "--onnx", target, "--runs-dir", runs_dir)
        assert finished.code == 0, finished.err
        told = session_of(target).get_modelmeta().custom_metadata_map
        assert told["run"] == run.name
        assert json.loads(told["settings"])["uav.max_altitude_m"] == 150.0


class TestRefusals:
    @pytest.fixture
    def refused(self, orchid, tmp_path, monkeypatch):
        """Calls that fail, and leave nothing but what was there."""
        monkeypatch.chdir(tmp_path)

        def check(run, name, *parts, code=2):
            before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
            finished = orchid("export", run, f"--onnx={name}")
            assert_is_an_error(finished, *parts, code=code)
            assert before == {
                path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()
            }

        return check

    def test_a_file_that_exists_stays_without_force(self, refused, small_run, written):
        Path("mine").write_text("important")
        refused(small_run, "mine", "mine exists", "--force")
        written(small_run, "mine", "--force")

    def test_places_where_no_file_can_be(self, refused, small_run):
        Path("folder").mkdir()
        Path("file").touch()
        refused(small_run, "folder", "folder is a directory", str(Path("folder/actor.onnx")))
        refused(small_run, "nowhere/x.onnx", "cannot write", "there is no directory nowhere")
        refused(small_run, "file/x.onnx", "cannot write")

    def test_names_that_are_neither_a_run_nor_a_policy(self, refused):
        refused(
            "orchid-destilled", "x.onnx", "orchid-destilled", "did you mean 'orchid-distilled'?"
        )
        Path("runs").mkdir()
        refused("20261122T2112", "x.onnx", "no run '20261122T2112' in runs")

    def test_runs_without_a_policy(self, refused, tmp_path):
        runs = tmp_path / "runs"
        live = begin_run(runs)
        refused(live.path.name, "x.onnx", "is still running")
        live.release()
        refused(live.path.name, "x.onnx", "died: only a run that ended has a policy")
        broken = make_run(runs, "broken")  # whose policy is none
        refused(broken.name, "x.onnx", "cannot be flown", "policy.json")
        (broken / "policy.safetensors").unlink()
        refused(broken.name, "x.onnx", "no such file", "policy.safetensors")

    def test_without_onnx_it_says_what_installs_it(self, refused, small_run, monkeypatch):
        monkeypatch.setitem(sys.modules, "onnx", None)
        refused(small_run, "x.onnx", "onnx cannot be imported", install_command("onnx"))

    def test_without_onnxruntime_it_says_what_was_not_checked(
        self, orchid, small_run, tmp_path, monkeypatch
    ):
        monkeypatch.setitem(sys.modules, "onnxruntime", None)
        finished = orchid(
            "export", tmp_path / "runs" / small_run, "--onnx", tmp_path / "x", "--json"
        )
        assert finished.code == 0
        assert json.loads(finished.out)["parity"] is None
        assert "checked by onnx.checker alone" in finished.err

    def test_a_file_that_flies_otherwise_never_appears(self, refused, monkeypatch):
        other = graph_of(read_released("orchid-no-rf"))
        monkeypatch.setattr(onnx_file, "actor_graph", lambda *arguments: other)
        refused("orchid", "x.onnx", "flies otherwise than the policy", code=1)


class TestExample:
    def test_it_is_short_and_says_how_it_is_run(self):
        text = EXAMPLE.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 40
        assert "python examples/fly_onnx.py actor.onnx" in text

    def test_it_flies_the_policy_beside_the_zero_action(
        self, written, small_run, monkeypatch, capsys
    ):
        written()

        def small(**keywords):
            few = {"uavs": 2, "users": 20, "network.episode_slots": 10}
            return parallel_env(**keywords | few)

        monkeypatch.setattr(envs, "parallel_env", small)
        monkeypatch.setattr(sys, "argv", [str(EXAMPLE), "actor.onnx"])
        runpy.run_path(str(EXAMPLE))
        lines = capsys.readouterr().out.splitlines()
        policy, rewards = onnx_file.find_policy(small_run, Path("runs")), []
        assert lines[0] == f"{policy.run}, beside zero, means of 5 topologies"
        env = small(speed_mps=5.0, objective="mmf")
        for seed in range(5):
            observations, _ = env.reset(seed=seed)
            while env.agents:
                actions = policy.actor.act([*observations.values()])
                observations, *_, infos = env.step(dict(zip(env.agents, actions, strict=True)))
            rewards.append(infos["uav_0"]["episode_metrics"]["reward"])
        reward = next(line for line in lines if line.startswith("reward"))
        _, learned, still = reward.split()
        assert float(learned) == pytest.approx(np.mean(rewards), rel=1e-4)
        assert float(still) != float(learned)
