"""MAPPO and MADDPG beside public implementations on MPE2's simple_spread: ``make validation``.

Every run is a process of its own, with one thread, in the Python environment of its library. The
learners take turns seed by seed, so that disturbances of the machine affect all of them. Runs that
are already in ``--runs`` with the same settings are not repeated. A run that fails counts as a
failure, and is tried again the next time. Rows and comparison are written to one JSON file.
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

from studies.recording import (
    ONE_THREAD,
    RESULTS,
    add_recording_options,
    record,
    require_commit,
    write_result,
)
from studies.simple_spread.comparison import compare
from studies.simple_spread.rules import baselines
from studies.simple_spread.task import MADDPG_SETTINGS, PPO_SETTINGS, Settings

ROOT = Path(__file__).parents[2]
PYTHONS = {
    "orchid": sys.executable,
    "benchmarl": ".venv-benchmarl/bin/python",
    "agilerl": ".venv-agilerl/bin/python",
}
_PPO = {"frames": 200_000, "learning_rate": 1e-3}
_MADDPG = {"frames": 150_000, "learning_rate": 1e-3}
SEEDS = 10
TUNING_SEED = 100


def name_of(library: str, method: str) -> str:
    """The name of an arm."""
    return f"{library} {method}"


@dataclass(frozen=True)
class Arm:
    """One learner of a library, with its changes to the common settings."""

    library: str
    method: str
    changes: Mapping[str, float] = field(default_factory=dict)
    seeds: int = SEEDS

    @property
    def name(self) -> str:
        """The name in results, such as "orchid mappo"."""
        return name_of(self.library, self.method)

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, in the form in which JSON returns them."""
        return json.loads(json.dumps(asdict(Settings(**self.changes))))

    def is_of(self, settings: Mapping[str, Any]) -> bool:
        """Whether a run with these settings is of this arm; the other algorithm's do not count."""
        others = PPO_SETTINGS if self.method.startswith("maddpg") else MADDPG_SETTINGS
        return all(
            settings.get(name) == value
            for name, value in self.settings.items()
            if name not in others
        )

    def command(self, pythons: Mapping[str, str], seed: int, out: Path) -> list[str]:
        """The command that trains one seed."""
        command = [pythons[self.library], "-m", "studies.simple_spread.train"]
        command += [self.library, self.method, "--seed", str(seed), "--out", str(out)]
        for name, value in self.changes.items():
            command += ["--set", f"{name}={value}"]
        return command

    def file(self, seed: int) -> str:
        """The name of a run's file."""
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
    Arm("orchid", "maddpg-tripled", _MADDPG, seeds=5),
)
_TRIED = {"frames": 100_000}
TRIALS = (
    *(
        (Arm("benchmarl", "mappo", _TRIED | changes), TUNING_SEED)
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
        (Arm("benchmarl", "maddpg", _TRIED | changes), TUNING_SEED)
        for changes in (
            {"learning_rate": 1e-3, "exploration_std": 0.1},
            {"learning_rate": 5e-4, "exploration_std": 0.1},
            {"learning_rate": 1e-3, "exploration_std": 0.2},
        )
    ),
    *(
        (Arm(library, method, {"frames": 250_000, "learning_rate": 3e-3}), 0)
        for library, method in (
            ("benchmarl", "mappo"),
            ("benchmarl", "mappo-gaussian"),
            ("orchid", "mappo"),
        )
    ),
)
"""Arms that were tried before the settings were chosen, with their numbers of seeds. The last three
began the comparison, until BenchMARL's actions became NaN; then all learners got the lower rate."""


def jobs(arms: tuple[Arm, ...], seeds: int) -> Iterator[tuple[Arm, int]]:
    """Arms and seeds, seed by seed."""
    for seed in range(seeds):
        for arm in arms:
            if seed < arm.seeds:
                yield arm, seed


