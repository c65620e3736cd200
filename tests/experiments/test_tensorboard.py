"""``orchid tensorboard``, and what a real TensorBoard shows of runs that have ended."""

import json
import signal
import socket
import time
import urllib.request

import pytest

from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import read_record
from orchid_uav.experiments.runs.tensorboard_server import named_folders
from tests.helpers.processes import assert_is_an_error
from tests.helpers.run_directories import COMMAND, begin_export, begun, end_export, make_run, rows

PATIENCE_S = 60.0
ALL = ["STATUS_UNKNOWN", "STATUS_SUCCESS", "STATUS_FAILURE", "STATUS_RUNNING"]


@pytest.fixture(autouse=True)
def _no_git(monkeypatch):
    monkeypatch.setattr(provenance, "git_commit", lambda: None)


def ended(run: RunDirectory, config, status: str, log: list[dict[str, float]], known: int = 0):
    tracker = begin_export("tensorboard", run, config)
    if known:
        tracker.resume(known)
    return end_export(tracker, run, status, log, known)


@pytest.fixture
def runs(tmp_path):
    """A run that is complete, one that failed, and one that went on after it was interrupted."""
    directory = tmp_path / "my runs, today"
    good = ended(*begun(directory, "good", reset__kappa=0.1), "completed", rows(3, reward=2.0))
    bad = ended(*begun(directory, "bad", reset__kappa=0.5), "failed", rows(2, reward=4.0))
    run, config = begun(directory, "long", episodes=6, uav__station__altitude_m=None)
    ended(run, config, "interrupted", rows(4, reward=6.0))
    longer = config.extended_to(9)
    run = RunDirectory.reopen(run.path, longer, COMMAND)
    long = ended(
        run, longer, "completed", [*rows(4, reward=6.0), *rows(9, reward=8.0)[4:]], known=4
    )
    return directory, {"good": good, "bad": bad, "long": long}


def ask(url: str, page: str, **question):
    request = urllib.request.Request(
        f"{url}data/{page}",
        json.dumps(question).encode() if question else None,
        {"Content-Type": "application/json"},
    )
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return json.load(answer)


def until_complete(question, count: int):
    """What the server answers once it has read everything."""
    deadline = time.monotonic() + PATIENCE_S
    while len(answer := question()) < count and time.monotonic() < deadline:
        time.sleep(0.1)
    return answer


@pytest.mark.parametrize("names", [[], ["bad", "long"]], ids=["all", "some"])
def test_settings_and_final_metrics_lie_side_by_side(runs, start_orchid, names):
    directory, paths = runs
    named = [str(paths[name]) for name in names]
    process = start_orchid("tensorboard", *named, "--runs-dir", directory, "--port=0", "--json")
    document = json.loads(process.stdout.readline())
    expected = {paths[name].name: name for name in names or paths}
    assert document["runs"] == ([paths[name].name for name in names] or None)
    url = document["url"]
    assert url.startswith("http://localhost:")

    def groups():
        found = ask(
            url,
            "plugin/hparams/session_groups",
            allowedStatuses=ALL,
            startIndex=0,
            sliceSize=10,
            colParams=[{"hparam": "reset.kappa"}],
        )["sessionGroups"]
        return [group for group in found if group["sessions"][0]["status"] != "STATUS_UNKNOWN"]

    sessions = {}
    for group in until_complete(groups, len(expected)):
        (session,) = group["sessions"]
        metrics = {one["name"]["tag"]: one["value"] for one in session["metricValues"]}
        sessions[expected[session["name"]]] = session["status"], group["hparams"], metrics
    assert set(sessions) == set(names or paths)
    assert {name: status for name, (status, *_) in sessions.items()} == {
        name: "STATUS_FAILURE" if name == "bad" else "STATUS_SUCCESS" for name in sessions
    }
    assert sessions["bad"][1]["reset.kappa"] == 0.5
    assert sessions["bad"][1]["reset.enabled"] is True
    assert sessions["bad"][2]["final/reward"] == 4.0
    _, settings, metrics = sessions["long"]
    assert settings["training.episodes"] == 9  # not the 6 of its first end
    assert settings["uav.station.altitude_m"] == "none"
    assert metrics["final/reward"] == pytest.approx((4 * 6.0 + 5 * 8.0) / 9)
    assert metrics["final/rate_jfi"] == pytest.approx(
        read_record(paths["long"]).final["rate_jfi"], rel=1e-6
    )
    curve = ask(url, f"plugin/scalars/scalars?run={paths['long'].name}&tag=episode%2Freward")
    assert [(step, value) for _, step, value in curve] == [
        (step, 6.0 if step <= 4 else 8.0) for step in range(1, 10)
    ]
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (130, "", "interrupted\n")


class TestFiles:
    def test_an_end_leaves_one_file_with_settings_and_the_next_end_replaces_it(self, runs):
        for path in runs[1].values():
            episodes = [*path.glob("events.out.tfevents.*[0-9]")]
            (settings,) = path.glob("events.out.tfevents.*.hparams")
            assert settings.name > max(one.name for one in episodes)  # TensorBoard reads it last
        assert len(episodes) == 2

    def test_a_record_that_cannot_be_read_is_a_warning(self, tmp_path, capsys):
        run, config = begun(tmp_path, "lab")
        tracker = begin_export("tensorboard", run, config)
        (run.path / "run.json").write_text("{}")
        tracker.close("failed")
        assert "tensorboard is off for the rest of the run" in capsys.readouterr().err
        run.release()


class TestRefusals:
    @pytest.fixture(autouse=True)
    def _elsewhere(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)

    def test_runs_that_cannot_be_shown(self, orchid, tmp_path):
        quiet = make_run(tmp_path / "runs", "quiet")
        for name, part in (
            (quiet.name, "has no events for TensorBoard"),
            ("nothing", "no run 'nothing'"),
            (tmp_path, "not a run directory"),
        ):
            assert_is_an_error(orchid("tensorboard", name), part)
        assert_is_an_error(orchid("tensorboard", "--runs-dir=missing"), "no directory missing")

    def test_two_runs_of_one_name(self, tmp_path):
        for folder in ("a", "b"):
            path = make_run(tmp_path / folder, "lab")
            (path / "events.out.tfevents.1").touch()
            path.rename(path.with_name("twin"))
        paths = [str(tmp_path / folder / "twin") for folder in ("a", "b")]
        with pytest.raises(InputError, match="two runs are called twin"):
            named_folders(paths, tmp_path)
        assert list(named_folders([paths[0], paths[0]], tmp_path)) == ["twin"]

    def test_a_port_that_is_taken(self, start_orchid, tmp_path):
        (tmp_path / "runs").mkdir()
        with socket.create_server(("localhost", 0)) as taken:
            port = taken.getsockname()[1]
            process = start_orchid("tensorboard", "--port", port)
            out, err = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, out) == (2, "")
        note, error = err.splitlines()
        assert "no runs in runs yet" in note
        assert error.startswith("error: TensorBoard cannot start") and f"port {port}" in error
