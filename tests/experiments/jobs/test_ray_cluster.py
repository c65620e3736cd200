"""Jobs on a Ray cluster: lost machines, what is checked before, and real clusters of two nodes."""

import _thread
import dataclasses
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections import deque
from contextlib import suppress
from pathlib import Path

import pytest

from orchid_uav import notices
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.jobs import ray_cluster, ray_tasks
from orchid_uav.experiments.jobs.choice import executor_for
from orchid_uav.experiments.jobs.executor import JobProgress, JobRun, TryEnd
from orchid_uav.experiments.jobs.local_processes import LocalProcesses
from orchid_uav.experiments.jobs.ray_cluster import RayCluster
from orchid_uav.experiments.jobs.workload import Job
from orchid_uav.experiments.provenance import describe_versions
from orchid_uav.extras import install_command
from tests.helpers.processes import TINY_FLAGS, assert_is_an_error, learned_files, record_of

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and sessions are POSIX")

HAS_RAY = importlib.util.find_spec("ray") is not None
NEEDS_RAY = pytest.mark.skipif(
    not HAS_RAY, reason="Ray, the extra 'ray', is not installed: make test-ray"
)
GIVE_UP_AFTER_S = 400.0


def job(name, *command):
    return Job(name, command or ("x",), Path("log"), float)


class Told(JobProgress):
    def __init__(self):
        self.restarts = []
        self.most_running = []

    def restarted(self, job, error):
        self.restarts.append((job.name, error))

    def update(self, overview):
        self.most_running.append(len(overview.running))


class Scripted:
    """A place where each try of a job ends with the next of its codes; None is a lost machine."""

    seconds_between_updates = 0.0

    def __init__(self, codes, most_losses=2, capacities=(2,)):
        self.codes = {name: deque(of_job) for name, of_job in codes.items()}
        self.most_losses = most_losses
        self.capacities = deque(capacities)
        self.running = []
        self.began = []

    def capacity(self):
        return self.capacities[0]

    def start(self, one):
        self.running.append(one.name)
        self.began.append(one.name)

    def collect(self):
        if len(self.capacities) > 1:
            self.capacities.popleft()
        if self.running:
            name = self.running.pop(0)
            yield TryEnd(name, self.codes[name].popleft(), f"end of {name}")

    def stop(self):
        pass

    kill = close = stop


def run_at(place, progress=None):
    jobs = [job(name) for name in place.codes]
    return JobRun(jobs, place, progress or Told(), Interruption()).run()


class TestLostMachines:
    def test_their_jobs_are_run_again_a_few_times(self):
        told = Told()
        ends = run_at(Scripted({"a": [None, None, 0], "b": [0]}), told)
        assert [(end.status, end.code, end.tries) for end in ends] == [
            ("completed", 0, 3),
            ("completed", 0, 1),
        ]
        assert told.restarts == [("a", "end of a")] * 2

    def test_are_not_run_again_for_ever(self):
        [end] = run_at(Scripted({"a": [None] * 9}, most_losses=2))
        assert (end.status, end.code, end.tries, end.error) == ("failed", None, 3, "end of a")

    def test_are_counted_apart_from_what_kills_a_process(self):
        [end] = run_at(Scripted({"a": [None, -9, None, 0]}, most_losses=2))
        assert (end.status, end.tries) == ("completed", 4)
        [end] = run_at(Scripted({"a": [-9, None, -11]}, most_losses=2))
        assert (end.status, end.code, end.tries) == ("failed", -11, 3)

    def test_a_run_that_fails_is_no_lost_one(self):
        place = Scripted({"a": [1, 0], "b": [0]})
        ends = run_at(place)
        assert [(end.status, end.code, end.tries) for end in ends] == [
            ("failed", 1, 1),
            ("completed", 0, 1),
        ]
        assert place.began == ["a", "b"]

    def test_leave_fewer_jobs_at_once_and_new_ones_let_more_begin(self):
        told = Told()
        codes = {name: [0] for name in "abcdefgh"}
        ends = run_at(Scripted(codes, capacities=[2, 2, 0, 0, 0, 3]), told)
        assert [end.status for end in ends] == ["completed"] * 8
        assert told.most_running[:6] == [2, 2, 1, 0, 0, 3]