def run(arm: Arm, seed: int, pythons: Mapping[str, str], directory: Path) -> dict[str, Any]:
    """The row of one run, trained unless it exists; "failed" gives the reason of a failure."""
    path = directory / arm.file(seed)
    if path.exists():
        row = json.loads(path.read_text(encoding="utf-8"))
        if arm.is_of(row["settings"]):
            return row
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
    if outcome.returncode == 0:
        return json.loads(path.read_text(encoding="utf-8"))
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    said = [line for line in lines if "Error" in line]
    reason = said[-1].strip() if said else f"ended with {outcome.returncode}"
    return {"library": arm.library, "method": arm.method, "seed": seed, "failed": reason}


def run_all(
    todo: list[tuple[Arm, int]], pythons: Mapping[str, str], directory: Path, parallel: int
) -> list[dict[str, Any]]:
    """Rows in the order of ``todo``; ``parallel`` runs are trained at a time."""
    directory.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(parallel) as pool:
        return list(pool.map(lambda job: run(*job, pythons, directory), todo))


def compact(row: Mapping[str, Any]) -> dict[str, Any]:
    """A run as stored: the mean of its final episodes, and the curve without its frames."""
    run = {"arm": name_of(row["library"], row["method"]), "seed": row["seed"]}
    if "failed" in row:
        return run | {"final_return": None, "failed": row["failed"]}
    returns = row["final_returns"]
    return run | {
        "final_return": sum(returns) / len(returns),
        "training_s": row["training_s"],
        "curve": [value for _, value in row["curve"]],
    }


def arm_record(arm: Arm, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What all runs of an arm have in common.

    Raises:
        SystemExit: the runs were trained with different versions, or all of them failed.
    """
    own = [row for row in rows if name_of(row["library"], row["method"]) == arm.name]
    versions = {json.dumps(row["versions"]) for row in own if "failed" not in row}
    if len(versions) != 1:
        raise SystemExit(f"{arm.name}: trained with {len(versions)} sets of versions, not one")
    return {
        "changes": dict(arm.changes),
        "frames": Settings(**arm.changes).curve_frames,
        "versions": json.loads(versions.pop()),
    }


def add_pythons(parser: argparse.ArgumentParser) -> None:
    """Add options for Python environments of public libraries in other places."""
    for library in ("benchmarl", "agilerl"):
        parser.add_argument(
            f"--{library}-python", default=str(ROOT / PYTHONS[library]), metavar="FILE"
        )


def chosen_pythons(arguments: argparse.Namespace) -> dict[str, str]:
    """The Python of every library."""
    return PYTHONS | {
        library: getattr(arguments, f"{library}_python") for library in ("benchmarl", "agilerl")
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=Path, default=ROOT / "runs" / "validation")
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--jobs", type=int, default=2, help="runs at a time, one core each")
    add_pythons(parser)
    add_recording_options(parser, RESULTS / "validation.json")
    arguments = parser.parse_args()
    require_commit(parser, arguments, arguments.json)
    pythons = chosen_pythons(arguments)
    todo = [*jobs(ARMS, arguments.seeds), *TRIALS]
    rows = run_all(todo, pythons, arguments.runs, arguments.jobs)
    rows, trials = rows[: -len(TRIALS)], rows[-len(TRIALS) :]
    compacted = [compact(row) for row in rows]
    rules = baselines(Settings())
    document = record(
        {"settings": asdict(Settings()), "jobs": arguments.jobs, "seeds": arguments.seeds},
        arms={arm.name: arm_record(arm, rows) for arm in ARMS},
        baselines=rules,
        comparison=compare(compacted, rules["random"]),
        trials=[
            {"changes": dict(arm.changes)} | compact(row)
            for (arm, _), row in zip(TRIALS, trials, strict=True)
        ],
        runs=compacted,
        # Without this machine's paths of the runs and of each library's Python.
        command="python -m studies.simple_spread.study",
    )
    beginnings = ('{"arm":"', '{"changes":', '"arms":', '"baselines":', '"comparison":', '"pairs')
    write_result(arguments.json, document, beginnings)


if __name__ == "__main__":
    main()
