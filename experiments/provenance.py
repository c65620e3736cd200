"""Records the machine and the software versions with which a run was made."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

Status = Literal["running", "completed", "failed", "interrupted"]
"""How a run or a study stands, by its own record."""

_PACKAGES = (
    "orchid-uav",
    "torch",
    "stable-baselines3",
    "gymnasium",
    "numpy",
    "numba",
    "scipy",
    "scikit-learn",
)


def describe_versions() -> dict[str, str | None]:
    """Versions of python and of the packages that the numbers depend on, and the git commit."""
    versions: dict[str, str | None] = {"python": platform.python_version()}
    versions |= {name.replace("-", "_"): version(name) for name in _PACKAGES}
    return versions | {"git_commit": git_commit()}


def describe_host() -> dict[str, Any]:
    """Describe the machine."""
    return {
        "name": platform.node(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor_name(),
        "cores": os.cpu_count(),
    }


def boot_id() -> str | None:
    """An id of the machine's current boot; None on systems that have none."""
    path = Path("/proc/sys/kernel/random/boot_id")
    return path.read_text().strip() if path.is_file() else None


CHANGES = "+changes"
"""Ends the commit of a checkout with changes that are not committed."""
_NOT_MEASURED = (
    *("runs", "studies/results", "studies/pages", "docs", "tests", "*.md", "mkdocs.yml", "LICENSE"),
)
"""Files whose changes do not count, since they change nothing that is measured: what runs
and benchmarks write, pages and figures made of it, and tests. Checksums identify the policies. All
other changes count: packages, `pyproject.toml`, `constraints.txt`, the benchmarks themselves."""


def git_commit() -> str | None:
    """Commit of the checkout that this code runs from, "+changes" if it differs; else None."""
    source = Path(__file__).resolve().parent
    top = _git(source, "rev-parse", "--show-toplevel")
    # Installed code may lie inside somebody else's repository.
    if not top or not (Path(top) / "envs" / "dynamics.py").is_file():
        return None
    commit = _git(source, "rev-parse", "HEAD")
    measured = (":(top)", *(f":(top,exclude,glob){one}" for one in _NOT_MEASURED))
    if commit and _git(source, "status", "--porcelain", "--", *measured):
        commit += CHANGES
    return commit or None


def _git(directory: Path, *arguments: str) -> str:
    try:
        finished = subprocess.run(
            ["git", "--no-optional-locks", "-C", str(directory), *arguments],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return finished.stdout.strip() if finished.returncode == 0 else ""


def _processor_name() -> str:
    described = Path("/proc/cpuinfo")  # of Linux, and not in every container
    if described.is_file():
        for line in described.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
