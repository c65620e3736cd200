"""What a user should know of the machine, though nothing fails of it: said once in a process.

It goes to the logger ``orchid_uav``: a program that uses the package decides what becomes of it,
and Python itself shows warnings where none does. The command and its jobs show notes as well.
How an exception reads in one line stands here, too.
"""

import logging
import sys
from contextlib import suppress

_LOGGER = logging.getLogger("orchid_uav")
_told: set[str] = set()


def note_once(subject: str, message: str) -> None:
    """Log a note, once for each subject."""
    _log_once(logging.INFO, subject, message)


def warn_once(subject: str, message: str) -> None:
    """Log a warning, once for each subject."""
    _log_once(logging.WARNING, subject, message)


def _log_once(level: int, subject: str, message: str) -> None:
    if subject not in _told:
        _told.add(subject)
        _LOGGER.log(level, "%s", message)


class _Stderr(logging.Handler):
    """Prints on whatever is the standard error output at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a line."""
        word = "warning" if record.levelno >= logging.WARNING else "note"
        if sys.stderr is not None:
            with suppress(OSError, ValueError):  # nobody can be told
                print(f"{word}: {record.getMessage()}", file=sys.stderr, flush=True)


_STDERR = _Stderr()


def show_on_stderr(with_notes: bool = True) -> None:
    """Print warnings on stderr from now on, and notes too."""
    _LOGGER.setLevel(logging.INFO if with_notes else logging.WARNING)
    _LOGGER.propagate = False
    _LOGGER.addHandler(_STDERR)  # once, however often it is asked for


def in_one_line(error: BaseException) -> str:
    """What an exception says, in one line; its kind where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__


def reason_of(error: OSError) -> str:
    """Why the system refused something, in its words alone."""
    return error.strerror or in_one_line(error)


def kind_and_reason(error: BaseException) -> str:
    """The kind of an unforeseen exception and what it says, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
