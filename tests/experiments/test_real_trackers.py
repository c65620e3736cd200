"""Runs in a real MLflow, trackio and W&B, read back by their own means: ``make test-trackers``."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.helpers.processes import TINY_FLAGS, columns, record_of

mlflow = pytest.importorskip("mlflow", reason="make test-trackers installs it")
EPISODES, AT_ONCE, PATIENCE_S = 30, 8, 300.0


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


@pytest.fixture
def run_orchid(tmp_path, plain_environment):
    """Runs ``orchid train`` in a process; calls give the run's directory and what was told."""

    def run(*options: str, code: int = 0, **variables: str) -> tuple[Path, str]:
        # On a busy machine the few seconds in the end may not be enough for eight at once.
        patient = (
            "import sys; from orchid_uav.experiments.training import tracker_process as one;"
            "one._SECONDS_AT_THE_END = 120.0; from orchid_uav.cli.main import main;"
            "sys.exit(main())"
        )
        given = ["train", *TINY_FLAGS, "--no-rf", f"--runs-dir={tmp_path}", "--json", "--quiet"]
        if any(option.startswith("--resume") for option in options):
            given = ["train", f"--runs-dir={tmp_path}", "--json", "--quiet"]
        finished = subprocess.run(
            [sys.executable, "-c", patient, *given, *options],
            env=os.environ | {"PYTHONWARNINGS": "ignore"} | variables,
            capture_output=True,
            text=True,
            check=False,
        )
        assert finished.returncode == code, finished.stderr
        path = json.loads(finished.stdout)["path"] if finished.stdout else ""
        return Path(path), finished.stderr

    return run


def mlflow_run(uri: str, run_id: str):
    """The only MLflow run of a run, and a client."""
    client = mlflow.MlflowClient(uri)
    experiment = client.get_experiment_by_name("orchid")
    found = client.search_runs([experiment.experiment_id], f"tags.`orchid.run` = '{run_id}'")
    assert len(found) == 1
    return client, found[0]


def history(client, run, metric: str) -> list[tuple[int, float]]:
    return [(one.step, one.value) for one in client.get_metric_history(run.info.run_id, metric)]


def check_whole(uri: str, path: Path, tmp_path: Path) -> None:
    """Everything of a run is in MLflow, once."""
    client, run = mlflow_run(uri, path.name)
    record, logged = record_of(path), columns(path)
    assert run.info.status == "FINISHED" and run.info.run_name == path.name
    for column in ("reward", "rate_jfi", "worst_rate_bps"):
        expected = [(n, pytest.approx(one)) for n, one in enumerate(logged[column], 1)]
        assert history(client, run, f"episode/{column}") == expected
        assert run.data.metrics[f"final/{column}"] == pytest.approx(record["final"][column])
    assert run.data.params["network.uav_count"] == "2"
    assert run.data.params["training.seed"] == str(
        json.loads((path / "config.json").read_text())["training"]["seed"]
    )
    kept = Path(client.download_artifacts(run.info.run_id, "", str(tmp_path / "kept")))
    names = ("run.json", "config.json", "episodes.csv", "policy.safetensors", "policy.json")
    assert {one.name for one in kept.iterdir()} == set(names)
    for name in names:
        assert (kept / name).read_bytes() == (path / name).read_bytes()


@pytest.mark.parametrize("where", ["server", "database"])
def test_eight_runs_at_once(server, run_orchid, tmp_path, where):
    variables = {"MLFLOW_TRACKING_URI": server} if where == "server" else {}
    uri = server if where == "server" else f"sqlite:///{tmp_path / 'mlflow.db'}"
    options = ("--track=mlflow", f"--episodes={EPISODES}")
    with ThreadPoolExecutor(AT_ONCE) as pool:
        ended = [
            pool.submit(run_orchid, *options, f"--seed={seed}", **variables)
            for seed in range(AT_ONCE)
        ]
        told = [one.result() for one in ended]
    for number, (path, err) in enumerate(told):
        assert "warning" not in err
        folder = tmp_path / f"kept {number}"
        folder.mkdir()
        check_whole(uri, path, folder)
    assert len({path.name for path, _ in told}) == AT_ONCE


def test_a_run_that_goes_on_continues_its_mlflow_run(server, run_orchid, tmp_path):
    here = {"MLFLOW_TRACKING_URI": server}
    path, _ = run_orchid("--track=mlflow", "--episodes=5", **here)
    _, run = mlflow_run(server, path.name)
    assert run.data.params["training.episodes"] == "5"
    again, err = run_orchid(f"--resume={path}", "--episodes=9", "--track=mlflow", **here)
    assert again == path and "warning" not in err
    check_whole(server, path, tmp_path)
    _, run = mlflow_run(server, path.name)
    assert run.data.params["training.episodes"] == "5"  # MLflow never changes a parameter
    assert run.data.tags["training.episodes"] == "9"


def test_a_run_that_fails_is_failed_there(server, run_orchid, tmp_path):
    failing = ("--track=mlflow", "--episodes=40", "--set=ppo.actor_lr=1e30")
    run_orchid(*failing, code=1, MLFLOW_TRACKING_URI=server)
    (path,) = (one.parent for one in tmp_path.glob("*/run.json"))
    _, run = mlflow_run(server, path.name)
    assert record_of(path)["status"] == "failed"
    assert run.info.status == "FAILED"


def test_trackio_has_every_episode_and_continues(run_orchid, tmp_path):
    pytest.importorskip("trackio")
    here = {"TRACKIO_DIR": str(tmp_path / "trackio")}
    path, err = run_orchid("--track=trackio", "--episodes=5", **here)
    assert "warning" not in err
    run_orchid(f"--resume={path}", "--episodes=9", "--track=trackio", **here)
    code = (
        "import json, trackio; run, = trackio.Api().runs('orchid');"
        "print(json.dumps([run.name, run.config['network.uav_count'], "
        "run.history('episode/reward') if hasattr(run, 'history') else []], default=str))"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | here,
        capture_output=True,
        text=True,
        check=True,
    )
    name, uavs, _ = json.loads(finished.stdout.splitlines()[-1])
    assert (name, uavs) == (path.name, 2)


def test_wandb_keeps_a_run_offline(run_orchid, tmp_path):
    pytest.importorskip("wandb")
    path, err = run_orchid("--track=wandb", "--episodes=5", WANDB_MODE="offline")
    assert "warning: wandb is off" not in err
    (kept,) = tmp_path.glob(f"wandb/offline-run-*-{path.name}/*.wandb")
    assert path.name.encode() in kept.read_bytes()
