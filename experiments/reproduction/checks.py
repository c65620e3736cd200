"""The comparisons that decide each claim of the paper, by its number.

Margins are absolute and were fixed before the runs (``docs/claims.md``).
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.evidence import Evidence, Statistic
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.verdicts import Check, Expectation
from orchid_uav.experiments.runs.directory import FINAL_EPISODES

Floats = NDArray[np.float64]

COVERAGE, EFFICIENCY = "coverage", "energy_efficiency_bit_per_joule"
RATE, LOAD, WORST = "rate_jfi", "load_jfi", "worst_rate_bps"
REWARD, UTILITY, PAIRS = "reward", "utility", "blocking_pairs"
NEAREST, SNR = "nearest_uav_m", "user_snr_db"
VARIANCE_RATIO = "log10_update_variance_ratio"

MARGINS = {
    COVERAGE: 0.01,
    EFFICIENCY: 0.015e6,
    RATE: 0.02,
    LOAD: 0.02,
    WORST: 0.2e6,
    REWARD: 3.0,
    UTILITY: 0.02,
    PAIRS: 0.1,
    NEAREST: 20.0,
    SNR: 0.5,
    VARIANCE_RATIO: 0.3,
}
"""The greatest differences that do not matter, in the unit of the name. 0.015 Mbit/J are 5 % of a
hovering fleet's; 3 of reward 1 %; 0.3 of a decimal logarithm a factor of two."""
SPREAD_MARGINS = {EFFICIENCY: 0.01, RATE: 0.01, LOAD: 0.01, REWARD: 1.0}
"""The same for spreads: of energy efficiency the coefficient of variation, of the others the
standard deviation; in C15 the mean distance from the median."""

BLOCK_MARGINS = SPREAD_MARGINS | {EFFICIENCY: 0.005e6}
"""The same for spreads between the blocks of a training, in the metric's unit."""
VARIANCE_RATIO_TITLE = "decimal logarithm of a ratio of variances"

ORCHID, NO_RF = "orchid", "orchid-no-rf"
PF_DDPG, MMF_DDPG = MADDPG = "maddpg-pf", "maddpg-mmf"
MADDPG_OF_PAPER = f"{PF_DDPG}-paper", f"{MMF_DDPG}-paper"
STATIC, STATIC_MMF = "static-pf", "static-mmf"
LONG_MMF, LONG_PF = "orchid-long", "orchid-pf"
LEARNED = (ORCHID, *MADDPG)


def _flown(
    method: str, metric: str, cases: Sequence[Case], statistic: Statistic = "mean"
) -> Callable[[Evidence], Floats]:
    return lambda evidence: evidence.flown(method, metric, cases, statistic)


def beside(
    one: str,
    expected: Expectation,
    other: str,
    metric: str,
    cases: Sequence[Case],
    statistic: Statistic = "mean",
    where: str = "",
) -> Check:
    """Two methods flown in the same cases."""
    margin = MARGINS[metric] if statistic == "mean" else SPREAD_MARGINS[metric]
    spread = {"mean": "", "std": ", spread", "cv": ", relative spread"}[statistic]
    return Check(
        f"{one} {expected} than {other}{spread}{where}"
        if expected != "equal"
        else f"{one} equal to {other}{spread}{where}",
        (one, other.removesuffix("-zero")),
        metric,
        expected,
        margin,
        _flown(one, metric, cases, statistic),
        _flown(other, metric, cases, statistic),
        is_relative=statistic == "cv",
    )


def _trained(one: str, expected: Expectation, other: str, metric: str) -> Check:
    """Two methods at the end of their training, with the noise of training."""
    return Check(
        f"{one} {expected} than {other}, last {FINAL_EPISODES} training episodes",
        (one, other),
        metric,
        expected,
        MARGINS[metric],
        lambda evidence: evidence.at_the_end(one, metric),
        lambda evidence: evidence.at_the_end(other, metric),
    )


def _constant(value: float) -> Callable[[Evidence], Floats]:
    return lambda evidence: np.full(len(evidence.seeds), value)


def _full_coverage(cases: Sequence[Case]) -> Iterator[Check]:
    """Each learned method beside full coverage."""
    for method in LEARNED:
        yield Check(
            f"{method} covers all of its target users",
            (method,),
            COVERAGE,
            "not lower",
            MARGINS[COVERAGE],
            _flown(method, COVERAGE, cases),
            _constant(1.0),
        )


def _static_is_least_efficient(cases: Sequence[Case]) -> Iterator[Check]:
    """Hovering beside each learned method."""
    for method in LEARNED:
        yield beside(STATIC, "lower", method, EFFICIENCY, cases)


