"""One process a run: who gets the right to write it, and when that ends."""

import errno
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from orchid_uav import notices
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.provenance import boot_id
from orchid_uav.experiments.runs import lock as run_lock
from orchid_uav.experiments.runs.lock import LOCK_FILE, RunLock, is_alive
from orchid_uav.experiments.runs.records import RunRecord, status_of
from orchid_uav.notices import show_on_stderr
from tests.helpers.processes import forked

pytestmark = pytest.mark.skipif(os.name != "posix", reason="fork and signals are POSIX")

GIVE_UP_AFTER_S = 30.0


def record_saying(status, pid=None, boot=None) -> RunRecord:
    return RunRecord.model_construct(status=status, pid=pid, boot_id=boot)


@pytest.fixture
def run(tmp_path) -> Path:
    directory = tmp_path / "20260101T000000Z-lab-s0-abcd"
    directory.mkdir()
    return directory


@pytest.fixture
def no_patience(monkeypatch):
    """Who finds the lock taken gives up at once."""
    monkeypatch.setattr(run_lock, "_PATIENCE_S", 0.0)


@pytest.fixture
def holder(run):
    """Starts processes that hold the lock until they are killed; gives their ids."""
    started = []

    def start(hold=signal.pause) -> int:
        ready, tell = os.pipe()

        def task() -> None:
            lock = RunLock(run)
            os.write(tell, b"!")
            hold()
            lock.release()

        started.append(forked(task))
        os.close(tell)
        assert os.read(ready, 1) == b"!", "it did not get the lock"
        os.close(ready)
        return started[-1]

    yield start
    for child in started:
        kill(child)


def kill(child: int) -> None:
    try:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    except (ProcessLookupError, ChildProcessError):
        pass


class TestRight:
    def test_is_refused_while_another_process_has_it(self, run, holder, no_patience):
        holder()
        for _ in range(2):
            with pytest.raises(InputError, match=f"{run.name} is being written by another process"):
                RunLock(run)

    def test_is_refused_a_second_time_in_the_same_process(self, run, no_patience):
        lock = RunLock(run)
        with pytest.raises(InputError, match="another process"):
            RunLock(run)
        lock.release()

    def test_ends_with_its_release(self, run, no_patience):
        RunLock(run).release()
        RunLock(run).release()

    def test_ends_with_a_process_that_is_killed(self, run, holder, no_patience):
        for _ in range(3):
            kill(holder())
            assert not is_alive(run)
            RunLock(run).release()

    def test_is_not_inherited_by_programs_that_the_process_starts(self, run, holder, no_patience):
        # Trackers start servers, which live on when the run is killed.
        told, tell = os.pipe()

        def start_a_server() -> None:
            server = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
            os.write(tell, str(server.pid).encode())
            signal.pause()

        child = holder(start_a_server)
        server = int(os.read(told, 32))
        try:
            kill(child)
            os.kill(server, 0)  # it lives
            RunLock(run).release()
        finally:
            os.kill(server, signal.SIGKILL)
            os.close(told)
            os.close(tell)

    def test_goes_to_one_of_many_that_ask_at_once(self, run, no_patience):
        results, tell = os.pipe()
        wait, go = os.pipe()

        def contend() -> None:
            os.close(go)
            os.read(wait, 1)
            try:
                lock = RunLock(run)
            except InputError:
                os.write(tell, b"-")
                return
            os.write(tell, b"+")
            signal.pause()
            lock.release()

        children = [forked(contend) for _ in range(8)]
        os.close(wait)
        os.close(go)  # all of them begin
        os.close(tell)
        try:
            answers = b""
            while len(answers) < len(children):
                answer = os.read(results, 64)
                assert answer, "a process failed by itself"
                answers += answer
            assert sorted(answers) == sorted(b"+" + b"-" * 7)
        finally:
            for child in children:
                kill(child)
            os.close(results)

    def test_is_waited_for_while_somebody_only_looks(self, run, holder):
        # `orchid runs list` has the lock for an instant; here it is a rather long one.
        began = time.monotonic()
        holder(lambda: time.sleep(0.3))
        RunLock(run).release()
        assert time.monotonic() - began >= 0.3

    def test_in_a_directory_that_is_none_is_an_error_that_names_it(self, tmp_path):
        (tmp_path / "file").touch()
        for wrong in (tmp_path / "missing", tmp_path / "file"):
            with pytest.raises(InputError, match=f"cannot write to .*{wrong.name}"):
                RunLock(wrong)


