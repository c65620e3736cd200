"""Reads a user's own methods from Python files: ``orchid eval --method FILE.py:CLASS``.

A file is executed only if it is named on the command line. Nothing in the directory of a run or of
an evaluation can name a file that would be executed.
"""

import hashlib
import re
import sys
import traceback
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from orchid_uav.agents.controllers.controller import Actions, Controller
from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.keys import choices_of
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.configuration import field_of
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.method_keys import known_methods
from orchid_uav.experiments.evaluation.methods import Contender, OwnFile, method_overrides
from orchid_uav.notices import reason_of


def read_own_methods(specifications: Sequence[str], taken: Collection[str] = ()) -> list[Contender]:
    """Make rows of an evaluation from files.

    Args:
        specifications: each is ``FILE.py:CLASS``. The class, or anything else that can be called
            without arguments, makes a :class:`Controller`. That may have the attributes
            ``objective`` ("mmf", the default, or "pf"), ``deployment_init`` ("kmeans", the default,
            or "random") and ``idea``.
        taken: keys of the evaluation's other rows.

    Raises:
        InputError: there is no such file or class, or it makes no method.
    """
    contenders: list[Contender] = []
    for specification in specifications:
        contender = _own_method(specification)
        others = {*known_methods(), *taken, *(other.key for other in contenders)}
        if contender.key in others:
            raise InputError(
                f"--method {specification}: there is a method '{contender.key}' already; "
                "give the class another name"
            )
        contenders.append(contender)
    return contenders


def _own_method(specification: str) -> Contender:
    file, _, name = specification.rpartition(":")
    if not file or not name.isidentifier():
        raise InputError(f"--method {specification}: it must be FILE.py:CLASS")
    path = Path(file).expanduser()
    try:
        source = path.read_bytes()
    except OSError as error:
        raise InputError(f"--method {specification}: {reason_of(error)}: {path}") from error
    told = f"--method {specification}"
    with _Telling(InputError, told, path):
        module = _run(path.resolve(), source)
    make: Callable[[], Controller] | None = getattr(module, name, None)
    if not callable(make):
        raise InputError(f"{told}: {path} has no class '{name}'")
    with _Telling(InputError, told, path):
        method: Any = make()
        objective = getattr(method, "objective", "mmf")
        init = getattr(method, "deployment_init", "kmeans")
        flight = getattr(method, "flight", "direct")
        observation = getattr(method, "observation", "paper")
        idea = getattr(method, "idea", f"{name} of {path.name}")
    for needed in ("begin", "act"):
        if not callable(getattr(method, needed, None)):
            raise InputError(f"{told}: '{name}' has no {needed}(world), which a method needs")
    for attribute, value, right in (
        ("objective", objective, choices_of(field_of("reward.objective"))),
        ("deployment_init", init, choices_of(field_of("deployment.init"))),
        ("flight", flight, choices_of(field_of("uav.flight"))),
        ("observation", observation, choices_of(field_of("uav.observation"))),
    ):
        if value not in right:
            raise InputError(f"{told}: {attribute} is {value!r}, not {' or '.join(right)}")
    key = _key_of(name)
    return Contender(
        key,
        str(idea),
        method_overrides(objective, init, flight, observation),
        lambda seeds: _Guarded(make(), f"method '{key}'", path),
        own_file=OwnFile(path.name, name, hashlib.sha256(source).hexdigest()),
    )


def _key_of(name: str) -> str:
    """Turn a class name into a key: ``WideCircles`` becomes ``wide-circles``."""
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|_+", "-", name)
    return words.strip("-").lower() or name


def _run(path: Path, source: bytes) -> ModuleType:
    """Execute a file as a module, from the very bytes whose digest is recorded."""
    module = ModuleType(f"orchid_own_{hashlib.sha256(str(path).encode()).hexdigest()[:16]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # dataclasses look for their module there
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))  # last, so that no file beside it shadows a library
    exec(compile(source, path, "exec"), module.__dict__)
    return module


class _Guarded:
    """A method whose errors end the evaluation with its name and the line of its file."""

    def __init__(self, method: Controller, told: str, path: Path) -> None:
        self._method = method
        self._told = told
        self._path = path

    def begin(self, world: WorldBatch) -> None:
        """Begin the flight, as the method does."""
        with _Telling(RunFailedError, self._told, self._path):
            self._method.begin(world)

    def act(self, world: WorldBatch) -> Actions:
        """Return the method's actions, after checking their shape and that they are finite."""
        with _Telling(RunFailedError, self._told, self._path):
            actions = np.asarray(self._method.act(world), np.float64)
        shape = (world.world_count, world.uav_count, ACTION_SIZE)
        if actions.shape != shape:
            raise RunFailedError(
                f"{self._told}: act() gave shape {actions.shape}, not (worlds, UAVs, 4) = {shape}"
            )
        if not np.isfinite(actions).all():
            slot = int(world.arrays.slot[0])
            raise RunFailedError(
                f"{self._told}: act() gave a number that is not finite, in slot {slot}"
            )
        return actions


class _Telling:
    """Turns whatever a user's file raises into a one-line error with the file and the line."""

    def __init__(self, kind: type[Exception], told: str, path: Path) -> None:
        self._kind = kind
        self._told = told
        self._path = path

    def __enter__(self) -> None:
        """Enter the block; there is nothing to prepare."""

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        """Raise the error that the user sees, if the block raised one."""
        if isinstance(error, Exception | SystemExit):
            if isinstance(error, SyntaxError):
                line, reason = error.lineno, error.msg
            else:
                own = [
                    frame.lineno
                    for frame in traceback.extract_tb(trace)
                    if frame.filename == str(self._path.resolve())
                ]
                line, reason = own[-1] if own else None, " ".join(str(error).split())
            place = f"{self._path}, line {line}" if line else str(self._path)
            raise self._kind(f"{self._told}: {type(error).__name__}: {reason} ({place})") from error