def narrowest_efficiency(
    cases: Sequence[Case], orchid: str = ORCHID, baselines: Sequence[str] = MADDPG
) -> Iterator[Check]:
    """ORCHID beside both baselines."""
    for baseline in baselines:
        yield beside(orchid, "lower", baseline, EFFICIENCY, cases, "cv")


def fairer_than_maddpg(
    cases: Sequence[Case], orchid: str = ORCHID, baselines: Sequence[str] = MADDPG
) -> Iterator[Check]:
    """ORCHID beside both baselines, by both fairness indices."""
    for baseline in baselines:
        for metric in (RATE, LOAD):
            yield beside(orchid, "higher", baseline, metric, cases)


def _walking(distribution: Distribution) -> list[Case]:
    """Users that walk, with both times for which headings are held."""
    return [
        case for hold_s in settings.HEADINGS_S for case in settings.speeds(distribution, hold_s)[1:]
    ]


def _strategy(metric: str, one: str, expected: Expectation, other: str) -> Check:
    """The two objectives over 1,000 episodes, in the paper's network."""
    return beside(one, expected, other, metric, [settings.base("tcp")])


def c1(_: Distribution) -> Iterator[Check]:
    """Hovering beside each learned method, at the end of training."""
    yield _trained(STATIC_MMF, "higher", ORCHID, REWARD)
    yield _trained(STATIC_MMF, "higher", MMF_DDPG, REWARD)
    yield _trained(STATIC, "higher", PF_DDPG, REWARD)
    for method in LEARNED:
        for metric in (RATE, LOAD):
            yield _trained(STATIC, "higher", method, metric)


def c2(distribution: Distribution) -> Iterator[Check]:
    """ORCHID beside hovering, in training and flown."""
    yield _trained(ORCHID, "not lower", STATIC, EFFICIENCY)
    cases = [settings.base(distribution)]
    yield beside(ORCHID, "not lower", STATIC, EFFICIENCY, cases, where=", flown")


def c3(_: Distribution) -> Iterator[Check]:
    """ORCHID beside MADDPG, with the tuned and with the paper's numbers."""
    for baseline in (MMF_DDPG, MADDPG_OF_PAPER[1]):
        for metric in (REWARD, EFFICIENCY):
            yield Check(
                f"{ORCHID} varies less than {baseline} in episodes 1 to 200",
                (ORCHID, baseline),
                metric,
                "lower",
                BLOCK_MARGINS[metric],
                partial(Evidence.unsteadiness, method=ORCHID, metric=metric),
                partial(Evidence.unsteadiness, method=baseline, metric=metric),
            )


def _late(method: str, expected: Expectation, metric: str) -> Check:
    words = "falls" if expected == "lower" else "does not fall"
    return Check(
        f"{method} {words} from episodes 151 to 200 to the last {FINAL_EPISODES}",
        (method,),
        metric,
        expected,
        MARGINS[metric],
        lambda evidence: evidence.late_change(method, metric),
        _constant(0.0),
    )


def c4(_: Distribution) -> Iterator[Check]:
    """Late changes with and without Reset-and-Finetune, and the two beside each other."""
    for metric in (EFFICIENCY, LOAD):
        yield _late(NO_RF, "lower", metric)
        yield _late(ORCHID, "not lower", metric)
        yield _trained(ORCHID, "higher", NO_RF, metric)


def c5(distribution: Distribution) -> Iterator[Check]:
    """Coverage over the numbers of users."""
    yield from _full_coverage(settings.users(distribution))


def c6(distribution: Distribution) -> Iterator[Check]:
    """Many users beside few."""
    few, *_, many = settings.users(distribution)
    for method in LEARNED:
        yield Check(
            f"{method} higher with 200 users than with 50",
            (method,),
            EFFICIENCY,
            "higher",
            MARGINS[EFFICIENCY],
            _flown(method, EFFICIENCY, [many]),
            _flown(method, EFFICIENCY, [few]),
        )


def c7(distribution: Distribution) -> Iterator[Check]:
    """The two baselines beside each other."""
    yield beside(MMF_DDPG, "higher", PF_DDPG, EFFICIENCY, settings.users(distribution))


def c8(distribution: Distribution) -> Iterator[Check]:
    """Hovering over the numbers of users."""
    yield from _static_is_least_efficient(settings.users(distribution))


def c9(distribution: Distribution) -> Iterator[Check]:
    """Spreads over the numbers of users."""
    yield from narrowest_efficiency(settings.users(distribution))


def c10(distribution: Distribution) -> Iterator[Check]:
    """Fairness over the numbers of users."""
    yield from fairer_than_maddpg(settings.users(distribution))


