"""``orchid train``."""

import json
import math
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from orchid_uav.agents.imitation.tasks import DRAWN
from orchid_uav.cli import completion
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
    ConfigOption,
    PresetOption,
    RunFlags,
    SetOption,
    configuration,
    with_flags,
)
from orchid_uav.experiments.configuration import FLAGS, RunConfig, spare_uavs_note
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.provenance import describe_versions
from orchid_uav.experiments.runs.records import (
    DEFAULT_RUNS_DIR,
    RunRecord,
    expanded,
    find_run,
    has_checkpoint,
    name_of,
    read_config,
    read_record,
    resume_command,
    run_argument,
    status_of,
)
from orchid_uav.notices import show_on_stderr

if TYPE_CHECKING:
    from orchid_uav.experiments.runs.directory import RunDirectory
    from orchid_uav.experiments.training.loop import TrainingOutcome

_FOR_REWARDS = ("training.center_rewards", "training.final_learning_rate_scale")
_OF_NEW_RUNS = {
    "--preset": "preset",
    "--config": "config",
    "--set": "assignments",
    "--name": "name",
}
"""Further options that only a new run can take, and the parameters that hold them."""


@with_flags
def train(
    context: typer.Context,
    *,
    preset: PresetOption = "paper",
    config: ConfigOption = None,
    assignments: SetOption = None,
    flags: RunFlags,
    name: Annotated[
        str,
        typer.Option(
            help="Name of the run, which becomes part of its id.", rich_help_panel=OUTPUT_PANEL
        ),
    ] = "orchid",
    runs_dir: Annotated[
        Path,
        typer.Option(
            envvar="ORCHID_RUNS_DIR",
            help="Directory in which the run's directory is made.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = DEFAULT_RUNS_DIR,
    resume: Annotated[
        str | None,
        typer.Option(
            metavar="RUN",
            autocompletion=completion.runs,
            help="Continue a run that stopped or died; with more --episodes, extend it.",
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    track: Annotated[
        list[str] | None,
        typer.Option(
            help="Also export metrics to: tensorboard (always on), mlflow, trackio, wandb.",
            autocompletion=completion.trackers,
            rich_help_panel=OUTPUT_PANEL,
            show_default=False,
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Train one run; by default the paper's, 700 episodes of 200 slots with 6 UAVs.

    Ctrl-C stops the run after the next update. --resume continues it; the result is bit for bit the
    same as without the interruption.

    Example: orchid train --uavs 8 --objective pf --no-rf --seed 3 --name pf-8
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        out = console(stderr=as_json)
        if resume is None:
            merged, sources = configuration(preset, config, assignments, flags)
            _note_idle_flags(merged, flags)
            _note_idle_keys(merged, sources)
            if spare_uavs := spare_uavs_note(merged):
                print_note(spare_uavs)
        else:
            path, merged = _continuation(context, flags, find_run(resume, expanded(runs_dir)))
        # torch and SB3 take seconds to import, so the input is checked first.
        from orchid_uav.cli.progress.training import training_reporter
        from orchid_uav.experiments.interruption import interruption_requests
        from orchid_uav.experiments.runs.directory import RunDirectory
        from orchid_uav.experiments.training import trackers
        from orchid_uav.experiments.training.loop import train as run_training

        wanted = list(dict.fromkeys(["tensorboard", *(track or [])]))
        for tracker in wanted:
            trackers.check_tracker(tracker)
        with interruption_requests() as interruption, stdout_for_json_alone(as_json):
            command = ["orchid", *context.obj]
            if resume is None:
                run = RunDirectory.create(expanded(runs_dir), name, merged, command)
            else:
                run = RunDirectory.reopen(path, merged, command)
                _note_new_id(run)
            opened = [trackers.open_tracker(tracker, run.path, merged) for tracker in wanted]
            try:
                reporter = training_reporter(out, quiet)
                outcome = run_training(merged, run, reporter, opened, interruption)
            except RunFailedError as error:
                raise RunFailedError(f"{error}\n{_after_failure(run.path, error)}") from error
            except KeyboardInterrupt:
                _print_continuation(run.path)
                raise
        if as_json:
            print(json.dumps(outcome.summary(), allow_nan=False))
        else:
            _print_outcome(out, outcome)
            if outcome.status == "completed" and not quiet:
                print_next(out, "eval", run_argument(run.path))
        if outcome.status == "interrupted":
            _print_continuation(run.path)
            raise typer.Exit(INTERRUPTED)


def _note_idle_flags(config: RunConfig, flags: Mapping[str, Any]) -> None:
    if config.reset.enabled and 2 * config.reset.window >= config.training.episodes:
        print_note(
            f"Reset-and-Finetune cannot help here: it needs more than two windows of "
            f"{config.reset.window} episodes, to learn after them; there are "
            f"{config.training.episodes}"
        )
    if "reset.kappa" in flags and not config.reset.enabled:
        print_note("--kappa has no effect: Reset-and-Finetune is off")


def _note_idle_keys(config: RunConfig, sources: Mapping[str, str]) -> None:
    """Tell of keys that were given and that DAgger does not heed."""
    if config.training.algorithm != "dagger":
        return
    for keys, reason in (
        (DRAWN, "DAgger draws them anew for every flight"),
        (_FOR_REWARDS, "DAgger learns from no rewards, and has a schedule of its own"),
    ):
        given = [
            f"--{FLAGS[key].name}" if key in FLAGS else key
            for key in keys
            if key in sources and not sources[key].startswith(("default", "preset ", "algorithm "))
        ]
        if given:
            print_note(f"without effect on the training: {', '.join(given)} ({reason})")


def _continuation(
    context: typer.Context, flags: Mapping[str, Any], path: Path
) -> tuple[Path, RunConfig]:
    """The run to continue, and its configuration, extended if more episodes are asked for."""
    given = [
        option
        for option, parameter in _OF_NEW_RUNS.items()
        if getattr(context.get_parameter_source(parameter), "name", "") == "COMMANDLINE"
    ]
    given += [f"--{FLAGS[key].name}" for key in flags if key != "training.episodes"]
    if given:
        raise InputError(
            f"--resume uses the run's own configuration, so {', '.join(given)} cannot be "
            f"given; --episodes can"
        )
    record = read_record(path)
    config = read_config(path, record)
    status, episodes = status_of(path, record), flags.get("training.episodes")
    planned = config.training.episodes
    if status == "running":
        raise InputError(f"run {name_of(path)} is still running")
    if episodes is not None and episodes < planned:
        raise InputError(f"--episodes {episodes} is fewer than the {planned} that were planned")
    if status == "completed" and episodes in (None, planned):
        raise InputError(
            f"run {name_of(path)} is complete; to extend it, give --episodes above {planned}"
        )
    if status == "completed" and not has_checkpoint(path):
        raise InputError(
            f"run {name_of(path)} is complete and has no checkpoint to continue from: "
            f"train a new one with --episodes {episodes}"
        )
    if episodes is not None and episodes > planned:
        extended = config.extended_to(episodes)
        print_note(
            f"extended from {planned} to {episodes} episodes: reward weights, entropy coefficient "
            f"and any decay of the learning rates stay constant from episode "
            f"{extended.training.schedule_episodes} on, so the result differs from that of a run "
            f"planned with {episodes} episodes"
        )
        config = extended
    _note_other_versions(record)
    return path, config


def _note_new_id(run: "RunDirectory") -> None:
    if run.renamed_from is not None:
        print_note(
            f"this is a copy of run {run.renamed_from}, or it was renamed: from now on its id is "
            f"{run.id}, the name of its directory"
        )


def _note_other_versions(record: RunRecord) -> None:
    now = describe_versions()
    changed = [
        f"{name} {record.versions.get(name)} -> {version}"
        for name, version in now.items()
        if record.versions.get(name) != version
    ]
    if changed:
        print_note(f"the run began with other versions: {', '.join(changed)}")


def _continuation_text(path: Path) -> str:
    return f"continue with: {shlex.join(resume_command(path))}"


def _after_failure(path: Path, error: RunFailedError) -> str:
    if isinstance(error.__cause__, ArithmeticError):
        return "it would fail again in the same way: start a new run with lower learning rates"
    return f"once the cause is fixed, {_continuation_text(path)}"


def _print_continuation(path: Path) -> None:
    print_line(console(stderr=True), _continuation_text(path))


def _print_outcome(out: Console, outcome: "TrainingOutcome") -> None:
    from orchid_uav.cli.progress.training import metric_texts
    from orchid_uav.experiments.runs.directory import FINAL_EPISODES

    rows = len(outcome.rows)
    if rows:
        final = {
            column: math.nan if value is None else value
            for column, value in outcome.run.record.final.items()
        }
        print_table(
            out,
            ["mean of the last episodes", str(min(rows, FINAL_EPISODES))],
            [[name, text] for name, text in metric_texts(final).items()],
        )
    resets = ", ".join(map(str, outcome.reset_episodes)) or "none"
    print_line(
        out,
        f"{outcome.status}: {rows} episodes in {outcome.seconds:.1f} s, "
        f"resets at episode: {resets}",
    )
    print_line(out, f"run directory: {outcome.run.path}")
