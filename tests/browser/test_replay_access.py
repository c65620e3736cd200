"""The page of a replay without a mouse, without seeing it, and without movement."""

import pytest

from tests.browser.conftest import WITH_WEBGL
from tests.helpers.replays import made_up_replay

pytestmark = pytest.mark.browser

MADE = made_up_replay()
SLOTS = MADE.document.slots

TEXTS = """() => {
  const channels = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const linear = (value) => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  const luminance = ([r, g, b]) =>
    0.2126 * linear(r / 255) + 0.7152 * linear(g / 255) + 0.0722 * linear(b / 255);
  const behind = (element) => {
    for (let one = element; one; one = one.parentElement) {
      const colour = channels(getComputedStyle(one).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  const found = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const element = walk.currentNode.parentElement;
    const text = walk.currentNode.textContent.trim();
    if (!text || !element.checkVisibility() || element.closest(".hidden, .dimmed")) continue;
    const colours = [channels(getComputedStyle(element).color), behind(element)];
    const [one, other] = colours.map(luminance);
    const ratio = (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
    found.push([text.slice(0, 30), ratio]);
  }
  return found;
}"""
"""Every text that can be seen, and its contrast (WCAG 2.2)."""

COLOURS = """() => {
  const style = getComputedStyle(document.documentElement);
  const probe = document.body.appendChild(document.createElement("i"));
  const luminance = (name) => {
    probe.style.color = style.getPropertyValue(`--${name}`);
    const [r, g, b] = getComputedStyle(probe).color.match(/[\\d.]+/g).map((text) => {
      const value = Number(text) / 255;
      return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ratio = (one, other) => {
    const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05);
  };
  const found = {};
  const lines = ["flight-0", "flight-1", "control", "accent"];
  for (const name of lines) found[name] = ratio(name, "page");
  const marks = ["mast", "unserved", ...[0, 1, 2, 3, 4, 5].map((number) => `drone-${number}`)];
  for (const name of marks) found[name] = ratio(name, "ground");
  found.chosen = ratio("on-accent", "accent");
  probe.remove();
  return found;
}"""
"""The contrast of lines, borders and marks to what is behind them."""


def slot_of(page):
    return int(page.locator("#time").input_value())


def focused(page):
    return page.evaluate("""() => {
        const element = document.activeElement;
        return element.id || element.getAttribute("aria-label") || element.tagName.toLowerCase();
    }""")


