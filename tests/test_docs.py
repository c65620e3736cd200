"""The documentation says what the code and the committed results say."""

import ast
import json
import re
from pathlib import Path

import pytest

from docs.generate import configuration_page, pages
from docs.studies import FIGURE_SOURCES, figure_digests
from orchid_uav.experiments.configuration import configuration_keys

ROOT = Path(__file__).parent.parent
PROSE = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.name)
def test_generated_pages_are_current(path):
    assert path.read_text() == pages()[path], "run: make docs-data"


def test_figures_were_drawn_from_what_is_committed():
    recorded = json.loads(FIGURE_SOURCES.read_text())
    assert recorded == figure_digests(), "run: make docs-data"
    shown = {
        target
        for path in PROSE
        for target in re.findall(r"!\[[^]]*\]\((?:docs/)?figures/([^)]+)\)", path.read_text())
    }
    assert shown <= set(recorded)


def test_every_key_is_described():
    page = configuration_page()
    for key in configuration_keys():
        row = next(line for line in page.splitlines() if f"`{key}`" in line)
        assert row.count("|") >= 6 and not row.rstrip().endswith("| None |"), key
    assert "| `training.worlds` | 1 |" in page
    assert "| `reset.enabled` | true |" in page
    assert "| `network.total_bandwidth_hz` | none |" in page


@pytest.mark.parametrize("path", PROSE, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
        if not target.startswith(("http", "#", "mailto")):
            assert (path.parent / target.partition("#")[0]).exists(), target


@pytest.mark.parametrize("path", PROSE, ids=lambda path: path.name)
def test_python_examples_parse(path):
    for block in re.findall(r"```python\n(.*?)```", path.read_text(), flags=re.DOTALL):
        ast.parse(block)


@pytest.mark.parametrize("page", ["environment.md", "methods.md"])
def test_the_first_example_of_a_page_runs(page):
    text = (ROOT / "docs" / page).read_text()
    block = re.search(r"```python\n(.*?)```", text, flags=re.DOTALL)
    exec(compile(block.group(1), page, "exec"), {})
