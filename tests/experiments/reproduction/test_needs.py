"""Which methods figures and claims need."""

import pytest

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.figures.all_figures import drawn_methods
from orchid_uav.experiments.reproduction.job import HOVERING, RULES
from orchid_uav.experiments.reproduction.needs import (
    FIGURES,
    chosen,
    figures_for,
    needed_for,
)
from orchid_uav.experiments.reproduction.trainings import TRAININGS

SCALING = ("fig4", "fig5", "fig6")
EVERYTHING = {*TRAININGS, *RULES, *HOVERING}


def test_everything_is_needed_for_everything():
    assert needed_for([]) == EVERYTHING
    assert {hovering.rule for hovering in HOVERING.values()} <= {*RULES}
    assert {hovering.beside for hovering in HOVERING.values()} <= {*TRAININGS}


@pytest.mark.parametrize(
    ("key", "needed"),
    [
        ("c4", {"orchid", "orchid-no-rf"}),
        ("c7", {"maddpg-mmf", "maddpg-pf"}),
        ("c18", {"orchid-long", "orchid-pf"}),
        ("c19", {"orchid-long", "orchid-pf"}),
        ("c24", {"static-pf"}),
        ("c27", {"orchid", "orchid-decay-only", "orchid-kappa-0.1"}),
        ("c29", set()),
        ("q1", {"orchid"}),
        ("fig7", {"orchid", "orchid-random-init", "static-mmf", "static-pf"}),
    ],
)
def test_a_claim_needs_what_it_compares(key, needed):
    assert needed_for([key]) == needed


@pytest.mark.parametrize("claim", [*CLAIMS, *QUESTIONS], ids=lambda claim: claim.key)
def test_a_comparison_names_the_methods_that_it_reads(claim):
    class Asked(Evidence):
        def _row(self, method, seed):
            if method in EVERYTHING:  # twins are asked for as if they were rules, first
                asked.add(method)

    for distribution in ("tcp", "uniform"):
        for check in claim.checks(distribution):
            asked: set[str] = set()
            for side in (check.one, check.other):
                side(Asked([]))
            assert {*check.methods} == asked, check.what


def test_needs_add_up():
    assert needed_for(["c24", "c7"]) == {"static-pf", "maddpg-mmf", "maddpg-pf"}


@pytest.mark.parametrize("figure", FIGURES)
def test_a_figure_needs_what_it_draws(figure):
    further = {"orchid-tuned", "orchid-uniform", "orchid-no-rf-uniform", "orchid-informed"}
    further |= {"maddpg-pf-paper", "maddpg-mmf-paper"}
    drawn = {*drawn_methods(figure)}
    assert FIGURES[figure] <= drawn
    assert drawn - FIGURES[figure] == (further - FIGURES[figure] if figure in SCALING else set())


@pytest.mark.parametrize("key", [*FIGURES, *(claim.key for claim in (*CLAIMS, *QUESTIONS))])
def test_what_is_needed_can_be_made(key):
    assert needed_for([key]) <= EVERYTHING


def test_every_claim_names_a_figure_that_there_is():
    assert {claim.figure for claim in (*CLAIMS, *QUESTIONS)} <= {*FIGURES, ""}


def test_what_is_unknown_is_refused_with_the_nearest_name():
    with pytest.raises(InputError, match="fig5"):
        needed_for(["fgi5"])


def test_claims_can_be_chosen():
    assert [claim.key for claim in chosen(CLAIMS, ["c4", "fig5"])] == ["c4"]
    assert chosen(CLAIMS, []) == list(CLAIMS)


def test_figures_are_those_asked_for_and_those_of_the_claims():
    assert figures_for([]) == {*FIGURES}
    assert figures_for(["fig5", "c4", "c29"]) == {"fig5", "fig3"}
    assert figures_for(["c29"]) == set()
