"""Standard output that can be lost without harm: a closed terminal, a full disk, ``| head -1``."""

import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

_UNKNOWN = "replace"
"""How characters are written that the stream cannot encode, such as "³" in ASCII."""


class _Lasting(io.RawIOBase):
    """Writes to another stream; once that fails, everything further is dropped."""

    def __init__(self, raw: io.RawIOBase) -> None:
        self._raw = raw
        self.error: OSError | None = None

    def write(self, content: Any, /) -> int:
        size = memoryview(content).nbytes
        if self.error is None:
            try:
                written = self._raw.write(content)
                if written is not None:
                    return written
                self.error = BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
            except OSError as error:
                self.error = error
        return size

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._raw.fileno()

    def isatty(self) -> bool:
        return not self._raw.closed and self._raw.isatty()  # libraries ask at the very end as well


class Output:
    """Tells whether standard output was lost."""

    def __init__(self, stream: TextIO, lasting: _Lasting | None) -> None:
        self._stream = stream
        self._lasting = lasting

    def loss(self) -> OSError | None:
        """The error if some of what was printed so far could not be written, else None."""
        self._stream.flush()
        return self._lasting.error if self._lasting is not None else None


@contextmanager
def lasting_output() -> Iterator[Output]:
    """Make writing to ``sys.stdout`` and ``sys.stderr`` never fail, for displays as well.

    Everything that is printed once a stream has failed is dropped. Streams without a
    file descriptor, such as those of a notebook, are left unchanged.
    """
    before = sys.stdout, sys.stderr
    (sys.stdout, lasting), (sys.stderr, _) = map(_made_lasting, before)
    try:
        yield Output(sys.stdout, lasting)
    finally:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        sys.stdout, sys.stderr = before


def _made_lasting(stream: TextIO) -> tuple[TextIO, _Lasting | None]:
    buffer: Any = getattr(stream, "buffer", None)
    raw = getattr(buffer, "raw", buffer)  # the same where Python is told not to buffer
    if not isinstance(stream, io.TextIOWrapper):
        return stream, None
    if not isinstance(raw, io.RawIOBase):
        stream.reconfigure(errors=_UNKNOWN)
        return stream, None
    lasting = _Lasting(raw)
    binary: Any = lasting if raw is buffer else io.BufferedWriter(lasting)
    made = io.TextIOWrapper(
        binary,
        encoding=stream.encoding,
        errors=_UNKNOWN,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )
    return made, lasting
