"""The verdicts of a reproduction for terminals."""

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table, print_text
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.result import JudgedClaim, Reproduction
from orchid_uav.experiments.reproduction.verdicts import Judgement


def print_reproduction(out: Console, document: Reproduction) -> None:
    """Print each claim with its verdict, and how far the rows go."""
    if document.is_quick:
        print_text(out, "quick: not evidence, no verdicts; means over two short trainings")
    for claims in (document.claims, document.questions):
        if claims:
            print_line(out, "")
            heads = ["", "claim", "verdict", "uniform users", "first comparison", "seeds"]
            print_table(out, heads, [_row(claim) for claim in claims])
    if document.missing:
        print_text(out, f"{document.missing} rows are missing: claims that need them are undecided")


def _row(claim: JudgedClaim) -> list[str]:
    uniform = claim.uniform.verdict if claim.uniform else None
    first = claim.tcp.checks[0] if claim.tcp.checks else None
    return [
        claim.key,
        claim.says,
        claim.tcp.verdict or "not evidence",
        uniform or "–",
        effect_text(first) if first else "–",
        f"{min(check.n for check in claim.tcp.checks)}" if first else "–",
    ]


def effect_text(check: Judgement) -> str:
    """The difference with its interval, as it is shown."""
    if check.difference is None:
        return "not measured"
    metric = METRICS.get(check.metric)
    scale, digits = (metric.scale, metric.digits + 1) if metric else (1.0, 2)
    text = f"{check.difference * scale:+.{digits}f}"
    if check.ci95:
        low, high = (end * scale for end in check.ci95)
        text += f" [{low:+.{digits}f}, {high:+.{digits}f}]"
    return text
