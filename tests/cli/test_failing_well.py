"""Full disks, read-only directories, clocks set back, numbers that are none, output that nobody can
write to: what is left, and that the run can go on."""

import errno
import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import safetensors.numpy

from orchid_uav import notices
from orchid_uav.experiments.evaluation.methods import read_policy
from orchid_uav.experiments.runs import directory as run_directory
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import read_record, status_of
from orchid_uav.experiments.training import checkpoints, listeners, tensorboard_tracker
from orchid_uav.experiments.training import loop as training
from orchid_uav.storage.files import sync_directory, write_atomically
from tests.helpers.processes import (
    TINY_FLAGS,
    Finished,
    assert_is_an_error,
    cells,
    columns,
    file_size_limit,
    fingerprint,
    forked,
    learned_files,
    record_of,
    signals_by_default,
    without_privileges,
)

TRAIN = ["train", *TINY_FLAGS, "--no-rf", "--quiet"]
LATE = ["--set=ppo.actor_learning_rate=5", "--set=ppo.minibatch=rows"]
"""Diverges after some updates of several steps each."""
MADDPG = ["--algorithm=maddpg", "--set=maddpg.hidden_sizes=[16,16]", "--set=maddpg.batch_size=32"]
EVERY_SECOND = "--set=checkpoint.every_episodes=2"
EIGHT = ("--episodes=8", EVERY_SECOND)
GIVE_UP_AFTER_S = 120
FULL = r"\[Errno 28\] No space left on device|\[Errno 27\] File too large"


@contextmanager
def mounted(place: Path, size: int) -> Iterator[Path]:
    """A file system of so many bytes, where this process may mount one."""
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "orchid-test", str(place)]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"no file system can be mounted here: {error}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


class SmallDisk:
    """A small file system that can be filled and emptied."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._filler = path / "filler"

    def fill(self) -> None:
        """Take all room that there is."""
        room = os.statvfs(self.path)
        size = room.f_bavail * room.f_frsize
        with self._filler.open("ab") as file:
            os.posix_fallocate(file.fileno(), file.tell(), size)
        assert os.statvfs(self.path).f_bavail == 0

    def empty(self) -> None:
        """Give it back."""
        self._filler.unlink()


@pytest.fixture
def disk(tmp_path) -> Iterator[SmallDisk]:
    with mounted(tmp_path / "disk", 2**21) as path:
        yield SmallDisk(path)


@pytest.fixture
def at_episode(monkeypatch):
    """Calls have something done when so many episodes are written, once."""

    def arrange(episode: int, act: Callable[[], None]) -> None:
        show = listeners.Reporter.show
        left = [act]

        def show_and_act(self, rows, reset_episodes):
            show(self, rows, reset_episodes)
            if rows[-1]["episode"] == episode and left:
                left.pop()()

        monkeypatch.setattr(listeners.Reporter, "show", show_and_act)

    return arrange


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Calls give what a run of some flags leaves when nothing happens to it."""
    from orchid_uav.cli.main import main

    known = {}

    def run(*flags: str) -> tuple[bytes, bytes]:
        if flags not in known:
            runs_dir = tmp_path_factory.mktemp("undisturbed")
            assert main([*TRAIN, *flags, "--runs-dir", str(runs_dir)]) == 0
            [path] = runs_dir.iterdir()
            known[flags] = learned_files(path)
        return known[flags]

    return run


def run_in(runs_dir: Path) -> Path:
    [path] = runs_dir.iterdir()
    return path


def checkpoints_of(run: Path) -> list[str]:
    """All that lies there, also what should not."""
    folder = run / "checkpoints"
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def assert_failed(finished: Finished, *parts: str) -> None:
    """As a run does: the reason in one line, and in another how to go on."""
    assert finished.code == 1
    assert "Traceback" not in finished.err
    lines = [line for line in finished.err.splitlines() if not line.startswith("warning: ")]
    assert len(lines) <= 2, finished.err
    assert lines[0].startswith("error: run ")
    assert all(len(line) < 500 for line in lines)
    for part in parts:
        assert re.search(part, lines[0]), finished.err


