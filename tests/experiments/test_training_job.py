"""Runs as jobs: found if they are there, gone on with if they stopped, and real processes."""

import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.runs import lock as run_lock
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.experiments.training import job as training_job
from orchid_uav.experiments.training import loop as training
from orchid_uav.experiments.training.job import TrainingJob, run_one
from tests.helpers.processes import (
    Audience,
    columns,
    files_of,
    fingerprint,
    forked,
    killed_at_step,
    learned_files,
    record_of,
    tell_of_file_steps,
    tiny_config,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="fork and signals are POSIX")

GIVE_UP_AFTER_S = 60.0
EPISODES = 6
COMMAND = ("orchid", "ablate", "--no-rf")


def config_of(episodes=EPISODES, **values):
    """Decays until episode 4, and is saved every second episode."""
    saved = {"checkpoint__every_episodes": 2, "training__schedule_episodes": 4}
    return tiny_config(episodes, **saved, training__final_learning_rate_scale=0.2, **values)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    """No git, no waiting for the disk, and none for locks."""
    monkeypatch.setattr(provenance, "git_commit", lambda: None)
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)
    monkeypatch.setattr(run_lock, "_PATIENCE_S", 0.1)


@pytest.fixture
def make(tmp_path):
    """Makes jobs whose runs are in one directory."""

    def job(name="lab", config=None, **values):
        return TrainingJob(name, config or config_of(**values), tmp_path / "runs", COMMAND)

    return job


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nothing disturbed, and that is no job."""
    config = config_of()
    run = RunDirectory.create(tmp_path_factory.mktemp("whole"), "lab", config, COMMAND)
    training.train(config, run, Audience(), (), Interruption())
    return run.path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A job that was run."""
    job = TrainingJob("lab", config_of(), tmp_path_factory.mktemp("trained") / "runs", COMMAND)
    assert run_one(job) == 0
    return job


def only_run(job) -> Path:
    [path] = job.runs_dir.iterdir()
    return path


class TestRunOne:
    def test_leaves_a_complete_run(self, trained, whole):
        path = only_run(trained)
        assert trained.find() == trained.completed() == path
        assert trained.status() == "completed"
        record = record_of(path)
        assert (record["name"], record["command"]) == ("lab", list(COMMAND))
        assert read_config(path, read_record(path)) == trained.config
        assert files_of(path) == files_of(whole) | {"events.out.tfevents"}
        assert learned_files(path) == learned_files(whole)

    def test_trains_with_the_schedule_of_its_configuration(self, trained):
        rates = columns(only_run(trained))["actor_lr"]
        assert rates[-1] == pytest.approx(0.2e-4, rel=1e-12)
        assert rates[-2] == rates[-1]  # the schedule ends at episode 4 of 6
        assert rates[1] - rates[2] == pytest.approx(0.2e-4, rel=1e-9)

    def test_has_nothing_to_do_where_the_run_is_complete(self, trained, monkeypatch):
        monkeypatch.setattr(training, "train", None)
        before = fingerprint(trained.runs_dir)
        times = {path: path.stat().st_mtime_ns for path in trained.runs_dir.rglob("*")}
        assert run_one(trained) == 0
        assert run_one(dataclasses.replace(trained, command=("orchid", "again"))) == 0
        assert fingerprint(trained.runs_dir) == before
        assert {path: path.stat().st_mtime_ns for path in trained.runs_dir.rglob("*")} == times

    def test_goes_on_where_it_was_asked_to_stop(self, make, whole, monkeypatch):
        job, shown = make(), []

        def stop(self, rows, reset_episodes):
            shown.extend(rows)
            if len(shown) == 3:  # by the batch system, and by the study that it told as well
                signal.raise_signal(signal.SIGTERM)
                signal.raise_signal(signal.SIGTERM)

        monkeypatch.setattr(training_job._Log, "show", stop)
        assert run_one(job) == 130
        assert job.status() == "interrupted"
        assert job.completed() is None
        assert run_one(job) == 0
        assert [row["episode"] for row in shown] == [1, 2, 3, 4, 5, 6]  # no episode twice
        assert learned_files(only_run(job)) == learned_files(whole)

    @pytest.mark.parametrize("at", [1, 4, 7])
    def test_goes_on_where_it_was_killed(self, make, whole, at):
        def watch(patch, tell):
            append = RunDirectory.append_episodes
            patch.setattr(
                RunDirectory, "append_episodes", lambda *given: tell("append") or append(*given)
            )

        job = make()
        assert killed_at_step(lambda: run_one(job), at, watch)
        # The first of these steps comes before there is a record.
        assert job.status() == ("not begun" if at == 1 else "died")
        assert run_one(job) == 0
        assert learned_files(job.completed()) == learned_files(whole)
        assert len(list(job.runs_dir.iterdir())) == (2 if at == 1 else 1)

    @pytest.mark.parametrize("at", [3, 6, 12, 20])
    def test_begins_again_where_it_was_killed_while_it_began(self, make, whole, at):
        job = make()
        assert killed_at_step(lambda: run_one(job), at, tell_of_file_steps)
        assert run_one(job) == 0
        assert job.status() == "completed"
        assert learned_files(job.completed()) == learned_files(whole)

    def test_fails_again_in_the_directory_in_which_it_failed(self, make):
        job = make(ppo__actor_learning_rate=1e30)
        for _ in range(2):
            with pytest.raises(RunFailedError, match=r"failed after \d episodes"):
                run_one(job)
            assert job.status() == "failed"
        assert len(record_of(only_run(job))["resumed"]) == 1

    def test_leaves_a_run_alone_that_another_process_writes(self, make):
        job = make()
        held = RunDirectory.create(job.runs_dir, job.name, job.config, COMMAND)
        assert job.status() == "running"
        with pytest.raises(InputError, match="is being written by another process"):
            run_one(job)
        held.finish("interrupted", [], [], 0.0)


