"""``orchid runs``: past training runs, read from their directories without a database."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from orchid_uav.cli import completion
from orchid_uav.cli.commands import Commands
from orchid_uav.cli.console import (
    FAILED,
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    console,
    failing_well,
    print_line,
    print_next_on_terminal,
    print_note,
)
from orchid_uav.cli.tables.runs import (
    LIST_COLUMNS,
    SHOWN_ON_TERMINAL,
    columns_that_fit,
    print_comparison,
    print_curves,
    print_removals,
    print_resume_commands,
    print_run,
    print_runs,
)
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs.records import find_run, run_argument
from orchid_uav.notices import reason_of
from orchid_uav.suggestions import unknown

if TYPE_CHECKING:
    from orchid_uav.experiments.runs.index import Run

app = Commands()

_SELECTION, _CURVES = "Selection", "Learning curves"
_RUN = "A run's id, the beginning of one, or a path."
_TERMINAL_METRIC = "reward"

RunsArgument = Annotated[
    list[str], typer.Argument(metavar="RUN", help=_RUN, autocompletion=completion.runs)
]
RunsDirOption = Annotated[
    Path,
    typer.Option(
        envvar="ORCHID_RUNS_DIR",
        help="Directory that contains the runs.",
        rich_help_panel=_SELECTION,
    ),
]
MetricOption = Annotated[
    str | None,
    typer.Option(
        help="Columns of episodes.csv, separated by commas (default: reward; in a figure, six).",
        autocompletion=completion.training_metrics,
        rich_help_panel=_CURVES,
        show_default=False,
    ),
]
SmoothOption = Annotated[
    int,
    typer.Option(min=1, help="Episodes that the trailing mean covers.", rich_help_panel=_CURVES),
]
FigureOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FILE",
        help="Also draw the learning curves to this file: .png, .svg or .pdf.",
        rich_help_panel=OUTPUT_PANEL,
        show_default=False,
    ),
]


@app.callback(invoke_without_command=True)
def _commands(context: typer.Context) -> None:
    """List, show, compare, delete, export and import training runs."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command("list")
