"""How good the planner's search is: ``python -m studies.planning --jobs 2``.

Thirty made-up sites of three to twelve drones: the utility after times that a budget leaves for the
search, against ten times as long, and against CMA-ES on the same plans. For four more with up to
six drones and a hundred people, ten searches with ten times the default budget each. Results are
written after every site, and the same command continues there.
"""

import argparse
import warnings
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry import Polygon, box

from orchid_uav.envs import Parameters
from orchid_uav.experiments.planning.clusterings import best_clustering
from orchid_uav.experiments.planning.model import Budget, Mast, People, Surroundings
from orchid_uav.experiments.planning.network import Fleet
from orchid_uav.experiments.planning.region import Region, region_of
from orchid_uav.experiments.planning.search import search
from orchid_uav.experiments.planning.site import Site
from orchid_uav.storage.files import read_document
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

NAME = "planning"
SITES, SMALL_SITES, STARTS = 30, 4, 10
TIMES_S = (0.25, 0.5, 1.0, 2.5, 5.0, 50.0)
"""Of the search alone, which has half of a budget: 5 s are those of ``--budget 10s``."""
DEFAULT_S = 2.5
"""The search's part of the default budget."""
CMA_S = 5.0
LARGE = (25, 100)
"""Numbers of drones of larger sites, with a hundred people each."""
_LARGEST_STEP = 0.4
_OUTSIDE = -1.0
"""Utility of plans with drones too near to each other, for CMA-ES."""


def site_of(number: int, drones: int, people: int) -> tuple[Fleet, Region]:
    """A made-up site: people in groups, perhaps masts, and a zone where nobody may fly."""
    generator = np.random.default_rng([number, drones, people])
    side_m = 700.0 * np.sqrt(drones) + 500.0
    parents_m = generator.uniform(0.0, side_m, (drones + 2, 2))
    groups = generator.integers(len(parents_m), size=people)
    positions_m = parents_m[groups] + generator.normal(0.0, 150.0, (people, 2))
    crowd = People(np.clip(positions_m, 0.0, side_m), generator.integers(1, 6, people))
    masts = generator.uniform(0.0, side_m, (int(generator.integers(3)), 2))
    west_m, south_m = generator.uniform(0.0, 0.7 * side_m, 2)
    zone = box(west_m, south_m, west_m + 0.2 * side_m, south_m + 0.2 * side_m)
    surroundings = Surroundings(
        site=Site(),
        area=box(-300.0, -300.0, side_m + 300.0, side_m + 300.0),
        no_fly=zone if number % 2 else Polygon(),
        masts=tuple(Mast(*mast, 30.0) for mast in masts.tolist()),
        home_m=(0.0, 0.0),
        home_height_amsl_m=0.0,
        lowest_m=80.0,
        highest_m=120.0,
        clearance_m=50.0,
    )
    parameters = Parameters()
    fleet = Fleet(parameters, crowd, surroundings.masts, drones, 40.0)
    return fleet, region_of(surroundings, 40.0, parameters)


def usual_site(number: int) -> tuple[Fleet, Region]:
    """One of the thirty sites."""
    generator = np.random.default_rng(number)
    return site_of(number, int(generator.integers(3, 13)), int(generator.integers(50, 1001)))


def course(fleet: Fleet, region: Region, times_s: tuple[float, ...]) -> dict[str, float]:
    """The best utility at each of some times of one search, and how many plans it judged."""
    begun_s = perf_counter()
    found: dict[str, float] = {}

    def note(share: float, utility: float) -> None:
        for time_s in times_s[:-1]:
            if perf_counter() - begun_s >= time_s:
                found.setdefault(f"{time_s:g}", utility)

    last = search(fleet, region, Budget(seconds=times_s[-1]), 0, note)
    return found | {f"{times_s[-1]:g}": last.utility, "evaluations": last.evaluations}


