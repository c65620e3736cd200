"""What is trained for the paper's figures and claims, each by its ``orchid train`` command."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from orchid_uav.experiments.ablation.variants import CONTROLS, FROZEN, control
from orchid_uav.experiments.configuration import (
    FLAGS,
    Layer,
    RunConfig,
    assignment_layer,
    flatten,
    merge,
    preset_layer,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.methods import COMMANDS
from orchid_uav.suggestions import unknown

SEEDS = tuple(range(10, 20))
"""Training seeds of all verdicts. None of them was used for tuning, nor for a released policy."""
QUICK_SEEDS = SEEDS[:2]
QUICK_EPISODES, QUICK_WINDOW = 150, 15
"""Length of a quick run, and window W of its trigger."""

Flown = Literal["everything", "tcp", "walking", "base"]
"""What a policy is flown in: all settings of both distributions; all of TCP; the paper's network
with users that stay and that walk, and where Phase I errs; the paper's network alone."""


@dataclass(frozen=True)
class Training:
    """A method that is trained with every seed."""

    key: str
    arguments: tuple[str, ...]
    """Of ``orchid train``, without the seed."""
    purpose: str
    flown: Flown
    in_quick: bool = False

    def config(self, seed: int, is_quick: bool = False) -> RunConfig:
        """The configuration of the run with a seed."""
        own: dict[str, Any] = {"training.seed": seed}
        config = configured(self.arguments)
        if is_quick:
            own["training.episodes"] = QUICK_EPISODES
            own["reset.window"] = QUICK_WINDOW
        return merge([Layer(self.key, flatten(config)), Layer("seed", own)])[0]

    def command(self, seed: int) -> tuple[str, ...]:
        """The command line that trains the same run by itself."""
        return ("orchid", "train", *self.arguments, "--seed", str(seed), "--name", self.key)


def configured(arguments: Sequence[str]) -> RunConfig:
    """The configuration that ``orchid train`` makes of these arguments.

    Raises:
        InputError: an option is none of ``--preset``, ``--set``, ``--no-rf`` and those with a key.
    """
    presets: list[Layer] = []
    values: dict[str, Any] = {}
    assignments: list[str] = []
    keys = {f"--{flag.name}": key for key, flag in FLAGS.items()}
    remaining = iter(arguments)
    for option in remaining:
        if option == "--no-rf":
            values["reset.enabled"] = False
        elif option == "--preset":
            presets = [preset_layer(next(remaining))]
        elif option == "--set":
            assignments.append(next(remaining))
        elif option in keys:
            text = f"{keys[option]}={next(remaining)}"
            values |= assignment_layer([text], option).values
        else:
            raise InputError(unknown("option", option, keys))
    layers = [*presets, assignment_layer(assignments), Layer("options", values)]
    return merge(layers)[0]


_LONG = ("--episodes", "1000", "--set", "reset.max_resets=3")


def _controls(base: str, flown: Flown, keys: Iterable[str]) -> Iterator[Training]:
    """The controls of Reset-and-Finetune for a method."""
    config = configured(COMMANDS[base])
    for key in keys:
        values = control(key, config).values
        arguments = [word for name, value in values.items() for word in _assigned(name, value)]
        yield Training(f"{base}-{key}", (*COMMANDS[base], *arguments), CONTROLS[key], flown)


def _assigned(key: str, value: Any) -> tuple[str, str]:
    return "--set", f"{key}={str(value).lower() if isinstance(value, bool) else value}"


def _sensitivity(key: str, assignment: str, purpose: str) -> Training:
    return Training(f"orchid-{key}", ("--set", assignment), purpose, "base")


def _all() -> Iterator[Training]:
    def released(key: str, purpose: str, flown: Flown, in_quick: bool = False) -> Training:
        return Training(key, COMMANDS[key], purpose, flown, in_quick)

    no_rf = "the same without Reset-and-Finetune"
    yield released("orchid", "the paper's proposal", "everything", True)
    yield released("orchid-no-rf", no_rf, "everything", True)
    random_starts = "from random starts: the ablation of Phase I"
    yield released("orchid-random-init", random_starts, "everything", True)
    yield Training("orchid-long", _LONG, "max-min, 1,000 episodes, 3 resets", "base", True)
    yield released("orchid-pf", "proportional, 1,000 episodes, 3 resets", "everything", True)
    for key in ("maddpg-mmf", "maddpg-pf"):
        yield released(key, "MADDPG with the best recipe of its search", "everything", True)
    yield released("orchid-tuned", "orchid with the best recipe of its search", "tcp")
    for key in ("maddpg-mmf-paper", "maddpg-pf-paper"):
        yield released(key, "MADDPG with the paper's numbers", "tcp")
    yield from _controls("orchid", "base", (key for key in CONTROLS if key != FROZEN))
    yield from _controls("orchid", "base", (FROZEN,))
    yield _sensitivity("kappa-0.1", "reset.kappa=0.1", "κ of the paper's text instead of Table I's")
    informed = COMMANDS["orchid-informed"]
    yield Training("orchid-informed", informed, "where learning can move something", "walking")
    yield Training("orchid-informed-no-rf", (*informed, "--no-rf"), no_rf, "walking")
    rest = (key for key in CONTROLS if key != FROZEN)
    yield from _controls("orchid-informed", "walking", rest)
    uniform = ("--distribution", "uniform")
    yield Training("orchid-uniform", uniform, "trained on uniform users", "everything")
    yield Training("orchid-no-rf-uniform", (*uniform, "--no-rf"), no_rf, "everything")
    yield _sensitivity("shares-se", "network.shares=se", "shares that follow spectral efficiency")
    yield _sensitivity("shares-pf", "network.shares=pf", "equal shares with the max-min reward")
    for megahertz in (10, 20):
        what = f"{megahertz} MHz for all UAVs together instead of 10 for each"
        yield _sensitivity(f"{megahertz}mhz", f"network.total_bandwidth_hz={megahertz}e6", what)
    yield _sensitivity("n-init-10", "deployment.n_init=10", "the best of ten K-Means starts")
    for deviation in (-1, -2):
        what = f"exploration noise of e^{deviation} instead of 1"
        yield _sensitivity(f"log-std{deviation}", f"ppo.log_std_init={deviation}", what)


TRAININGS: Mapping[str, Training] = {training.key: training for training in _all()}
"""By key, in the order in which they are trained: what most claims need comes first."""
