"""Disks that fill, directories that turn read-only, clocks that jump, in the middle of a command.

Each command must end as the documentation says, with one clear message, lose nothing that it had,
and become what the undisturbed command makes once the cause is gone.
"""

import errno
import os
import random
import shutil
import signal
import subprocess
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import pyarrow.parquet

from studies.torture.kills import GIVE_UP_AFTER_S, started, undisturbed, until
from studies.torture.subjects import (
    Command,
    Outcome,
    Subject,
    differences,
    episodes_done,
    litter,
    paths_below,
    positions_file,
    subjects,
)

_DISK_MIB = 64
_ROWS_BEFORE = 20
"""Episodes after which something happens to trainings."""
_LONGEST_MESSAGE, _MOST_LINES = 500, 3
_FAKETIME = "*/faketime/libfaketimeMT.so.1"
_NEEDED = "needs Debian's package libfaketime"
_CANNOT_SLEEP = "libfaketime 0.9.10 lets Python's time.sleep fail, with which the command waits"


class NotHereError(Exception):
    """This machine does not allow what shall happen."""


class Fault(ABC):
    """Something that happens to a command, in a place of its own."""

    name: ClassVar[str]
    how: ClassVar[str]
    codes: ClassVar[tuple[int, ...]] = (1,)
    """With one of which the command ends."""
    before: Sequence[str] = ()
    """A command that starts the other one."""
    environment: ClassVar[dict[str, str]] = {}

    @contextmanager
    def place(self, beside: Path) -> Iterator[Path]:
        """The working directory, made in a folder that nothing happens to.

        Raises:
            NotHereError: this machine does not allow it.
        """
        working = beside / "working"
        working.mkdir()
        yield working

    @abstractmethod
    def strike(self, working: Path, process: "subprocess.Popen[bytes]") -> None:
        """Let it happen."""

    @abstractmethod
    def heal(self, working: Path) -> None:
        """Remove the cause."""


class FullDisk(Fault):
    """A small file system without any room."""

    name = "disk full"
    how = f"a file system of {_DISK_MIB} MiB in memory (tmpfs), filled by another process"

    @contextmanager
    def place(self, beside: Path) -> Iterator[Path]:
        """Mount the file system."""
        working = beside / "working"
        working.mkdir()
        size = f"size={_DISK_MIB}m"
        command = ["mount", "-t", "tmpfs", "-o", size, "orchid-torture", str(working)]
        mounted = subprocess.run(command, capture_output=True, text=True, check=False)
        if mounted.returncode:
            raise NotHereError(f"no file system can be mounted: {mounted.stderr.strip()}")
        try:
            yield working
        finally:
            subprocess.run(["umount", "-l", str(working)], check=True)

    def strike(self, working: Path, process: "subprocess.Popen[bytes]") -> None:
        """Take all room that there is, also what is freed in the next moments."""
        with (working / "filler").open("ab") as file:
            while room := os.statvfs(working).f_bavail * os.statvfs(working).f_frsize:
                try:
                    os.posix_fallocate(file.fileno(), file.tell(), room)
                except OSError as error:
                    if error.errno != errno.ENOSPC:  # the command was faster
                        raise
                file.seek(0, os.SEEK_END)

    def heal(self, working: Path) -> None:
        """Give it back."""
        (working / "filler").unlink()


class ReadOnly(Fault):
    """Files and directories that nobody may write any more."""

    name = "read-only"
    how = "all permissions to write taken from files and directories (chmod -R a-w)"

    @contextmanager
    def place(self, beside: Path) -> Iterator[Path]:
        """Root may write everywhere, so it is started without that right."""
        if os.geteuid() == 0:
            if shutil.which("setpriv") is None:
                raise NotHereError("root may write everywhere, and setpriv is not installed")
            dropped = "-dac_override,-dac_read_search"
            self.before = ("setpriv", f"--bounding-set={dropped}", f"--inh-caps={dropped}")
        with super().place(beside) as working:
            yield working

    def strike(self, working: Path, process: "subprocess.Popen[bytes]") -> None:
        """Take the permissions, from the directories above first."""
        self._change("a-w", working)

    def heal(self, working: Path) -> None:
        """Give them back."""
        self._change("u+w", working)

    @staticmethod
    def _change(mode: str, working: Path) -> None:
        # Temporary files may vanish meanwhile, for which chmod is sorry.
        subprocess.run(["chmod", "-R", mode, str(working)], capture_output=True, check=False)