def assert_rows_are_whole(run: Path, at_least: int) -> None:
    header, *rows = cells(run)
    assert all(len(row) == len(header) for row in rows)
    assert columns(run)["episode"] == list(range(1, len(rows) + 1))
    assert record_of(run)["episodes"] == len(rows) >= at_least


class TestFullDisk:
    @pytest.fixture(params=["a small file system", "a limit on sizes"])
    def fill_at(self, request, tmp_path, at_episode):
        """Calls fill the disk after so many episodes; they give where runs go and what empties."""
        if request.param == "a limit on sizes":
            limit = file_size_limit(20_000)  # less than the state of a checkpoint

            def fill(episode: int) -> tuple[Path, Callable[[], None]]:
                at_episode(episode, limit.__enter__)
                return tmp_path / "runs", lambda: limit.__exit__(None, None, None)

            yield fill
            return
        with mounted(tmp_path / "disk", 2**21) as path:
            disk = SmallDisk(path)

            def fill(episode: int) -> tuple[Path, Callable[[], None]]:
                at_episode(episode, disk.fill)
                return path / "runs", disk.empty

            yield fill

    @pytest.mark.parametrize("learner", [(), MADDPG])
    def test_during_a_checkpoint(self, orchid, fill_at, undisturbed, learner):
        flags = (*EIGHT, *learner)
        wanted = undisturbed(*flags)
        runs_dir, empty = fill_at(5)
        finished = orchid(*TRAIN, *flags, "--runs-dir", runs_dir)
        run = run_in(runs_dir)
        assert_failed(finished, "failed after 6 episodes", FULL, "checkpoint of episode 4 is kept")
        record = record_of(run)
        assert record["status"] == "failed"
        assert re.search(FULL, record["error"])
        assert checkpoints_of(run) == ["2", "4"]
        assert_rows_are_whole(run, 6)
        assert not [path for path in run.iterdir() if path.name.startswith((".r", ".e", ".c"))]
        empty()
        finished = orchid("train", "--resume", run, "--quiet")
        assert finished.code == 0, finished.err
        assert learned_files(run) == wanted
        assert record_of(run)["status"] == "completed"

    def test_during_the_log(self, orchid, disk, at_episode, undisturbed):
        # The log's last page has room for some more rows, so that it fails in the middle of one.
        flags = ("--episodes=60", "--set=checkpoint.every_episodes=20")
        wanted = undisturbed(*flags)
        at_episode(21, disk.fill)
        finished = orchid(*TRAIN, *flags, "--runs-dir", disk.path / "runs")
        run = run_in(disk.path / "runs")
        assert_failed(finished, FULL, "checkpoint of episode 20 is kept")
        assert record_of(run)["status"] == "failed"
        assert record_of(run)["episodes"] < 40, "the next checkpoint failed instead"
        assert_rows_are_whole(run, 21)
        disk.empty()
        assert orchid("train", "--resume", run, "--quiet").code == 0
        assert learned_files(run) == wanted

    def test_while_the_policy_is_written(self, orchid, disk, undisturbed, monkeypatch):
        wanted = undisturbed(*EIGHT)
        write_policy = RunDirectory.write_policy

        def fill_first(run, files):
            disk.fill()
            write_policy(run, files)

        with monkeypatch.context() as patch:
            patch.setattr(RunDirectory, "write_policy", fill_first)
            finished = orchid(*TRAIN, *EIGHT, "--runs-dir", disk.path / "runs")
        run = run_in(disk.path / "runs")
        assert_failed(finished, "failed after 8 episodes", FULL, "checkpoint of episode 8 is kept")
        assert record_of(run)["status"] == "failed"
        assert not (run / "policy.safetensors").exists()
        disk.empty()
        finished = orchid("train", "--resume", run, "--quiet")
        assert finished.code == 0, finished.err
        assert learned_files(run) == wanted

    def test_that_leaves_no_room_even_for_the_record(self, orchid, disk, at_episode, undisturbed):
        wanted = undisturbed(*EIGHT)

        def take_the_reserve_too():
            (run_in(disk.path / "runs") / ".reserve").unlink()
            disk.fill()

        at_episode(5, take_the_reserve_too)
        finished = orchid(*TRAIN, *EIGHT, "--runs-dir", disk.path / "runs")
        run = run_in(disk.path / "runs")
        assert_failed(finished, "failed after 6 episodes", FULL)
        record = read_record(run)
        assert record.status == "running", "the reserve has no purpose"
        assert status_of(run, record) == "died"
        disk.empty()
        finished = orchid("train", "--resume", run, "--quiet")
        assert finished.code == 0, finished.err
        assert learned_files(run) == wanted

    def test_when_a_run_is_to_go_on_changes_nothing(self, orchid, disk, at_episode, undisturbed):
        wanted = undisturbed(*EIGHT)
        at_episode(5, disk.fill)
        assert orchid(*TRAIN, *EIGHT, "--runs-dir", disk.path / "runs").code == 1
        run = run_in(disk.path / "runs")
        for more in ((), ("--episodes", "20")):
            before = fingerprint(run)
            finished = orchid("train", "--resume", run, "--quiet", *more)
            told = finished.err.splitlines()[-1]
            assert finished.code == 2
            assert re.fullmatch(rf"error: cannot write to {run}: No space left on device", told)
            assert fingerprint(run) == before
        disk.empty()
        assert orchid("train", "--resume", run, "--quiet").code == 0
        assert learned_files(run) == wanted

    def test_when_a_run_is_to_begin_leaves_nothing(self, orchid, disk):
        for room in (0, 4096, 16384, 65536):
            (disk.path / "runs").mkdir(exist_ok=True)
            spare = disk.path / "spare"
            spare.write_bytes(b"." * room)
            disk.fill()
            spare.unlink()
            finished = orchid(*TRAIN, "--runs-dir", disk.path / "runs")
            assert_is_an_error(finished, str(disk.path), "No space left on device", code=2)
            assert list((disk.path / "runs").iterdir()) == []
            disk.empty()

    def test_reached_by_a_run_alone_in_a_process_of_its_own(self, start_orchid, tmp_path, orchid):
        flags = (*TINY_FLAGS, "--no-rf", "--quiet", "--set=checkpoint.every_episodes=1")
        flags += ("--set=checkpoint.keep=1000", "--episodes=100000")
        with mounted(tmp_path / "disk", 2**20) as path:
            process = start_orchid("train", *flags, "--runs-dir", path)
            out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
            run = run_in(path)
            assert out == ""
            assert "ignored" not in err, "Python tells of errors while it exits"
            assert_failed(Finished(process.returncode, out, err), FULL)
            assert record_of(run)["status"] == "failed"
            kept = sorted(map(int, checkpoints_of(run)))
            assert kept == list(range(1, len(kept) + 1)) != []
            assert_rows_are_whole(run, kept[-1])
            # Room for one more checkpoint is enough to go on and to end.
            shutil.rmtree(run / "checkpoints" / "1")
            shutil.rmtree(run / "checkpoints" / "2")
            resumed = orchid("train", "--resume", run, "--quiet")
            assert_failed(resumed, FULL, "failed after")
            assert_rows_are_whole(run, kept[-1] + 1)