class TestIsAlive:
    def test_only_while_the_lock_is_held(self, run, holder):
        assert not is_alive(run)
        child = holder()
        assert [is_alive(run) for _ in range(3)] == [True] * 3
        kill(child)
        assert [is_alive(run) for _ in range(3)] == [False] * 3

    def test_a_look_neither_takes_nor_leaves_anything(self, run, no_patience):
        is_alive(run)
        assert list(run.iterdir()) == []
        lock = RunLock(run)
        assert is_alive(run)
        lock.release()
        assert not is_alive(run)
        RunLock(run).release()
        assert [path.name for path in run.iterdir()] == [LOCK_FILE]

    def test_whatever_the_record_says_where_the_lock_can_be_asked(self, run):
        RunLock(run).release()
        assert not is_alive(run, os.getpid(), boot_id())

    @pytest.fixture
    def read_only(self, run, monkeypatch):
        """A directory of somebody else's, in which no lock can be opened."""
        RunLock(run).release()

        def refuse(lock, timeout):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(run_lock.FileLock, "acquire", refuse)
        return run

    def test_where_it_cannot_the_process_is_looked_for(self, read_only):
        mine = os.getpid(), boot_id()
        assert is_alive(read_only, *mine)
        child = forked(lambda: None)
        os.waitpid(child, 0)
        assert not is_alive(read_only, child, boot_id())

    @pytest.mark.skipif(boot_id() is None, reason="no boot id here")
    def test_a_process_from_before_the_machine_was_started_anew_is_gone(self, read_only):
        assert not is_alive(read_only, os.getpid(), "another")
        assert not is_alive(read_only, os.getpid())

    @pytest.mark.parametrize("pid", [None, 2**70, 2**31 - 1])
    def test_what_is_no_process_is_not_alive(self, read_only, pid):
        assert not is_alive(read_only, pid, boot_id())


class TestFileSystemWithoutLocks:
    REFUSALS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP, errno.ENOLCK, 524)

    @pytest.fixture(params=REFUSALS)
    def without_locks(self, request, run, monkeypatch):
        fcntl = pytest.importorskip("fcntl")
        monkeypatch.setattr(notices, "_told", set())

        def refuse(descriptor, operation):
            raise OSError(request.param, os.strerror(request.param))

        monkeypatch.setattr(fcntl, "flock", refuse)
        return run

    def test_the_right_is_taken_for_granted_with_one_warning(self, without_locks, capsys):
        show_on_stderr()
        first, second = RunLock(without_locks), RunLock(without_locks)
        [warning] = capsys.readouterr().err.splitlines()
        assert warning.startswith(f"warning: the file system of {without_locks} has no locks")
        first.release()
        second.release()

    def test_whether_it_is_alive_the_process_says(self, without_locks):
        lock = RunLock(without_locks)
        mine = os.getpid(), boot_id()
        assert is_alive(without_locks, *mine)
        child = forked(lambda: None)
        os.waitpid(child, 0)
        assert not is_alive(without_locks, child, boot_id())
        lock.release()
        assert status_of(without_locks, record_saying("running", *mine)) == "running"

    def test_a_failure_is_no_refusal(self, run, monkeypatch):
        def fail(descriptor, operation):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

        monkeypatch.setattr(pytest.importorskip("fcntl"), "flock", fail)
        with pytest.raises(InputError, match=re.escape(os.strerror(errno.EIO))):
            RunLock(run)


class TestStatus:
    @pytest.mark.parametrize("status", ["completed", "failed", "interrupted"])
    def test_of_a_run_that_has_ended_is_what_it_says(self, run, status):
        assert status_of(run, record_saying(status)) == status

    def test_of_one_that_says_it_is_running_depends_on_its_process(self, run, holder):
        record = record_saying("running")
        assert status_of(run, record) == "died"
        child = holder()
        assert status_of(run, record) == "running"
        kill(child)
        assert status_of(run, record) == "died"
