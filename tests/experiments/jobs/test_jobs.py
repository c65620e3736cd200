"""Jobs as real processes: how they end, are killed and stopped, and what is shown of them."""

import io
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from orchid_uav.cli.progress import displays
from orchid_uav.cli.progress.jobs import (
    LineJobProgress,
    LiveJobProgress,
    duration_text,
    job_progress,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.jobs import executor as executor_module
from orchid_uav.experiments.jobs import local_processes as jobs_module
from orchid_uav.experiments.jobs.child_process import describe_end
from orchid_uav.experiments.jobs.executor import JobEnd, JobProgress, Overview
from orchid_uav.experiments.jobs.local_processes import LocalProcesses
from orchid_uav.experiments.jobs.workload import Job, Workload, hours_text, last_end

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and sessions are POSIX")

GIVE_UP_AFTER_S = 30.0

PRELUDE = """
import os, signal, subprocess, sys, time
from pathlib import Path
here, name = Path(sys.argv[1]), sys.argv[2]
def write(kind, text="", mode="a"):
    # Complete or not there, so that nobody reads half a number.
    (here / f".{name}.{kind}").write_text(text)
    (here / f".{name}.{kind}").replace(here / f"{name}.{kind}")
def count(kind):
    with (here / f"{name}.{kind}").open("a") as file:
        file.write("x")
    return (here / f"{name}.{kind}").stat().st_size
"""

SAVES = """
asked = []
signal.signal(signal.SIGTERM, lambda *_: asked.append(1))
write("pid", str(os.getpid()))
while not asked:
    time.sleep(0.01)
time.sleep(0.3)  # time for a second one, which there must not be
write("saved", str(len(asked)))
sys.exit(130)
"""

DEAF = """
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-I", "-S", "-c", "import time; time.sleep(60)"])
write("grandchild", str(child.pid))
write("pid", str(os.getpid()))
time.sleep(60)
"""

WATCHES_ITS_INPUT = """
write("pid", str(os.getpid()))
sys.stdin.buffer.read()
write("eof")
"""


def command(directory, name, code):
    source = PRELUDE + textwrap.dedent(code)
    return (sys.executable, "-I", "-S", "-c", source, str(directory), name)


@pytest.fixture
def make(tmp_path):
    """Makes a job of Python code, which finds ``here``, ``name``, ``write`` and ``count``."""

    def job(name, code, fraction_done=lambda: 0.0, cost=1.0):
        log = tmp_path / "logs" / f"{name}.log"
        return Job(name, command(tmp_path, name, code), log, fraction_done, cost)

    return job


@pytest.fixture(autouse=True)
def _four_cores_and_no_patience(monkeypatch):
    """What is tested here waits and does not compute."""
    monkeypatch.setattr(jobs_module, "usable_cores", lambda: 4)
    monkeypatch.setattr(jobs_module, "_SECONDS_BETWEEN_LOOKS", 0.02)
    monkeypatch.setattr(jobs_module, "_SECONDS_BETWEEN_UPDATES", 0.1)


@pytest.fixture(autouse=True)
def _heeded_interrupts():
    """A shell starts background jobs, such as a whole test run, with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


class Recorder(JobProgress):
    """Notes what it is told; ``on_update`` is called with every overview."""

    def __init__(self, on_update=lambda overview: None):
        self.calls = []
        self.overviews = []
        self._on_update = on_update

    def begin(self, jobs, processes):
        self.calls.append(("begin", len(jobs), processes))

    def update(self, overview):
        self.overviews.append(overview)
        self._on_update(overview)

    def restarted(self, job, error):
        self.calls.append(("restarted", job.name, error))

    def stopping(self, running):
        self.calls.append(("stopping", running))

    def ended(self, end):
        self.calls.append(("ended", end.job.name, end.status))

    def end(self):
        self.calls.append(("end",))


def run(jobs, processes=2, progress=None):
    return LocalProcesses(processes).run(jobs, progress or Recorder())


def until(condition):
    give_up_s = time.monotonic() + GIVE_UP_AFTER_S
    while not condition():
        assert time.monotonic() < give_up_s
        time.sleep(0.02)


def is_running(pid):
    """A zombie, which waits for its exit code to be read, is not."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    with suppress(OSError):
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    return not Path("/proc/self").exists()


def pid_of(directory, name, kind="pid"):
    return int((directory / f"{name}.{kind}").read_text())


class TestEnds:
    def test_exit_codes_are_read_and_a_failure_stops_no_other_job(self, make):
        ends = run(
            [
                make("bad", "print('loading'); print('error: no such thing'); sys.exit(3)"),
                make("good", "time.sleep(0.2)"),
                make("stopped-by-others", "print('interrupted'); sys.exit(130)"),
                make("late", "print('done')"),
            ],
            processes=1,
        )
        assert [(end.job.name, end.status, end.code, end.tries, end.error) for end in ends] == [
            ("bad", "failed", 3, 1, "error: no such thing"),
            ("good", "completed", 0, 1, None),
            ("stopped-by-others", "failed", 130, 1, "interrupted"),
            ("late", "completed", 0, 1, None),
        ]
        assert ends[1].seconds >= 0.2

    def test_a_job_that_is_killed_goes_on_once(self, make, tmp_path):
        killed = []

        def kill(overview):
            if not killed and (tmp_path / "victim.pid").exists():
                killed.append(pid_of(tmp_path, "victim"))
                os.kill(killed[0], signal.SIGKILL)

        progress = Recorder(kill)
        victim = make(
            "victim",
            """
            if count("tries") == 1:
                write("pid", str(os.getpid()))
                time.sleep(60)
            """,
        )
        other = make("other", "time.sleep(0.1)")
        ends = run([victim, other], progress=progress)
        assert [(end.status, end.code, end.tries) for end in ends] == [
            ("completed", 0, 2),
            ("completed", 0, 1),
        ]
        assert (tmp_path / "victim.tries").read_text() == "xx"
        assert ("restarted", "victim", "killed by SIGKILL") in progress.calls
        assert not is_running(killed[0])

    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])
    def test_a_job_that_is_killed_twice_has_failed(self, make, tmp_path, number):
        code = f"print('busy'); count('tries'); os.kill(os.getpid(), {int(number)})"
        [end] = run([make("victim", code)])
        assert (end.status, end.code, end.tries) == ("failed", -number, 2)
        assert end.error == f"killed by {number.name}"
        assert (tmp_path / "victim.tries").read_text() == "xx"

    def test_the_error_is_that_of_the_last_try(self, make):
        code = "count('n') == 1 and os.kill(os.getpid(), 9); print('error: worse'); sys.exit(1)"
        [end] = run([make("victim", code)])
        assert (end.status, end.code, end.tries, end.error) == ("failed", 1, 2, "error: worse")

    def test_a_command_that_cannot_be_started_has_failed(self, make, tmp_path):
        (tmp_path / "logs" / "taken.log").mkdir(parents=True)
        (tmp_path / "data").write_text("no program")
        fraction_done = float
        ends = run(
            [
                Job("nowhere", ("no-such-command", "x"), tmp_path / "nowhere.log", fraction_done),
                Job("data", (str(tmp_path / "data"),), tmp_path / "data.log", fraction_done),
                Job("null", ("a\0b",), tmp_path / "null.log", fraction_done),
                make("taken", "pass"),
                make("good", "pass"),
            ]
        )
        assert [end.status for end in ends] == ["failed"] * 4 + ["completed"]
        assert [end.code for end in ends] == [None] * 4 + [0]
        for end, reason in zip(
            ends, ["'no-such-command'", "Permission", "null", "Is a directory"], strict=False
        ):
            assert end.error.startswith("cannot be started: ")
            assert reason in end.error

    def test_sigchld_that_a_caller_ignores_hides_no_exit_code(self, make):
        before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
        try:
            [end] = run([make("bad", "sys.exit(3)")])
            assert signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN
        finally:
            signal.signal(signal.SIGCHLD, before)
        assert (end.status, end.code) == ("failed", 3)

    def test_no_jobs_end_at_once(self):
        progress = Recorder()
        assert run([], progress=progress) == []
        assert progress.calls == [("begin", 0, 0), ("end",)]

    def test_two_jobs_of_one_name_are_refused(self, make):
        with pytest.raises(ValueError, match="same name"):
            run([make("a", "pass"), make("a", "pass")])

    @pytest.mark.parametrize("change", [{"command": ()}, {"cost": 0.0}, {"cost": float("nan")}])
    def test_a_job_that_cannot_be_is_refused(self, tmp_path, change):
        good = {
            "name": "a",
            "command": ("x",),
            "log": tmp_path,
            "fraction_done": float,
            "cost": 1.0,
        }
        Job(**good)
        with pytest.raises(ValueError, match="job 'a'"):
            Job(**good | change)


