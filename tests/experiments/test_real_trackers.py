"""Runs in a real MLflow, trackio and W&B, read back by their own means: ``make test-trackers``."""

import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training import tracker_process
from tests.helpers.processes import columns, record_of
from tests.helpers.run_directories import COMMAND, POLICY, begin_export, begun, end_export, rows

mlflow = pytest.importorskip("mlflow", reason="make test-trackers installs it")
EPISODES, AT_ONCE, PATIENCE_S = 30, 8, 300.0


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """On a busy machine the few seconds in the end may not be enough for eight at once."""
    monkeypatch.setattr(tracker_process, "_SECONDS_AT_THE_END", PATIENCE_S)
    monkeypatch.setattr(tracker_process, "_SECONDS_WITHOUT_A_WORD", PATIENCE_S)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The address of an MLflow server of this test."""
    folder = tmp_path_factory.mktemp("server")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [
        *(sys.executable, "-m", "mlflow", "server", "--host=127.0.0.1", f"--port={port}"),
        *("--workers=1", f"--backend-store-uri=sqlite:///{folder / 'server.db'}"),
        f"--artifacts-destination={folder / 'artifacts'}",
    ]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            command, cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
    url, deadline = f"http://127.0.0.1:{port}", time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        try:
            urllib.request.urlopen(f"{url}/health", timeout=5).close()
            break
        except OSError:
            assert process.poll() is None, (folder / "log").read_text()
            time.sleep(0.2)
    yield url
    os.killpg(process.pid, signal.SIGTERM)
    process.wait(PATIENCE_S)


def mlflow_run(uri: str, run_id: str):
    """The only MLflow run of a run, and a client."""
    client = mlflow.MlflowClient(uri)
    experiment = client.get_experiment_by_name("orchid")
    (run,) = client.search_runs([experiment.experiment_id], f"tags.`orchid.run` = '{run_id}'")
    return client, run


def check_whole(uri: str, path: Path, folder: Path) -> None:
    """Everything of a run is in MLflow, once."""
    client, run = mlflow_run(uri, path.name)
    record = record_of(path)
    assert run.info.status == "FINISHED" and run.info.run_name == path.name
    expected = [(n, pytest.approx(one)) for n, one in enumerate(columns(path)["reward"], 1)]
    history = client.get_metric_history(run.info.run_id, "episode/reward")
    assert [(one.step, one.value) for one in history] == expected
    for column in ("reward", "rate_jfi"):
        assert run.data.metrics[f"final/{column}"] == pytest.approx(record["final"][column])
    assert run.data.params["network.uav_count"] == "2"
    folder.mkdir()
    kept = Path(client.download_artifacts(run.info.run_id, "", str(folder)))
    names = {"run.json", "config.json", "episodes.csv", *POLICY}
    assert {one.name for one in kept.iterdir()} == names
    for name in names:
        assert (kept / name).read_bytes() == (path / name).read_bytes()


@pytest.mark.parametrize("where", ["server", "database"])
def test_eight_runs_at_once(server, tmp_path, monkeypatch, capfd, where):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    if where == "server":
        uri = server
        monkeypatch.setenv("MLFLOW_TRACKING_URI", uri)
    runs = [begun(tmp_path, "lab", training__seed=seed) for seed in range(AT_ONCE)]
    trackers = [begin_export("mlflow", *run) for run in runs]
    for number, ((run, _), tracker) in enumerate(zip(runs, trackers, strict=True)):
        end_export(tracker, run, "completed", rows(EPISODES, reward=float(number)), waits=False)
    for tracker in trackers:
        tracker.close("completed")
    assert "warning" not in capfd.readouterr().err
    for number, (run, _) in enumerate(runs):
        check_whole(uri, run.path, tmp_path / f"kept {number}")


def test_a_run_that_goes_on_continues_its_mlflow_run(server, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", server)
    run, config = begun(tmp_path, "long", episodes=6)
    end_export(begin_export("mlflow", run, config), run, "failed", rows(4))
    _, there = mlflow_run(server, run.path.name)
    assert there.info.status == "FAILED"
    longer = config.extended_to(9)
    run = RunDirectory.reopen(run.path, longer, COMMAND)
    # The checkpoint was of episode 3: the fourth is flown again, with the same numbers.
    tracker = begin_export("mlflow", run, longer)
    tracker.resume(3)
    tracker.log(4, {"episode/reward": rows(4)[3]["reward"]})
    end_export(tracker, run, "completed", rows(9), known=4)
    assert "warning" not in capfd.readouterr().err
    check_whole(server, run.path, tmp_path / "kept")
    _, there = mlflow_run(server, run.path.name)
    assert there.data.params["training.episodes"] == "6"  # MLflow never changes a parameter
    assert there.data.tags["training.episodes"] == "9"


def test_a_run_whose_process_dies_is_failed_there(server, tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", server)
    run, config = begun(tmp_path, "lab")
    tracker = begin_export("mlflow", run, config)
    tracker.log(1, {"episode/reward": 1.0})
    process = tracker._tracker._process
    tracker._tracker._orders.put(None)  # its standard input ends, as with this process
    process.wait(PATIENCE_S)
    run.release()
    assert mlflow_run(server, run.path.name)[1].info.status == "FAILED"


def test_trackio_has_every_episode_of_one_run(tmp_path, monkeypatch, capfd):
    trackio = pytest.importorskip("trackio")
    monkeypatch.setenv("TRACKIO_DIR", str(tmp_path / "trackio"))
    run, config = begun(tmp_path, "lab", episodes=6)
    end_export(begin_export("trackio", run, config), run, "interrupted", rows(4))
    run = RunDirectory.reopen(run.path, config, COMMAND)
    end_export(begin_export("trackio", run, config), run, "completed", rows(6), known=4)
    assert "warning" not in capfd.readouterr().err
    code = (
        "import json; from trackio.sqlite_storage import SQLiteStorage as s;"
        "n, = s.get_runs('orchid'); print(json.dumps([n, [one.get('episode/reward')"
        " for one in s.get_logs('orchid', n)]]))"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert trackio and run.path.name in finished.stdout
    assert finished.stdout.count("null") <= 2  # the two records of final metrics
    for row in rows(6):
        assert repr(row["reward"])[:6] in finished.stdout


def test_wandb_keeps_a_run_offline(tmp_path, monkeypatch, capfd):
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    run, config = begun(tmp_path, "lab")
    end_export(begin_export("wandb", run, config), run, "completed", rows(3))
    assert "warning: wandb is off" not in capfd.readouterr().err
    (kept,) = tmp_path.glob(f"wandb/offline-run-*-{run.path.name}/*.wandb")
    assert run.path.name.encode() in kept.read_bytes()
