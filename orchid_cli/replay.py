"""``orchid replay``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from orchid_uav.cli import completion
from orchid_uav.cli.commands import SEED
from orchid_uav.cli.console import (
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    QuietOption,
    console,
    failing_well,
    print_line,
    print_note,
    print_table,
    stdout_for_json_alone,
)
from orchid_uav.cli.options import (
    SETTINGS_PANEL,
    ConfigOption,
    OneSettingFlags,
    SetOption,
    flag_layers,
    option,
    with_flags,
)
from orchid_uav.cli.worlds import tell_differences, world_of
from orchid_uav.experiments.configuration import (
    LEARNING_SECTIONS,
    Layer,
    RunConfig,
    flatten,
    spare_uavs_note,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.metrics import METRICS, heading_of
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR, expanded
from orchid_uav.notices import show_on_stderr

if TYPE_CHECKING:
    from orchid_uav.experiments.evaluation.methods import Contender
    from orchid_uav.experiments.replay.document import ReplayDocument
    from orchid_uav.experiments.replay.files import Output
    from orchid_uav.experiments.replay.flown import ReplayListener

_METHODS, _PICTURES = "Methods", "Pictures"


@with_flags
def replay(
    *,
    subjects: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="RUN|PLAN",
            help="A run, two of them, or the directory of a plan.",
            show_default=False,
            autocompletion=completion.runs,
        ),
    ] = None,
    methods: Annotated[
        str | None,
        option(
            _METHODS,
            "A key of orchid eval --list, or two separated by a comma.",
            metavar="KEY[,KEY]",
            autocompletion=completion.methods,
        ),
    ] = None,
    own_methods: Annotated[
        list[str] | None,
        option(
            _METHODS,
            "Your own method, as FILE.py:CLASS; may be repeated.",
            "--method",
            metavar="FILE:CLASS",
        ),
    ] = None,
    planner_evaluations: Annotated[
        int,
        option(_METHODS, "Plans that the planner evaluates (default: 3000).", min=31, metavar="N"),
    ] = 3000,
    flags: OneSettingFlags,
    seed: Annotated[
        int, option(SETTINGS_PANEL, "Seed of the topologies (default: 0).", **SEED)
    ] = 0,
    topology: Annotated[
        int,
        option(
            SETTINGS_PANEL,
            "Which of the topologies that orchid eval flies (default: 0).",
            min=0,
            max=99_999,
            metavar="N",
        ),
    ] = 0,
    config: ConfigOption = None,
    assignments: SetOption = None,
    out: Annotated[
        Path | None,
        option(
            OUTPUT_PANEL,
            "A .html, .png, .gif or .webp (default: ./orchid-replay/TIME.html).",
            "--out",
            "-o",
            metavar="FILE",
        ),
    ] = None,
    force: Annotated[
        bool, option(OUTPUT_PANEL, "Replace the file if it exists.", "--force")
    ] = False,
    frame: Annotated[
        int | None,
        option(
            _PICTURES, "Slot that a .png shows, from 0 (default: the last).", min=0, metavar="N"
        ),
    ] = None,
    every: Annotated[
        int | None,
        option(
            _PICTURES,
            "Slots from one picture of a .gif or .webp to the next (default: for 100 pictures).",
            min=1,
            metavar="N",
        ),
    ] = None,
    frames_per_s: Annotated[
        float | None,
        option(_PICTURES, "Pictures per second (default: 10).", "--fps", min=0.1, max=50.0),
    ] = None,
    width_px: Annotated[
        int | None,
        option(
            _PICTURES,
            "Width of pictures in pixels (default: 900).",
            "--width",
            min=200,
            max=4000,
            metavar="PX",
        ),
    ] = None,
    runs_dir: Annotated[
        Path,
        typer.Option(
            envvar="ORCHID_RUNS_DIR",
            help="Directory in which RUN is looked up.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = DEFAULT_RUNS_DIR,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Show a flight: a page that opens in a browser from disk, or pictures for a talk.

    Two methods fly side by side over the same people, on a topology that no policy was trained on.
    The world is that of the first run, or the paper's. A plan is shown as orchid plan made it.

    Example: orchid replay --methods track,best-response --speeds 15 -o a.html
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        from orchid_uav.cli.progress.replay import replay_progress
        from orchid_uav.experiments.evaluation.methods import find_runs
        from orchid_uav.experiments.replay.files import Output, write_replay
        from orchid_uav.experiments.replay.planned import plan_directory

        names = subjects or []
        keys = list(dict.fromkeys(filter(None, map(str.strip, (methods or "").split(",")))))
        if not (names or keys or own_methods):
            raise InputError(
                "there is nothing to replay: name a run, a plan, or methods, as in: "
                "orchid replay --methods orchid-distilled,balanced-loiter"
            )
        path = None if out is None else expanded(out)
        output = Output(path, frame, every, frames_per_s, width_px, force)
        output.check()
        plans = [directory for name in names if (directory := plan_directory(name))]
        if plans:
            given = [flags, assignments, config, seed, topology]
            make = _of_plan(plans[0], [*names[1:], *keys, *(own_methods or [])], given, output)
        else:
            paths = find_runs(names, expanded(runs_dir))
            contenders = _contenders(paths, keys, own_methods or [], planner_evaluations)
            world = _world(contenders if paths else [], config, assignments or [], flags)
            make = _of_flights(contenders, world, (seed, topology), output)
        shown = console(stderr=as_json)
        listener = replay_progress(shown, quiet)
        try:
            with stdout_for_json_alone(as_json):
                document = make(listener)
                written, size = write_replay(document, output, listener)
        finally:
            listener.ends()
        if as_json:
            print(json.dumps(_summary(document, written, size), allow_nan=False))
            return
        _print_means(shown, document)
        print_line(shown, f"completed: {written} ({size / 1e6:.2f} MB)")


def _of_plan(
    directory: Path, others: list[str], given: list[Any], output: "Output"
) -> Callable[["ReplayListener"], "ReplayDocument"]:
    from orchid_uav.experiments.replay.files import check_frame
    from orchid_uav.experiments.replay.planned import replay_of_plan

    if others:
        raise InputError(f"{directory} is a plan, which is shown alone: leave out {others[0]}")
    if any(given):
        raise InputError(
            f"{directory} is a plan, which is shown as it was made: leave out settings, and "
            "everything that chooses a topology"
        )
    document = replay_of_plan(directory)
    check_frame(output, document.slots)
    return lambda listener: document


def _contenders(
    paths: list[Path], keys: list[str], own_methods: list[str], planner_evaluations: int
) -> "list[Contender]":
    """Runs first, then methods, in the order in which they were named."""
    from orchid_uav.experiments.evaluation.methods import select
    from orchid_uav.experiments.evaluation.own_methods import read_own_methods

    found = [select([], [path])[0] for path in paths]
    for key in keys:
        found += select([key], planner_evaluations=planner_evaluations)
    return found + read_own_methods(own_methods, [contender.key for contender in found])


def _world(
    runs: "list[Contender]", config: Path | None, assignments: list[str], flags: dict[str, Any]
) -> RunConfig:
    """The world of the first run, unless a file says otherwise; else the paper's."""
    from orchid_uav.experiments.evaluation.methods import METHOD_KEYS

    below = []
    if runs and config is None and runs[0].policy is not None:
        values = {
            key: value
            for key, value in flatten(runs[0].policy.config).items()
            if key not in METHOD_KEYS and key.partition(".")[0] not in LEARNING_SECTIONS
        }
        below = [Layer(f"run {runs[0].key}", values)]
    return world_of(config, assignments, below, flag_layers(flags))