class TestProcesses:
    def test_as_many_run_at_once_as_are_allowed_the_first_ones_first(self, make, tmp_path):
        code = """
        began = time.monotonic()
        write("began")
        while len(list(here.glob("[a-g].began"))) < 3:
            time.sleep(0.01)
        time.sleep(0.1)
        write("times", f"{began} {time.monotonic()}")
        """
        names = list("abcdefg")
        ends = run([make(name, code) for name in names], processes=3)
        assert [end.status for end in ends] == ["completed"] * 7
        spans = [
            tuple(map(float, (tmp_path / f"{name}.times").read_text().split())) for name in names
        ]
        together = [sum(one <= begin < end for one, end in spans) for begin, _ in spans]
        assert max(together) == 3
        begins = [begin for begin, _ in spans]
        assert max(begins[:3]) < min(begins[3:])

    def test_never_more_than_the_cores_that_may_be_used(self, monkeypatch):
        monkeypatch.undo()
        cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count()
        many = LocalProcesses(10_000)
        assert many.processes == cores
        assert many.note.startswith(f"{cores} at once instead of 10000")
        one = LocalProcesses(1)
        assert (one.processes, one.note) == (1, None)

    def test_a_core_less_may_be_used_than_there_is(self, monkeypatch):
        monkeypatch.undo()
        if sys.platform != "linux":
            pytest.skip("affinity is Linux's")
        before = os.sched_getaffinity(0)
        try:
            os.sched_setaffinity(0, {min(before)})
            assert LocalProcesses(2).processes == 1
        finally:
            os.sched_setaffinity(0, before)

    @pytest.mark.parametrize("processes", [0, -1])
    def test_fewer_than_one_are_refused(self, processes):
        with pytest.raises(InputError, match=f"{processes} jobs at once: give 1 or more"):
            LocalProcesses(processes)

    def test_a_job_has_one_thread_a_session_and_an_open_input(self, make):
        [end] = run(
            [
                make(
                    "a",
                    """
                    import select
                    names = ["OMP", "OPENBLAS", "MKL", "NUMBA"]
                    threads = [os.environ[f"{one}_NUM_THREADS"] for one in names]
                    ready, _, _ = select.select([0], [], [], 0.2)
                    print(threads, os.environ["ORCHID_JOB"], os.getsid(0) == os.getpid(), ready)
                    """,
                )
            ]
        )
        assert end.job.log.read_text() == "['1', '1', '1', '1'] 1 True []\n"

    def test_nothing_is_left_open(self, make):
        def descriptors():
            return len(list(Path("/dev/fd").iterdir()))

        run([make("warm", "pass")])
        before = descriptors()
        run([make(name, "sys.exit(name == 'b')") for name in "abc"])
        assert descriptors() == before

    def test_jobs_run_outside_the_main_thread_where_signals_are_left_alone(self, make):
        ends, handlers = [], []
        before = signal.getsignal(signal.SIGINT)
        progress = Recorder(lambda overview: handlers.append(signal.getsignal(signal.SIGINT)))
        thread = threading.Thread(
            target=lambda: ends.extend(run([make("a", "pass")], progress=progress))
        )
        thread.start()
        thread.join(GIVE_UP_AFTER_S)
        assert [end.status for end in ends] == ["completed"]
        assert set(handlers) == {before}  # a slow machine is told of more than once


