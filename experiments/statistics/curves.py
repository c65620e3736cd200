"""Learning curves as numbers: smoothed, and over several runs with an interval."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.metrics import EPISODE_METRICS
from orchid_uav.envs.seeds import RESAMPLING_SEED
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.statistics.intervals import CONFIDENCE, MIN_SEEDS, RESAMPLES
from orchid_uav.storage.documents import Document

Row = Mapping[str, float]
"""An episode's metrics, as ``read_episodes`` gives them."""
Floats = NDArray[np.float64]

WINDOW = 20
"""Default number of episodes of a trailing mean."""
DEFAULT_COLUMNS = (
    "reward",
    "energy_efficiency_bit_per_joule",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "coverage",
)
"""Columns that are drawn by default."""
_EPISODES_AT_ONCE = 64
_DIGITS = 6


class Curve(NamedTuple):
    """One metric of one run or of several, by episode; all arrays (E,)."""

    runs: int
    """Number of runs at the beginning of the curve."""
    episodes: Floats
    values: Floats
    """Values of the run, or the interquartile mean over runs."""
    band: tuple[Floats, Floats] | None
    """Ends of the interval of the interquartile mean; None below ``MIN_SEEDS`` runs."""


def scale_of(column: str) -> float:
    """Factor from a column's stored values to the shown ones."""
    return METRICS[column].scale if column in METRICS else 1.0


def smoothed(values: ArrayLike, window: int) -> Floats:
    """Trailing means over the last ``window`` values, or over all values so far, (E,).

    A value that is not a number affects only the means whose window contains it.

    Raises:
        ValueError: the window is less than one value.
    """
    if window < 1:
        raise ValueError(f"a window of {window} values has no mean")
    given = np.asarray(values, np.float64)
    beginning = given[: window - 1]
    means = np.cumsum(beginning) / np.arange(1, len(beginning) + 1)
    if len(given) < window:
        return means
    rest = np.lib.stride_tricks.sliding_window_view(given, window).mean(axis=1)
    return np.concatenate([means, rest])


def single_curve(rows: Sequence[Row], column: str, window: int = WINDOW) -> Curve:
    """The curve of a run's metric, smoothed and scaled as it is shown."""
    values = smoothed([row[column] for row in rows], window) * scale_of(column)
    return Curve(1, np.array([row["episode"] for row in rows], np.float64), values, None)


def group_curve(runs: Sequence[Sequence[Row]], column: str, window: int = WINDOW) -> Curve:
    """The interquartile mean over runs at each episode, after smoothing each run.

    A run that ended early counts until its last episode. With ``MIN_SEEDS`` runs or more there is a
    band, and the curve ends where fewer runs go on. With fewer runs there is no band, and the curve
    ends with the longest run.

    Args:
        runs: the rows of each run, from the first episode on.
        column: the column of the rows.
        window: episodes of the trailing mean.
    """
    from orchid_uav.experiments.statistics.comparison import interquartile_mean

    singles = sorted((single_curve(rows, column, window) for rows in runs), key=_length)
    if not singles:
        return Curve(0, np.empty(0), np.empty(0), None)
    has_band = len(singles) >= MIN_SEEDS
    values, lows, highs = [np.empty(0)], [np.empty(0)], [np.empty(0)]
    for begin, end, going_on in _stretches(singles, MIN_SEEDS if has_band else 1):
        table = np.stack([curve.values[begin:end] for curve in going_on])
        values.append(interquartile_mean(table, axis=0))
        if has_band:
            low, high = _bootstrap_interval(table)
            lows.append(low)
            highs.append(high)
    middle = np.concatenate(values)
    band = (np.concatenate(lows), np.concatenate(highs)) if has_band else None
    return Curve(len(singles), singles[-1].episodes[: len(middle)], middle, band)


def _length(curve: Curve) -> int:
    return len(curve.values)


def _stretches(curves: Sequence[Curve], least: int) -> Iterator[tuple[int, int, Sequence[Curve]]]:
    """Begin and end of the parts in which the same curves, at least ``least``, go on."""
    ends = sorted({0, *map(_length, curves)})
    for begin, end in pairwise(ends):
        going_on = [curve for curve in curves if _length(curve) >= end]
        if len(going_on) >= least:
            yield begin, end, going_on


def _bootstrap_interval(table: Floats) -> tuple[Floats, Floats]:
    """Interval of the interquartile mean of (runs, E): percentile bootstrap over whole runs."""
    from orchid_uav.experiments.statistics.comparison import interquartile_mean

    count = len(table)
    drawn = np.random.default_rng(RESAMPLING_SEED).integers(0, count, (RESAMPLES, count))
    tail = 100.0 * (1.0 - CONFIDENCE) / 2.0
    parts = [
        np.percentile(interquartile_mean(part[drawn], axis=1), [tail, 100.0 - tail], axis=0)
        for part in np.array_split(table, max(1, table.shape[1] // _EPISODES_AT_ONCE), axis=1)
    ]
    low, high = np.concatenate(parts, axis=1)
    return low, high


class CurveTable(Document):
    """A learning curve for a JSON document: lists of the same length.

    Numbers have six digits; None stands for values that are not finite numbers.
    """

    runs: int
    episodes: list[int]
    iqm: list[float | None]
    low: list[float | None] | None
    """None below ``MIN_SEEDS`` runs, as is ``high``."""
    high: list[float | None] | None


def curve_table(
    groups: Mapping[str, Sequence[Sequence[Row]]],
    columns: Sequence[str] = EPISODE_METRICS,
    window: int = WINDOW,
    every: int = 1,
) -> dict[str, dict[str, CurveTable]]:
    """The numbers of learning curves for a JSON document, unscaled, by group and column.

    Args:
        groups: the rows of each run, by the group's name.
        columns: the columns of the rows.
        window: episodes of the trailing mean.
        every: every so many episodes a point is kept, and the last point.

    Returns:
        The curve over all runs of a group, by group and column.
    """
    return {
        name: {
            column: _plain(group_curve(runs, column, window), column, every) for column in columns
        }
        for name, runs in groups.items()
    }


def _plain(curve: Curve, column: str, every: int) -> CurveTable:
    last = len(curve.episodes) - 1
    kept = [at for at in range(last + 1) if (at + 1) % every == 0 or at == last]

    def numbers(values: Floats) -> list[float | None]:
        unscaled = values[kept] / scale_of(column)
        return [float(f"{x:.{_DIGITS}g}") if np.isfinite(x) else None for x in unscaled]

    low, high = curve.band or (None, None)
    return CurveTable(
        runs=curve.runs,
        episodes=[int(episode) for episode in curve.episodes[kept]],
        iqm=numbers(curve.values),
        low=None if low is None else numbers(low),
        high=None if high is None else numbers(high),
    )
