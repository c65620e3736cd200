"""The tests with whatever is installed, and a record of what that was: ``make newest``.

Arguments after ``--`` go to pytest. Exits as pytest does.
"""

import argparse
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.metadata import distributions
from pathlib import Path
from xml.etree import ElementTree

from packaging.utils import canonicalize_name
from packaging.version import Version

from studies.recording import ROOT, record, write_result


def installed() -> dict[str, str]:
    """Versions of all packages of this interpreter but this project, by normalised name."""
    found = {canonicalize_name(one.name): one.version for one in distributions()}
    found.pop("orchid-uav", None)
    return dict(sorted(found.items()))


def pins(path: Path) -> dict[str, str]:
    """Versions in a file of constraints, by normalised name."""
    lines = path.read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in pairs}


def differences(found: Mapping[str, str], pinned: Mapping[str, str]) -> list[str]:
    """Lines such as ``numpy 2.5.5, pinned 2.4.6`` for what is not installed as it is pinned."""
    return [
        f"{name} {version}, pinned {pinned[name]}"
        for name, version in found.items()
        # Local versions, such as that of torch for processors alone, are builds of the same code.
        if name in pinned and Version(version).public != Version(pinned[name]).public
    ]


def counts(report: Path) -> dict[str, int]:
    """Numbers of tests by outcome, from a JUnit file that pytest itself has just written."""
    suites = ElementTree.parse(report).getroot().iter("testsuite")
    totals = {"tests": 0, "failures": 0, "errors": 0, "skipped": 0}
    for suite in suites:
        for outcome in totals:
            totals[outcome] += int(suite.get(outcome, 0))
    return totals


def main() -> int:
    """Run the tests and write the record."""
    parser = argparse.ArgumentParser(prog="studies.supply_chain.tested", description=__doc__)
    parser.add_argument("--json", type=Path, required=True, help="where the record goes")
    parser.add_argument("pytest", nargs="*", help="arguments of pytest")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", f"--junitxml={report}", *options.pytest]
        status = subprocess.run(command, cwd=ROOT, check=False).returncode
        outcome = counts(report) if report.is_file() else {}
    found = installed()
    result = record(
        {"pytest": options.pytest},
        python=platform.python_version(),
        status=status,
        tests=outcome,
        installed=found,
    )
    options.json.parent.mkdir(parents=True, exist_ok=True)
    write_result(options.json, result, ['"installed"'])
    changed = differences(found, pins(ROOT / "constraints.txt"))
    print(f"Python {platform.python_version()}; {len(changed)} versions are not those pinned:")
    print("".join(f"  {line}\n" for line in changed), end="")
    print(f"wrote {options.json}")
    return status


if __name__ == "__main__":
    sys.exit(main())
