"""Rows: made by jobs, written, read back, and not made twice."""

import json
from pathlib import Path

import numpy as np
import pytest

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import read_policy, rows_of
from orchid_uav.experiments.reproduction import job as jobs
from orchid_uav.experiments.reproduction import settings, trainings
from orchid_uav.experiments.reproduction.job import RowJob, make_row
from orchid_uav.experiments.reproduction.rows import read_row, read_rows, row_path
from orchid_uav.experiments.reproduction.settings import EVALUATION_SEED, Case
from orchid_uav.experiments.reproduction.trainings import Training
from orchid_uav.experiments.runs.records import read_record

SMALL = ("--episodes", "20", "--set", "network.episode_slots=4", "--set", "ppo.hidden_sizes=8")
SMALL = (*SMALL, "--uavs", "2", "--users", "12", "--set", "reset.window=5")
CASES = [Case(Setting(uavs=2, users=12)), Case(Setting(uavs=3, users=12), sensing_error_m=50.0)]


@pytest.fixture
def small(monkeypatch, tmp_path):
    """A campaign of one method with three topologies and two cases."""
    method = Training("orchid", SMALL, "small", "base")
    known = {"orchid": method, "maddpg-pf": method}
    for module in (jobs, trainings):
        monkeypatch.setattr(module, "TRAININGS", known)
    monkeypatch.setattr(jobs, "TOPOLOGIES", 3)
    monkeypatch.setattr(jobs, "flown_by", lambda flown: CASES)
    monkeypatch.setattr(settings, "CURVE_TOPOLOGIES", 2)

    def order(method: str, seed: int | None) -> RowJob:
        return RowJob(method, seed, tmp_path / "rows", tmp_path / "runs")

    return order


class TestARow:
    def test_of_a_training_holds_what_its_policy_does(self, small, tmp_path):
        assert make_row(small("orchid", 10)) == 0
        row = read_row(row_path(tmp_path / "rows", "orchid", 10))
        assert (row.method, row.seed, row.episodes) == ("orchid", 10, 20)
        assert len(row.update_variances) == 20
        assert row.curve.block == 10 and len(row.curve.mean["reward"]) == 2
        [run] = (tmp_path / "runs").iterdir()
        assert not (run / "checkpoints").exists()
        assert row.reset_episodes == read_record(run).reset_episodes
        policy = read_policy(run)
        contender = rows_of(policy, "x", "", stochastic=False, is_zero=False)
        for case in CASES:
            world = policy.config.network_parameters.with_overrides(dict(case.world))
            plan = EvaluationPlan(contender, [case.setting], 3, EVALUATION_SEED, world)
            [flown] = evaluate(plan)[0].values()
            found = row.find(case)
            for name, values in flown.items():
                mean, std = found.metrics[name]
                assert mean == pytest.approx(np.mean(values), rel=1e-4, abs=1e-4)
                assert std == pytest.approx(np.std(values, ddof=1), rel=1e-3, abs=1e-4)
        sampled = row.find(CASES[0], deterministic=False)
        assert sampled.metrics != row.find(CASES[0]).metrics
        twin = row.find(CASES[1], is_zero=True)  # of the first seed, everywhere
        assert twin.metrics["displacement_m"][0] == 0.0
        with pytest.raises(LookupError):
            row.find(Case(Setting(uavs=9)))

    def test_is_made_once(self, small, tmp_path):
        path = row_path(tmp_path / "rows", "static-pf", 10)
        assert make_row(small("static-pf", 10)) == 0
        before = path.read_bytes()
        assert make_row(small("static-pf", 10)) == 0
        assert path.read_bytes() == before

    def test_of_a_rule_has_no_seed(self, small, tmp_path, monkeypatch):
        monkeypatch.setattr(jobs, "flown_by", lambda flown: [Case(Setting(uavs=2, users=12))])
        assert make_row(small("static-mmf", None)) == 0
        row = read_row(row_path(tmp_path / "rows", "static-mmf", None))
        assert row.seed is None
        assert row.flights[0].metrics["displacement_m"] == [0.0, 0.0]

    def test_survives_a_death_between_training_and_flying(self, small, tmp_path, monkeypatch):
        def dies(*_):
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr(jobs, "_measured", dies)
            with pytest.raises(KeyboardInterrupt):
                make_row(small("orchid", 11))
        [run] = (tmp_path / "runs").iterdir()
        log = (run / "episodes.csv").read_bytes()
        assert make_row(small("orchid", 11)) == 0
        assert [path.name for path in (tmp_path / "runs").iterdir()] == [run.name]
        assert (run / "episodes.csv").read_bytes() == log
        row = read_row(row_path(tmp_path / "rows", "orchid", 11))
        assert len(row.update_variances) == 20
        with pytest.raises(LookupError):  # only the first seed's twin flies everywhere
            row.find(CASES[1], is_zero=True)


class TestReading:
    def test_gives_rows_by_method(self, small, tmp_path):
        for seed in (12, 11):
            make_row(small("static-pf", seed))
        assert [row.seed for row in read_rows(tmp_path / "rows")] == [11, 12]
        assert list(read_rows(tmp_path / "nothing")) == []

    @pytest.mark.parametrize("content", ["", "{}", "[1]", '{"schema": 1, "method": "static-pf"}'])
    def test_refuses_what_is_no_row(self, tmp_path, content):
        path = row_path(tmp_path, "static-pf", 11)
        path.parent.mkdir()
        path.write_text(content)
        with pytest.raises(InputError, match="no row"):
            list(read_rows(tmp_path))

    def test_refuses_a_row_in_another_rows_place(self, small, tmp_path):
        make_row(small("static-pf", 11))
        path = row_path(tmp_path / "rows", "static-pf", 11)
        other = row_path(tmp_path / "rows", "static-pf", 12)
        other.write_bytes(path.read_bytes())
        with pytest.raises(InputError):
            read_row(other)


def test_an_order_is_read_back(small, tmp_path):
    folder = tmp_path / "jobs"
    folder.mkdir()
    job = small("orchid", 13)
    described = job.as_job(folder, 2.0)
    assert described.cost == 2.0
    read = RowJob.read(Path(described.command[-1]))
    assert (read.method, read.seed, read.rows) == ("orchid", 13, job.rows.resolve())
    assert described.fraction_done() == 0.0
    (folder / "orchid-s13.json").write_text(json.dumps({"method": 3}))
    with pytest.raises(InputError, match="order"):
        RowJob.read(folder / "orchid-s13.json")
