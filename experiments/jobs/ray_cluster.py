"""Runs jobs on a Ray cluster; only its core tasks are used."""

import json
import os
import queue
import re
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from filelock import FileLock

from orchid_uav.envs.threads import usable_cores
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Interruption, Raising, interruption_requests
from orchid_uav.experiments.jobs.child_process import describe_end
from orchid_uav.experiments.jobs.executor import JobEnd, JobProgress, JobRun, TryEnd
from orchid_uav.experiments.jobs.local_processes import check_count
from orchid_uav.experiments.jobs.ray_driver import AUTO, LOCAL, SECONDS_TO_LOOK
from orchid_uav.experiments.jobs.ray_tasks import LOCK_FILE, TOKEN_FILE
from orchid_uav.experiments.jobs.workload import Job
from orchid_uav.experiments.provenance import describe_host, describe_versions
from orchid_uav.notices import note_once, reason_of, warn_once

_DRIVER = "orchid_uav.experiments.jobs.ray_driver"
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+):[0-9]{1,5}")
_SECONDS_TO_CONNECT = 90.0
_SECONDS_OF_A_WAIT = 0.5
_SECONDS_BETWEEN_UPDATES = 1.0
_SECONDS_TO_END = 45.0
_MOST_LOSSES = 5
_OF_A_STACK = ("/", "@", "[", "*")
"""How lines of Ray's stack traces begin; it writes one where it ends its process."""
_SOURCE = ("git_commit", "python")
"""Versions that may differ: wheels know no commit, and Ray itself compares Pythons."""


class RayCluster:
    """Runs jobs as tasks of a Ray cluster, each in a process of its own on one CPU.

    A job whose machine is lost is run again elsewhere, a few times at most; one that fails is not.
    Signals are heeded as by ``LocalProcesses``. Jobs whose driver is lost save and end.

    Args:
        address: ``auto`` for the cluster of this machine, ``host:port``, or ``local`` for a cluster
            that is started here and ends with this object.
        processes: the most jobs at once; None for all CPUs.

    Raises:
        InputError: there is no such cluster, it cannot be used, or ``processes`` is less than 1.
    """

    def __init__(self, address: str, processes: int | None = None) -> None:
        if processes is not None:
            check_count(processes)
        _check_address(address)
        self._asked = processes
        self._may_be_lost = True
        self._stop = Interruption()
        cores = usable_cores() if processes is None else min(processes, usable_cores())
        self._driver = _Driver(address, cores)
        where = "a Ray cluster of this machine" if address == LOCAL else f"Ray cluster at {address}"
        machines, cpus = self._driver.machines, self._driver.cpus
        self.note: str | None = (
            f"{where}: {_counted(machines, 'machine')}, {_counted(cpus, 'CPU')}, "
            f"{_counted(self.processes, 'run')} at once"
        )
        """Which cluster it is."""
        if not cpus:
            self.close()
            raise InputError(f"--ray {address}: no machine of the cluster has a CPU for runs")

    @property
    def processes(self) -> int:
        """The most jobs that run at once."""
        cpus = self._driver.cpus
        return cpus if self._asked is None else min(cpus, self._asked)

    @property
    def was_stopped(self) -> bool:
        """Whether a stop was asked for while the last jobs were running, even by the very end."""
        return self._stop.requested

    def check(self, folder: Path) -> None:
        """Make sure that all machines have this version and share a directory with this one.

        Where they do not see each other's locks, no lost job is run again: the machine that seems
        lost may still be writing.

        Raises:
            InputError: a machine does not.
        """
        token = secrets.token_hex(8)
        folder = folder.absolute()
        # What is made in a shared directory is shared.
        there = next(path for path in (folder, *folder.parents) if path.is_dir())
        with _probe_directory(there) as probe:
            directory = Path(probe)
            (directory / TOKEN_FILE).write_text(token)
            lock = FileLock(directory / LOCK_FILE, fallback_to_soft=False)
            with suppress(OSError):  # a file system without locks
                lock.acquire(timeout=0)
            directory.chmod(0o755)  # workers may be of another user
            found = self._driver.looked(probe)
            written = [path.read_text() for path in directory.glob("*") if path.name != LOCK_FILE]
            lock.release()
        for one in found:
            _check_machine(one, token, there)
        if written.count(token) <= len(found):  # the token itself is one of them
            raise InputError(f"what machines of the cluster write to {there} is not seen here")
        blind = [one["host"] for one in found if not one["sees_lock"]]
        if blind:
            self._may_be_lost = False
            warn_once(
                "locks of machines",
                f"{blind[0]} does not see locks that this machine holds in {there}: a run whose "
                "machine is lost fails, since nothing tells whether it is still being written",
            )

    def run(self, jobs: Sequence[Job], progress: JobProgress) -> list[JobEnd]:
        """Run jobs, begun in the order given, and return how each ended.

        Raises:
            ValueError: two jobs have the same name.
            RunFailedError: the connection to the cluster was lost.
        """
        place = _Tasks(self._driver, self._asked, _MOST_LOSSES if self._may_be_lost else 0)
        with interruption_requests(Raising.NEVER, b"") as self._stop:
            return JobRun(jobs, place, progress, self._stop).run()

    def close(self) -> None:
        """Leave the cluster; one that was started for this object ends."""
        self._driver.close()