class TestErrorTexts:
    @pytest.mark.parametrize(
        ("log", "text"),
        [
            ("one\ntwo\n\n  \n", "two"),
            ("\x1b[1;31merror:\x1b[0m wrong\n", "error: wrong"),
            ("a \x1b]8;;x\x1b\\link\x1b]8;;\x1b\\\n", "a link"),
            ("1 %\rerror: 'x' is\nnot a number\n", "error: 'x' is not a number"),
            ("error: far away\nsomething\nTypeError: bad\n", "TypeError: bad"),
            ("tab\there \x07\n", "tab here"),
            (b"\xff\xfe\n", "\ufffd\ufffd"),
            ("x" * 301, "x" * 296 + " ..."),
            ("x" * 300, "x" * 300),
            ("y" * 100_000 + "\nend\n", "end"),
        ],
    )
    def test_are_the_last_words_without_control_codes(self, tmp_path, log, text):
        path = tmp_path / "log"
        path.write_bytes(log if isinstance(log, bytes) else log.encode())
        assert describe_end(1, path, 0) == text

    def test_of_an_empty_or_lost_log_name_the_exit_code(self, tmp_path):
        path = tmp_path / "log"
        assert describe_end(4, path, 0) == f"exit code 4, and nothing in {path}"

    def test_of_a_signal_name_it(self, tmp_path):
        assert describe_end(-11, tmp_path / "log", 0) == "killed by SIGSEGV"
        assert describe_end(-signal.SIGRTMIN - 1, tmp_path, 0) == (
            f"killed by signal {signal.SIGRTMIN + 1}"
        )

    def test_leave_out_what_an_earlier_try_has_logged(self, make):
        first = run([make("a", "print('error: first'); sys.exit(1)")])
        second = run([make("a", "sys.exit(4)")])
        assert first[0].error == "error: first"
        assert second[0].error.startswith("exit code 4, and nothing in ")
        assert second[0].job.log.read_text() == "error: first\n"


