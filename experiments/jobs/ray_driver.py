"""The process that talks to Ray, started by :mod:`ray_cluster` and told what to do line by line.

Ray replaces signal handlers, prints on standard output from a thread of its own, and ends the whole
process where the machine's Ray daemon ends. All of that stays in this process, which the study
survives. Requests and answers are JSON, one a line; the process ends with its standard input.
"""

import json
import os
import queue
import re
import socket
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.jobs import ray_tasks
from orchid_uav.experiments.jobs.child_process import shortened
from orchid_uav.experiments.jobs.executor import INTERRUPTED_CODE
from orchid_uav.extras import import_extra
from orchid_uav.notices import in_one_line, reason_of

AUTO, LOCAL = "auto", "local"
SECONDS_TO_LOOK = 120.0
"""How long the machines have to say what they see."""

_SECONDS_TO_REACH = 10.0
_SECONDS_OF_A_WAIT = 0.5
_SECONDS_BETWEEN_LOOKS = 1.0
_SECONDS_TO_SAVE = 35.0  # a little more than a task gives its process
_OBJECT_STORE_BYTES = 100 * 2**20  # nearly the least that Ray takes: nothing large is sent
_KILLED_CODE = -9
_FAILED_CODE = 1
_NODE_ADDRESS = re.compile(r"node IP: ([^\s,]+)")


def connect(address: str, processes: int) -> ModuleType:
    """Join a cluster, or start one; return Ray.

    Args:
        address: ``auto``, ``local`` or ``host:port``.
        processes: CPUs of a cluster that is started.

    Raises:
        InputError: Ray is not installed or of another version, or there is no such cluster.
    """
    try:
        ray = import_extra("ray")
    except ImportError as error:
        raise InputError(f"--ray {address}: {error}") from error
    quiet = {"log_to_driver": False, "logging_level": "ERROR"}
    try:
        if address == LOCAL:
            ray.init(
                address=LOCAL,
                num_cpus=processes,
                include_dashboard=False,
                object_store_memory=_OBJECT_STORE_BYTES,
                **quiet,
            )
        else:
            if address != AUTO:
                _reach(address)
            ray.init(address=address, **quiet)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        reason = _explained(str(error.__cause__ or error), address)
        raise InputError(f"--ray {address}: {reason}") from error
    return ray


def _reach(address: str) -> None:
    """Fail soon where nothing listens, for which Ray would wait longer.

    Raises:
        InputError: nothing can be reached there.
    """
    host, _, port = address.rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=_SECONDS_TO_REACH):
            pass
    except OSError as error:
        reason = reason_of(error)
        raise InputError(f"--ray {address}: nothing answers there ({reason})") from error


def _explained(reason: str, address: str) -> str:
    """What Ray says, in words of this command where it is an everyday thing."""
    if "Could not find any running Ray" in reason:
        return "no Ray cluster runs on this machine; `ray start --head` starts one"
    if "Version mismatch" in reason:
        versions = " ".join(reason.partition("Version mismatch: ")[2].split())
        return f"the cluster and this environment differ: {versions}"
    if "InvalidAuthToken" in reason:
        return (
            "the cluster wants its token: set RAY_AUTH_MODE=token, and have the file "
            "~/.ray/auth_token of its first machine on all of them"
        )
    # Ray puts whole tracebacks into its messages; what happened stands in the last line.
    last = shortened((reason.strip().splitlines() or ["Ray does not say why"])[-1].strip())
    if address == LOCAL:
        return last
    return f"{last} (this machine must be a node of the cluster: `ray start --address={address}`)"


