"""What flies well: ``python -m studies.flying --runs DIRECTORY``.

Policies of several training seeds, their zero-action twin and the rules on stations, over one axis
at a time from six UAVs and a hundred users that walk at 10 m/s. Differences are paired by topology.
Results are written after every setting, and the same command continues there.
"""

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchid_uav.envs import Parameters
from orchid_uav.experiments.evaluation.flights import Plan, Setting, evaluate
from orchid_uav.experiments.evaluation.method_keys import SENSED
from orchid_uav.experiments.evaluation.methods import Contender, read_policy, rows_of, select
from orchid_uav.experiments.metrics import EVALUATION_METRICS
from orchid_uav.experiments.statistics.intervals import summarise
from orchid_uav.storage.files import read_document
from studies.recording import RESULTS, add_allow_changes, record, require_commit, write_result

NAME = "flying"
TOPOLOGIES, EVALUATION_SEED = 100, 0
LEARNED = "orchid-distilled"
RULES = ("best-response", "forces")
OLD_RULES = ("track-120", "track", "balanced-loiter", "loiter-mmf", "static-mmf")
BOUND = "receding-horizon"
METRICS = (
    "utility",
    "rate_jfi",
    "load_jfi",
    "worst_rate_bps",
    "energy_efficiency_bit_per_joule",
    "thrust_energy_efficiency_bit_per_joule",
    "coverage",
    "collisions",
)
PAIRED = ("utility", "rate_jfi", "worst_rate_bps", "thrust_energy_efficiency_bit_per_joule")


class Case(NamedTuple):
    """A setting of the study."""

    axis: str
    """What it belongs to in the tables."""
    setting: Setting
    overrides: Mapping[str, Any] = MappingProxyType({})
    first_slot: int = 1
    with_bound: bool = True
    """Whether the receding horizon is flown as well, which takes longest."""

    @property
    def key(self) -> str:
        """A name for the results."""
        words = [f"{name}={value}" for name, value in self.setting._asdict().items()]
        words += [f"{name}={value}" for name, value in self.overrides.items()]
        return " ".join([*words, f"from={self.first_slot}"])


BASE = Setting(speed_mps=10.0, heading_hold_s=20.0)
FAST = BASE._replace(speed_mps=15.0)
STILL = BASE._replace(speed_mps=0.0)
CASES = (
    *(Case("speed", BASE._replace(speed_mps=speed)) for speed in (0.0, 5.0, 10.0, 15.0)),
    *(Case("UAVs at 15 m/s", FAST._replace(uavs=uavs)) for uavs in (4, 10)),
    *(
        Case("Phase I", STILL, {"network.sensing_error_std_m": error}, 31)
        for error in (0.0, 50.0, 150.0)
    ),
    *(
        Case("knowledge", FAST, {"sensing.flight_error_std_m": error, "sensing.delay_s": delay_s})
        for error, delay_s in ((150.0, 0.0), (150.0, 10.0), (0.0, 20.0))
    ),
    Case("failure", BASE, {"network.failures": ["2@60"]}, 91),
    *(Case("UAVs", BASE._replace(uavs=uavs), with_bound=False) for uavs in (4, 5, 7, 8, 9, 10)),
    *(Case("users", BASE._replace(users=users), with_bound=False) for users in (50, 150, 200)),
    Case("distribution", BASE._replace(distribution="uniform"), with_bound=False),
)


def contenders(case: Case, runs: Sequence[Path]) -> dict[str, Contender]:
    """Policies by seed, their twin, and the rules, by the names that the results have."""
    policies = [read_policy(path) for path in runs]
    found = {
        f"{LEARNED}-s{policy.config.training.seed}": rows_of(policy, LEARNED, "", False, False)[0]
        for policy in policies
    }
    found[f"{LEARNED}-zero"] = rows_of(policies[0], LEARNED, "", False, True)[0]
    # Where Phase I sees the users as they are, both starts are the same, and one is drawn for all.
    on_stations = [*RULES, *([BOUND] if case.with_bound else [])]
    keys = {key: f"{key}{SENSED}" for key in on_stations}
    if case.axis == "speed":
        keys |= {key: key for key in OLD_RULES}
    for name, key in keys.items():
        found[name] = select([key])[0]
    return {name: replace(contender, key=name) for name, contender in found.items()}


def fly(case: Case, runs: Sequence[Path]) -> dict[str, Any]:
    """Means of all methods, and differences of the learned policies to the others."""
    flown_by = contenders(case, runs).values()
    world = Parameters().with_overrides(dict(case.overrides))
    plan = Plan(list(flown_by), [case.setting], TOPOLOGIES, EVALUATION_SEED, world, case.first_slot)
    flown, _ = evaluate(plan)
    found = {key[len(case.setting)]: metrics for key, metrics in flown.items()}
    seeds = [name for name in found if name.startswith(f"{LEARNED}-s")]
    means: dict[str, NDArray[np.float64]] = {
        metric: np.mean([found[name][metric] for name in seeds], axis=0)
        for metric in EVALUATION_METRICS
    }
    others = {name: metrics for name, metrics in found.items() if name not in seeds}
    return {
        "axis": case.axis,
        "setting": case.setting._asdict() | dict(case.overrides),
        "first_slot": case.first_slot,
        "methods": {
            name: {metric: float(metrics[metric].mean()) for metric in METRICS}
            for name, metrics in {LEARNED: means, **found}.items()
        },
        "least_coverage": {
            name: float(metrics["coverage"].min()) for name, metrics in found.items()
        },
        "learned_less": {
            name: {
                metric: summarise(means[metric] - metrics[metric]).to_json() for metric in PAIRED
            }
            for name, metrics in others.items()
        },
    }


def _fly_number(number: int, runs: Sequence[Path]) -> dict[str, Any]:
    """:func:`fly` for a process of its own."""
    return fly(CASES[number], runs)


def main() -> None:
    """Fly all cases, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, required=True, help="runs of --preset distilled")
    parser.add_argument("--json", type=Path, default=RESULTS / f"{NAME}.json", metavar="FILE")
    parser.add_argument("--jobs", type=int, default=1)
    add_allow_changes(parser)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    runs = sorted(path for path in options.runs.iterdir() if (path / "policy.json").is_file())
    settings = {
        "topologies": TOPOLOGIES,
        "evaluation_seed": EVALUATION_SEED,
        "training_seeds": sorted(read_policy(path).config.training.seed for path in runs),
    }
    cases: dict[str, Any] = {}
    if options.json.exists():
        before = read_document(options.json)
        cases = before["cases"] if before["settings"] == settings else {}
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        waiting = {
            pool.submit(_fly_number, number, runs): case.key
            for number, case in enumerate(CASES)
            if case.key not in cases
        }
        for finished in as_completed(waiting):
            cases[waiting[finished]] = finished.result()
            ordered = {case.key: cases[case.key] for case in CASES if case.key in cases}
            write_result(options.json, record(settings, cases=ordered), ('{"axis"',))
            print(waiting[finished], flush=True)


if __name__ == "__main__":
    main()