class _ClockJumps(Fault):
    """A clock that tells another day; then the command is asked to stop."""

    how = "the clock of the processes (libfaketime; not the monotonic one), and then SIGTERM"
    codes = (130, 0)  # the latter if it was done before it heard of it
    offset: ClassVar[str]

    @contextmanager
    def place(self, beside: Path) -> Iterator[Path]:
        """Begin with the real time."""
        found = sorted(Path("/usr/lib").glob(_FAKETIME))
        if not found:
            raise NotHereError(_NEEDED)
        with super().place(beside) as working:
            self._clock(working).write_text("+0", encoding="ascii")
            self.before = (
                "env",
                f"LD_PRELOAD={found[0]}",
                f"FAKETIME_TIMESTAMP_FILE={self._clock(working)}",
                "FAKETIME_NO_CACHE=1",
                "FAKETIME_DONT_FAKE_MONOTONIC=1",
                "NO_FAKE_STAT=1",
            )
            yield working

    @staticmethod
    def _clock(working: Path) -> Path:
        return working.parent / "clock"

    def strike(self, working: Path, process: "subprocess.Popen[bytes]") -> None:
        """Jump; a while later, ask for a stop."""
        clock = self._clock(working)
        beside = clock.with_suffix(".new")
        beside.write_text(self.offset, encoding="ascii")
        beside.replace(clock)
        until(lambda: process.poll() is not None, 0.1)
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)

    def heal(self, working: Path) -> None:
        """Leave the clock as it is: what goes on does so on the other day."""


class ClockBack(_ClockJumps):
    """Yesterday."""

    name, offset = "clock back a day", "-1d"


class ClockForward(_ClockJumps):
    """Tomorrow."""

    name, offset = "clock forward a day", "+1d"


FAULTS: tuple[type[Fault], ...] = (FullDisk, ReadOnly, ClockBack, ClockForward)


@dataclass
class Case:
    """A fault that happens to a command, and what came of it."""

    subject: Subject
    fault: Fault
    skipped: str | None = None
    """Why this machine does not allow it."""
    code: int | None = None
    message: str = ""
    """What the command said when it ended."""
    kept: int = 0
    """Episodes in checkpoints and flights in tables, once it had ended."""
    failures: tuple[str, ...] = ()


def run(scale: float, seed: int) -> dict[str, Any]:
    """Let every fault happen to every command; with a smaller scale, to some, but every fault once.

    Returns:
        The cases and the ``failures``, none of which there should be.
    """
    draw = random.Random(seed)
    suffering = [_talking(one) for one in subjects() if "worlds" not in one.name]
    every = [Case(subject, fault()) for fault in FAULTS for subject in suffering]
    least = [
        draw.choice([one for one in every if isinstance(one.fault, fault)]) for fault in FAULTS
    ]
    others = [case for case in every if case not in least]
    more = max(0, min(round(scale * len(every)) - len(least), len(others)))
    cases = least + draw.sample(others, more)
    cases.sort(key=every.index)
    with tempfile.TemporaryDirectory(prefix="orchid-faults-") as place:
        whole: dict[str, Outcome] = {}
        for case in cases:
            name = case.subject.name
            if name not in whole:
                whole[name] = undisturbed(case.subject, Path(place) / "whole").outcome
            suffer(case, Path(place) / "case", whole[name])
            told = case.skipped or f"ends with {case.code}: {case.message}"
            print(f"{name}, {case.fault.name}: {told}", *case.failures, sep="\n  ", flush=True)
    return {
        "how": {fault.name: fault.how for fault in FAULTS},
        "cases": [
            {
                "subject": case.subject.name,
                "fault": case.fault.name,
                "code": case.code,
                "message": case.message,
                "kept": case.kept,
                "skipped": case.skipped,
                "went_on_equal": not case.failures and case.skipped is None,
            }
            for case in cases
        ],
        "failures": [
            f"{case.subject.name}, {case.fault.name}: {failure}"
            for case in cases
            for failure in case.failures
        ],
    }


def _talking(subject: Subject) -> Subject:
    """The plan searches for long enough to say that it does."""
    if subject.name != "plan":
        return subject
    command = tuple(
        "--budget=300000" if word.startswith("--budget") else word
        for word in subject.command
        if word != "--quiet"
    )
    return replace(
        subject,
        command=command,
        going_on=lambda working: command if subject.going_on(working) else None,
    )