def _probe_directory(folder: Path) -> "tempfile.TemporaryDirectory[str]":
    try:
        return tempfile.TemporaryDirectory(prefix=".ray-", dir=folder, ignore_cleanup_errors=True)
    except OSError as error:
        raise InputError(f"cannot write to {folder}: {reason_of(error)}") from error


def _check_address(address: str) -> None:
    if address in (AUTO, LOCAL) or _ADDRESS.fullmatch(address):
        return
    hint = ""
    if "://" in address:
        hint = "; a client cannot be lost without its jobs, so run this on a node of the cluster"
    raise InputError(f"--ray {address!r}: give auto, local or HOST:PORT{hint}")


def _check_machine(found: Mapping[str, Any], token: str, folder: Path) -> None:
    host = found["host"]
    if found["fault"] is None and found["token"] == token:
        own = describe_versions()
        for name, version in found["versions"].items():
            if name not in _SOURCE and version != own.get(name):
                raise InputError(
                    f"{host} has {name} {version}, this machine {own.get(name)}: the same versions "
                    "are needed for the same numbers"
                )
        processor = describe_host()["processor"]
        if found["processor"] != processor:
            note_once(
                "processors",
                f"{host} has another processor ({found['processor']}) than this machine "
                f"({processor}): late digits may differ between runs",
            )
        return
    fault = found["fault"] or "another directory of this name"
    raise InputError(
        f"{host} cannot use {folder}: {fault}; all machines of a cluster need the "
        "directory of the study under the same path, and this package"
    )


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