@pytest.fixture
def notices_anew(monkeypatch):
    """Nothing was said in this process yet."""
    monkeypatch.setattr(notices, "_told", set())


class TestFileSystemThatOffersLittle:
    """Shared folders of other systems and of clusters, emulated where a program meets them."""

    @pytest.fixture
    def offering_little(self, monkeypatch, notices_anew):
        def arrange(refusal: int) -> None:
            def refuse(*arguments, **options):
                raise OSError(refusal, os.strerror(refusal))

            fsync = os.fsync

            def fsync_of_files(descriptor):
                if stat.S_ISDIR(os.fstat(descriptor).st_mode):
                    refuse()
                fsync(descriptor)

            monkeypatch.setattr(os, "fsync", fsync_of_files)
            monkeypatch.setattr(os, "chmod", refuse)
            monkeypatch.setattr(pytest.importorskip("fcntl"), "flock", refuse)

        return arrange

    # What all three are known to answer; and each is known to answer.
    @pytest.mark.parametrize("refusal", [errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOSYS])
    def test_is_told_once_and_costs_nothing(
        self, orchid, runs_dir, new_runs, undisturbed, offering_little, refusal
    ):
        wanted = undisturbed(*EIGHT)
        offering_little(refusal)
        finished = orchid(*TRAIN, *EIGHT, "--runs-dir", runs_dir)
        assert finished.code == 0, finished.err
        [run] = new_runs()
        assert learned_files(run) == wanted
        warnings = finished.err.splitlines()
        assert len(warnings) == 3, finished.err
        assert all(line.startswith("warning: ") for line in warnings)
        assert all(str(run) in line and os.strerror(refusal) in line for line in warnings)
        # It goes on, is exported, and is deleted, and all that was said before.
        extended = orchid("train", "--resume", run, "--episodes=10", "--quiet")
        assert extended.code == 0, extended.err
        assert extended.err.splitlines()[0].startswith("note: extended from 8 to 10")
        assert "warning" not in extended.err
        archive = runs_dir.parent / "run.zip"
        assert orchid("runs", "export", run, "--out", archive).code == 0
        assert orchid("runs", "delete", run, "--runs-dir", runs_dir, "--yes").code == 0
        imported = orchid("runs", "import", archive, "--runs-dir", runs_dir)
        assert (imported.code, imported.err) == (0, "")
        assert orchid("runs", "show", run).code == 0

    @pytest.mark.parametrize("refusal", [errno.EINVAL, errno.EBADF, errno.EACCES, errno.EPERM])
    def test_directories_that_cannot_be_synced(self, tmp_path, offering_little, refusal):
        offering_little(refusal)
        sync_directory(tmp_path)

    @pytest.mark.parametrize("failure", [errno.EIO, errno.ENOSPC, errno.EDQUOT])
    def test_a_failure_is_no_refusal(self, tmp_path, offering_little, failure):
        offering_little(failure)
        with pytest.raises(OSError, match=re.escape(os.strerror(failure))):
            sync_directory(tmp_path)

    def test_files_that_cannot_be_synced_are_written(self, tmp_path, monkeypatch, notices_anew):
        def refuse(descriptor):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

        monkeypatch.setattr(os, "fsync", refuse)
        write_atomically(tmp_path / "one", b"1")
        assert (tmp_path / "one").read_bytes() == b"1"


