"""The verdicts of a reproduction for terminals."""

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table, print_text
from orchid_uav.experiments.reproduction.report.effects import (
    decisive,
    interval_text,
    mean_text,
    pairs_text,
    scale_of,
)
from orchid_uav.experiments.reproduction.result import JudgedClaim, Reproduction
from orchid_uav.experiments.reproduction.verdicts import Judgement


def print_reproduction(out: Console, document: Reproduction) -> None:
    """Print each claim with its verdict, and how far the rows go."""
    if document.is_quick:
        print_text(out, "quick: not evidence, no verdicts; means over two short trainings")
    for claims in (document.claims, document.questions):
        if claims:
            print_line(out, "")
            heads = ["", "claim", "verdict", "uniform users", "what decides", "pairs"]
            print_table(out, heads, [_row(claim) for claim in claims])
    if document.missing:
        print_text(out, f"{document.missing} rows are missing: claims that need them are undecided")


def _row(claim: JudgedClaim) -> list[str]:
    uniform = claim.uniform.verdict if claim.uniform else None
    check = decisive(claim.tcp)
    return [
        claim.key,
        claim.says,
        claim.tcp.verdict or "not evidence",
        uniform or "–",
        _decides(check) if check else "–",
        pairs_text(check) if check else "–",
    ]


def _decides(check: Judgement) -> str:
    return f"{scale_of(check).title}: {mean_text(check)} {interval_text(check)}".strip()
