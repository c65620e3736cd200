"""``orchid train``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from orchid_uav.cli.configuring import (
    AlgorithmOption,
    ConfigOption,
    DistributionOption,
    EpisodesOption,
    InitOption,
    KappaOption,
    NoResetOption,
    ObjectiveOption,
    PresetOption,
    SeedOption,
    SetOption,
    SharesOption,
    UavsOption,
    UsersOption,
    WorldsOption,
    configuration,
)
from orchid_uav.cli.console import (
    INTERRUPTED,
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    QuietOption,
    console,
    failing_well,
    print_line,
    print_table,
    stdout_for_json_alone,
)

if TYPE_CHECKING:
    from orchid_uav.experiments.training import Reporter, TrainingOutcome


def train(
    context: typer.Context,
    preset: PresetOption = "paper",
    config: ConfigOption = None,
    assignments: SetOption = None,
    uavs: UavsOption = None,
    users: UsersOption = None,
    distribution: DistributionOption = None,
    init: InitOption = None,
    objective: ObjectiveOption = None,
    shares: SharesOption = None,
    episodes: EpisodesOption = None,
    seed: SeedOption = None,
    worlds: WorldsOption = None,
    algorithm: AlgorithmOption = None,
    kappa: KappaOption = None,
    no_rf: NoResetOption = False,
    name: Annotated[
        str, typer.Option(help="Part of the run's id.", rich_help_panel=OUTPUT_PANEL)
    ] = "orchid",
    runs_dir: Annotated[
        Path,
        typer.Option(
            envvar="ORCHID_RUNS_DIR",
            help="Where run directories are made.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = Path("runs"),
    track: Annotated[
        list[str] | None,
        typer.Option(
            help="Export figures as well to: tensorboard (always on), mlflow, trackio.",
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Train one run: by default the paper's, 700 episodes of 200 slots with 6 UAVs.

    Ctrl-C ends it at the next step, after the update that may be due, and keeps what is done.

    Example: orchid train --uavs 8 --objective pf --no-rf --seed 3 --name pf-8
    """
    with failing_well(debug):
        merged, _ = configuration(context)
        out = console(stderr=as_json)
        if merged.reset.enabled and 2 * merged.reset.window >= merged.training.episodes:
            console(stderr=True).print(
                f"note: Reset-and-Finetune cannot help here: it waits for two windows of "
                f"{merged.reset.window} episodes, and there are {merged.training.episodes}"
            )
        if kappa is not None and not merged.reset.enabled:
            console(stderr=True).print("note: --kappa has no effect: Reset-and-Finetune is off")
        # torch and SB3 take seconds to import: not before the input is known to be right.
        from orchid_uav.experiments import trackers
        from orchid_uav.experiments.interruption import interruption_requests
        from orchid_uav.experiments.run_directory import RunDirectory
        from orchid_uav.experiments.training import train as run_training

        wanted = list(dict.fromkeys(["tensorboard", *(track or [])]))
        for tracker in wanted:
            trackers.check_tracker(tracker)
        with interruption_requests() as interruption, stdout_for_json_alone(as_json):
            command = ["orchid", *context.obj]
            run = RunDirectory.create(runs_dir.expanduser(), name, merged, command)
            opened = [trackers.open_tracker(tracker, run.path, merged) for tracker in wanted]
            outcome = run_training(merged, run, _reporter(out, quiet), opened, interruption)
        if as_json:
            print(json.dumps(outcome.summary(), allow_nan=False))
        else:
            _print_outcome(out, outcome)
        if outcome.status == "interrupted":
            raise typer.Exit(INTERRUPTED)


def _reporter(out: Console, quiet: bool) -> "Reporter":
    from orchid_uav.cli.display import LineReporter, LiveReporter, SilentReporter

    if quiet:
        return SilentReporter()
    has_cursor = out.is_terminal and not out.is_dumb_terminal
    return LiveReporter(out) if has_cursor else LineReporter(out)


def _print_outcome(out: Console, outcome: "TrainingOutcome") -> None:
    from orchid_uav.cli.display import figure_texts
    from orchid_uav.experiments.run_directory import FINAL_EPISODES

    rows = len(outcome.rows)
    if rows:
        final = outcome.run.record["final"]
        print_table(
            out,
            ["mean of the last episodes", str(min(rows, FINAL_EPISODES))],
            [[name, text] for name, text in figure_texts(final).items()],
        )
    resets = ", ".join(map(str, outcome.reset_episodes)) or "none"
    print_line(
        out,
        f"{outcome.status}: {rows} episodes in {outcome.seconds:.1f} s, "
        f"resets at episode: {resets}",
    )
    print_line(out, f"run directory: {outcome.run.path}")