class TestReadOnly:
    def test_file_system_is_told_before_anything_is_computed(self, orchid, tmp_path):
        flags = ("--episodes=4", EVERY_SECOND)
        with mounted(tmp_path / "disk", 2**22) as path:
            assert orchid(*TRAIN, *flags, "--runs-dir", path / "runs").code == 0
            run = run_in(path / "runs")
            subprocess.run(["mount", "-o", "remount,ro", str(path)], check=True)
            before = fingerprint(path)
            began = time.monotonic()
            for command in (
                (*TRAIN, "--runs-dir", path / "runs"),
                ("train", "--resume", run, "--episodes", "700", "--quiet"),
            ):
                finished = orchid(*command)
                assert finished.code == 2
                *notes, error = finished.err.splitlines()
                assert all(note.startswith("note: ") for note in notes)
                assert error.startswith("error: cannot ")
                assert "Read-only file system" in error
                assert str(path) in error
            assert time.monotonic() - began < 10
            shown = orchid("runs", "show", run, "--json")
            assert json.loads(shown.out)["status"] == "completed"
            assert read_policy(run).run == run.name, "what can be read can be evaluated"
            assert fingerprint(path) == before

    @pytest.fixture
    def one_bound_by_permissions(self, undisturbed):
        """A folder for a process that permissions bind, as they do not bind root."""
        undisturbed(*EIGHT)
        folder = Path(tempfile.mkdtemp(prefix="orchid-test-"))
        try:
            with without_privileges():
                yield folder
        finally:
            for path in folder.rglob("*"):
                if path.is_dir():
                    path.chmod(stat.S_IRWXU)
            shutil.rmtree(folder)

    def test_directory_of_runs_is_told(self, one_bound_by_permissions, orchid):
        one_bound_by_permissions.chmod(0o555)
        finished = orchid(*TRAIN, "--runs-dir", one_bound_by_permissions)
        assert_is_an_error(finished, str(one_bound_by_permissions), "Permission denied", code=2)
        assert list(one_bound_by_permissions.iterdir()) == []

    @pytest.mark.parametrize("folder", [".", "checkpoints"])
    def test_directory_during_a_run_costs_nothing_that_was_done(
        self, undisturbed, one_bound_by_permissions, orchid, at_episode, folder
    ):
        wanted = undisturbed(*EIGHT)
        runs_dir = one_bound_by_permissions / "runs"
        at_episode(5, lambda: (run_in(runs_dir) / folder).chmod(0o555))
        finished = orchid(*TRAIN, *EIGHT, "--runs-dir", runs_dir)
        run = run_in(runs_dir)
        (run / folder).chmod(0o755)
        record = read_record(run)
        if folder == "checkpoints":
            assert_failed(finished, "Permission denied", "checkpoint of episode 4 is kept")
            assert record.status == "failed"
            assert checkpoints_of(run) == ["2", "4"]
        else:  # the run's record cannot be written, nor its policy
            assert_failed(finished, "Permission denied", "failed after 8 episodes")
            assert status_of(run, record) == "died"
        resumed = orchid("train", "--resume", run, "--quiet")
        assert resumed.code == 0, resumed.err
        assert learned_files(run) == wanted


