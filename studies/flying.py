"""What flies well: ``python -m studies.flying --distilled DIRECTORY --informed DIRECTORY``.

Policies of several training seeds of each kind, their zero-action twins and the rules on stations,
over one axis at a time from six UAVs and a hundred users that walk at 10 m/s. Differences are
paired by topology. Results are written after every setting, and the same command continues there.
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
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.method_keys import SENSED
from orchid_uav.experiments.evaluation.methods import Contender, read_policy, rows_of, select
from orchid_uav.experiments.metrics import EVALUATION_METRICS
from orchid_uav.experiments.statistics.intervals import summarise
from orchid_uav.storage.files import read_document
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

NAME = "flying"
TOPOLOGIES, EVALUATION_SEED = 100, 0
LEARNED = ("orchid-distilled", "orchid-informed")
RULES = ("best-response", "forces")
OLD_RULES = ("planner", "track-120", "track", "balanced-loiter", "loiter-mmf", "static-mmf")
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
    "blocking_pairs",
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
    with_old: bool = False
    """Whether the rules that do not use stations are flown as well."""

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
    *(
        Case("speed", BASE._replace(speed_mps=speed), with_old=True)
        for speed in (0.0, 5.0, 10.0, 15.0)
    ),
    *(
        Case("headings of 1 s", BASE._replace(speed_mps=speed, heading_hold_s=1.0), with_old=True)
        for speed in (10.0, 15.0)
    ),
    *(  # a case is one slot: that with which its episodes end
        Case("convergence", STILL, {"network.episode_slots": slot}, slot, with_bound=False)
        for slot in (1, 10, 20, 30, 60, 100, 200)
    ),
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


def contenders(case: Case, runs: Mapping[str, Sequence[Path]]) -> dict[str, Contender]:
    """Policies by seed, their twins, and the rules, by the names that the results have.

    Args:
        case: the setting.
        runs: run directories by the kind of policy, one of LEARNED.
    """
    found: dict[str, Contender] = {}
    for kind, paths in runs.items():
        policies = [read_policy(path) for path in paths]
        for policy in policies:
            name = f"{kind}-s{policy.config.training.seed}"
            found[name] = rows_of(policy, kind, "", False, False)[0]
        found[f"{kind}-zero"] = rows_of(policies[0], kind, "", False, True)[0]
    # Where Phase I sees the users as they are, both starts are the same, and one is drawn for all.
    on_stations = [*RULES, *([BOUND] if case.with_bound else [])]
    keys = {key: f"{key}{SENSED}" for key in on_stations}
    if case.with_old:
        keys |= {key: key for key in OLD_RULES}
    for name, key in keys.items():
        found[name] = select([key])[0]
    return {name: replace(contender, key=name) for name, contender in found.items()}


def fly(case: Case, runs: Mapping[str, Sequence[Path]]) -> dict[str, Any]:
    """Means of all methods, and differences of the learned policies to the others."""
    flown_by = contenders(case, runs).values()
    world = Parameters().with_overrides(dict(case.overrides))
    plan = EvaluationPlan(
        list(flown_by), [case.setting], TOPOLOGIES, EVALUATION_SEED, world, case.first_slot
    )
    flown, _ = evaluate(plan)
    found = {key[len(case.setting)]: metrics for key, metrics in flown.items()}
    seeds = {kind: [name for name in found if name.startswith(f"{kind}-s")] for kind in runs}
    means: dict[str, dict[str, NDArray[np.float64]]] = {
        kind: {
            metric: np.mean([found[name][metric] for name in names], axis=0)
            for metric in EVALUATION_METRICS
        }
        for kind, names in seeds.items()
    }
    of_a_seed = {name for names in seeds.values() for name in names}
    others = {name: metrics for name, metrics in found.items() if name not in of_a_seed}
    return {
        "axis": case.axis,
        "setting": case.setting._asdict() | dict(case.overrides),
        "first_slot": case.first_slot,
        "methods": {
            name: {metric: float(metrics[metric].mean()) for metric in METRICS}
            for name, metrics in {**means, **found}.items()
        },
        "least_coverage": {
            name: float(metrics["coverage"].min()) for name, metrics in found.items()
        },
        "learned_less": {
            kind: {
                name: {
                    metric: summarise(mean[metric] - metrics[metric]).to_json() for metric in PAIRED
                }
                for name, metrics in others.items()
            }
            for kind, mean in means.items()
        },
    }


def _fly_number(number: int, runs: Mapping[str, Sequence[Path]]) -> dict[str, Any]:
    """:func:`fly` for a process of its own."""
    return fly(CASES[number], runs)


def main() -> None:
    """Fly all cases, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for kind in LEARNED:
        preset = kind.removeprefix("orchid-")
        parser.add_argument(
            f"--{preset}", type=Path, required=True, help=f"runs of --preset {preset}"
        )
    parser.add_argument("--jobs", type=int, default=1)
    add_recording_options(parser, RESULTS / f"{NAME}.json")
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    runs = {
        kind: sorted(
            path
            for path in getattr(options, kind.removeprefix("orchid-")).iterdir()
            if (path / "policy.json").is_file()
        )
        for kind in LEARNED
    }
    settings = {
        "topologies": TOPOLOGIES,
        "evaluation_seed": EVALUATION_SEED,
        "training_seeds": {
            kind: sorted(read_policy(path).config.training.seed for path in paths)
            for kind, paths in runs.items()
        },
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
