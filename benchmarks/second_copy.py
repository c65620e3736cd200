"""Modules of the simulator once more, with something in them replaced."""

import importlib.util
import sys
from collections.abc import Mapping
from types import ModuleType
from unittest import mock


def second_copy(module: ModuleType, imports: Mapping[str, ModuleType]) -> ModuleType:
    """A module executed again, which meets other modules under the names that it imports.

    Args:
        module: left as it is.
        imports: modules by the names under which the copy finds them.
    """
    assert module.__file__ is not None
    specification = importlib.util.spec_from_file_location("second_copy", module.__file__)
    assert specification is not None and specification.loader is not None
    copy = importlib.util.module_from_spec(specification)
    with mock.patch.dict(sys.modules, imports):
        specification.loader.exec_module(copy)
    return copy
