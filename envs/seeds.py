"""The seeds of worlds, and the streams of random numbers that they begin."""

import numpy as np

_EVALUATION_STREAM = 2**31
"""First spawn key of held-out topologies; worlds of training count from 0."""


def world_seeds(seed: int, worlds: int) -> list[int]:
    """The seeds of ``worlds`` worlds that belong to one seed.

    World 0 takes ``seed`` itself, so that a batch of one is the single environment with that seed.
    The others take hashed seeds rather than seed + 1, seed + 2 ..., with which runs of
    neighbouring seeds would share their worlds. World i's seed does not depend on ``worlds``.
    """
    children = np.random.SeedSequence(seed).spawn(worlds)
    return [seed, *(_hashed(child) for child in children[1:])]


def evaluation_seeds(seed: int, count: int) -> list[int]:
    """Seeds of ``count`` held-out topologies: another stream than :func:`world_seeds`.

    The first ones do not depend on ``count``.
    """
    stream = np.random.SeedSequence(seed, spawn_key=(_EVALUATION_STREAM,))
    return [_hashed(child) for child in stream.spawn(count)]


def _hashed(sequence: np.random.SeedSequence) -> int:
    # 63 bits: seeds are stored in JSON and handed to libraries that take signed integers.
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))
