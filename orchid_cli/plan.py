"""``orchid plan``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from orchid_uav.cli.console import (
    OUTPUT_PANEL,
    WRONG_INPUT,
    DebugOption,
    JsonOption,
    QuietOption,
    console,
    failing_well,
    print_line,
    print_note,
    print_text,
    stdout_for_json_alone,
)
from orchid_uav.cli.options import ConfigOption, SetOption, option
from orchid_uav.cli.tables.planning import print_plan
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR, expanded
from orchid_uav.notices import show_on_stderr

if TYPE_CHECKING:
    from orchid_uav.experiments.configuration import Layer

_PLACES, _DRONES, _SEARCH = "Places", "Drones", "Search"


def plan(
    context: typer.Context,
    people: Annotated[
        Path | None,
        typer.Argument(
            metavar="PEOPLE",
            help="Where people are: .csv, .geojson, .json, .kml or .kmz; others need gis.",
            show_default=False,
        ),
    ] = None,
    drones: Annotated[
        str | None,
        option(
            _DRONES,
            "How many, or auto: the least that meets --want (default: 6).",
            metavar="N|auto",
        ),
    ] = None,
    want: Annotated[
        str | None,
        option(_DRONES, "What people should have, like 1Mbps:95%.", metavar="RATE:SHARE"),
    ] = None,
    masts: Annotated[
        list[str] | None,
        option(
            _PLACES,
            "A mast that still works, with its height (30 m); may be repeated; default: none.",
            "--mast",
            metavar="LAT,LON[,M]",
        ),
    ] = None,
    environment: Annotated[
        str | None,
        option(
            _PLACES,
            "What stands around: suburban, urban, dense-urban, high-rise (default: urban).",
            metavar="NAME",
        ),
    ] = None,
    area: Annotated[
        Path | None,
        option(_PLACES, "Polygons that drones stay in: GeoJSON or KML (default: round people)."),
    ] = None,
    no_fly: Annotated[
        Path | None, option(_PLACES, "Polygons that drones keep out of: GeoJSON or KML.")
    ] = None,
    home: Annotated[
        str | None,
        option(
            _PLACES,
            "Where drones start and land (default: at the first mast, else amid the people).",
            metavar="LAT,LON[,AMSL_M]",
        ),
    ] = None,
    altitude: Annotated[
        str | None,
        option(_DRONES, "Of stations, in m above home (default: 80..120).", metavar="M..M"),
    ] = None,
    hover: Annotated[
        bool,
        option(
            _DRONES, "Drones stand still, on a tether for example, and do not circle.", "--hover"
        ),
    ] = False,
    battery_wh: Annotated[
        float | None, option(_DRONES, "Energy of a full battery in Wh (default: 800).")
    ] = None,
    reserve: Annotated[
        str | None,
        option(_DRONES, "Of the battery, left on landing (default: 20%).", metavar="SHARE"),
    ] = None,
    clearance_m: Annotated[
        float | None, option(_DRONES, "Between the circles of two drones in m (default: 50).")
    ] = None,
    firmware: Annotated[
        Literal["px4", "ardupilot", "both"],
        option(_DRONES, "For which autopilots missions are written (default: both)."),
    ] = "both",
    method: Annotated[
        str,
        option(
            _SEARCH,
            "planner, balanced, or a method of orchid eval or a run that flies to its stations "
            "(default: planner).",
        ),
    ] = "planner",
    seed: Annotated[
        int | None, option(_SEARCH, "Seed of search and draws (default: 0).", min=0, metavar="N")
    ] = None,
    budget: Annotated[
        str,
        option(
            _SEARCH,
            "Time, like 5s or 2min, or number of plans to judge, like 5000 (default: 5s).",
            metavar="TIME|N",
        ),
    ] = "5s",
    config: ConfigOption = None,
    assignments: SetOption = None,
    out: Annotated[
        Path | None,
        option(OUTPUT_PANEL, "Directory for the files (default: ./orchid-plan/TIME)."),
    ] = None,
    runs_dir: Annotated[
        Path,
        typer.Option(
            envvar="ORCHID_RUNS_DIR",
            help="Directory in which a run given as --method is looked up.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = DEFAULT_RUNS_DIR,
    check: Annotated[
        Path | None,
        option(
            OUTPUT_PANEL,
            "Instead of planning, check a mission file against the rules of its readers.",
            metavar="FILE.plan",
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Decide where drones circle, from where people are; write a report and files for the crews.

    People are a file with the columns lat and lon (or x_m and y_m, metres of your own), and
    perhaps people: how many a row stands for. report.html says who is served how well, how sure
    that is, and how many drones it takes.

    Example: orchid plan people.csv --drones 6 --mast 17.2964,-62.7243
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        if check is not None:
            _check_mission(check, as_json)
            return
        if people is None:
            raise InputError("no file with people is given, as in: orchid plan people.csv")
        given: dict[str, Any] = {
            "plan.drones": _drones(drones),
            "plan.environment": environment,
            "plan.hover": hover or None,
            "plan.battery_wh": battery_wh,
            "plan.clearance_m": clearance_m,
            "plan.seed": seed,
        }
        flags: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
        if drones == "auto":
            flags["plan.drones"] = None
            if want is None and config is None:
                raise InputError("--drones auto needs --want, as in --want 1Mbps:95%")
        from orchid_uav.cli.progress.planning import planning_progress
        from orchid_uav.experiments.planning.files import Given, plan_from_files
        from orchid_uav.experiments.planning.reading.places import parse_budget

        shown = console(stderr=as_json)
        with stdout_for_json_alone(as_json):
            planned, directory = plan_from_files(
                Given(people, masts or [], home, area, no_fly),
                _layers(config, assignments or [], flags, want, altitude, reserve),
                parse_budget(budget),
                method,
                expanded(runs_dir),
                ["orchid", *context.obj],
                None if out is None else expanded(out),
                firmware,
                planning_progress(shown, quiet),
            )
        document = planned.mapped.document
        if as_json:
            print(json.dumps(document.to_json(), allow_nan=False))
        else:
            print_plan(shown, document)
        for note in document.notes:
            print_note(note)
        print_line(shown, f"report: {directory / 'report.html'}")
        print_line(shown, f"completed: {directory}")


def _drones(text: str | None) -> int | None:
    if text is None or text == "auto":
        return None
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 1000:
        raise InputError(f"--drones {text} is not a number from 1 to 1000, and not auto")
    return int(text)


def _layers(
    config: Path | None,
    assignments: list[str],
    flags: dict[str, Any],
    want: str | None,
    altitude: str | None,
    reserve: str | None,
) -> "list[Layer]":
    from orchid_uav.experiments.configuration import Layer, assignment_layer, file_layer
    from orchid_uav.experiments.planning.reading.places import (
        parse_altitudes,
        parse_reserve,
        parse_want,
    )
    from orchid_uav.experiments.planning.settings import PlanConfig

    if want is not None:
        flags["plan.want_rate_bps"], flags["plan.want_share"] = parse_want(want)
    if altitude is not None:
        lowest_m, highest_m = parse_altitudes(altitude)
        flags |= {"uav.min_altitude_m": lowest_m, "uav.max_altitude_m": highest_m}
        flags["uav.initial_altitude_m"] = highest_m
    if reserve is not None:
        flags["plan.reserve"] = parse_reserve(reserve)
    of_file = [] if config is None else [file_layer(config, print_note, PlanConfig)]
    return [*of_file, assignment_layer(assignments), Layer("command line", flags)]


def _check_mission(path: Path, as_json: bool) -> None:
    from orchid_uav.experiments.planning.missions.check import check_plan_file

    findings = check_plan_file(path)
    if as_json:
        print(json.dumps({"schema": 1, "findings": [finding._asdict() for finding in findings]}))
    else:
        for finding in findings:
            print_text(console(), f"{finding.severity}: {finding.where}: {finding.what}")
        if not findings:
            print_line(console(), f"{path}: no rule is broken")
    if any(finding.severity == "error" for finding in findings):
        raise typer.Exit(WRONG_INPUT)
