"""The compiled step's cache: quick the second time, never stale, not needed."""

import ast
import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from orchid_uav import notices
from orchid_uav.envs import compilation, dynamics
from orchid_uav.notices import show_on_stderr
from tests.helpers.processes import file_size_limit
from tests.mutants import copy_package

PROBE = """
import numpy
from orchid_uav.envs.channel import spectral_efficiency
from orchid_uav.envs.compilation import SOURCES, compiled

@compiled
def probe(numbers, sources=SOURCES):
    numbers[0] = spectral_efficiency(numbers[0])

numbers = numpy.array([3.0])
probe(numbers)
print(sum(probe.stats.cache_hits.values()), numbers[0])
"""


def test_an_equation_changed_in_another_file_is_compiled_anew(tmp_path):
    # numba's own key is the file of the compiled function, which does not change here.
    channel = copy_package(tmp_path) / "envs" / "channel.py"
    (tmp_path / "probe.py").write_text(PROBE)

    def probe() -> tuple[int, float]:
        finished = subprocess.run(
            [sys.executable, "-c", "import probe"],
            env={**os.environ, "PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        hits, number = finished.stdout.split()
        return int(hits), float(number)

    assert probe() == (0, 2.0)
    assert probe() == (1, 2.0)
    text = channel.read_text()
    changed = text.replace("logarithm_2(1.0 + snr)", "logarithm_2(5.0 + snr)")
    assert changed != text
    channel.write_text(changed)
    assert probe() == (0, 3.0)


def test_every_compiled_function_is_kept_under_the_equations_of_all_files():
    found = []
    for path in sorted(Path(compilation.__file__).parents[1].rglob("*.py")):
        for part in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(part, ast.FunctionDef) and "compiled" in map(
                ast.unparse, part.decorator_list
            ):
                name = f"{path.stem}.{part.name}"
                last, value = part.args.args[-1].arg, ast.unparse(part.args.defaults[-1])
                assert (last, value) == ("sources", "SOURCES"), name
                found.append(name)
    assert {"dynamics.step_worlds", "diagnostics.inspect_worlds"} <= set(found)


DOUBLE = """
def double(numbers):
    for index in range(len(numbers)):
        numbers[index] *= 2.0
"""


@pytest.fixture
def double(tmp_path, monkeypatch, capsys):
    """A function in a file, compiled as by a process that has just started.

    Calls give how often its code was read from the cache, and what was said of that.
    """
    file = tmp_path / "doubling.py"
    file.write_text(DOUBLE)
    show_on_stderr()

    def call(numbers=(1.5,)) -> tuple[int, list[str]]:
        monkeypatch.setattr(notices, "_told", set())
        module = {"__name__": "doubling"}
        exec(compile(DOUBLE, file, "exec"), module)
        function = compilation.compiled(module["double"])
        array = np.array(numbers)
        capsys.readouterr()
        function(array)
        assert array.tolist() == [2 * number for number in numbers]
        return sum(function.stats.cache_hits.values()), capsys.readouterr().err.splitlines()

    return call


@pytest.fixture
def cache(tmp_path):
    """Where it keeps its code."""
    return tmp_path / "__pycache__"


COMPILING = "note: compiling the simulator, ten seconds to a minute, "


def test_compiling_is_announced_where_it_is_done(double):
    assert double() == (0, [f"{COMPILING}once on this machine"])
    assert double() == (1, [])


def flipped(content: bytes, share: float) -> bytes:
    place = int(share * (len(content) - 1))
    return content[:place] + bytes([content[place] ^ 16]) + content[place + 1 :]


class TestDamagedCache:
    @pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
    @pytest.mark.parametrize(
        "damage",
        [
            lambda content: b"",
            lambda content: content[:1],
            lambda content: content[: len(content) // 2],
            lambda content: content[:-40],
            lambda content: b"no pickle at all\n",
            lambda content: bytes(len(content)),
        ],
    )
    def test_is_told_and_replaced(self, double, cache, suffix, damage):
        double()
        [file] = cache.glob(f"*{suffix}")
        file.write_bytes(damage(file.read_bytes()))
        hits, (warning, note) = double()
        assert hits == 0
        assert warning.startswith(f"warning: compiled code in {cache} was damaged, and is replaced")
        assert note == f"{COMPILING}once on this machine"
        assert double() == (1, [])

    @pytest.mark.parametrize("share", [number / 8 for number in range(9)])
    @pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
    def test_is_never_run(self, double, cache, suffix, share):
        # Most bits of the code's file are machine code: it would do something, but what?
        double()
        [file] = cache.glob(f"*{suffix}")
        file.write_bytes(flipped(file.read_bytes(), share))
        hits, _ = double()  # which looks at the result
        assert hits == 0 or suffix == ".nbi"
        double()
        assert double() == (1, [])

    def test_with_code_of_another_key_in_its_place(self, double, cache):
        # As a process leaves it that dies, or finds the disk full, behind its index.
        double()
        [code] = cache.glob("*.nbc")
        of_floats = code.read_bytes()
        for path in cache.iterdir():
            path.unlink()
        double((3,))  # integers
        [code] = cache.glob("*.nbc")
        code.write_bytes(of_floats)
        assert double((3,))[0] == 0
        assert double((3,)) == (1, [])

    def test_that_cannot_be_read(self, double, cache):
        double()
        [index] = cache.glob("*.nbi")
        index.unlink()
        index.mkdir()  # permissions do not bind root
        hits, lines = double()
        assert hits == 0
        assert_goes_without(lines, cache)


def assert_goes_without(lines, cache, *reasons: str) -> None:
    [warning] = [line for line in lines if line.startswith("warning: ")]
    assert f"compiled code cannot be kept in {cache}" in warning
    assert "NUMBA_CACHE_DIR" in warning
    assert not reasons or any(reason in warning for reason in reasons)
    assert any(line.startswith(COMPILING) for line in lines)


class TestNoRoomForTheCache:
    @pytest.mark.parametrize("size", [0, 2000])
    def test_is_told_with_its_place(self, double, cache, size):
        # None for the index, or none for the code behind it.
        with file_size_limit(size):
            assert_goes_without(double()[1], cache, "File too large")
        assert double() == (0, [f"{COMPILING}once on this machine"])
        assert double() == (1, [])

    def test_of_another_kind(self, double, cache, monkeypatch):
        def replace(source, target):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), source)

        monkeypatch.setattr(os, "replace", replace)
        assert_goes_without(double()[1], cache, "No space left on device")
        assert not list(cache.glob("*tmp*"))

    def test_and_no_folder_that_can_be_written(self, double, cache, monkeypatch):
        monkeypatch.setattr(compilation._Places, "_locator_classes", [])
        hits, lines = double()
        assert (hits, len(lines)) == (0, 2)
        assert_goes_without(lines, cache, "it cannot be written")
        assert lines[-1] == f"{COMPILING}at every start"
        assert not cache.exists()


def test_without_a_home_no_folder_is_made_in_the_current_one(tmp_path):
    # numba takes "~" for the name of a folder where there is no home.
    (tmp_path / "__pycache__").write_text("no folder\n")
    (tmp_path / "doubling.py").write_text(DOUBLE)
    script = """
import os
os.path.expanduser = lambda path: path
import numpy, doubling
from orchid_uav.envs import compilation
compilation.compiled(doubling.double)(numpy.ones(1))
"""
    finished = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    # No handler was set up, as in a program that uses the package: a line all the same.
    assert finished.stderr.startswith("compiled code cannot be kept in ")
    assert len(finished.stderr.splitlines()) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"__pycache__", "doubling.py"}


def test_a_damaged_cache_changes_no_exit_code(tmp_path, start_orchid):
    # An EOFError is what Typer takes for ctrl-C.
    own = Path(dynamics.__file__)
    locator = dynamics.step_worlds._cache._impl.locator  # the class's name depends on the version
    folder = tmp_path / "cache" / locator.get_suitable_cache_subpath(str(own))
    shutil.copytree(dynamics.step_worlds.stats.cache_path, folder)
    [index] = folder.glob("diagnostics.inspect_worlds*.nbi")
    index.write_bytes(b"")
    flags = ["--uavs=2", "--users=9", "--episodes=1", "--methods=static-mmf", "--no-figures"]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    process = start_orchid("eval", *flags, "--out", tmp_path / "eval", env=environment)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    warning, note = err.splitlines()
    assert warning.startswith(f"warning: compiled code in {folder} was damaged, and is replaced")
    assert note.startswith(COMPILING)
    assert index.stat().st_size
