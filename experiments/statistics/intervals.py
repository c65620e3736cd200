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
"""Values that differ by less than this share of the greatest are the same."""
CONFIDENCE = 0.95
INTERVAL = f"BCa bootstrap, {RESAMPLES} resamples, {CONFIDENCE:.0%}"


class MetricSummary(Document):
    """A metric over many episodes; None for what is not known."""

    model_config = ConfigDict(frozen=True)

    mean: float | None
    std: float | None
    """With ddof = 1."""
    ci95: list[float] | None
    """Ends of the interval of the mean."""


UNKNOWN = MetricSummary(mean=None, std=None, ci95=None)


def summarise(values: Floats, with_interval: bool = True) -> MetricSummary:
    """Mean, standard deviation (ddof = 1) and interval of the mean.

    None for what so few values cannot give, or is not wanted, or where a value is not a number.
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
    """BCa interval [low, high] of a statistic of paired samples; None where there is none.

    Args:
        samples: of the same length, drawn together; constant ones give an interval of no width.
        statistic: of the samples, along ``axis``.
    """
    if len(samples[0]) < 2:
        return None
    observed = float(statistic(*samples, axis=-1))
    if all(map(_is_constant, samples)):
        return [observed, observed]
    with warnings.catch_warnings():
        # Values that differ by rounding alone have no acceleration constant.
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
