"""``orchid config``."""

import json
from typing import Any

import typer

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
from orchid_uav.cli.console import DebugOption, JsonOption, console, failing_well, print_table
from orchid_uav.experiments.configuration import flatten, unit_of

app = typer.Typer()


@app.callback(invoke_without_command=True)
def _commands(context: typer.Context) -> None:
    """Look at configurations."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command()
def show(
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
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Print the merged configuration with units and where each value came from.

    With --json the document can be used as a --config file. docs/configuration.md describes every
    key with its range.

    Example: orchid config show --config lab.toml --set uav.max_speed_mps=20
    """
    with failing_well(debug):
        merged, sources = configuration(context)
        if as_json:
            print(json.dumps(merged.model_dump(mode="json"), allow_nan=False))
            return
        print_table(
            console(),
            ["key", "value", "unit", "from"],
            [
                [key, _text(value), unit_of(key), sources[key]]
                for key, value in flatten(merged).items()
            ],
        )


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    if isinstance(value, list):
        return json.dumps(value)
    return str(value)
