"""DAgger by configuration: what every command of runs does with a learner that is not SB3's."""

import json
import shutil

import pytest

from orchid_uav.experiments.ablation.calibration import seconds_per_episode
from orchid_uav.experiments.runs.records import has_checkpoint
from orchid_uav.experiments.training import imitation
from tests.helpers.processes import cells, tiny_config

SMALL = {
    "training.algorithm": "dagger",
    "reset.enabled": False,
    "uav.flight": "station",
    "uav.observation": "informed",
    "network.episode_slots": 10,
    "dagger.hidden_sizes": [8],
    "dagger.batch_size": 16,
    "dagger.gradient_steps": 3,
}
FLAGS = [f"--set={key}={json.dumps(value)}" for key, value in SMALL.items()]


@pytest.fixture
def run(orchid, new_runs, runs_dir):
    """A run of two iterations."""
    finished = orchid("train", *FLAGS, "--quiet", "--episodes=2", "--runs-dir", runs_dir)
    assert finished.code == 0, finished.err
    [made] = new_runs()
    return made


def test_a_run_is_shown_compared_and_listed(orchid, run):
    copy = run.with_name(run.name.replace("orchid", "copy"))
    for command in (("show", run), ("compare", run, copy)):
        if not copy.exists():
            shutil.copytree(run, copy)
        finished = orchid("runs", *command, "--runs-dir", run.parent)
        assert (finished.code, finished.err) == (0, "")
        assert "rate JFI" in finished.out
        assert "uav.station" not in finished.out  # nothing of it was changed
    listed = orchid("runs", "list", "--runs-dir", run.parent, "--json")
    assert listed.code == 0 and '"dagger"' in listed.out


def test_a_run_goes_on_elsewhere_from_its_checkpoint_and_its_examples(orchid, run, tmp_path):
    here, there = run.parent, tmp_path / "there"
    archive = tmp_path / "run.zip"
    exported = orchid(
        *("runs", "export", run, "--checkpoints", "--runs-dir", here, "--out", archive)
    )
    assert (exported.code, exported.err) == (0, "")
    assert orchid("runs", "import", archive, "--runs-dir", there).code == 0
    for folder in (here, there):
        more = ("train", "--resume", run.name, "--episodes=4", "--quiet", "--runs-dir", folder)
        assert orchid(*more).code == 0
    assert cells(there / run.name) == cells(run)
    for name in ("policy.safetensors", "checkpoints/examples/4.safetensors"):
        assert (there / run.name / name).read_bytes() == (run / name).read_bytes()


def test_examples_alone_are_no_checkpoint(run):
    assert has_checkpoint(run)
    shutil.rmtree(run / "checkpoints" / "2")
    assert (run / "checkpoints" / "examples" / "2.safetensors").exists()
    assert not has_checkpoint(run)


def test_what_it_draws_itself_is_no_setting_of_its_training(orchid, runs_dir):
    finished = orchid(
        *("train", *FLAGS, "--episodes=1", "--uavs=8", "--runs-dir", runs_dir),
        *('--set=network.failures=["5@5"]', "--set=training.center_rewards=false"),
    )
    assert finished.code == 0
    told = " ".join(finished.err.split())
    assert "without effect on the training: --uavs, network.failures (DAgger draws" in told
    assert "without effect on the training: training.center_rewards (DAgger learns" in told
    assert "uav.flight" not in told


def test_the_time_that_is_measured_is_its_own(monkeypatch):
    iterations = []

    class Watched(imitation.Dagger):
        def iterate(self, folder=None):
            iterations.append(folder)
            return super().iterate(folder)

    monkeypatch.setattr(imitation, "Dagger", Watched)
    values = {key.replace(".", "__"): value for key, value in SMALL.items()}
    assert seconds_per_episode(tiny_config(**values)) > 0.0
    assert iterations == [None] * 3