class TestChoice:
    def test_nothing_but_the_option_joins_a_cluster(self, monkeypatch):
        monkeypatch.setenv("RAY_ADDRESS", "auto")
        monkeypatch.setattr(ray_cluster, "_Driver", None)
        executor = executor_for(None, None)
        assert isinstance(executor, LocalProcesses)
        assert "ray" not in sys.modules or HAS_RAY

    @pytest.mark.parametrize(
        "address", ["", "head", "head:", ":6379", "head:port", "a b:1", "ray://head:10001", "Auto"]
    )
    def test_an_address_that_is_none_is_refused_at_once(self, monkeypatch, address):
        monkeypatch.setattr(ray_cluster, "_Driver", None)
        with pytest.raises(InputError, match="give auto, local or HOST:PORT"):
            executor_for(None, address)

    def test_fewer_than_one_job_is_refused(self, monkeypatch):
        monkeypatch.setattr(ray_cluster, "_Driver", None)
        with pytest.raises(InputError, match="0 jobs at once: give 1 or more"):
            executor_for(0, "local")

    @pytest.mark.skipif(HAS_RAY, reason="Ray is installed")
    def test_without_ray_the_command_says_what_installs_it(self, orchid, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        finished = orchid("ablate", "--no-rf", "--ray=local")
        assert_is_an_error(finished, "--ray local: ray cannot be imported", install_command("ray"))
        assert list(tmp_path.iterdir()) == []


FAKE_RAY = """
import os, sys, time
print("Ray talks", flush=True)
os.write(1, b"even past Python\\n")

class exceptions:
    class RayError(Exception): pass
    class RayTaskError(RayError): cause = None
    class TaskCancelledError(RayError): pass
    class OutOfMemoryError(RayError): pass
    class NodeDiedError(RayError): pass
    class GetTimeoutError(RayError): pass

def init(**given):
    print("RAY_ADDRESS" in os.environ, os.environ["RAY_USAGE_STATS_ENABLED"], flush=True)
    if "FAKE_REFUSAL" in os.environ:
        raise RuntimeError(os.environ["FAKE_REFUSAL"])
    if "FAKE_CRASH" in os.environ:
        print("the daemon has died", file=sys.stderr, flush=True)
        os._exit(1)

def shutdown(): pass

def nodes():
    cpus = {"CPU": 2.0}
    one = {"Alive": True, "Resources": cpus, "NodeID": "1", "NodeManagerHostname": "one"}
    dead = {**one, "NodeID": "dead", "Alive": False}
    return [one, {**one, "NodeID": "2"}, dead, {**one, "Resources": {}}]

class Reference:
    def __init__(self, name): self.name = name

class remote:
    def __init__(self, **options): self.given = options
    def __call__(self, function): return self
    def options(self, **options): return self
    def remote(self, command, log, *rest):
        if command[0] == "cut-off":
            with open(log[:-4] + ".node", "w") as file:
                file.write("dead")
        return Reference(command[0])

def wait(references, num_returns, timeout):
    ready = [one for one in references if one.name != "cut-off"]
    if not ready:
        time.sleep(timeout)
    return ready[:1], []

def get(reference, timeout=None):
    kind = getattr(exceptions, reference.name, None)
    if kind is None:
        return 0, "fine"
    error = kind("Task failed: the node IP: 10.0.0.7, node ID: 1\\nmore")
    if reference.name == "RayTaskError":
        error.cause = ModuleNotFoundError("No module named 'orchid_uav'")
    raise error
"""


@pytest.fixture
def fake_ray(tmp_path, monkeypatch):
    """The driver's process finds a Ray without a cluster, whose tasks end as they are named."""
    (tmp_path / "fake").mkdir()
    (tmp_path / "fake" / "ray.py").write_text(FAKE_RAY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "fake"))
    monkeypatch.setenv("RAY_ADDRESS", "somewhere:6379")


