"""The configuration of a run: its sections, and how presets, files and flags are merged."""

import json
import tomllib
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import Field, ValidationError, model_validator
from pydantic.fields import FieldInfo

from orchid_uav.envs.keys import (
    Flag,
    Pair,
    Section,
    Weight,
    by_key,
    describe_error,
    fields_by_key,
    flag_of,
    holds_several,
    in_sections,
    may_hold_several,
    with_current_keys,
    within,
)
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.configuration_files import read_configuration
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.presets import ALGORITHM_DEFAULTS, PRESETS
from orchid_uav.suggestions import unknown

Fraction = Annotated[float, within(0.0, 1.0)]
LearningRate = Annotated[float, within(0.0, 1e40)]
"""Any finite number: a rate that is too high ends its run with a message of its own."""
LayerSizes = Annotated[
    tuple[Annotated[int, within(1, 4096)], ...], Field(min_length=1, max_length=16)
]
"""Limited to the largest networks that :func:`orchid_uav.agents.load_policy` reads."""
GradientNorm = Annotated[float, within(1e-12, 1e12)]
AdamEpsilon = Annotated[float, within(1e-30, 1.0)]
Tolerance = Annotated[float, within(1e-15, 1e12)]
Episodes = Annotated[int, within(1, 1_000_000_000)]


class PpoParameters(Section):
    """MAPPO."""

    actor_learning_rate: LearningRate = 1e-4
    """Learning rate eta_actor of the actor; if both rates are 0 the policy never changes."""
    critic_learning_rate: LearningRate = 1e-3
    """Learning rate eta_critic of the critic."""
    discount: Fraction = 0.99
    """Discount factor gamma_df."""
    gae_lambda: Fraction = 0.95
    """Parameter lambda_GAE of the advantage estimation."""
    clip_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.2
    """Clip ratio epsilon_clip."""
    batch_size: Annotated[int, within(2, 10_000_000)] = 128
    """Rows or slots per gradient step, as `ppo.minibatch` says."""
    minibatch: Literal["rows", "slots"] = "slots"
    """What a batch counts: `rows`, a step of one UAV each, or `slots`, a step of all UAVs (M34)."""
    epochs: Annotated[int, within(1, 10_000)] = 4
    """Passes over each rollout."""
    entropy_coef: Pair = (0.01, 0.0)
    """Entropy coefficient c_e at training progress 0 and 1."""
    value_coef: Weight = 0.5
    """Weight of the value loss (M31)."""
    max_grad_norm: GradientNorm = 0.5
    """Greatest gradient norm, for actor and critic separately (M31)."""
    hidden_sizes: LayerSizes = (256, 256, 256)
    """Hidden layers of actor and critic."""
    log_std_init: Annotated[float, within(-50.0, 50.0)] = 0.0
    """Initial value of the actor's log standard deviation (M31)."""
    adam_epsilon: AdamEpsilon = 1e-5
    """Adam's epsilon (M31)."""


class MaddpgParameters(Section):
    """MADDPG; what the paper does not give is decision M32."""

    actor_learning_rate: LearningRate = 1e-4
    """Learning rate of the actor, the same as eta_actor."""
    critic_learning_rate: LearningRate = 1e-3
    """Learning rate of the critic, the same as eta_critic."""
    discount: Fraction = 0.99
    """Discount factor gamma_df."""
    batch_size: Annotated[int, within(2, 10_000_000)] = 128
    """Transitions per update; one transition is one step of the whole fleet."""
    buffer_size: Annotated[int, within(2, 10_000_000)] = 100_000
    """Transitions of the whole fleet that are kept for replay (M32)."""
    target_rate: Annotated[float, Field(gt=0, le=1)] = 0.01
    """Share by which the target networks move towards the networks at each update (M32)."""
    exploration_std: Annotated[float, within(0.0, 1000.0)] = 0.1
    """Standard deviation of the Gaussian noise on actions in [-1, 1] (M32)."""
    update_every_slots: Annotated[int, within(1, 1_000_000)] = 4
    """Slots from one update to the next (M32)."""
    preactivation_penalty: Weight = 1e-3
    """Weight, in the actor's loss, of its squared output before tanh (as in Lowe et al.'s code)."""
    max_grad_norm: GradientNorm = 0.5
    """Greatest gradient norm, for actor and critic separately."""
    hidden_sizes: LayerSizes = (256, 256, 256)
    """Hidden layers of actor and critic."""
    adam_epsilon: AdamEpsilon = 1e-5
    """Adam's epsilon."""

    @model_validator(mode="after")
    def _buffer_holds_a_batch(self) -> "MaddpgParameters":
        if self.buffer_size < self.batch_size:
            raise ValueError(
                f"buffer_size is {self.buffer_size}, less than batch_size = {self.batch_size}"
            )
        return self