class TestWaiting:
    """For another process that writes the run, such as one on a machine that was thought lost."""

    @pytest.fixture
    def held(self, make):
        """A run that another process holds until it is told to end, and how it then leaves it."""
        told, tell = os.pipe()
        ready, begun = os.pipe()
        job = make()

        def hold():
            run = RunDirectory.create(job.runs_dir, job.name, job.config, COMMAND)
            os.write(begun, b"!")
            if os.read(told, 1) == b"c":
                training.train(job.config, run, Audience(), (), Interruption())
            else:
                run.finish("interrupted", [], [], 0.0)

        child = forked(hold)
        os.read(ready, 1)
        yield job, lambda way: os.write(tell, way)
        os.write(tell, b"i")
        os.waitpid(child, 0)
        for descriptor in (told, tell, ready, begun):
            os.close(descriptor)

    def test_goes_on_once_that_one_has_ended(self, held, whole, capsys):
        job, tell = held
        threading.Timer(0.5, tell, [b"i"]).start()
        assert run_one(job, patience_s=GIVE_UP_AFTER_S) == 0
        assert "is being written by another process: waiting for its end" in capsys.readouterr().out
        assert learned_files(only_run(job)) == learned_files(whole)

    def test_has_nothing_to_do_where_that_one_has_completed_it(self, held, whole):
        job, tell = held
        threading.Timer(0.5, tell, [b"c"]).start()
        assert run_one(job, patience_s=GIVE_UP_AFTER_S) == 0
        assert record_of(only_run(job))["resumed"] == []
        assert learned_files(only_run(job)) == learned_files(whole)

    def test_fails_after_a_while(self, held):
        with pytest.raises(InputError, match="is being written by another process"):
            run_one(held[0], patience_s=0.2)

    def test_ends_where_it_is_asked_to_stop(self, held):
        stop = threading.Timer(0.5, os.kill, [os.getpid(), signal.SIGTERM])
        stop.start()
        assert run_one(held[0], patience_s=GIVE_UP_AFTER_S) == 130
        assert held[0].status() == "running"