def c11(distribution: Distribution) -> Iterator[Check]:
    """The baselines beside each other, and hovering beside all."""
    cases = settings.uavs(distribution)
    yield beside(MMF_DDPG, "higher", PF_DDPG, EFFICIENCY, cases)
    yield from _static_is_least_efficient(cases)


def c12(distribution: Distribution) -> Iterator[Check]:
    """Spreads over the numbers of UAVs."""
    yield from narrowest_efficiency(settings.uavs(distribution))


def c13(distribution: Distribution) -> Iterator[Check]:
    """Fairness over the numbers of UAVs."""
    yield from fairer_than_maddpg(settings.uavs(distribution))


def c14(distribution: Distribution) -> Iterator[Check]:
    """Coverage of users that walk."""
    yield from _full_coverage(_walking(distribution))


def c15(distribution: Distribution) -> Iterator[Check]:
    """Fast users beside those that stay."""
    for hold_s in settings.HEADINGS_S:
        still, *_, fast = settings.speeds(distribution, hold_s)
        held = f", headings held {hold_s:g} s"
        for metric in (RATE, LOAD):
            yield Check(
                f"{STATIC} lower at 15 m/s than where nobody walks{held}",
                (STATIC,),
                metric,
                "lower",
                MARGINS[metric],
                partial(Evidence.topologies, rule=STATIC, metric=metric, case=fast),
                partial(Evidence.topologies, rule=STATIC, metric=metric, case=still),
            )
            yield Check(
                f"{STATIC} spreads more at 15 m/s{held}",
                (STATIC,),
                metric,
                "higher",
                SPREAD_MARGINS[metric],
                partial(_deviations, rule=STATIC, metric=metric, case=fast),
                partial(_deviations, rule=STATIC, metric=metric, case=still),
            )
            yield Check(
                f"{ORCHID} not lower at 15 m/s{held}",
                (ORCHID,),
                metric,
                "not lower",
                MARGINS[metric],
                _flown(ORCHID, metric, [fast]),
                _flown(ORCHID, metric, [still]),
            )


def _deviations(evidence: Evidence, rule: str, metric: str, case: Case) -> Floats:
    """Distances of the topologies' values from their median (Brown and Forsythe's)."""
    values = evidence.topologies(rule, metric, case)
    return np.abs(values - np.median(values)) if len(values) else values


def c16(_: Distribution) -> Iterator[Check]:
    """Random starts beside those of Phase I."""
    random = "orchid-random-init"
    yield _trained(random, "higher", ORCHID, REWARD)
    yield _trained(random, "lower", ORCHID, EFFICIENCY)
    yield _trained(random, "lower", ORCHID, LOAD)
    for metric in (EFFICIENCY, LOAD):
        yield Check(
            f"{random} spreads more than {ORCHID} over the last 200 training episodes",
            (random, ORCHID),
            metric,
            "higher",
            BLOCK_MARGINS[metric],
            partial(Evidence.spread_at_the_end, method=random, metric=metric),
            partial(Evidence.spread_at_the_end, method=ORCHID, metric=metric),
        )


def c17(_: Distribution) -> Iterator[Check]:
    """Fairness of rates under the two objectives."""
    yield _strategy(RATE, LONG_MMF, "equal", LONG_PF)


def c18(_: Distribution) -> Iterator[Check]:
    """Energy efficiency under the two objectives."""
    yield _strategy(EFFICIENCY, LONG_MMF, "higher", LONG_PF)


def c19(_: Distribution) -> Iterator[Check]:
    """The worst user's rate, in the mean and where it is lowest."""
    yield _strategy(WORST, LONG_MMF, "higher", LONG_PF)
    yield Check(
        f"{LONG_MMF} higher than {LONG_PF}, fifth percentile of topologies",
        (LONG_MMF, LONG_PF),
        WORST,
        "higher",
        MARGINS[WORST],
        partial(_floor, method=LONG_MMF),
        partial(_floor, method=LONG_PF),
    )


def _floor(evidence: Evidence, method: str) -> Floats:
    """The worst user's rate that all but 5 % of the topologies reach."""
    case = settings.base("tcp")
    found = {row.seed: row.find(case).topologies[WORST] for row in evidence.rows(method)}
    return np.array(
        [np.percentile(found[seed], 5) if seed in found else np.nan for seed in evidence.seeds]
    )


def c20(distribution: Distribution) -> Iterator[Check]:
    """ORCHID beside its zero-action twin."""
    yield beside(ORCHID, "lower", f"{ORCHID}-zero", PAIRS, [settings.base(distribution)])
    yield beside(
        ORCHID, "lower", f"{ORCHID}-zero", PAIRS, _walking(distribution), where=", walking"
    )


