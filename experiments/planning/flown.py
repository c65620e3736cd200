"""Stations where a method of ``orchid eval`` or a run flies to, on the people of a plan."""

from pathlib import Path

import numpy as np

from orchid_uav.envs import WorldBatch
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.method_keys import known_methods
from orchid_uav.experiments.evaluation.methods import (
    Contender,
    read_policy,
    rows_of,
    select,
)
from orchid_uav.experiments.planning.clusterings import settled
from orchid_uav.experiments.planning.model import Floats, Surroundings
from orchid_uav.experiments.planning.network import Fleet
from orchid_uav.experiments.planning.region import Region
from orchid_uav.experiments.runs.records import find_run
from orchid_uav.suggestions import unknown

MOST_USERS = 5000
"""Users of the simulated world; where people are more, so many of them are drawn."""
_AVERAGED_SLOTS = 60
"""Some three turns of a circle, over which the place of a drone is averaged at the end."""


def find_method(name: str, runs_dir: Path, own: tuple[str, ...]) -> Contender | None:
    """The method of a name, None for one of the planner's ``own``.

    Raises:
        InputError: it is neither a method nor a run.
    """
    if name in own:
        return None
    if name in known_methods():
        return select([name])[0]
    try:
        path = find_run(name, runs_dir)
    except InputError as error:
        raise InputError(
            f"{unknown('method', name, [*own, *known_methods()], cutoff=0.4)}, nor is it a run: "
            f"{error}"
        ) from error
    return rows_of(read_policy(path), name, "", False, False)[0]


def flown_plan(
    contender: Contender, fleet: Fleet, surroundings: Surroundings, region: Region, seed: int
) -> Floats:
    """The plan (N, 4) of where drones are at the end of an episode that a method flies.

    The world is the box round the area, without masts, so that all people are to be served. Places
    that are not allowed are moved to the nearest that are.

    Raises:
        InputError: the method cannot fly there, or there is no room for so many drones.
    """
    west_m, south_m, east_m, north_m = surroundings.area.bounds
    corner_m = np.array([west_m, south_m])
    people = fleet.people
    users_m = np.repeat(people.positions_m, people.weights, axis=0)
    if len(users_m) > MOST_USERS:
        generator = np.random.default_rng(seed)
        users_m = users_m[np.sort(generator.choice(len(users_m), MOST_USERS, replace=False))]
    sides_m = np.array([east_m - west_m, north_m - south_m])
    users_m = np.clip(users_m - corner_m, 0.0, sides_m)
    try:
        parameters = fleet.parameters.with_overrides(
            {
                **contender.overrides,
                "network.area_m": sides_m.tolist(),
                "network.uav_count": fleet.drones,
                "network.user_count": len(users_m),
                "network.failures": [],
                "gbs.positions_m": [],
                "uav.station.centre_spacing_m": region.spacing_m,
            }
        )
        world = WorldBatch(parameters, seed=[seed], user_positions_m=users_m)
        world.set_progress(1.0)
        world.reset()
        method = contender.make([seed])
        method.begin(world)
        slots = parameters.network.episode_slots
        places_m = np.zeros((fleet.drones, 2))
        last = min(_AVERAGED_SLOTS, slots)
        for slot in range(slots):
            world.step(method.act(world))
            if slot >= slots - last:
                places_m += world.arrays.positions_m[0, :, :2] / last
    except ValueError as error:
        raise InputError(f"{contender.key} cannot fly here: {error}") from error
    plan = np.empty((fleet.drones, 4))
    plan[:, :2] = settled(places_m + corner_m, region)
    plan[:, 2] = np.clip(world.arrays.positions_m[0, :, 2], region.lowest_m, region.highest_m)
    plan[:, 3] = world.arrays.transmit_powers_w[0]
    return plan
