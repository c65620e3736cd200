"""Worlds over several threads: which are given to whom, and that no number depends on it."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.envs import threads
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.threads import LEAST_LINKS, parts_of, run_each
from orchid_uav.envs.world import WorldBatch

WALKING = {"user_speed_mps": 10.0, "user_count": 40, "uav_count": 3}


@given(st.integers(1, 500), st.integers(2, 10**7), st.integers(1, 300))
def test_parts_are_all_worlds_once_as_equal_as_they_can_be(worlds, links, count):
    parts = parts_of(worlds, links, count)
    sizes = [part.stop - part.start for part in parts]
    assert parts[0].start == 0
    assert parts[-1].stop == worlds
    assert all(one.stop == other.start for one, other in itertools.pairwise(parts))
    assert max(sizes) - min(sizes) <= 1
    assert len(parts) <= max(count, 1)
    assert len(parts) == 1 or min(sizes) * links * len(parts) > LEAST_LINKS


@pytest.mark.parametrize("count", [2, 3, 7])
@pytest.mark.parametrize("worlds", [1, 11, 16])
def test_no_bit_depends_on_the_number_of_threads(monkeypatch, count, worlds):
    monkeypatch.setattr(threads, "LEAST_LINKS", 1)
    both = [
        WorldBatch(Parameters().with_overrides(WALKING), worlds, seed=4, threads=one)
        for one in (1, count)
    ]
    metrics = []
    for world in both:
        generator, diagnostics = np.random.default_rng(0), Diagnostics(world)
        world.reset()
        diagnostics.begin()
        for _ in range(15):
            world.step(generator.uniform(-1.0, 1.0, (worlds, 3, 4)))
            diagnostics.observe()
        metrics.append([diagnostics.episode_metrics(index) for index in range(worlds)])
    for array, other in zip(both[0].arrays, both[1].arrays, strict=True):
        np.testing.assert_array_equal(array, other)
    assert metrics[0] == metrics[1]


def test_what_is_wrong_in_a_thread_is_told():
    def fail(part: slice) -> None:
        if part.start == 0:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_each(fail, [slice(0, 1), slice(1, 2)])


def test_threads_are_one_at_least():
    with pytest.raises(ValueError, match="threads is 0"):
        WorldBatch(threads=0)
