"""``orchid reproduce``."""

import json
import shlex
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from orchid_uav.cli.console import (
    FAILED,
    INTERRUPTED,
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    QuietOption,
    console,
    failing_well,
    print_line,
    print_note,
    stdout_for_json_alone,
)
from orchid_uav.cli.options import JobsOption, RayOption, option
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.notices import show_on_stderr

if TYPE_CHECKING:
    from orchid_uav.experiments.jobs.executor import Executor
    from orchid_uav.experiments.provenance import Status
    from orchid_uav.experiments.reproduction.campaign import Campaign

_STUDY = "Study"


def reproduce(
    context: typer.Context,
    quick: Annotated[
        bool,
        option(
            _STUDY,
            "Two seeds of 150 episodes on 20 topologies, some minutes: to see that it works. It "
            "gives no verdicts.",
            "--quick",
        ),
    ] = False,
    only: Annotated[
        str | None,
        option(
            _STUDY,
            "Figures and claims that are wanted, such as fig5,c4: what they need is trained "
            "(default: all).",
            "--only",
            metavar="LIST",
        ),
    ] = None,
    train: Annotated[
        bool,
        option(
            _STUDY,
            "With --no-train nothing is trained or flown: the report is made of the rows that "
            "there are.",
            "--train/--no-train",
        ),
    ] = True,
    jobs: JobsOption = None,
    ray: RayOption = None,
    rows: Annotated[
        Path | None,
        option(
            OUTPUT_PANEL,
            "Folder of rows: what a seed has given is read from here if it is there, and written "
            "here if not (default: rows in the directory).",
            "--rows",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        option(
            OUTPUT_PANEL,
            "Directory (default: ./orchid-reproduce, or ./orchid-reproduce-quick).",
            "--out",
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Train, fly and judge everything that the paper claims, and write it up.

    Writes report.html, claims.json and figures. The full one takes many hours: it prints how many
    before it begins. Ctrl-C stops it with a report of what is there; the same command goes on, and
    trains no finished seed again. docs/claims.md says what is tested, and by which rules.

    Example: orchid reproduce --quick
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        # torch and matplotlib take seconds to import, so names are checked first.
        wanted = tuple(dict.fromkeys(word.strip() for word in (only or "").split(",") if only))
        from orchid_uav.experiments.jobs.choice import executor_for
        from orchid_uav.experiments.reproduction.campaign import (
            DEFAULT_DIRECTORY,
            DEFAULT_QUICK,
            REPORT_FILE,
            ROWS_FOLDER,
            Campaign,
        )
        from orchid_uav.experiments.runs.records import expanded

        directory = expanded(out or (DEFAULT_QUICK if quick else DEFAULT_DIRECTORY))
        campaign = Campaign(directory, expanded(rows or directory / ROWS_FOLDER), quick, wanted)
        command = ["orchid", *context.obj]
        shown, again = console(stderr=as_json), shlex.join(command)
        status: Status = "completed"
        with stdout_for_json_alone(as_json):
            campaign.reserve(command)
            try:
                if train:
                    with closing(executor_for(jobs, ray)) as executor:
                        status = _make(campaign, executor, shown, quiet, again)
                document = campaign.report(command, status)
            except RunFailedError as error:
                raise RunFailedError(f"{error}\ntry again with: {again}") from error
        if as_json:
            print(json.dumps(document.to_json(), allow_nan=False))
        else:
            from orchid_uav.cli.tables.reproduction import print_reproduction

            print_reproduction(shown, document)
        print_line(shown, f"{status}: {directory / REPORT_FILE}")
        if status == "interrupted":
            print_line(console(stderr=True), f"interrupted; continue with: {again}")
            raise typer.Exit(INTERRUPTED)
        if status == "failed":
            print_line(console(stderr=True), f"try the failed ones again with: {again}")
            raise typer.Exit(FAILED)


def _make(
    campaign: "Campaign", executor: "Executor", shown: Console, quiet: bool, again: str
) -> "Status":
    """Make the rows that are missing, and say how that ended."""
    if executor.note:
        print_note(executor.note)
    for folder in (campaign.directory, campaign.rows):
        executor.check(folder)
    from orchid_uav.cli.progress.jobs import job_progress
    from orchid_uav.experiments.reproduction.campaign import measured_minutes

    total, waiting = len(campaign.jobs()), campaign.waiting()
    if not quiet:
        print_line(shown, f"{total} rows, {total - len(waiting)} of them already there")
    if not waiting:
        return "completed"
    if not quiet:
        print_line(shown, f"if it stops, continue with: {again}")
        print_line(shown, "measuring how long it takes ...")
    try:
        minutes = measured_minutes(waiting)
        if not quiet:
            _print_plan(campaign, minutes, executor.processes, shown)
        ends = campaign.make(waiting, executor, job_progress(shown, quiet), minutes)
    except KeyboardInterrupt:
        return "interrupted"
    if executor.was_stopped or any(end.status == "interrupted" for end in ends):
        return "interrupted"
    return "failed" if any(end.status == "failed" for end in ends) else "completed"


def _print_plan(
    campaign: "Campaign", minutes: dict[str, float], processes: int, shown: Console
) -> None:
    """Print what will be made, and how long it takes."""
    from orchid_uav.cli.console import print_table
    from orchid_uav.experiments.jobs.workload import hours_text

    waiting = campaign.waiting()
    methods = list(dict.fromkeys(job.method for job in waiting))
    rows = []
    for method in methods:
        own = [minutes[job.name] for job in waiting if job.method == method]
        rows.append([method, f"{len(own)}", hours_text(own, 1)])
    print_table(shown, ["method", "rows", "of one core"], rows)
    total = hours_text(list(minutes.values()), processes)
    print_line(
        shown,
        f"about {total} with {processes} at once, if parallel runs are as fast as a single one",
    )