class TestClock:
    @pytest.fixture
    def clock(self, monkeypatch):
        """A clock that goes back by an hour whenever it is looked at."""

        class Backwards(datetime):
            moment = datetime(2031, 5, 6, 7, 8, 9, tzinfo=UTC)

            @classmethod
            def now(cls, tz=None):
                cls.moment -= timedelta(hours=1)
                return cls.moment.astimezone(tz)

        monkeypatch.setattr(run_directory, "datetime", Backwards)
        monkeypatch.setattr(time, "time", lambda: Backwards.now(UTC).timestamp())
        monkeypatch.setattr(tensorboard_tracker, "time", SimpleNamespace(time=time.time))
        return Backwards

    def test_that_goes_back_all_the_time_changes_no_run(
        self, orchid, runs_dir, new_runs, at_episode, undisturbed, clock
    ):
        wanted = undisturbed(*EIGHT)

        def stop():
            raise OSError("stopped here")

        at_episode(5, stop)
        assert orchid(*TRAIN, *EIGHT, "--runs-dir", runs_dir).code == 1
        [run] = new_runs()
        before = read_record(run)
        assert 0.0 <= before.seconds < 60
        resumed = orchid("train", "--resume", run)
        assert resumed.code == 0, resumed.err
        assert "continuing after episode 4" in resumed.out
        assert learned_files(run) == wanted
        after = read_record(run)
        assert before.seconds <= after.seconds < 60
        assert after.started == before.started
        listed = orchid("runs", "list", "--runs-dir", runs_dir, "--json")
        assert run.name in listed.out
        # A run is told by its own id from one that began "later", and from one in the same second.
        clock.moment += timedelta(hours=4)
        for _ in range(4):
            assert orchid(*TRAIN, "--episodes=1", "--runs-dir", runs_dir).code == 0
            clock.moment = datetime(2031, 5, 6, tzinfo=UTC)
        assert len({record_of(path)["id"] for path in new_runs()}) == len(new_runs()) == 5

    def test_that_gave_checkpoints_wrong_times_does_not_decide_which_is_newest(
        self, orchid, runs_dir, new_runs, at_episode, undisturbed
    ):
        flags = ("--episodes=10", EVERY_SECOND)
        wanted = undisturbed(*flags)

        def stop():
            raise OSError("stopped here")

        at_episode(9, stop)
        assert orchid(*TRAIN, *flags, "--runs-dir", runs_dir).code == 1
        [run] = new_runs()
        assert checkpoints_of(run) == ["4", "6", "8"]
        for age, episode in enumerate((4, 6, 8)):  # "10" would sort before them by name
            moment = 2_000_000_000 - 86_400 * 365 * 20 * age
            for path in (*(run / "checkpoints" / str(episode)).iterdir(), run / "checkpoints"):
                os.utime(path, (moment, moment))
            os.utime(run / "checkpoints" / str(episode), (moment, moment))
        resumed = orchid("train", "--resume", run)
        assert resumed.code == 0, resumed.err
        assert "continuing after episode 8" in resumed.out
        assert learned_files(run) == wanted
        assert checkpoints_of(run) == ["10", "6", "8"]


