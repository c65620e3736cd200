"""Methods that can be evaluated: built-in ones by key, and policies of run directories."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from orchid_uav.agents.controllers.best_response import BestResponse
from orchid_uav.agents.controllers.controller import Controller
from orchid_uav.agents.controllers.forces import Forces
from orchid_uav.agents.controllers.heuristics import BalancedLoiter, Hover, Loiter, Track
from orchid_uav.agents.controllers.learned import ExplorationNoise, Learned, ZeroAction
from orchid_uav.agents.controllers.planner import EVALUATIONS, Planner
from orchid_uav.agents.controllers.receding_horizon import RecedingHorizon
from orchid_uav.agents.deployed_actor import LocalActor, PolicyDescription, load_policy
from orchid_uav.envs.arrays import ACTION_SIZE, OBSERVATION_SIZE
from orchid_uav.envs.knowledge.informed import INFORMED_SIZE
from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.method_keys import (
    ALL,
    LEARNED,
    RELEASED,
    RULE_IDEAS,
    RULES,
    SENSED,
    ZERO,
    known_methods,
)
from orchid_uav.experiments.runs.records import find_run, read_config, read_record, status_of
from orchid_uav.suggestions import unknown

OBSERVATION_SIZES = {"paper": OBSERVATION_SIZE, "informed": INFORMED_SIZE}
"""Numbers in a UAV's observation, by `uav.observation`."""
METHOD_KEYS = (
    "reward.objective",
    "network.shares",
    "deployment.init",
    "deployment.balanced_on",
    "uav.observation",
    "uav.flight",
)
"""Keys that belong to a method rather than to the world that it flies in."""


def method_overrides(
    objective: str, init: str = "kmeans", flight: str = "direct", observation: str = "paper"
) -> dict[str, Any]:
    """Values of all ``METHOD_KEYS`` for a method that has no run's configuration."""
    return {
        "reward.objective": objective,
        "network.shares": None,
        "deployment.init": init,
        "deployment.balanced_on": "sensed",
        "uav.observation": observation,
        "uav.flight": flight,
    }


_MMF, _PF = method_overrides("mmf"), method_overrides("pf")
SENSED_STATIONS = method_overrides("mmf", "balanced", "station")
"""What rules on stations override, where they begin as Phase I sees the users."""
STATIONS = SENSED_STATIONS | {"deployment.balanced_on": "exact"}
"""The same with a start from where the users are, as other rules have it."""


class OwnFile(NamedTuple):
    """The user's file that a method comes from."""

    name: str
    """Name of the file, without its folders."""
    attribute: str
    """Name of the class."""
    sha256: str
    """Checksum of the file."""


@dataclass(frozen=True)
class Policy:
    """A learned policy, with the run in which it was learned."""

    actor: LocalActor
    run: str
    """The run's id."""
    config: RunConfig
    is_complete: bool = True
    """False if the run was interrupted."""

    @property
    def episodes(self) -> int | None:
        """Episodes that it has learned from; None in a policy that does not say so."""
        description = self.actor.description
        return None if description is None else description.episodes


@dataclass(frozen=True)
class Contender:
    """One row of an evaluation."""

    key: str
    idea: str
    overrides: Mapping[str, Any]
    """Parameters that belong to the method, by ``"section.key"``."""
    make: Callable[[Sequence[int]], Controller]
    """Makes the method for worlds of the given seeds."""
    policy: Policy | None = None
    own_file: OwnFile | None = None
    deterministic: bool = True
    is_comparable: bool = True
    """False if it serves other users than the other methods do."""
    cost: float = 1.0
    """Rough duration of a flight, relative to hovering; for the estimate of the time left."""

    def with_overrides(self, values: Mapping[str, Any]) -> "Contender":
        """The same row with further parameters that belong to the method."""
        return replace(self, overrides={**self.overrides, **values})


_TUNED_MAPPO = (
    *("--set", "ppo.actor_learning_rate=1e-5", "--set", "ppo.critic_learning_rate=1e-3"),
    *("--set", "ppo.discount=0.9", "--set", "ppo.log_std_init=-1"),
    *("--set", "training.center_rewards=true"),
)
_TUNED_MADDPG = (
    *("--set", "maddpg.actor_learning_rate=1e-5", "--set", "maddpg.critic_learning_rate=3e-3"),
    *("--set", "maddpg.discount=0.9", "--set", "maddpg.preactivation_penalty=1"),
    *("--set", "training.center_rewards=true"),
)
"""The best trial of studies/results/tuning.json for each algorithm; see docs/methods.md."""
COMMANDS: dict[str, tuple[str, ...]] = {
    "orchid": (),
    "orchid-no-rf": ("--no-rf",),
    "orchid-pf": ("--objective", "pf", "--episodes", "1000", "--set", "reset.max_resets=3"),
    "orchid-random-init": ("--init", "random"),
    "orchid-informed": ("--preset", "informed"),
    "orchid-distilled": ("--preset", "distilled"),
    "orchid-tuned": _TUNED_MAPPO,
    "maddpg-pf": ("--algorithm", "maddpg", "--objective", "pf", *_TUNED_MADDPG),
    "maddpg-mmf": ("--algorithm", "maddpg", *_TUNED_MADDPG),
    "maddpg-pf-paper": ("--algorithm", "maddpg", "--objective", "pf"),
    "maddpg-mmf-paper": ("--algorithm", "maddpg"),
}
"""Arguments of ``orchid train`` with which each released policy was trained."""


