"""Everything is in pyproject.toml.

This is here to say that a Python is too old: pip compares ``requires-python`` only after it has
looked for all dependencies, and what it cannot find on an old Python is all that it tells.
"""

import runpy
import sys

complaint = runpy.run_path("src/orchid_uav/python_version.py")["complaint"]()
if complaint:
    sys.exit(complaint)

from setuptools import setup  # noqa: E402 - an old Python has an old one, which knows less

setup()
