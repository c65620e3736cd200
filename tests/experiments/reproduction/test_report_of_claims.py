"""The page that says what holds: the document's numbers, and nothing from outside."""

import base64
import itertools
import re
from collections import Counter
from html import escape, unescape

import numpy as np
import pytest

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS
from orchid_uav.experiments.reproduction.report.effects import decisive, scale_of
from orchid_uav.experiments.reproduction.report.methods import OWN, PAPERS
from orchid_uav.experiments.reproduction.report.page import report_html
from orchid_uav.experiments.reproduction.result import Judged
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.reproduction.verdicts import verdict_of
from tests.helpers.pages import HOSTILE, Page
from tests.helpers.reports import (
    make_claims,
    make_document,
    make_figures,
    make_judgement,
    make_method,
)
from tests.helpers.reproductions import make_reproduction, make_rows, mean_of

VERDICT_WORDS = ("holds", "partly", "does not hold", "undecided", "not testable in this model")


@pytest.fixture(scope="module")
def figures(tmp_path_factory):
    return make_figures(tmp_path_factory.mktemp("figures"))


@pytest.fixture(scope="module")
def document():
    return make_document()


@pytest.fixture(scope="module")
def page(document, figures):
    return report_html(document, figures)


@pytest.fixture(scope="module")
def quick(figures):
    return report_html(make_document(is_quick=True, missing=12), figures)


def text_of(markup):
    return unescape(re.sub(r"<[^>]*>", "", markup)).replace("\u00a0", " ")


def table_of(page, caption):
    """The cells of a table, row by row, without its head."""
    [found] = re.findall(rf"<caption>{re.escape(escape(caption))}</caption>(.*?)</table>", page)
    body = found.partition("<tbody>")[2]
    return [
        [text_of(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)]
        for row in re.findall(r"<tr[^>]*>(.*?)</tr>", body)
    ]


def numbers_in(text):
    return [float(found) for found in re.findall(r"[+-]?\d+(?:\.\d+)?", text.replace("−", "-"))]


def found_in_words(check):
    if check.finding != "no":
        return check.finding
    if check.is_within_margin:
        return "no (less than counts)"
    others = {"equal": "no (it differs)", "not lower": "no (it is lower)"}
    return others.get(check.expected, "no (the opposite)")


class TestAsAPage:
    def test_it_is_nested_well_and_asks_for_nothing_from_anywhere(self, page, quick):
        for one in (page, quick):
            parsed = Page(one)
            tags = {tag for tag, _ in parsed.elements}
            assert not tags & {"script", "link", "iframe", "object", "embed", "base", "svg"}
            for tag, attributes in parsed.elements:
                assert attributes.get("href", "#").startswith("#"), tag
                assert attributes.get("src", "data:image/svg+xml").startswith("data:image/svg+xml")
                assert not any(key.startswith("on") for key in attributes)
            assert "http" not in one.replace("http-equiv", "")
            assert "url(" not in one
            assert "@import" not in one

    def test_its_policy_admits_styles_and_images_within_it_alone(self, page):
        [policy] = [
            one["content"]
            for one in Page(page).all("meta")
            if one.get("http-equiv") == "Content-Security-Policy"
        ]
        assert policy == "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

    def test_links_lead_to_places_that_are_there_once(self, page, quick):
        for one in (page, quick):
            elements = Page(one).elements
            places = [attributes["id"] for _, attributes in elements if "id" in attributes]
            assert len(places) == len(set(places))
            links = {attributes["href"][1:] for _, attributes in elements if "href" in attributes}
            assert links <= set(places)

    def test_headings_do_not_leave_out_a_level(self, page):
        levels = [int(tag[1]) for tag, _ in Page(page).elements if re.fullmatch("h[1-6]", tag)]
        assert levels[0] == 1
        assert levels.count(1) == 1
        assert all(after <= before + 1 for before, after in itertools.pairwise(levels))

    def test_tables_have_a_caption_heads_and_equal_rows(self, page):
        parsed = Page(page)
        assert len(parsed.all("caption")) == len(parsed.all("table"))
        assert {head["scope"] for head in parsed.all("th")} == {"col", "row"}
        for body in re.findall("<table>.*?</table>", page):
            rows = re.findall("<tr.*?</tr>", body)
            assert len({len(re.findall("<t[hd][ >]", row)) for row in rows}) == 1

    def test_no_number_is_missing(self, page, quick):
        for one in (page, quick):
            assert not re.search(r"\bnan\b|\binf\b|\bNone\b|Traceback|\bnp\.", Page(one).text)

    def test_the_same_document_gives_the_same_page(self, document, figures, page):
        assert report_html(document, figures) == page