def suffer(case: Case, beside: Path, whole: Outcome) -> None:
    """Let it happen, go on, and note what is wrong; in a new directory, which is removed."""
    beside.mkdir()
    fault = case.fault
    if isinstance(fault, _ClockJumps) and case.subject.command[0] == "ablate":
        case.skipped = _CANNOT_SLEEP
        beside.rmdir()
        return
    try:
        with fault.place(beside) as working:
            positions_file(working)
            began_s = time.monotonic()
            failures = [*_struck(case, working), *_gone_on(case, working, whole)]
            failures += _wrong_times(working, time.monotonic() - began_s)
        case.failures = tuple(failures)
    except NotHereError as error:
        case.skipped = str(error)
    finally:
        shutil.rmtree(beside)


def _struck(case: Case, working: Path) -> Iterator[str]:
    """Run the command until something happens to it; what is wrong with its end."""
    fault, notes = case.fault, working.parent
    with started(case.subject.command, working, notes, fault.before) as process:
        until(
            lambda: process.poll() is not None or _is_amid(case.subject, working, notes),
            GIVE_UP_AFTER_S,
        )
        before = _kept(working)
        if process.poll() is None:
            fault.strike(working, process)
        else:
            yield "it ended before anything happened"
        case.code = process.wait(GIVE_UP_AFTER_S)
    told = (notes / "stderr").read_text(encoding="utf-8")
    lines = [line for line in told.splitlines() if not line.startswith(("warning: ", "note: "))]
    case.message = " / ".join(lines).replace(str(working), "…")[:_LONGEST_MESSAGE]
    fault.heal(working)
    case.kept = _kept(working)
    if case.code not in fault.codes:
        yield f"it ended with {case.code}, which is none of {fault.codes}"
    if "Traceback" in told or (case.code and not 1 <= len(lines) <= _MOST_LINES):
        yield f"no clear message: {told[-_LONGEST_MESSAGE:]}"
    if case.code == 1 and sum(line.startswith("error: ") for line in lines) != 1:
        yield "not one line that begins with error:"
    if case.kept < before:
        yield f"of {before} episodes or flights that were kept, {case.kept} are left"


def _gone_on(case: Case, working: Path, whole: Outcome) -> Iterator[str]:
    """Go on once the cause is gone; what differs from the undisturbed command."""
    command: Command | None = case.subject.going_on(working)
    notes = working.parent / "after"
    notes.mkdir()
    if command is not None:
        with started(command, working, notes, case.fault.before) as process:
            code = process.wait(GIVE_UP_AFTER_S)
        if code:
            told = (notes / "stderr").read_text(encoding="utf-8")[-_LONGEST_MESSAGE:]
            yield f"orchid {' '.join(command)} ends with {code}: {told}"
            return
    for name in differences(whole, case.subject.outcome(working)):
        yield f"differs: {name}"
    for path in litter(working):
        yield f"left behind: {path.relative_to(working)}"


def _wrong_times(working: Path, elapsed_s: float) -> Iterator[str]:
    """Durations that a clock has spoiled."""
    for path in working.rglob("run.json"):
        seconds = _number_after('"seconds":', path.read_text(encoding="utf-8"))
        if not 0.0 <= seconds <= elapsed_s:
            yield f"a run says that it took {seconds} s, within {elapsed_s:.0f} s"


def _number_after(key: str, text: str) -> float:
    return float(text.partition(key)[2].partition(",")[0])


def _is_amid(subject: Subject, working: Path, notes: Path) -> bool:
    """Whether a command is where something shall happen to it."""
    amid: dict[str, Callable[[], bool]] = {
        "train": lambda: episodes_done(working) >= _ROWS_BEFORE,
        "ablate": lambda: episodes_done(working) >= _ROWS_BEFORE,
        "eval": lambda: any(path.name == "episodes.parquet" for path in paths_below(working)),
        "plan": lambda: "stations:" in (notes / "stdout").read_text(encoding="utf-8"),
    }
    return amid[subject.command[0]]()


def _kept(working: Path) -> int:
    """Episodes of the newest checkpoints of all runs, and flights of all tables."""
    newest: dict[Path, int] = {}
    flights = 0
    for path in paths_below(working):
        if path.parent.name == "checkpoints" and path.name.isdigit():
            newest[path.parent] = max(newest.get(path.parent, 0), int(path.name))
        if path.name == "episodes.parquet":
            flights += pyarrow.parquet.read_metadata(path).num_rows
    return sum(newest.values()) + flights
