"""Starts, stops and kills child processes, and says why they ended."""

import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

JOB_ENVIRONMENT = {
    "ORCHID_JOB": "1",
    # On small networks one thread is fastest; the processes themselves run in parallel.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
}
"""Environment of a child. ``ORCHID_JOB`` tells it that its standard input ends when its parent
does."""

_LONGEST_ERROR = 300
_LOG_END_BYTES = 8192
_ESCAPE_CODE = re.compile(r"\x1b(\[[0-9;?]*[ -/]*[@-~]|\][^\x07\x1b]*(\x07|\x1b\\)|.)")


@contextmanager
def readable_exit_codes() -> Iterator[None]:
    """Do not ignore SIGCHLD in this block: if it is ignored, every exit code reads as 0."""
    is_settable = threading.current_thread() is threading.main_thread()
    if not is_settable or not hasattr(signal, "SIGCHLD"):
        yield
        return
    before = signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGCHLD, before)


@dataclass
class Child:
    """A process in its own session, which the terminal's ctrl-C does not reach."""

    process: subprocess.Popen[bytes]
    log: Path
    log_start: int
    """Size of the log, in bytes, when the process began."""
    began_s: float
    is_asked_to_stop: bool = False

    @classmethod
    def start(cls, command: Sequence[str], log: Path) -> "Child":
        """Start a process with one thread per library; its output is appended to a log.

        Raises:
            OSError: there is no such program, or the log cannot be written.
            ValueError: no system can start such a command.
        """
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("ab") as output:
            log_start = output.seek(0, os.SEEK_END)
            began_s = time.monotonic()
            process = subprocess.Popen(
                command,
                bufsize=0,
                stdin=subprocess.PIPE,  # held open until the process has ended
                stdout=output,
                stderr=subprocess.STDOUT,
                close_fds=True,  # otherwise one child would hold the pipe of another
                start_new_session=True,
                env=os.environ | JOB_ENVIRONMENT,
            )
        return cls(process, log, log_start, began_s)

    def stop(self) -> None:
        """Ask the process to save what it has and end."""
        if not self.is_asked_to_stop:
            self.is_asked_to_stop = True
            self.process.terminate()

    def kill(self) -> None:
        """Kill the process and all processes that it started."""
        if self.process.poll() is None:
            with suppress(ProcessLookupError, PermissionError):  # it has just ended
                if hasattr(os, "killpg"):
                    os.killpg(self.process.pid, signal.SIGKILL)
                else:
                    self.process.kill()

    def close(self) -> None:
        """Wait for its end, which was asked for."""
        self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()


def describe_end(code: int, log: Path, log_start: int) -> str:
    """Say why a process ended, in at most 300 characters: its signal, or its last output.

    Args:
        code: its exit code, or minus the signal that killed it.
        log: the file that its output went to.
        log_start: size of the log, in bytes, when the process began.
    """
    if code < 0:
        try:
            return f"killed by {signal.Signals(-code).name}"
        except ValueError:  # a signal without a name
            return f"killed by signal {-code}"
    # An error of the command line takes one or two lines and begins with "error:".
    lines = _lines_at_the_end(log, log_start)[-2:]
    begins = (index for index, line in enumerate(lines) if line.startswith("error:"))
    text = " ".join(lines[next(begins, -1) :])
    return shortened(text or f"exit code {code}, and nothing in {log}")


def shortened(text: str) -> str:
    """A text, cut to at most 300 characters."""
    return text if len(text) <= _LONGEST_ERROR else text[: _LONGEST_ERROR - 4] + " ..."


def _lines_at_the_end(log: Path, start: int) -> list[str]:
    try:
        with log.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(start, size - _LOG_END_BYTES))
            text = file.read(_LOG_END_BYTES).decode(errors="replace")
    except OSError:
        return []
    lines = _ESCAPE_CODE.sub("", text).splitlines()
    plain = ("".join(one if one.isprintable() else " " for one in line) for line in lines)
    return [line.strip() for line in plain if line.strip()]
