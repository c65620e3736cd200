"""Small runs, and helpers that their tests share."""

import ctypes
import hashlib
import importlib.util
import json
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from orchid_uav.experiments.configuration import Layer, RunConfig, merge
from orchid_uav.experiments.training.listeners import Reporter

TINY = {
    "network.uav_count": 2,
    "network.user_count": 20,
    "network.episode_slots": 10,
    "ppo.hidden_sizes": [16, 16],
}
"""A configuration that flies and learns an episode in about ten milliseconds."""

TINY_FLAGS = [f"--set={key}={json.dumps(value)}" for key, value in TINY.items()]

COLUMNS = [
    "episode",
    "reward",
    "coverage",
    "energy_efficiency_bit_per_joule",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "sum_rate_bps",
    "propulsion_power_w",
    "collisions",
    "boundary_violations",
    "backhaul_violations",
    "actor_lr",
    "critic_lr",
    "entropy_coef",
    "reset",
]
"""Columns of ``episodes.csv``, written out here because other programs rely on them."""

WHOLE_NUMBERS = ("episode", "collisions", "boundary_violations", "backhaul_violations", "reset")

ESCAPE = "\x1b"

NEEDS_SUPERSUIT = pytest.mark.skipif(
    importlib.util.find_spec("supersuit") is None,
    reason="SuperSuit, the extra 'supersuit', is not installed",
)
_CAPABILITIES_VERSION = 0x20080522
_PASS_OVER_PERMISSIONS = 1 << 1 | 1 << 2  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH


@dataclass(frozen=True)
class Finished:
    """A command that has ended."""

    code: int
    out: str
    err: str


def tiny_config(episodes: int = 3, **values: Any) -> RunConfig:
    """TINY with some values changed; keys have two underscores, as in ``reset__window=2``."""
    dotted = {key.replace("__", "."): value for key, value in values.items()}
    return merge([Layer("test", TINY | {"training.episodes": episodes} | dotted)])[0]


def cells(directory: Path) -> list[list[str]]:
    """The lines of a run's ``episodes.csv``, split, header first."""
    text = (directory / "episodes.csv").read_text()
    assert text.endswith("\n"), "the last row is cut off"
    return [line.split(",") for line in text.splitlines()]


def columns(directory: Path) -> dict[str, list[float]]:
    """The columns of a run's ``episodes.csv``, read without the project's own reader."""
    header, *rows = cells(directory)
    assert all(len(row) == len(header) for row in rows)
    return {name: [float(row[index]) for row in rows] for index, name in enumerate(header)}


def record_of(directory: Path) -> dict[str, Any]:
    """A run's ``run.json``."""
    return json.loads((directory / "run.json").read_text())


def files_of(directory: Path) -> set[str]:
    """Names of a run's files; those of TensorBoard without the part that differs between runs."""
    return {re.sub(r"(tfevents)\..*", r"\1", path.name) for path in directory.iterdir()}


def fingerprint(directory: Path) -> dict[str, str]:
    """Every path below a directory with the hash of its content."""
    return {
        str(path.relative_to(directory)): (
            hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "directory"
        )
        for path in sorted(directory.rglob("*"))
    }


def assert_is_an_error(finished: Finished, *parts: str, code: int = 2) -> None:
    """Check that the command failed with the parts on one or two stderr lines, and no output."""
    assert finished.code == code
    assert finished.out == ""
    assert finished.err.startswith("error: ")
    assert len(finished.err.splitlines()) <= 2, finished.err
    for part in parts:
        assert part in finished.err


@contextmanager
def file_size_limit(size: int) -> Iterator[None]:
    """Like a full disk: no file of this process can grow beyond ``size`` bytes."""
    resource = pytest.importorskip("resource", reason="limits on file sizes are POSIX")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextmanager
def without_privileges() -> Iterator[None]:
    """Remove root's right to ignore permissions, but not its rights to its own files.

    Switching to another user might not work: it may be unable to enter the checkout, for example
    below root's home.
    """
    if os.geteuid() != 0:
        yield
        return
    if sys.platform != "linux":
        pytest.skip("root ignores permissions here")
    library = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITIES_VERSION, 0)  # of this thread
    sets = (ctypes.c_uint32 * 6)()  # effective, permitted, inheritable; and again, the higher bits
    assert library.capget(header, sets) == 0, os.strerror(ctypes.get_errno())
    before = sets[0]
    sets[0] = before & ~_PASS_OVER_PERMISSIONS
    assert library.capset(header, sets) == 0, os.strerror(ctypes.get_errno())
    try:
        yield
    finally:
        sets[0] = before
        assert library.capset(header, sets) == 0, os.strerror(ctypes.get_errno())


