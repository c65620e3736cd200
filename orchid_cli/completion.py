"""What a shell completes: run ids, methods, metrics and keys.

The shell waits for the answer at every press of the tab key, so nothing slow is imported. Errors
are never printed, since they would appear in the middle of the command line.
"""

import os
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path

import typer

_Completer = Callable[[typer.Context, str], list[str]]


def _silent(complete: _Completer) -> _Completer:
    @wraps(complete)
    def quietly(ctx: typer.Context, incomplete: str) -> list[str]:
        try:
            return complete(ctx, incomplete)
        except Exception:  # bad files or variables are reported when they are used
            return []

    return quietly


def _listed(known: Iterable[str], incomplete: str, sign: str = "") -> list[str]:
    """Complete the last of several names separated by commas; each name is offered only once."""
    before, comma, last = incomplete.rpartition(",")
    given = {one.removeprefix(sign) for one in before.split(",")}
    order = sign if sign and last.startswith(sign) else ""
    return [before + comma + order + name for name in known if name not in given]


@_silent
def runs(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete run ids, or their parts after the time; the shell completes paths itself."""
    from orchid_uav.experiments.runs.records import RECORD_FILE, without_time

    given = ctx.params.get("runs_dir") or os.environ.get("ORCHID_RUNS_DIR") or "runs"
    directory = Path(given).expanduser()
    with os.scandir(directory) as entries:
        names = [entry.name for entry in entries if entry.name[0] != "."]
    fitting = [name for name in names if name.startswith(incomplete)] or [
        without_time(name) for name in names
    ]
    by_name = {without_time(name): name for name in names} | {name: name for name in names}
    return [
        name
        for name in sorted(fitting)
        if name.startswith(incomplete) and (directory / by_name[name] / RECORD_FILE).is_file()
    ]


@_silent
def policies(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete runs and the keys of released policies."""
    from orchid_uav.experiments.evaluation.method_keys import RELEASED

    return [*runs(ctx, incomplete), *RELEASED]


@_silent
def methods(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys and groups of methods."""
    from orchid_uav.experiments.evaluation.method_keys import ALL, LEARNED, RULES, known_methods

    return _listed([ALL, LEARNED, RULES, *known_methods()], incomplete)


@_silent
def metrics(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the metrics of an evaluation."""
    from orchid_uav.experiments.metrics import METRICS

    return _listed(["main", "all", *METRICS], incomplete)


@_silent
def training_metrics(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete the columns of ``episodes.csv``."""
    from orchid_uav.experiments.runs.index import TRAINING_METRICS

    return _listed(TRAINING_METRICS, incomplete)


@_silent
def assignments(ctx: typer.Context, incomplete: str) -> list[str]:
    """Complete keys of the configuration; if only one fits, offer its default as well.

    Offering two completions of one key also keeps the shell from adding a space after the "=".
    """
    from orchid_uav.experiments.configuration import RunConfig, flatten
    from orchid_uav.experiments.runs.index import value_text

    fitting = {
        key: value for key, value in flatten(RunConfig()).items() if key.startswith(incomplete)
    }
    if len(fitting) != 1:
        return [f"{key}=" for key in fitting]
    ((key, value),) = fitting.items()
    return [f"{key}=", f"{key}={value_text(value).replace(' ', '')}"]


@_silent
def presets(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of presets, for ``--preset``."""
    from orchid_uav.experiments.presets import PRESETS

    return list(PRESETS)


@_silent
def run_keys(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys that runs can be sorted and filtered by."""
    return _listed(_run_keys(), incomplete)


@_silent
def sort_keys(ctx: typer.Context, incomplete: str) -> list[str]:
    """The same keys, with a minus as well."""
    return _listed(_run_keys(), incomplete, sign="-")


@_silent
def trackers(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of trackers, for ``--track``."""
    from orchid_uav.experiments.training.trackers import TRACKERS

    return list(TRACKERS)


def _run_keys() -> list[str]:
    from orchid_uav.experiments.configuration import configuration_keys
    from orchid_uav.experiments.runs.index import RECORD_KEYS, TRAINING_METRICS

    return [*RECORD_KEYS, *TRAINING_METRICS, *configuration_keys()]
