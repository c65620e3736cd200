"""Means, standard deviations and intervals."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict
from scipy.stats import DegenerateDataWarning, bootstrap

from orchid_uav.envs.seeds import RESAMPLING_SEED
from orchid_uav.storage.documents import Document

Floats = NDArray[np.float64]

RESAMPLES = 2000
_ROUNDING = 1e-12
"""Values that differ by at most this share of the greatest count as equal."""
CONFIDENCE = 0.95
MIN_SEEDS = 5
"""With fewer seeds, or runs, there is no interval, no equivalence, no least detectable effect."""
INTERVAL = f"BCa bootstrap, {RESAMPLES} resamples, {CONFIDENCE:.0%}"


class MetricSummary(Document):
    """Summary of a metric over many episodes; None for what is not known."""

    model_config = ConfigDict(frozen=True)

    mean: float | None
    std: float | None
    """With ddof = 1."""
    ci95: list[float] | None
    """Ends of the 95 % interval of the mean."""


UNKNOWN = MetricSummary(mean=None, std=None, ci95=None)


def summarise(values: Floats, with_interval: bool = True) -> MetricSummary:
    """Mean, standard deviation (ddof = 1) and interval of the mean.

    Each is None if it needs more values, is not wanted, or if a value is not a finite number.
    """
    if not len(values) or not np.isfinite(values).all():
        return UNKNOWN
    return MetricSummary(
        mean=float(np.mean(values)),
        std=float(np.std(values, ddof=1)) if len(values) > 1 else None,
        ci95=(
            interval((values,), lambda sample, axis: np.mean(sample, axis=axis))
            if with_interval
            else None
        ),
    )


def interval(samples: tuple[Floats, ...], statistic: Callable[..., Any]) -> list[float] | None:
    """BCa interval [low, high] of a statistic of paired samples; None if it does not exist.

    Args:
        samples: samples of equal length, resampled together; if all of them are constant, the
            interval has no width.
        statistic: takes the samples and ``axis``, along which it is computed.
    """
    if len(samples[0]) < 2:
        return None
    observed = float(statistic(*samples, axis=-1))
    if all(map(_is_constant, samples)):
        return [observed, observed]
    with warnings.catch_warnings():
        # Values that differ only by rounding have no acceleration constant.
        warnings.simplefilter("ignore", RuntimeWarning)
        warnings.simplefilter("ignore", DegenerateDataWarning)
        result = bootstrap(
            samples,
            statistic,
            n_resamples=RESAMPLES,
            paired=True,
            vectorized=True,
            confidence_level=CONFIDENCE,
            method="BCa",
            rng=np.random.default_rng(RESAMPLING_SEED),
        )
    if _is_constant(result.bootstrap_distribution):
        return [observed, observed]
    low, high = map(float, result.confidence_interval)
    return [low, high] if np.isfinite([low, high]).all() else None


def _is_constant(values: Floats) -> bool:
    return bool(np.ptp(values) <= _ROUNDING * np.abs(values).max())