class TestVerdicts:
    def test_there_is_one_of_every_kind(self, document):
        assert {claim.tcp.verdict for claim in document.claims} == set(VERDICT_WORDS)

    def test_they_are_counted(self, document, page):
        counts = Counter(claim.tcp.verdict for claim in document.claims)
        tiles = re.findall(r"<div><dt>(.*?)</dt><dd>(\d+)</dd></div>", page)
        told = {text_of(name).partition(" ")[2]: int(count) for name, count in tiles}
        assert told == {word: counts[word] for word in VERDICT_WORDS}

    def test_no_two_kinds_look_the_same_without_colours(self, page):
        signs = {
            word: sign
            for sign, word in re.findall(
                r'class="badge \w+"><span aria-hidden="true">(.)</span>\u00a0([\w ]+)</span>', page
            )
        }
        assert set(VERDICT_WORDS) <= set(signs)
        assert len({signs[word] for word in VERDICT_WORDS}) == len(VERDICT_WORDS)

    @pytest.mark.parametrize(
        ("caption", "claims"),
        [("The paper's claims", CLAIMS), ("Questions, by the same rules", QUESTIONS)],
    )
    def test_every_claim_has_a_line_with_its_verdicts(self, document, page, caption, claims):
        both = {one.key: one for one in (*document.claims, *document.questions)}
        rows = table_of(page, caption)
        assert [row[0] for row in rows] == [claim.key.upper() for claim in claims]
        for claim, row in zip(claims, rows, strict=True):
            assert claim.says in row[1]
            assert claim.where in row[1]
            own = both[claim.key]
            assert own.tcp.verdict in row[2]
            assert (own.uniform is not None) == ("spread evenly: " in row[2])
            if own.tcp.checks:
                shown = decisive(own.tcp)
                assert shown.what in row[3]
                scale = scale_of(shown)
                half = 0.5 * 10.0**-scale.digits + 1e-12
                told = numbers_in(row[4].partition("detectable")[0])
                for number, value in zip(told, (shown.difference, *shown.ci95), strict=True):
                    assert number == pytest.approx(value * scale.factor, abs=half)
                assert ("detectable from" in row[4]) == (shown.finding == "undecided")
                assert row[5] == "10 of 10"

    def test_a_figure_is_linked_where_one_was_drawn(self, page):
        for claim, row in zip(CLAIMS, table_of(page, "The paper's claims"), strict=True):
            figure = f"Fig. {claim.figure[3]}" if claim.figure else "–"
            assert row[-1].replace("\u00a0", " ") == f"{figure}--only {claim.key}"
            assert f"orchid reproduce --only {claim.key}<" in page
        assert '<a href="#fig4_tcp">Fig.\u00a04</a>' in page

    def test_every_comparison_is_told_with_the_documents_numbers(self, document, page):
        seen, found = 0, set()
        for claim in (*document.claims, *document.questions):
            for words, judged in (
                ("users in hotspots", claim.tcp),
                ("users spread evenly", claim.uniform),
            ):
                if judged is None or not judged.checks:
                    continue
                rows = table_of(page, f"Comparisons of {claim.key.upper()}, {words}")
                for check, row in zip(judged.checks, rows, strict=True):
                    factor, digits = expected_scale(check)
                    half = 0.5 * 10.0**-digits + 1e-12
                    assert row[0] == check.what
                    for text, value in (
                        (row[2], check.one),
                        (row[3], check.other),
                        (row[5], check.margin),
                        (row[8], check.least_detectable_effect),
                    ):
                        assert numbers_in(text)[0] == pytest.approx(value * factor, abs=half)
                    ends = numbers_in(row[4].partition("[")[2])
                    assert ends == pytest.approx([end * factor for end in check.ci95], abs=half)
                    assert row[6] == "0.012"
                    assert row[7] == "10 of 10"
                    assert row[9][2:] == found_in_words(check)
                    seen += 1
                    found.add(row[9][2:])
        assert seen > 200
        assert {"yes", "undecided", "no (less than counts)", "no (the opposite)"} <= found

    def test_no_margin_vanishes_in_rounding(self):
        for claim in (*CLAIMS, *QUESTIONS):
            for check in claim.checks("tcp"):
                judgement = make_judgement(check, "yes")
                assert float(scale_of(judgement).text(check.margin)) > 0.0, check.what


