"""Replays of methods on one held-out topology: flown, recorded, and put into a document."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.seeds import evaluation_seeds
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.flights import HeldOut, Setting, begin_flight
from orchid_uav.experiments.evaluation.methods import Contender
from orchid_uav.experiments.figures.style import setting_text
from orchid_uav.experiments.markup import harmless
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.planning.maps.drawing import mast_name
from orchid_uav.experiments.replay.document import (
    DRONE_SCALE_M,
    POWER_SCALE_W,
    RATE_RATIO,
    SCHEMA,
    USER_SCALE_M,
    ReplayDocument,
    ReplayDrones,
    ReplayFlight,
    ReplayMast,
    ReplayMetric,
    ReplayStations,
    ReplayUsers,
)
from orchid_uav.experiments.replay.packing import pack, pack_magnitudes, pack_states
from orchid_uav.experiments.replay.recording import Recording, check_size, record
from orchid_uav.experiments.runs.records import short_ids

MOST_FLIGHTS = 2
"""Flights side by side."""
SHOWN = (
    *("rate_jfi", "worst_rate_bps", "load_jfi", "utility", "energy_efficiency_bit_per_joule"),
    *("total_coverage", "coverage"),
)
"""Metrics of a replay, those first in which methods differ most."""


class Topology(NamedTuple):
    """A held-out topology: the one that an evaluation with this seed flies as its n-th."""

    seed: int
    number: int
    """From 0 on."""

    @property
    def own_seed(self) -> int:
        """The seed of the one topology."""
        return evaluation_seeds(self.seed, self.number + 1)[self.number]


class ReplayListener:
    """Is told how far a replay is; this base class says nothing."""

    def begins(self, stage: str, steps: int) -> None:
        """So many steps of something begin."""

    def advances(self) -> None:
        """One step is done."""

    def ends(self) -> None:
        """All is done, or has failed."""


def replay_of_flights(
    contenders: Sequence[Contender],
    world: Parameters,
    setting: Setting,
    topology: Topology,
    listener: ReplayListener | None = None,
) -> ReplayDocument:
    """Fly one or two methods on the same topology, and tell how it went.

    Args:
        contenders: the methods.
        world: in which they fly.
        setting: what is changed of it.
        topology: where people are and how they walk.
        listener: is told how far it is.

    Raises:
        InputError: something cannot be flown, or not be compared.
    """
    listener = listener or ReplayListener()
    if not 1 <= len(contenders) <= MOST_FLIGHTS:
        raise InputError(f"{len(contenders)} methods: a replay shows one, or two side by side")
    held_out = HeldOut(world, setting, [topology.own_seed])
    recordings = [_flown(contender, held_out, listener) for contender in contenders]
    _check_same_topology(contenders, recordings)
    network = setting.apply(world).network
    first = recordings[0]
    labels = _labels(contenders)
    walks = not np.array_equal(first.users_m[0], first.users_m[-1]) or network.user_speed_mps > 0.0
    return ReplayDocument(
        schema=SCHEMA,
        title=" beside ".join(labels),
        subtitle=f"{setting_text(setting._asdict())}; {_name_of(topology)}",
        slot_s=network.slot_s,
        slots=network.episode_slots,
        area_m=list(network.area_size_m),
        altitudes_m=[world.uav.min_altitude_m, world.uav.max_altitude_m],
        users=ReplayUsers(
            count=first.users_m.shape[1],
            names=None,
            weights=None,
            targets=pack(first.target_users.astype(np.uint8), "uint8"),
            positions=pack_states(first.users_m if walks else first.users_m[:1], USER_SCALE_M),
        ),
        masts=[
            ReplayMast(name=mast_name(index), position_m=place_m)
            for index, place_m in enumerate(first.masts_m.tolist())
        ],
        metrics=[described(name) for name in SHOWN],
        flights=[
            _flight(contender, label, recording, world)
            for contender, label, recording in zip(contenders, labels, recordings, strict=True)
        ],
        place=None,
    )


def described(metric: str) -> ReplayMetric:
    """A metric as a document describes it."""
    one = METRICS[metric]
    return ReplayMetric(
        key=metric, label=one.title, unit=one.unit, better=one.better, digits=one.digits
    )


def mean_metrics(flight: ReplayFlight) -> dict[str, float | None]:
    """Means over the slots, by name and in the units of evaluations; None where there is none."""
    means = {
        name: float(packed.values().mean()) / METRICS[name].scale
        for name, packed in flight.metrics.items()
    }
    return {name: mean if math.isfinite(mean) else None for name, mean in means.items()}


def _flown(contender: Contender, held_out: HeldOut, listener: ReplayListener) -> Recording:
    parameters, topologies = held_out.of(contender)
    network = parameters.network
    check_size(network.episode_slots, network.uav_count, network.user_count)
    listener.begins(contender.key, network.episode_slots)
    world, method = begin_flight(contender, parameters, topologies, held_out.seeds)
    return record(world, method, listener.advances)


def _check_same_topology(contenders: Sequence[Contender], recordings: list[Recording]) -> None:
    """Raise InputError unless all serve the same people, who walk the same ways."""
    first = recordings[0]
    for contender, other in zip(contenders[1:], recordings[1:], strict=True):
        if not np.array_equal(first.users_m, other.users_m):
            raise RuntimeError(f"{contender.key} has flown over other users' ways")
        if not np.array_equal(first.target_users, other.target_users):
            raise InputError(
                f"{contender.key} serves other users than {contenders[0].key}, so that they "
                "cannot be compared: replay each alone"
            )


def _labels(contenders: Sequence[Contender]) -> list[str]:
    """Keys of methods, and the shortest unique names of runs."""
    runs = [one.key for one in contenders if one.policy and one.policy.run == one.key]
    short = short_ids(runs)
    return [harmless(short.get(one.key, one.key)) for one in contenders]


def _name_of(topology: Topology) -> str:
    return f"held-out topology {topology.number} of seed {topology.seed}"


def _flight(
    contender: Contender, label: str, recording: Recording, world: Parameters
) -> ReplayFlight:
    drones = recording.positions_m.shape[1]
    is_run = contender.policy is not None and contender.policy.run == contender.key
    stations = None
    if recording.stations_m is not None:
        radius_m = world.with_overrides(dict(contender.overrides)).circle_radius_m
        stations = ReplayStations(
            centres=pack_states(recording.stations_m, DRONE_SCALE_M), radius_m=radius_m
        )
    return ReplayFlight(
        key=harmless(contender.key),
        label=label,
        note=harmless(f"run {contender.key}" if is_run else contender.idea),
        drones=ReplayDrones(
            count=drones,
            names=[f"uav_{index}" for index in range(drones)],
            positions=pack_states(recording.positions_m, DRONE_SCALE_M),
            powers_w=pack_states(recording.powers_w, POWER_SCALE_W),
            stations=stations,
        ),
        association=pack_states(recording.association, 1.0),
        rates=pack_magnitudes(recording.rates_bps, RATE_RATIO),
        metrics={
            name: pack(recording.metrics[name] * METRICS[name].scale, "float32") for name in SHOWN
        },
    )