class Audience(Reporter):
    """A reporter that records its calls, and calls a function after each update.

    Args:
        on_show: a function, called with the finished episodes.
    """

    def __init__(self, on_show: Callable[[int], None] = lambda episodes: None) -> None:
        self.on_show = on_show
        self.began_behind = -1
        self.episodes = 0
        self.warnings: list[str] = []

    def begin(self, run, config, rows, reset_episodes) -> None:
        self.began_behind = self.episodes = len(rows)

    def show(self, rows, reset_episodes) -> None:
        self.episodes += len(rows)
        self.on_show(self.episodes)

    def warn(self, message: str) -> None:
        self.warnings.append(message)


def learned_files(directory: Path) -> tuple[bytes, bytes]:
    """The files of a run that must be the same bit for bit, however often it was stopped."""
    return (
        (directory / "episodes.csv").read_bytes(),
        (directory / "policy.safetensors").read_bytes(),
    )


class _InHalves:
    """A file whose ``write`` happens in two steps."""

    def __init__(self, file: Any, tell: Callable[[str], None]) -> None:
        self._file, self._tell = file, tell

    def write(self, content: Any) -> int:
        self._tell("write")
        half = len(content) // 2
        written = self._file.write(content[:half])
        self._file.flush()
        self._tell("write")
        return written + self._file.write(content[half:])

    def __enter__(self) -> "_InHalves":
        return self

    def __exit__(self, *error: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def tell_of_file_steps(patch: pytest.MonkeyPatch, tell: Callable[[str], None]) -> None:
    """Call ``tell`` with a step's name before each change of a file, and amid each write."""

    def telling(name: str) -> None:
        original = getattr(os, name)

        def step(*arguments: Any, **options: Any) -> Any:
            tell(name)
            return original(*arguments, **options)

        patch.setattr(os, name, step)

    for name in ("mkdir", "rename", "replace", "unlink", "rmdir", "truncate", "fsync"):
        telling(name)
    open_path, open_descriptor = Path.open, os.fdopen

    def opened(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        if not set(mode) & set("wax+"):
            return open_path(path, mode, *arguments, **options)
        tell("open")
        return _InHalves(open_path(path, mode, *arguments, **options), tell)

    def descriptor_opened(descriptor: int, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        file = open_descriptor(descriptor, mode, *arguments, **options)
        return _InHalves(file, tell) if set(mode) & set("wax+") else file

    patch.setattr(Path, "open", opened)
    patch.setattr(os, "fdopen", descriptor_opened)


@contextmanager
def signals_by_default() -> Iterator[None]:
    """Let signals stop processes, even if tests run under nohup or as a background job."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGXCPU")
    numbers = [signal.Signals[name] for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.SIG_DFL) for number in numbers}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def forked(task: Callable[[], object]) -> int:
    """Start a process that does the task, with exit code 0 on success; return its number."""
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", DeprecationWarning
        )  # the child does not have xdist's threads
        child = os.fork()
    if child:
        return child
    code = 70
    try:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(120)  # end it, whatever it waits for
        task()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def killed_at_step(task: Callable[[], object], at: int, watch: Callable[..., None]) -> bool:
    """Do the task in a process that is killed at a step; return False if it ended before.

    Args:
        task: what the process does.
        at: the number of the step, from 1.
        watch: takes a monkeypatch and a function, and has the function called before each step.
    """
    steps = 0

    def tell(kind: str) -> None:
        nonlocal steps
        steps += 1
        if steps == at:
            os.kill(os.getpid(), signal.SIGKILL)

    def watched() -> None:
        watch(pytest.MonkeyPatch(), tell)
        task()

    _, status = os.waitpid(forked(watched), 0)
    if os.WIFEXITED(status):
        assert os.WEXITSTATUS(status) == 0, "the process failed by itself"
        return False
    assert os.WTERMSIG(status) == signal.SIGKILL
    return True
