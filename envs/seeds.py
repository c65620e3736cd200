"""Seeds, and what keeps the streams of random numbers that come from one seed apart.

The table "Random numbers" in docs/environment.md says for every generator of this project who draws
from it, what its key is, and what its numbers must not depend on.
"""

import numpy as np

EVALUATION_STREAM = 2**31
"""Spawn key that leads from the seed of an evaluation to its topologies. The worlds of a training
run have the spawn keys 0, 1, 2 …, so that they never meet these."""
NOISE_STREAM = 2**31
"""Spawn key that leads from the seed of a topology to the exploration noise flown on it."""
SENSING_STREAM, START_STREAM = 1, 2
"""Second number of the keys of Phase I's sensing error (M29) and of its random start (M28); the
first number is what Phase I takes from the world's generator."""
MASTS_STREAM = 5
"""Second number of the key of the shadowing of all masts but the first (M45); the first number is
the seed of the users' walks."""
FLIGHT_SENSING_STREAM = 3
"""Second number of the key of the error on the users' positions in flight (M39); the first number
is the seed of the users' walks."""
RANDOM_RESETS_STREAM = 1
"""Second number of the key from which the episodes of random resets are drawn; the first number is
the seed of the training run."""
IMITATION_STREAM = 4
"""Third number of the key from which an iteration of imitation draws; the others are the seed of
the training run and the iteration."""
RESAMPLING_SEED = 0
"""Seed of all bootstraps and permutation tests, so that equal data give equal intervals."""


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
    stream = np.random.SeedSequence(seed, spawn_key=(EVALUATION_STREAM,))
    return [_hashed(child) for child in stream.spawn(count)]


def _hashed(sequence: np.random.SeedSequence) -> int:
    # 63 bits: seeds are stored in JSON and handed to libraries that take signed integers.
    return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))
