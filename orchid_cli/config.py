"""``orchid config``."""

import json
from typing import Annotated

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
    ConfigOption,
    PresetOption,
    RunFlags,
    SetOption,
    configuration,
    text_of,
    with_flags,
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
    """Show configurations."""
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command()
@with_flags
def show(
    context: typer.Context,
    *,
    preset: PresetOption = "paper",
    config: ConfigOption = None,
    assignments: SetOption = None,
    flags: RunFlags,
    changed: Annotated[
        bool,
        typer.Option(
            "--changed",
            help="Show only values that differ from the preset, beside the preset's.",
            rich_help_panel=OUTPUT_PANEL,
        ),
    ] = False,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Print the merged configuration with units, ranges and where each value came from.

    The output of --json without --changed can be used as a --config file. docs/configuration.md
    explains every key.

    Example: orchid config show --config lab.toml --uavs 8 --changed
    """
    with failing_well(debug):
        merged, sources = configuration(preset, config, assignments, flags)
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
                [key, text_of(value), unit_of(key), values_of(field_of(key)), sources[key]]
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
            [one["key"], text_of(one["value"]), text_of(one["preset"]), one["unit"], one["from"]]
            for one in changes
        ],
    )
