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


def test_a_sentence_for_other_findings_is_refused():
    [claim] = [one for one in result().claims if one.key == "c19"]
    assert is_measured(claim)
    with pytest.raises(ValueError, match="c19: written for"):
        told_of(claim, SAID["c19"]._replace(findings=["yes", "no"]))


def test_no_claim_is_told_twice():
    assert len(SAID) == sum(map(len, sentences().values()))
