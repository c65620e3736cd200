"""``orchid eval``."""

import itertools
import json
import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from orchid_uav.cli import completion
from orchid_uav.cli.commands import SEED
from orchid_uav.cli.console import (
    INTERRUPTED,
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    QuietOption,
    console,
    failing_well,
    print_line,
    print_next,
    print_note,
    print_table,
    stdout_for_json_alone,
)
from orchid_uav.cli.options import (
    SETTINGS_PANEL,
    ConfigOption,
    SetOption,
    SettingFlags,
    listed,
    with_flags,
)
from orchid_uav.cli.ranges import MOST_VALUES
from orchid_uav.cli.worlds import tell_differences, world_of
from orchid_uav.experiments.configuration import RunConfig, flatten, spare_uavs_note
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR
from orchid_uav.notices import show_on_stderr
from orchid_uav.suggestions import unknown

if TYPE_CHECKING:
    from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting
    from orchid_uav.experiments.evaluation.methods import Contender

_METHODS = "Methods"


def _option(panel: str, text: str, *names: str, **more: Any) -> Any:
    return typer.Option(*names, help=text, rich_help_panel=panel, **more)


@with_flags
def evaluate(
    context: typer.Context,
    *,
    runs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN",
            help="Runs to fly: ids, beginnings of ids, or paths (default: the released policies).",
            show_default=False,
            autocompletion=completion.runs,
        ),
    ] = None,
    methods: Annotated[
        str | None,
        _option(
            _METHODS,
            "all, learned, rules, or keys separated by commas (default: all; with RUN, rules).",
            show_default=False,
            autocompletion=completion.methods,
        ),
    ] = None,
    own_methods: Annotated[
        list[str] | None,
        _option(
            _METHODS,
            "Your own method, as FILE.py:CLASS; may be repeated.",
            "--method",
            metavar="FILE:CLASS",
            show_default=False,
        ),
    ] = None,
    stochastic: Annotated[
        bool,
        _option(_METHODS, "Also fly learned policies with sampled actions.", show_default=False),
    ] = False,
    list_methods: Annotated[
        bool, _option(_METHODS, "List all methods and exit.", "--list")
    ] = False,
    planner_evaluations: Annotated[
        int,
        _option(_METHODS, "Plans that the planner evaluates per topology.", min=31, metavar="N"),
    ] = 3000,
    flags: SettingFlags,
    episodes: Annotated[
        int, _option(SETTINGS_PANEL, "Topologies per setting.", min=1, max=100_000, metavar="N")
    ] = 100,
    seed: Annotated[int, _option(SETTINGS_PANEL, "Seed of the topologies.", **SEED)] = 0,
    config: ConfigOption = None,
    assignments: SetOption = None,
    metrics: Annotated[
        str,
        _option(
            OUTPUT_PANEL,
            "Tables to print: main, all, or names separated by commas.",
            autocompletion=completion.metrics,
        ),
    ] = "main",
    out: Annotated[
        Path | None,
        _option(
            OUTPUT_PANEL,
            "Directory for the results (default: ./orchid-eval/TIME).",
            show_default=False,
        ),
    ] = None,
    runs_dir: Annotated[
        Path,
        _option(OUTPUT_PANEL, "Directory in which RUN is looked up.", envvar="ORCHID_RUNS_DIR"),
    ] = DEFAULT_RUNS_DIR,
    figures: Annotated[
        bool, _option(OUTPUT_PANEL, "Draw a figure per metric.", "--figures/--no-figures")
    ] = True,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Fly all methods over the same held-out topologies; write tables, figures and episode rows.

    The released policies were trained with 6 UAVs and 100 users, and fly every setting. If several
    options are lists, all combinations are flown. Ctrl-C stops and keeps the finished results; the
    same command with the same --out continues.

    Example: orchid eval --uavs 4..10 --methods orchid,orchid-zero,loiter-mmf
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        if list_methods:
            _list_methods(as_json)
            return
        from orchid_uav.cli.progress.evaluation import evaluation_progress
        from orchid_uav.experiments.evaluation.directory import (
            FIGURES_FOLDER,
            describe_plan,
            make_default_directory,
            read_interrupted,
            reserve_directory,
            run_evaluation,
        )
        from orchid_uav.experiments.evaluation.methods import find_runs, select
        from orchid_uav.experiments.evaluation.own_methods import read_own_methods
        from orchid_uav.experiments.figures.contact_sheet import SHEET_FILE
        from orchid_uav.experiments.runs.records import expanded

        world = world_of(config, assignments or [])
        settings = _settings(world, flags)
        shown_metrics = _metrics(metrics)
        paths = find_runs(runs or [], expanded(runs_dir))
        names = (methods or ("rules" if paths else "all")).split(",")
        contenders = select(
            [name.strip() for name in names], paths, stochastic, planner_evaluations
        )
        keys = [contender.key for contender in contenders]
        contenders += read_own_methods(own_methods or [], keys)
        plan = _plan(contenders, settings, episodes, seed, world)
        description = describe_plan(plan, planner_evaluations)
        flown = (
            {} if out is None else read_interrupted(expanded(out), plan, description, print_note)
        )
        shown = console(stderr=as_json)
        tell_differences(plan.contenders, world)
        for note in dict.fromkeys(spare_uavs_note(one.apply(plan.world)) for one in settings):
            if note:
                print_note(note)
        if not quiet:
            _announce(shown, plan, flown)
        directory = make_default_directory() if out is None else expanded(out)
        reserve_directory(directory)
        command = ["orchid", *context.obj]
        with stdout_for_json_alone(as_json):
            progress = evaluation_progress(shown, quiet)
            document = run_evaluation(
                plan, description, directory, command, flown, progress, figures
            )
        if as_json:
            print(json.dumps(document.to_json(), allow_nan=False))
        elif document.results:
            from orchid_uav.cli.tables.evaluation import print_tables

            print_tables(shown, document.results, shown_metrics)
        if document.status == "interrupted":
            again = shlex.join([*command, *([] if out else ["--out", str(directory)])])
            print_line(console(stderr=True), f"interrupted; continue with: {again}")
            raise typer.Exit(INTERRUPTED)
        if figures:
            print_line(shown, f"figures: {directory / FIGURES_FOLDER / SHEET_FILE}")
        print_line(shown, f"completed: {directory}")
        if not (as_json or quiet):
            print_next(shown, *_next_command(settings, context.obj))