def list_runs(
    where: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY OP VALUE",
            autocompletion=completion.run_keys,
            help="Only runs that fit; OP is = != < <= > >= or ~ (contains). May be repeated.",
            rich_help_panel=_SELECTION,
            show_default=False,
        ),
    ] = None,
    sort: Annotated[
        str,
        typer.Option(
            metavar="[-]KEY,...",
            autocompletion=completion.sort_keys,
            help="Keys to sort by; - puts the greatest first (default: latest first).",
            rich_help_panel=_SELECTION,
            show_default=False,
        ),
    ] = "",
    limit: Annotated[
        int | None,
        typer.Option(
            min=0,
            help=f"Most runs to list, 0 for all (default: {SHOWN_ON_TERMINAL} on a terminal, "
            "else all).",
            rich_help_panel=_SELECTION,
            show_default=False,
        ),
    ] = None,
    runs_dir: RunsDirOption = Path("runs"),
    columns: Annotated[
        str | None,
        typer.Option(
            metavar="KEY,...",
            autocompletion=completion.run_keys,
            help="Columns of the table after the id.",
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """List runs: their state, and the means of their last 50 episodes.

    A KEY is a key of the configuration (reset.kappa, or kappa alone), a column of episodes.csv
    (rate_jfi, in the unit of its name), or an entry of the record: id, name, status, started,
    seconds, episodes, resets, host.name, versions.torch ... A run whose process is gone is shown as
    'died'.

    Example: orchid runs list --where 'rate_jfi>0.7' --sort -rate_jfi
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.filters import Keys, found_values, select
        from orchid_uav.experiments.runs.index import read_index
        from orchid_uav.experiments.runs.records import expanded

        index = read_index(expanded(runs_dir))
        keys = Keys(index.runs)
        conditions = [keys.condition(text) for text in where or []]
        wanted = keys.columns(columns) if columns else None
        chosen = select(index.runs, keys, conditions, sort)
        out = console()
        if limit is None and out.is_terminal and not as_json:
            limit = SHOWN_ON_TERMINAL
        shown = chosen[: limit or None]
        _tell_damaged(index.damaged)
        if as_json:
            _print_json(
                runs=[run.summary() for run in shown],
                damaged=[{"id": run, "reason": why} for run, why in index.damaged.items()],
            )
            return
        if not index.runs:
            print_note(f"no runs in {runs_dir}")
            print_next_on_terminal("train")
            return
        if not chosen:
            print_note(f"none of the {len(index.runs)} runs fits")
            for condition in conditions:
                if not select(index.runs, keys, [condition]):
                    found = found_values(index.runs, condition.key)
                    print_note(f"no run has {condition.text}: {condition.key} is {found}")
            return
        print_runs(out, shown, wanted or columns_that_fit(out, shown))
        if wanted is None:
            _tell_columns_left_out(columns_that_fit(out, shown))
        if len(shown) < len(chosen):
            print_note(f"{len(shown)} of {len(chosen)} runs are shown; --limit 0 shows all")
        if print_resume_commands(out, shown) or not shown:
            return
        paths = [run_argument(run.path) for run in shown[:2]]
        if shown[0].status == "interrupted":
            print_next_on_terminal("train", "--resume", paths[0])
        else:
            print_next_on_terminal("runs", "compare" if len(paths) > 1 else "show", *paths)


@app.command()
def show(
    run: Annotated[str, typer.Argument(metavar="RUN", help=_RUN, autocompletion=completion.runs)],
    runs_dir: RunsDirOption = Path("runs"),
    metric: MetricOption = None,
    smooth: SmoothOption = 20,
    out_file: FigureOption = None,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Show everything that is known about a run, and its learning curve.

    Example: orchid runs show 20261122T2112 --metric rate_jfi --out curve.png
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.index import details

        (found,) = _read([run], runs_dir)
        metrics = _metrics(metric)
        if out_file is not None:
            _draw([found], out_file, metrics, smooth)
        if as_json:
            _print_json(**details(found), figure=None if out_file is None else str(out_file))
            return
        out = console()
        print_run(out, found)
        print_curves(out, [found], metrics or [_TERMINAL_METRIC], smooth)
        if out_file is not None:
            print_line(out, f"figure: {out_file}")
        _suggest_flying([found])


@app.command()
def compare(
    runs: RunsArgument,
    runs_dir: RunsDirOption = Path("runs"),
    metric: MetricOption = None,
    smooth: SmoothOption = 20,
    out_file: FigureOption = None,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Compare runs: the configuration keys that differ, final metrics, learning curves.

    Example: orchid runs compare 20261122T2112 20261122T2115 --out curves.png
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.index import differences

        found = _read(runs, runs_dir)
        if len(found) < 2 and out_file is None:
            raise InputError(
                f"there is nothing to compare {found[0].id} with: name another run, "
                "or --out FILE to draw the curves of this one"
            )
        metrics = _metrics(metric)
        if out_file is not None:
            _draw(found, out_file, metrics, smooth)
        if as_json:
            _print_json(
                runs=[run.summary() for run in found],
                differences=differences(found),
                figure=None if out_file is None else str(out_file),
            )
            return
        out = console()
        print_comparison(out, found)
        print_curves(out, found, metrics or [_TERMINAL_METRIC], smooth)
        if out_file is not None:
            print_line(out, f"figure: {out_file}")
        _suggest_flying(found)


@app.command()
def delete(
    runs: RunsArgument,
    runs_dir: RunsDirOption = Path("runs"),
    yes: Annotated[
        bool, typer.Option("--yes", help="Delete without asking.", rich_help_panel=_SELECTION)
    ] = False,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Delete run directories after asking for confirmation.

    Links are removed and never followed, and runs that are still running are not deleted.

    Example: orchid runs delete 20261122T2112
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.records import expanded
        from orchid_uav.experiments.runs.removal import plan_removal, remove

        removals = plan_removal(runs, expanded(runs_dir))
        if not yes:
            if not sys.stdin.isatty():
                raise InputError(
                    "there is no terminal on which to ask: give --yes to delete without asking"
                )
            print_removals(console(stderr=True), removals)
            if not _is_confirmed("Delete?"):
                print_note("nothing was deleted")
                raise typer.Exit(FAILED)
        deleted = remove(removals)
        if as_json:
            _print_json(deleted=deleted)
        else:
            print_line(console(), f"deleted: {', '.join(deleted)}")


@app.command()
def export(
    runs: RunsArgument,
    runs_dir: RunsDirOption = Path("runs"),
    out_file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="The zip to write (default for one run: ./<id>.zip).",
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    checkpoints: Annotated[
        bool,
        typer.Option(
            "--checkpoints",
            help="Include checkpoints, so that the run can be resumed elsewhere.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = False,
    force: Annotated[
        bool,
        typer.Option("--force", help="Replace the zip if it exists.", rich_help_panel=OUTPUT_PANEL),
    ] = False,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Write runs to a zip that another machine can import and evaluate.

    Example: orchid runs export 20261122T2112 --out for-a-colleague.zip
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.archive import export_runs
        from orchid_uav.experiments.runs.records import expanded

        paths = [find_run(name, expanded(runs_dir)) for name in runs]
        if out_file is None and len(paths) > 1:
            raise InputError("several runs need a name for their archive: give --out FILE.zip")
        target = Path(f"{paths[0].resolve().name}.zip") if out_file is None else expanded(out_file)
        exported = export_runs(paths, target, checkpoints, force)
        for name in exported.left_out:
            print_note(f"left out, since it is not a file of a run: {name}")
        if as_json:
            _print_json(runs=exported.runs, file=str(target), bytes=exported.size)
            return
        out = console()
        count = f"{len(exported.runs)} run" + "s" * (len(exported.runs) > 1)
        print_line(out, f"{target}: {count}, {exported.size / 1e6:.1f} MB")
        print_line(out, f"on the other machine: orchid runs import {target.name}")


@app.command("import")
def import_archive(
    archive: Annotated[
        Path, typer.Argument(metavar="FILE", help="A zip written by orchid runs export.")
    ],
    runs_dir: RunsDirOption = Path("runs"),
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Unpack exported runs, after checking everything in the zip.

    Example: orchid runs import from-a-colleague.zip
    """
    with failing_well(debug):
        from orchid_uav.experiments.runs.archive import import_runs
        from orchid_uav.experiments.runs.records import expanded

        paths = import_runs(expanded(archive), expanded(runs_dir))
        if as_json:
            _print_json(runs=[{"id": path.name, "path": str(path)} for path in paths])
            return
        for path in paths:
            print_line(console(), f"imported: {path}")
        print_next_on_terminal("eval", *map(run_argument, paths))


def _tell_columns_left_out(fitting: list[str]) -> None:
    left_out = [key.rpartition(".")[2] for key in LIST_COLUMNS if key not in fitting]
    if left_out:
        print_note(
            f"no room for {', '.join(left_out)}: use a wider terminal, or choose with --columns"
        )


def _suggest_flying(runs: "list[Run]") -> None:
    """Suggest evaluating the runs, if all of them have a policy."""
    if all(run.status in ("completed", "interrupted") for run in runs):
        print_next_on_terminal("eval", *(run_argument(run.path) for run in runs))


def _read(names: list[str], runs_dir: Path) -> "list[Run]":
    from orchid_uav.experiments.runs.index import read_run
    from orchid_uav.experiments.runs.records import expanded

    runs = [read_run(find_run(name, expanded(runs_dir))) for name in names]
    places = [run.path.resolve() for run in runs]
    for run, place in zip(runs, places, strict=True):
        if places.count(place) > 1:
            raise InputError(f"run {run.id} is given twice")
    return runs


def _is_confirmed(question: str) -> bool:
    """Ask on stderr, since a program may read stdout."""
    print(f"{question} [y/N] ", end="", file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise typer.Abort
    return answer.strip().lower() in ("y", "yes")


def _metrics(given: str | None) -> list[str]:
    from orchid_uav.experiments.runs.index import TRAINING_METRICS

    names = [name.strip() for name in given.split(",")] if given else []
    for name in names:
        if name not in TRAINING_METRICS:
            raise InputError(unknown("metric", name, TRAINING_METRICS, cutoff=0.4))
    return names


def _draw(runs: "list[Run]", path: Path, metrics: list[str], window: int) -> None:
    from orchid_uav.experiments.figures.learning_curves import FORMATS, draw_learning_curves
    from orchid_uav.experiments.figures.style import setting_of
    from orchid_uav.experiments.runs.index import read_log, short_names
    from orchid_uav.experiments.runs.records import expanded
    from orchid_uav.experiments.statistics.curves import DEFAULT_COLUMNS

    if path.suffix not in FORMATS:
        raise InputError(f"--out {path} ends in none of {', '.join(FORMATS)}")
    rows = dict(zip(short_names(runs), map(read_log, runs), strict=True))
    if not any(rows.values()):
        raise InputError("there is nothing to draw: none of the runs has an episode")
    groups = {run: [found] for run, found in rows.items()}
    title = setting_of(run.config for run in runs)
    columns = metrics or DEFAULT_COLUMNS
    try:
        draw_learning_curves(groups, expanded(path), columns, window, title=title)
    except OSError as error:
        raise RunFailedError(f"cannot write {path}: {reason_of(error)}") from error


def _tell_damaged(damaged: dict[str, str]) -> None:
    for name, reason in list(damaged.items())[:3]:
        print_note(f"left out, {name}: {reason}")
    if len(damaged) > 3:
        print_note(f"also left out: {', '.join(list(damaged)[3:])}")


def _print_json(**document: Any) -> None:
    print(json.dumps({"schema": 1, **document}, allow_nan=False))
