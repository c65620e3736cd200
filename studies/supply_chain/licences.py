"""Who wrote what we depend on, and under which licence: ``make licences``.

Reads the metadata of every release in ``constraints.txt``, without installing it, and follows what
the extras of ``pyproject.toml`` pull in on Linux with the oldest Python. Exits with 1 where a
licence is missing or has not been accepted.
"""

import argparse
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from orchid_uav.python_version import OLDEST
from studies.recording import (
    RESULTS,
    ROOT,
    add_recording_options,
    record,
    require_commit,
    write_result,
)

RESULT = RESULTS / "licences.json"
PERMISSIVE = (
    {"MIT", "MIT-0", "MIT-CMU", "ISC", "Zlib", "0BSD", "CC0-1.0", "BSL-1.0", "PSF-2.0"}
    | {"BSD", "BSD-2-Clause", "BSD-3-Clause", "Apache-2.0", "Apache-2.0 WITH LLVM-exception"}
    | {"matplotlib"}
)
"""Ask for their notice to stay where the code is copied, and for no more."""
WEAK_COPYLEFT = {"MPL-2.0", "LGPL", "LGPL-2.1", "LGPL-3.0"}
"""Ask for their own source, and changes of it, to stay free where it is passed on. We pass none of
it on: pip fetches it from its authors, and importing it unchanged asks nothing of our code."""
ACCEPTED = PERMISSIVE | WEAK_COPYLEFT

NAMES = {
    "mit license": "MIT",
    "apache 2.0": "Apache-2.0",
    "apache license, version 2.0": "Apache-2.0",
    "apache software license": "Apache-2.0",
    "bsd license": "BSD",
    "bsd 3-clause license": "BSD-3-Clause",
    "3-clause bsd license": "BSD-3-Clause",
    "isc license": "ISC",
    "isc license (iscl)": "ISC",
    "psfl": "PSF-2.0",
    "python software foundation license": "PSF-2.0",
    "mozilla public license 2.0 (mpl 2.0)": "MPL-2.0",
    "gnu library or lesser general public license (lgpl)": "LGPL",
    "gnu lesser general public license v3 (lgplv3)": "LGPL-3.0",
    "lgpl v2.1": "LGPL-2.1",
    "lgplv3": "LGPL-3.0",
}
"""What packages write instead of an identifier of SPDX. BSD without a number of clauses and LGPL
without a version are as unspecific as the package is."""
READ = {"huey": "MIT", "matplotlib": "matplotlib", "skops": "MIT"}
"""Read in the package's own file, where its metadata have none, or one that says something else:
matplotlib's licence is modelled on that of Python."""
BUNDLED = {
    "three": ("MIT", "experiments/replay/page/bundle", "THIRD_PARTY_LICENSES.txt"),
}
"""Other people's code that our own files contain: licence, folder, and the file with its text."""
_BUNDLER = ROOT / "experiments" / "replay" / "page" / "build" / "package.json"


class Stated(NamedTuple):
    """A licence, and where it is stated."""

    licence: str
    where: str


def stated_licence(metadata: Mapping[str, Any]) -> Stated | None:
    """The licence as a package's metadata state it, None if they do not.

    Args:
        metadata: as in pip's report: ``name``, ``license_expression``, ``license``, ``classifier``.
    """
    if known := READ.get(canonicalize_name(metadata["name"])):
        return Stated(known, "licence file")
    if expression := metadata.get("license_expression"):
        return Stated(expression, "expression")
    first_line, *_ = (metadata.get("license") or "").strip().splitlines() or [""]
    named = NAMES.get(first_line.strip().lower(), first_line.strip())
    if unaccepted(named) == []:
        return Stated(named, "field")
    classifiers = [
        entry.rpartition(" :: ")[2].lower()
        for entry in metadata.get("classifier", [])
        if entry.startswith("License :: OSI Approved :: ")
    ]
    if classifiers:
        found = [NAMES.get(entry, entry) for entry in classifiers]
        return Stated(" OR ".join(sorted(set(found))), "classifier")
    return Stated(named, "field") if named else None


def unaccepted(expression: str) -> list[str]:
    """The licences of an SPDX expression that are not accepted; of alternatives, all must be."""
    parts = [part.strip() for part in re.split(r"\bAND\b|\bOR\b|[()]", expression)]
    return [part for part in parts if part and part not in ACCEPTED] if any(parts) else [""]


