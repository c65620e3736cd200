"""``orchid reproduce`` where rows are missing: plan, training, failure, interruption, going on."""

import json
from pathlib import Path

import pytest

from orchid_uav.experiments.evaluation.flights import Setting
from orchid_uav.experiments.jobs import choice
from orchid_uav.experiments.jobs.executor import JobEnd
from orchid_uav.experiments.reproduction import campaign, job, needs, settings, trainings
from orchid_uav.experiments.reproduction.job import RowJob, make_row
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.trainings import Training

SMALL = ("--episodes", "10", "--uavs", "2", "--users", "12", "--no-rf")
SMALL = (*SMALL, "--set", "network.episode_slots=4", "--set", "ppo.hidden_sizes=8")
SEEDS = (10, 11)


class InThisProcess:
    """An executor of jobs as they are ordered; some of them fail, or are stopped."""

    processes, note, was_stopped = 1, None, False

    def __init__(self, *fails, stops=()):
        self.fails, self.stops = fails, stops

    def check(self, folder):
        folder.mkdir(parents=True, exist_ok=True)

    def run(self, jobs, progress):
        return [self._ended(one) for one in jobs]

    def close(self):
        pass

    def _ended(self, one):
        status, code = "completed", 0
        if one.name in self.stops:
            status, code = "interrupted", 130
        elif one.name in self.fails:
            status, code = "failed", 1
        else:
            assert make_row(RowJob.read(Path(one.command[-1]))) == 0
        return JobEnd(one, status, code, 1, 0.1, None)


@pytest.fixture
def reproduce(orchid, monkeypatch, tmp_path):
    """Runs the command, with a small training and two seeds, by an executor."""
    known = {"orchid": Training("orchid", SMALL, "small", "base")}
    for module in (campaign, job, needs, trainings):
        monkeypatch.setattr(module, "TRAININGS", known)
    monkeypatch.setattr(campaign, "SEEDS", SEEDS)
    monkeypatch.setattr(job, "TOPOLOGIES", 3)
    monkeypatch.setattr(job, "flown_by", lambda flown: [Case(Setting(uavs=2, users=12))])
    monkeypatch.setattr(settings, "CURVE_TOPOLOGIES", 2)
    monkeypatch.chdir(tmp_path)

    def run(executor, *words):
        monkeypatch.setattr(choice, "executor_for", lambda jobs, ray: executor)
        return orchid("reproduce", "--only=q1", *words)

    return run


def test_trains_and_flies_what_is_missing_and_nothing_twice(reproduce, tmp_path):
    finished = reproduce(InThisProcess())
    assert finished.code == 0, finished.err
    for told in ("2 rows, 0 of them already there", "orchid", "with 1 at once", "completed"):
        assert told in finished.out
    rows = tmp_path / "orchid-reproduce" / "rows" / "orchid"
    assert sorted(path.name for path in rows.iterdir()) == ["seed-10.json", "seed-11.json"]
    document = json.loads((tmp_path / "orchid-reproduce" / "claims.json").read_text())
    assert (document["status"], document["missing"]) == ("completed", 0)
    before = {path: path.stat().st_mtime_ns for path in rows.iterdir()}
    again = reproduce(InThisProcess("orchid-s10", "orchid-s11"))
    assert again.code == 0
    assert "2 rows, 2 of them already there" in again.out
    assert {path: path.stat().st_mtime_ns for path in rows.iterdir()} == before


def test_a_failed_training_is_told_and_tried_again(reproduce, tmp_path):
    finished = reproduce(InThisProcess("orchid-s10"))
    assert finished.code == 1
    assert "try the failed ones again with: orchid reproduce --only=q1" in finished.err
    document = json.loads((tmp_path / "orchid-reproduce" / "claims.json").read_text())
    assert (document["status"], document["waiting"]) == ("failed", {"orchid": 1})
    assert (tmp_path / "orchid-reproduce" / "report.html").exists()
    finished = reproduce(InThisProcess())
    assert finished.code == 0
    assert "2 rows, 1 of them already there" in finished.out


def test_a_stop_leaves_a_report_and_says_how_to_go_on(reproduce, tmp_path):
    finished = reproduce(InThisProcess(stops=["orchid-s11"]), "--quiet")
    assert finished.code == 130
    assert "interrupted; continue with: orchid reproduce --only=q1 --quiet" in finished.err
    document = json.loads((tmp_path / "orchid-reproduce" / "claims.json").read_text())
    assert (document["status"], document["rows"]) == ("interrupted", {"orchid": [10]})


@pytest.mark.parametrize("folders", [1, 2, 3])
def test_a_directory_is_known_again_however_early_it_was_left(reproduce, monkeypatch, folders):
    def dies(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Path, "mkdir", _after(Path.mkdir, folders, dies))
        assert reproduce(InThisProcess()).code == 130
    assert reproduce(InThisProcess()).code == 0


def _after(function, calls, then):
    """A function that works so often, and is then another one."""
    count = 0

    def counted(*arguments, **named):
        nonlocal count
        count += 1
        return (function if count <= calls else then)(*arguments, **named)

    return counted
