"""The page of a replay in a real Chromium: it opens, shows, plays, and its numbers are right."""

import io
import itertools
import json

import numpy as np
import pytest
from PIL import Image

from orchid_uav.experiments.replay.packing import pack_states
from tests.browser.conftest import WITH_WEBGL
from tests.helpers.replays import METRICS, made_up_replay

pytestmark = pytest.mark.browser

MADE = made_up_replay()
SLOTS = MADE.document.slots


def picture_of(page, number=0):
    """What a flight's canvas shows, without the names above it, as an array of colours."""
    page.evaluate(
        "document.querySelectorAll('.labels, .camera, .hint').forEach(e => e.style.opacity = '0')"
    )
    canvas = page.locator(".stage canvas:visible").nth(number)
    return np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB"))


def colours_in(picture):
    return len(np.unique(picture.reshape(-1, 3), axis=0))


def seek(page, slot):
    page.locator("#time").fill(str(slot))


def slot_of(page):
    return int(page.locator("#time").input_value())


def shown_metrics(page, flight):
    """By key: the text of the slot's value, and the number behind it."""
    read = """(sections, flight) => Object.fromEntries(sections.map((section) => {
        const data = section.querySelector(`.readout.flight-${flight} data`);
        return [section.dataset.metric, [data.textContent, data.value]];
    }))"""
    return page.locator(".metric").evaluate_all(read, flight)


def table_of(page, number):
    read = "(rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent))"
    return page.locator("#drone-tables table").nth(number).locator("tbody tr").evaluate_all(read)


