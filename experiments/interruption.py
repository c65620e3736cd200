"""Signals that ask to stop are noted as requests, so that what is done is kept."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGXCPU")
"""Sent by ctrl-C; by ``kill``; by a terminal that closes; by batch systems before their time limit
(Slurm's ``--signal=USR1``); by the kernel at a limit of processor time. Some systems lack some."""
_OF_OTHERS = ("SIGUSR1", "SIGXCPU")
"""Handled only if nothing else handles them: programs that start jobs of their own may."""
_SECONDS_OF_ONE_REQUEST = 1.0
"""Seconds in which further signals are taken for repetitions of the first one."""

AFTER_UPDATE = b"stopping after the update that follows; ctrl-C once more stops at once\n"
"""What a training run prints at the first signal."""


class Raising(Enum):
    """When signals raise KeyboardInterrupt."""

    AT_ONCE = "at the first one"
    IF_URGENT = "at a second ctrl-C"
    NEVER = "never"


class Interruption:
    """What signals have asked for.

    Only a ctrl-C more than a second after the first signal is urgent, since it comes from a person.
    Every other signal only repeats the first request, whoever sends it and however often.
    """

    def __init__(self) -> None:
        self.requested = False
        self.is_urgent = False
        self._first_s = 0.0
        self._raising = Raising.NEVER
        self._message = b""
        self._holders = 0
        self._is_due = False

    @contextmanager
    def held_back(self) -> Iterator[None]:
        """Delay KeyboardInterrupt until this block, such as one that writes files, has ended."""
        self._holders += 1
        try:
            yield
        finally:
            self._holders -= 1
        if self._is_due and not self._holders:
            self._is_due = False
            raise KeyboardInterrupt

    def _note(self, signal_number: int, frame: FrameType | None) -> None:
        now_s = time.monotonic()
        is_first = not self.requested
        if is_first:
            self.requested, self._first_s = True, now_s
            self._tell()
        elif signal_number == signal.SIGINT and now_s - self._first_s > _SECONDS_OF_ONE_REQUEST:
            self.is_urgent = True
        if (self._raising is Raising.AT_ONCE and is_first) or (
            self._raising is not Raising.NEVER and self.is_urgent
        ):
            if not self._holders:
                raise KeyboardInterrupt
            self._is_due = True

    def _tell(self) -> None:
        # Not `print`, in the middle of which the signal may have come. The terminal may be gone.
        with suppress(OSError):
            os.write(2, self._message)


_contexts: list[Interruption] = []
"""The contexts of this process, innermost last: all share one interruption, as signals do."""


@contextmanager
def interruption_requests(
    raising: Raising = Raising.IF_URGENT, message: bytes = AFTER_UPDATE
) -> Iterator[Interruption]:
    """Record signals instead of being ended by them.

    Signals that the caller ignores (nohup, a shell's background job) stay ignored. A context inside
    another one yields the same interruption, with its own ``raising`` and ``message``. Outside the
    main thread, where Python delivers no signals, nothing is changed.

    Args:
        raising: when KeyboardInterrupt is raised.
        message: written to stderr at the first signal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield Interruption()
        return
    is_outermost = not _contexts
    interruption = Interruption() if is_outermost else _contexts[-1]
    _contexts.append(interruption)
    before = interruption._raising, interruption._message
    interruption._raising, interruption._message = raising, message
    previous = {}
    try:
        for number in _heeded() if is_outermost else ():
            previous[number] = signal.signal(number, interruption._note)
        yield interruption
    finally:
        interruption._raising, interruption._message = before
        for number, handler in previous.items():
            signal.signal(number, handler)
        _contexts.pop()


def ignore_signals() -> None:
    """Ignore signals from now on: everything is written, and the process is about to end."""
    for number in _heeded():
        signal.signal(number, signal.SIG_IGN)


def _heeded() -> Iterator[signal.Signals]:
    for name in _NAMES:
        if hasattr(signal, name):
            number = signal.Signals[name]
            handler = signal.getsignal(number)
            is_free = handler is signal.SIG_DFL if name in _OF_OTHERS else handler is not None
            if is_free and handler is not signal.SIG_IGN:
                yield number