def evolved(fleet: Fleet, region: Region, seconds: float, prices_distance: bool = False) -> float:
    """The best utility that CMA-ES finds from the same clusterings, over all coordinates.

    Plans whose drones are too near to each other are refused. With many drones nearly all plans
    that it draws are, so there the distance can be priced instead.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma

    begun_s = perf_counter()
    start, best, _ = best_clustering(fleet, region, 0)
    uav = fleet.parameters.uav
    west_m, south_m, east_m, north_m = region.allowed.bounds
    low = np.array([west_m, south_m, region.lowest_m, uav.min_transmit_power_w])
    high = np.array([east_m, north_m, region.highest_m, uav.max_transmit_power_w])

    def plan_of(point: NDArray[np.float64]) -> NDArray[np.float64]:
        plan = low + np.clip(point.reshape(-1, 4), 0.0, 1.0) * (high - low)
        plan[:, :2] = region.nearest(plan[:, :2])
        return plan

    def loss(point: NDArray[np.float64]) -> float:
        plan = plan_of(point)
        apart_m = np.linalg.norm(plan[:, None, :2] - plan[None, :, :2], axis=2)
        np.fill_diagonal(apart_m, np.inf)
        if prices_distance:
            lacking = np.maximum(region.spacing_m - apart_m, 0.0) / region.spacing_m
            return float(lacking.sum()) - fleet.utility(plan)
        return -_OUTSIDE if apart_m.min() < region.spacing_m else -fleet.utility(plan)

    point, step = ((start - low) / (high - low)).ravel(), 0.05
    while perf_counter() - begun_s < seconds:
        strategy = cma.CMAEvolutionStrategy(
            point, step, {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9}
        )
        while not strategy.stop() and perf_counter() - begun_s < seconds:
            points = strategy.ask()
            losses = [loss(one) for one in points]
            strategy.tell(points, losses)
            best = max(best, -min(losses))
        step = min(
            2.0 * step, _LARGEST_STEP
        )  # where it has stopped, it begins again with larger steps
    return best


def measure_usual(number: int) -> dict[str, Any]:
    """A usual site: the course of the search, and CMA-ES."""
    fleet, region = usual_site(number)
    search(fleet, region, Budget(evaluations=50), 0)  # compiles
    return {
        "drones": fleet.drones,
        "positions": len(fleet.people.weights),
        "masts": len(fleet.masts),
        "search": course(fleet, region, TIMES_S),
        "cma": evolved(fleet, region, CMA_S),
    }


def measure_small(number: int) -> dict[str, Any]:
    """A small site: the default, and ten starts with ten times its time each."""
    drones = 3 + number % 4
    fleet, region = site_of(100 + number, drones, 100)
    default = search(fleet, region, Budget(seconds=DEFAULT_S), 0)
    others = [
        search(fleet, region, Budget(seconds=STARTS * DEFAULT_S), seed) for seed in range(STARTS)
    ]
    return {
        "drones": drones,
        "default": default.utility,
        "others": sorted(found.utility for found in others),
    }


def measure_large(drones: int) -> dict[str, Any]:
    """A large site: the course of the search, and CMA-ES in the longest of its times."""
    fleet, region = site_of(200, drones, 100 * drones)
    search(fleet, region, Budget(evaluations=50), 0)  # compiles
    times_s = (2.5, 5.0, 20.0, 100.0)
    return {
        "positions": len(fleet.people.weights),
        "search": course(fleet, region, times_s),
        "cma": evolved(fleet, region, times_s[-1], prices_distance=True),
    }


KINDS: dict[str, tuple[Callable[[int], dict[str, Any]], tuple[int, ...]]] = {
    "usual": (measure_usual, tuple(range(SITES))),
    "small": (measure_small, tuple(range(SMALL_SITES))),
    "large": (measure_large, LARGE),
}


def measure(kind: str, number: int) -> dict[str, Any]:
    """One site, for a process of its own."""
    return KINDS[kind][0](number)


def main() -> None:
    """Measure all sites, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=1)
    add_recording_options(parser, RESULTS / f"{NAME}.json")
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    settings = {"times_s": TIMES_S, "default_s": DEFAULT_S, "cma_s": CMA_S, "starts": STARTS}
    found = read_document(options.json)["sites"] if options.json.exists() else {}
    wanted = [(kind, number) for kind, (_, numbers) in KINDS.items() for number in numbers]
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        waiting = {
            pool.submit(measure, *one): one
            for one in wanted
            if str(one[1]) not in found.get(one[0], {})
        }
        for finished in as_completed(waiting):
            kind, number = waiting[finished]
            found.setdefault(kind, {})[str(number)] = finished.result()
            ordered = {
                name: {
                    str(one): found[name][str(one)] for one in numbers if str(one) in found[name]
                }
                for name, (_, numbers) in KINDS.items()
                if name in found
            }
            write_result(options.json, record(settings, sites=ordered), ('{"drones"', '"search"'))
            print(kind, number, flush=True)


if __name__ == "__main__":
    main()
