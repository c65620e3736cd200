"""The world that methods are flown in, from a command line."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from orchid_uav.cli.console import print_note
from orchid_uav.experiments.configuration import (
    LEARNING_SECTIONS,
    SETTING_KEYS,
    Layer,
    RunConfig,
    assignment_layer,
    file_layer,
    flatten,
    merge,
)
from orchid_uav.experiments.errors import InputError

if TYPE_CHECKING:
    from orchid_uav.experiments.evaluation.methods import Contender


def world_of(
    config: Path | None,
    assignments: list[str],
    below: Iterable[Layer] = (),
    above: Iterable[Layer] = (),
) -> RunConfig:
    """Merge a file and assignments, between other layers.

    Raises:
        InputError: a key is unknown, does not fit, or has no effect on a world.
    """
    from orchid_uav.experiments.evaluation.methods import METHOD_KEYS

    layers: list[Layer] = [] if config is None else [file_layer(config, print_note)]
    given = assignment_layer(assignments)
    for key in given.values:
        if key in SETTING_KEYS:
            raise InputError(f"--set {key}: use {SETTING_KEYS[key]}")
        if key in METHOD_KEYS:
            raise InputError(f"--set {key}: each method sets this itself; see --methods")
        if key.partition(".")[0] in LEARNING_SECTIONS:
            raise InputError(f"--set {key}: nothing is trained here, so it would have no effect")
    merged, sources = merge([*below, *layers, given, *above])
    idle = [
        key
        for key, source in sources.items()
        if source == str(config)
        and flatten(merged)[key] != flatten(RunConfig())[key]
        and (key in METHOD_KEYS or key.partition(".")[0] in LEARNING_SECTIONS)
    ]
    if idle:
        print_note(f"these keys of {config} have no effect here: {', '.join(idle)}")
    return merged


def tell_differences(contenders: Sequence["Contender"], world: RunConfig) -> None:
    """Print notes on runs that were interrupted, or trained in another world."""
    from orchid_uav.experiments.evaluation.flights import world_differences

    told: set[str] = set()
    for contender in contenders:
        policy = contender.policy
        if policy is not None and policy.run not in told:
            told.add(policy.run)
            if not policy.is_complete:
                done, wanted = policy.episodes, policy.config.training.episodes
                print_note(f"run {policy.run} was interrupted after {done} of {wanted} episodes")
            differing = world_differences(policy, world)
            if differing:
                print_note(f"{contender.key} was trained in another world: {', '.join(differing)}")