class DaggerParameters(Section):
    """Imitation of best response by DAgger; an iteration counts as an episode (M43)."""

    learning_rate: tuple[LearningRate, LearningRate] = (1e-3, 5e-5)
    """Learning rate at training progress 0 and 1, geometric in between."""
    batch_size: Annotated[int, within(1, 10_000_000)] = 2048
    """Examples of a gradient step."""
    gradient_steps: Annotated[int, within(1, 1_000_000)] = 60
    """Gradient steps of an iteration."""
    label_every_slots: Annotated[int, within(1, 1_000_000)] = 3
    """Slots from one question to the teacher to the next."""
    examples: Annotated[int, within(1, 100_000_000)] = 400_000
    """Newest examples that are kept."""
    decisiveness: Annotated[float, within(0.01, 100.0)] = 2.5
    """Factor on the policy's output before tanh in flight; learning alone makes it hesitate."""
    hidden_sizes: LayerSizes = (192, 192)
    """Hidden layers of the policy."""

    @model_validator(mode="after")
    def _learns(self) -> "DaggerParameters":
        if min(self.learning_rate) <= 0.0:
            raise ValueError("learning_rate is 0, from which it cannot change geometrically")
        return self


class ResetParameters(Section):
    """Reset-and-Finetune."""

    enabled: Annotated[bool, Flag("no-rf", "method", help="Train without Reset-and-Finetune.")] = (
        True
    )
    """Whether Reset-and-Finetune is used."""
    window: Episodes = 50
    """Episodes W in each of the two windows that are compared."""
    tolerance_jfi: Tolerance = 0.05
    """Relative change of the rate JFI below which it is on a plateau."""
    tolerance_reward: Tolerance = 0.05
    """Relative change of the reward below which it is on a plateau."""
    kappa: Annotated[float, Field(gt=0, le=1), Flag("kappa", "method", "0.1,0.5")] = 0.5
    """Factor by which a reset multiplies both learning rates (M1)."""
    max_resets: Annotated[int, within(1, 1_000_000)] = 1
    """Greatest number of interventions (M22)."""
    trigger: Literal["plateau", "random"] = "plateau"
    """When it intervenes; `random`, a control, draws the episodes before training."""
    clear_optimizer: bool = True
    """Whether a reset clears Adam's moments; if not (a control), it only lowers the rates."""


class CheckpointParameters(Section):
    """Saved states from which a run can continue."""

    every_episodes: Episodes = 50
    """Episodes from one checkpoint to the next."""
    keep: Annotated[int, within(1, 1000)] = 3
    """Number of latest checkpoints that are kept."""


class TrainingParameters(Section):
    """The length, seed and algorithm of a training."""

    algorithm: Annotated[Literal["mappo", "maddpg", "dagger"], Flag("algorithm")] = "mappo"
    """Learning algorithm; `maddpg` uses Reset-and-Finetune only if `reset.enabled` is set."""
    episodes: Annotated[Episodes, Flag("episodes")] = 700
    """Number E_max of training episodes."""
    seed: Annotated[int, within(0, 2**32 - 1), Flag("seed")] = 0
    """Seed of topologies, weights and exploration."""
    worlds: Annotated[int, within(1, 100_000), Flag("worlds")] = 1
    """Worlds flown in parallel; an update follows when each has flown one episode."""
    schedule_episodes: Episodes | None = None
    """Episodes over which training progress grows from 0 to 1; none means all episodes (M9)."""
    final_learning_rate_scale: Fraction = 1.0
    """Factor on both learning rates at training progress 1, reached linearly; 1 keeps them."""
    center_rewards: bool = False
    """Whether learning sees rewards less their running mean, so that values stay small (M37)."""
    threads: Annotated[int, within(1, 256)] = 1
    """Threads that PyTorch uses; one is fastest for networks of this size."""