class TestShares:
    def test_that_cannot_be_told_stop_nothing(self, make):
        answers = iter([0.25, 0.5, OSError(), float("nan"), "x", None])

        def fraction_done():
            answer = next(answers)  # StopIteration at the end
            if isinstance(answer, Exception):
                raise answer
            return answer

        progress = Recorder()
        jobs = [
            make("broken", "time.sleep(0.8)", fraction_done),
            make("too-much", "time.sleep(0.2)", lambda: 7.0),
            make("too-little", "time.sleep(0.2)", lambda: -3.0),
        ]
        ends = run(jobs, processes=3, progress=progress)
        assert [end.status for end in ends] == ["completed"] * 3
        seen = [
            [fraction_done for job, fraction_done in overview.running if job.name == "broken"]
            for overview in progress.overviews
        ]
        # The first answer was for what had been done before.
        assert [one for one in seen if one][:5] == [[0.5]] * 5
        assert {
            (job.name, fraction_done)
            for overview in progress.overviews
            for job, fraction_done in overview.running
            if job.name != "broken"
        } == {("too-much", 1.0), ("too-little", 0.0)}

    def test_of_all_jobs_are_weighted_by_cost(self, make, tmp_path):
        def finish(overview):
            if overview.failed:
                (tmp_path / "finish").touch()

        waits = """
        while not (here / "finish").exists():
            time.sleep(0.02)
        """
        progress = Recorder(finish)
        jobs = [
            make("a", waits, lambda: 0.5, cost=3.0),
            make("b", waits, lambda: 0.25, cost=1.0),
            make("c", "sys.exit(1)", cost=4.0),
        ]
        run(jobs, processes=3, progress=progress)
        first = progress.overviews[0]
        second = next(overview for overview in progress.overviews if overview.failed)
        assert first.fraction_done == pytest.approx((3.0 * 0.5 + 1.0 * 0.25) / 8.0)
        assert (first.completed, first.failed) == (0, 0)
        # What has failed is over, too.
        assert second.fraction_done == pytest.approx((3.0 * 0.5 + 1.0 * 0.25 + 4.0) / 8.0)
        assert (second.completed, second.failed) == (0, 1)
        assert second.running == [(jobs[0], 0.5), (jobs[1], 0.25)]


def workload(costs, fractions, processes):
    """A workload whose fractions are read from a list that a test changes."""
    now = list(fractions)
    jobs = [
        Job(str(index), ("x",), Path("log"), lambda index=index: now[index], cost)
        for index, cost in enumerate(costs)
    ]
    return Workload(jobs, processes), now


