"""A page that says which figure answers which question, for a browser and for print."""

import html
import shlex
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.configuration import SETTING_KEYS
from orchid_uav.experiments.metrics import HEADLINE, HEADROOM, METRICS
from orchid_uav.experiments.statistics.results import (
    EvaluationSettings,
    EvaluationSummary,
    ResultHeader,
)
from orchid_uav.storage.files import write_atomically

SHEET_FILE = "index.html"

_QUESTIONS = {
    "coverage": "Are the target users served?",
    "total_coverage": "Are all users served, those of the ground station included?",
    "energy_efficiency_bit_per_joule": "How much data is sent for the energy spent?",
    "rate_jfi": "Do the users get similar rates?",
    "load_jfi": "Do the UAVs serve similar numbers of users?",
    "worst_rate_bps": "What does the user who is served worst get?",
    "utility": "Which method is best in the paper's own objective?",
    HEADROOM: "How much of what circling leaves does a method gain?",
    "sum_rate_bps": "How much data is sent in all?",
    "propulsion_power_w": "What does flying cost?",
    "thrust_energy_efficiency_bit_per_joule": "How much, if turns cost energy, too?",
    "reward": "What is the return that learning maximises?",
    "collisions": "Do UAVs come too close to each other?",
    "boundary_violations": "Do UAVs try to leave the area?",
    "backhaul_violations": "Do UAVs lose their link to the ground station?",
    "nearest_uav_m": "How far apart are the UAVs?",
    "gbs_rate_bps": "What do the users of the ground station get?",
    "gbs_coverage": "Are the users of the ground station served?",
    "blocking_pairs": "Would users and UAVs rather change partners?",
}
_TERMS = {
    "rate_jfi": "JFI is Jain's fairness index: 1 where all are equal.",
    "load_jfi": "JFI is Jain's fairness index: 1 where all are equal.",
    "utility": "A weighted sum of coverage, energy efficiency and both fairness indices.",
    HEADROOM: "0 is circling the start (loiter-mmf), 100 the planner.",
}
_READING = {
    "higher": "Higher is better.",
    "lower": "Lower is better.",
    None: "Neither more nor less is better as such.",
}


class _Entry(NamedTuple):
    """A figure on the page."""

    question: str
    reading: str
    pictures: Sequence[Path]
    """The files of the figure; the first is shown, all are linked."""


def write_evaluation_sheet(
    folder: Path, document: EvaluationSummary, figures: Sequence[Path]
) -> None:
    """Write the page of an evaluation.

    Args:
        folder: the folder of the figures, where the page is written.
        document: the evaluation's ``summary.json``.
        figures: the files that ``draw_figures`` returned, named by their metrics.

    Raises:
        OSError: the page cannot be written.
    """
    settings = document.settings
    facts = {
        "Setting": "; ".join(_listed(settings)),
        "World": _world(settings.world),
        "Topologies": f"{settings.episodes:,} for each setting, seed {settings.seed}, the same for "
        "all methods",
        "Methods": ", ".join(dict.fromkeys(entry.method for entry in settings.methods)),
    }
    pictures: dict[str, list[Path]] = {}
    for path in figures:
        pictures.setdefault(path.stem, []).append(path)
    entries = {metric: _entry(metric, own) for metric, own in pictures.items()}
    groups = {
        "First of all": [entry for metric, entry in entries.items() if metric in HEADLINE],
        "Further": [entry for metric, entry in entries.items() if metric not in HEADLINE],
    }
    _write(folder, "Evaluation", document, facts, groups)


def write_ablation_sheet(
    folder: Path, document: ResultHeader, facts: Mapping[str, str], curves: Path
) -> None:
    """Write the page of an ablation.

    Args:
        folder: the folder of the figure, where the page is written.
        document: ``ablation.json``.
        facts: facts for the top of the page, by heading, of which "Setting" is the first.
        curves: the figure of the learning curves.

    Raises:
        OSError: the page cannot be written.
    """
    entry = _Entry(
        "How do the variants learn, and does one stay behind?",
        "By training episode. How sure the differences are is in ablation.json.",
        [curves],
    )
    _write(folder, "Ablation", document, facts, {"Learning curves": [entry]})


def _listed(settings: EvaluationSettings) -> list[str]:
    """The values that are combined into the settings of an evaluation, as text."""
    names = {"tcp": "clustered"}
    kinds = " and ".join(names.get(one, one) for one in settings.distributions)
    parts = [f"UAVs: {_numbers(settings.uavs)}", f"users: {_numbers(settings.users)}, {kinds}"]
    if settings.speeds_mps == [0]:
        return [*parts, "at rest"]
    return [
        *parts,
        f"moving at up to {_numbers(settings.speeds_mps)} m/s",
        f"headings held for {_numbers(settings.heading_hold_s)} s",
    ]


def _numbers(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _world(world: Mapping[str, Mapping[str, Any]]) -> str:
    """The values in which the world differs from the paper's, as text."""
    usual = Parameters().model_dump(mode="json")
    differing = [
        f"{section}.{field} = {value}"
        for section, fields in world.items()
        for field, value in fields.items()
        if f"{section}.{field}" not in SETTING_KEYS and usual[section][field] != value
    ]
    return ", but ".join(["the paper's parameters", *filter(None, [", ".join(differing)])])


def _entry(metric: str, pictures: Sequence[Path]) -> _Entry:
    described = METRICS[metric]
    question = _QUESTIONS.get(metric, f"How do the methods differ in {described.title}?")
    heading = described.heading[:1].upper() + described.heading[1:]
    words = [f"{heading}.", _TERMS.get(metric, ""), _READING[described.better]]
    return _Entry(question, " ".join(filter(None, words)), pictures)


_STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --quiet: #595959; --page: #fff; --line: #d0d0d0;
  --link: #0b57a4; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --quiet: #b0b0b0; --page: #16181b;
  --line: #43474d; --link: #8ec5ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 90rem; padding: 1rem clamp(0.75rem, 3vw, 2.5rem) 3rem;
  background: var(--page); color: var(--ink); font: 1rem/1.5 system-ui, sans-serif; }
