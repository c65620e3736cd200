"""Sentences about claims: each names a claim, and no difference that the claim does not have."""

import string

import pytest

from studies.pages.results import is_measured, result
from studies.pages.results_words import sentences, told_of

SAID = {key: text for said in sentences().values() for key, text in said.items()}


@pytest.mark.parametrize("key", SAID)
def test_a_sentence_tells_differences_of_its_claim(key):
    [claim] = [one for one in (*result().claims, *result().questions) if one.key == key]
    assert len(SAID[key].findings) == len(claim.tcp.checks)
    told = told_of(claim, SAID[key])
    assert told.endswith(f"({key.upper()})") and "{" not in told
    numbers = {field for _, field, _, _ in string.Formatter().parse(SAID[key].text) if field}
    assert numbers & {str(place) for place in range(len(claim.tcp.checks))}


@pytest.mark.parametrize(
    ("key", "others"),
    [
        ("c19", {"findings": ["yes", "no"]}),
        ("c18", {"findings": ["within"]}),  # and it is shown on the other side
        ("q1", {"uniform": ["above, within", "above, within", "no"]}),
    ],
)
def test_a_sentence_for_other_findings_is_refused(key, others):
    [claim] = [one for one in (*result().claims, *result().questions) if one.key == key]
    assert is_measured(claim)
    with pytest.raises(ValueError, match=f"{key}: written for"):
        told_of(claim, SAID[key]._replace(**others))


def test_a_sentence_about_uniform_users_names_what_it_was_written_for():
    assert {key for key in SAID if "niform" in SAID[key].text} == {
        key for key in SAID if SAID[key].uniform
    }


def test_no_claim_is_told_twice():
    assert len(SAID) == sum(map(len, sentences().values()))
