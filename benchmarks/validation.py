"""MAPPO and MADDPG beside public implementations on MPE2's simple_spread: ``make validation``.

Every run is a process of its own, with one thread, in the environment of its library; seed by seed
the learners take turns, so that whatever disturbs the machine disturbs all of them. Runs that lie
in ``--runs`` already are not done again; one that fails is counted as a failure, and tried again
the next time. The rows and the comparison go to one JSON file.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.measuring import record
from benchmarks.spread.comparison import compare
from benchmarks.spread.rules import baselines
from benchmarks.spread.task import Settings
from benchmarks.studies import RESULTS, rounded
from orchid_uav.experiments.files import write_atomically

ROOT = Path(__file__).parent.parent
PYTHONS = {
    "orchid": sys.executable,
    "benchmarl": ".venv-benchmarl/bin/python",
    "agilerl": ".venv-agilerl/bin/python",
}
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
_PPO = {"frames": 200_000, "learning_rate": 1e-3}
_MADDPG = {"frames": 150_000, "learning_rate": 1e-3}
SEEDS = 10
TUNING_SEED = 100


@dataclass(frozen=True)
class Arm:
    """One learner of a library, with what differs from the settings of all."""

    library: str
    method: str
    changes: Mapping[str, float] = field(default_factory=dict)
    seeds: int = SEEDS

    @property
    def name(self) -> str:
        """As in results: "orchid mappo"."""
        return f"{self.library} {self.method}"

    def command(self, pythons: Mapping[str, str], seed: int, out: Path) -> list[str]:
        """Trains one seed."""
        command = [pythons[self.library], "-m", "benchmarks.spread.train"]
        command += [self.library, self.method, "--seed", str(seed), "--out", str(out)]
        for name, value in self.changes.items():
            command += ["--set", f"{name}={value}"]
        return command

    def file(self, seed: int) -> str:
        """Name of a run's file."""
        changes = "".join(f"-{name}={value}" for name, value in self.changes.items())
        return f"{self.library}-{self.method}{changes}-s{seed}.json"


ARMS = (
    Arm("orchid", "mappo", _PPO),
    Arm("benchmarl", "mappo", _PPO),
    Arm("benchmarl", "mappo-gaussian", _PPO),
    Arm("orchid", "ippo", _PPO),
    Arm("orchid", "maddpg", _MADDPG),
    Arm("benchmarl", "maddpg", _MADDPG),
    Arm("agilerl", "maddpg", _MADDPG, seeds=5),
)
_TRIED = {"frames": 100_000}
TRIALS = (
    *(
        Arm("benchmarl", "mappo", _TRIED | changes)
        for changes in (
            {"learning_rate": 1e-3},
            {"learning_rate": 3e-3},
            {"learning_rate": 1e-3, "epochs": 20},
            {"learning_rate": 1e-3, "max_grad_norm": 0.5},
            {"learning_rate": 3e-3, "frames_per_iteration": 1250},
            {"learning_rate": 3e-3, "gamma": 0.9, "gae_lambda": 0.9},
        )
    ),
    *(
        Arm("benchmarl", "maddpg", _TRIED | changes)
        for changes in (
            {"learning_rate": 1e-3, "exploration_std": 0.1},
            {"learning_rate": 5e-4, "exploration_std": 0.1},
            {"learning_rate": 1e-3, "exploration_std": 0.2},
        )
    ),
)
"""What was tried before the settings were chosen: on the public code alone, with another seed."""
DIVERGED = Arm("benchmarl", "mappo", {"frames": 250_000, "learning_rate": 3e-3}), 0
"""Was to be compared first, and ended in actions that are no numbers."""


def jobs(arms: tuple[Arm, ...], seeds: int) -> Iterator[tuple[Arm, int]]:
    """Arms and seeds, seed by seed."""
    for seed in range(seeds):
        for arm in arms:
            if seed < arm.seeds:
                yield arm, seed


def run(arm: Arm, seed: int, pythons: Mapping[str, str], directory: Path) -> dict[str, Any]:
    """The row of one run, trained unless it is there already; "failed" says why there is none."""
    path = directory / arm.file(seed)
    if not path.exists():
        log = path.with_suffix(".log")
        with log.open("wb") as output:
            outcome = subprocess.run(
                arm.command(pythons, seed, path),
                cwd=ROOT,
                env=os.environ | ONE_THREAD,
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            )
        print(f"{arm.name}, seed {seed}: {outcome.returncode or 'done'}", flush=True)
        if outcome.returncode:
            said = [
                line for line in log.read_text(errors="replace").splitlines() if "Error" in line
            ]
            reason = said[-1].strip() if said else f"ended with {outcome.returncode}"
            return {"library": arm.library, "method": arm.method, "seed": seed, "failed": reason}
    return json.loads(path.read_text(encoding="utf-8"))


def run_all(
    todo: list[tuple[Arm, int]], pythons: Mapping[str, str], directory: Path, parallel: int
) -> list[dict[str, Any]]:
    """Rows in the order of ``todo``, ``parallel`` runs at a time."""
    directory.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(parallel) as pool:
        return list(pool.map(lambda job: run(*job, pythons, directory), todo))


def compact(row: Mapping[str, Any]) -> dict[str, Any]:
    """A run as it is kept: the mean of its final episodes, and the curve without its frames."""
    run = {"arm": f"{row['library']} {row['method']}", "seed": row["seed"]}
    if "failed" in row:
        return run | {"final_return": None, "failed": row["failed"]}
    returns = row["final_returns"]
    return run | {
        "final_return": sum(returns) / len(returns),
        "training_s": row["training_s"],
        "curve": [value for _, value in row["curve"]],
    }


def arm_record(arm: Arm, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What all runs of an arm have in common."""
    one = next(row for row in rows if row["library"] == arm.library and "failed" not in row)
    frames = Settings(**arm.changes).curve_frames
    return {"changes": dict(arm.changes), "frames": frames, "versions": one["versions"]}


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "validation")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time, a core each")
    parser.add_argument("--json", type=Path, default=RESULTS / "validation.json")
    for library in ("benchmarl", "agilerl"):
        parser.add_argument(
            f"--{library}-python", default=str(ROOT / PYTHONS[library]), metavar="FILE"
        )
    arguments = parser.parse_args()
    pythons = PYTHONS | {
        library: getattr(arguments, f"{library}_python") for library in ("benchmarl", "agilerl")
    }
    tried = [*((trial, TUNING_SEED) for trial in TRIALS), DIVERGED]
    todo = [*tried, *jobs(ARMS, arguments.seeds)]
    rows = run_all(todo, pythons, arguments.runs, arguments.jobs)
    trials, rows = rows[: len(tried)], rows[len(tried) :]
    compacted = [compact(row) for row in rows]
    rules = baselines(Settings())
    document = record(
        {"settings": asdict(Settings()), "jobs": arguments.jobs, "seeds": arguments.seeds},
        arms={arm.name: arm_record(arm, rows) for arm in ARMS},
        baselines=rules,
        comparison=compare(compacted, rules["random"]),
        trials=[
            {"changes": dict(arm.changes)} | compact(row)
            for (arm, _), row in zip(tried, trials, strict=True)
        ],
        runs=compacted,
    )
    text = json.dumps(rounded(document), ensure_ascii=False, separators=(",", ":"))
    for key in ('{"arm":"', '{"changes":', '"arms":', '"comparison":', '"baselines":'):
        text = text.replace(key, f"\n{key}")
    write_atomically(arguments.json, (text + "\n").encode())


if __name__ == "__main__":
    main()
