"""Numbers that claims are about, one per training seed, out of the rows."""

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from orchid_uav.experiments.ablation.design import SETTLED
from orchid_uav.experiments.reproduction.rows import FlownCase, Row
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.trainings import SEEDS
from orchid_uav.experiments.runs.directory import FINAL_EPISODES

Floats = NDArray[np.float64]
Statistic = Literal["mean", "std", "cv"]
"""Over a case's topologies: mean, standard deviation, or the second over the first."""

EARLY = (1, 200)
"""Episodes that are called early."""
LATE = 200
"""How many episodes are called late: the last ones."""
BEFORE_RESET, AFTER_RESET = 50, 50
"""Updates before a reset, and after it, whose variances are compared."""


class Evidence:
    """All rows, asked by method.

    Every answer is an array with one number per seed, (seeds,), NaN where a seed has not been
    measured. What has no training seed, a rule or a zero-action twin, has the same number for all.

    Args:
        rows: of methods and rules.
        seeds: the training seeds of the answers, in their order.
    """

    def __init__(self, rows: Iterable[Row], seeds: Sequence[int] = SEEDS) -> None:
        self.seeds = tuple(seeds)
        self._rows = {(row.method, row.seed): row for row in rows}

    def _row(self, method: str, seed: int | None) -> Row | None:
        return self._rows.get((method, seed))

    def methods(self) -> set[str]:
        """The methods that have a row."""
        return {method for method, _ in self._rows}

    def rows(self, method: str) -> list[Row]:
        """The rows of a method's seeds, as far as there are any."""
        found = (self._row(method, seed) for seed in self.seeds)
        return [row for row in found if row is not None]

    def rule(self, method: str) -> Row | None:
        """The row of a rule's flights."""
        return self._row(method, None)

    def flown(
        self,
        method: str,
        metric: str,
        cases: Sequence[Case],
        statistic: Statistic = "mean",
        deterministic: bool = True,
    ) -> Floats:
        """A metric of the policy, averaged over cases; ``KEY-zero`` names the twin of a method."""
        rule = self.rule(method)
        if rule is not None:
            return np.full(len(self.seeds), _over_cases(rule, metric, cases, statistic))
        key = method.removesuffix("-zero")
        is_zero = key != method
        values = [
            _over_cases(row, metric, cases, statistic, deterministic, is_zero) if row else np.nan
            for row in (self._row(key, seed) for seed in self.seeds)
        ]
        if is_zero:  # it flies every case for one of the seeds alone, and alike for all of them
            known = [value for value in values if np.isfinite(value)]
            return np.full(len(values), known[0] if known else np.nan)
        return np.array(values)

    def gained(self, method: str, metric: str, cases: Sequence[Case]) -> Floats:
        """How much more of a metric the policy has than its zero-action twin, over cases."""
        return self.flown(method, metric, cases) - self.flown(f"{method}-zero", metric, cases)

    def topologies(self, rule: str, metric: str, case: Case) -> Floats:
        """A rule's metric on every topology of a case, (topologies,); empty where not flown."""
        row = self.rule(rule)
        try:
            return np.array(row.find(case).topologies[metric]) if row else np.empty(0)
        except LookupError:
            return np.empty(0)

    def trained(self, method: str, metric: str, first: int, last: int) -> Floats:
        """Mean of a metric over training episodes, counted from 1; whole blocks of them."""

        def of(row: Row) -> float:
            blocks = _blocks(row, metric, first, last)
            return float(np.mean(blocks)) if len(blocks) else np.nan

        return self._of_curves(method, of)

    def at_the_end(self, method: str, metric: str) -> Floats:
        """Mean over the last ``FINAL_EPISODES`` episodes of a training."""
        return self._of_curves(method, lambda row: _at_the_end(row, metric))

    def spread_at_the_end(self, method: str, metric: str) -> Floats:
        """Standard deviation between the blocks of the ``LATE`` last episodes of a training."""

        def of(row: Row) -> float:
            if row.episodes < LATE:
                return np.nan
            return float(
                np.std(_blocks(row, metric, row.episodes - LATE + 1, row.episodes), ddof=1)
            )

        return self._of_curves(method, of)

    def late_change(self, method: str, metric: str) -> Floats:
        """The end of a training minus the episodes ``SETTLED``."""
        return self.at_the_end(method, metric) - self.trained(method, metric, *SETTLED)

    def unsteadiness(self, method: str, metric: str) -> Floats:
        """How much successive blocks of the ``EARLY`` episodes differ.

        It is the root mean square of successive differences over √2 (von Neumann's estimate of a
        standard deviation), which a trend does not raise.
        """

        def of(row: Row) -> float:
            steps = np.diff(_blocks(row, metric, *EARLY))
            return float(np.sqrt(np.mean(steps**2) / 2.0))

        return self._of_curves(method, of)

    def update_variance_ratio(self, method: str) -> Floats:
        """log10 of Var(Δθ) after the first reset over that before it."""

        def of(row: Row) -> float:
            if not row.reset_episodes or not row.update_variances:
                return np.nan
            updates_per_episode = len(row.update_variances) / row.episodes
            at = round(row.reset_episodes[0] * updates_per_episode)
            before = row.update_variances[max(at - BEFORE_RESET, 0) : at]
            after = row.update_variances[at : at + AFTER_RESET]
            return float(np.log10(np.mean(after) / np.mean(before)))

        return self._of_curves(method, of)

    def _of_curves(self, method: str, of: Callable[[Row], float]) -> Floats:
        rows = (self._row(method, seed) for seed in self.seeds)
        return np.array([of(row) if row and row.curve else np.nan for row in rows], np.float64)


def _over_cases(
    row: Row,
    metric: str,
    cases: Sequence[Case],
    statistic: Statistic,
    deterministic: bool = True,
    is_zero: bool = False,
) -> float:
    try:
        found = [row.find(case, deterministic, is_zero) for case in cases]
    except LookupError:
        return np.nan
    return float(np.mean([_statistic(case, metric, statistic) for case in found]))


def _statistic(case: FlownCase, metric: str, statistic: Statistic) -> float:
    mean, std = (np.nan if number is None else number for number in case.metrics[metric])
    if statistic == "mean":
        return mean
    return std if statistic == "std" else std / mean


def _blocks(row: Row, metric: str, first: int, last: int) -> Floats:
    """Means of the blocks that lie between two episodes, counted from 1."""
    assert row.curve is not None
    block = row.curve.block
    return np.array(row.curve.mean[metric][-(-(first - 1) // block) : last // block])


def _at_the_end(row: Row, metric: str) -> float:
    assert row.curve is not None
    whole = len(row.curve.mean[metric]) * row.curve.block
    return float(np.mean(_blocks(row, metric, whole - FINAL_EPISODES + 1, whole)))
