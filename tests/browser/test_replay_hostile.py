"""Names that somebody chose to do harm, or that are merely unusual, in a real Chromium."""

import json

import pytest

from tests.browser.conftest import WITH_WEBGL, WITHOUT_WEBGL
from tests.helpers.replays import made_up_replay

pytestmark = pytest.mark.browser

NAMES = {
    "ends the script": "</script><script>window.harmed = 1</script>",
    "opens a comment": "<!--<script>window.harmed = 1",
    "is an image": '"><img src=x onerror="window.harmed = 1">',
    "is an address": "javascript:window.harmed=1",
    "is a template": "{{script}} ${harmed} $& $1",
    "emoji": "👩‍👩‍👧 🚁 ñandú مروحية",
    "long": "x" * 10_000,
    "turns the direction": "\u202egnp.exe \u2028 \x00 \x1b[31m",
    "half a character": "\ud83d",
    "nothing": "",
}


def named(name):
    """The document with a name in each place that holds one."""
    document = json.loads(made_up_replay().json)
    for key in ("title", "subtitle"):
        document[key] = name
    document["users"]["names"] = [name] * document["users"]["count"]
    for one in (*document["masts"],):
        one["name"] = name
    for metric in document["metrics"]:
        metric["label"] = metric["unit"] = name
    for flight in document["flights"]:
        flight["label"] = flight["note"] = flight["key"] = name
        flight["drones"]["names"] = [name] * flight["drones"]["count"]
    return document


@pytest.mark.parametrize("kind", NAMES)
def test_it_stays_a_name(open_page, kind):
    name = NAMES[kind]
    arguments = WITH_WEBGL if kind in ("ends the script", "long") else WITHOUT_WEBGL
    document = json.dumps(named(name), ensure_ascii=False)
    page = open_page(
        document, title=name, arguments=arguments, viewport={"width": 360, "height": 740}
    )
    assert page.evaluate("window.harmed") is None
    assert page.locator("img, iframe, object, a[href]:not(.skip)").count() == 0
    assert page.locator("body script").count() == 3  # the document, the scene, the page
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    heads = page.locator("#drone-tables tbody th").all_text_contents()
    if len(name) <= 60 and name.isprintable():
        assert heads == [name] * 8
        assert page.locator("h1").text_content() == name
    assert all(len(head) <= 61 for head in heads)
    assert not any(set(head) & set("\u202e\u2028\x00\x1b\ud83d") for head in heads)
    page.locator("#view-2d").check()
    page.locator("#forward").click()
    assert page.locator("#slot").inner_text() == "21 / 40"
