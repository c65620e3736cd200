"""Compares training runs over seeds: the effects first, then what chance could explain.

The unit of analysis is the training seed. Variants share their seeds with the base, so that effects
are paired differences, variant − base. A run that failed has no value but NaN or None. Failures are
counted and reported beside the effect, which is that of the complete pairs. They are never imputed.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, Final, Literal

import numpy as np
from scipy.special import nctdtrinc
from scipy.stats import permutation_test, rankdata, t, trim_mean

from orchid_uav.envs.seeds import RESAMPLING_SEED
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.statistics.intervals import MIN_SEEDS, Floats, interval
from orchid_uav.storage.documents import Document

Values = Sequence[float | None] | Floats
"""One value per seed, with seeds in the same order everywhere; NaN or None for a failed run."""
Better = Literal["higher", "lower"] | None
"""Which values of a metric are better; None if neither higher nor lower ones are."""
Verdict = Literal[
    "better", "worse", "higher", "lower", "equivalent", "no difference shown", "undecided"
]

NOT_COMPARED: Final = "not compared"
"""Replaces the verdict if the metric measures different things in base and variant."""

ALPHA = 0.05
FLIPS = 2**14
"""Sign patterns of the permutation test: all of them up to 14 pairs, else as many at random."""


class SeedSummary(Document):
    """The values of one method over its seeds; None for what needs more seeds."""

    n: int
    """Number of seeds with a value."""
    failed: int
    """Number of seeds without a value; all other entries leave these out."""
    mean: float | None
    median: float | None
    iqm: float | None
    """See :func:`interquartile_mean`."""
    std: float | None
    """With ddof = 1."""
    ci95: list[float] | None
    """The BCa interval over seeds of the statistic named in ``ci95_of``. It is also None if no
    single seed changes the statistic, as when nine of ten are 0."""
    ci95_of: str


class Difference(Document):
    """The difference variant − base over complete pairs."""

    mean: float | None
    median: float | None
    iqm: float | None
    ci95: list[float] | None
    """The BCa interval of what ``ci95_of`` names. For the mean it is somewhat narrow: with normal
    data, it covers the truth in about 83 % of samples of 5 seeds and 90 % of samples of 10."""
    ci95_of: str | None


class Equivalence(Document):
    """Whether the mean difference is shown to lie within ±margin; see :func:`equivalence`."""

    margin: float
    p_value: float
    """The greater p-value of the two tests, not adjusted for other comparisons."""
    equivalent: bool
    """Whether ``p_value`` is at most 0.05."""


class Comparison(Document):
    """One metric of a variant against that of its base, paired by seed.

    What needs more pairs is None. The last three entries are known only within a family.
    """

    n: int
    """Number of complete pairs."""
    seeds: int
    failed_base: int
    failed_variant: int
    better: Better
    difference: Difference
    relative: float | None
    """Mean difference / |mean of the base| over the same pairs; None if that mean is 0."""
    probability_of_improvement: float | None
    """See :func:`probability_of_improvement`."""
    probability_of_improvement_ci95: list[float] | None
    p_value: float | None
    """See :func:`sign_flip_p_value`."""
    smallest_p: float | None
    """The smallest p-value that this number of pairs can give."""
    equivalence: Equivalence | None
    """See :func:`equivalence`."""
    least_detectable_effect: float | None
    """See :func:`least_detectable_effect`."""
    p_holm: float | None = None
    smallest_p_holm: float | None = None
    """The smallest that the first adjusted p-value of the family could be. If it is above 0.05,
    nothing can be shown: 10 seeds can show nothing in a family of more than 25 tests."""
    verdict: Verdict | Literal["not compared"] | None = None
    """See :func:`judge`."""


def interquartile_mean(values: Floats, axis: int = -1) -> Any:
    """Mean of the middle half (Agarwal et al. 2021), which one outlying seed cannot move far.

    Of n values the ⌊n/4⌋ lowest and the ⌊n/4⌋ highest are left out and the rest is averaged, as
    by ``scipy.stats.trim_mean(values, 0.25)``. If n is no multiple of 4, more than half remains: 3
    of 5, 4 of 6, 5 of 7, 6 of 10. Of fewer than 4 values it is the mean.

    Args:
        values: at least one value along ``axis``; one NaN makes the mean NaN.
        axis: the axis to average over.
    """
    return trim_mean(values, 0.25, axis=axis)


def describe_seeds(values: Values) -> SeedSummary:
    """Summarise the values of one method over its seeds.

    Raises:
        InputError: a value is neither a finite number nor NaN or None for a failed run.
    """
    given = _checked(values)
    reached = given[~np.isnan(given)]
    mean, median, iqm = _averages(reached)
    return SeedSummary(
        n=len(reached),
        failed=len(given) - len(reached),
        mean=mean,
        median=median,
        iqm=iqm,
        std=float(np.std(reached, ddof=1)) if len(reached) > 1 else None,
        ci95=_over_seeds((reached,), interquartile_mean),
        ci95_of="iqm",
    )


def compare_pairs(
    base: Values, variant: Values, better: Better, margin: float | None = None
) -> Comparison:
    """Compare one metric of a variant with that of its base, paired by seed.

    Args:
        base: one value per seed.
        variant: one value for each of the same seeds, in the same order.
        better: which values of the metric are better.
        margin: the greatest mean difference that does not matter, in the metric's unit. It has to
            be chosen before the runs. None for no test of equivalence.

    Raises:
        InputError: the seeds do not pair, values are not numbers, ``better`` is unknown, or the
            margin is not above 0.
    """
    if better not in ("higher", "lower", None):
        raise InputError(f"better is '{better}': give 'higher', 'lower' or None")
    one, other = _checked(base), _checked(variant)
    if len(one) != len(other):
        raise InputError(
            f"{len(one)} seeds of the base and {len(other)} of the variant do not pair: "
            "give one value per seed to both, NaN for a failed run"
        )
    failed_one, failed_other = np.isnan(one), np.isnan(other)
    complete = ~(failed_one | failed_other)
    differences = other[complete] - one[complete]
    of_base = abs(float(np.mean(one[complete]))) if complete.any() else 0.0
    improvement = probability_of_improvement(one, other, better)
    return Comparison(
        n=len(differences),
        seeds=len(one),
        failed_base=int(failed_one.sum()),
        failed_variant=int(failed_other.sum()),
        better=better,
        difference=describe_differences(differences),
        relative=float(np.mean(differences)) / of_base if of_base else None,
        probability_of_improvement=improvement[0],
        probability_of_improvement_ci95=improvement[1],
        p_value=sign_flip_p_value(differences),
        smallest_p=_smallest_p(len(differences)),
        equivalence=equivalence(differences, margin),
        least_detectable_effect=least_detectable_effect(differences),
    )


def describe_differences(differences: Floats) -> Difference:
    """Averages of paired differences, (pairs,), with the interval of the mean."""
    mean, median, iqm = _averages(differences)
    ci95 = _over_seeds((differences,), np.mean)
    return Difference(mean=mean, median=median, iqm=iqm, ci95=ci95, ci95_of="mean")


def probability_of_improvement(
    base: Floats, variant: Floats, better: Better
) -> tuple[float | None, list[float] | None]:
    """How often a run of the variant is better than one of the base, whatever the seeds.

    This is the Mann-Whitney statistic: of all pairs of a base's and a variant's seed, the share in
    which the variant is better, with ties counted half. A failed run is worse than any other and
    ties with another failed one. If ``better`` is None, it is the share in which the variant is
    higher, and seeds that failed on either side are left out.

    Returns:
        The share, and its BCa interval, for which both runs of a seed are drawn together. The
        interval is None below 5 seeds. It is also None if all resamples give the same share, since
        they then do not show how certain it is (runs that do not overlap always give 0 or 1).
    """
    if better is None:
        complete = ~(np.isnan(base) | np.isnan(variant))
        base, variant = base[complete], variant[complete]
    if not len(base):
        return None, None
    merits = np.concatenate([base, variant]) * (-1.0 if better == "lower" else 1.0)
    merits[np.isnan(merits)] = -np.inf
    places = rankdata(merits, method="dense").astype(np.float64)
    samples = (places[: len(base)], places[len(base) :])
    ends = _over_seeds(samples, _share_above)
    is_known = ends is not None and ends[0] < ends[1]
    return float(_share_above(*samples)), ends if is_known else None


def _share_above(base: Floats, variant: Floats, axis: int = -1) -> Any:
    """Mann-Whitney's U / n² from the ranks of the variant's values among all; last axis only."""
    count = base.shape[axis]
    ranks = rankdata(np.concatenate([base, variant], axis=axis), axis=axis)[..., count:]
    return (ranks.mean(axis=axis) - (count + 1) / 2) / count


def sign_flip_p_value(differences: Floats) -> float | None:
    """How often paired differences with random signs have a mean as far from 0, two-sided.

    The p-value is exact up to 14 pairs. There n pairs can give no less than 2/2ⁿ: 5 pairs can never
    show a difference at 0.05, 6 can give 0.031 and 10 can give 0.002. With more pairs it comes from
    ``FLIPS`` patterns of a fixed generator and the observed one, and is no less than
    2/(FLIPS + 1). It is None without pairs.
    """
    if len(differences) < 2:
        return 1.0 if len(differences) else None
    found = permutation_test(
        (differences,),
        np.mean,
        permutation_type="samples",
        vectorized=True,
        n_resamples=FLIPS,
        axis=-1,
        rng=np.random.default_rng(RESAMPLING_SEED),
    )
    return float(found.pvalue)


def _smallest_p(pairs: int) -> float | None:
    patterns = 2**pairs
    return 2.0 / (patterns if patterns <= FLIPS else FLIPS + 1) if pairs else None


def equivalence(differences: Floats, margin: float | None) -> Equivalence | None:
    """Two one-sided paired t-tests: is the mean difference shown to lie within ±margin?

    Returns:
        The result; None without a margin or below 5 pairs. Differences that are all equal are taken
        as exact: p is 0 if they lie within the margin, else 1.

    Raises:
        InputError: the margin is not above 0.
    """
    if margin is None:
        return None
    if not 0.0 < margin < np.inf:
        raise InputError(f"the margin is {margin}: give a finite number above 0")
    if len(differences) < MIN_SEEDS:
        return None
    p_value = max(p_value_above(sign * differences, -margin) for sign in (1.0, -1.0))
    return Equivalence(margin=float(margin), p_value=p_value, equivalent=p_value <= ALPHA)


def p_value_above(differences: Floats, bound: float) -> float:
    """p-value of a one-sided paired t-test against a mean of at most ``bound``.

    Differences that are all equal are taken as exact: p is 0 if they are above it, else 1.
    """
    distance = float(np.mean(differences)) - bound
    error = float(np.std(differences, ddof=1)) / len(differences) ** 0.5
    if not error:
        return 0.0 if distance > 0.0 else 1.0
    return float(t.sf(distance / error, len(differences) - 1))


def least_detectable_effect(
    differences: Floats, power: float = 0.8, alpha: float = ALPHA, sides: Literal[1, 2] = 2
) -> float | None:
    """Mean difference that a paired t-test would show with this power at this spread.

    It comes from the noncentral t distribution. The far tail, where the test errs in the sign, is
    left out (below 1e-6 for a power of 0.8). It holds for a single test; within a family the effect
    must be greater. It is None below 5 pairs.

    Args:
        differences: differences of pairs; only their number and standard deviation matter.
        power: how often the test would show this effect.
        alpha: how often the test would show an effect where there is none.
        sides: on which the effect may lie; 1 for a distance from a bound.

    Raises:
        InputError: not 0 < alpha < power < 1.
    """
    if not 0.0 < alpha < power < 1.0:
        raise InputError(f"no test has power {power} at level {alpha}: give 0 < level < power < 1")
    count = len(differences)
    if count < MIN_SEEDS:
        return None
    threshold = t.isf(alpha / sides, count - 1)
    noncentrality = nctdtrinc(count - 1, 1.0 - power, threshold)
    return float(noncentrality * np.std(differences, ddof=1) / count**0.5)


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Holm's adjusted p-values of one family, in the order given; None stays and does not count.

    Raises:
        InputError: a value outside [0, 1].
    """
    tested = [(p_value, index) for index, p_value in enumerate(p_values) if p_value is not None]
    adjusted: list[float | None] = [None] * len(p_values)
    greatest = 0.0
    for rank, (p_value, index) in enumerate(sorted(tested)):
        if not 0.0 <= p_value <= 1.0:
            raise InputError(f"{p_value} is not a p-value: give numbers from 0 to 1, or None")
        greatest = max(greatest, min(1.0, (len(tested) - rank) * p_value))
        adjusted[index] = greatest
    return adjusted


