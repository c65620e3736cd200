"""The ablations that the documentation shows: ``make ablation``.

Each is one ``orchid ablate`` command. Given the directory of an ablation that was begun or is
finished, it continues there. Its ``ablation.json`` is kept, with rounded numbers.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from orchid_uav.experiments.ablation.study import DOCUMENT_FILE
from studies.recording import RESULTS, add_recording_options, require_commit, write_result

ABLATIONS: dict[str, tuple[str, ...]] = {
    "ablation_controls": ("--no-rf", "--controls", "reset-only,decay-only"),
    "ablation_minibatch": ("--base", "ppo.minibatch=rows", "--set", "ppo.minibatch=slots"),
}


def run(name: str, directory: Path) -> None:
    """Run an ablation in a directory, and write its compact result."""
    arguments = [*ABLATIONS[name], "--out", str(directory)]
    subprocess.run([sys.executable, "-m", "orchid_uav", "ablate", *arguments], check=True)
    compact(name, directory)


def compact(name: str, directory: Path) -> None:
    """The result of a finished ablation."""
    document = json.loads((directory / DOCUMENT_FILE).read_text(encoding="utf-8"))
    if document["status"] != "completed":
        raise SystemExit(f"{directory} is {document['status']}")
    document["command"] = ["orchid", "ablate", *ABLATIONS[name]]
    beginnings = ('{"variant":"', '{"method":"', '"energy_efficiency_bit_per_joule":{"n"')
    write_result(RESULTS / f"{name}.json", document, beginnings)


def main() -> None:
    """Run all ablations, or the named one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", choices=ABLATIONS, metavar="ABLATION")
    parser.add_argument("--out", type=Path, help="directory of the study; needs a name")
    add_recording_options(parser)
    arguments = parser.parse_args()
    if arguments.out and not arguments.name:
        parser.error("--out is the directory of one ablation: name the ablation")
    require_commit(parser, arguments, RESULTS)
    for name in [arguments.name] if arguments.name else ABLATIONS:
        with tempfile.TemporaryDirectory() as temporary:
            run(name, arguments.out or Path(temporary) / "study")
        print(f"wrote {name}.json", flush=True)


if __name__ == "__main__":
    main()
