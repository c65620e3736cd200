"""What the program has to bear: ``python -m studies.torture [PART ...] [--scale 1]``.

Each part writes what it measured, and what failed, into a JSON file of its own. The command ends
with 1 if anything failed.
"""

import argparse
import importlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from studies.recording import RESULTS, add_recording_options, record, require_commit, write_result

PARTS = {
    "kills": "SIGKILL at random moments",
    "cycles": "stop and go, a thousand times",
    "faults": "full disks, read-only directories, clocks that jump",
    "fuzz": "random command lines and files",
    "fleets": "fleets of many UAVs and users",
}
"""Modules of this package, each with ``run(scale, seed)``: a JSON document with ``failures``."""
_LINES = ('{"subject":', '{"name":', '{"cycle":')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the parts that are named, one after the other; all if none is."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.torture", description=__doc__.splitlines()[0]
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--scale", type=float, default=1.0, help="share of everything (1)")
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn (0)")
    parser.add_argument("--json-dir", type=Path, default=RESULTS / "torture", metavar="DIRECTORY")
    add_recording_options(parser)
    options = parser.parse_args(arguments)
    for part in options.parts:
        if part not in PARTS:
            parser.error(f"there is no part {part}, only {', '.join(PARTS)}")
    if not 0.0 < options.scale <= 100.0:
        parser.error(f"--scale {options.scale} is not above 0 and at most 100")
    require_commit(parser, options, options.json_dir)
    failed = [
        part
        for part in options.parts or PARTS
        if not _passes(part, options.scale, options.seed, options.json_dir)
    ]
    return 1 if failed else 0


def _passes(part: str, scale: float, seed: int, json_dir: Path) -> bool:
    """Run a part and write its document; False if something failed."""
    again = f"python -m studies.torture {part} --scale {scale:g} --seed {seed}"
    began_s = time.monotonic()
    measured = importlib.import_module(f"studies.torture.{part}").run(scale, seed)
    seconds = round(time.monotonic() - began_s)
    settings = {"scale": scale, "seed": seed}
    document = record(settings, **{"command": again, "seconds": seconds, **measured})
    json_dir.mkdir(parents=True, exist_ok=True)
    write_result(json_dir / f"{part}.json", document, _LINES)
    failures = document["failures"]
    print(f"{part}: {len(failures)} failures, {seconds} s", flush=True)
    for failure in failures:
        print(f"failed: {failure}", file=sys.stderr)
    if failures:
        print(f"the same again: {again}", file=sys.stderr)
    return not failures


if __name__ == "__main__":
    sys.exit(main())
