"""Common to all tests."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.helpers.processes import Finished, fingerprint

# What is slow to import is imported by fixtures: the process that hands out the tests uses none.


@pytest.fixture(autouse=True, scope="session")
def _one_thread_per_process() -> None:
    """pytest-xdist runs a process per core; more torch threads than that slow all of them down."""
    import torch

    torch.set_num_threads(1)


@pytest.fixture(autouse=True, scope="session")
def _signals_as_in_a_terminal() -> None:
    """Under nohup, or behind a script's "&", some are ignored, and then runs ignore them too."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_IGN:
            is_interrupt = number == signal.SIGINT
            signal.signal(number, signal.default_int_handler if is_interrupt else signal.SIG_DFL)


@pytest.fixture(scope="session")
def compiled_simulator():
    """Compile what is compiled at the first call: commands tell of it among what tests look at."""
    import numpy as np

    from orchid_uav.envs import WorldBatch
    from orchid_uav.envs.diagnostics import Diagnostics

    world = WorldBatch(seed=0)
    world.reset()
    diagnostics = Diagnostics(world)
    diagnostics.begin()
    world.step(np.zeros((1, 6, 4)))
    diagnostics.observe()


@pytest.fixture
def plain_environment(monkeypatch, compiled_simulator):
    """Nothing that decides where a command writes, or how, is left from the caller."""
    for name in ("FORCE_COLOR", "NO_COLOR", "TTY_COMPATIBLE", "ORCHID_RUNS_DIR", "PYTHONWARNINGS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "100")


@pytest.fixture(autouse=True)
def _denormal_numbers_as_before() -> Iterator[None]:
    """What computes without them for a while must not leave the whole process without them."""
    yield
    assert sys.float_info.min / 2 > 0


@pytest.fixture
def runs_dir(tmp_path):
    """Where a test's runs go. An earlier run lies there, which nothing may touch."""
    directory = tmp_path / "runs"
    earlier = directory / "20200101T000000Z-earlier-s0-abcd"
    (earlier / "checkpoints" / "100").mkdir(parents=True)
    for name in ("run.json", "episodes.csv", "policy.safetensors", "checkpoints/100/state.json"):
        (earlier / name).write_text(f"{name} of an earlier run\n")
    before = fingerprint(earlier)
    yield directory
    assert fingerprint(earlier) == before


@pytest.fixture
def new_runs(runs_dir):
    """Calls give the directories under ``runs_dir`` that the test has made, oldest first."""
    there_before = set(runs_dir.iterdir())

    def find():
        return sorted(set(runs_dir.iterdir()) - there_before)

    return find


@pytest.fixture
def orchid(capsys, plain_environment):
    """Runs the ``orchid`` command in this process."""
    from orchid_uav.cli.main import main

    def run(*arguments):
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Finished(code, captured.out, captured.err)

    return run


@pytest.fixture
def start_process():
    """Starts a process that ends with the test."""
    started = []

    def start(command, **options):
        piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        process = subprocess.Popen(command, text=True, **piped | options)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def start_orchid(plain_environment, start_process):
    """Starts the ``orchid`` command as a process of its own."""

    def start(*arguments, **options):
        command = [sys.executable, "-m", "orchid_uav", *map(str, arguments)]
        return start_process(command, **options)

    return start