def _next_command(settings: list["Setting"], given: list[str]) -> list[str]:
    """Suggest the same study with several numbers of UAVs; after that, one over training seeds."""
    if len(settings) > 1 or settings[0].users <= 10:
        return ["ablate", "--no-rf"]
    kept: list[str] = []
    rest = iter(given)
    for argument in rest:
        if argument in ("--uavs", "--out"):
            next(rest)
        elif not argument.startswith(("--uavs=", "--out=")):
            kept.append(argument)
    if not any(argument.startswith("--methods") for argument in kept):
        kept += ["--methods", "learned,loiter-mmf"]  # without the planner, which is slow
    return [*kept, "--uavs", "4..10"]


def _list_methods(as_json: bool) -> None:
    from orchid_uav.experiments.evaluation.methods import groups, ideas

    if not as_json:
        print_table(console(), ["method", "what it is"], list(ideas().items()), wraps_last=True)
        return
    members = groups().items()
    methods = [
        {"method": key, "idea": idea, "groups": [name for name, keys in members if key in keys]}
        for key, idea in ideas().items()
    ]
    print(json.dumps({"schema": 1, "methods": methods}))


def _settings(world: "RunConfig", flags: Mapping[str, str]) -> list["Setting"]:
    """All combinations of the lists; other values are those of the configuration."""
    from orchid_uav.experiments.evaluation.flights import SETTING_FIELDS, Setting

    usual = flatten(world)
    lists = [listed(key, flags[key]) if key in flags else [usual[key]] for key in SETTING_FIELDS]
    count = math.prod(map(len, lists))
    if count > MOST_VALUES:
        raise InputError(f"the lists make {count:,} settings, more than {MOST_VALUES:,}")
    return [Setting(*combination) for combination in itertools.product(*lists)]


def _plan(
    contenders: list["Contender"],
    settings: list["Setting"],
    episodes: int,
    seed: int,
    world: "RunConfig",
) -> "EvaluationPlan":
    from orchid_uav.experiments.evaluation.flights import EvaluationPlan

    plan = EvaluationPlan(contenders, settings, episodes, seed, world.network_parameters)
    plan.check()
    return plan


def _metrics(text: str) -> list[str]:
    from orchid_uav.experiments.metrics import HEADLINE, METRICS

    if text in ("main", "all"):
        return list(HEADLINE if text == "main" else METRICS)
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in METRICS:
            raise InputError(unknown("metric", name, METRICS, cutoff=0.3))
    return names


def _announce(out: Console, plan: "EvaluationPlan", flown: dict[Any, Any]) -> None:
    def listed(values: list[Any], unit: str = "") -> str:
        return ", ".join(f"{value:g}" for value in dict.fromkeys(values)) + unit

    settings = plan.settings
    print_line(out, f"UAVs {listed([setting.uavs for setting in settings])}")
    print_line(out, f"users {listed([setting.users for setting in settings])}")
    print_line(out, f"speeds {listed([setting.speed_mps for setting in settings], ' m/s')}")
    holds = listed([setting.heading_hold_s for setting in settings], " s")
    print_line(out, f"headings held {holds}")
    distributions = dict.fromkeys(setting.distribution for setting in settings)
    print_line(out, f"distributions {', '.join(distributions)}")
    total = len(settings) * len(plan.contenders) * plan.episodes
    counts = [(len(settings), "setting"), (len(plan.contenders), "method")]
    product = " x ".join(f"{count:,} {what}{'' if count == 1 else 's'}" for count, what in counts)
    before = f", {len(flown)} batches of them already flown" if flown else ""
    print_line(out, f"{product} x {plan.episodes:,} topologies = {total:,} flights{before}")
