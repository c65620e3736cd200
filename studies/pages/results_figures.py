"""The paper's figures that have all of their seeds, for docs/results.md."""

import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from orchid_uav.experiments.reproduction.figures.all_figures import (
    draw_figures,
    drawn_methods,
    figure_of,
)
from orchid_uav.experiments.reproduction.needs import FIGURES as NEEDS
from orchid_uav.storage.files import write_json
from studies.pages.markdown import FIGURES
from studies.pages.results import PAGE, ROWS, result, rows_read

PREFIX = "reproduction_"
WORDS = FIGURES / "reproduction.json"
"""Titles, captions and descriptions; written with the figures, since drawing takes long."""


def row_files(drawn: Path) -> list[Path]:
    """The committed rows that a figure of this page is drawn from."""
    methods = drawn_methods(figure_of(drawn.stem.removeprefix(PREFIX)))
    return [path for method in methods for path in sorted((ROWS / method).glob("*.json"))]


def draw_reproduction() -> list[Path]:
    """Draw the figures all of whose methods have all of their rows."""
    complete = [figure for figure in NEEDS if _is_complete(figure)]
    for former in FIGURES.glob(f"{PREFIX}*.svg"):
        former.unlink()
    paths, words = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for drawn in draw_figures(rows_read(), Path(folder), complete):
            paths.append(FIGURES / f"{PREFIX}{drawn.path.name}")
            shutil.move(drawn.path, paths[-1])
            words[paths[-1].name] = {
                "title": drawn.title,
                "caption": drawn.caption,
                "alternative": drawn.alternative,
            }
    write_json(WORDS, words)
    return paths


def figures_block() -> str:
    """The figures with their captions."""
    return "\n\n".join(_shown())


def _shown() -> Iterator[str]:
    for name, words in json.loads(WORDS.read_text("utf-8")).items():
        yield f"### {words['title']}"
        yield f"![{words['alternative']}](figures/{name})"
        yield words["caption"]
    if missing := [f"Fig. {key.removeprefix('fig')}" for key in NEEDS if not _is_complete(key)]:
        yield f"Without all of their seeds so far: {', '.join(missing)}."


def _is_complete(figure: str) -> bool:
    return not NEEDS[figure] & result().waiting.keys()


RESULTS_FIGURES_BLOCKS = {"results figures": (PAGE, figures_block)}