class TestDriver:
    """The process that talks to Ray, with a Ray of our own."""

    def test_how_tasks_end_is_how_jobs_end(self, fake_ray):
        told = Told()
        names = ["fine", "RayTaskError", "TaskCancelledError", "OutOfMemoryError", "NodeDiedError"]
        executor = RayCluster("local", 3)
        try:
            assert executor.note == (
                "a Ray cluster of this machine: 2 machines, 4 CPUs, 3 runs at once"
            )
            ends = executor.run([job(name, name) for name in names], told)
        finally:
            executor.close()
        assert [(end.status, end.code, end.tries) for end in ends] == [
            ("completed", 0, 1),
            ("failed", 1, 1),
            ("failed", 130, 1),
            ("failed", -9, 2),
            ("failed", None, 6),
        ]
        assert ends[1].error == "No module named 'orchid_uav'"
        assert "memory" in ends[3].error
        assert ends[4].error == "its Ray worker on 10.0.0.7 was lost (NodeDiedError)"

    def test_what_runs_on_a_node_that_was_cut_off_is_lost(self, fake_ray, tmp_path, monkeypatch):
        monkeypatch.setattr(ray_cluster, "_MOST_LOSSES", 1)
        executor = RayCluster("local", 2)
        try:
            cut = Job("a.b-s0", ("cut-off",), tmp_path / "a.b-s0.log", float)
            ends = executor.run([cut, job("fine", "fine")], Told())
        finally:
            executor.close()
        assert [(end.status, end.code, end.tries, end.error) for end in ends] == [
            ("failed", None, 2, "its machine was lost"),
            ("completed", 0, 1, None),
        ]
        assert not list(tmp_path.glob("*.node"))

    @pytest.mark.parametrize(
        ("reason", "text"),
        [
            (
                "a\nVersion mismatch: The cluster\n  Ray: 2",
                "environment differ: The cluster Ray: 2",
            ),
            ("Could not find any running Ray instance.", "`ray start --head` starts one"),
            ("Traceback\n" * 99 + "InvalidAuthToken: no", "set RAY_AUTH_MODE=token"),
            ("Traceback\n" * 99 + "the reason", "--ray auto: the reason (this machine must be"),
        ],
    )
    def test_a_cluster_that_refuses_is_an_error_of_a_line(
        self, fake_ray, monkeypatch, reason, text
    ):
        monkeypatch.setenv("FAKE_REFUSAL", reason)
        with pytest.raises(InputError) as refusal:
            RayCluster("auto")
        assert text in str(refusal.value)
        assert "\n" not in str(refusal.value)

    def test_its_death_is_told_with_its_last_words(self, fake_ray, monkeypatch):
        monkeypatch.setenv("FAKE_CRASH", "1")
        with pytest.raises(RunFailedError, match="connection to the Ray cluster was lost: the dae"):
            RayCluster("local")

    def test_an_address_where_nothing_listens_is_told_soon(self, fake_ray):
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))  # and does not listen
            address = f"127.0.0.1:{taken.getsockname()[1]}"
            with pytest.raises(InputError, match=rf"--ray {address}: nothing answers there \("):
                RayCluster(address)

    @pytest.mark.parametrize(("address", "is_kept"), [("local", False), ("auto", True)])
    def test_only_auto_heeds_the_environment(self, monkeypatch, address, is_kept):
        monkeypatch.setenv("RAY_ADDRESS", "somewhere:6379")
        environment = ray_cluster._environment(address)
        assert ("RAY_ADDRESS" in environment) is is_kept
        assert environment["RAY_USAGE_STATS_ENABLED"] == "0"