class TestOpening:
    def test_it_opens_from_disk_and_draws_in_three_dimensions(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        assert page.url.startswith("file://")
        assert page.locator("html").get_attribute("data-ready") == "3d"
        assert page.title() == "method 0 beside method 1 – ORCHID replay"
        assert page.locator("h1").inner_text() == "method 0 beside method 1"
        assert page.locator(".flight h2").all_inner_texts() == ["method 0", "method 1"]
        for number in range(2):
            picture = picture_of(page, number)
            assert colours_in(picture) > 200
            for colour in ((3, 84, 142), (206, 133, 0)):  # people of the first two drones
                assert (np.abs(picture.astype(int) - colour).max(axis=2) <= 3).sum() > 50

    def test_one_flight_alone_is_a_page_as_well(self, open_page):
        page = open_page(made_up_replay(flights=1).json, arguments=WITH_WEBGL)
        assert page.locator(".stage").count() == 1
        assert colours_in(picture_of(page)) > 200

    def test_a_flight_without_people_moving_masts_or_numbers(self, open_page):
        document = json.loads(MADE.json)
        document["masts"] = []
        servers = MADE.association[0][:1].clip(-1)
        still_m = np.full((1, 30, 2), 700.0)
        document["users"]["positions"] = pack_states(still_m, 0.5).model_dump(exclude_none=True)
        for flight in document["flights"]:
            flight["metrics"] = {}
            flight["association"] = pack_states(servers, 1.0).model_dump(exclude_none=True)
            flight["rates"] = pack_states(1e6 * (servers >= 0), 1.0).model_dump(exclude_none=True)
        page = open_page(json.dumps(document))
        assert {text for text, _ in shown_metrics(page, 0).values()} == {"–"}
        seek(page, SLOTS)
        people = [int(row[6]) for row in table_of(page, 0)]
        assert people == [(servers == index).sum() for index in range(4)]

    def test_nothing_can_be_loaded_even_if_somebody_tried(self, open_page):
        page = open_page(MADE.json)
        refused = page.evaluate("""() => new Promise((resolve) => {
            const seen = [];
            document.addEventListener("securitypolicyviolation", (event) => {
                seen.push(event.effectiveDirective);
                if (seen.length === 3) resolve(seen.sort());
            });
            fetch("https://example.org/").catch(() => {});
            new Image().src = "https://example.org/picture.png";
            const script = document.createElement("script");
            script.textContent = "window.ran = true";
            document.head.append(script);
        })""")
        assert refused == ["connect-src", "img-src", "script-src-elem"]
        assert page.evaluate("window.ran") is None
        open_page.complaints.clear()  # Chromium tells of each

    @pytest.mark.parametrize(
        ("change", "before", "told"),
        [
            ({"schema": 2}, "", "reads schema 1, and the flight has schema 2"),
            ({}, "delete globalThis.DecompressionStream", "This browser is too old"),
            ({"users": None}, "", "This flight cannot be shown."),
        ],
    )
    def test_what_cannot_be_shown_is_said(self, open_page, change, before, told):
        document = json.dumps(json.loads(MADE.json) | change)
        page = open_page(document, wait=False, before=before)
        page.get_by_role("alert").wait_for()
        assert told in page.get_by_role("alert").inner_text()
        assert not page.locator("main").is_visible()

    def test_without_scripts_it_says_why_there_is_nothing(self, open_page):
        page = open_page(MADE.json, wait=False, java_script_enabled=False)
        assert "JavaScript, which is switched off" in page.locator("noscript").inner_text()


class TestNumbers:
    @pytest.mark.parametrize("slot", [1, 7, SLOTS])
    def test_they_are_those_of_the_document(self, open_page, slot):
        page = open_page(MADE.json)
        seek(page, slot)
        for flight, metrics in enumerate(MADE.metrics):
            shown = shown_metrics(page, flight)
            for metric in METRICS:
                value = metrics[metric.key][slot - 1]
                assert shown[metric.key][0] == f"{value:.{metric.digits}f}"
                assert np.float32(shown[metric.key][1]) == value  # to the last bit

    def test_a_slot_without_a_value_shows_none(self, open_page):
        page = open_page(MADE.json, "#slot=3")
        assert shown_metrics(page, 0)["worst_rate_bps"] == ["–", ""]
        seek(page, 0)
        assert {text for text, _ in shown_metrics(page, 0).values()} == {"–"}

    @pytest.mark.parametrize("slot", [0, 9, SLOTS])
    def test_the_tables_tell_the_same_state(self, open_page, slot):
        page = open_page(MADE.json, f"#slot={slot}")
        for flight in range(2):
            rows = table_of(page, flight)
            assert [row[0] for row in rows] == [f"uav_{index}" for index in range(4)]
            shown_m = np.array([[float(cell) for cell in row[1:4]] for row in rows])
            # Half a step of the document, and half a digit of the table.
            assert np.abs(shown_m - MADE.positions_m[flight][slot]).max() <= 0.1 + 1e-9
            servers = MADE.association[flight][slot]
            assert [int(row[6]) for row in rows] == [(servers == i).sum() for i in range(4)]
            assert (rows[3][5] == "out of service") == (slot >= SLOTS // 2)
            told = page.locator(".service").nth(flight).inner_text()
            assert told.startswith(
                f"{(servers >= 0).sum()}\u00a0people served by drones, "
                f"{(servers == -2).sum()} by masts, {(servers == -1).sum()} not served."
            )


class TestPlaying:
    def test_it_plays_by_itself_and_the_picture_moves(self, open_page):
        slots = 400  # so many that a slow machine sees it play as well
        page = open_page(made_up_replay(slots=slots).json, "", arguments=WITH_WEBGL)
        page.get_by_role("button", name="Pause").wait_for()
        before = picture_of(page)
        page.locator("#speed").select_option("60")
        page.wait_for_selector("body:not(.is-playing)")  # the end
        assert slot_of(page) == slots
        after = picture_of(page)
        assert (np.abs(before.astype(int) - after).max(axis=2) > 30).mean() > 0.002

    def test_an_address_with_a_slot_opens_there_and_rests(self, open_page):
        page = open_page(MADE.json, "#slot=12")
        assert slot_of(page) == 12
        assert page.get_by_role("button", name="Play").is_visible()

    def test_seeking_changes_pictures_cursors_and_numbers_of_both(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        before = [picture_of(page, number) for number in range(2)]
        seek(page, 30)
        for number in range(2):
            assert (picture_of(page, number) != before[number]).any()
        cursors = page.locator(".cursor").evaluate_all("all => all.map(e => e.getAttribute('x1'))")
        assert cursors == ["30"] * len(METRICS)
        assert page.locator("#slot").inner_text() == f"30 / {SLOTS}"

    def test_dragging_in_a_curve_seeks(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        plot = page.locator(".plot svg").first
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
        page.mouse.down()
        assert slot_of(page) == 10
        page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + 20)
        assert slot_of(page) == 30
        page.mouse.up()
        page.mouse.move(box["x"], box["y"] + 20)
        assert slot_of(page) == 30

    def test_buttons_step_and_speed_is_chosen(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        for name, slot in [
            ("One slot forward", 6),
            ("To the end", SLOTS),
            ("One slot back", SLOTS - 1),
            ("To the start", 0),
        ]:
            page.get_by_role("button", name=name).click()
            assert slot_of(page) == slot
        page.locator("#speed").select_option("60")
        page.get_by_role("button", name="Play").click()
        page.wait_for_selector("body:not(.is-playing)")
        assert slot_of(page) == SLOTS


class TestPictures:
    def test_dragging_turns_both_cameras_alike(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        places = "all => all.map(e => e.style.transform)"
        names = [page.locator(".labels").nth(number).locator(".north") for number in range(2)]
        before = [name.evaluate_all(places) for name in names]
        assert before[0] == before[1]
        box = page.locator("canvas.scene").first.bounding_box()
        page.mouse.move(box["x"] + 60, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 160, box["y"] + 70)
        page.mouse.up()
        after = [name.evaluate_all(places) for name in names]
        assert after[0] == after[1] != before[0]

    @pytest.mark.parametrize("view", ["view-2d", "view-3d"])
    def test_what_is_shown_can_be_chosen(self, open_page, view):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        page.locator(f"#{view}").check()
        seen = [picture_of(page)]
        page.locator("#links").uncheck()
        seen.append(picture_of(page))
        page.locator("#trails").uncheck()
        seen.append(picture_of(page))
        page.locator("#by-rate").select_option("rate")
        seen.append(picture_of(page))
        page.locator("#highlight").select_option("1")
        seen.append(picture_of(page))
        page.locator("#theme").select_option("dark")
        seen.append(picture_of(page))
        for one, other in itertools.pairwise(seen):
            assert (one != other).any()
        assert seen[0].mean() > 200
        assert seen[-1].mean() < 60

    @pytest.mark.parametrize("view", ["view-2d", "view-3d"])
    def test_pointing_at_a_drone_tells_of_it(self, open_page, view):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        page.locator(f"#{view}").check()
        told = page.locator(".stage").first.evaluate("""(stage) => {
            const [box, hint] = [stage.getBoundingClientRect(), stage.querySelector(".hint")];
            const told = new Set();
            for (let x = 10; x < box.width; x += 7) {
                for (let y = 10; y < box.height; y += 7) {
                    const place = { clientX: box.left + x, clientY: box.top + y };
                    stage.dispatchEvent(new PointerEvent("pointermove", place));
                    if (!hint.hidden) told.add(hint.textContent);
                }
            }
            return [...told];
        }""")
        assert any(text.startswith("uav_1: ") and " m high, transmits " in text for text in told)
        assert any(text.startswith("Person ") and "served by mast_0, " in text for text in told)

    def test_without_webgl_the_view_from_above_tells_everything(self, open_page):
        page = open_page(MADE.json)
        assert page.locator("html").get_attribute("data-ready") == "2d"
        assert "WebGL is missing or switched off" in page.locator("#notice").inner_text()
        assert page.locator("#view-3d").is_disabled()
        assert colours_in(picture_of(page)) > 100
        assert page.locator("canvas.map").count() == page.locator("canvas.map:visible").count() == 2
        before = picture_of(page)
        page.keyboard.press("ArrowRight")
        assert (picture_of(page) != before).any()
        assert len(table_of(page, 0)) == 4

    def test_a_context_that_is_lost_leaves_the_view_from_above(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        page.locator("canvas.scene").first.evaluate(
            "e => e.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()"
        )
        page.locator("#notice").wait_for()
        assert "stopped the 3-D view" in page.locator("#notice").inner_text()
        assert page.locator("canvas.map:visible").count() == 2
        assert colours_in(picture_of(page)) > 100
        seek(page, 33)
        assert page.locator("#slot").inner_text() == f"33 / {SLOTS}"

    def test_slow_pictures_are_noticed(self, open_page):
        slow = "window.requestAnimationFrame = (f) => setTimeout(() => f(performance.now()), 350)"
        page = open_page(MADE.json, arguments=WITH_WEBGL, before=slow)
        page.locator("#speed").select_option("1")
        page.locator("#play").click()
        page.locator("#notice").wait_for(timeout=60_000)
        assert "slow in this browser" in page.locator("#notice").inner_text()
