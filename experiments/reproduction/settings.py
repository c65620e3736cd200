"""What is flown for the figures: settings by axis, in worlds of the paper's network."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.evaluation.flights import Setting
from orchid_uav.experiments.reproduction.trainings import Flown

EVALUATION_SEED = 1000
"""Seed of the held-out topologies of all verdicts; nothing was tuned or chosen on them."""
CURVE_SEED = 1001
"""Seed of the topologies on which policies are flown on their way."""
TOPOLOGIES, CURVE_TOPOLOGIES, QUICK_TOPOLOGIES = 100, 50, 20

USERS = (50, 100, 150, 200)
UAVS = (4, 5, 6, 7, 8, 9, 10)
SPEEDS_MPS = (0.0, 5.0, 10.0, 15.0)
HEADINGS_S = (1.0, 20.0)
SENSING_ERRORS_M = (0.0, 50.0, 150.0)
DISTRIBUTIONS: tuple[Distribution, ...] = ("tcp", "uniform")
SENSING_KEY = "network.sensing_error_std_m"


class Case(NamedTuple):
    """A setting, and what else of the world differs from the paper's."""

    setting: Setting
    sensing_error_m: float = 0.0

    @property
    def world(self) -> Mapping[str, Any]:
        """The values that differ, by ``"section.key"``."""
        return {SENSING_KEY: self.sensing_error_m} if self.sensing_error_m else {}


def users(distribution: Distribution) -> list[Case]:
    """The axis of Fig. 4."""
    return [Case(Setting(distribution, users=count)) for count in USERS]


def uavs(distribution: Distribution) -> list[Case]:
    """The axis of Fig. 5."""
    return [Case(Setting(distribution, uavs=count)) for count in UAVS]


def speeds(distribution: Distribution, heading_hold_s: float) -> list[Case]:
    """The axis of Fig. 6; where nobody walks, how long headings are held means nothing."""
    return [
        Case(Setting(distribution, speed_mps=speed, heading_hold_s=heading_hold_s))
        if speed
        else Case(Setting(distribution))
        for speed in SPEEDS_MPS
    ]


def walking_held(distribution: Distribution) -> list[Case]:
    """Users that walk and hold their headings for 20 s, as ``orchid-informed`` was trained."""
    return speeds(distribution, HEADINGS_S[-1])[1:]


def errors(distribution: Distribution) -> list[Case]:
    """Phase I that sees users where they are, 50 and 150 m off."""
    return [Case(Setting(distribution), error_m) for error_m in SENSING_ERRORS_M]


def base(distribution: Distribution) -> Case:
    """The paper's network."""
    return Case(Setting(distribution))


def flown_by(flown: Flown) -> list[Case]:
    """The cases of a kind of training, each once, the paper's network first."""
    return list(dict.fromkeys(_cases(flown)))


def _cases(flown: Flown) -> Iterator[Case]:
    for distribution in DISTRIBUTIONS if flown == "everything" else DISTRIBUTIONS[:1]:
        yield base(distribution)
        if flown in ("everything", "tcp"):
            yield from users(distribution)
            yield from uavs(distribution)
        if flown != "base":
            for hold_s in HEADINGS_S:
                yield from speeds(distribution, hold_s)
            yield from errors(distribution)


QUICK_CASES = list(
    dict.fromkeys(
        [base("tcp"), *users("tcp")[::3], *uavs("tcp")[::6], *speeds("tcp", 1.0)[::3]],
    )
)
"""What a quick run flies."""
