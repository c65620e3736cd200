"""The page as a browser gets it: whole, offline, and deaf to what names try to say."""

import dataclasses
import functools
import itertools
import re

import numpy as np
import pytest

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.maps.report import report_html
from orchid_uav.experiments.planning.site import Place
from tests.helpers.pages import HOSTILE, Page
from tests.helpers.plans import make_plan

PLANS = {
    "usual": {},
    "one person": {"drones": 1, "rows": 1, "masts": 0, "zone": False, "ways": False, "want": None},
    "no mast": {"masts": 0},
    "several masts": {"masts": 3},
    "metres": {"center": None},
    "hovering": {"hover": True},
    "antimeridian": {"center": Place(-16.8, 179.999)},
    "nothing wanted": {"want": None},
    "nothing more": {"launches": [], "notes": [], "fleet_sizes": []},
    "large": {"drones": 100, "rows": 20_000, "across_m": 9000.0, "greatest_weight": 1},
}


@functools.cache
def page_of(name):
    return report_html(make_plan(**PLANS[name]))


@pytest.fixture(params=PLANS)
def page(request):
    return page_of(request.param)


class TestEveryPage:
    def test_it_is_nested_well(self, page):
        assert page.startswith('<!DOCTYPE html>\n<html lang="en">')
        Page(page)

    def test_it_asks_for_nothing_from_anywhere(self, page):
        parsed = Page(page)
        tags = {tag for tag, _ in parsed.elements}
        assert not tags & {"script", "link", "img", "iframe", "object", "embed", "base", "image"}
        for tag, attributes in parsed.elements:
            assert not set(attributes) & {"src", "href", "xlink:href", "srcset", "action"}, tag
            assert not any(key.startswith("on") for key in attributes), tag
        assert "http://" not in page
        assert "https://" not in page
        assert "@import" not in page
        assert set(re.findall(r"url\(([^)]*)\)", page)) <= {
            "#hatch", "#cross-0", "#cross-1", "#cross-2"
        }  # fmt: skip

    def test_its_policy_forbids_all_but_styles(self, page):
        policies = [
            one["content"]
            for one in Page(page).all("meta")
            if one.get("http-equiv") == "Content-Security-Policy"
        ]
        assert policies == ["default-src 'none'; style-src 'unsafe-inline'"]

    def test_every_identity_is_there_once_and_every_reference_leads_to_one(self, page):
        parsed = Page(page)
        identities = [one["id"] for _, one in parsed.elements if "id" in one]
        assert len(identities) == len(set(identities))
        named = [
            name
            for _, one in parsed.elements
            for name in (one.get("aria-labelledby", "") + " " + one.get("for", "")).split()
        ]
        named += re.findall(r"url\(#([^)]*)\)", page.partition("</style>")[2])
        assert set(named) <= set(identities)

    def test_drawings_have_a_title_and_a_description(self, page):
        for drawing in Page(page).all("svg"):
            if drawing.get("aria-hidden") != "true":
                assert drawing["role"] == "img"
                assert len(drawing["aria-labelledby"].split()) == 2

    def test_headings_do_not_leave_out_a_level(self, page):
        levels = [int(tag[1]) for tag, _ in Page(page).elements if re.fullmatch("h[1-6]", tag)]
        assert levels[0] == 1
        assert levels.count(1) == 1
        for level, following in itertools.pairwise(levels):
            assert following <= level + 1

    def test_the_heads_of_tables_say_what_they_head(self, page):
        parsed = Page(page)
        assert parsed.all("th")
        assert {head["scope"] for head in parsed.all("th")} == {"col", "row"}
        assert len(parsed.all("caption")) == len(parsed.all("table"))

    def test_all_rows_of_a_table_are_equally_long(self, page):
        for body in re.findall("<table>.*?</table>", page):
            rows = re.findall("<tr.*?</tr>", body)
            assert len({len(re.findall("<t[hd][ >]", row)) for row in rows}) == 1

    def test_no_number_is_missing(self, page):
        text = Page(page).text
        assert not re.search(r"\bnan\b|\binf\b|\bNone\b(?! of)|Traceback|\bnp\.", text)
        assert "NaN" not in page

    def test_it_has_the_seven_parts_in_order(self, page):
        headings = re.findall("<h2>(.*?)</h2>", page)
        assert [heading.partition(".")[0] for heading in headings] == list("1234567")


class TestSizes:
    def test_a_hundred_drones_and_twenty_thousand_people_stay_below_a_megabyte(self):
        assert len(page_of("large").encode()) < 1_000_000

    def test_a_usual_page_is_small(self):
        assert len(page_of("usual").encode()) < 100_000


def test_the_same_plan_gives_the_same_page():
    assert report_html(make_plan(seed=5)) == report_html(make_plan(seed=5))


def test_a_plan_that_serves_nobody_has_a_page():
    plan = make_plan()
    nobody = np.full(len(plan.server), NOBODY)
    nothing = np.zeros(len(nobody))
    Page(report_html(dataclasses.replace(plan, server=nobody, rates_bps=nothing)))


def test_it_can_be_written_as_utf_8():
    report_html(hostile_plan(HOSTILE)).encode("utf-8")


def hostile_plan(name):
    """A plan in which every text that can come from outside is ``name``."""
    plan = make_plan(
        command=["orchid", "plan", name],
        settings={"plan": {"seed": 3, name: name}},
        notes=[name],
        date=name,
    )
    lost = plan.document.robustness.one_drone_lost
    each = [one.model_copy(update={"drone": name, "taken_over": {name: 1}}) for one in lost.each]
    robustness = plan.document.robustness.model_copy(
        update={"one_drone_lost": lost.model_copy(update={"each": each})}
    )
    drones = [one.model_copy(update={"id": name}) for one in plan.document.drones]
    launches = [launch | {"drone": name} for launch in plan.document.launches]
    document = plan.document.model_copy(
        update={"robustness": robustness, "drones": drones, "launches": launches}
    )
    stations = tuple(station._replace(name=name) for station in plan.stations)
    return dataclasses.replace(plan, document=document, stations=stations)


class TestHostileNames:
    def test_they_become_no_element(self):
        usual, hostile = Page(report_html(make_plan())), Page(report_html(hostile_plan(HOSTILE)))
        assert {tag for tag, _ in hostile.elements} == {tag for tag, _ in usual.elements}
        assert not any("onclick" in attributes for _, attributes in hostile.elements)
        assert "</script><script>alert(1)</script>" in hostile.text

    def test_none_turns_the_text_round_or_hides(self):
        page = report_html(hostile_plan(HOSTILE))
        assert not set(page) & set("\u202e\x00\ud800")
        assert "\U0001f681" in page

    def test_a_long_one_is_shortened(self):
        page = report_html(hostile_plan("x" * 10_000))
        assert "x" * 2_001 not in page
        assert len(page) < 300_000

    def test_an_empty_one_does_no_harm(self):
        Page(report_html(hostile_plan("")))