class Machines:
    """Stands in for the driver: machines that look at a directory, as real ones do or otherwise."""

    cpus = machines = 2

    def __init__(self, **change):
        self.change = change
        self.ended = False

    def looked(self, folder):
        other = Path(folder) if "elsewhere" not in self.change else self.change["elsewhere"]
        found = [ray_tasks.look(folder, "1"), ray_tasks.look(str(other), "2")]
        found[1] |= {"host": "node-2"} | self.change.get("says", {})
        return found

    def close(self):
        self.ended = True


class TestCheck:
    @pytest.fixture
    def cluster(self, monkeypatch):
        monkeypatch.setattr(notices, "_told", set())

        def make(**change):
            monkeypatch.setattr(ray_cluster, "_Driver", lambda *given: Machines(**change))
            return RayCluster("head:6379")

        return make

    def test_a_shared_directory_passes_and_is_left_as_it_was(self, cluster, tmp_path):
        one = cluster()
        one.check(tmp_path)
        one.check(tmp_path / "not" / "yet")
        assert list(tmp_path.iterdir()) == []
        assert one._may_be_lost

    def test_a_directory_that_a_machine_does_not_see_is_named(self, cluster, tmp_path):
        with pytest.raises(InputError, match=rf"node-2 cannot use {tmp_path}: No such file"):
            cluster(elsewhere=tmp_path / "missing").check(tmp_path)

    def test_another_directory_of_that_name_is_no_shared_one(self, cluster, tmp_path):
        other = tmp_path / "other"
        other.mkdir()
        (other / "token").write_text("of another study")
        with pytest.raises(InputError, match=r"node-2 cannot use .*: another directory of this"):
            cluster(elsewhere=other).check(tmp_path)

    def test_what_is_written_there_must_be_seen_here(self, cluster, tmp_path, monkeypatch):
        monkeypatch.setattr(Path, "write_text", lambda path, text: None)
        (tmp_path / "token").touch()
        with pytest.raises((InputError, FileNotFoundError)):
            cluster().check(tmp_path)

    @pytest.mark.parametrize("name", ["orchid_uav", "torch", "numpy"])
    def test_other_versions_are_refused(self, cluster, tmp_path, name):
        versions = describe_versions() | {name: "0.0.1"}
        with pytest.raises(InputError, match=f"node-2 has {name} 0.0.1, this machine "):
            cluster(says={"versions": versions}).check(tmp_path)

    def test_another_commit_and_another_processor_are_not(self, cluster, tmp_path, capsys):
        notices.show_on_stderr()
        versions = describe_versions() | {"git_commit": None, "python": "3.11.0"}
        cluster(says={"versions": versions, "processor": "slow"}).check(tmp_path)
        assert "note: node-2 has another processor (slow)" in capsys.readouterr().err

    def test_where_locks_are_not_seen_nothing_is_run_again(self, cluster, tmp_path, capsys):
        notices.show_on_stderr()
        one = cluster(says={"sees_lock": False})
        one.check(tmp_path)
        assert not one._may_be_lost
        assert "warning: node-2 does not see locks" in capsys.readouterr().err

    def test_a_machine_without_this_package_is_named(self, cluster, tmp_path):
        fault = "No module named 'orchid_uav'"
        with pytest.raises(InputError, match=rf"node-2 cannot use .*: {fault}; .*and this package"):
            cluster(says={"fault": fault}).check(tmp_path)

    def test_a_cluster_without_a_processor_is_refused(self, monkeypatch):
        machines = Machines()
        machines.cpus = 0
        monkeypatch.setattr(ray_cluster, "_Driver", lambda *given: machines)
        with pytest.raises(InputError, match="no machine of the cluster has a CPU"):
            RayCluster("auto")
        assert machines.ended