class Driver:
    """Serves the requests of the process that started this one.

    Args:
        ray: Ray, connected.
        answers: takes the answers.
    """

    def __init__(self, ray: ModuleType, answers: IO[str]) -> None:
        self._ray = ray
        self._answers = answers
        self._jobs: dict[Any, str] = {}
        """Names of the running jobs, by what Ray calls them."""
        self._marks: dict[Any, Path] = {}
        """The files that tell on which node they run."""
        self._cpus = -1
        self._next_look_s = 0.0
        self._task = ray.remote(num_cpus=1, max_retries=0)(ray_tasks.run_command)
        self._look = ray.remote(num_cpus=0, max_retries=0)(ray_tasks.look)

    def serve(self, requests: "queue.Queue[dict[str, Any] | None]") -> None:
        """Serve requests until None comes; then let running jobs save and end."""
        while True:
            self._look_at_nodes()
            try:
                request = requests.get(timeout=0.0 if self._jobs else _SECONDS_OF_A_WAIT)
            except queue.Empty:
                self._tell_ends(_SECONDS_OF_A_WAIT)
                continue
            if request is None:
                break
            self._serve(request)
        self._cancel(force=False)
        end_s = time.monotonic() + _SECONDS_TO_SAVE
        while self._jobs and time.monotonic() < end_s:
            self._tell_ends(_SECONDS_OF_A_WAIT)

    def _serve(self, request: dict[str, Any]) -> None:
        match request["do"]:
            case "look":
                self._tell(looked=self._looked(request["folder"]))
            case "start":
                self._start(request)
            case "stop":
                self._cancel(force=False)
            case "kill":
                self._cancel(force=True)

    def _start(self, request: dict[str, Any]) -> None:
        mark = ray_tasks.mark_of(Path(request["log"]))
        with suppress(OSError):
            mark.unlink(missing_ok=True)
        task = self._task.remote(request["command"], request["log"], request["python"])
        self._jobs[task], self._marks[task] = request["job"], mark

    def _tell(self, **answer: Any) -> None:
        with suppress(OSError, ValueError):  # who asked is gone; its standard output ends as well
            self._answers.write(json.dumps(answer) + "\n")
            self._answers.flush()

    def _look_at_nodes(self) -> None:
        now_s = time.monotonic()
        if now_s < self._next_look_s:
            return
        self._next_look_s = now_s + _SECONDS_BETWEEN_LOOKS
        found = self._ray.nodes()
        self._give_up({node["NodeID"] for node in found if not node["Alive"]})
        nodes = _able(found)
        cpus = sum(int(node["Resources"]["CPU"]) for node in nodes)
        if cpus != self._cpus:
            self._cpus = cpus
            self._tell(cpus=cpus, machines=len(nodes))

    def _give_up(self, lost: set[str]) -> None:
        """Tell that the jobs of lost nodes are lost, without waiting for Ray to say so of each."""
        for task, mark in list(self._marks.items()) if lost else ():
            try:
                is_lost = mark.read_text() in lost
            except OSError:  # it has not begun
                continue
            if is_lost:
                self._tell_end(task, None, "its machine was lost")

    def _tell_end(self, task: Any, code: int | None, error: str) -> None:
        with suppress(OSError):
            self._marks.pop(task).unlink(missing_ok=True)
        self._tell(ended=self._jobs.pop(task), code=code, error=error)

    def _tell_ends(self, patience_s: float) -> None:
        if not self._jobs:
            return
        ready, _ = self._ray.wait(list(self._jobs), num_returns=1, timeout=patience_s)
        for task in ready:
            self._tell_end(task, *self._end_of(task))

    def _end_of(self, reference: Any) -> tuple[int | None, str]:
        """The exit code of a job, None if it was lost, and why it ended."""
        exceptions = self._ray.exceptions
        try:
            code, error = self._ray.get(reference)
            return code, error
        except exceptions.TaskCancelledError:
            return INTERRUPTED_CODE, ""
        except exceptions.OutOfMemoryError:
            return _KILLED_CODE, "killed by Ray, since its machine ran out of memory"
        except exceptions.RayTaskError as error:
            return _FAILED_CODE, shortened(in_one_line(error.cause or error))
        except exceptions.RayError as error:
            found = _NODE_ADDRESS.search(str(error))
            where = f" on {found[1]}" if found else ""
            return None, f"its Ray worker{where} was lost ({type(error).__name__})"

    def _cancel(self, force: bool) -> None:
        for reference in self._jobs:
            self._ray.cancel(reference, force=force)

    def _looked(self, folder: str) -> list[dict[str, Any]]:
        """What every machine sees of a directory; ``fault`` says why it could not tell."""
        pinned = self._ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy
        asked = {}
        for node in _able(self._ray.nodes()):
            there = self._look.options(scheduling_strategy=pinned(node["NodeID"], soft=False))
            asked[there.remote(folder, node["NodeID"])] = node["NodeManagerHostname"]
        self._ray.wait(list(asked), num_returns=len(asked), timeout=SECONDS_TO_LOOK)
        found = []
        for reference, host in asked.items():
            try:
                found.append(self._ray.get(reference, timeout=0.0))
            except self._ray.exceptions.GetTimeoutError:
                self._ray.cancel(reference, force=True)
                found.append({"host": host, "fault": f"no answer in {SECONDS_TO_LOOK:.0f} s"})
            except self._ray.exceptions.RayError as error:
                cause = getattr(error, "cause", None) or error
                found.append({"host": host, "fault": shortened(in_one_line(cause))})
        return found


def _able(nodes: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The nodes that can run something."""
    return [one for one in nodes if one["Alive"] and one["Resources"].get("CPU", 0.0) >= 1.0]


def _read_requests(requests: "queue.Queue[dict[str, Any] | None]") -> None:
    for line in sys.stdin:
        requests.put(json.loads(line))
    requests.put(None)


def main() -> int:
    """Serve the process that started this one, about the cluster named on the command line."""
    # What Ray prints must not get among the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)
    address, processes = sys.argv[1], int(sys.argv[2])
    try:
        ray = connect(address, processes)
    except InputError as error:
        answers.write(json.dumps({"refused": str(error)}) + "\n")
        answers.flush()
        return 1
    requests: queue.Queue[dict[str, Any] | None] = queue.Queue()
    threading.Thread(target=_read_requests, args=(requests,), daemon=True).start()
    try:
        Driver(ray, answers).serve(requests)
    finally:
        ray.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
