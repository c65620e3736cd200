"""A real Chromium without a network; everything that a page must never do is noticed."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from orchid_uav.experiments.replay.page.page import page_html

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
WITH_WEBGL = [
    *("--no-sandbox", "--disable-gpu-sandbox", "--disable-background-networking"),
    # WebGL without a graphics card; the rest of the page is faster without that.
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"),
]
WITHOUT_WEBGL = [*WITH_WEBGL, "--disable-3d-apis"]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if "browser" not in (config.option.markexpr or ""):
        reason = "make test-browser runs it, where there is a Chromium"
        for item in items:
            if item.get_closest_marker("browser"):
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def launch() -> Iterator[Callable[[list[str]], Any]]:
    """Starts a Chromium, one for each list of arguments."""
    api = pytest.importorskip("playwright.sync_api", reason="make test-browser installs playwright")
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.fail("there is no Chromium (Debian: apt install chromium)")
    started: dict[tuple[str, ...], Any] = {}
    with api.sync_playwright() as playwright:

        def start(arguments: list[str]) -> Any:
            key = tuple(arguments)
            if key not in started:
                started[key] = playwright.chromium.launch(executable_path=found, args=arguments)
            return started[key]

        yield start
        for browser in started.values():
            browser.close()


@pytest.fixture
def open_page(launch, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Opens the page of a document from disk; whatever a page complains of fails the test.

    ``address`` is what follows the file's name, ``wait`` whether the page has to get ready, and
    other keywords are those of Playwright's contexts. Without a graphics card three dimensions
    take long, so that only those tests have them that need them (``WITH_WEBGL``).
    """
    complaints: list[str] = []
    contexts = []

    def heed(message: Any) -> None:
        # Chromium's own word on how slow a picture is without a graphics card.
        if (
            message.type in ("error", "warning")
            and "GPU stall due to ReadPixels" not in message.text
        ):
            complaints.append(message.text)

    def watch(page: Any, expected: str) -> None:
        page.on("console", heed)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("dialog", lambda dialog: complaints.append(f"dialog: {dialog.message}"))
        page.on("request", lambda one: one.url != expected and complaints.append(one.url))

    def open_it(
        document: str,
        address: str = "#slot=20",
        arguments: list[str] = WITHOUT_WEBGL,
        wait: bool = True,
        before: str = "",
        title: str = "a flight",
        **options: Any,
    ) -> Any:
        path = tmp_path / f"flight {len(contexts)}.html"
        path.write_text(page_html(document, title), encoding="utf-8")
        options = {"viewport": {"width": 1280, "height": 900}} | options
        context = launch(arguments).new_context(offline=True, **options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(120_000)
        watch(page, path.as_uri())
        if before:
            page.add_init_script(before)
        page.goto(path.as_uri() + address)
        if wait:
            page.wait_for_selector("html[data-ready]")
        return page

    open_it.complaints = complaints
    yield open_it
    for context in contexts:
        context.close()
    assert not complaints