class TestNoNumbers:
    """Rates of learning at which it really diverges."""

    @pytest.fixture
    def written(self, monkeypatch):
        """Whether the weights of each checkpoint that is written are finite, by number."""
        noted = []
        save = checkpoints.save

        def note(tensors):
            noted.append(all(np.isfinite(array).all() for array in tensors.values()))
            return save(tensors)

        monkeypatch.setattr(checkpoints, "save", note)
        return noted

    @pytest.mark.parametrize(
        ("flags", "every"),
        [
            (["--set=ppo.actor_learning_rate=1e30"], 1),
            (["--set=ppo.critic_learning_rate=1e30"], 1000),
            (LATE, 1),
            (LATE, 1000),
            # The loss is finite, the weights after it are not.
            (["--set=ppo.actor_learning_rate=1e39", "--set=ppo.epochs=1"], 1),
            (["--set=ppo.actor_learning_rate=1e39", "--set=ppo.epochs=1"], 1000),
            ([*MADDPG, "--set=maddpg.actor_learning_rate=1e30"], 1),
            ([*MADDPG, "--set=maddpg.critic_learning_rate=1e30"], 1),
            ([*MADDPG, "--set=maddpg.critic_learning_rate=1e39"], 1000),
        ],
    )
    def test_end_a_run_whose_last_good_checkpoint_stays(
        self, orchid, runs_dir, new_runs, written, flags, every
    ):
        flags = [*flags, f"--set=checkpoint.every_episodes={every}", "--episodes=40"]
        finished = orchid(*TRAIN, *flags, "--runs-dir", runs_dir)
        [run] = new_runs()
        # What overflows first, and so which check meets it, depends on the processor.
        assert_failed(finished, r"DivergedError: (after )?update \d+.* is (-?inf|nan|not )")
        record = record_of(run)
        assert record["status"] == "failed"
        assert re.search(r"update \d+", record["error"])
        assert "tensor(" not in record["error"]
        assert not (run / "policy.safetensors").exists()
        assert_rows_are_whole(run, 0)
        kept = sorted(map(int, checkpoints_of(run)))
        if every == 1:
            # Of the last episode there is none where its own update led to such weights.
            last = kept[-1] if kept else 0
            assert last in (record["episodes"], record["episodes"] - 1)
            assert kept == list(range(1, last + 1))[-3:]
        told = f"checkpoint of episode {kept[-1]} is kept" if kept else "no checkpoint yet"
        assert told in finished.err
        assert all(written)
        for episode in kept:
            for path in (run / "checkpoints" / str(episode)).glob("*.safetensors"):
                tensors = safetensors.numpy.load_file(path)
                assert all(np.isfinite(tensor).all() for tensor in tensors.values())
        before = fingerprint(run / "checkpoints")
        again = orchid("train", "--resume", run, "--quiet")
        assert again.code == 1
        assert again.err == finished.err
        assert record_of(run)["error"] == record["error"]
        assert fingerprint(run / "checkpoints") == before

    @pytest.mark.parametrize(
        ("flags", "part", "told"),
        [
            ([], "actor", r"after update 0: an action is not a finite number"),
            ([], "critic", r"update \d+: \w+_loss is nan"),
            (MADDPG, "actor", r"after update 0: an action is not a finite number"),
            (MADDPG, "critic", r"update 1: (actor|critic)_loss is nan"),
            (MADDPG, "target", r"update 1: (actor|critic)_loss is nan"),
        ],
    )
    def test_are_told_by_what_they_are_met_in(
        self, orchid, runs_dir, monkeypatch, flags, part, told
    ):
        build_model = training.build_model

        def build_with_nan(config, env):
            model = build_model(config, env)
            for name, weights in model.policy.state_dict().items():
                if part in name:
                    weights.fill_(np.nan)
            return model

        monkeypatch.setattr(training, "build_model", build_with_nan)
        finished = orchid(*TRAIN, *flags, "--episodes=40", "--runs-dir", runs_dir)
        assert_failed(finished, rf"failed after \d+ episodes: DivergedError: {told}")

    @pytest.mark.parametrize(
        "flags",
        [
            LATE,
            [*MADDPG, "--set=maddpg.critic_learning_rate=1e30"],
        ],
    )
    def test_come_late_enough_for_checkpoints_before(self, orchid, runs_dir, new_runs, flags):
        flags = [*flags, "--set=checkpoint.every_episodes=1", "--episodes=40"]
        assert orchid(*TRAIN, *flags, "--runs-dir", runs_dir).code == 1
        [run] = new_runs()
        assert len(checkpoints_of(run)) > 1


