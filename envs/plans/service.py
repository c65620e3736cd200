"""Who serves whom from given places, how fast, and how good that is: compiled.

A plan is judged at K points of the drones' circles, at each of which all of them are at once.
Received powers that are less than a link needs are 0.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Floats
from orchid_uav.envs.association import link_power_w
from orchid_uav.envs.channel import signal_to_noise_ratio, spectral_efficiency
from orchid_uav.envs.compilation import SOURCES, compiled
from orchid_uav.envs.fairness import jain_index_from_sums
from orchid_uav.envs.plans.network import NOBODY, Ground, Rules
from orchid_uav.envs.propulsion import total_power_w
from orchid_uav.envs.reward import (
    composite_reward,
    coverage_ratio,
    energy_efficiency,
    normalised_energy_efficiency,
)
from orchid_uav.envs.sharing import (
    bandwidth_share,
    cell_squared_rates,
    cell_throughput_bps,
    user_rate_bps,
)

COUNT, SUM, INVERSE_SUM, SQUARE_SUM, FOURTH_SUM = range(5)
"""Columns of a cell's sums over its people: their number, and powers of spectral efficiencies."""
_SUMS = 5


@compiled
def receive(
    rules: Rules,
    stations: Floats,
    offsets_m: Floats,
    ground: Ground,
    received_w: Floats,
    sources: str = SOURCES,
) -> None:
    """What everybody receives of every drone at every point of its circle.

    Args:
        rules: of the network.
        stations: east, north, altitude and transmit power of each drone, (N, 4).
        offsets_m: the points of the circles, from the centres, (K, 2).
        ground: people (P).
        received_w: result, (N, K, P).
        sources: not used; see ``SOURCES``.
    """
    for drone in range(len(stations)):
        _receive_one(rules, stations[drone], offsets_m, ground, received_w[drone])


@njit(error_model="numpy", forceinline=True)
def _receive_one(
    rules: Rules, station: Floats, offsets_m: Floats, ground: Ground, received_w: Floats
) -> None:
    east_m, north_m, altitude_m, transmit_w = station[0], station[1], station[2], station[3]
    for point in range(len(offsets_m)):
        x_m, y_m = east_m + offsets_m[point, 0], north_m + offsets_m[point, 1]
        row = received_w[point]
        for person in range(len(row)):
            dx = ground.coordinates_m[0, person] - x_m
            dy = ground.coordinates_m[1, person] - y_m
            squared = dx * dx + dy * dy + altitude_m * altitude_m
            power_w = link_power_w(
                transmit_w, squared, altitude_m, rules.link, rules.access_gain_db
            )
            row[person] = power_w if power_w >= rules.required_power_w else 0.0


class Ranking(NamedTuple):
    """The strongest and the second transmitter of everybody, at K points by P people."""

    power_w: Floats
    """(2, K, P)."""
    server: NDArray[np.int64]
    """A drone, or N + a mast, or NOBODY, (2, K, P)."""
    efficiency: Floats
    """Spectral efficiency in bit/s/Hz, 0 of NOBODY, (2, K, P)."""

    @classmethod
    def empty(cls, points: int, people: int) -> "Ranking":
        """Arrays of the right shapes."""
        shape = (2, points, people)
        return cls(np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape))


@compiled
def rank(
    rules: Rules,
    ground: Ground,
    received_w: Floats,
    moved: int,
    ranking: Ranking,
    sources: str = SOURCES,
) -> None:
    """Rank what everybody receives.

    Args:
        rules: of the network.
        ground: people and masts.
        received_w: of :func:`receive`, (N, K, P).
        moved: the one drone whose row has changed since the ranking was made, or NOBODY for a
            ranking that means nothing yet.
        ranking: result.
        sources: not used; see ``SOURCES``.
    """
    points, people = received_w.shape[1:]
    for point in range(points):
        for person in range(people):
            if moved != NOBODY:
                was_among = (
                    ranking.server[0, point, person] == moved
                    or ranking.server[1, point, person] == moved
                )
                if not was_among and (
                    received_w[moved, point, person] <= ranking.power_w[1, point, person]
                ):
                    continue
            _rank_one(rules, ground, received_w, point, person, ranking)