def expected_scale(check):
    """Factor and digits, worked out anew: coefficients of variation have no unit."""
    if check.metric not in METRICS:
        return 1.0, 2
    if "relative spread" in check.what:
        return 1.0, 4
    return METRICS[check.metric].scale, METRICS[check.metric].digits


SOME = [check for claim in CLAIMS[:4] for check in claim.checks("tcp")]


def decisive_of(*found):
    return decisive(Judged(verdict=verdict_of([one.finding for one in found]), checks=[*found]))


class TestTheDecisiveComparison:
    def test_is_the_clearest_no(self):
        found = [make_judgement(check, "no") for check in SOME[:3]]
        found[1] = found[1].model_copy(update={"difference": -9.0 * found[1].margin})
        assert decisive_of(make_judgement(SOME[4], "yes"), *found) is found[1]

    def test_is_none_that_speaks_for_the_claim_while_another_does_not(self):
        found = [make_judgement(check, "no") for check in SOME[:2]]
        found[0] = found[0].model_copy(update={"difference": 0.7 * found[0].margin})
        found[1] = found[1].model_copy(update={"difference": -0.1 * found[1].margin})
        assert decisive_of(*found) is found[1]

    def test_is_what_is_open_before_what_is_shown(self):
        found = make_judgement(SOME[1], "undecided")
        assert decisive_of(make_judgement(SOME[0], "yes"), found) is found

    def test_is_what_is_open_where_nothing_else_keeps_a_claim_from_failing(self):
        found = [make_judgement(check, "undecided") for check in SOME[:2]]
        found[1] = found[1].model_copy(update={"difference": -0.9 * found[1].margin})
        assert decisive_of(make_judgement(SOME[2], "no"), *found) is found[1]

    def test_is_what_waits_for_seeds_before_what_is_open(self):
        open_one, waiting = (make_judgement(check, "undecided") for check in SOME[:2])
        waiting = waiting.model_copy(update={"n": 0, "difference": None, "ci95": None})
        assert decisive_of(open_one, waiting) is waiting

    def test_is_the_narrowest_where_all_are_shown(self):
        found = [make_judgement(check, "yes") for check in SOME[:3]]
        found[2] = found[2].model_copy(update={"difference": 1.1 * found[2].margin})
        assert decisive_of(*found) is found[2]

    def test_is_none_where_none_is_possible(self):
        assert decisive_of() is None

    def test_bears_the_verdict_out(self):
        findings = {"holds": "yes", "partly": "no", "does not hold": "no", "undecided": "undecided"}
        for judged in (claim.tcp for claim in make_claims(CLAIMS, False) if claim.tcp.checks):
            assert decisive(judged).finding == findings[judged.verdict]


class TestFigures:
    def test_are_in_the_page_byte_for_byte_with_their_alternatives(self, page, figures):
        images = Page(page).all("img")
        for image, figure in zip(images, figures, strict=True):
            content = image["src"].partition("base64,")[2]
            assert base64.b64decode(content) == figure.path.read_bytes()
            assert image["alt"] == figure.alternative
            assert figure.caption in page

    def test_tell_the_verdict_for_the_users_they_show(self, document, figures):
        [claim] = [one for one in document.claims if one.key == "c7"]
        evenly = claim.uniform.model_copy(update={"verdict": "undecided"})
        clustered = claim.tcp.model_copy(update={"verdict": "holds"})
        changed = claim.model_copy(update={"tcp": clustered, "uniform": evenly})
        page = report_html(make_document(claims=[changed], questions=[]), figures)
        told = {
            key: text_of(words)
            for key, words in re.findall(
                r'<figure id="(fig4_\w+)">.*?What it says about the claims: (.*?)</p>', page
            )
        }
        assert told == {"fig4_tcp": "C7 ✓ holds", "fig4_uniform": "C7 ? undecided"}

    def test_a_page_without_them_has_no_dead_link(self, document):
        parsed = Page(report_html(document, []))
        assert not parsed.all("img")
        assert not any("#fig" in one.get("href", "") for _, one in parsed.elements)


