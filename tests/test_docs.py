"""The documentation says what the code and the committed results say."""

import ast
import json
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from studies.deployment import RESULT, fly
from studies.pages.figure_sources import FIGURE_SOURCES, figure_digests
from tests.helpers.processes import TINY

ROOT = Path(__file__).parent.parent
PROSE = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
MODEL = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
FORMULA = re.compile(r"^\$\$\n(.*?)\n\$\$$|(?<!\$)\$([^$\n]+)\$(?!\$)", re.MULTILINE | re.DOTALL)
ROOMS = (
    "agents",
    "benchmarks",
    "callbacks",
    "docs",
    "envs",
    "examples",
    "runs",
    "studies",
    "tests",
)


def test_figures_were_drawn_from_what_is_committed():
    recorded = json.loads(FIGURE_SOURCES.read_text())
    assert recorded == figure_digests(), "run: make docs-data"
    shown = {
        target
        for path in PROSE
        for target in re.findall(r"!\[[^]]*\]\((?:docs/)?figures/([^)]+)\)", path.read_text())
    }
    assert shown <= set(recorded)


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


def test_every_generator_of_random_numbers_is_in_the_table():
    text = (ROOT / "docs" / "environment.md").read_text(encoding="utf-8")
    table = text.partition("### Random numbers")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([^`]+)`", table))
    makers = ("default_rng(", "SeedSequence(", "counter_uniform(key: ")
    for room in ("src", "envs", "agents", "callbacks", "experiments", "orchid_cli"):
        for path in sorted((ROOT / room).rglob("*.py")):
            source, own = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
            if any(maker in source for maker in makers) and own != "envs/seeds.py":
                assert own in named or f"{Path(own).parent}/" in named, own
    streams = re.findall(r"\b([A-Z_]+_(?:STREAM|SEED))\b", (ROOT / "envs" / "seeds.py").read_text())
    assert set(streams) - {"EVALUATION_STREAM"} <= named  # that one is used in its own file


class TestModel:
    def test_formulas_are_the_same_on_the_site_and_on_github(self):
        """Markdown of GitHub changes some characters before it looks for formulas."""
        formulas = [block or inline for block, inline in FORMULA.findall(MODEL)]
        assert len(formulas) > 60
        for formula in formulas:
            assert not re.search(r"\\[^a-zA-Z]", formula), formula  # an escape loses its backslash
            assert not re.search(r"(?<![A-Za-z0-9])_", formula), formula  # might begin an emphasis
            assert not re.search(r"[*<>&~`]", formula), formula

    def test_functions_under_the_formulas_exist(self):
        formulas, _, decisions = MODEL.partition("## Decisions")
        code = "\n".join(
            path.read_text(encoding="utf-8")
            for room in ("agents", "callbacks", "envs")
            for path in (ROOT / room).rglob("*.py")
        )
        names = re.findall(r"`(?:MAPPO\.)?(\w+)`", formulas)
        assert len(names) > 40
        for name in names:
            assert re.search(rf"^ *(def|class) {name}\b", code, re.MULTILINE), name
        for decision in re.findall(r"\bM\d+\b", formulas):
            assert f"| {decision} |" in decisions, decision

    def test_decisions_that_the_code_names_are_described(self):
        for room in ("agents", "callbacks", "envs", "experiments"):
            for path in (ROOT / room).rglob("*.py"):
                if path.parent.name == "maps":  # where M0 begins a line of a drawing
                    continue
                for decision in re.findall(r"\bM\d+\b", path.read_text(encoding="utf-8")):
                    assert f"| {decision} |" in MODEL, f"{path}: {decision}"


class TestSite:
    def build(self, root, site):
        """As ``make docs`` does."""
        command = re.search(r"/mkdocs (build.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)[1]
        return subprocess.run(
            [sys.executable, "-m", "mkdocs", *command.split(), "--site-dir", site],
            cwd=root,
            capture_output=True,
            text=True,
            check=False,
        )

    def test_it_is_whole_and_needs_nothing_from_elsewhere(self, tmp_path):
        finished = self.build(ROOT, tmp_path)
        assert finished.returncode == 0, finished.stderr
        model = (tmp_path / "model.html").read_text(encoding="utf-8")
        assert model.count("<math") == len(FORMULA.findall(MODEL))
        assert 'href="source/envs/channel.py.html"' in model
        source = (tmp_path / "source" / "envs" / "channel.py.html").read_text(encoding="utf-8")
        assert "air_to_ground_path_loss_db" in source
        home = (tmp_path / "index.html").read_text(encoding="utf-8")
        assert 'src="figures/deployment.png"' in home and 'href="contributing.html"' in home
        version = re.search(r"^## .*", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[0][3:]
        assert version in (tmp_path / "changelog.html").read_text(encoding="utf-8")
        for shown in tmp_path.glob("*.html"):
            fetched = re.findall(
                r'<(?:link|script|img)\b[^>]*?(?:href|src)="(http[^"]*)', shown.read_text()
            )
            assert not fetched, shown.name

    def test_dead_links_and_unknown_commands_fail(self, tmp_path):
        """Nothing of this kind is seen by readers of the site first."""
        copy = tmp_path / "copy"
        copy.mkdir()
        for room in ROOMS:
            ignored = shutil.ignore_patterns("__pycache__", "2*-s*", "data")
            shutil.copytree(ROOT / room, copy / room, ignore=ignored)
        for path in ROOT.iterdir():
            if path.is_file() and path.name != ".git":
                shutil.copy(path, copy)
        planted = ("nowhere.md", "model.md#nowhere", "../envs/nowhere.py", "/nowhere")
        with (copy / "docs" / "install.md").open("a", encoding="utf-8") as page:
            page.write("".join(f"\n[here]({target})\n" for target in planted))
            page.write("\n$$\n\\nocommand{x}\n$$\n\n$\\mathbf x$\n")
        with (copy / "CONTRIBUTING.md").open("a", encoding="utf-8") as page:
            page.write("\n[here](docs/nowhere-too.md)\n")
        finished = self.build(copy, tmp_path / "site")
        assert finished.returncode != 0
        told = [line for line in finished.stderr.splitlines() if line.startswith("WARNING")]
        for sign in (*planted, "\\nocommand{x}", "\\mathbf x", "docs/nowhere-too.md"):
            assert sum(f"'{sign}'" in line for line in told) == 1, (sign, finished.stderr)
        assert len(told) == len(planted) + 3


class TestExamples:
    def test_the_configuration_trains(self, orchid, new_runs, runs_dir):
        finished = orchid(
            *("train", "--config", ROOT / "examples" / "lab.toml", "--quiet"),
            *("--episodes", 1, "--set", "network.episode_slots=10"),
            *("--set", f"ppo.hidden_sizes={TINY['ppo.hidden_sizes']}", "--runs-dir", runs_dir),
        )
        assert finished.code == 0, finished.err
        (run,) = new_runs()
        config = json.loads((run / "config.json").read_text())
        assert config["network"]["uav_count"] == 4
        assert config["reward"]["objective"] == "pf"

    def test_pandas_reads_an_evaluation(self, orchid, tmp_path, monkeypatch, capsys):
        out = tmp_path / "evaluation"
        methods = "orchid,orchid-zero,static-mmf"
        finished = orchid(
            *("eval", "--methods", methods, "--uavs", 2, "--users", 20, "--episodes", 3),
            *("--set", "network.episode_slots=10", "--no-figures", "--quiet", "--out", out),
        )
        assert finished.code == 0, finished.err
        monkeypatch.setattr(sys, "argv", ["read_evaluation.py", str(out)])
        runpy.run_path(str(ROOT / "examples" / "read_evaluation.py"))
        told = capsys.readouterr().out
        summary = json.loads((out / "summary.json").read_text())
        own, twin = (result["utility"]["mean"] for result in summary["results"][:2])
        assert f"orchid - orchid-zero: {own - twin:+.4f} in utility" in told
        assert "of 3 topologies" in told


def test_the_pictured_flight_is_the_simulators():
    committed, flown = json.loads(RESULT.read_text()), fly()
    assert flown["seed"] == committed["seed"] and flown["slot"] == committed["slot"]
    for name in ("is_target", "uav"):
        own = [[user[name] for user in flight["users"]] for flight in (flown, committed)]
        assert own[0] == own[1]
    for name in ("position_m", "rate_bps"):
        own = [[user[name] for user in flight["users"]] for flight in (flown, committed)]
        np.testing.assert_allclose(*own, rtol=1e-4)
    own = [[uav["position_m"] for uav in flight["uavs"]] for flight in (flown, committed)]
    np.testing.assert_allclose(*own, atol=0.1)


def test_the_paper_is_cited_everywhere():
    for path in ("README.md", "CITATION.cff", "docs/model.md"):
        assert "arXiv:2602.09994" in (ROOT / path).read_text(encoding="utf-8"), path
