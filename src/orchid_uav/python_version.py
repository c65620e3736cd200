"""Says that a Python is too old, before that fails for another reason.

``make install`` and the build of the package run this file, so Pythons that are too old must be
able to read it.
"""

import platform
import sys

OLDEST = (3, 11)
"""``requires-python`` of ``pyproject.toml``."""


def complaint() -> str:
    """What is wrong with the Python that runs, nothing if it is new enough."""
    if sys.version_info >= OLDEST:
        return ""
    oldest = ".".join(map(str, OLDEST))
    found = f"{platform.python_version()} ({sys.executable})"
    return f"ORCHID needs Python {oldest} or newer, and this is Python {found}."


if __name__ == "__main__":
    sys.exit(complaint() or 0)