def compare_families(
    base: Mapping[str, Values],
    variants: Mapping[str, Mapping[str, Values]],
    better: Mapping[str, Better],
    margins: Mapping[str, float] | None = None,
) -> dict[str, dict[str, Comparison]]:
    """Compare every variant with the base in every metric; all tests of a call are one family.

    Args:
        base: values per seed, by metric.
        variants: the same for each variant, by the variant's name.
        better: the metrics that are judged together, and which values of each are better.
        margins: margins of equivalence, for the metrics that have one.

    Returns:
        The results of ``compare_pairs`` by variant and metric, with the entries that depend on the
        family.

    Raises:
        InputError: a metric is missing, a margin belongs to a metric that is not judged, or
            ``compare_pairs`` raises it.
    """
    margins = margins or {}
    for metric in margins:
        if metric not in better:
            raise InputError(
                f"there is a margin for '{metric}', but only {', '.join(better)} are judged"
            )
    comparisons: dict[str, dict[str, Comparison]] = {name: {} for name in variants}
    for name, metric in product(variants, better):
        comparisons[name][metric] = compare_pairs(
            _of(base, metric, "the base"),
            _of(variants[name], metric, f"'{name}'"),
            better[metric],
            margins.get(metric),
        )
    family = [found for by_metric in comparisons.values() for found in by_metric.values()]
    tests = sum(found.p_value is not None for found in family)
    adjusted = holm([found.p_value for found in family])
    for found, p_holm in zip(family, adjusted, strict=True):
        least = found.smallest_p
        found.p_holm = p_holm
        found.smallest_p_holm = None if least is None else min(1.0, tests * least)
        found.verdict = judge(found)
    return comparisons