class _Driver:
    """The process that talks to Ray, and what it last said.

    Raises:
        InputError: it cannot join or start the cluster.
    """

    def __init__(self, address: str, processes: int) -> None:
        self.cpus = self.machines = 0
        self._address = address
        self._errors = tempfile.NamedTemporaryFile(prefix="orchid-ray-", suffix=".log")  # noqa: SIM115
        # Its own session: ctrl-C of a terminal is for the study, which then asks jobs to stop.
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", _DRIVER, address, str(processes)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
            cwd=Path(sys.executable).anchor,  # Ray lets its workers import from this directory
            env=_environment(address),
        )
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            first = self._next(_SECONDS_TO_CONNECT)
        except BaseException:
            self.close()
            raise
        if first is None:
            self.close()
            raise InputError(
                f"--ray {address}: no answer from the cluster in {_SECONDS_TO_CONNECT:.0f} s"
            )
        self._note(first)

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            for line in answers:
                self._answers.put(json.loads(line))
        self._answers.put(None)

    def _next(self, patience_s: float) -> dict[str, Any] | None:
        """The next answer; None if none comes.

        Raises:
            InputError: the cluster cannot be used.
            RunFailedError: the process has ended.
        """
        try:
            answer = self._answers.get(timeout=patience_s)
        except queue.Empty:
            return None
        if answer is None:
            self._answers.put(None)  # for whoever asks next
            reason = describe_end(self._process.wait(), Path(self._errors.name), 0)
            if reason.startswith(_OF_A_STACK):
                reason = "its head, or Ray on this machine, has ended"
            raise RunFailedError(f"the connection to the Ray cluster was lost: {reason}")
        if "refused" in answer:
            raise InputError(answer["refused"])
        return answer

    def _note(self, answer: Mapping[str, Any]) -> None:
        if "cpus" in answer:
            self.cpus, self.machines = answer["cpus"], answer["machines"]
            if not self.cpus:
                warn_once("no CPU", "no machine of the Ray cluster is left: waiting for one")

    def ask(self, what: str, **details: Any) -> None:
        """Send a request."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it has ended, which `_next` tells
            self._process.stdin.write((json.dumps({"do": what, **details}) + "\n").encode())
            self._process.stdin.flush()

    def looked(self, folder: str) -> list[dict[str, Any]]:
        """What the machines see of a directory."""
        self.ask("look", folder=folder)
        end_s = time.monotonic() + SECONDS_TO_LOOK + _SECONDS_TO_END
        while time.monotonic() < end_s:
            answer = self._next(_SECONDS_OF_A_WAIT) or {}
            self._note(answer)
            if "looked" in answer:
                return answer["looked"]
        raise InputError(f"--ray {self._address}: no answer from the cluster")

    def ends(self, patience_s: float) -> Iterator[TryEnd]:
        """Wait for answers, and return the tries that have ended."""
        while answer := self._next(patience_s):
            self._note(answer)
            if "ended" in answer:
                yield TryEnd(answer["ended"], answer["code"], answer["error"])
            patience_s = 0.0

    def close(self) -> None:
        """End the process; jobs that still run save and end."""
        if self._process.stdin is not None:
            with suppress(OSError):
                self._process.stdin.close()
        try:
            self._process.wait(_SECONDS_TO_END)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(_SECONDS_OF_A_WAIT)
        self._errors.close()


def _environment(address: str) -> dict[str, str]:
    """The driver's environment.

    No usage statistics, no other cluster, no environment of uv's; and in a cluster that is started
    here, runs are no less urgent than they would be without Ray.
    """
    own = {
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ENABLE_UV_RUN_RUNTIME_ENV": "0",
        "RAY_worker_niceness": "0",
    }
    environment = os.environ | own
    if address != AUTO:
        environment.pop("RAY_ADDRESS", None)
    return environment


class _Tasks:
    """Jobs as tasks of a cluster."""

    seconds_between_updates = _SECONDS_BETWEEN_UPDATES

    def __init__(self, driver: _Driver, most: int | None, most_losses: int) -> None:
        self._driver = driver
        self._most = most
        self.most_losses = most_losses
        self._running: set[str] = set()
        self._has_asked: set[str] = set()

    def capacity(self) -> int:
        cpus = self._driver.cpus
        return cpus if self._most is None else min(cpus, self._most)

    def start(self, job: Job) -> None:
        self._driver.ask(
            "start",
            job=job.name,
            command=list(job.command),
            log=str(job.log.absolute()),
            python=sys.executable,
        )
        self._running.add(job.name)

    def collect(self) -> Iterator[TryEnd]:
        for one in self._driver.ends(_SECONDS_OF_A_WAIT):
            self._running.discard(one.job)
            yield one

    def stop(self) -> None:
        self._ask_once("stop")

    def kill(self) -> None:
        self._ask_once("kill")

    def _ask_once(self, what: str) -> None:
        if self._running and what not in self._has_asked:
            self._has_asked.add(what)
            self._driver.ask(what)

    def close(self) -> None:
        """Nothing to wait for: the machines kill what they run, and no directory is shared."""
