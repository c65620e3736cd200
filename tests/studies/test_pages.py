"""Generated parts of the documentation say what the committed results say, in words that follow."""

import string

import pytest

from orchid_uav.experiments.configuration import configuration_keys
from orchid_uav.experiments.statistics.intervals import MetricSummary
from studies.pages import ablation as ablations
from studies.pages.generate import PAGES, configuration_page, page
from studies.pages.markdown import metrics_table
from studies.pages.results import is_measured, result
from studies.pages.results_words import sentences, told_of
from studies.recording import read_evaluation

SAID = {key: text for said in sentences().values() for key, text in said.items()}
"""Of claims: each names a claim, and no difference that the claim does not have."""


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_generated_pages_are_current(path):
    assert path.read_text(encoding="utf-8") == page(path), "run: make docs-data"


def test_results_of_before_total_coverage_make_tables_without_it():
    hover = read_evaluation("methods").results[0].model_copy(update={"method": "hover"}, deep=True)
    hover.metrics.clear()
    for name, mean, std in (("coverage", 1.0, 0.0), ("total_coverage", 0.925, 0.1)):
        hover.metrics[name] = MetricSummary(mean=mean, std=std, ci95=None)
    metrics = ("coverage", "total_coverage")
    assert "| 1.000 | 0.925 ± 0.100 |" in metrics_table([hover], metrics)
    del hover.metrics["total_coverage"]
    assert metrics_table([hover], metrics).splitlines()[2] == "| `hover` | 1.000 |"


def test_words_that_do_not_follow_from_the_results_are_not_written(monkeypatch):
    document = ablations.read_ablation(ablations.NAME)
    found = document.comparisons["evaluation"]["no-rf"]["utility"]
    monkeypatch.setattr(ablations, "read_ablation", lambda name: document)
    for verdict, reward, words in (
        ("worse", None, "no difference is shown"),
        ("equivalent", None, None),
        ("equivalent", 0.0, "reward is lower in every"),
    ):
        found.verdict = verdict
        if reward is not None:
            document.runs[0].training["reward"] = reward
        if words is None:
            ablations.summary_block()
        else:
            with pytest.raises(ValueError, match=words):
                ablations.summary_block()


def test_every_key_is_described():
    page = configuration_page()
    for key in configuration_keys():
        row = next(line for line in page.splitlines() if f"`{key}`" in line)
        assert row.count("|") >= 6 and not row.rstrip().endswith("| None |"), key
    assert "| `training.worlds` | 1 |" in page
    assert "| `reset.enabled` | true |" in page
    assert "| `network.total_bandwidth_hz` | none |" in page


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