def c21(_: Distribution) -> Iterator[Check]:
    """Distances between UAVs under the two objectives."""
    yield _strategy(NEAREST, LONG_MMF, "higher", LONG_PF)


def c22(_: Distribution) -> Iterator[Check]:
    """SNR under the two objectives."""
    yield _strategy(SNR, LONG_PF, "higher", LONG_MMF)


def c23(distribution: Distribution) -> Iterator[Check]:
    """Both baselines beside ORCHID, over each axis."""
    for name, cases in (
        ("users", settings.users(distribution)),
        ("UAVs", settings.uavs(distribution)),
        ("speeds", _walking(distribution)),
    ):
        for baseline in MADDPG:
            yield beside(baseline, "higher", ORCHID, EFFICIENCY, cases, where=f", over {name}")


def c24(distribution: Distribution) -> Iterator[Check]:
    """Fast users beside those that stay."""
    for hold_s in settings.HEADINGS_S:
        still, *_, fast = settings.speeds(distribution, hold_s)
        yield Check(
            f"{STATIC} lower at 15 m/s, headings held {hold_s:g} s",
            (STATIC,),
            EFFICIENCY,
            "lower",
            MARGINS[EFFICIENCY],
            partial(Evidence.topologies, rule=STATIC, metric=EFFICIENCY, case=fast),
            partial(Evidence.topologies, rule=STATIC, metric=EFFICIENCY, case=still),
        )


def c25(distribution: Distribution) -> Iterator[Check]:
    """Hovering beside each learned method, in mean and spread."""
    cases = settings.uavs(distribution)
    for method in LEARNED:
        for metric in (RATE, LOAD):
            yield beside(STATIC, "higher", method, metric, cases)
            yield beside(STATIC, "higher", method, metric, cases, "std")


def c26(distribution: Distribution) -> Iterator[Check]:
    """The second baseline beside ORCHID."""
    for metric in (RATE, LOAD):
        cases = settings.users(distribution)
        yield beside(MMF_DDPG, "lower", ORCHID, metric, cases, "std")


def c27(_: Distribution) -> Iterator[Check]:
    """What variances do at the reset, beside κ²."""
    lowered_alone = f"{ORCHID}-decay-only"
    for method, kappa in ((lowered_alone, 0.5), (ORCHID, 0.5), (f"{ORCHID}-kappa-0.1", 0.1)):
        yield Check(
            f"{method}: Var(Δθ) of the 50 updates after the reset over that of the 50 before, "
            f"beside κ² = {kappa**2:g} (decimal logarithms)",
            (method,),
            VARIANCE_RATIO,
            "equal",
            MARGINS[VARIANCE_RATIO],
            partial(Evidence.update_variance_ratio, method=method),
            _constant(2.0 * float(np.log10(kappa))),
        )


def c28(distribution: Distribution) -> Iterator[Check]:
    """ORCHID beside its twin where Phase I was wrong."""
    exact, *wrong = settings.errors(distribution)
    for case in wrong:
        where = f", Phase I {case.sensing_error_m:g} m off"
        for metric in (RATE, LOAD, UTILITY):
            yield beside(ORCHID, "higher", f"{ORCHID}-zero", metric, [case], where=where)
        yield Check(
            f"{ORCHID} loses less than its twin{where}",
            (ORCHID,),
            UTILITY,
            "higher",
            MARGINS[UTILITY],
            partial(_loss, method=ORCHID, exact=exact, wrong=case),
            partial(_loss, method=f"{ORCHID}-zero", exact=exact, wrong=case),
        )


def _loss(evidence: Evidence, method: str, exact: Case, wrong: Case) -> Floats:
    with_error = evidence.flown(method, UTILITY, [wrong])
    return with_error - evidence.flown(method, UTILITY, [exact])


def c29(_: Distribution) -> Iterator[Check]:
    """Nothing: no backhaul of the model has a capacity."""
    return iter(())


def c30(distribution: Distribution) -> Iterator[Check]:
    """ORCHID beside hovering with either rule of sharing, where users walk fastest."""
    for hold_s in settings.HEADINGS_S:
        fast = settings.speeds(distribution, hold_s)[-1]
        where = f" at 15 m/s, headings held {hold_s:g} s"
        for rule in (STATIC, STATIC_MMF):
            for metric in (RATE, LOAD):
                yield beside(ORCHID, "not lower", rule, metric, [fast], where=where)


def c31(distribution: Distribution) -> Iterator[Check]:
    """ORCHID beside MADDPG, over all speeds of users that walk."""
    yield from narrowest_efficiency(_walking(distribution))
