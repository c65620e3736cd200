"""The same plan where things are otherwise than planned."""

from collections.abc import Callable, Iterator

import numpy as np

from orchid_uav.envs.channel import (
    elevation_angle_deg,
    free_space_gain,
    line_of_sight_probability,
    received_power_w,
)
from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.judging.served import count_served
from orchid_uav.experiments.planning.model import Budget, Floats, People, Want
from orchid_uav.experiments.planning.network import Fleet, Service
from orchid_uav.experiments.planning.region import Region
from orchid_uav.experiments.planning.result import (
    DrawnFigures,
    DroneLost,
    OneDroneLost,
    Robustness,
)
from orchid_uav.experiments.planning.search import search

DRAWS = 100
WALK_S, WALK_HEADING_S, WALK_SPEED_MPS = 600.0, 60.0, 1.4
"""People walk for ten minutes, at up to this speed, and change speed and heading every minute."""
_NEIGHBOURS = 6
"""Drones that move when one is lost: those nearest to it."""
_MOVES_EACH = 120
"""Places that each of them tries."""
_ERRORS, _SHADOWING, _WALK, _LOST = range(4)
"""Streams of random numbers."""


def check_robustness(
    fleet: Fleet,
    region: Region,
    plan: Floats,
    names: list[str],
    seed: int,
    want: Want | None,
    tell: Callable[[str], None] = lambda what: None,
) -> Robustness:
    """All checks of a plan (N, 4) whose drones have these names."""

    def figures(what: str, services: Iterator[Service]) -> DrawnFigures:
        tell(what)
        return _figures(list(services), fleet, want)

    return Robustness(
        position_error_50m=figures("positions 50 m off", _with_errors(fleet, plan, 50.0, seed)),
        position_error_150m=figures("positions 150 m off", _with_errors(fleet, plan, 150.0, seed)),
        shadowing=figures("buildings in the way", _with_shadowing(fleet, plan, seed)),
        walking_10_minutes=figures("people who walk", _with_walks(fleet, plan, seed)),
        one_drone_lost=_lose_each(fleet, region, plan, names, seed, want, tell),
    )


def _figures(services: list[Service], fleet: Fleet, want: Want | None) -> DrawnFigures:
    counts = [count_served(service, fleet.people, fleet.drones, want) for service in services]
    shares = [count.share_served for count in counts]
    worst_bps = [count.worst_rate_bps for count in counts]
    medians_bps = [count.median_rate_bps for count in counts]
    above = [count.share_above_want for count in counts if count.share_above_want is not None]
    return DrawnFigures(
        draws=len(counts),
        share_served=float(np.mean(shares)),
        share_served_worst=min(shares),
        worst_rate_bps=float(np.mean(worst_bps)),
        worst_rate_bps_worst=min(worst_bps),
        median_rate_bps=float(np.mean(medians_bps)),
        median_rate_bps_worst=min(medians_bps),
        share_above_want=float(np.mean(above)) if above else None,
        share_above_want_worst=min(above) if above else None,
    )


def _elsewhere(fleet: Fleet, plan: Floats, positions_m: Floats) -> Service:
    """How the same people are served at other places."""
    return fleet.changed(people=People(positions_m, fleet.people.weights)).service_of(plan)


def _with_errors(fleet: Fleet, plan: Floats, error_m: float, seed: int) -> Iterator[Service]:
    """People whose true positions are off by a normal error per axis."""
    generator = np.random.default_rng([seed, _ERRORS, int(error_m)])
    shape = fleet.people.positions_m.shape
    for _ in range(DRAWS):
        off_m = generator.normal(0.0, error_m, shape)
        yield _elsewhere(fleet, plan, fleet.people.positions_m + off_m)


def _with_walks(fleet: Fleet, plan: Floats, seed: int) -> Iterator[Service]:
    """People who have walked for ten minutes, everybody with a will of their own."""
    generator = np.random.default_rng([seed, _WALK])
    legs = round(WALK_S / WALK_HEADING_S)
    shape = (legs, len(fleet.people.weights))
    for _ in range(DRAWS):
        leg_m = generator.uniform(0.0, WALK_SPEED_MPS * WALK_HEADING_S, shape)
        heading = generator.uniform(0.0, 2.0 * np.pi, shape)
        walked_m = np.stack([leg_m * np.cos(heading), leg_m * np.sin(heading)], axis=2).sum(axis=0)
        yield _elsewhere(fleet, plan, fleet.people.positions_m + walked_m)


