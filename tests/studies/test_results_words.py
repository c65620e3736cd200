"""Sentences about claims: each names a claim, and no difference that the claim does not have."""

import string

import pytest

from studies.pages.results import result
from studies.pages.results_words import sentences, told_of

SAID = {key: text for said in sentences().values() for key, text in said.items()}


@pytest.mark.parametrize("key", SAID)
def test_a_sentence_tells_differences_of_its_claim(key):
    [claim] = [one for one in (*result().claims, *result().questions) if one.key == key]
    told = told_of(claim, SAID[key])
    assert told.endswith(f"({key.upper()})") and "{" not in told
    numbers = {field for _, field, _, _ in string.Formatter().parse(SAID[key]) if field}
    assert numbers & {str(place) for place in range(len(claim.tcp.checks))}


def test_no_claim_is_told_twice():
    assert len(SAID) == sum(map(len, sentences().values()))
