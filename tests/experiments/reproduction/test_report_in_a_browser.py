"""The page in a real browser: no width at which it spills over, and figures that are drawn."""

import functools
import http.server
import json
import re
import subprocess
import threading
from html import unescape

import pytest

from orchid_uav.experiments.reproduction.report.page import report_html
from tests.helpers.pages import BROWSER, HOSTILE
from tests.helpers.reports import make_document, make_figures

pytestmark = pytest.mark.skipif(BROWSER is None, reason="there is no Chromium on this machine")

WIDTHS = (360, 800, 1280)
PROBE = """<!DOCTYPE html><title>probe</title><script>
const widths = %s, found = [];
function next() {
  const width = widths.shift();
  if (!width) { document.body.textContent = JSON.stringify(found); return; }
  const frame = document.createElement("iframe");
  frame.style = `border: 0; height: 800px; width: ${width}px`;
  frame.onload = async () => {
    const page = frame.contentDocument, root = page.documentElement;
    await Promise.all([...page.images].map(image => image.decode()));
    const target = page.getElementById("c3");
    frame.contentWindow.location.hash = "c3";
    await new Promise(done => setTimeout(done, 50));
    found.push({
      width, needed: root.scrollWidth, images: [...page.images].map(one => one.naturalWidth),
      opened: target.closest("details").open, scripts: page.scripts.length,
      colour: getComputedStyle(page.body).backgroundColor,
    });
    frame.remove(); next();
  };
  frame.src = "report.html";
  document.body.append(frame);
}
addEventListener("load", next);
</script><body></body>"""


def browse(folder, *options):
    """What the probe found, in a browser that takes the page from a server of this machine."""
    handler = functools.partial(QuietHandler, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/probe.html"
        done = subprocess.run(
            [
                *(BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom"),
                *("--no-first-run", f"--user-data-dir={folder / 'profile'}"),
                *("--virtual-time-budget=20000", *options, address),
            ],
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=True,
        )
        server.shutdown()
    [found] = re.findall("<body>(.*)</body>", done.stdout, re.DOTALL)
    return json.loads(unescape(found))


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    """Serves files and says nothing of it."""

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    document = make_document(processors=[HOSTILE + "x" * 500], command=["orchid", HOSTILE])
    page = report_html(document, make_figures(folder))
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "probe.html").write_text(PROBE % json.dumps(WIDTHS), encoding="utf-8")
    return folder


def test_it_fits_every_width_and_draws_its_figures(folder):
    found = browse(folder)
    assert [one["width"] for one in found] == list(WIDTHS)
    for one in found:
        assert one["needed"] <= one["width"]
        assert one["images"] == [700] * 7
        assert one["opened"], "a link to a claim opens it"
        assert one["scripts"] == 0
        assert one["colour"] == "rgb(255, 255, 255)"


def test_it_is_dark_where_that_is_preferred(folder):
    found = browse(folder, "--blink-settings=preferredColorScheme=0")
    assert {one["colour"] for one in found} == {"rgb(21, 24, 28)"}
