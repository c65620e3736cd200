"""Whether an ONNX file flies as the NumPy actor does."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents.deployed_actor import LocalActor
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.exporting.graph import INPUT

TOLERANCE = 1e-5
"""The most by which an action, in [-1, 1], may differ where rounding does not make it more."""
OBSERVATIONS = 10_000
_SEED = 0
_ROUNDINGS = 2.0
"""Roundings of two float32 computations may add up."""

Floats = NDArray[np.float32]


class Parity(NamedTuple):
    """A comparison with the NumPy actor."""

    runtime: str
    """Version of onnxruntime."""
    observations: int
    largest_difference: float
    """Of an action from that of the NumPy actor."""
    rounding: float | None
    """How far the NumPy actor, in float32, is from exact arithmetic on the same observations; None
    where the difference is at most ``TOLERANCE``."""


def check_parity(model: bytes, actor: LocalActor, low: Floats, high: Floats) -> Parity | None:
    """Compare an ONNX file with the actor that it was made of; None without onnxruntime.

    Args:
        model: content of the file.
        actor: the NumPy actor.
        low: the least observation (O,).
        high: the greatest observation (O,).

    Raises:
        RunFailedError: an action differs by more than ``TOLERANCE``, and not by rounding alone.
    """
    try:
        import onnxruntime
    except ImportError:
        return None
    seen = sample_observations(low, high)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # more would spin
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    (actions,) = session.run(None, {INPUT: seen})
    expected = actor.act(seen)
    difference, rounding = float(np.abs(actions - expected).max()), None
    if not difference <= TOLERANCE:
        rounding = float(np.abs(expected - _exact_actions(actor, seen)).max())
        if not difference <= _ROUNDINGS * rounding:
            raise RunFailedError(
                f"onnxruntime {onnxruntime.__version__} flies otherwise than the policy: actions "
                f"differ by up to {difference:.1e}, more than {TOLERANCE:g}"
            )
    return Parity(onnxruntime.__version__, len(seen), difference, rounding)


def _exact_actions(actor: LocalActor, observations: Floats) -> NDArray[np.float64]:
    """Actions (n, A) in double precision."""
    hidden = observations.astype(np.float64)
    for index, (weight, bias) in enumerate(actor.layers):
        hidden = (np.maximum(hidden, 0.0) if index else hidden) @ weight.T.astype(np.float64) + bias
    return np.tanh(hidden)


def sample_observations(low: Floats, high: Floats, count: int = OBSERVATIONS) -> Floats:
    """Observations (count, O) between two: the two themselves, some inside, some at corners.

    In every second row about half of the numbers are the least or the greatest that they can be.
    """
    generator = np.random.default_rng(_SEED)
    seen = generator.uniform(low, high, (count, len(low)))
    drawn = generator.random(seen[1::2].shape)
    seen[1::2] = np.select([drawn < 0.25, drawn > 0.75], [low, high], seen[1::2])
    seen[:2] = low, high
    return seen.astype(np.float32)
