"""What can be said of the page of a replay without a browser; ``tests/browser`` drives one."""

import hashlib
import html
import json
import re
import zlib
from base64 import b64decode, b64encode
from pathlib import Path

import pytest

import orchid_uav.experiments.replay.page.page as page_module
from orchid_uav.experiments.planning.maps.colours import ON_DARK, ON_WHITE
from orchid_uav.experiments.replay.page.page import page_html
from tests.helpers.replays import made_up_replay

PAGE = Path(__file__).parents[3] / "experiments" / "replay" / "page"
BUNDLES = ("page.js", "scene.js")


def element_of(page, opening):
    """What stands between an opening tag and its closing one."""
    name = re.match(r"<(\w+)", opening)[1]
    return page.partition(opening)[2].partition(f"</{name}>")[0]


def text_of(name):
    return (PAGE / name).read_text(encoding="utf-8")


class TestBundles:
    @pytest.mark.parametrize("bundle", BUNDLES)
    def test_they_were_made_from_the_sources_that_lie_beside_them(self, bundle):
        names = [path.relative_to(PAGE).as_posix() for path in PAGE.glob("source/**/*.js")]
        digest = hashlib.sha256()
        for name in sorted([*names, "build/build.mjs", "build/package.json"]):
            digest.update(f"{name}\n{text_of(name)}\n".encode())
        first = text_of(f"bundle/{bundle}").partition("\n")[0]
        told = f"/* sources: sha256 {digest.hexdigest()} */"
        assert first == told, "make replay-page"

    def test_versions_are_pinned_and_the_licence_goes_along(self):
        pins = json.loads(text_of("build/package.json"))["dependencies"]
        assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in pins.values())
        licence = text_of("bundle/THIRD_PARTY_LICENSES.txt")
        assert licence.startswith(f"three.js {pins['three']}\n")
        assert "The MIT License" in licence
        assert "three.js authors" in licence
        assert html.escape(licence) in page_html("{}", "")

    def test_nothing_in_them_ends_the_element_that_holds_them(self):
        assert not re.search(r"<!--|</?script", text_of("bundle/page.js"), re.IGNORECASE)
        assert "</style" not in text_of("style.css")

    def test_our_own_scripts_make_no_markup_of_texts(self):
        for path in PAGE.glob("source/**/*.js"):
            forbidden = (
                r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\b|new Function"
            )
            assert not re.search(forbidden, path.read_text(encoding="utf-8")), path


class TestPage:
    def test_the_document_comes_back_as_it_was(self):
        document = made_up_replay().json
        page = page_html(document, "a flight")
        assert element_of(page, '<script type="application/json" id="document">') == document
        scene = element_of(page, '<script type="text/plain" id="scene-script">')
        assert zlib.decompress(b64decode(scene)).decode() == text_of("bundle/scene.js")

    def test_nothing_in_a_document_or_title_ends_its_element(self):
        nasty = "</script><!--<script>&amp;\u2028\u2029\ud83d🚁{{script}}</title>"
        page = page_html(json.dumps({"a": nasty}, ensure_ascii=False), nasty)
        inside = element_of(page, '<script type="application/json" id="document">')
        assert json.loads(inside) == {"a": nasty}
        assert not set(inside) & set("<>&\u2028\u2029\ud83d")
        assert "🚁" in inside
        assert "{{script}}&lt;/title&gt;</title>" in page
        assert page.count("</script>") == 3
        page.encode()

    def test_the_policy_lets_in_what_is_there_and_nothing_else(self):
        page = page_html("{}", "a flight")
        policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)[1]
        parts = dict(part.strip().split(" ", 1) for part in policy.split(";"))
        assert parts["default-src"] == parts["base-uri"] == parts["form-action"] == "'none'"
        assert set(parts) == {"default-src", "script-src", "style-src", "base-uri", "form-action"}

        def source(text):
            return f"'sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"

        inline = element_of(page.partition('id="scene-script">')[2], "<script>")
        assert parts["script-src"].split() == [source(inline), source(text_of("bundle/scene.js"))]
        assert parts["style-src"] == source(element_of(page, "<style>"))

    def test_drones_have_the_colours_of_plans(self):
        style = element_of(page_html("{}", ""), "<style>")
        for number, (light, dark) in enumerate(zip(ON_WHITE, ON_DARK, strict=True)):
            assert style.index(f"--drone-{number}: {light};") < style.index(
                f"--drone-{number}: {dark};"
            )

    def test_the_page_around_a_document_leaves_room_for_it(self):
        assert len(page_html("{}", "a flight").encode()) < 300_000

    def test_a_template_without_a_part_is_noticed(self, monkeypatch):
        monkeypatch.setattr(page_module, "_part", lambda name: "{{unknown}}")
        with pytest.raises(KeyError, match="unknown"):
            page_html("{}", "")