class TestTimeLeft:
    def test_counts_only_what_was_done_since_the_beginning(self):
        # Two of four jobs were complete, a third half done. In 30 s that one has done 30 % more.
        load, fractions = workload([1, 1, 1, 1], [1.0, 1.0, 0.5, 0.0], processes=1)
        fractions[2] = 0.8
        load.look([2])
        assert load.fraction_done == pytest.approx(2.8 / 4)
        # 100 s a job: 20 s for the rest of this one, and 100 s for the next. That the complete
        # ones took 8 s each to say so tells nothing.
        left_s = load.seconds_left([2], [8.0, 8.0, 30.0, 0.0])
        assert left_s == pytest.approx(120.0)

    def test_knows_that_the_last_job_runs_alone(self):
        load, fractions = workload([1, 1, 1], [0.0, 0.0, 0.0], processes=2)
        fractions[:] = [0.5, 0.5, 0.0]
        load.look([0, 1])
        # 100 s a job and two at once: 50 s for both, 100 s for the third with an idle process.
        assert load.seconds_left([0, 1], [50.0, 50.0, 0.0]) == pytest.approx(150.0)

    @pytest.mark.parametrize(
        ("waiting", "busy", "expected"),
        [
            ([1.0] * 20, [0.0] * 16, 2.0),  # four in a second round, twelve processes idle
            ([5.0, 7.0], [0.0] * 16, 7.0),
            ([2.0, 3.0], [4.0, 1.0], 6.0),  # 1 + 2 on the second, and 3 behind that
            ([], [4.0, 1.0], 4.0),
        ],
    )
    def test_ends_with_the_last_job(self, waiting, busy, expected):
        assert last_end(waiting, busy) == expected

    @pytest.mark.parametrize(
        ("minutes", "processes", "expected"),
        [([], 2, "0 min"), ([20.2, 20.2], 1, "41 min"), ([50.0, 50.0, 50.0], 2, "1.7 hours")],
    )
    def test_is_told_in_hours(self, minutes, processes, expected):
        assert hours_text(minutes, processes) == expected

    def test_is_not_told_before_a_tenth_of_a_job(self):
        load, fractions = workload([1, 3], [0.5, 0.0], processes=1)  # 2 on average
        fractions[0] = 0.69
        load.look([0])
        assert load.seconds_left([0], [19.0, 0.0]) is None
        fractions[0] = 0.71
        load.look([0])
        assert load.seconds_left([0], [21.0, 0.0]) == pytest.approx(29.0 + 300.0)

    def test_does_not_wait_for_what_has_failed(self):
        load, fractions = workload([1, 1], [0.0, 0.0], processes=1)
        fractions[:] = [0.5, 0.5]
        load.look([0, 1])
        load.end(0, is_complete=False)
        assert load.fraction_done == 0.75
        assert load.seconds_left([1], [50.0, 50.0]) == pytest.approx(50.0)
        load.end(1, is_complete=True)
        assert (load.fraction_done, load.seconds_left([], [50.0, 100.0])) == (1.0, 0.0)

    def test_of_nothing_is_none_left(self):
        load, _ = workload([], [], processes=2)
        assert (load.fraction_done, load.seconds_left([], [])) == (1.0, 0.0)

    @given(
        works=st.lists(
            st.tuples(st.floats(0.1, 5.0), st.sampled_from([0.0, 0.0, 0.3, 0.9, 1.0])),
            min_size=1,
            max_size=12,
        ),
        processes=st.integers(1, 5),
        when=st.floats(0.0, 0.999),
        pace=st.floats(0.1, 1000.0),
    )
    def test_is_exact_where_all_jobs_keep_the_pace(self, works, processes, when, pace):
        # A timetable, laid out second by second without any estimate.
        free = [0.0] * processes
        spans = []
        for cost, first in works:
            process = free.index(min(free))
            begin_s = free[process]
            free[process] += cost * (1.0 - first) * pace
            spans.append((begin_s, free[process]))
        now_s = when * max(free)
        load, fractions = workload(
            [cost for cost, _ in works], [first for _, first in works], processes
        )
        seconds = [min(max(now_s - begin_s, 0.0), end_s - begin_s) for begin_s, end_s in spans]
        for index, (cost, first) in enumerate(works):
            fractions[index] = min(first + seconds[index] / (cost * pace), 1.0)
        running = []
        for index, (begin_s, end_s) in enumerate(spans):
            load.look([index])
            if end_s <= now_s:
                load.end(index, is_complete=True)
            elif begin_s <= now_s:
                running.append(index)
        left_s = load.seconds_left(running, seconds)
        if left_s is None:
            done = sum(
                cost * (fraction_done - first)
                for (cost, first), fraction_done in zip(works, fractions, strict=True)
            )
            assert done <= 0.1 * sum(cost for cost, _ in works) / len(works) + 1e-9
        else:
            assert left_s == pytest.approx(max(free) - now_s, rel=1e-6, abs=1e-6 * pace)


