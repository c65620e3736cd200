"""From which data every figure was drawn, so that a test finds those that are out of date."""

import hashlib
from pathlib import Path

from orchid_uav.experiments.evaluation.methods import COMMANDS
from orchid_uav.storage.files import write_json
from studies.pages.evaluation import REFERENCE
from studies.pages.markdown import FIGURES
from studies.pages.results_figures import PREFIX, row_files
from studies.recording import RESULTS

FIGURE_SOURCES = FIGURES / "sources.json"


def record_sources() -> Path:
    """Record digests of every figure and of the data from which it was drawn."""
    write_json(FIGURE_SOURCES, figure_digests())
    return FIGURE_SOURCES


def figure_digests() -> dict[str, dict[str, str]]:
    """Digests of every committed figure and of its data, by the figure's name.

    Digests are compared, since redrawn PNG files differ between versions of libraries.
    """
    drawn = [path for kind in ("png", "svg", "webp") for path in FIGURES.glob(f"*.{kind}")]
    return {
        path.name: {"figure": _digest([path]), "sources": _digest(_sources(path))}
        for path in sorted(drawn)
    }


def _sources(figure: Path) -> list[Path]:
    if figure.name.startswith(PREFIX):
        return row_files(figure)
    if figure.name.startswith("reference"):
        return [REFERENCE / key / "episodes.csv" for key in COMMANDS]
    if figure.name.startswith("uavs_"):
        return [RESULTS / "uavs.json"]
    own = [*RESULTS.glob(f"{figure.stem}.json"), *RESULTS.glob(f"torture/{figure.stem}.json")]
    if not own:
        raise LookupError(f"{figure.name} is drawn from no result of its name")
    return own


def _digest(files: list[Path]) -> str:
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
