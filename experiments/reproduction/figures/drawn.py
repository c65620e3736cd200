"""A figure that was drawn, and what can be said of it in words."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib import style
from matplotlib.figure import Figure

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.figures.style import STYLE
from orchid_uav.experiments.metrics import METRICS

PANELS = ("reward", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi")
"""What the paper shows of trainings."""
DISTRIBUTION_WORDS: Mapping[Distribution, str] = {
    "tcp": "users in hotspots",
    "uniform": "users spread evenly",
}


MOST_NAMED = 3
"""So many methods with the same number are named; more are counted."""


class DrawnFigure(NamedTuple):
    """A figure of the report."""

    key: str
    """Such as "fig4_tcp": the paper's figure, and which of ours it is."""
    title: str
    path: Path
    """The SVG file."""
    alternative: str
    """What it shows, in words and numbers, for those who do not see it."""
    caption: str
    """How it is read, and what is missing in it."""


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as SVG; the same figure gives the same bytes.

    Raises:
        OSError: the file cannot be written.
    """
    with style.context(["default", STYLE]):
        figure.savefig(path, metadata={"Date": None})
    return path


def value_text(metric: str, stored: float) -> str:
    """A metric's value as people read it, with its unit."""
    described = METRICS[metric]
    return f"{described.text(stored)} {described.unit}".strip()


def extremes_text(metric: str, values: Mapping[str, float]) -> str:
    """Which methods have the highest and the lowest value: "highest a 0.9, lowest b 0.7".

    Methods that show the same number are named together.
    """
    known = {label: value for label, value in values.items() if math.isfinite(value)}
    if not known:
        return "not measured"
    shown = {label: value_text(metric, value) for label, value in known.items()}
    if len(set(shown.values())) == 1:
        everybody = "all" if len(shown) > 1 else next(iter(shown))
        return f"{everybody} {next(iter(shown.values()))}"
    told = []
    for word, end in (("highest", max), ("lowest", min)):
        extreme = shown[end(known, key=known.__getitem__)]
        told.append(f"{word} {_named([key for key in shown if shown[key] == extreme])} {extreme}")
    return ", ".join(told)


def listed_text(metric: str, values: Mapping[str, float]) -> str:
    """All values, the highest first: "a and b 0.9, c 0.7"; those that look equal together."""
    known = {label: value for label, value in values.items() if math.isfinite(value)}
    highest_first = sorted(known, key=known.__getitem__, reverse=True)
    return ", ".join(told_together({key: value_text(metric, known[key]) for key in highest_first}))


def told_together(texts: Mapping[str, str]) -> list[str]:
    """Labels with their texts, such as "a and b 0.9"; those with the same text are named once."""
    named: dict[str, list[str]] = {}
    for label, text in texts.items():
        named.setdefault(text, []).append(label)
    return [f"{' and '.join(labels)} {text}" for text, labels in named.items()]


def _named(labels: Sequence[str]) -> str:
    if len(labels) > MOST_NAMED:
        return f"{len(labels)} methods"
    *others, last = labels
    return f"{', '.join(others)} and {last}" if others else last


def missing_text(present: Mapping[str, int], wanted: Iterable[str], seeds: int) -> str:
    """What a figure lacks: methods without a row, and seeds; empty where nothing is missing.

    Args:
        present: the number of seeds of each method that is drawn.
        wanted: the methods that should be drawn.
        seeds: how many seeds each trained one should have.
    """
    absent = [label for label in wanted if label not in present]
    fewer = [f"{label} {count}" for label, count in present.items() if count < seeds]
    sentences = []
    if absent:
        sentences.append(f"Missing: {', '.join(absent)}.")
    if fewer:
        sentences.append(f"Fewer than {seeds} seeds: {', '.join(fewer)}.")
    return " ".join(sentences)
