"""What ``make dist`` builds, checked as a stranger would: ``make dist-check``.

Builds it twice from clones in different folders, by users with different rights, times and
languages; compares the bytes; looks at what is inside; installs the wheel in an environment of its
own and runs the command there, in an empty folder. Exits with 1 at the first thing that is wrong.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from studies.supply_chain.distributions import ROOT

MODULE = "studies.supply_chain.distributions"
USERS = (
    {"umask": 0o077, "TZ": "Asia/Tokyo", "LC_ALL": "C", "PYTHONHASHSEED": "1"},
    {"umask": 0o002, "TZ": "America/St_Johns", "LC_ALL": "C.UTF-8", "PYTHONHASHSEED": "2"},
)
"""For whom it is built."""

_PAGE = "experiments/replay/page"
_NEEDED = (
    r"reference/orchid/policy\.safetensors",
    r"reference/maddpg-mmf/run\.json",
    rf"{_PAGE}/bundle/page\.js",
    rf"{_PAGE}/bundle/scene\.js",
    rf"{_PAGE}/bundle/THIRD_PARTY_LICENSES\.txt",
    rf"{_PAGE}/template\.html",
    r"orchid_uav/py\.typed",
    r"envs/dynamics\.py",
)
NEEDED = {
    "wheel": (
        *_NEEDED,
        r"orchid_uav-[^/]*\.dist-info/licenses/LICENSE",
        r"orchid_uav/cli/train\.py",
    ),
    "sdist": (
        *(*_NEEDED, r"LICENSE", r"PKG-INFO", r"README\.md", r"CHANGELOG\.md", r"setup\.py"),
        *(r"pyproject\.toml", rf"{_PAGE}/source/main\.js", r"orchid_cli/train\.py"),
    ),
}
"""Ends of names, each of which some file must have."""
UNWANTED = r"(^|/)(tests?|studies|benchmarks|docs|node_modules|__pycache__|\.git[^/]*|\.venv[^/]*)/"
"""Folders that belong to the repository, or to nobody."""


class WrongError(Exception):
    """What is wrong, for the user."""


def names(path: Path) -> list[str]:
    """Files in a wheel or sdist; those of an sdist without the folder that holds them all."""
    if path.suffix == ".whl":
        with zipfile.ZipFile(path) as wheel:
            return wheel.namelist()
    with tarfile.open(path) as sdist:
        return [member.name.partition("/")[2] for member in sdist if member.isfile()]


def check_contents(kind: str, found: Sequence[str]) -> None:
    """Compare names with what must be there and what must not.

    Raises:
        WrongError: something lacks, or is too much.
    """
    lacking = [
        end for end in NEEDED[kind] if not any(re.search(f"(^|/){end}$", name) for name in found)
    ]
    unwanted = [name for name in found if re.search(UNWANTED, name)]
    if lacking or unwanted:
        raise WrongError(f"the {kind} lacks {lacking} and should not have {unwanted[:5]}")


def build_twice(into: Path) -> list[Path]:
    """Build from two clones, as each of ``USERS``.

    Raises:
        WrongError: the bytes differ.
    """
    digests = []
    for number, user in enumerate(USERS):
        clone = into.joinpath("clones", *["deeper"] * number, "clone")
        subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", ROOT, clone], check=True)
        built = into / f"built-{number}"
        variables = {key: value for key, value in user.items() if key != "umask"}
        subprocess.run(
            [sys.executable, "-m", MODULE, "--out", str(built)],
            cwd=clone,
            env=os.environ | variables,
            umask=user["umask"],
            check=True,
        )
        found = sorted(built.iterdir())
        digests.append([hashlib.sha256(path.read_bytes()).hexdigest() for path in found])
    for path, first, second in zip(found, *digests, strict=True):
        print(f"{first}  {path.name}, {path.stat().st_size} bytes")
        if first != second:
            raise WrongError(f"{path.name} of the second build differs: {second}")
    return found


def install_and_run(wheel: Path, folder: Path, constraints: Path) -> None:
    """Install the wheel into a new environment and use it in an empty folder.

    Raises:
        subprocess.CalledProcessError: something does not run.
        WrongError: a file that it should have written is not there.
    """
    subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
    pip = [folder / "venv" / "bin" / "python", "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, "--constraint", constraints, "torch"], check=True)
    subprocess.run([*pip, "--constraint", constraints, wheel], check=True)
    subprocess.run([folder / "venv" / "bin" / "python", "-m", "pip", "check"], check=True)
    place = folder / "empty"
    place.mkdir()
    people = place / "people.csv"
    people.write_bytes((ROOT / "examples" / "planning" / "people.csv").read_bytes())
    commands = (
        "--version",
        "eval --methods=static-mmf,orchid --users=20 --uavs=2 --episodes=1 --quiet --out=eval",
        "plan people.csv --drones=6 --mast=17.2966,-62.7243 --budget=200 --quiet --out=plan",
        "replay plan --quiet --out=replay.html",
    )
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"HOME": str(place), "NUMBA_CACHE_DIR": str(folder / "cache")}
    for command in commands:
        print(f"orchid {command}", flush=True)
        orchid = folder / "venv" / "bin" / "orchid"
        subprocess.run([orchid, *command.split()], cwd=place, env=environment, check=True)
    for name in ("eval/summary.json", "plan/plan.json", "replay.html"):
        if not (place / name).is_file():
            raise WrongError(f"{name} was not written")


def main() -> int:
    """Check all; 1 if something is wrong."""
    parser = argparse.ArgumentParser(
        prog="studies.supply_chain.distribution_check", description=__doc__
    )
    parser.add_argument("--constraints", type=Path, default=ROOT / "constraints.txt")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            wheel, sdist = build_twice(folder)
            subprocess.run(
                [sys.executable, "-m", "twine", "check", "--strict", wheel, sdist], check=True
            )
            check_contents("wheel", names(wheel))
            check_contents("sdist", names(sdist))
            install_and_run(wheel, folder, options.constraints.resolve())
        except (WrongError, subprocess.CalledProcessError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
    print("equal bytes, as expected inside, and it runs")
    return 0


if __name__ == "__main__":
    sys.exit(main())