class TestFinding:
    """By name, seed and configuration."""

    def begin(self, job, status="completed") -> Path:
        """A run of the job that was never trained."""
        run = RunDirectory.create(job.runs_dir, job.name, job.config, COMMAND)
        run.finish(status, [], [], 0.0)
        return run.path

    def test_finds_nothing_where_nothing_is(self, make):
        assert make().find() is None
        assert make().status() == "not begun"
        make().runs_dir.mkdir()
        assert make().find() is None

    def test_a_run_of_another_configuration_is_left_alone(self, make):
        one, other = make(reset__kappa=0.5), make(reset__kappa=0.1)
        path = self.begin(one)
        before = fingerprint(path)
        assert other.find() is None
        assert run_one(other) == 0
        assert fingerprint(path) == before
        assert one.find() == path
        assert other.find() not in (None, path)

    def test_names_and_seeds_do_not_mix(self, make):
        names = ["a", "b-a", "a-s0", "b-a-s0", "a.b", "a_b", "axb", "a-s0-abcd"]
        config = config_of()
        jobs = [make(name, config) for name in names]
        jobs += [make("a", config_of(training__seed=seed)) for seed in (1, 10)]
        paths = {}
        for job in jobs:
            assert job.find() is None
            paths[job.key] = self.begin(job)
        assert {job.key: job.find() for job in jobs} == paths

    @pytest.mark.parametrize(
        "damage",
        [
            lambda path: (path / "run.json").unlink(),
            lambda path: (path / "run.json").write_text("{"),
            lambda path: (path / "config.json").unlink(),
            lambda path: (path / "config.json").write_bytes(b"\xff"),
            lambda path: (shutil.rmtree(path), path.mkdir()),
            lambda path: (shutil.rmtree(path), path.write_text("no directory")),
            lambda path: (path / "run.json").write_text(
                (path / "run.json").read_text().replace('"completed"', '"failed"')
            ),
        ],
        ids=["no record", "half a record", "no config", "no text", "empty", "file", "broken seal"],
    )
    def test_what_is_damaged_is_passed_over(self, make, damage):
        job = make()
        damaged = self.begin(job)
        damage(damaged)
        assert job.find() is None
        whole = self.begin(job)
        assert job.find() == whole
        shutil.rmtree(whole)
        assert damaged.exists()

    def test_a_complete_one_comes_before_a_newer_one_that_is_not(self, make):
        job = make()
        for stamp, status in (
            ("20260101T000000Z", "failed"),
            ("20260101T000001Z", "completed"),
            ("20260101T000002Z", "interrupted"),
        ):
            path = self.begin(job, status)
            path.rename(path.with_name(f"{stamp}-lab-s0-abcd"))
        assert job.completed().name == "20260101T000001Z-lab-s0-abcd"
        shutil.rmtree(job.find())
        assert job.find().name == "20260101T000002Z-lab-s0-abcd"
        assert job.completed() is None