class _Rule(NamedTuple):
    overrides: Mapping[str, Any]
    make: Callable[[], Controller]
    cost: float = 1.0
    is_comparable: bool = True


def rules(planner_evaluations: int = EVALUATIONS) -> dict[str, Contender]:
    """The methods that need no training, by key."""
    planning = 3.0 * planner_evaluations / 30.0
    plan, full_power = partial(Planner, planner_evaluations), partial(Hover, full_power=True)
    retarget = partial(BalancedLoiter, keeps_targets=False)
    replan = partial(plan, keeps_targets=False)
    by_key = {
        "static-pf": _Rule(_PF, Hover),
        "static-mmf": _Rule(_MMF, Hover),
        "static-pf-full-power": _Rule(_PF, full_power),
        "static-mmf-full-power": _Rule(_MMF, full_power),
        "loiter-pf": _Rule(_PF, Loiter),
        "loiter-mmf": _Rule(_MMF, Loiter),
        "balanced-loiter": _Rule(_MMF, BalancedLoiter, 6.0),
        "track": _Rule(_MMF, Track, 3.0),
        "planner": _Rule(_MMF, plan, planning),
        "track-120": _Rule(_MMF, partial(Track, altitude_m=120.0), 3.0),
        **_on_stations("balanced-loiter-120", ZeroAction, 1.0),
        **_on_stations("forces", Forces, 2.0),
        **_on_stations("best-response", BestResponse, 15.0),
        **_on_stations("receding-horizon", RecedingHorizon, 50.0),
        "balanced-loiter-retargeted": _Rule(_MMF, retarget, 6.0, is_comparable=False),
        "planner-retargeted": _Rule(_MMF, replan, planning, is_comparable=False),
    }
    return {
        key: Contender(
            key,
            RULE_IDEAS[key],
            rule.overrides,
            _ignoring_seeds(rule.make),
            is_comparable=rule.is_comparable,
            cost=rule.cost,
        )
        for key, rule in by_key.items()
    }


def _on_stations(key: str, make: Callable[[], Controller], cost: float) -> dict[str, _Rule]:
    """A rule on stations, from both starts."""
    return {key: _Rule(STATIONS, make, cost), key + SENSED: _Rule(SENSED_STATIONS, make, cost)}


def _ignoring_seeds(rule: Callable[[], Controller]) -> Callable[[Sequence[int]], Controller]:
    return lambda _: rule()


def find_runs(names: Sequence[str], runs_dir: Path) -> list[Path]:
    """The directories of the runs that are given by name, see :func:`find_run`.

    Raises:
        InputError: one is not found; where it is a method's name, the message says so.
    """
    found = []
    for name in names:
        try:
            found.append(find_run(name, runs_dir))
        except InputError as error:
            if name not in known_methods():
                raise
            raise InputError(f"{error}; it is a method: give --methods {name}") from error
    return found


def groups() -> dict[str, list[str]]:
    """The keys in each group; "all" leaves out the rules that serve other users."""
    catalogue = rules()
    comparable = [key for key, contender in catalogue.items() if contender.is_comparable]
    learned = [key for key in known_methods() if key not in catalogue]
    return {ALL: [*learned, *comparable], RULES: comparable, LEARNED: learned}


def ideas() -> dict[str, str]:
    """A short description of every method, by key."""
    catalogue = rules()
    return {
        key: catalogue[key].idea
        if key in catalogue
        else _idea_of(key.removesuffix(ZERO), RELEASED[key.removesuffix(ZERO)], key.endswith(ZERO))
        for key in known_methods()
    }


def _idea_of(name: str, idea: str, is_zero: bool) -> str:
    return f"{name} with its actions forced to zero" if is_zero else idea