class RunConfig(Parameters):
    """Everything that defines a run: the network, and how it is learned."""

    ppo: PpoParameters = PpoParameters()
    """MAPPO."""
    maddpg: MaddpgParameters = MaddpgParameters()
    """MADDPG."""
    dagger: DaggerParameters = DaggerParameters()
    """Imitation."""
    reset: ResetParameters = ResetParameters()
    """Reset-and-Finetune."""
    checkpoint: CheckpointParameters = CheckpointParameters()
    """Saved states."""
    training: TrainingParameters = TrainingParameters()
    """Episodes, seed, algorithm."""

    @model_validator(mode="after")
    def _enough_samples(self) -> "RunConfig":
        network = self.network
        if network.uav_count * network.episode_slots * self.training.worlds < 2:
            raise ValueError(
                "one UAV, world and slot (network.episode_slots) make a rollout of one sample, "
                "and at least 2 are needed"
            )
        return self

    @model_validator(mode="after")
    def _imitates_what_it_can(self) -> "RunConfig":
        if self.training.algorithm == "dagger":
            if self.uav.flight != "station":
                raise ValueError("algorithm = dagger imitates a rule that needs flight = station")
            if self.reset.enabled:
                raise ValueError("algorithm = dagger has no Reset-and-Finetune")
        return self

    @property
    def network_parameters(self) -> Parameters:
        """The part of the configuration that the simulator needs."""
        return Parameters.model_validate(self.model_dump(include=set(Parameters.model_fields)))

    def extended_to(self, episodes: int) -> "RunConfig":
        """The configuration with more episodes, in which all schedules keep their last values."""
        training = self.training
        changes = {
            "episodes": episodes,
            "schedule_episodes": training.schedule_episodes or training.episodes,
        }
        return self.model_copy(update={"training": training.model_copy(update=changes)})


def as_read_before(sections: Mapping[str, Any]) -> dict[str, Any]:
    """Sections of a configuration as earlier versions read them.

    ``ppo.batch_size`` counted rows when there was no ``ppo.minibatch`` to say of what (M34), so it
    does where a file gives the one without the other.
    """
    read = dict(sections)
    ppo = read.get("ppo")
    if isinstance(ppo, Mapping) and "batch_size" in ppo:
        read["ppo"] = {"minibatch": "rows", **ppo}
    return read


LEARNING_SECTIONS = tuple(RunConfig.model_fields)[len(Parameters.model_fields) :]
"""Sections on learning; the others define the world."""


class Layer(NamedTuple):
    """Some values of a configuration and where they come from."""

    source: str
    values: Mapping[str, Any]
    """By ``"section.key"``."""


_FIELDS = fields_by_key(RunConfig)


def configuration_keys() -> list[str]:
    """All keys as ``"section.key"``, in order."""
    return list(_FIELDS)


def field_of(key: str) -> FieldInfo:
    """The field of a key ``"section.key"``."""
    return _FIELDS[key]


FLAGS: dict[str, Flag] = {
    key: flag for key in configuration_keys() if (flag := flag_of(field_of(key)))
}
"""Command-line options, by the key that each sets."""
SETTING_KEYS = {key: f"--{flag.name}" for key, flag in FLAGS.items() if flag.varies == "world"}
"""Keys that a setting of an evaluation decides, and the options that list them."""

_OTHER_NAMES = {
    name: key
    for key, flag in FLAGS.items()
    for name in (flag.name.replace("-", "_"), flag.name.removesuffix("s"))
} | {"speed_mps": "network.user_speed_mps"}
"""Names that keys have elsewhere, on the command line and in Python."""
_LISTS = {key for key in configuration_keys() if holds_several(field_of(key))}
_PERHAPS_LISTS = {key for key in configuration_keys() if may_hold_several(field_of(key))}