def _with_shadowing(fleet: Fleet, plan: Floats, seed: int) -> Iterator[Service]:
    """Links that are in sight or behind a building, instead of the mean of both (P7).

    A drone's link is drawn with the model's probability of a line of sight, one draw per drone and
    position; a mast's has its shadowing (M4).
    """
    generator = np.random.default_rng([seed, _SHADOWING])
    parameters, people = fleet.parameters, fleet.people
    channel = parameters.channel
    apart_m = people.positions_m[None, None] - (plan[:, None, None, :2] + fleet.offsets_m[:, None])
    altitude_m = plan[:, 2, None, None]
    distance_m = np.sqrt((apart_m**2).sum(axis=3) + altitude_m**2)
    del apart_m
    in_sight = line_of_sight_probability(
        elevation_angle_deg(altitude_m, distance_m), channel.s_curve_a, channel.s_curve_b
    ).mean(axis=1)
    seen_w = received_power_w(
        plan[:, 3, None, None] * free_space_gain(distance_m, channel.carrier_frequency_hz),
        channel.access_gain_db,
        channel.excess_loss_los_db,
    )
    behind = received_power_w(1.0, 0.0, channel.excess_loss_nlos_db - channel.excess_loss_los_db)
    for _ in range(DRAWS):
        is_seen = generator.random(in_sight.shape) < in_sight
        received_w = seen_w * np.where(is_seen, 1.0, behind)[:, None]
        received_w[received_w < fleet.rules.required_power_w] = 0.0
        shadowing_db = generator.normal(
            0.0, parameters.gbs.shadowing_std_db, (len(fleet.masts), len(people.weights))
        )
        drawn = fleet.changed(shadowing_db=shadowing_db)
        yield drawn.service(drawn.rank(received_w))


def _lose_each(
    fleet: Fleet,
    region: Region,
    plan: Floats,
    names: list[str],
    seed: int,
    want: Want | None,
    tell: Callable[[str], None],
) -> OneDroneLost | None:
    """Every drone in turn is lost, and its neighbours move (P6)."""
    if len(plan) == 1:
        return None
    ranking = fleet.rank(fleet.receive(plan))
    planned = fleet.service(ranking)
    transmitters = [*names, *(f"mast_{mast}" for mast in range(len(fleet.masts)))]
    left_fleet = fleet.changed(drones=len(plan) - 1)
    each = []
    for drone, name in enumerate(names):
        tell(f"{name} is lost")
        left = fleet.service(ranking, without=drone)
        was_served = planned.server == drone
        taken_over = {
            transmitters[server]: int(fleet.people.weights[was_served][of_it].sum())
            for server in np.unique(left.server[was_served])
            if server != NOBODY
            for of_it in [left.server[was_served] == server]
        }
        others = np.delete(plan, drone, axis=0)
        apart_m = np.linalg.norm(others[:, :2] - plan[drone, :2], axis=1)
        movers = np.argsort(apart_m, kind="stable")[:_NEIGHBOURS].tolist()
        found = search(
            left_fleet,
            region,
            Budget(evaluations=_MOVES_EACH * len(movers)),
            seed + _LOST,
            start=others,
            movers=movers,
        )
        moved_m = np.linalg.norm(found.plan[:, :2] - others[:, :2], axis=1).max()
        regained = left_fleet.service_of(found.plan)
        each.append(
            DroneLost(
                drone=name,
                people_before=int(fleet.people.weights[was_served].sum()),
                taken_over=taken_over,
                left=count_served(left, fleet.people, fleet.drones, want),
                regained=count_served(regained, fleet.people, left_fleet.drones, want),
                regained_after_s=float(moved_m / fleet.parameters.uav.station.speed_limit_mps),
            )
        )
    left_shares = [one.left.share_served for one in each]
    regained_shares = [one.regained.share_served for one in each]
    return OneDroneLost(
        share_served=float(np.mean(left_shares)),
        share_served_worst=min(left_shares),
        share_served_regained=float(np.mean(regained_shares)),
        share_served_regained_worst=min(regained_shares),
        each=each,
    )
