"""Flies every method over the same held-out topologies."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from orchid_uav.agents.controllers.controller import Controller
from orchid_uav.agents.controllers.planner import Planner
from orchid_uav.envs.diagnostics import Diagnostics
from orchid_uav.envs.parameters import Distribution, NetworkParameters, Parameters
from orchid_uav.envs.seeds import evaluation_seeds
from orchid_uav.envs.starts.topologies import Topologies
from orchid_uav.envs.threads import usable_cores
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.configuration import LEARNING_SECTIONS, SETTING_KEYS, RunConfig, flatten
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.methods import METHOD_KEYS, Contender, Policy
from orchid_uav.experiments.metrics import EVALUATION_METRICS, HEADROOM
from orchid_uav.experiments.statistics.intervals import (
    UNKNOWN,
    MetricSummary,
    interval,
    summarise,
)
from orchid_uav.experiments.statistics.results import EvaluationResult

Floats = NDArray[np.float64]
Metrics = dict[str, Floats]
"""The values of every metric of ``EVALUATION_METRICS`` over a flight's episodes, (episodes,)."""

FLOOR, CEILING = "loiter-mmf", "planner"
"""Methods whose utilities are the ends of the headroom, 0 % and 100 %."""
_WORLDS_AT_ONCE = 1000
_USUAL = NetworkParameters()


class Setting(NamedTuple):
    """The values by which the worlds of an evaluation differ."""

    distribution: Distribution = _USUAL.distribution
    uavs: int = _USUAL.uav_count
    users: int = _USUAL.user_count
    speed_mps: float = _USUAL.user_speed_mps
    heading_hold_s: float = _USUAL.heading_hold_s

    def values(self) -> dict[str, Any]:
        """The values of the setting, by ``"section.key"``."""
        return dict(zip(SETTING_FIELDS, self, strict=True))

    def apply(self, world: Parameters) -> Parameters:
        """The parameters of a world with this setting.

        Raises:
            InputError: the combination is not possible.
        """
        try:
            return world.with_overrides(self.values())
        except ValueError as error:
            raise InputError(f"a setting cannot be flown: {error}") from error


SETTING_FIELDS = (
    "network.distribution",
    "network.uav_count",
    "network.user_count",
    "network.user_speed_mps",
    "network.heading_hold_s",
)
"""The keys of the values of a setting, in their order."""


@dataclass(frozen=True)
class EvaluationPlan:
    """All that an evaluation flies."""

    contenders: Sequence[Contender]
    settings: Sequence[Setting]
    episodes: int
    seed: int
    world: Parameters
    first_slot: int = 1
    """Metrics are those of the slots from this one on."""
    training_progress: float = 1.0
    """The weights of the reward are those at this progress τ."""

    def flights(self) -> Iterator["Flight"]:
        """All flights, setting by setting."""
        for setting, contender in itertools.product(self.settings, self.contenders):
            yield Flight(setting, contender)

    def check(self) -> None:
        """Raise InputError if a setting cannot be flown, before anything is flown."""
        for setting in self.settings:
            parameters = setting.apply(self.world)
            for contender in self.contenders:
                try:
                    parameters.with_overrides(dict(contender.overrides))
                except ValueError as error:
                    raise InputError(f"{contender.key} cannot be flown: {error}") from error


class Flight(NamedTuple):
    """A method in a setting."""

    setting: Setting
    contender: Contender

    @property
    def key(self) -> tuple[Any, ...]:
        """The identity of this flight within an evaluation."""
        return (*self.setting, self.contender.key, self.contender.deterministic)


class FlightProgress:
    """Shows the progress of an evaluation; this base class shows nothing."""

    def begin(self, total_cost: float) -> None:
        """The flights are about to begin."""

    def start(self, flight: Flight) -> None:
        """This flight begins."""

    def advance(self, cost: float) -> None:
        """This much more of the total cost is done."""

    def end(self) -> None:
        """The evaluation has ended."""


Flown = dict[tuple[Any, ...], Metrics]
"""Metrics by :attr:`Flight.key`."""