PARENT = """
import os, sys
from pathlib import Path
from orchid_uav.experiments.jobs import local_processes as jobs
here = Path(sys.argv[1])
jobs.usable_cores = lambda: 4
executor = jobs.LocalProcesses(2)
ends = executor.run(
    [
        jobs.Job(name, (sys.executable, "-I", "-S", "-c", sys.argv[2], str(here), name),
                 here / f"{name}.log", float)
        for name in ("first", "second", "third")
    ],
    jobs.JobProgress(),
)
for end in ends:
    print(end.job.name, end.status, end.code, end.tries, end.error, sep="|")
print(executor.was_stopped)
try:
    print("left", os.waitpid(-1, os.WNOHANG))
except ChildProcessError:
    print("none left, none unread")
"""


@pytest.fixture
def parent(tmp_path):
    """Starts a process that runs three jobs, two at once, and waits until these run."""
    started = []

    def start(code):
        process = subprocess.Popen(
            [sys.executable, "-c", PARENT, str(tmp_path), PRELUDE + code],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        until(lambda: all((tmp_path / f"{name}.pid").exists() for name in ("first", "second")))
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()
    for path in tmp_path.glob("*.pid"):
        with suppress(ProcessLookupError):
            os.kill(int(path.read_text()), signal.SIGKILL)


class TestStopping:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
    def test_asks_all_jobs_once_to_save_and_begins_no_other(self, parent, tmp_path, number):
        process = parent(SAVES)
        process.send_signal(number)
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert err == ""
        assert out.splitlines() == [
            "first|interrupted|130|1|None",
            "second|interrupted|130|1|None",
            "third|not started|None|0|None",
            "True",
            "none left, none unread",
        ]
        assert process.returncode == 0
        for name in ("first", "second"):
            assert (tmp_path / f"{name}.saved").read_text() == "1"  # SIGTERM came once
            assert not is_running(pid_of(tmp_path, name))
        assert not (tmp_path / "third.pid").exists()

    def test_a_second_time_kills_all_jobs_and_what_they_have_started(self, parent, tmp_path):
        process = parent(DEAF)
        process.send_signal(signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.2)  # they do not heed SIGTERM
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert err == ""
        assert out.splitlines()[:2] == [
            "first|interrupted|-9|1|killed by SIGKILL",
            "second|interrupted|-9|1|killed by SIGKILL",
        ]
        for name in ("first", "second"):
            assert not is_running(pid_of(tmp_path, name))
            grandchild = pid_of(tmp_path, name, "grandchild")
            until(lambda pid=grandchild: not is_running(pid))

    @pytest.mark.parametrize(
        ("first", "second"),
        [
            (signal.SIGHUP, signal.SIGHUP),
            (signal.SIGTERM, signal.SIGTERM),
            (signal.SIGINT, signal.SIGINT),
        ],
    )
    def test_by_a_terminal_or_a_batch_system_that_tells_it_twice_is_no_hurry(
        self, parent, tmp_path, first, second
    ):
        process = parent(SAVES)
        process.send_signal(first)
        time.sleep(0.2)
        process.send_signal(second)
        out, _ = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert out.startswith("first|interrupted|130|")
        assert (tmp_path / "first.saved").read_text() == "1"

    def test_is_known_even_if_every_job_completes(self, make, tmp_path):
        handler = signal.getsignal(signal.SIGINT)
        last = """
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        write("pid", str(os.getpid()))
        time.sleep(0.4)
        """

        def stop(overview):
            if (tmp_path / "last.pid").exists() and not executor.was_stopped:
                signal.raise_signal(signal.SIGINT)

        progress = Recorder(stop)
        fractions = iter([0.0])
        executor = LocalProcesses(2)
        ends = executor.run([make("last", last, lambda: next(fractions, 0.5))], progress)
        assert [end.status for end in ends] == ["completed"]
        assert executor.was_stopped
        assert ("stopping", 1) in progress.calls
        # Nobody knows how long saving takes.
        left = [overview.seconds_left is None for overview in progress.overviews]
        assert left == [False] * left.count(False) + [True] * left.count(True)
        assert set(left) == {False, True}
        assert signal.getsignal(signal.SIGINT) is handler
        executor.run([make("next", "pass")], JobProgress())
        assert not executor.was_stopped

    def test_begins_no_job_even_in_the_middle_of_beginning_some(self, make, tmp_path):
        class Stopper(Recorder):
            def ended(self, end):
                super().ended(end)
                if end.job.name == "nowhere":
                    signal.raise_signal(signal.SIGINT)

        nowhere = Job("nowhere", ("no-such-command",), tmp_path / "nowhere.log", float)
        ends = run([nowhere, make("next", "pass")], progress=Stopper())
        assert [end.status for end in ends] == ["failed", "not started"]
        assert [end.tries for end in ends] == [1, 0]

    def test_runs_no_killed_job_again(self, make, tmp_path):
        def stop(overview):
            if (tmp_path / "a.tries").exists() and not executor.was_stopped:
                signal.raise_signal(signal.SIGTERM)

        executor = LocalProcesses(1)
        job = make("a", "count('tries'); time.sleep(60)")  # dies of SIGTERM, as a Python starting
        [end] = executor.run([job], Recorder(stop))
        assert (end.status, end.code, end.tries) == ("interrupted", -signal.SIGTERM, 1)
        assert (tmp_path / "a.tries").read_text() == "x"

    def test_leaves_ignored_signals_ignored(self, make):
        before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        try:
            progress = Recorder(lambda overview: signal.raise_signal(signal.SIGHUP))
            executor = LocalProcesses(1)
            [end] = executor.run([make("a", "pass")], progress)
        finally:
            signal.signal(signal.SIGHUP, before)
        assert end.status == "completed"
        assert not executor.was_stopped

    def test_jobs_see_the_end_of_a_parent_that_is_killed(self, parent, tmp_path):
        process = parent(WATCHES_ITS_INPUT)
        time.sleep(0.3)
        assert not list(tmp_path.glob("*.eof"))
        process.kill()
        process.wait()
        until(lambda: len(list(tmp_path.glob("*.eof"))) == 2)
        for name in ("first", "second"):
            pid = pid_of(tmp_path, name)
            until(lambda pid=pid: not is_running(pid))


class BreakingError(Exception):
    pass


class TestExceptions:
    def broken_at(self, monkeypatch, call, tmp_path, error=BreakingError):
        """A display that breaks in ``call``, once a job has said its number."""

        class Broken(Recorder):
            pass

        def breaking(self, *arguments):
            if (tmp_path / "long.pid").exists():
                raise error

        monkeypatch.setattr(Broken, call, breaking)
        return Broken()

    @pytest.mark.parametrize(
        ("call", "error"),
        [
            ("update", BreakingError),
            ("update", KeyboardInterrupt),
            ("ended", BreakingError),
            ("restarted", BreakingError),
        ],
    )
    def test_of_the_display_let_the_jobs_save_and_leave_none(
        self, make, tmp_path, monkeypatch, call, error
    ):
        before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
        progress = self.broken_at(monkeypatch, call, tmp_path, error)
        dies = """
        while not (here / "long.pid").exists():
            time.sleep(0.02)
        os.kill(os.getpid(), 9)
        """
        with pytest.raises(error):
            run([make("long", SAVES), make("short", dies)], progress=progress)
        assert (tmp_path / "long.saved").read_text() == "1"
        assert not is_running(pid_of(tmp_path, "long"))
        assert progress.calls[-1] == ("end",)
        assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]

    def test_kill_jobs_that_do_not_stop(self, make, tmp_path, monkeypatch):
        monkeypatch.setattr(executor_module, "_SECONDS_TO_SAVE", 0.3)
        progress = self.broken_at(monkeypatch, "update", tmp_path)
        began_s = time.monotonic()
        with pytest.raises(BreakingError):
            run([make("long", DEAF)], progress=progress)
        assert time.monotonic() - began_s < GIVE_UP_AFTER_S  # half of what they sleep
        assert not is_running(pid_of(tmp_path, "long"))
        until(lambda: not is_running(pid_of(tmp_path, "long", "grandchild")))


