"""Train one learner with one seed.

``python -m studies.simple_spread.train LIBRARY METHOD --seed 0 --out FILE``

This runs in the Python environment of the library, which need not have ``orchid_uav``.
"""

import argparse
import importlib
import json
import platform
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import torch

from studies.simple_spread.task import Settings, final_returns

LIBRARIES = {
    "orchid": ("mappo", "ippo", "maddpg", "maddpg-tripled"),
    "benchmarl": ("mappo", "mappo-gaussian", "mappo-stock", "maddpg"),
    "agilerl": ("maddpg",),
}


def train(library: str, method: str, seed: int, settings: Settings) -> dict[str, Any]:
    """Train a learner and judge its policy."""
    torch.set_num_threads(1)
    learners = importlib.import_module(f"studies.simple_spread.{library}_learners")
    learned = learners.learn(method, seed, settings)
    return {
        "library": library,
        "method": method,
        "seed": seed,
        "settings": asdict(settings),
        "versions": {"python": platform.python_version()} | learned.versions,
        "training_s": learned.training_s,
        "curve": learned.progress.curve,
        "final_returns": final_returns(learned.policy, settings),
    }


def changed(settings: Settings, changes: list[str]) -> Settings:
    """``settings`` with "name=value" applied.

    Raises:
        ValueError: there is no numeric setting of that name, or the value is not a number.
    """
    kinds = {one.name: type(getattr(settings, one.name)) for one in fields(settings)}
    wanted = {}
    for change in changes:
        name, _, value = change.partition("=")
        if kinds.get(name) not in (int, float):
            numbers = ", ".join(known for known, kind in kinds.items() if kind in (int, float))
            raise ValueError(f"'{name}' is none of {numbers}")
        wanted[name] = kinds[name](value)
    return replace(settings, **wanted)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("library", choices=LIBRARIES)
    parser.add_argument(
        "method", choices=sorted({one for own in LIBRARIES.values() for one in own})
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE")
    arguments = parser.parse_args()
    if arguments.method not in LIBRARIES[arguments.library]:
        parser.error(f"{arguments.library} has no {arguments.method} here")
    try:
        settings = changed(Settings(), arguments.set)
    except ValueError as error:
        parser.error(str(error))
    document = train(arguments.library, arguments.method, arguments.seed, settings)
    unfinished = arguments.out.with_suffix(".part")
    unfinished.write_text(json.dumps(document) + "\n", encoding="utf-8")
    unfinished.replace(arguments.out)


if __name__ == "__main__":
    main()