def evaluate(
    plan: EvaluationPlan,
    progress: FlightProgress | None = None,
    flown: Flown | None = None,
    save: Callable[[Flown], None] = lambda flown: None,
    stop: Callable[[], bool] = lambda: False,
) -> tuple[Flown, bool]:
    """Fly all flights of a plan; the topologies of a setting are flown in large batches.

    Args:
        plan: the flights of the evaluation.
        progress: shows the progress; by default nothing is shown.
        flown: flights of an interrupted evaluation of the same plan, which are not flown again.
        save: called with all flights so far after every setting, and however the flying ends.
        stop: asked in every slot, since libraries may lose a KeyboardInterrupt in their callbacks.

    Returns:
        The metrics by flight, and whether all flights were flown. KeyboardInterrupt ends the
        evaluation, and the flight in progress is lost.
    """

    def heed_stop() -> None:
        if stop():
            raise KeyboardInterrupt

    progress = progress or FlightProgress()
    done: Flown = dict(flown or {})
    waiting = [flight for flight in plan.flights() if flight.key not in done]
    progress.begin(sum(_cost(flight) for flight in waiting))
    try:
        # One thread: matrices are small, and metrics must not depend on the number of cores.
        with threadpool_limits(1):
            for setting, flights in itertools.groupby(waiting, lambda flight: flight.setting):
                topologies = HeldOut(
                    plan.world, setting, evaluation_seeds(plan.seed, plan.episodes)
                )
                try:
                    for flight in flights:
                        done[flight.key] = _fly(plan, flight, topologies, progress, heed_stop)
                finally:
                    if done:
                        save(done)
    except KeyboardInterrupt:
        return done, False
    except MemoryError as error:
        raise RunFailedError(f"not enough memory: {error}") from error
    finally:
        progress.end()
    return done, True


def world_differences(policy: Policy, world: RunConfig) -> list[str]:
    """Keys in which the world of a policy's training differs from the one it is flown in."""
    trained, flown = flatten(policy.config), flatten(world)
    return [
        key
        for key in trained
        if key.partition(".")[0] not in LEARNING_SECTIONS
        and key not in METHOD_KEYS
        and key not in SETTING_KEYS
        and trained[key] != flown[key]
    ]


def _cost(flight: Flight) -> float:
    return flight.contender.cost * flight.setting.uavs


class HeldOut:
    """Held-out topologies of a setting, drawn once for methods with the same start and world.

    Args:
        world: in which they lie.
        setting: what is changed of it.
        seeds: of the topologies.

    Raises:
        InputError: the setting cannot be flown.
    """

    def __init__(self, world: Parameters, setting: Setting, seeds: Sequence[int]) -> None:
        self.seeds = seeds
        self._parameters = setting.apply(world)
        self._drawn: dict[Any, Topologies] = {}

    def of(self, contender: Contender) -> tuple[Parameters, Topologies]:
        """The parameters that a method flies with, and its topologies.

        Raises:
            InputError: the method has no start there.
        """
        parameters = self._parameters.with_overrides(dict(contender.overrides))
        # Of these, nothing affects what is drawn, but how balanced starts are judged: by the rates
        # that the rule of shares gives.
        kind = (
            parameters.model_dump_json(
                exclude={
                    "reward": True,
                    "sensing": True,
                    "network": {"shares", "failures"},
                    "uav": {"flight", "station", "observation"},
                }
            ),
            parameters.share_rule if parameters.deployment.init == "balanced" else None,
        )
        if kind not in self._drawn:
            try:
                self._drawn[kind] = Topologies.joined(
                    [
                        WorldBatch(parameters, len(seeds), seeds).draw_topologies()
                        for seeds in in_batches(self.seeds)
                    ]
                )
            except ValueError as error:
                raise InputError(f"no start can be found: {error}") from error
        return parameters, self._drawn[kind]


def _fly(
    plan: EvaluationPlan,
    flight: Flight,
    topologies: HeldOut,
    progress: FlightProgress,
    heed_stop: Callable[[], None],
) -> Metrics:
    parameters, all_topologies = topologies.of(flight.contender)
    parts: list[Metrics] = []
    first = 0
    progress.start(flight)
    for seeds in in_batches(topologies.seeds):
        some = all_topologies.chosen(slice(first, first + len(seeds)))
        first += len(seeds)
        cost = _cost(flight) * len(seeds) / plan.episodes
        batch = _fly_batch(
            flight.contender, parameters, some, seeds, plan, progress, cost, heed_stop
        )
        parts.append(batch)
    return {name: np.concatenate([part[name] for part in parts]) for name in EVALUATION_METRICS}


def in_batches(seeds: Sequence[int]) -> Iterator[Sequence[int]]:
    """Divide seeds into batches of as many worlds as are kept in memory at once."""
    for first in range(0, len(seeds), _WORLDS_AT_ONCE):
        yield seeds[first : first + _WORLDS_AT_ONCE]


