"""Reads a configuration from a file or a pipe, and says so if it has to wait."""

import io
import os
import select
import stat
from collections.abc import Callable
from pathlib import Path

from orchid_uav.experiments.errors import InputError
from orchid_uav.notices import reason_of

_MOST_BYTES = 2**20
_PATIENCE_S = 1.0
_STREAMS = ("/dev/", "/proc/")
"""Folders of pipes and devices, such as ``/dev/stdin``, whose names do not tell the format."""


def read_configuration(path: Path, say: Callable[[str], object]) -> tuple[str, str]:
    """Return the format, "toml" or "json", and the text of a configuration.

    A pipe, such as ``/dev/stdin`` or a process substitution, is read once and to its end. It is
    taken for JSON if it begins with a brace, with which TOML cannot begin.

    Args:
        path: the file's path; ``~`` is the home directory.
        say: called once if a pipe has to be waited for, with a message that says so.

    Raises:
        InputError: the file cannot be read or is too large, or the pipe is empty.
    """
    suffix = path.suffix.lower()[1:]
    try:
        # Opening a pipe that nobody writes to would block for ever.
        flags = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        descriptor = os.open(path.expanduser(), os.O_RDONLY | flags)
        with os.fdopen(descriptor, "rb", buffering=0) as file:
            mode = os.fstat(descriptor).st_mode
            is_regular = stat.S_ISREG(mode)
            is_stream = not is_regular or str(path.absolute()).startswith(_STREAMS)
            if suffix not in ("toml", "json") and not is_stream:
                raise InputError(f"configuration {path} ends in neither .toml nor .json")
            if file.isatty():
                raise InputError(f"configuration {path} is a terminal, not a file or a pipe")
            content = file.read(_MOST_BYTES + 1) if is_regular else _drain(descriptor, path, say)
        if stat.S_ISFIFO(mode) and not content:
            raise InputError(f"configuration {path} is a pipe that nothing was written to")
        if len(content) > _MOST_BYTES:
            raise InputError(f"configuration {path} is larger than {_MOST_BYTES // 2**20} MiB")
        text = io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig").read()
    except OSError as error:
        raise InputError(f"cannot read configuration {path}: {reason_of(error)}") from error
    except (ValueError, RuntimeError) as error:  # not UTF-8, or no home directory
        raise InputError(f"cannot read configuration {path}: {error}") from error
    if suffix not in ("toml", "json"):
        suffix = "json" if text.lstrip().startswith("{") else "toml"
    return suffix, text


def _drain(descriptor: int, path: Path, say: Callable[[str], object]) -> bytes:
    """The content of a pipe or a device up to its end, or to just above the size allowed."""
    content, has_waited = b"", False
    while len(content) <= _MOST_BYTES:
        select.select([descriptor], [], [], _PATIENCE_S)
        try:
            part = os.read(descriptor, _MOST_BYTES)
        except BlockingIOError:  # a process has it open for writing and has written nothing yet
            if not has_waited:
                say(f"waiting for what is written to {path}")
            has_waited = True
            continue
        if not part:
            break
        content += part
    return content
