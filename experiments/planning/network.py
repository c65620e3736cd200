"""A fleet over people and masts: judged, searched and asked by everything that plans."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.plans.network import NOBODY, Ground, Rules
from orchid_uav.envs.plans.service import (
    Ranking,
    judge_moves,
    judge_plan,
    rank,
    receive,
    serve,
)
from orchid_uav.envs.propulsion import least_power_speed_mps, load_factor, propulsion_power_w
from orchid_uav.experiments.planning.model import Floats, Mast, People

CIRCLE_POINTS = 4
"""Points of the circles at which a plan is judged."""


class Service(NamedTuple):
    """How people are served from given stations, over the circle."""

    server: NDArray[np.int64]
    """Who serves each position, (P,): a drone, N + a mast, or NOBODY; where that changes along the
    circle, who does at its first point. NOBODY for those who are without a link somewhere."""
    rates_bps: Floats
    """Mean rate of one person at each position, (P,); 0 for those whom NOBODY serves."""


class Fleet:
    """Some drones of one kind over people and masts.

    A plan is (N, 4): east and north of a centre in m, altitude in m, transmit power in W.

    Args:
        parameters: of the network.
        people: P positions and their weights.
        masts: on the ground.
        drones: number N.
        circle_radius_m: of all circles; 0 for drones that hover.
        speed_mps: on the circle; by default that of least propulsion power.
        shadowing_db: of the masts' links, (G, P), or one number.
    """

    def __init__(
        self,
        parameters: Parameters,
        people: People,
        masts: tuple[Mast, ...],
        drones: int,
        circle_radius_m: float,
        speed_mps: float | None = None,
        shadowing_db: ArrayLike = 0.0,
    ) -> None:
        self.parameters = parameters
        self.people = people
        self.masts = masts
        self.drones = drones
        self.circle_radius_m = circle_radius_m
        self.rules = Rules.of(parameters, drones)
        self.ground = Ground.of(parameters, people.positions_m, people.weights, masts, shadowing_db)
        if speed_mps is None:
            speed_mps = station_speed_mps(parameters, circle_radius_m)
        self.speed_mps = speed_mps
        self.propulsion_w = drones * station_power_w(parameters, circle_radius_m, speed_mps)
        points = CIRCLE_POINTS if circle_radius_m > 0.0 else 1
        angles = 2.0 * np.pi * np.arange(points) / points
        self.offsets_m = circle_radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def changed(
        self,
        people: People | None = None,
        drones: int | None = None,
        shadowing_db: ArrayLike = 0.0,
    ) -> "Fleet":
        """The same with other people, another number of drones, or with shadowing."""
        return Fleet(
            self.parameters,
            people or self.people,
            self.masts,
            drones or self.drones,
            self.circle_radius_m,
            self.speed_mps,
            shadowing_db,
        )

    def receive(self, plan: Floats) -> Floats:
        """What everybody receives of every drone, (N, K, P) in W."""
        received_w = np.empty((len(plan), len(self.offsets_m), len(self.people.weights)))
        receive(self.rules, plan, self.offsets_m, self.ground, received_w)
        return received_w

    def rank(
        self, received_w: Floats, ranking: Ranking | None = None, moved: int = NOBODY
    ) -> Ranking:
        """Who is received best: all anew, or what has changed as one drone has moved."""
        if ranking is None:
            ranking, moved = Ranking.empty(*received_w.shape[1:]), NOBODY
        rank(self.rules, self.ground, received_w, moved, ranking)
        return ranking

    def move(self, received_w: Floats, ranking: Ranking, drone: int, station: Floats) -> None:
        """Put one drone at another place (4,)."""
        one_w = received_w[drone : drone + 1]
        receive(self.rules, station[None], self.offsets_m, self.ground, one_w)
        self.rank(received_w, ranking, drone)

    def utility(self, plan: Floats, ranking: Ranking | None = None) -> float:
        """U_total of a plan at training progress 1, a mean over the circle (P1, P3)."""
        utilities = np.empty(len(self.offsets_m))
        judge_plan(
            self.rules,
            self.ground,
            self.rank(self.receive(plan)) if ranking is None else ranking,
            self.drones,
            self.propulsion_w,
            float(plan[:, 3].sum()),
            utilities,
        )
        return float(utilities.mean())

    def utilities_of_moves(
        self, plan: Floats, ranking: Ranking, drone: int, moves: Floats
    ) -> Floats:
        """U_total with one drone elsewhere, for places (C, 4), the others staying."""
        utilities = np.empty(len(moves))
        judge_moves(
            self.rules,
            self.ground,
            ranking,
            self.drones,
            drone,
            moves,
            self.offsets_m,
            self.propulsion_w,
            float(plan[:, 3].sum() - plan[drone, 3]),
            utilities,
        )
        return utilities

    def service_of(self, plan: Floats) -> Service:
        """Who serves whom from the stations of a plan."""
        return self.service(self.rank(self.receive(plan)))

    def service(self, ranking: Ranking, without: int = NOBODY) -> Service:
        """Who serves whom, a drone left out if one is given."""
        servers = np.empty(ranking.server.shape[1:], np.int64)
        rates_bps = np.empty(servers.shape)
        serve(self.rules, self.ground, ranking, self.drones, without, servers, rates_bps)
        always = (rates_bps > 0.0).all(axis=0)
        return Service(
            np.where(always, servers[0], NOBODY), np.where(always, rates_bps.mean(axis=0), 0.0)
        )


def station_speed_mps(parameters: Parameters, circle_radius_m: float) -> float:
    """Speed on the circle: that of least propulsion power; 0 for a drone that hovers."""
    if circle_radius_m == 0.0:
        return 0.0
    return least_power_speed_mps(parameters.rotor, parameters.uav.max_speed_mps)


def station_power_w(
    parameters: Parameters, circle_radius_m: float, speed_mps: float, with_thrust: bool = False
) -> float:
    """Propulsion power on station, as the paper has it or with the thrust of turns paid for."""
    factor = 1.0
    if with_thrust and circle_radius_m > 0.0:
        factor = float(load_factor(speed_mps**2 / circle_radius_m))
    curve = parameters.rotor.power_curve()
    return float(propulsion_power_w(speed_mps, **curve, load_factor=factor))
