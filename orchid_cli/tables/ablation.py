"""The results of an ablation for terminals, effects first."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from statistics import fmean

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table, print_text
from orchid_uav.experiments.ablation.design import FLOWN, key_of
from orchid_uav.experiments.ablation.result import AblationResult, TriggerReplay
from orchid_uav.experiments.ablation.variants import BASE
from orchid_uav.experiments.evaluation.method_keys import ZERO
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.runs.directory import FINAL_EPISODES
from orchid_uav.experiments.statistics.comparison import Comparison, SeedSummary

KINDS = {
    "evaluation": "held-out topologies, deterministic policies",
    "sampled": "held-out topologies, sampled actions",
    "training": f"last training episodes, at most {FINAL_EPISODES}",
}
"""Families of comparisons, and what each compares."""
_COLUMNS = (
    "variant",
    "metric",
    "difference [95 %]",
    "relative",
    "P(better)",
    "p (Holm)",
    "verdict",
    "base",
    "variant's",
    "seeds",
)
_EFFECT = slice(1, 7)
"""Columns of a variant's own table on a terminal; the rest is shown above it or elsewhere."""
_ROOM = 105
"""Terminal width that such a table needs without breaking its cells."""


def print_ablation(out: Console, document: AblationResult) -> None:
    """Print the effects, then the values compared, then when the trigger would have fired."""
    for kind, title in KINDS.items():
        print_line(out, "")
        print_text(out, f"{title}: variant - base, paired by seed")
        _print_comparisons(out, comparison_rows(document, kind))
    print_line(out, "")
    print_text(out, "held-out topologies: interquartile means over seeds, and means of the rest")
    heads = ["policy", *(METRICS[metric].heading for metric in FLOWN)]
    print_table(out, heads, list(reached_rows(document)))
    for name, table in document.replayed_trigger.items():
        print_line(out, "")
        print_text(
            out,
            f"Reset-and-Finetune's trigger on {name}: runs in which it fires, and at "
            "which episode (median)",
        )
        print_table(out, *trigger_table(table))


def _print_comparisons(out: Console, rows: Sequence[Sequence[str]]) -> None:
    """Print one table for programs, or for people one table per variant with what fits."""
    if not out.is_terminal:
        print_table(out, _COLUMNS, rows)
        return
    for name in dict.fromkeys(row[0] for row in rows):
        own = [row for row in rows if row[0] == name]
        pairs = " or ".join(dict.fromkeys(row[-1] for row in own))
        print_line(out, f"\n{name}, pairs of seeds: {pairs}")
        columns, *cells = (list(row[_EFFECT]) for row in (_COLUMNS, *own))
        if out.width < _ROOM:  # units and intervals on a second line
            for row in cells:
                row[:2] = [row[0].replace(" (", "\n("), row[1].replace(" [", "\n[")]
        print_table(out, columns, cells)


def reached_rows(document: AblationResult) -> Iterator[list[str]]:
    """The values compared: policies, twins that do nothing or only make noise, and rules.

    Twins that do the same as those of the base are left out.
    """
    values, seeds = document.values, document.settings.seeds
    means = {
        (other.method, other.deterministic): [other.metrics[metric].mean for metric in FLOWN]
        for other in document.others
    }
    of_base: list[list[str]] = []
    for name in values["evaluation"]:
        for kind, suffix in (("evaluation", ""), ("sampled", ", sampled")):
            reached = values[kind][name]
            yield [name + suffix, *_texts(reached[metric].iqm for metric in FLOWN)]
        for is_silent, what in ((True, "no actions"), (False, "noise alone")):
            keys = [(key_of(name, seed) + ZERO, is_silent) for seed in seeds]
            twins = [means[key] for key in keys if key in means]
            cells = _texts([_mean(values) for values in zip(*twins, strict=True)])
            if cells and cells not in of_base:
                yield [f"{name}, {what}", *cells]
            if name == BASE:
                of_base.append(cells)
    for (method, _), own in means.items():
        if not method.endswith(ZERO):
            yield [method, *_texts(own)]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return fmean(known) if len(known) == len(values) else None


def _texts(values: Iterable[float | None]) -> list[str]:
    return [_text(metric, value) for metric, value in zip(FLOWN, values, strict=False)]


def _text(metric: str, value: float | None) -> str:
    return "-" if value is None else METRICS[metric].text(value)


def comparison_rows(document: AblationResult, kind: str) -> list[list[str]]:
    """One row for every variant and metric of a family."""
    values = document.values[kind]
    return [
        [name, METRICS[metric].heading, *_cells(metric, found, values[BASE], values[name])]
        for name, metrics in document.comparisons[kind].items()
        for metric, found in metrics.items()
    ]


def _cells(
    metric: str,
    found: Comparison,
    base: Mapping[str, SeedSummary],
    own: Mapping[str, SeedSummary],
) -> list[str]:
    difference = found.difference
    failures = {"base": found.failed_base, "variant": found.failed_variant}
    failed = ", ".join(f"{count} of the {who} failed" for who, count in failures.items() if count)
    return [
        f"{signed(metric, difference.mean)}{_interval(metric, difference.ci95)}",
        "-" if found.relative is None else f"{found.relative:+.1%}",
        _plain(found.probability_of_improvement, 2),
        _plain(found.p_holm, 4),
        str(found.verdict),
        _text(metric, base[metric].iqm),
        _text(metric, own[metric].iqm),
        f"{found.n}" + (f" ({failed})" if failed else ""),
    ]


def signed(metric: str, value: float | None) -> str:
    """A difference as text, with one digit more than the metric itself."""
    if value is None:
        return "-"
    described = METRICS[metric]
    text = f"{value * described.scale:+.{described.digits + 1}f}"
    return text if float(text) else text[1:]  # zero has no sign


def _interval(metric: str, ends: Sequence[float] | None) -> str:
    return "" if ends is None else f" [{signed(metric, ends[0])}, {signed(metric, ends[1])}]"


def _plain(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def trigger_table(table: Sequence[TriggerReplay]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of a table with windows as rows and tolerances as columns."""
    tolerances = list(dict.fromkeys(row.tolerance for row in table))
    rows = []
    for window in dict.fromkeys(row.window for row in table):
        cells = {row.tolerance: row for row in table if row.window == window}
        rows.append([f"W = {window}", *(_firings(cells[tolerance]) for tolerance in tolerances)])
    return ["window", *(f"tolerance {tolerance:g}" for tolerance in tolerances)], rows


def _firings(cell: TriggerReplay) -> str:
    text = f"{cell.fired} of {cell.runs}"
    return text + (f", at {cell.median_episode:.0f}" if cell.fired else "")
