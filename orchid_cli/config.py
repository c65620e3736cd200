"""``orchid config``."""

import json
from typing import Annotated, Any

import typer

from orchid_uav.cli.commands import Commands
from orchid_uav.cli.console import (
    OUTPUT_PANEL,
    DebugOption,
    JsonOption,
    console,
    failing_well,
    print_next_on_terminal,
    print_note,
    print_table,
)
from orchid_uav.cli.options import (
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
from orchid_uav.envs.keys import unit_of, values_of
from orchid_uav.experiments.configuration import (
    RunConfig,
    field_of,
    flatten,
    merge,
    preset_layer,
)

app = Commands()


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
    changed: Annotated[
        bool,
        typer.Option(
            "--changed",
            help="Only what differs from the preset, with what it would be there.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = False,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Print the merged configuration with units, ranges and where each value came from.

    With --json alone the document can be used as a --config file. docs/configuration.md says of
    every key what it means.

    Example: orchid config show --config lab.toml --uavs 8 --changed
    """
    with failing_well(debug):
        merged, sources = configuration(context)
        if changed:
            _show_changes(merged, sources, preset, as_json)
            return
        if as_json:
            print(json.dumps(merged.model_dump(mode="json"), allow_nan=False))
            return
        print_table(
            console(),
            ["key", "value", "unit", "values", "from"],
            [
                [key, _text(value), unit_of(key), values_of(field_of(key)), sources[key]]
                for key, value in flatten(merged).items()
            ],
            wraps_last=True,
        )
        given = [argument for argument in context.obj[2:] if argument != "--changed"]
        print_next_on_terminal("train", *given)


def _show_changes(config: RunConfig, sources: dict[str, str], preset: str, as_json: bool) -> None:
    usual = flatten(merge([preset_layer(preset)])[0])
    changes = [
        {
            "key": key,
            "value": value,
            "preset": usual[key],
            "unit": unit_of(key),
            "from": sources[key],
        }
        for key, value in flatten(config).items()
        if value != usual[key]
    ]
    if as_json:
        document = {"schema": 1, "preset": preset, "changed": changes}
        print(json.dumps(document, allow_nan=False))
        return
    if not changes:
        print_note(f"nothing differs from preset {preset}")
    print_table(
        console(),
        ["key", "value", f"preset {preset}", "unit", "from"],
        [
            [one["key"], _text(one["value"]), _text(one["preset"]), one["unit"], one["from"]]
            for one in changes
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
        return ",".join(map(_text, value))  # as --set takes them
    return str(value)
