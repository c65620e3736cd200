"""A training run as a job: a complete run is found, a stopped one resumed, else one is begun.

Other processes start it as ``python -m orchid_uav.experiments.training.job FILE``.
"""

import gc
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import (
    Interruption,
    ignore_signals,
    interruption_requests,
)
from orchid_uav.experiments.jobs.executor import INTERRUPTED_CODE
from orchid_uav.experiments.jobs.workload import Job, job_from_order, path_in_order
from orchid_uav.experiments.output import lasting_output
from orchid_uav.experiments.runs.lock import RunHeldError, RunLock
from orchid_uav.experiments.runs.records import (
    EPISODES_FILE,
    SeenStatus,
    read_config,
    read_record,
    status_of,
)
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.notices import show_on_stderr
from orchid_uav.storage.files import read_document

if TYPE_CHECKING:
    from orchid_uav.callbacks import EpisodeCallback

_MODULE = "orchid_uav.experiments.training.job"
PATIENCE_S = 300.0
"""How long the process of a job waits for another that writes its run. On a machine that was cut
off from a Ray cluster that one works on for two to three minutes more; a server of files gives the
locks of a dead machine back after 90 seconds (the usual lease of NFS)."""


@dataclass(frozen=True)
class TrainingJob:
    """A run that shall exist and be complete in the end.

    Its name, seed and configuration identify the run, so that the same job finds it again.
    """

    name: str
    config: RunConfig
    runs_dir: Path
    command: tuple[str, ...]
    """The command that the user called; it goes into the run's record."""

    @property
    def key(self) -> str:
        """The name and the seed, joined."""
        return f"{self.name}-s{self.config.training.seed}"

    def find(self) -> Path | None:
        """The run's directory, or None; of several, a complete one or else the newest."""
        if not self.runs_dir.is_dir():
            return None
        pattern = re.compile(rf"\d{{8}}T\d{{6}}Z-{re.escape(self.key)}-[a-z]{{4}}")
        named = [path for path in self.runs_dir.iterdir() if pattern.fullmatch(path.name)]
        found = []
        for path in sorted(named, reverse=True):
            with suppress(InputError):  # killed before it had a record, or damaged
                record = read_record(path)
                if read_config(path, record) == self.config:
                    found.append((record.status != "completed", path))
        return min(found, key=lambda one: one[0])[1] if found else None

    def status(self) -> SeenStatus | Literal["not begun"]:
        """The run's status."""
        path = self.find()
        return "not begun" if path is None else status_of(path, read_record(path))

    def completed(self) -> Path | None:
        """The run's directory if the run is complete, else None."""
        path = self.find()
        return path if path and read_record(path).status == "completed" else None

    def as_job(self, folder: Path, cost: float = 1.0) -> Job:
        """Describe the process that trains the run; its order and log are kept in ``folder``."""
        order = {
            "name": self.name,
            "config": self.config.model_dump(mode="json"),
            "runs_dir": self.runs_dir,
            "command": list(self.command),
        }
        return job_from_order(self.key, _MODULE, order, folder, self.fraction_done(), cost)

    def fraction_done(self) -> Callable[[], float]:
        """What tells which fraction of the run's episodes is done."""
        return _FractionDone(self)

    @classmethod
    def read(cls, order: Path) -> "TrainingJob":
        """Read a job from a file that :meth:`as_job` wrote.

        Raises:
            InputError: the file is not one of those.
        """
        try:
            document = read_document(order)
            return cls(
                document["name"],
                RunConfig.model_validate(document["config"]),
                path_in_order(document["runs_dir"], order),
                tuple(document["command"]),
            )
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise InputError(f"{order} is not the order of a training job: {error}") from error


class _FractionDone:
    """Tells which fraction of a run's episodes is done, from the rows of its log."""

    def __init__(self, job: TrainingJob) -> None:
        self._job = job
        self._path: Path | None = None

    def __call__(self) -> float:
        self._path = self._path or self._job.find()
        if self._path is None:
            return 0.0
        with (self._path / EPISODES_FILE).open("rb") as file:
            rows = file.read().count(b"\n") - 1
        return max(rows, 0) / self._job.config.training.episodes


class _Log(Reporter):
    """Prints the episode from which the run goes on; the output goes to the job's log."""

    def begin(self, run: Any, config: Any, rows: Sequence[Any], reset_episodes: Any) -> None:
        """Print the run's id and the episode from which it goes on."""
        print(f"run {run.id} from episode {len(rows) + 1} on", flush=True)


def run_one(
    job: TrainingJob, watchers: "Sequence[EpisodeCallback]" = (), patience_s: float = 0.0
) -> int:
    """Complete the run: begin it, go on where it stopped, or do nothing if it is complete.

    Args:
        job: the run.
        watchers: further callbacks; see :func:`orchid_uav.experiments.training.loop.train`.
        patience_s: how long to wait for another process that is writing the run.

    Returns:
        0, or 130 if it was interrupted; what was done is then kept.

    Raises:
        InputError: the run cannot be begun or resumed.
        RunFailedError: the run failed.
    """
    # Imported here because the process that starts jobs needs neither torch nor SB3.
    from orchid_uav.experiments.runs.directory import RunDirectory
    from orchid_uav.experiments.training.loop import train
    from orchid_uav.experiments.training.trackers import open_tracker

    if job.completed():
        return 0
    path = job.find()
    with interruption_requests() as interruption:
        if path is None:
            run = RunDirectory.create(job.runs_dir, job.name, job.config, job.command)
        else:
            lock = _lock_of(path, patience_s, interruption)
            if lock is None:
                return INTERRUPTED_CODE
            if job.completed():  # by the process that was waited for
                lock.release()
                return 0
            run = RunDirectory.reopen(path, job.config, job.command, lock)
        trackers = [open_tracker("tensorboard", run.path, job.config)]
        outcome = train(job.config, run, _Log(), trackers, interruption, watchers)
    return 0 if outcome.status == "completed" else INTERRUPTED_CODE


def _lock_of(path: Path, patience_s: float, interruption: Interruption) -> RunLock | None:
    """The lock of a run, which another process may have for a while; None if interrupted.

    Raises:
        InputError: it has not been given back in this time, or the directory cannot be written.
    """
    try:
        return RunLock(path)
    except RunHeldError as error:
        if not patience_s:
            raise
        print(f"{error}: waiting for its end, at most {patience_s:.0f} s", flush=True)
    try:
        return RunLock(path, patience_s, lambda: interruption.requested)
    except RunHeldError:
        if interruption.requested:
            return None
        raise


def _stop_with_parent() -> None:
    """Stop when standard input ends, which means that the parent process has ended."""

    def wait() -> None:
        while os.read(0, 1024):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


def main() -> int:
    """Run the job whose file is named on the command line."""
    return done(lambda order: run_one(TrainingJob.read(order), patience_s=PATIENCE_S))


def done(work: Callable[[Path], int]) -> int:
    """Do what the file named on the command line orders, and return the exit code.

    Args:
        work: given the file's path; returns the exit code.
    """
    show_on_stderr()
    if "ORCHID_JOB" in os.environ:
        _stop_with_parent()
    with lasting_output(), interruption_requests():
        try:
            return work(Path(sys.argv[1]))
        except (InputError, RunFailedError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        except KeyboardInterrupt:
            return INTERRUPTED_CODE


def leave(code: int) -> NoReturn:
    """End the process of a job."""
    ignore_signals()
    gc.freeze()  # see __main__.py
    sys.exit(code)


if __name__ == "__main__":
    leave(main())
