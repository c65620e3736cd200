"""What an ablation says, for terminals: the effects first."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table
from orchid_uav.cli.evaluation_tables import print_tables
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.run_directory import FINAL_EPISODES
from orchid_uav.experiments.variants import BASE

KINDS = {
    "evaluation": "held-out topologies, deterministic policies",
    "sampled": "held-out topologies, sampled actions",
    "training": f"last {FINAL_EPISODES} training episodes",
}
"""Families of comparisons, and what they are of."""
_COLUMNS = (
    "variant",
    "figure",
    "difference [95 %]",
    "relative",
    "P(better)",
    "p (Holm)",
    "verdict",
    "base",
    "variant's",
    "seeds",
)


def print_ablation(out: Console, document: Mapping[str, Any]) -> None:
    """The comparisons, then twins and rules beside the policies, then when the trigger fired."""
    for kind, title in KINDS.items():
        print_line(out, f"\n{title}: variant - base, paired by seed")
        print_table(out, list(_COLUMNS), comparison_rows(document, kind))
    print_line(out, "\nzero-action twins, noise alone, and rules on the same topologies")
    print_tables(
        out,
        [result for result in document["others"] if result["deterministic"]],
        list(document["values"]["evaluation"][BASE]),
    )
    for name, table in document["replayed_trigger"].items():
        print_line(out, f"\nwhen Reset-and-Finetune's trigger would have fired on {name}")
        print_table(out, *trigger_table(table))


def comparison_rows(document: Mapping[str, Any], kind: str) -> list[list[str]]:
    """A row for every variant and figure of a family."""
    values = document["values"][kind]
    return [
        [name, METRICS[figure].heading, *_cells(figure, found, values[BASE], values[name])]
        for name, figures in document["comparisons"][kind].items()
        for figure, found in figures.items()
    ]


def _cells(
    figure: str, found: Mapping[str, Any], base: Mapping[str, Any], own: Mapping[str, Any]
) -> list[str]:
    difference = found["difference"]
    failed = found["failed_base"] + found["failed_variant"]
    return [
        f"{signed(figure, difference['mean'])}{_interval(figure, difference['ci95'])}",
        "-" if found["relative"] is None else f"{found['relative']:+.1%}",
        _plain(found["probability_of_improvement"], 2),
        _plain(found["p_holm"], 4),
        found["verdict"],
        _iqm(figure, base[figure]),
        _iqm(figure, own[figure]),
        f"{found['n']}" + (f" ({failed} runs failed)" if failed else ""),
    ]


def signed(figure: str, value: float | None) -> str:
    """A difference as it is shown, with one digit more than the figure itself."""
    metric = METRICS[figure]
    return "-" if value is None else f"{value * metric.scale:+.{metric.digits + 1}f}"


def _interval(figure: str, ends: Sequence[float] | None) -> str:
    return "" if ends is None else f" [{signed(figure, ends[0])}, {signed(figure, ends[1])}]"


def _iqm(figure: str, described: Mapping[str, Any]) -> str:
    return "-" if described["iqm"] is None else METRICS[figure].text(described["iqm"])


def _plain(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def trigger_table(table: Sequence[Mapping[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows: windows by tolerances."""
    tolerances = list(dict.fromkeys(row["tolerance"] for row in table))
    rows = []
    for window in dict.fromkeys(row["window"] for row in table):
        cells = {row["tolerance"]: row for row in table if row["window"] == window}
        rows.append([f"W = {window}", *(_firings(cells[tolerance]) for tolerance in tolerances)])
    return ["window", *(f"tolerance {tolerance:g}" for tolerance in tolerances)], rows


def _firings(cell: Mapping[str, Any]) -> str:
    text = f"{cell['fired']} of {cell['runs']}"
    return text + (f", from episode {cell['median_episode']:.0f}" if cell["fired"] else "")