@njit(error_model="numpy", forceinline=True)
def _rank_one(
    rules: Rules, ground: Ground, received_w: Floats, point: int, person: int, ranking: Ranking
) -> None:
    drones = len(received_w)
    first_w, second_w = ground.mast_power_w[person], 0.0
    first = drones + ground.mast[person] if first_w > 0.0 else NOBODY
    second = NOBODY
    for drone in range(drones):
        power_w = received_w[drone, point, person]
        if power_w > first_w:
            second_w, second = first_w, first
            first_w, first = power_w, drone
        elif power_w > second_w:
            second_w, second = power_w, drone
    ranking.power_w[0, point, person], ranking.power_w[1, point, person] = first_w, second_w
    ranking.server[0, point, person], ranking.server[1, point, person] = first, second
    for place in range(2):
        efficiency = 0.0
        server = ranking.server[place, point, person]
        if server != NOBODY:
            power_w = ranking.power_w[place, point, person]
            efficiency = _efficiency(rules, drones, server, power_w)
        ranking.efficiency[place, point, person] = efficiency


@njit(error_model="numpy", forceinline=True)
def _efficiency(rules: Rules, drones: int, server: int, power_w: float) -> float:
    """Spectral efficiency of a link to a drone, or to a mast with its own band."""
    noise_w = rules.noise_power_w if server < drones else rules.mast_noise_power_w
    return spectral_efficiency(signal_to_noise_ratio(power_w, noise_w))


@njit(error_model="numpy", forceinline=True)
def _add(cell: Floats, efficiency: float, weight: float) -> None:
    """A person joins a cell, or leaves it with a weight below 0."""
    square = efficiency * efficiency
    cell[COUNT] += weight
    cell[SUM] += weight * efficiency
    cell[INVERSE_SUM] += weight / efficiency
    cell[SQUARE_SUM] += weight * square
    cell[FOURTH_SUM] += weight * square * square


@njit(error_model="numpy", forceinline=True)
def _fill_cells(
    ground: Ground, ranking: Ranking, point: int, without: int, place: NDArray[np.int64],
    cells: Floats,
) -> None:  # fmt: skip
    """Sums over the cells (N + G, 5) at one point, a drone left out (or NOBODY).

    ``place`` (P,) is where each person's server stands in the ranking then, 0 or 1.
    """
    cells[:] = 0.0
    for person in range(len(place)):
        at = 1 if without != NOBODY and ranking.server[0, point, person] == without else 0
        place[person] = at
        server = ranking.server[at, point, person]
        if server != NOBODY:
            efficiency = ranking.efficiency[at, point, person]
            _add(cells[server], efficiency, ground.weights[person])


@compiled
def serve(
    rules: Rules,
    ground: Ground,
    ranking: Ranking,
    drones: int,
    without: int,
    servers: NDArray[np.int64],
    rates_bps: Floats,
    sources: str = SOURCES,
) -> None:
    """Who serves whom, and how fast.

    Args:
        rules: of the network.
        ground: people and masts.
        ranking: of :func:`rank`.
        drones: number N.
        without: a drone that is left out, or NOBODY.
        servers: result, a drone, or N + a mast, or NOBODY, (K, P).
        rates_bps: result, the rate of one person at each position, 0 if nobody serves, (K, P).
        sources: not used; see ``SOURCES``.
    """
    points, people = servers.shape
    cells = np.empty((drones + ground.mast_count, _SUMS))
    place = np.empty(people, np.int64)
    for point in range(points):
        _fill_cells(ground, ranking, point, without, place, cells)
        for person in range(people):
            server = ranking.server[place[person], point, person]
            servers[point, person] = server
            rates_bps[point, person] = 0.0
            if server != NOBODY:
                cell = cells[server]
                efficiency = ranking.efficiency[place[person], point, person]
                share = bandwidth_share(
                    rules.share_rule, efficiency, cell[COUNT], cell[SUM], cell[INVERSE_SUM]
                )
                bandwidth_hz = rules.bandwidth_hz if server < drones else rules.mast_bandwidth_hz
                rates_bps[point, person] = user_rate_bps(share, bandwidth_hz, efficiency)


@compiled
def judge_moves(
    rules: Rules,
    ground: Ground,
    ranking: Ranking,
    drones: int,
    drone: int,
    moves: Floats,
    offsets_m: Floats,
    propulsion_w: float,
    other_transmit_w: float,
    utilities: Floats,
    sources: str = SOURCES,
) -> None:
    """Utility of a plan with one drone elsewhere, the others staying: a mean over the points.

    Args:
        rules: of the network.
        ground: people and masts.
        ranking: of :func:`rank`, of the plan with the drone anywhere.
        drones: number N.
        drone: which one is moved.
        moves: east, north, altitude and transmit power to try, (C, 4).
        offsets_m: the points of the circles, from the centres, (K, 2).
        propulsion_w: of the fleet.
        other_transmit_w: of the other drones.
        utilities: result, (C,).
        sources: not used; see ``SOURCES``.
    """
    people = len(ground.weights)
    total = ground.weights.sum()
    before = np.empty((drones + ground.mast_count, _SUMS))
    cells = np.empty_like(before)
    place = np.empty(people, np.int64)
    utilities[:] = 0.0
    for point in range(len(offsets_m)):
        _fill_cells(ground, ranking, point, drone, place, before)
        for move in range(len(moves)):
            cells[:] = before
            _take_over(rules, ground, ranking, drones, drone, point, place, moves[move], offsets_m[point], cells)  # fmt: skip # noqa: E501
            power_w = total_power_w(propulsion_w, other_transmit_w + moves[move, 3])
            utilities[move] += _utility(rules, cells, drones, total, power_w)
    for move in range(len(moves)):
        utilities[move] /= len(offsets_m)