def select(
    methods: Sequence[str],
    runs: Iterable[Path] = (),
    stochastic: bool = False,
    planner_evaluations: int = EVALUATIONS,
) -> list[Contender]:
    """The rows of an evaluation, in the order of the catalogue, then the given runs.

    Args:
        methods: keys, or groups: "all" (comparable ones), "learned" (with their twins), "rules".
        runs: run directories; each policy is followed by its zero-action twin.
        stochastic: whether every row of a learned policy is followed by one with sampled actions.
        planner_evaluations: the planner's budget per topology.

    Raises:
        InputError: a key is unknown, or a run cannot be flown.
    """
    catalogue, members = rules(planner_evaluations), groups()
    known = known_methods()
    wanted: set[str] = set()
    for key in methods:
        if key not in {*members, *known}:
            raise InputError(unknown("method", key, [*members, *known], cutoff=0.4))
        wanted.update(members.get(key, [key]))
    contenders: list[Contender] = []
    for key in known:
        if key not in wanted:
            continue
        if key in catalogue:
            contenders.append(catalogue[key])
        else:
            name = key.removesuffix(ZERO)
            policy = read_released(name)
            contenders += rows_of(policy, name, RELEASED[name], stochastic, key.endswith(ZERO))
    seen: dict[str, Path] = {}
    for path in runs:
        policy = read_policy(path)
        if policy.run in seen:
            raise InputError(
                f"run {policy.run} is given twice, as {seen[policy.run]} and as {path}"
            )
        seen[policy.run] = path
        if policy.run in known:
            raise InputError(f"run {policy.run} has the key of a built-in method: rename it")
        for is_zero in (False, True):
            contenders += rows_of(policy, policy.run, str(path), stochastic, is_zero)
    if not contenders:
        raise InputError("there is nothing to evaluate: name methods or runs")
    return contenders


def rows_of(
    policy: Policy, name: str, idea: str, stochastic: bool, is_zero: bool
) -> list[Contender]:
    """A learned policy, or its zero-action twin, as rows of an evaluation.

    Args:
        policy: the policy.
        name: the policy's key.
        idea: a short description of the policy.
        stochastic: whether to add a row with sampled actions; for the twin, with noise alone.
        is_zero: whether the rows are those of the twin.
    """
    overrides = {key: flatten(policy.config)[key] for key in METHOD_KEYS}

    def make(is_sampled: bool) -> Callable[[Sequence[int]], Controller]:
        def method(seeds: Sequence[int]) -> Controller:
            noise = ExplorationNoise(policy.actor.log_std, seeds) if is_sampled else None
            return ZeroAction(noise) if is_zero else Learned(policy.actor, noise)

        return method

    return [
        Contender(
            name + ZERO if is_zero else name,
            _idea_of(name, idea, is_zero),
            overrides,
            make(is_sampled),
            policy,
            deterministic=not is_sampled,
            cost=1.0 if is_zero else 4.0,
        )
        for is_sampled in ((False, True) if stochastic else (False,))
    ]


def read_released(key: str) -> Policy:
    """Read a policy that comes with the package."""
    path = Path(str(files("orchid_uav.reference"))) / key
    return read_policy(path)


def read_policy(path: Path) -> Policy:
    """Read the policy of a run directory.

    Raises:
        InputError: there is no run, it is still running or failed, files are damaged, or the
            policy is for other observations or actions than the environment's.
    """
    record = read_record(path)
    status, run = status_of(path, record), record.id
    if status not in ("completed", "interrupted"):
        state = "is still running" if status == "running" else status
        raise InputError(f"run {run} {state}: only a run that ended has a policy to fly ({path})")
    try:
        config = read_config(path, record)
        actor = load_policy(path)
    except (OSError, ValueError, InputError) as error:
        raise InputError(f"run {run} cannot be flown: {error}") from error
    description = actor.description
    if description is None or description.run not in (run, *record.former_ids):
        of = description.run if description else None
        raise InputError(f"the policy in {path} is that of run {of}")
    _check_fit(run, actor, description, config)
    return Policy(actor, run, config, is_complete=status == "completed")


def _check_fit(
    run: str, actor: LocalActor, description: PolicyDescription, config: RunConfig
) -> None:
    """Raise InputError where a policy was learned for another observation or flight."""
    uav = config.uav
    for name, learned, flown in (
        ("observation", description.observation or "paper", uav.observation),
        ("flight", description.flight or "direct", uav.flight),
    ):
        if learned != flown:
            raise InputError(
                f"run {run} has a policy for {name} = {learned}, and its configuration says {flown}"
            )
    sizes = (actor.observation_size, actor.action_size)
    wanted = (OBSERVATION_SIZES[uav.observation], ACTION_SIZE)
    if sizes != wanted:
        raise InputError(
            f"run {run} has a policy of {sizes[0]} observations and {sizes[1]} actions; the "
            f"environment has {wanted[0]} and {wanted[1]}"
        )