h1 { font-size: 1.6rem; margin: 0.5rem 0; } h2 { font-size: 1.25rem; margin: 2rem 0 0.75rem; }
h3 { font-size: 1.05rem; margin: 0; } a { color: var(--link); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0.25rem 1rem; margin: 1rem 0; }
dt { color: var(--quiet); } dd { margin: 0; min-width: 0; overflow-wrap: anywhere; }
code { font-size: 0.9em; overflow-wrap: anywhere; white-space: pre-wrap; }
ul { columns: 22rem; margin: 0; padding-left: 1.2rem; } li { break-inside: avoid; }
.figures { display: grid; gap: 1.25rem; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 30rem), 1fr)); }
article { border: 1px solid var(--line); border-radius: 6px; padding: 0.75rem; min-width: 0; }
article.wide { grid-column: 1 / -1; }
article p { margin: 0.25rem 0 0.5rem; color: var(--quiet); font-size: 0.9rem; }
img { display: block; width: auto; max-width: 100%; max-height: 46rem; height: auto; margin: 0 auto;
  background: #fff; border-radius: 3px; }
.notice { border-left: 4px solid #d55e00; padding-left: 0.75rem; }
@media (max-width: 30rem) {
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: 0.5rem; } }
code span { white-space: nowrap; }
@media print { :root { color-scheme: light; --ink: #000; --quiet: #444; --page: #fff; --line: #bbb;
  --link: #000; } body { max-width: none; padding: 0; font-size: 9.5pt; }
  .figures { gap: 5mm; grid-template-columns: 1fr 1fr; } article { break-inside: avoid; }
  img { max-height: 200mm; } .links { display: none; } h2 { break-after: avoid; } }
"""


def _write(
    folder: Path,
    title: str,
    document: ResultHeader,
    facts: Mapping[str, str],
    groups: Mapping[str, Sequence[_Entry]],
) -> None:
    """Write the page; characters that cannot be encoded are written as escapes."""
    program = f"orchid {document.versions['orchid_uav']}"
    rows = {name: html.escape(text) for name, text in facts.items()} | {
        "Made on": html.escape(f"{document.date} by {program}"),
        "Command": f"<code>{' '.join(map(_whole, document.command))}</code>",
    }
    is_partial = document.status != "completed"
    notice = f"<p class=notice>{html.escape(document.status.capitalize())}: not everything "
    notice += "that was planned is in these figures.</p>"
    groups = {name: entries for name, entries in groups.items() if entries}
    contents = "".join(
        f'<li><a href="#{_anchor(entry)}">{html.escape(entry.question)}</a></li>'
        for entries in groups.values()
        for entry in entries
    )
    heading = html.escape(f"{title}: {facts['Setting']}")
    parts = [
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{heading}</title><style>{_STYLE}</style></head><body>",
        f"<header><h1>{html.escape(title)}: which figure answers which question</h1>",
        notice if is_partial else "",
        "<dl>",
        *(f"<dt>{html.escape(name)}</dt><dd>{content}</dd>" for name, content in rows.items()),
        f"</dl></header><nav><h2>Questions</h2><ul>{contents}</ul></nav><main>",
        *(_section(name, entries) for name, entries in groups.items()),
        "</main></body></html>",
    ]
    text = "\n".join(part for part in parts if part)
    write_atomically(folder / SHEET_FILE, (text + "\n").encode("utf-8", "backslashreplace"))


def _whole(argument: str) -> str:
    """Mark up a word of a command so that no line break divides it."""
    return f"<span>{html.escape(shlex.quote(argument))}</span>"


def _section(name: str, entries: Sequence[_Entry]) -> str:
    articles = "\n".join(map(_article, entries))
    return (
        f'<section><h2>{html.escape(name)}</h2><div class="figures">\n{articles}\n</div></section>'
    )


def _article(entry: _Entry) -> str:
    links = " · ".join(
        f'<a href="{quote(path.name)}">{html.escape(path.suffix[1:].upper())}</a>'
        for path in entry.pictures
    )
    first = quote(entry.pictures[0].name)
    question, reading = html.escape(entry.question), html.escape(entry.reading)
    width, height = _size(entry.pictures[0])
    kind = ' class="wide"' if width > 1.5 * height else ""
    return (
        f'<article id="{_anchor(entry)}"{kind}><h3>{question}</h3><p>{reading} '
        f'<span class="links">{links}</span></p>'
        f'<a href="{first}"><img src="{first}" width="{width}" height="{height}" '
        f'alt="{question} {reading}"></a></article>'
    )


def _anchor(entry: _Entry) -> str:
    return quote(entry.pictures[0].stem)


def _size(picture: Path) -> tuple[int, int]:
    """Read width and height of a PNG, in pixels, from the beginning of the file."""
    with picture.open("rb") as file:
        width, height = struct.unpack(">II", file.read(24)[16:])
    return width, height
