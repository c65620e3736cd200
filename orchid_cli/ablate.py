"""``orchid ablate``."""

import json
import math
import shlex
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from orchid_uav.cli import completion
from orchid_uav.cli.commands import SEED
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
    print_next,
    print_note,
    print_warning,
    stdout_for_json_alone,
)
from orchid_uav.cli.options import (
    VARIANTS_PANEL,
    BaseFlags,
    ConfigOption,
    JobsOption,
    PresetOption,
    RayOption,
    VariantFlags,
    configuration,
    listed,
    option,
    with_flags,
)
from orchid_uav.cli.ranges import parse_counts
from orchid_uav.experiments.configuration import FLAGS, RunConfig
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.notices import show_on_stderr

if TYPE_CHECKING:
    from orchid_uav.experiments.ablation.result import AblationResult
    from orchid_uav.experiments.ablation.study import AblationStudy
    from orchid_uav.experiments.ablation.variants import Variant
    from orchid_uav.experiments.jobs.executor import Executor
    from orchid_uav.experiments.training.job import TrainingJob

_BASE, _STUDY = "Base", "Study"


@with_flags
def ablate(
    context: typer.Context,
    *,
    variants: VariantFlags,
    assignments: Annotated[
        list[str] | None,
        option(
            VARIANTS_PANEL,
            "section.key=value: a variant with this value; may be repeated.",
            "--set",
            autocompletion=completion.assignments,
        ),
    ] = None,
    controls: Annotated[
        str | None,
        option(
            VARIANTS_PANEL,
            "Controls for Reset-and-Finetune: all, or some of reset-only, decay-only, random-time, "
            "linear-decay, frozen.",
            "--controls",
            metavar="LIST",
        ),
    ] = None,
    preset: PresetOption = "paper",
    config: ConfigOption = None,
    base: Annotated[
        list[str] | None,
        option(
            _BASE,
            "section.key=value: a value of the base; may be repeated.",
            "--base",
            autocompletion=completion.assignments,
        ),
    ] = None,
    flags: BaseFlags,
    seeds: Annotated[str, option(_STUDY, "Training seeds (default: 0..9).")] = "0..9",
    topologies: Annotated[
        int,
        option(
            _STUDY,
            "Held-out topologies that every policy flies (default: 100).",
            min=1,
            max=100_000,
            metavar="N",
        ),
    ] = 100,
    evaluation_seed: Annotated[
        int, option(_STUDY, "Seed of the held-out topologies (default: 0).", **SEED)
    ] = 0,
    margin: Annotated[
        float,
        option(
            _STUDY,
            "Share of the base's mean below which a difference is negligible (default: 0.05).",
        ),
    ] = 0.05,
    jobs: JobsOption = None,
    ray: RayOption = None,
    out: Annotated[
        Path | None,
        option(OUTPUT_PANEL, "Directory of the study (default: ./orchid-ablate/TIME).", "--out"),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Train a base and its variants on the same seeds, fly them, and compare pair by pair.

    Ctrl-C stops and keeps the finished results; the same command with the same --out continues and
    does not train finished seeds again. Seeds and variants can be added to a study in the same way.

    Example: orchid ablate --no-rf --kappa 0.1,0.3 --seeds 0..4 --jobs 2
    """
    with failing_well(debug):
        show_on_stderr(with_notes=not quiet)
        from orchid_uav.experiments.ablation.variants import check_variants

        merged, _ = configuration(preset, config, base, flags, "--base")
        compared = _variants(merged, variants, assignments or [], controls)
        for note in check_variants(compared, merged):
            print_note(note)
        if not 0.0 < margin < math.inf:
            raise InputError(f"--margin {margin}: it must be a finite number above 0")
        seed_list = parse_counts(seeds, "--seeds", least=0)
        # torch and pyarrow take seconds to import, so the input is checked first.
        from orchid_uav.experiments.ablation.design import Ablation
        from orchid_uav.experiments.ablation.study import DEFAULT_PARENT, RUNS_FOLDER, AblationStudy
        from orchid_uav.experiments.evaluation.directory import make_default_directory
        from orchid_uav.experiments.jobs.choice import executor_for
        from orchid_uav.experiments.runs.records import expanded

        command = ["orchid", *context.obj]
        ablation = Ablation(merged, compared, seed_list, topologies, evaluation_seed, margin)
        shown = console(stderr=as_json)
        with closing(executor_for(jobs, ray)) as executor, stdout_for_json_alone(as_json):
            if executor.note:
                print_note(executor.note)
            directory = make_default_directory(DEFAULT_PARENT) if out is None else expanded(out)
            study = AblationStudy(ablation, directory, command)
            executor.check(directory)
            study.reserve()
            again = shlex.join([*command, *([] if out else ["--out", str(directory)])])
            try:
                document = _run(study, executor, shown, quiet, again)
            except RunFailedError as error:
                raise RunFailedError(f"{error}\ntry again with: {again}") from error
        if document is None:
            print_line(console(stderr=True), f"interrupted; continue with: {again}")
            raise typer.Exit(INTERRUPTED)
        if as_json:
            print(json.dumps(document.to_json(), allow_nan=False))
        else:
            from orchid_uav.cli.tables.ablation import print_ablation

            print_ablation(shown, document)
        print_line(shown, f"{document.status}: {directory}")
        if document.status == "failed":
            print_line(console(stderr=True), f"try the failed runs again with: {again}")
            raise typer.Exit(FAILED)
        if not (as_json or quiet):
            print_next(shown, "runs", "list", "--runs-dir", str(directory / RUNS_FOLDER))


def _variants(
    base: RunConfig, flags: Mapping[str, Any], assignments: list[str], controls: str | None
) -> list["Variant"]:
    from orchid_uav.experiments.ablation.variants import (
        CONTROLS,
        Variant,
        assigned,
        control,
        variants_of_values,
    )

    variants = []
    for key, value in flags.items():
        name = FLAGS[key].name
        if isinstance(value, str):
            variants += variants_of_values(name, key, listed(key, value))
        else:
            variants.append(Variant(name, {key: value}))
    variants += assigned(assignments)
    names = list(CONTROLS) if "all" in _words(controls) else _words(controls)
    return variants + [control(name, base) for name in names]


def _words(text: str | None) -> list[str]:
    return list(dict.fromkeys(word.strip() for word in text.split(","))) if text else []


def _run(
    study: "AblationStudy", executor: "Executor", shown: Console, quiet: bool, again: str
) -> "AblationResult | None":
    """Train and evaluate; return None if interrupted."""
    from orchid_uav.cli.progress.evaluation import evaluation_progress
    from orchid_uav.cli.progress.jobs import job_progress
    from orchid_uav.experiments.ablation.design import differing_worlds

    for name, keys in differing_worlds(study.ablation).items():
        print_note(f"{name} is flown in its own world, which differs in {', '.join(keys)}")
    document = None
    try:
        waiting = study.waiting()
        if not quiet:
            _announce(study, len(waiting), shown, again)
        costs = _costs(study, waiting, executor.processes, shown, quiet) if waiting else {}
        if study.train(executor, job_progress(shown, quiet), costs) != "interrupted":
            document = study.evaluate(evaluation_progress(shown, quiet))
    except KeyboardInterrupt:
        document = None
    if document is None:
        study.note_interruption()
    return document


def _announce(study: "AblationStudy", waiting: int, shown: Console, again: str) -> None:
    """Print what will be trained, and the command that continues the study if it stops."""
    names, seeds = list(study.ablation.configurations()), study.ablation.seeds
    total = len(study.training_jobs)
    print_line(shown, f"seeds {', '.join(map(str, seeds))}")
    print_line(
        shown,
        f"{', '.join(names)}: {len(names)} x {len(seeds)} seeds = {total} runs of "
        f"{study.ablation.base.training.episodes} episodes, {total - waiting} of them already done",
    )
    print_line(shown, f"if it stops, continue with: {again}")


def _costs(
    study: "AblationStudy",
    waiting: Sequence["TrainingJob"],
    processes: int,
    shown: Console,
    quiet: bool,
) -> dict[str, float]:
    """Estimate how long a run of each variant takes, in seconds."""
    from orchid_uav.experiments.ablation.calibration import seconds_per_episode
    from orchid_uav.experiments.jobs.workload import hours_text

    if not quiet:
        print_line(shown, "measuring how long a run takes ...")
    names = [job.name for job in waiting]
    costs = {}
    for name, config in study.ablation.configurations().items():
        if name in names:
            try:
                costs[name] = seconds_per_episode(config) * config.training.episodes
            except RunFailedError as error:
                print_warning(f"{name} is likely to fail: {error}")
                costs[name] = 1.0
    if not quiet:
        text = hours_text([costs[name] / 60.0 for name in names], processes)
        print_line(
            shown,
            f"about {text} with {processes} at once, if parallel runs are as fast as a single one",
        )
    return costs