def _of_flights(
    contenders: "list[Contender]", world: RunConfig, topology: tuple[int, int], output: "Output"
) -> Callable[["ReplayListener"], "ReplayDocument"]:
    from orchid_uav.experiments.evaluation.flights import SETTING_FIELDS, EvaluationPlan, Setting
    from orchid_uav.experiments.replay.files import check_frame
    from orchid_uav.experiments.replay.flown import Topology, replay_of_flights

    values = flatten(world)
    setting = Setting(*(values[key] for key in SETTING_FIELDS))
    parameters = world.network_parameters
    EvaluationPlan(contenders, [setting], 1, topology[0], parameters).check()
    check_frame(output, parameters.network.episode_slots)
    tell_differences(contenders, world)
    spare = spare_uavs_note(parameters)
    if spare:
        print_note(spare)
    return lambda listener: replay_of_flights(
        contenders, parameters, setting, Topology(*topology), listener
    )


def _means(document: "ReplayDocument") -> list[dict[str, float | None]]:
    """Means over the slots of every flight's metrics, by name, as an evaluation has them."""
    from orchid_uav.experiments.replay.flown import mean_metrics

    return [mean_metrics(flight) for flight in document.flights]


def _summary(document: "ReplayDocument", written: Path, size: int) -> dict[str, Any]:
    return {
        "schema": 1,
        "file": str(written),
        "bytes": size,
        "title": document.title,
        "subtitle": document.subtitle,
        "slots": document.slots,
        "flights": [
            {"method": flight.key, "metrics": means}
            for flight, means in zip(document.flights, _means(document), strict=True)
        ],
    }


def _print_means(out: Console, document: "ReplayDocument") -> None:
    shown = document.metrics
    rows = [
        [
            flight.label,
            *(
                "–" if (mean := means[one.key]) is None else METRICS[one.key].text(mean)
                for one in shown
            ),
        ]
        for flight, means in zip(document.flights, _means(document), strict=True)
    ]
    print_table(out, ["method", *(heading_of(one.key) for one in shown)], rows)