def python(code, *arguments):
    return ("the-drivers-python", "-I", "-S", "-c", textwrap.dedent(code), *map(str, arguments))


class TestTask:
    def run(self, command, log):
        return ray_tasks.run_command(command, str(log), "the-drivers-python", "this-node")

    def test_runs_a_command_with_the_python_of_its_machine(self, tmp_path):
        log = tmp_path / "log"
        code, error = self.run(python("import sys; print('error: no'); sys.exit(3)"), log)
        assert (code, error, log.read_text()) == (3, "error: no", "error: no\n")
        assert self.run(python("import os; os.kill(os.getpid(), 9)"), log) == (
            -9,
            "killed by SIGKILL",
        )
        code, error = self.run(("no-such-command",), log)
        assert (code, "cannot be started on" in error) == (1, True)

    def test_makes_no_directory_that_its_machine_does_not_see(self, tmp_path):
        code, error = self.run(python("pass"), tmp_path / "shared" / "log")
        assert (code, error.endswith(f"does not see {tmp_path / 'shared'}")) == (1, True)
        assert list(tmp_path.iterdir()) == []

    def test_tells_where_it_runs(self, tmp_path):
        self.run(python("pass"), tmp_path / "a.b-s0.log")
        assert (tmp_path / "a.b-s0.node").read_text() == "this-node"

    def test_lets_its_process_save_where_it_is_cancelled(self, tmp_path):
        saves = """
        import signal, sys, time
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
        open(sys.argv[1], "w").close()
        time.sleep(60)
        """

        def cancel():  # as Ray does it, without a signal
            while not (tmp_path / "ready").exists():
                time.sleep(0.02)
            _thread.interrupt_main()

        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            threading.Thread(target=cancel).start()
            code, _ = self.run(python(saves, tmp_path / "ready"), tmp_path / "log")
        finally:
            signal.signal(signal.SIGINT, before)
        assert code == 130


STUDY = [
    *("ablate", "--no-rf", *[one.replace("--set", "--base") for one in TINY_FLAGS]),
    *("--base=checkpoint.every_episodes=20", "--base=reset.window=20"),
    *("--seeds=0,1", "--topologies=2"),
]


def runs_of(study):
    """The learned files of a study's runs, by variant and seed."""
    found = {}
    for path in sorted((study / "runs").iterdir()):
        record = record_of(path)
        assert record["status"] == "completed"
        seed = json.loads((path / "config.json").read_text())["training"]["seed"]
        assert (record["name"], seed) not in found, "two runs of one job"
        found[record["name"], seed] = learned_files(path)
    return found


def numbers_of(document):
    return {key: document[key] for key in ("values", "comparisons", "learning_curves")}


