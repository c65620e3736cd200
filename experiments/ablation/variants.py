"""What is compared in an ablation: a base, and variants that differ from it."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from orchid_uav.experiments.configuration import (
    Layer,
    RunConfig,
    assignment_layer,
    flatten,
    merge,
    reward_differences,
    spare_uavs_note,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.suggestions import unknown

BASE = "base"
FROZEN = "frozen"


class Variant(NamedTuple):
    """Some values that differ from the base's."""

    name: str
    values: Mapping[str, Any]
    """The values, by ``"section.key"``."""


CONTROLS: dict[str, str] = {
    "reset-only": "clears the optimizer at the plateau, and leaves the learning rates",
    "decay-only": "lowers the learning rates at the plateau, and leaves the optimizer",
    "random-time": "does both at an episode drawn at random",
    "linear-decay": "no reset; the learning rates fall linearly to the same last value",
    FROZEN: "learns nothing: how often the trigger fires on a policy that does not change",
}
"""What else could explain an effect of Reset-and-Finetune, by the control that tests it."""
_LONGEST_NAME = 48


def control(name: str, base: RunConfig) -> Variant:
    """Return a control for Reset-and-Finetune.

    Raises:
        InputError: the control is unknown, or the base does not use Reset-and-Finetune.
    """
    if name not in CONTROLS:
        raise InputError(unknown("control", name, CONTROLS, cutoff=0.4))
    if not base.reset.enabled:
        raise InputError(f"control '{name}': the base has no Reset-and-Finetune")
    from orchid_uav.callbacks.reset_and_finetune import LOWEST_RATE_SCALE  # torch takes seconds

    last_scale = max(base.reset.kappa**base.reset.max_resets, LOWEST_RATE_SCALE)
    last_scale *= base.training.final_learning_rate_scale
    rates = f"{'maddpg' if base.training.algorithm == 'maddpg' else 'ppo'}.{{}}_learning_rate"
    values: dict[str, dict[str, Any]] = {
        "reset-only": {"reset.kappa": 1.0},
        "decay-only": {"reset.clear_optimizer": False},
        "random-time": {"reset.trigger": "random"},
        "linear-decay": {
            "reset.enabled": False,
            "training.final_learning_rate_scale": last_scale,
        },
        FROZEN: {
            "reset.enabled": False,
            rates.format("actor"): 0.0,
            rates.format("critic"): 0.0,
        },
    }
    return Variant(name, values[name])


def variants_of_values(option: str, key: str, values: Iterable[Any]) -> list[Variant]:
    """A variant for each value of one key, named after the option and the value."""
    return [Variant(_name(f"{option}-{value}"), {key: value}) for value in values]


def assigned(assignments: Sequence[str]) -> list[Variant]:
    """A variant for each ``section.key=value``."""
    return [
        Variant(_name(assignment), assignment_layer([assignment]).values)
        for assignment in assignments
    ]


def _name(text: str) -> str:
    """The text as part of a run's id. A minus is kept, so that -1 and 1 have different names."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._")[:_LONGEST_NAME] or "variant"


def apply_variant(variant: Variant, base: RunConfig) -> RunConfig:
    """The configuration of a variant.

    Raises:
        InputError: a key is unknown or a value does not fit.
    """
    own = Layer(f"variant {variant.name}", variant.values)
    return merge([Layer("base", flatten(base)), own])[0]


def check_variants(variants: Sequence[Variant], base: RunConfig) -> list[str]:
    """Check variants and return notes on them, a line each.

    Raises:
        InputError: there is no variant, one equals the base or another one, two have the same
            name, or values do not fit.
    """
    if not variants:
        raise InputError(
            "there is nothing to compare: name a variant, such as --no-rf or --init random"
        )
    notes = []
    first = 2 * base.reset.window
    if base.reset.enabled and first >= base.training.episodes:
        notes.append(
            f"Reset-and-Finetune needs two windows, {first} episodes, and something to learn "
            f"after them: in {base.training.episodes} it changes nothing"
        )
    if spare_uavs := spare_uavs_note(base):
        notes.append(spare_uavs)
    known = {BASE: base}
    for variant in variants:
        config = apply_variant(variant, base)
        if variant.name in known:
            raise InputError(f"two variants are called '{variant.name}': leave one of them out")
        if config.training.seed != base.training.seed:
            raise InputError("training.seed cannot be varied: see --seeds")
        for name, other in known.items():
            if config == other:
                same = "the base" if name == BASE else f"variant '{name}'"
                raise InputError(f"variant '{variant.name}' is the same as {same}: leave it out")
        known[variant.name] = config
        notes += [f"variant '{variant.name}': {note}" for note in _notes(variant, config, base)]
    return notes


def _notes(variant: Variant, config: RunConfig, base: RunConfig) -> Iterator[str]:
    if "reset.kappa" in variant.values and not config.reset.enabled:
        yield "Reset-and-Finetune is off, so kappa has no effect"
    if "training.algorithm" in variant.values and config.reset.enabled:
        yield "Reset-and-Finetune stays on, as in the base"
    spare_uavs = spare_uavs_note(config)
    if spare_uavs and spare_uavs != spare_uavs_note(base):
        yield spare_uavs
    if keys := reward_differences([flatten(base), flatten(config)]):
        yield (
            f"its reward function is not the base's ({', '.join(keys)}), so rewards do not compare"
        )
