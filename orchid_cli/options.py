"""The flags that make up a configuration, shared by all commands that take one."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from orchid_uav.cli import completion
from orchid_uav.cli.console import print_note
from orchid_uav.experiments.configuration import (
    FLAGS,
    Layer,
    RunConfig,
    assignment_layer,
    file_layer,
    merge,
    preset_layer,
)

_FILES, _NETWORK, _LEARNING = "Configuration", "Network", "Learning"


def _option(panel: str, text: str, *names: str, **more: Any) -> Any:
    return typer.Option(*names, help=text, rich_help_panel=panel, show_default=False, **more)


PresetOption = Annotated[str, _option(_FILES, "Built-in configuration to begin with: paper.")]
ConfigOption = Annotated[
    Path | None, _option(_FILES, "TOML or JSON file or pipe, applied over the preset.", "--config")
]
SetOption = Annotated[
    list[str] | None,
    _option(
        _FILES,
        "section.key=value, over the file; may be repeated; lists as 1,2,3.",
        "--set",
        autocompletion=completion.assignments,
    ),
]
UavsOption = Annotated[int | None, _option(_NETWORK, "UAVs (paper: 6).")]
UsersOption = Annotated[int | None, _option(_NETWORK, "Ground users (paper: 100).")]
DistributionOption = Annotated[
    Literal["tcp", "uniform"] | None, _option(_NETWORK, "Where users are (paper: tcp).")
]
InitOption = Annotated[
    Literal["kmeans", "random"] | None, _option(_NETWORK, "Where UAVs start (paper: kmeans).")
]
ObjectiveOption = Annotated[
    Literal["mmf", "pf"] | None,
    _option(_NETWORK, "Rate term of the reward, and bandwidth shares (paper: mmf)."),
]
SharesOption = Annotated[
    Literal["mmf", "pf", "se"] | None,
    _option(_NETWORK, "Bandwidth shares alone (default: the objective's)."),
]
EpisodesOption = Annotated[int | None, _option(_LEARNING, "Training episodes (paper: 700).")]
SeedOption = Annotated[int | None, _option(_LEARNING, "Seed (default: 0).")]
WorldsOption = Annotated[
    int | None, _option(_LEARNING, "Worlds flown side by side (default: 1); same sample budget.")
]
AlgorithmOption = Annotated[
    Literal["mappo", "maddpg"] | None, _option(_LEARNING, "Learning algorithm (default: mappo).")
]
KappaOption = Annotated[
    float | None, _option(_LEARNING, "Factor on the learning rates at a reset (paper: 0.5).")
]
NoResetOption = Annotated[bool, _option(_LEARNING, "Without Reset-and-Finetune.", "--no-rf")]


def layers_of(given: Mapping[str, Any], assignments: Layer, flags: Iterable[str]) -> list[Layer]:
    """Preset < file < assignments < named flags, of the parameters given to a command."""
    layers = [preset_layer(given["preset"])]
    if given["config"] is not None:
        # typer before 0.29 leaves it a str
        layers.append(file_layer(Path(given["config"]), print_note))
    layers.append(assignments)
    layers += [
        Layer(f"--{name}", {FLAGS[name]: given[name]}) for name in flags if given[name] is not None
    ]
    return layers


def configuration(context: typer.Context) -> tuple[RunConfig, dict[str, str]]:
    """Preset < file < --set < flags as given to the command, and each value's source by its key."""
    given = context.params
    layers = layers_of(given, assignment_layer(given["assignments"] or []), FLAGS)
    if given["no_rf"]:
        layers.append(Layer("--no-rf", {"reset.enabled": False}))
    return merge(layers)