def descendants(pid):
    """A process and all that it has started, from /proc."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parents[int(path.name)] = int((path / "stat").read_text().rpartition(")")[2].split()[1])
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found


def until(condition, what):
    give_up_s = time.monotonic() + GIVE_UP_AFTER_S
    while not (result := condition()):
        assert time.monotonic() < give_up_s, what
        time.sleep(0.1)
    return result


@pytest.fixture
def two_nodes(tmp_path, start_process, monkeypatch):
    """A real cluster of two nodes with one CPU each; gives its address and the second's process."""
    if sys.platform != "linux":
        pytest.skip("processes are looked for in /proc")
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    monkeypatch.setenv("RAY_worker_niceness", "0")  # other tests run beside these
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"

    def start(*options):
        command = [sys.executable, "-m", "ray.scripts.scripts", "start", "--block"]
        common = ["--num-cpus=1", "--node-ip-address=127.0.0.1", "--disable-usage-stats"]
        return start_process(
            [*command, *common, *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    nodes = [start("--head", f"--port={address.rpartition(':')[2]}", "--include-dashboard=false")]
    try:

        def answers():
            with suppress(OSError), socket.create_connection(("127.0.0.1", int(address[10:])), 1):
                return True

        until(answers, "no head")
        nodes.append(start(f"--address={address}"))
        until(
            lambda: any("raylet" in name_of(pid) for pid in descendants(nodes[1].pid)), "no raylet"
        )
        yield address, nodes[1]
    finally:
        for node in nodes:
            kill_node(node)


def name_of(pid):
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text().partition("\0")[0]
    return ""


def kill_node(node):
    for pid in descendants(node.pid):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


@NEEDS_RAY
@pytest.mark.usefixtures("plain_environment")
class TestRealCluster:
    def test_a_node_lost_amid_a_study_changes_no_bit(
        self, two_nodes, start_orchid, tmp_path, monkeypatch
    ):
        address, second = two_nodes
        monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")  # of no meaning beside an address
        study = [*STUDY, "--episodes=200", "--json"]
        here = start_orchid(*study, f"--out={tmp_path / 'here'}")
        out, err = here.communicate(timeout=GIVE_UP_AFTER_S)
        assert here.returncode == 0, err
        there = start_orchid(*study, f"--ray={address}", f"--out={tmp_path / 'there'}")

        def on_second():
            """The run that the second node trains, once it has a checkpoint."""
            assert there.poll() is None, there.communicate()
            for pid in descendants(second.pid):
                with suppress(OSError):
                    order = Path(f"/proc/{pid}/cmdline").read_text().split("\0")[-2]
                    for run in (tmp_path / "there" / "runs").glob(f"*-{Path(order).stem}-*"):
                        if order.endswith(".json") and any((run / "checkpoints").glob("[0-9]*")):
                            return run
            return None

        lost = until(on_second, "nothing runs on the second node")
        kill_node(second)
        assert record_of(lost)["status"] == "running"
        told, notes = there.communicate(timeout=GIVE_UP_AFTER_S)
        assert there.returncode == 0, notes
        assert "was lost" in notes, notes
        assert "it is run once more and continues where it stopped" in notes
        assert len(record_of(lost)["resumed"]) == 1
        log = next((tmp_path / "there" / "jobs").glob(f"{lost.name[17:-5]}.log")).read_text()
        assert " from episode 1 on\n" in log.splitlines(keepends=True)[0]
        assert " from episode 1 on\n" not in log.splitlines(keepends=True)[-1]
        assert runs_of(tmp_path / "there") == runs_of(tmp_path / "here")
        assert numbers_of(json.loads(told)) == numbers_of(json.loads(out))

    def test_a_cluster_of_the_command_stops_with_it_and_goes_on(self, start_orchid, tmp_path):
        study = [*STUDY, "--episodes=20000", "--ray=local", "--jobs=2", f"--out={tmp_path / 'it'}"]
        process = start_orchid(*study)
        until(lambda: len(list(tmp_path.glob("it/runs/*/checkpoints/[0-9]*"))) >= 2, "no progress")
        started = descendants(process.pid)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert process.returncode == 130, err
        assert "interrupted; continue with: orchid ablate" in err
        runs = list((tmp_path / "it" / "runs").iterdir())
        assert [record_of(run)["status"] for run in runs] == ["interrupted"] * 2
        assert not [name_of(pid) for pid in started if name_of(pid)]
        assert "Traceback" not in out + err

    def test_jobs_that_fail_are_not_run_again(self, tmp_path, monkeypatch):
        executor = executor_for(1, "local")
        try:
            executor.check(tmp_path)
            failing = Job(
                "bad",
                (sys.executable, "-c", "print('error: no'); raise SystemExit(1)"),
                tmp_path / "bad.log",
                float,
            )
            ends = executor.run([failing, dataclasses.replace(failing, name="again")], Told())
        finally:
            executor.close()
        assert [(end.status, end.tries, end.error) for end in ends] == [
            ("failed", 1, "error: no")
        ] * 2
        assert (tmp_path / "bad.log").read_text() == "error: no\n" * 2