def _fly_batch(
    contender: Contender,
    parameters: Parameters,
    topologies: Topologies,
    seeds: Sequence[int],
    plan: EvaluationPlan,
    progress: FlightProgress,
    cost: float,
    heed_stop: Callable[[], None],
) -> Metrics:
    def plan_made() -> None:
        progress.advance(cost / len(seeds))
        heed_stop()

    world, method = begin_flight(
        contender, parameters, topologies, seeds, plan_made, plan.training_progress
    )
    diagnostics = Diagnostics(world)
    diagnostics.begin()
    for slot in range(1, parameters.network.episode_slots + 1):
        heed_stop()
        if slot == plan.first_slot and slot > 1:
            world.forget_metrics()
            diagnostics.begin()
        world.step(method.act(world))
        diagnostics.observe()
    if not isinstance(method, Planner):  # which takes most of its time before it flies
        progress.advance(cost)
    episodes = [
        world.episode_metrics(index) | diagnostics.episode_metrics(index)
        for index in range(len(seeds))
    ]
    return {name: np.array([episode[name] for episode in episodes]) for name in EVALUATION_METRICS}


def begin_flight(
    contender: Contender,
    parameters: Parameters,
    topologies: Topologies,
    seeds: Sequence[int],
    plan_made: Callable[[], None] | None = None,
    training_progress: float = 1.0,
) -> tuple[WorldBatch, Controller]:
    """Worlds on given topologies, as they are before the first slot, and who flies in them.

    Args:
        contender: the method.
        parameters: those of the method's worlds.
        topologies: one for each seed.
        seeds: of the topologies.
        plan_made: called after each of the plans of a method that plans before it flies.
        training_progress: the weights of the reward are those at this progress τ.
    """
    world = WorldBatch(parameters, worlds=len(seeds), seed=0, threads=usable_cores())
    world.set_progress(training_progress)
    world.use_topology(topologies)
    method = contender.make(seeds)
    if plan_made is not None and isinstance(method, Planner):
        method.after_each = plan_made
    method.begin(world)
    return world, method


def summarise_flights(
    plan: EvaluationPlan, flown: Mapping[tuple[Any, ...], Metrics], with_intervals: bool = True
) -> list[EvaluationResult]:
    """The "results" of ``summary.json``: one for every flight that was flown.

    Args:
        plan: the flights of the evaluation.
        flown: metrics by flight.
        with_intervals: whether to compute confidence intervals, which take most of the time, and
            the headroom, which needs an interval to tell whether there is any.
    """
    results = []
    for flight in plan.flights():
        if flight.key not in flown:
            continue
        metrics = flown[flight.key]
        results.append(
            EvaluationResult.from_json(
                describe(flight)
                | {"episodes": plan.episodes, "comparable": flight.contender.is_comparable}
                | {name: summarise(metrics[name], with_intervals) for name in EVALUATION_METRICS}
                | {HEADROOM: _headroom(flight, metrics, flown if with_intervals else {})}
            )
        )
    return results


def describe(flight: Flight) -> dict[str, Any]:
    """Describe method and setting as the results and the table of episodes do."""
    setting, contender = flight
    return {
        "method": contender.key,
        "run": contender.policy.run if contender.policy else None,
        "objective": contender.overrides["reward.objective"],
        **setting._asdict(),
        "deterministic": contender.deterministic,
    }


def _headroom(
    flight: Flight, metrics: Metrics, flown: Mapping[tuple[Any, ...], Metrics]
) -> MetricSummary:
    floor = flown.get((*flight.setting, FLOOR, True))
    ceiling = flown.get((*flight.setting, CEILING, True))
    if floor is None or ceiling is None or not flight.contender.is_comparable:
        return UNKNOWN

    def share(own: Floats, low: Floats, high: Floats, axis: int) -> Floats:
        room = np.mean(high, axis=axis) - np.mean(low, axis=axis)
        return (np.mean(own, axis=axis) - np.mean(low, axis=axis)) / room

    samples = metrics["utility"], floor["utility"], ceiling["utility"]
    room = summarise(samples[2] - samples[1])
    if room.mean is None or room.mean <= 0.0 or (room.ci95 and room.ci95[0] <= 0.0):
        return UNKNOWN  # the room cannot be told from none
    mean = float(share(*samples, axis=-1))
    return MetricSummary(mean=mean, std=None, ci95=interval(samples, share))