def flatten(config: Parameters) -> dict[str, Any]:
    """Values by ``"section.key"``."""
    return by_key(config.model_dump(mode="json"))


def preset_layer(name: str) -> Layer:
    """A built-in preset."""
    if name not in PRESETS:
        raise InputError(_unknown("preset", name, PRESETS))
    return Layer(f"preset {name}", _by_dotted_key(PRESETS[name].sections, f"preset {name}"))


def file_layer(
    path: Path,
    say: Callable[[str], object] = warnings.warn,
    model: type[Parameters] = RunConfig,
) -> Layer:
    """A TOML or JSON file with the sections of a model, or a pipe: :func:`read_configuration`."""
    kind, text = read_configuration(path, say)
    try:
        nested = tomllib.loads(text) if kind == "toml" else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"configuration {path} is not valid {kind}: {error}") from error
    if isinstance(nested, Mapping):
        nested = as_read_before(nested)
    return Layer(str(path), _by_dotted_key(nested, str(path), model))


def assignment_layer(assignments: Iterable[str], option: str = "--set") -> Layer:
    """Assignments ``section.key=value`` from the command line.

    A value is written as in JSON or as a plain word; a list as in JSON or separated by commas.
    """
    values: dict[str, Any] = {}
    for assignment in assignments:
        key, separator, text = assignment.partition("=")
        if not separator:
            raise InputError(f"{option} {assignment} is not of the form section.key=value")
        key, text = key.strip(), text.strip()
        is_list = key in _LISTS or ("," in text and key in _PERHAPS_LISTS)
        takes_list = is_list and not text.startswith("[")
        parts = text.split(",") if text else []
        values[key] = [_parse(part.strip()) for part in parts] if takes_list else _parse(text)
    return Layer(option, _with_current_keys(values, option))


def merge(layers: Iterable[Layer]) -> tuple[RunConfig, dict[str, str]]:
    """Merge layers, of which later ones win; also return the source of every value by its key.

    Raises:
        InputError: a key is unknown or a value does not fit; the message says what would.
    """
    given = list(layers)
    return merge_into(RunConfig, [*_algorithm_layers(given), *given])


Model = TypeVar("Model", bound=Parameters)


def merge_into(model: type[Model], layers: Iterable[Layer]) -> tuple[Model, dict[str, str]]:
    """:func:`merge` for any model that consists of the network's sections and others."""
    keys = list(fields_by_key(model))
    values: dict[str, Any] = {}
    sources = dict.fromkeys(keys, "default")
    for layer in layers:
        for key, value in _with_current_keys(layer.values, layer.source).items():
            if key not in sources:
                raise InputError(f"{_unknown('key', key, keys)} (from {layer.source})")
            values[key] = value
            sources[key] = layer.source
    try:
        return model.model_validate(in_sections(values)), sources
    except ValidationError as error:
        raise InputError(_describe(error, sources, model)) from error


def _algorithm_layers(layers: Iterable[Layer]) -> list[Layer]:
    chosen = [
        layer.values["training.algorithm"]
        for layer in layers
        if "training.algorithm" in layer.values
    ]
    if not chosen or not isinstance(chosen[-1], str) or chosen[-1] not in ALGORITHM_DEFAULTS:
        return []
    return [Layer(f"algorithm {chosen[-1]}", ALGORITHM_DEFAULTS[chosen[-1]])]


def _parse(text: str) -> Any:
    if text.lower() == "none":
        return None
    try:
        return json.loads(text)
    except ValueError:
        return text


def _by_dotted_key(nested: Any, source: str, model: type[Parameters] = RunConfig) -> dict[str, Any]:
    if not isinstance(nested, Mapping):
        raise InputError(f"{source} does not consist of sections")
    flat: dict[str, Any] = {}
    for section, fields in nested.items():
        if section not in model.model_fields:
            raise InputError(f"{_unknown('section', section, model.model_fields)} in {source}")
        if not isinstance(fields, Mapping):
            raise InputError(f"'{section}' in {source} is not a section with keys")
        flat |= {f"{section}.{key}": value for key, value in by_key(fields).items()}
    return flat