class TestMethods:
    def test_each_stands_beside_its_twin_with_the_documents_numbers(self, document, page):
        rows = table_of(page, "The paper's methods, and their twins")
        assert [row[0] for row in rows[2::3]] == [f"{key}-zero" for key in PAPERS]
        assert {row[1] for row in rows} == {"without noise", "with noise", "does nothing"}
        by_key = {method.method: method for method in document.methods}
        heads = ["coverage", "energy_efficiency_bit_per_joule", "rate_jfi"]
        for row in rows[::3]:
            for metric, cell in zip(heads, row[2:], strict=False):
                scale = METRICS[metric]
                mean, std = numbers_in(cell)
                summary = by_key[row[0]].deterministic[metric]
                half = 0.5 * 10.0**-scale.digits + 1e-12
                assert mean == pytest.approx(summary.mean * scale.scale, abs=half)
                assert std == pytest.approx(summary.std * scale.scale, abs=half)

    def test_own_ones_are_told_by_what_they_add(self, document, page):
        rows = table_of(page, "In the paper's network, flown without noise")
        assert [row[0] for row in rows] == ["orchid", *OWN]
        by_key = {method.method: method for method in document.methods}
        for row in rows[1:]:
            method = by_key[row[0]]
            mean = method.deterministic["utility"].mean
            assert numbers_in(row[2]) == [pytest.approx(mean, abs=0.0005001)]
            added = method.beside_orchid["utility"]
            assert numbers_in(row[3]) == pytest.approx([added.mean, *added.ci95], abs=0.0005001)

    def test_false_alarms_are_counted(self, page):
        rows = table_of(page, "Runs that learn nothing in which the trigger fires")
        assert rows == [["10", "7 of 10 (episode 123)"], ["25", "0 of 10"]]

    def test_every_training_can_be_repeated(self, page):
        rows = table_of(page, "Commands")
        assert [row[0] for row in rows] == list(TRAININGS)
        assert rows[1][3] == "orchid train --no-rf --seed 10 --name orchid-no-rf"


class TestAQuickRun:
    def test_is_marked_and_gives_no_verdict(self, quick):
        text = Page(quick).text
        assert text.startswith("NOT EVIDENCE")
        assert 'class="banner"' in quick
        badges = re.findall(r'class="badge \w+"><span[^>]*>.</span>\u00a0([\w ]+)</span>', quick)
        assert set(badges) == {"no verdict"}
        assert "12 results are still missing" in text

    def test_is_not_what_a_whole_run_is_called(self, page):
        assert "NOT EVIDENCE" not in page
        assert "Nothing is missing." in page


def test_what_is_missing_is_named():
    rows = [
        *make_rows(["maddpg-pf", "maddpg-mmf"], rules=()),
        *make_rows(["orchid"], SEEDS[:7], rules=["track"]),
    ]
    missing = [*(("orchid", seed) for seed in SEEDS[7:]), ("best-response", None)]
    missing += [("orchid-pf", seed) for seed in SEEDS]
    page = report_html(make_reproduction(rows, missing), [])
    told = [["orchid", "7 of 10"], ["orchid-pf", "0 of 10"]]
    assert table_of(page, "Trainings with fewer seeds") == told
    assert "2 of 4 trainings have all of their 10 seeds (10 to 19)" in Page(page).text
    assert "14 results are still missing" in Page(page).text


def test_methods_without_numbers_have_a_page(figures):
    bare = make_method("orchid").model_copy(update={"sampled": {}, "twin": {}})
    empty = make_document(methods=[bare], sensitivities=[], false_alarms=[], rows={}, missing=300)
    Page(report_html(empty, figures))
    Page(report_html(make_document(methods=[], claims=[], questions=[]), []))