@pytest.mark.skipif(os.name != "posix", reason="fork and terminals are POSIX")
class TestOutput:
    """The command as a process whose standard output and error lead somewhere else."""

    @pytest.fixture
    def start(self, plain_environment, runs_dir):
        """Calls start ``orchid train`` on descriptors; they give the number of the process."""
        started = []

        def start(*flags: str, out: int, err: int, before: Callable[[], object] = bool) -> int:
            def run() -> None:
                before()
                for number, lead in ((0, out), (1, out), (2, err)):
                    os.dup2(lead, number)
                sys.stdout, sys.stderr = (os.fdopen(number, "w") for number in (1, 2))
                from orchid_uav.__main__ import main as command

                sys.argv = ["orchid", "train", *TINY_FLAGS, "--no-rf", *flags]
                sys.argv += ["--runs-dir", str(runs_dir)]
                with signals_by_default():
                    os._exit(command())

            started.append(forked(run))
            return started[-1]

        yield start
        for number in started:
            with suppress(ProcessLookupError, ChildProcessError):
                os.kill(number, signal.SIGKILL)
                os.waitpid(number, 0)

    @pytest.fixture
    def log(self, tmp_path) -> Iterator[int]:
        with (tmp_path / "log").open("w") as file:
            yield file.fileno()

    @staticmethod
    def code_of(number: int) -> int:
        deadline = time.monotonic() + GIVE_UP_AFTER_S
        while time.monotonic() < deadline:
            ended, status = os.waitpid(number, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status)
            time.sleep(0.01)
        raise AssertionError("it does not end")

    @staticmethod
    def until_rows(new_runs: Callable[[], list[Path]], count: int = 3) -> Path:
        deadline = time.monotonic() + GIVE_UP_AFTER_S
        while time.monotonic() < deadline:
            for run in new_runs():
                log = run / "episodes.csv"
                if log.is_file() and log.read_bytes().count(b"\n") > count:
                    return run
            time.sleep(0.01)
        raise AssertionError("no episodes")

    @staticmethod
    def broken_pipe() -> int:
        read, write = os.pipe()
        os.close(read)
        return write

    @staticmethod
    def full_device() -> int:
        if not Path("/dev/full").exists():
            pytest.skip("no /dev/full")
        return os.open("/dev/full", os.O_WRONLY)

    @staticmethod
    def closed_terminal() -> int:
        master, slave = os.openpty()
        os.close(master)
        return slave

    @pytest.mark.parametrize("lost", ["broken_pipe", "full_device", "closed_terminal"])
    @pytest.mark.parametrize("flags", [(), ("--json", "--quiet")])
    def test_that_is_lost_costs_a_run_nothing_but_its_exit_code(
        self, start, new_runs, undisturbed, log, tmp_path, lost, flags
    ):
        out = getattr(self, lost)()
        assert self.code_of(start(*EIGHT, *flags, out=out, err=log)) == 1
        os.close(out)
        [run] = new_runs()
        assert record_of(run)["status"] == "completed"
        assert learned_files(run) == undisturbed(*EIGHT)
        [line] = (tmp_path / "log").read_text().splitlines()
        assert line.startswith("error: cannot write the output: ")

    @pytest.mark.parametrize("lost", ["broken_pipe", "full_device", "closed_terminal"])
    def test_of_errors_that_is_lost_costs_nothing_at_all(
        self, start, new_runs, undisturbed, log, lost
    ):
        err = getattr(self, lost)()
        # A warning is written there.
        assert self.code_of(start(*EIGHT, "--kappa=0.5", out=log, err=err)) == 0
        os.close(err)
        [run] = new_runs()
        assert learned_files(run) == undisturbed(*EIGHT)

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_that_is_lost_as_a_signal_comes_lets_the_run_save(self, start, new_runs, number):
        # orchid train 2>&1 | tee log, and a ctrl-C for both.
        out = self.broken_pipe()
        process = start("--episodes=100000", out=out, err=out)
        os.close(out)
        run = self.until_rows(new_runs)
        os.kill(process, number)
        assert self.code_of(process) == 130
        self.assert_saved(run)

    def test_on_a_terminal_that_is_closed_lets_the_run_save(self, start, new_runs):
        import fcntl
        import termios

        master, slave = os.openpty()

        def take_terminal() -> None:
            os.close(master)
            os.setsid()
            fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

        process = start("--episodes=100000", out=slave, err=slave, before=take_terminal)
        os.close(slave)
        shown = b""
        while b"last episode" not in shown:  # the display is there
            shown += os.read(master, 2**16)
        run = self.until_rows(new_runs)
        os.close(master)  # SIGHUP, and an error at every write from here on
        assert self.code_of(process) == 130
        self.assert_saved(run)

    def assert_saved(self, run: Path) -> None:
        record = record_of(run)
        assert record["status"] == "interrupted"
        assert record["error"] is None
        assert str(record["episodes"]) in checkpoints_of(run)
        assert_rows_are_whole(run, 3)

    def test_that_is_closed_is_found_in_no_file_of_the_run(
        self, start_process, plain_environment, new_runs, runs_dir
    ):
        from tensorboard.backend.event_processing.event_file_loader import LegacyEventFileLoader

        command = [sys.executable, "-m", "orchid_uav", "train", *TINY_FLAGS, "--episodes=3"]
        command += ["--kappa=0.5", "--no-rf", "--runs-dir", str(runs_dir)]
        process = start_process(["sh", "-c", '"$0" "$@" <&- >&- 2>&-', *command])
        process.communicate(timeout=GIVE_UP_AFTER_S)
        assert process.returncode == 0
        [run] = new_runs()
        assert record_of(run)["status"] == "completed"
        assert (run / ".lock").read_bytes() == b""
        [events] = run.glob("events.*[0-9]")
        assert [event.step for event in LegacyEventFileLoader(str(events)).Load()] == [0, 1, 2, 3]
        assert_rows_are_whole(run, 3)