class TestWithoutAMouse:
    def test_the_focus_goes_through_everything_in_the_order_of_the_page(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        order = []
        for _ in range(60):
            page.keyboard.press("Tab")
            if focused(page) == "body" or focused(page) in order[:1]:
                break
            order.append(focused(page))
        cameras = [
            *("Turn left", "Turn right", "Look more from above", "Look more from the side"),
            *("Closer", "Farther away", "Camera as at first"),
        ]
        pictures = [
            name
            for number in range(2)
            for name in (
                f"method {number} in three dimensions. Shift and arrow keys turn and tilt, "
                "brackets zoom. The tables below tell the same.",
                *cameras,
            )
        ]
        tables = ["Drones of method 0", "Drones of method 1", "Metrics"]
        assert order == [
            *("a", "theme", "help-button", "view-3d", "by-rate", "highlight", "heights"),
            *("links", "trails", *pictures),
            *("to-start", "back", "play", "forward", "to-end", "time", "speed", *tables, "summary"),
        ]

    def test_what_has_the_focus_is_seen(self, open_page):
        page = open_page(MADE.json)
        for _ in range(12):
            page.keyboard.press("Tab")
            outline = page.evaluate("""() => {
                const style = (one) => getComputedStyle(one);
                const element = document.activeElement;
                const shown = element.type === "radio" ? element.nextElementSibling : element;
                return [style(shown).outlineStyle, parseFloat(style(shown).outlineWidth)];
            }""")
            assert outline == ["solid", 3]

    def test_keys_do_everything(self, open_page):
        page = open_page(MADE.json, "#slot=5", arguments=WITH_WEBGL)
        for key, slot in [
            ("ArrowRight", 6),
            ("ArrowLeft", 5),
            ("End", SLOTS),
            ("ArrowRight", SLOTS),
            ("Home", 0),
            ("ArrowLeft", 0),
        ]:
            page.keyboard.press(key)
            assert slot_of(page) == slot
        page.keyboard.press("2")
        assert page.locator("canvas.map:visible").count() == 2
        page.keyboard.press("3")
        assert page.locator("canvas.scene:visible").count() == 2
        speed = page.locator("#speed").input_value()
        page.keyboard.press("+")
        assert float(page.locator("#speed").input_value()) > float(speed)
        page.keyboard.press("-")
        assert page.locator("#speed").input_value() == speed
        page.keyboard.press("Space")
        assert page.locator("body.is-playing").count() == 1
        page.keyboard.press("Space")
        assert page.locator("body.is-playing").count() == 0
        page.keyboard.press("?")
        assert page.get_by_role("dialog", name="Keys and explanations").is_visible()
        page.keyboard.press("Escape")
        assert not page.locator("#help").is_visible()

    def test_keys_turn_tilt_and_zoom_the_camera_and_put_it_back(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        place = "() => document.querySelector('.label.north').style.transform"
        first = page.evaluate(place)
        seen = {first}
        for key in ("Shift+ArrowLeft", "Shift+ArrowUp", "]"):
            page.keyboard.press(key)
            seen.add(page.evaluate(place))
        assert len(seen) == 4
        assert slot_of(page) == 20
        page.keyboard.press("0")
        assert page.evaluate(place) == first

    def test_arrows_on_the_slider_go_one_slot_and_no_more(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        page.locator("#time").focus()
        page.keyboard.press("ArrowRight")
        assert slot_of(page) == 6

    def test_the_button_that_has_the_focus_is_what_space_presses(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        page.locator("#forward").focus()
        page.keyboard.press("Space")
        assert slot_of(page) == 6
        assert page.locator("body.is-playing").count() == 0

    def test_keys_of_one_sign_can_be_switched_off(self, open_page):
        page = open_page(MADE.json, arguments=WITH_WEBGL)
        page.locator("#single-keys").evaluate("e => e.click()")
        page.keyboard.press("2")
        assert page.locator("canvas.map:visible").count() == 0


class TestForThoseWhoHearThePage:
    def test_a_slot_is_told_once_it_rests_and_not_while_it_plays(self, open_page):
        page = open_page(MADE.json, "#slot=5")
        spoken = page.locator("#spoken")
        assert spoken.get_attribute("aria-live") == "polite"
        page.locator("#spoken", has_text="Slot 5 of 40").wait_for(state="attached")
        coverage = [metrics["coverage"][8] for metrics in MADE.metrics]
        for _ in range(4):
            page.keyboard.press("ArrowRight")
        page.locator("#spoken", has_text="Slot 9 of 40, 0:09. method 0: ").wait_for(
            state="attached"
        )
        for value in coverage:
            assert f"Coverage {value:.3f}" in spoken.text_content()
        page.locator("#speed").select_option("2")
        page.locator("#play").click()
        page.wait_for_timeout(1500)
        assert slot_of(page) > 9
        assert "Slot 9 of 40" in spoken.text_content()

    def test_the_slider_and_the_pictures_have_words(self, open_page):
        page = open_page(MADE.json, "#slot=5", arguments=WITH_WEBGL)
        assert page.get_by_role("slider", name="Slot").get_attribute("aria-valuetext") == (
            "Slot 5 of 40, 0:05"
        )
        for name in ("method 0 in three dimensions", "method 1 in three dimensions"):
            assert page.get_by_role("application", name=name).count() == 1
        table = page.get_by_role("table", name="method 1")
        assert table.get_by_role("rowheader").all_inner_texts() == [f"uav_{i}" for i in range(4)]
        nameless = page.locator("button, select, input, canvas, a, table").evaluate_all("""(all) =>
            all.filter((one) => one.checkVisibility()).filter((one) => !(one.textContent.trim()
                || one.getAttribute("aria-label") || one.labels?.[0]?.textContent.trim()))
                .map((one) => one.outerHTML)""")
        assert nameless == []


class TestMovement:
    def test_who_wants_none_gets_a_page_at_rest_and_whole_slots(self, open_page):
        page = open_page(MADE.json, "", reduced_motion="reduce")
        assert slot_of(page) == 0
        page.wait_for_timeout(500)
        assert slot_of(page) == 0
        assert page.locator("body.is-playing").count() == 0
        assert self.times_while_playing(page) > {"0"}
        assert all("." not in time for time in self.times_while_playing(page))

    def test_others_see_everything_glide(self, open_page):
        page = open_page(MADE.json, "#slot=0")
        assert any("." in time for time in self.times_while_playing(page))

    @staticmethod
    def times_while_playing(page):
        """Where the cursor is in the first pictures."""
        page.locator("#speed").select_option("5")
        return set(
            page.evaluate("""() => new Promise((resolve) => {
            const seen = [];
            document.getElementById("to-start").click();
            document.getElementById("play").click();
            const look = () => {
                seen.push(document.querySelector(".cursor").getAttribute("x1"));
                if (seen.length < 30) requestAnimationFrame(look);
                else resolve(seen);
            };
            look();
        })""")
        )


class TestSeeing:
    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_every_text_stands_out(self, open_page, scheme):
        page = open_page(MADE.json, arguments=WITH_WEBGL, color_scheme=scheme)
        assert page.locator("html").get_attribute("data-theme") == scheme
        page.locator("summary").click()
        page.keyboard.press("?")
        texts = page.evaluate(TEXTS)
        assert len(texts) > 100
        assert [(text, ratio) for text, ratio in texts if ratio < 4.5] == []
        assert {name: one for name, one in page.evaluate(COLOURS).items() if one < 3.0} == {}

    @pytest.mark.parametrize("width", [320, 360, 800, 1280])
    def test_nothing_has_to_be_scrolled_sideways(self, open_page, width):
        page = open_page(MADE.json, viewport={"width": width, "height": 740})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        for name in ("#play", "#time", "#speed", "#help-button", ".stage >> nth=0"):
            box = page.locator(name).bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width

    def test_the_time_controls_stay_in_sight(self, open_page):
        page = open_page(MADE.json)
        assert page.locator("#play").bounding_box()["y"] < 900
        page.evaluate("scrollTo(0, 300)")
        assert page.locator("#play").bounding_box()["y"] < 900
