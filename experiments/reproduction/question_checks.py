"""The comparisons that answer the questions which the paper leaves open, by their numbers."""

from collections.abc import Iterator, Sequence

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import (
    EFFICIENCY,
    LOAD,
    MADDPG_OF_PAPER,
    ORCHID,
    RATE,
    UTILITY,
    WORST,
    beside,
    fairer_than_maddpg,
    narrowest_efficiency,
)
from orchid_uav.experiments.reproduction.settings import Case
from orchid_uav.experiments.reproduction.verdicts import Check

INFORMED, TUNED = "orchid-informed", "orchid-tuned"


def _above_twin(base: str, cases: Sequence[Case]) -> Iterator[Check]:
    """A policy beside its zero-action twin."""
    for metric in (UTILITY, RATE, WORST):
        yield beside(base, "higher", f"{base}-zero", metric, cases)


def _reset_and_finetune(base: str, cases: Sequence[Case]) -> Iterator[Check]:
    """With beside without Reset-and-Finetune."""
    for metric in (UTILITY, EFFICIENCY, RATE, LOAD):
        yield beside(base, "higher", f"{base}-no-rf", metric, cases)


def _what_does_it(base: str, cases: Sequence[Case]) -> Iterator[Check]:
    """Reset-and-Finetune beside each of its controls."""
    for control in ("reset-only", "decay-only", "random-time", "linear-decay"):
        yield beside(base, "higher", f"{base}-{control}", UTILITY, cases)


def q1(distribution: Distribution) -> Iterator[Check]:
    """The paper's policy beside its twin."""
    yield from _above_twin(ORCHID, [settings.base(distribution)])


def q2(distribution: Distribution) -> Iterator[Check]:
    """The paper's policy with and without Reset-and-Finetune."""
    yield from _reset_and_finetune(ORCHID, [settings.base(distribution)])


def q3(distribution: Distribution) -> Iterator[Check]:
    """The paper's policy beside the controls of Reset-and-Finetune."""
    yield from _what_does_it(ORCHID, [settings.base(distribution)])


def q4(distribution: Distribution) -> Iterator[Check]:
    """The policy on stations beside its twin."""
    yield from _above_twin(INFORMED, settings.walking_held(distribution))


def q5(distribution: Distribution) -> Iterator[Check]:
    """The policy on stations with and without Reset-and-Finetune."""
    yield from _reset_and_finetune(INFORMED, settings.walking_held(distribution))


def q6(distribution: Distribution) -> Iterator[Check]:
    """The policy on stations beside the controls of Reset-and-Finetune."""
    yield from _what_does_it(INFORMED, settings.walking_held(distribution))


def q7(distribution: Distribution) -> Iterator[Check]:
    """C9 and C10 where both sides have the paper's numbers."""
    cases = settings.users(distribution)
    yield from fairer_than_maddpg(cases, baselines=MADDPG_OF_PAPER)
    yield from narrowest_efficiency(cases, baselines=MADDPG_OF_PAPER)


def q8(distribution: Distribution) -> Iterator[Check]:
    """C9 and C10 where both sides were searched for, with the same effort."""
    cases = settings.users(distribution)
    yield from fairer_than_maddpg(cases, TUNED)
    yield from narrowest_efficiency(cases, TUNED)
