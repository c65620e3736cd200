"""Which methods a figure or a claim needs."""

from collections.abc import Iterable, Sequence

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS, Claim
from orchid_uav.experiments.reproduction.job import HOVERING, RULES
from orchid_uav.experiments.reproduction.settings import DISTRIBUTIONS
from orchid_uav.experiments.reproduction.trainings import TRAININGS
from orchid_uav.suggestions import unknown

_PAPERS = ("orchid", "orchid-no-rf", "maddpg-mmf", "maddpg-pf")
_HOVERING = ("static-mmf", "static-pf")
_SCALING = frozenset((*_PAPERS, "orchid-pf", "orchid-random-init", *RULES))
FIGURES: dict[str, frozenset[str]] = {
    "fig3": frozenset((*_PAPERS, "orchid-uniform", "orchid-no-rf-uniform", *HOVERING)),
    "fig4": _SCALING,
    "fig5": _SCALING,
    "fig6": _SCALING | {"orchid-informed"},
    "fig7": frozenset(("orchid", "orchid-random-init", *_HOVERING)),
    "fig8": frozenset(("orchid-long", "orchid-pf", *_HOVERING)),
}
"""Methods and rules without which one of the paper's figures, by its key, is not complete. Figs. 4
to 6 show further trainings where there are rows of them."""
KEYS = (*FIGURES, *(claim.key for claim in (*CLAIMS, *QUESTIONS)))
"""Everything that can be asked for alone."""


def needed_for(only: Sequence[str]) -> set[str]:
    """The methods and rules that figures and claims need; all of them where nothing is named.

    Raises:
        InputError: there is no such figure or claim.
    """
    if not only:
        return {*TRAININGS, *RULES, *HOVERING}
    needed: set[str] = set()
    claims = {claim.key: claim for claim in (*CLAIMS, *QUESTIONS)}
    for key in only:
        if key not in KEYS:
            raise InputError(unknown("figure or claim", key, KEYS))
        needed.update(FIGURES[key] if key in FIGURES else _methods_of(claims[key]))
    return needed


def chosen(claims: Iterable[Claim], only: Sequence[str]) -> list[Claim]:
    """The claims among those asked for; all of them where nothing is named."""
    return [claim for claim in claims if not only or claim.key in only]


def figures_for(only: Sequence[str]) -> set[str]:
    """The paper's figures among those asked for, and those that show the claims asked for."""
    shown = {claim.figure for claim in chosen((*CLAIMS, *QUESTIONS), only)}
    return {key for key in FIGURES if not only or key in only or key in shown}


def _methods_of(claim: Claim) -> set[str]:
    """The methods and rules that a claim's checks need."""
    distributions = DISTRIBUTIONS if claim.by_distribution else DISTRIBUTIONS[:1]
    return {
        method
        for distribution in distributions
        for check in claim.checks(distribution)
        for method in check.methods
    }
