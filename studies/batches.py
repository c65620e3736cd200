"""Seconds against utility: ``python -m studies.batches --json FILE``.

How long a run of the paper's 700 episodes takes and how well its policy flies, for several numbers
of worlds and sizes of minibatches. Every run has one thread; its seconds are the processor's, so
that what else the machine does hardly matters. Results are written after every run, and the same
command continues there.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from orchid_uav.experiments.configuration import Layer, merge
from orchid_uav.experiments.evaluation.methods import select
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.experiments.training.loop import train
from orchid_uav.storage.files import read_document
from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result
from studies.tuning import TOPOLOGIES, flown

NAME = "batches"
EVALUATION_SEED = 0


class Case(NamedTuple):
    """What differs from the paper's run."""

    worlds: int
    minibatch: str
    batch_size: int

    def overrides(self) -> dict[str, Any]:
        """Values of the configuration."""
        return {
            "training.worlds": self.worlds,
            "ppo.minibatch": self.minibatch,
            "ppo.batch_size": self.batch_size,
        }


CASES = (
    Case(1, "rows", 128),
    Case(1, "rows", 768),
    Case(1, "slots", 128),
    Case(10, "rows", 128),
    Case(10, "slots", 128),
    Case(10, "slots", 1000),
    Case(100, "slots", 128),
    Case(100, "slots", 1000),
)


def run(case: Case, seed: int, episodes: int) -> dict[str, Any]:
    """Train one policy and fly it."""
    values = {"training.seed": seed, "training.episodes": episodes, **case.overrides()}
    config = merge([Layer("batches", values)])[0]
    with tempfile.TemporaryDirectory() as directory:
        made = RunDirectory.create(Path(directory), NAME, config, [])
        before_s = time.process_time()
        train(config, made, Reporter())
        cpu_s = time.process_time() - before_s
        contender = select([], [made.path])[0]
        return {
            **case._asdict(),
            "seed": seed,
            "cpu_s": round(cpu_s, 1),
            **flown(contender, EVALUATION_SEED),
        }


def missing(rows: list[Mapping[str, Any]], seeds: int) -> Iterator[tuple[Case, int]]:
    """Runs that are not among the rows, one seed after the other."""
    known = {(Case(*(row[name] for name in Case._fields)), row["seed"]) for row in rows}
    for seed in range(seeds):
        for case in CASES:
            if (case, seed) not in known:
                yield case, seed


def main() -> None:
    """Train, fly and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--episodes", type=int, default=700)
    add_recording_options(parser, RESULTS / f"{NAME}.json")
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    settings = {
        "topologies": TOPOLOGIES,
        "evaluation_seed": EVALUATION_SEED,
        "seeds": options.seeds,
        "episodes": options.episodes,
    }
    rows: list[Any] = read_document(options.json)["runs"] if options.json.exists() else []
    zero_action = flown(select(["static-mmf"])[0], EVALUATION_SEED)
    for case, seed in missing(rows, options.seeds):
        rows.append(run(case, seed, options.episodes))
        print(rows[-1], flush=True)
        document = record(settings, zero_action=zero_action, runs=rows)
        write_result(options.json, document, ('{"worlds"',))


if __name__ == "__main__":
    main()
