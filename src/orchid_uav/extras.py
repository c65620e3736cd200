"""Packages that only some users need, each an extra of this project."""

import importlib
import re
import shlex
import shutil
import sys
from importlib.machinery import PathFinder
from importlib.metadata import requires
from types import ModuleType


def import_extra(extra: str) -> ModuleType:
    """Import the package after which an extra is named.

    Raises:
        ImportError: it cannot be imported; the message says why, and what installs it.
    """
    try:
        return importlib.import_module(extra)
    except ImportError as error:
        raise ImportError(
            f"{extra} cannot be imported ({error}); to install it: {install_command(extra)}",
            name=extra,
        ) from error


def install_command(extra: str) -> str:
    """What installs an extra's packages for this interpreter, from a checkout as from a wheel.

    The packages are named themselves: ``pip install 'orchid-uav[…]'`` would look for this project
    in a package index, where pip does not find the checkout that it was installed from.
    """
    command = [sys.executable, "-m", "pip", "install"]
    # importlib.util.find_spec("pip") would also wake what setuptools waits with for pip.
    if PathFinder.find_spec("pip") is None and shutil.which("uv"):
        command = ["uv", "pip", "install", "--python", sys.executable]
    return _as_typed([*command, *(extra_requirements(extra) or [extra])])


def extra_requirements(extra: str) -> list[str]:
    """What an extra adds, as the project's metadata has it: ``["mlflow>=3.0"]``."""
    found = []
    for requirement in requires("orchid-uav") or []:
        package, _, marker = requirement.partition(";")
        if re.search(rf"""\bextra\s*==\s*["']{re.escape(extra)}["']""", marker):
            found.append(package.strip())
    return found


def _as_typed(command: list[str]) -> str:
    if sys.platform == "win32":  # where single quotes quote nothing
        return " ".join(f'"{part}"' if re.search(r"[\s<>&|^]", part) else part for part in command)
    return shlex.join(command)