def test_texts_from_rows_do_no_harm(figures, page):
    document = make_document(
        command=["orchid", HOSTILE],
        processors=[HOSTILE],
        commits=[HOSTILE],
        date=HOSTILE,
        versions={"orchid_uav": HOSTILE},
    )
    made = report_html(document, figures)
    made.encode()
    usual, hostile = Page(page), Page(made)
    assert {tag for tag, _ in hostile.elements} == {tag for tag, _ in usual.elements}
    assert not any("onclick" in attributes for _, attributes in hostile.elements)
    assert "</script><script>alert(1)</script>" in hostile.text
    assert not set(made) & set("\u202e\x00\ud800")


def test_few_rows_of_a_quick_run_become_a_page(figures):
    rows = list(make_rows(["orchid", "maddpg-mmf"], (10, 11), ["static-pf"], is_quick=True))
    document = make_reproduction(rows, [("orchid-pf", 10)], is_quick=True)
    page = report_html(document, figures)
    for key, pairs in (("C2", "2 of 10"), ("C10", "0 of 10")):
        told = table_of(page, f"Comparisons of {key}, users in hotspots")
        assert {row[7] for row in told} == {pairs}
        assert {row[9] for row in told} == {"–"}


def test_what_a_method_adds_is_paired_by_seed():
    rows = list(make_rows(["orchid", "orchid-informed"], rules=["balanced-loiter"]))
    by_key = {method.method: method for method in make_reproduction(rows).methods}
    paper = [mean_of("orchid", "utility", seed) for seed in SEEDS]
    own = [mean_of("orchid-informed", "utility", seed) for seed in SEEDS]
    added = by_key["orchid-informed"].beside_orchid["utility"]
    assert added.mean == pytest.approx(np.mean(own) - np.mean(paper), abs=1e-4)
    assert added.ci95[0] < added.mean < added.ci95[1]
    rule = by_key["balanced-loiter"].beside_orchid["utility"]
    expected = mean_of("balanced-loiter", "utility", None) - np.mean(paper)
    assert rule.mean == pytest.approx(expected, abs=1e-4)
    assert by_key["orchid"].beside_orchid == {}


def test_what_a_method_adds_where_users_walk_is_told_apart():
    rows = list(make_rows(["orchid", "orchid-informed", "orchid-10mhz"], rules=["best-response"]))
    document = make_reproduction(rows)
    by_key = {method.method: method for method in document.methods}
    assert by_key["orchid-10mhz"].walking == by_key["orchid-10mhz"].walking_beside_orchid == {}
    own = by_key["orchid-informed"]
    # Only `orchid` keeps its fairness where users walk, by these rows.
    lost = 0.02 * np.mean([5.0, 10.0, 15.0]) / 15.0
    staying, walking = own.beside_orchid["rate_jfi"], own.walking_beside_orchid["rate_jfi"]
    assert walking.mean == pytest.approx(staying.mean - lost, abs=1e-4)
    assert own.walking["rate_jfi"].mean == pytest.approx(
        own.deterministic["rate_jfi"].mean - lost, abs=1e-4
    )
    page = report_html(document, [])
    caption = (
        "Where users walk at 5 to 15 m/s and hold their headings for 20 s, flown without noise"
    )
    told = {row[0]: row for row in table_of(page, caption)}
    assert list(told) == ["orchid", "orchid-informed", "best-response"]
    added = numbers_in(told["orchid-informed"][5])
    assert added == pytest.approx([walking.mean, *walking.ci95], abs=0.0005001)


def test_what_was_trained_on_uniform_users_is_flown_there_too():
    rows = list(make_rows(["orchid", "orchid-uniform", "orchid-no-rf-uniform"]))
    found = make_reproduction(rows).sensitivities
    assert [(one.method, one.users) for one in found] == [
        ("orchid-uniform", "tcp"),
        ("orchid-uniform", "uniform"),
        ("orchid-no-rf-uniform", "uniform"),
    ]
    for one in found:
        gains = [
            mean_of(one.method, "utility", seed) - mean_of(f"{one.method}-zero", "utility", seed)
            for seed in SEEDS
        ]
        assert one.gained.mean == pytest.approx(np.mean(gains), abs=1e-4)