def _with_current_keys(values: Mapping[str, Any], source: str) -> dict[str, Any]:
    try:
        return with_current_keys(values)
    except ValueError as error:
        raise InputError(f"{error} (from {source})") from error


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    candidates = list(known)
    field = name.rpartition(".")[2]  # the field may be right and only its section wrong or missing
    near = [key for key in candidates if key.rpartition(".")[2] == field]
    flag = field.lstrip("-").replace("-", "_").lower()
    if not near and kind != "preset" and flag in _OTHER_NAMES:
        near = [_OTHER_NAMES[flag]]
    return unknown(kind, name, candidates, near=near)


def _describe(error: ValidationError, sources: Mapping[str, str], model: type[Parameters]) -> str:
    key, message = describe_error(error, model)
    if key not in sources:  # a rule about several values
        changed = [f"{name} ({source})" for name, source in sources.items() if source != "default"]
        return message + (f"; set here: {', '.join(changed)}" if changed else "")
    return f"{message} (from {sources[key]})"


_REWARDED = {
    "network.episode_slots",
    "network.subband_bandwidth_hz",
    "network.total_bandwidth_hz",
    "uav.min_altitude_m",
    "uav.max_speed_mps",
    "uav.min_separation_m",
    "uav.max_transmit_power_w",
    "training.schedule_episodes",
}
"""Keys outside of `reward`, `rotor` and `channel` that the reward function depends on."""


def reward_differences(configurations: Sequence[Mapping[str, Any]]) -> list[str]:
    """Keys that make the rewards of runs different functions, so that they cannot be compared.

    These are the weights, the penalties and the objective; what EE_max (M7) and R_hi (M13) depend
    on; what counts as served, too close or weakly connected; and the numbers of slots and episodes
    that sums and schedules run over. Shares, sizes and speeds change the result, but not how it is
    rewarded.

    Args:
        configurations: the values of each run, by ``"section.key"``.
    """
    rewards_log_rates = any(one.get("reward.objective") == "pf" for one in configurations)
    divides_bandwidth = any(one.get("network.total_bandwidth_hz") for one in configurations)

    def is_rewarded(key: str) -> bool:
        section, _, name = key.partition(".")
        match section:
            case "reward":
                idle = () if rewards_log_rates else ("log_rate_floor_bps",)
                return name not in idle
            case "rotor":
                return name not in ("climb_power", "mass_kg")
            case "channel":
                return True
        return key in _REWARDED or (key == "network.uav_count" and divides_bandwidth)

    def of(one: Mapping[str, Any], key: str) -> Any:
        if key == "training.schedule_episodes":
            return one.get(key) or one.get("training.episodes")
        return one.get(key)

    given = (key for one in configurations for key in one if is_rewarded(key))
    keys = dict.fromkeys([*given, "training.schedule_episodes"])
    return [key for key in keys if len({repr(of(one, key)) for one in configurations}) > 1]


def spare_uavs_note(parameters: Parameters) -> str | None:
    """A note if users stand at fewer places than Phase I makes clusters (M36), else None."""
    network, masts = parameters.network, len(parameters.gbs_positions_m)
    are_points = network.distribution == "tcp" and network.scatter_std_m == 0.0
    clusters = network.uav_count + masts
    if not are_points or network.sensing_error_std_m > 0.0 or network.hotspot_count >= clusters:
        return None
    if network.hotspot_count <= masts:
        where = "one place" if masts == 1 else f"{network.hotspot_count} places at most"
        return f"all users stand at {where}, which Phase I gives to the GBS: UAVs serve nobody"
    return (
        f"users stand at {network.hotspot_count} places at most, fewer than the {clusters} "
        f"clusters of Phase I: {clusters - network.hotspot_count} or more of the "
        f"{network.uav_count} UAVs share the users of others"
    )
