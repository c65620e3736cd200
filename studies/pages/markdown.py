"""Tables and sources of results as Markdown."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.provenance import CHANGES
from orchid_uav.experiments.statistics.results import EvaluationResult, EvaluationSummary

ROOT = Path(__file__).parents[2]
FIGURES = ROOT / "docs" / "figures"
Result = EvaluationResult


def table(header: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> str:
    """A Markdown table: ``words`` columns of words, then columns of right-aligned numbers."""
    lines = [header, ["---"] * words + ["---:"] * (len(header) - words), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def cell(result: Result, metric: str, spread: bool = True) -> str:
    """Mean ± standard deviation in the usual format."""
    described, value = METRICS[metric], result.metrics[metric]
    if value.mean is None:
        return "–"
    text = described.text(value.mean)
    return f"{text} ± {described.text(value.std)}" if spread and value.std else text


def recorded(document: Mapping[str, Any]) -> str:
    """When and where something was measured, and whether its commit holds all of the code."""
    commit = document["versions"]["git_commit"] or CHANGES
    changed = ", with changes that were not committed" if commit.endswith(CHANGES) else ""
    return f"{document['date']}{changed}, {document['host']['processor']}"


def source(name: str, document: EvaluationSummary) -> str:
    """When, where and how the numbers were made."""
    command = " ".join(document.command)
    if name.endswith("_N"):
        command = command.rpartition(" ")[0] + " N"
    when = recorded(document.to_json())
    return f"{when}, `{command}` by `make studies` → `studies/results/{name}.json`."


def metrics_table(results: Sequence[Result], metrics: Sequence[str], spread: bool = True) -> str:
    """Methods by metrics, without metrics that the results of earlier versions lack."""
    metrics = [metric for metric in metrics if metric in results[0].metrics]
    return table(
        ["method", *(METRICS[metric].heading for metric in metrics)],
        [[f"`{result.label}`", *(cell(result, metric, spread) for metric in metrics)]
         for result in results],
    )  # fmt: skip
