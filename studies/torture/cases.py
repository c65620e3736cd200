"""A command as a case: run in a process of its own, and judged by what every command promises."""

import hashlib
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from orchid_uav.cli.main import main

ACCEPTED, REFUSED, ENDED_BY_CTRL_C = 0, 2, 130
PATIENCE_S = 20.0
"""After which a command that goes on (a server, a long training) is sent a ctrl-C."""
_LAST_PATIENCE_S = 60.0
_MEMORY = 16 * 2**30
"""Bytes of address space that a case may have more than its parent has."""
_CRASHED = 70


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    arguments: tuple[str, ...]
    code: int
    """The exit code; minus the signal that killed it."""
    out: str
    err: str
    was_stopped: bool
    """Whether it was still running and was sent a ctrl-C."""


@dataclass
class Tally:
    """What became of the cases of one surface."""

    codes: Counter[str] = field(default_factory=Counter)
    messages: set[str] = field(default_factory=set)
    """The first words of every error, which tell how many ways of refusing were reached."""
    seconds: float = 0.0

    @property
    def cases(self) -> int:
        """How many cases there were."""
        return self.codes.total()

    def count(self, ended: Ended) -> None:
        """Count a case that kept every promise."""
        self.codes["ctrl-C" if ended.was_stopped else str(ended.code)] += 1
        for line in ended.err.splitlines():
            if line.startswith("error: "):
                self.messages.add(" ".join(word for word in line.split()[1:] if word.isalpha()))


def run_case(arguments: Sequence[str], working: Path) -> Ended:
    """Run ``orchid`` with these arguments in a forked process, with ``working`` as its directory.

    The parent has imported and compiled everything already, so that a case takes a moment.
    """
    out, err = working.parent / "stdout", working.parent / "stderr"
    child = os.fork()
    if not child:
        _be_the_command(arguments, working, out, err)
    began_s, was_stopped = time.monotonic(), False
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        passed_s = time.monotonic() - began_s
        if not was_stopped and passed_s > PATIENCE_S:
            was_stopped = True
            os.kill(child, signal.SIGINT)
        if passed_s > PATIENCE_S + _LAST_PATIENCE_S:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.002 if passed_s < 1.0 else 0.05)
    code = os.waitstatus_to_exitcode(status)
    texts = (path.read_text(encoding="utf-8", errors="replace") for path in (out, err))
    return Ended(tuple(arguments), code, *texts, was_stopped)


def _be_the_command(arguments: Sequence[str], working: Path, out: Path, err: Path) -> None:
    """Never returns."""
    code = _CRASHED
    try:
        os.setsid()
        for number, path in ((1, out), (2, err)):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(descriptor, number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        limit = _address_space() + _MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        os.chdir(working)
        code = main(list(arguments))
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _address_space() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


def broken_promises(ended: Ended, before: dict[str, str], after: dict[str, str]) -> list[str]:
    """What a command did that none may do.

    Args:
        ended: how it ended.
        before: :func:`snapshot` of its working directory.
        after: the same when it had ended.
    """
    broken = []
    allowed = {ACCEPTED, REFUSED} | ({ENDED_BY_CTRL_C} if ended.was_stopped else set())
    if ended.code not in allowed:
        broken.append(f"exit code {ended.code}")
    is_wanted = "--debug" in ended.arguments and ended.code == REFUSED
    if "Traceback (most recent call last)" in ended.out + ended.err and not is_wanted:
        broken.append("a traceback")
    if ended.code != REFUSED:
        return broken
    is_list = "--check" in ended.arguments  # of all rules that a mission breaks, as the result
    told = ended.out + ended.err if is_list else ended.err
    errors = [line for line in told.splitlines() if line.startswith("error: ")]
    if not errors or (len(errors) > 1 and not is_list):
        broken.append(f"{len(errors)} lines that begin with 'error: '")
    changed = sorted(name for name in {*before, *after} if before.get(name) != after.get(name))
    if changed:
        broken.append(f"refused, yet left or changed {', '.join(changed[:5])}")
    return broken


def snapshot(directory: Path) -> dict[str, str]:
    """Every path below a directory with the checksum of its content."""
    return {
        str(path.relative_to(directory)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "directory"
        for path in directory.rglob("*")
    }


class Bench:
    """A working directory that every case finds as it was made.

    Args:
        place: an empty directory.
        template: what the working directory holds.
    """

    def __init__(self, place: Path, template: Path) -> None:
        self._working = place / "working"
        self._template = template
        self._before: dict[str, str] = {}
        self._prepare()

    def _prepare(self) -> None:
        shutil.rmtree(self._working, ignore_errors=True)
        shutil.copytree(self._template, self._working, symlinks=True)
        self._before = snapshot(self._working)

    def try_one(self, arguments: Sequence[str], files: dict[str, bytes], tally: Tally) -> None:
        """Run a case and judge it.

        Args:
            arguments: of ``orchid``.
            files: what is written into the working directory before, by name.
            tally: counts it.

        Raises:
            AssertionError: a promise was broken.
        """
        for name, content in files.items():
            (self._working / name).write_bytes(content)
        before = self._before | {
            name: hashlib.sha256(content).hexdigest() for name, content in files.items()
        }
        began_s = time.monotonic()
        ended = run_case(arguments, self._working)
        tally.seconds += time.monotonic() - began_s
        after = snapshot(self._working)
        if after != self._before:
            self._prepare()
        broken = broken_promises(ended, before, after)
        if broken:
            said = ended.err[-1500:] + ended.out[-300:]
            raise AssertionError(f"{'; '.join(broken)}: orchid {list(arguments)}\n{said}")
        tally.count(ended)
