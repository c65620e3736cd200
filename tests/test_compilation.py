"""The compiled step's cache: quick the second time, never stale, not needed."""

import os
import subprocess
import sys

import numba

from orchid_uav.envs import compilation
from tests.mutants import copy_package

FLY = """
import numpy
from orchid_uav.envs import WorldBatch, dynamics
world = WorldBatch(seed=0)
world.reset()
world.step(numpy.zeros((1, 6, 4)))
hits = sum(dynamics.step_worlds.stats.cache_hits.values())
print(hits, world.arrays.rates_bps.sum())
"""


def fly(directory) -> tuple[int, float]:
    finished = subprocess.run(
        [sys.executable, "-c", FLY],
        env={**os.environ, "PYTHONPATH": str(directory)},
        capture_output=True,
        text=True,
        check=True,
    )
    hits, rates = finished.stdout.split()
    return int(hits), float(rates)


def test_an_equation_changed_in_another_file_is_compiled_anew(tmp_path):
    # numba's own key is the file of the compiled function, which does not change here.
    channel = copy_package(tmp_path) / "envs" / "channel.py"
    first = fly(tmp_path)
    again = fly(tmp_path)
    assert (first[0], again[0]) == (0, 1)
    assert first[1] == again[1]
    text = channel.read_text()
    changed = text.replace("np.log2(1.0 + snr)", "np.log2(2.0 + snr)")
    assert changed != text
    channel.write_text(changed)
    hits, rates = fly(tmp_path)
    assert hits == 0
    assert rates > first[1]


def test_goes_without_a_cache_where_none_can_be_written(monkeypatch):
    def njit(*functions, cache=False, **options):
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return numba.njit(*functions, **options)

    monkeypatch.setattr(compilation, "njit", njit)
    double = compilation.compiled(lambda number: 2.0 * number)
    assert double(3.0) == 6.0