class TestJob:
    def test_its_order_says_all_of_it(self, make, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        job = dataclasses.replace(make(reset__kappa=0.3), runs_dir=Path("runs"))
        made = job.as_job(tmp_path, cost=2.5)
        assert (made.name, made.cost, made.log) == ("lab-s0", 2.5, tmp_path / "lab-s0.log")
        module = "orchid_uav.experiments.training.job"
        assert made.command[:4] == (sys.executable, "-P", "-m", module)
        absolute = dataclasses.replace(job, runs_dir=tmp_path.resolve() / "runs")
        assert TrainingJob.read(Path(made.command[4])) == absolute

    def test_its_order_holds_no_name_that_is_no_text(self, make, tmp_path):
        folder = tmp_path / os.fsdecode(b"of-1998-\xe9")
        try:
            folder.mkdir()
        except OSError:
            pytest.skip("names here are text")
        job = dataclasses.replace(make(), runs_dir=folder / "runs")
        assert TrainingJob.read(Path(job.as_job(folder).command[-1])) == job

    def test_its_process_imports_nothing_from_the_current_directory(self, make, tmp_path):
        for name in ("statistics", "torch", "numpy", "json"):
            (tmp_path / f"{name}.py").write_text("raise SystemExit('a namesake was imported')\n")
        made = make().as_job(tmp_path)
        Path(made.command[-1]).write_text("{}")
        finished = subprocess.run(
            made.command, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert finished.stderr.startswith("error: "), finished.stderr
        assert "lab-s0.json is not the order of a training job" in finished.stderr

    def test_what_is_done_of_it_grows_with_its_episodes(self, make, tmp_path, monkeypatch):
        job, seen = make(), []
        fraction_done = job.as_job(tmp_path).fraction_done
        assert fraction_done() == 0.0
        monkeypatch.setattr(training_job._Log, "begin", lambda *given: seen.append(fraction_done()))
        monkeypatch.setattr(training_job._Log, "show", lambda *given: seen.append(fraction_done()))
        run_one(job)
        assert seen == pytest.approx([done / 6 for done in range(7)])
        assert job.as_job(tmp_path).fraction_done() == 1.0

    @pytest.mark.parametrize(
        "content", ["{", "[]", "{}", '{"name": "a", "config": {"reset": 3}}', None]
    )
    def test_an_order_that_is_none_is_an_error_of_a_line(self, tmp_path, content):
        order = tmp_path / "order.json"
        if content is not None:
            order.write_text(content)
        with pytest.raises(InputError, match=r"order\.json is not the order of a training job"):
            TrainingJob.read(order)


@pytest.fixture
def process(tmp_path, start_process):
    """Starts the process of a job as an executor does."""

    def start(job, **streams):
        environment = os.environ | {"ORCHID_JOB": "1"}
        return start_process(job.as_job(tmp_path).command, env=environment, **streams)

    return start


def until(condition, child):
    deadline = time.monotonic() + GIVE_UP_AFTER_S
    while not condition():
        assert child.poll() is None, child.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)


class TestProcess:
    def test_stops_at_the_end_of_its_input_if_an_executor_started_it(self, make, process):
        job = make("endless", episodes=100_000)
        child = process(job, stdin=subprocess.PIPE)
        fraction_done = training_job._FractionDone(job)

        def has_begun():
            with suppress(OSError):
                return fraction_done() > 0.0

        until(has_begun, child)
        child.stdin.close()
        child.stdin = None
        out, err = child.communicate(timeout=GIVE_UP_AFTER_S)
        assert child.returncode == 130
        assert "Traceback" not in err
        assert job.status() == "interrupted"
        record = record_of(job.find())
        assert out == f"run {record['id']} from episode 1 on\n"
        assert columns(job.find())["episode"] == list(range(1, record["episodes"] + 1))

    def main(self, monkeypatch, order) -> int:
        monkeypatch.delenv("ORCHID_JOB", raising=False)  # or the end of our input would end us
        monkeypatch.setattr(sys, "argv", ["training_job", str(order)])
        return training_job.main()

    def test_heeds_no_end_of_its_input_if_it_was_started_by_hand(
        self, make, tmp_path, monkeypatch, capsys
    ):
        job, own_input = make("by-hand", episodes=3), os.dup(0)
        with Path(os.devnull).open() as ended:
            os.dup2(ended.fileno(), 0)
        try:
            code = self.main(monkeypatch, job.as_job(tmp_path).command[-1])
        finally:
            os.dup2(own_input, 0)
            os.close(own_input)
        assert (code, capsys.readouterr().err) == (0, "")
        assert job.status() == "completed"

    def test_ends_with_1_and_the_reason(self, make, tmp_path, monkeypatch, capsys):
        job = make(ppo__actor_learning_rate=1e30)
        assert self.main(monkeypatch, job.as_job(tmp_path).command[-1]) == 1
        err = capsys.readouterr().err
        assert err.startswith(f"error: run {record_of(only_run(job))['id']} failed after ")
        assert self.main(monkeypatch, tmp_path / "none.json") == 1
        assert "none.json is not the order" in capsys.readouterr().err

    def test_ends_with_130_if_it_is_stopped_at_once(self, make, tmp_path, monkeypatch):
        def stop(*given):
            raise KeyboardInterrupt

        job = make()
        monkeypatch.setattr(training_job._Log, "show", stop)
        assert self.main(monkeypatch, job.as_job(tmp_path).command[-1]) == 130
        assert job.status() == "interrupted"