def direct_requirements() -> dict[str, list[Requirement]]:
    """What ``pyproject.toml`` asks for: ``base``, then the extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    groups = {"base": project["dependencies"], **project["optional-dependencies"]}
    return {
        group: [
            requirement
            for line in lines
            if canonicalize_name((requirement := Requirement(line)).name) != project["name"]
        ]
        for group, lines in groups.items()
    }


def pulled_in(
    requirements: list[Requirement], packages: Mapping[str, Mapping[str, Any]]
) -> set[str]:
    """Names of what the requirements need, themselves included.

    Args:
        requirements: where to begin.
        packages: metadata by normalised name; what is not in there is not followed.
    """
    environment = {"sys_platform": "linux", "platform_system": "Linux", "os_name": "posix"}
    environment |= {"python_version": "{}.{}".format(*OLDEST), "extra": ""}
    found: set[str] = set()
    waiting = [(canonicalize_name(one.name), frozenset(one.extras)) for one in requirements]
    seen = set()
    while waiting:
        name, extras = entry = waiting.pop()
        if entry in seen or name not in packages:
            continue
        seen.add(entry)
        found.add(name)
        for line in packages[name].get("requires_dist", []):
            needed = Requirement(line)
            wanted = needed.marker is None or any(
                needed.marker.evaluate(environment | {"extra": extra}) for extra in ("", *extras)
            )
            if wanted:
                waiting.append((canonicalize_name(needed.name), frozenset(needed.extras)))
    return found


def read_metadata(constraints: Path) -> dict[str, dict[str, Any]]:
    """Metadata of all pinned releases by normalised name; pip installs none of them."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed"]
    command += ["--no-deps", "--quiet", "--report", "-", "--requirement", str(constraints)]
    report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    found = [item["metadata"] for item in report["install"]]
    return {canonicalize_name(metadata["name"]): metadata for metadata in found}


def rows(packages: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row per package: who asks for it, and its licence."""
    groups = direct_requirements()
    direct = {canonicalize_name(one.name) for group in groups.values() for one in group}
    users = {group: pulled_in(wanted, packages) for group, wanted in groups.items()}
    found = []
    for name, metadata in sorted(packages.items()):
        stated = stated_licence(metadata)
        found.append(
            {
                "name": name,
                "version": metadata["version"].partition("+")[0],
                "licence": stated.licence if stated else "",
                "stated": stated.where if stated else "nowhere",
                "direct": name in direct,
                # What the base installation has, no extra adds.
                "for": ["base"]
                if name in users["base"]
                else [group for group in groups if name in users[group]],
            }
        )
    return found


def bundled() -> list[dict[str, Any]]:
    """A row for each piece of other people's code in our own files."""
    versions = json.loads(_BUNDLER.read_text(encoding="utf-8"))["dependencies"]
    return [
        {"name": name, "version": versions[name], "licence": licence, "in": f"{folder}/"}
        | {"text": f"{folder}/{text}"}
        for name, (licence, folder, text) in BUNDLED.items()
    ]


def main() -> int:
    """Write the table; 1 if a licence in it is not accepted."""
    parser = argparse.ArgumentParser(prog="studies.supply_chain.licences", description=__doc__)
    add_recording_options(parser, RESULT)
    options = parser.parse_args()
    require_commit(parser, options, options.json)
    packages = rows(read_metadata(ROOT / "constraints.txt"))
    result = record({}, packages=packages, bundled=bundled())
    write_result(options.json, result, ['{"name"', '"bundled"'])
    wrong = [row for row in packages if unaccepted(row["licence"])]
    for row in wrong:
        found = f"'{row['licence']}'" if row["licence"] else "no licence in its metadata"
        print(f"{row['name']} {row['version']}: {found}", file=sys.stderr)
    unused = [row["name"] for row in packages if not row["for"]]
    if unused:
        print(f"pinned, but nothing asks for it: {', '.join(unused)}", file=sys.stderr)
    print(f"{len(packages)} packages, {len(wrong)} of them without an accepted licence")
    return 1 if wrong or unused else 0


if __name__ == "__main__":
    sys.exit(main())