def judge(comparison: Comparison) -> Verdict:
    """Sum a comparison up in a verdict, at a level of 0.05.

    * "equivalent": the difference is shown to lie within the margin, even if it is also shown not
      to be 0.
    * "better" or "worse" ("higher" or "lower" if ``better`` is None): ``p_holm`` (outside of a
      family, ``p_value``) is at most 0.05. The sign of the mean paired difference decides which.
    * "no difference shown": none of these, although the test could have shown a difference. That
      is not equality: see the interval and ``least_detectable_effect``.
    * "undecided": there are too few pairs for any p-value of at most 0.05, or one side failed more
      often and the effect is not in favour of the other side, since the seeds that survived are no
      fair sample. A variant with more failures can be worse, but neither better nor equivalent.
    """
    word = _word(comparison)
    balance = comparison.failed_variant - comparison.failed_base
    if balance and word not in ("no difference shown", "worse" if balance > 0 else "better"):
        return "undecided"
    return word


def _word(comparison: Comparison) -> Verdict:
    """The verdict on the complete pairs, without regard to failures."""
    known = comparison.model_fields_set
    p_value = comparison.p_holm if "p_holm" in known else comparison.p_value
    smallest = comparison.smallest_p_holm if "smallest_p_holm" in known else comparison.smallest_p
    if comparison.equivalence is not None and comparison.equivalence.equivalent:
        return "equivalent"
    if p_value is None or smallest is None or comparison.difference.mean is None:
        return "undecided"
    if p_value > ALPHA:
        return "undecided" if smallest > ALPHA else "no difference shown"
    is_higher = comparison.difference.mean > 0.0
    if comparison.better is None:
        return "higher" if is_higher else "lower"
    return "better" if is_higher == (comparison.better == "higher") else "worse"


def _averages(values: Floats) -> tuple[float | None, float | None, float | None]:
    """Mean, median and interquartile mean."""
    if not len(values):
        return None, None, None
    return float(np.mean(values)), float(np.median(values)), float(interquartile_mean(values))


def _over_seeds(samples: tuple[Floats, ...], statistic: Any) -> list[float] | None:
    return interval(samples, statistic) if len(samples[0]) >= MIN_SEEDS else None


def _of(values: Mapping[str, Values], metric: str, whose: str) -> Values:
    if metric not in values:
        raise InputError(f"{whose} has no '{metric}', only {', '.join(values) or 'nothing'}")
    return values[metric]


def _checked(values: Values) -> Floats:
    """Check values and return finite numbers, with NaN for failed runs: (seeds,)."""
    try:
        checked = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        checked = np.array(np.inf)
    if checked.ndim != 1 or np.isinf(checked).any():
        raise InputError(
            f"{values!r} are not values of a metric: give a list of finite numbers, NaN where a "
            "run failed"
        )
    return checked
