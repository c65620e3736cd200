"""Ctrl-C and SIGTERM as a request, so that what is done is kept."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interruption:
    """Whether a stop was asked for."""

    def __init__(self) -> None:
        self.requested = False


_AFTER_UPDATE = b"stopping after the update that follows; once more stops at once\n"


@contextmanager
def interruption_requests(message: bytes = _AFTER_UPDATE) -> Iterator[Interruption]:
    """Note SIGINT, SIGTERM and SIGHUP instead of dying of them; a second one acts at once.

    The first one has ``message`` written to stderr. Outside the main thread, where Python delivers
    no signals, nothing is changed.
    """
    interruption = Interruption()

    def note(signal_number: int, frame: FrameType | None) -> None:
        if interruption.requested:
            raise KeyboardInterrupt
        interruption.requested = True
        # Not print: the signal may have come in the middle of one.
        os.write(2, message)

    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    caught = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP"):  # the terminal is closed
        caught.append(signal.SIGHUP)
    # What the caller ignores (nohup, a shell's background job) stays ignored.
    heeded = [number for number in caught if signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, note) for number in heeded}
    try:
        yield interruption
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
