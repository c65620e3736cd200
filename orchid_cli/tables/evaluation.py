"""Tables of an evaluation: mean ± standard deviation, with the best marked by a star."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table
from orchid_uav.experiments.metrics import METRICS, UNBREAKABLE
from orchid_uav.experiments.runs.records import short_ids
from orchid_uav.experiments.statistics.results import EvaluationResult

Result = EvaluationResult

_MANY = 5
"""Methods with the same numbers from which on a terminal does not name them."""

_DIMENSIONS = {
    "distribution": "{}",
    "uavs": "{} UAVs",
    "users": "{} users",
    "speed_mps": "{:g} m/s",
    "heading_hold_s": "held {:g} s",
}


def print_tables(out: Console, results: Sequence[Result], metrics: Sequence[str]) -> None:
    """Print methods by metrics for a single setting, else methods by settings for each metric."""
    if out.is_terminal:  # elsewhere a program may search for the ids
        results = _with_short_names(results)
    settings = list(dict.fromkeys(_setting(result) for result in results))
    methods = list(dict.fromkeys(result.label for result in results))
    cells = {(_setting(result), result.label): result for result in results}
    names = _setting_names(settings)
    metrics = [
        metric
        for metric in metrics
        if any(result.metrics[metric].mean is not None for result in results)
    ]
    if len(settings) == 1:
        columns = {
            METRICS[metric].heading: _column(
                [cells.get((settings[0], method)) for method in methods], metric
            )
            for metric in metrics
        }
        _print(out, "method", methods, columns)
        return
    for metric in metrics:
        columns = {
            names[setting]: _column([cells.get((setting, method)) for method in methods], metric)
            for setting in settings
        }
        print_line(out, "")
        _print(out, METRICS[metric].heading, methods, columns)


def _with_short_names(results: Sequence[Result]) -> list[Result]:
    """Name each run by the shortest part of its id that tells it from the others."""
    named = [run for result in results if (run := result.run or "") and run in result.method]
    short = short_ids(list(dict.fromkeys(named)))

    def renamed(result: Result) -> Result:
        run = result.run or ""
        if run not in short:  # released policies are called by their keys
            return result
        return result.model_copy(update={"method": result.method.replace(run, short[run], 1)})

    return [renamed(result) for result in results]


def _print(
    out: Console, corner: str, methods: Sequence[str], columns: Mapping[str, Sequence[str]]
) -> None:
    rows: list[Sequence[str]] = list(zip(methods, *columns.values(), strict=True))
    if out.is_terminal:
        rows = _with_others_as_one(rows)
    print_table(out, [corner, *columns], rows)


def _with_others_as_one(rows: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """Where most methods have the same numbers, such as full coverage, one row for all of them."""
    cells, count = Counter(tuple(row[1:]) for row in rows).most_common(1)[0]
    if count < _MANY or 2 * count <= len(rows):
        return list(rows)
    others = "all methods" if count == len(rows) else f"the {count} others"
    return [*(row for row in rows if tuple(row[1:]) != cells), [others, *cells]]


def _column(results: Sequence[Result | None], metric: str) -> list[str]:
    """Texts of one metric in one setting; the best value at the digits shown is marked."""
    described = METRICS[metric]
    means = [None if result is None else result.metrics[metric].mean for result in results]
    shown = [None if mean is None else float(described.text(mean)) for mean in means]
    known = [
        value
        for result, value in zip(results, shown, strict=True)
        if result is not None and value is not None and result.comparable
    ]
    best = None
    if described.better is not None and len(set(known)) > 1:
        best = max(known) if described.better == "higher" else min(known)
    texts = []
    for result, mean, value in zip(results, means, shown, strict=True):
        if result is None or mean is None:
            texts.append("-")
            continue
        std = result.metrics[metric].std
        spread = "" if std is None else f" ± {described.text(std)}"
        star = " *" if value == best and result.comparable else ""
        texts.append(f"{described.text(mean)}{spread}{star}")
    return texts


def _setting(result: Result) -> tuple[Any, ...]:
    return tuple(getattr(result, name) for name in _DIMENSIONS)


def _setting_names(settings: Sequence[tuple[Any, ...]]) -> dict[tuple[Any, ...], str]:
    """Name settings by what tells them apart, or by the number of UAVs if nothing does."""
    varying = [
        index
        for index in range(len(_DIMENSIONS))
        if len({setting[index] for setting in settings}) > 1
    ] or [1]
    forms = list(_DIMENSIONS.values())
    return {
        setting: ", ".join(
            forms[index].format(setting[index]).replace(" ", UNBREAKABLE) for index in varying
        )
        for setting in settings
    }