@njit(error_model="numpy")
def _take_over(
    rules: Rules,
    ground: Ground,
    ranking: Ranking,
    drones: int,
    drone: int,
    point: int,
    place: NDArray[np.int64],
    station: Floats,
    offset_m: Floats,
    cells: Floats,
) -> None:
    """Those who receive a drone at a place best leave their cells for that of the drone.

    Most are too far away even if there were a line of sight, which takes no exponential to see.
    """
    east_m, north_m = station[0] + offset_m[0], station[1] + offset_m[1]
    altitude_m, transmit_w = station[2], station[3]
    reach_w_m2 = transmit_w * rules.best_case_gain_m2
    for person in range(len(place)):
        dx = ground.coordinates_m[0, person] - east_m
        dy = ground.coordinates_m[1, person] - north_m
        squared = dx * dx + dy * dy + altitude_m * altitude_m
        before_w = ranking.power_w[place[person], point, person]
        if reach_w_m2 <= before_w * squared:
            continue
        power_w = link_power_w(transmit_w, squared, altitude_m, rules.link, rules.access_gain_db)
        if power_w <= before_w or power_w < rules.required_power_w:
            continue
        weight = ground.weights[person]
        server = ranking.server[place[person], point, person]
        if server != NOBODY:
            _add(cells[server], ranking.efficiency[place[person], point, person], -weight)
        _add(cells[drone], _efficiency(rules, drones, drone, power_w), weight)


@compiled
def judge_plan(
    rules: Rules,
    ground: Ground,
    ranking: Ranking,
    drones: int,
    propulsion_w: float,
    transmit_w: float,
    utilities: Floats,
    sources: str = SOURCES,
) -> None:
    """Utility of a plan at every point, (K,), from its ranking."""
    cells = np.empty((drones + ground.mast_count, _SUMS))
    place = np.empty(len(ground.weights), np.int64)
    total, power_w = ground.weights.sum(), total_power_w(propulsion_w, transmit_w)
    for point in range(len(utilities)):
        _fill_cells(ground, ranking, point, NOBODY, place, cells)
        utilities[point] = _utility(rules, cells, drones, total, power_w)


@njit(error_model="numpy")
def _utility(rules: Rules, cells: Floats, drones: int, total: float, power_w: float) -> float:
    """U_total at training progress 1 with all people as targets (P1, P3).

    Coverage and the rates' Jain index are over all people, loads and energy over drones.
    """
    served, load_squares = 0.0, 0.0
    drones_served, drones_rate_bps = 0.0, 0.0
    rates_bps, squares = 0.0, 0.0
    for index in range(len(cells)):
        cell = cells[index]
        if cell[COUNT] < 0.5:  # what is left of sums that came and went means nothing
            continue
        bandwidth_hz = rules.bandwidth_hz if index < drones else rules.mast_bandwidth_hz
        throughput_bps = cell_throughput_bps(
            rules.share_rule, bandwidth_hz, cell[COUNT], cell[SUM], cell[INVERSE_SUM],
            cell[SQUARE_SUM],
        )  # fmt: skip
        squares += cell_squared_rates(
            rules.share_rule, bandwidth_hz, cell[COUNT], cell[SUM], cell[INVERSE_SUM],
            cell[SQUARE_SUM], cell[FOURTH_SUM],
        )  # fmt: skip
        served += cell[COUNT]
        rates_bps += throughput_bps
        if index < drones:
            drones_served += cell[COUNT]
            load_squares += cell[COUNT] * cell[COUNT]
            drones_rate_bps += throughput_bps
    efficiency = normalised_energy_efficiency(
        energy_efficiency(drones_rate_bps, power_w, rules.power_epsilon_w),
        rules.efficiency_scale_bit_per_joule,
    )
    return composite_reward(
        rules.coverage_weight,
        rules.efficiency_weight,
        rules.load_weight,
        rules.rate_weight,
        coverage_ratio(served, total),
        efficiency,
        jain_index_from_sums(drones_served, load_squares, drones),
        jain_index_from_sums(rates_bps, squares, total),
    )
