"""``orchid export``: from a run to an ONNX file that was compared with its policy."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from orchid_uav import __version__
from orchid_uav.envs.interfaces.spaces import observation_space
from orchid_uav.envs.knowledge.informed import INFORMED_NAMES
from orchid_uav.envs.observation import OBSERVATION_NAMES
from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.method_keys import RELEASED
from orchid_uav.experiments.evaluation.methods import (
    METHOD_KEYS,
    Policy,
    read_policy,
    read_released,
)
from orchid_uav.experiments.exporting.graph import OPSET, actor_graph
from orchid_uav.experiments.exporting.parity import Parity, check_parity
from orchid_uav.experiments.runs.records import find_run
from orchid_uav.notices import in_one_line, reason_of
from orchid_uav.storage.files import appearing_when_complete
from orchid_uav.suggestions import unknown

_OBSERVATION_NAMES = {"paper": OBSERVATION_NAMES, "informed": INFORMED_NAMES}
_ACTION_NAMES = {
    "direct": ("displacement, x", "displacement, y", "displacement, z", "change of transmit power"),
    "station": ("station's velocity, x", "station's velocity, y", "altitude", "transmit power"),
}
_MOVEMENT = (
    *("network.area_m", "network.slot_s", "uav.max_speed_mps", "uav.displacement_scale_m"),
    *("uav.min_altitude_m", "uav.max_altitude_m", "uav.power_step_w"),
    *("uav.min_transmit_power_w", "uav.max_transmit_power_w"),
)
"""Keys of the configuration by which an action becomes a movement."""


class ExportedActor(NamedTuple):
    """An ONNX file that was written."""

    path: Path
    run: str
    size: int
    """Bytes."""
    observation_size: int
    action_size: int
    parity: Parity | None
    """None if onnxruntime is not installed; the file was then checked by onnx.checker alone."""


def find_policy(name: str, runs_dir: Path) -> Policy:
    """The policy of a run, or the released one of that key.

    Raises:
        InputError: there is neither, or the run has no policy that can be flown.
    """
    if name in RELEASED:
        return read_released(name)
    try:
        path = find_run(name, runs_dir)
    except InputError as error:
        known = unknown("released policy", name, RELEASED, cutoff=0.4)
        raise InputError(f"{error}\n{known}") from error
    return read_policy(path)


def export_onnx(policy: Policy, target: Path, force: bool = False) -> ExportedActor:
    """Write a policy as an ONNX file, which appears once it is checked.

    Args:
        policy: what is exported.
        target: the file.
        force: whether it may replace another one.

    Raises:
        InputError: onnx is not installed, or the target exists or cannot be written.
        RunFailedError: a runtime flies the file otherwise than the policy.
    """
    if target.is_dir():
        raise InputError(f"{target} is a directory: name a file in it, {target / 'actor.onnx'}")
    if not force and os.path.lexists(target):
        raise InputError(f"{target} exists: give another name, or --force to replace it")
    if not target.parent.is_dir():
        raise InputError(f"cannot write {target}: there is no directory {target.parent}")
    actor, space = policy.actor, observation_space(policy.config.network_parameters)
    try:
        model = actor_graph(actor, policy.run, __version__, metadata(policy))
    except ImportError as error:
        raise InputError(in_one_line(error)) from error
    ends = np.array([space.low, space.high], np.float32)
    parity = check_parity(model, actor, *ends)
    try:
        with appearing_when_complete(target, force) as file:
            file.write(model)
    except OSError as error:
        raise InputError(f"cannot write {target}: {reason_of(error)}") from error
    sizes = actor.observation_size, actor.action_size
    return ExportedActor(target, policy.run, len(model), *sizes, parity)


def metadata(policy: Policy) -> dict[str, str]:
    """What the file says of itself: texts, and JSON where a value is none."""
    config = policy.config
    uav = config.uav
    described = policy.actor.description
    origin = {} if described is None else described.model_dump(include={"episodes", "sha256"})
    values: dict[str, Any] = {
        "run": policy.run,
        "algorithm": config.training.algorithm,
        "objective": config.reward.objective,
        "observation": uav.observation,
        "observation_names": _OBSERVATION_NAMES[uav.observation],
        "flight": uav.flight,
        "action_names": _ACTION_NAMES[uav.flight],
        "settings": settings(config),
        "project_version": __version__,
        "opset": OPSET,
        **origin,
    }
    return {
        key: value if isinstance(value, str) else json.dumps(value) for key, value in values.items()
    }


def settings(config: RunConfig) -> dict[str, Any]:
    """Keys of the configuration that fix what is seen and what an action of 1 does."""
    values = flatten(config)
    stations = [key for key in values if key.startswith("uav.station.")]
    keys = (*METHOD_KEYS, *_MOVEMENT, *(stations if config.uav.flight == "station" else ()))
    return {key: values[key] for key in keys}