class TestDisplays:
    def jobs(self, make):
        waits = """
        while len(list(here.glob("*.last"))) < 2:
            time.sleep(0.02)
        time.sleep(0.4)
        """
        killed = "count('n') == 1 and os.kill(os.getpid(), 9); write('last')"
        return [
            make("base-s0[red]", waits, lambda: 0.25),
            make("bad", "print('error: [red]wrong'); write('last'); sys.exit(3)"),
            make("killed", killed),
        ]

    def test_a_log_has_a_line_for_every_end(self, make, monkeypatch):
        monkeypatch.setattr(displays, "SECONDS_BETWEEN_LINES", 0.0)
        file = io.StringIO()
        jobs = self.jobs(make)
        run(jobs, processes=3, progress=LineJobProgress(Console(file=file, soft_wrap=True)))
        lines = file.getvalue().splitlines()
        assert lines[0] == "3 jobs, 3 at once"
        assert lines[1] == "8%: base-s0[red] 25%, bad 0%, killed 0%"  # 0.25 of 3
        assert (
            "killed: killed by SIGKILL; it is run once more and continues where it stopped" in lines
        )
        failure = next(line for line in lines if line.startswith("bad: failed after 0:00:0"))
        assert f": error: [red]wrong ({jobs[1].log}); " in failure
        assert lines[-1].startswith("base-s0[red]: completed after 0:00:0")
        assert lines[-1].endswith("; 3 of 3")

    def test_a_terminal_has_bars_while_jobs_run_and_lines_for_what_went_wrong(self, make, tmp_path):
        file = io.StringIO()
        console = Console(file=file, force_terminal=True, width=100, color_system=None)
        run(self.jobs(make), processes=3, progress=LiveJobProgress(console))
        shown = file.getvalue()
        assert "base-s0[red]" in shown
        assert "25 %" in shown
        assert "1 of 3, 1 failed" in shown
        assert "error: [red]wrong" in shown
        assert "killed by SIGKILL; it is run once more" in shown
        assert shown.count("\x1b[?25l") == shown.count("\x1b[?25h") == 1  # the cursor is back

    @pytest.mark.parametrize("display", [LineJobProgress, LiveJobProgress])
    def test_tells_the_time_left_and_who_saves(self, make, monkeypatch, display):
        monkeypatch.setattr(displays, "SECONDS_BETWEEN_LINES", 0.0)
        file = io.StringIO()
        progress = display(Console(file=file, force_terminal=True, width=100, color_system=None))
        job = make("a", "pass")
        progress.begin([job, make("b", "pass")], 1)
        progress.update(Overview(0.3, 3723.4, [(job, 0.6)], 0, 0))
        progress.stopping(2)
        progress.stopping(1)
        progress.end()
        shown = file.getvalue()
        assert "1:02:03 left" in shown
        assert "stopping: 2 jobs save what they have; Ctrl-C once more stops at once" in shown
        assert "stopping: 1 job saves what it has;" in shown

    def test_a_bar_goes_with_its_job(self, make):
        file = io.StringIO()
        progress = LiveJobProgress(Console(file=file, force_terminal=True, width=100))
        job = make("a-job", "pass")
        progress.begin([job], 1)
        progress.update(Overview(0.3, None, [(job, 0.6)], 0, 0))
        progress.ended(JobEnd(job, "completed", 0, 1, 1.0, None))
        before = len(file.getvalue())
        progress.update(Overview(1.0, 0.0, [], 1, 0))
        progress.end()
        last = file.getvalue()[before:]
        assert "1 of 1" in last
        assert "a-job" not in last

    def test_suit_the_console(self):
        terminal = Console(file=io.StringIO(), force_terminal=True)
        assert isinstance(job_progress(terminal, quiet=False), LiveJobProgress)
        assert type(job_progress(terminal, quiet=True)) is JobProgress
        assert isinstance(job_progress(Console(file=io.StringIO()), quiet=False), LineJobProgress)

    def test_write_durations_in_hours(self):
        assert [duration_text(s) for s in (0.4, 59.6, 3723.0)] == ["0:00:00", "0:01:00", "1:02:03"]
