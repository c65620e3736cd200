"""Exporters of a run's metrics to other programs.

A tracker gets the metrics of every episode and can never stop or delay training: an error switches
it off with a warning, and a tracker that may wait for a server or a lock runs in its own process.
"""

import importlib.util
import sys
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.training.listeners import Tracker
from orchid_uav.experiments.training.service_trackers import MlflowTracker, ProjectTracker
from orchid_uav.experiments.training.tensorboard_tracker import TensorBoardTracker
from orchid_uav.experiments.training.tracker_process import TrackerProcess
from orchid_uav.extras import install_command

EXPORTERS: dict[str, Callable[[Path, RunConfig], Tracker]] = {
    "mlflow": MlflowTracker,
    "trackio": partial(ProjectTracker, "trackio"),
    "wandb": partial(ProjectTracker, "wandb"),
}
"""Trackers that need a third-party package; each takes a run's directory and configuration."""
TRACKERS = ("tensorboard", *EXPORTERS)
"""Names for ``--track``; TensorBoard's files are always written."""


def check_tracker(name: str) -> None:
    """Check that a tracker can be opened, before anything is made for it.

    Raises:
        InputError: the tracker is unknown, or its package is not installed.
    """
    if name not in TRACKERS:
        raise InputError(f"unknown tracker '{name}': known are {', '.join(TRACKERS)}")
    if not _is_installed(name):
        raise InputError(
            f"--track {name} needs a package that is not installed; "
            f"to install it: {install_command(name)}"
        )


def _is_installed(package: str) -> bool:
    """Whether a package is installed. Only the tracker's own process imports it."""
    try:
        return importlib.util.find_spec(package) is not None
    except ValueError:  # `sys.modules` holds None in its place
        return False


def open_tracker(name: str, directory: Path, config: RunConfig) -> "SafeTracker":
    """Open a tracker that passed :func:`check_tracker`; if that fails, it stays switched off."""
    try:
        tracker: Tracker = (
            TensorBoardTracker(directory, config)
            if name == "tensorboard"
            else TrackerProcess(name, directory, config)
        )
    except Exception as error:
        _warn(f"{name} is off for this run: {error}")
        return SafeTracker(name, Tracker())
    return SafeTracker(name, tracker)


def _warn(message: str) -> None:
    # Not `warnings.warn`, which a filter can turn into an exception.
    print(f"warning: {message}", file=sys.stderr)


class SafeTracker(Tracker):
    """Passes everything on to a tracker; if that raises, warns once and switches it off."""

    def __init__(self, name: str, tracker: Tracker) -> None:
        self._name = name
        self._tracker = tracker

    def resume(self, episodes: int) -> None:
        """Pass on that the run goes on after this many episodes."""
        self._try(lambda tracker: tracker.resume(episodes))

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """Pass on an episode's metrics."""
        self._try(lambda tracker: tracker.log(episode, metrics))

    def close(self, status: str) -> None:
        """Pass on how the run has ended."""
        self._try(lambda tracker: tracker.close(status))

    def _try(self, action: Callable[[Tracker], None]) -> None:
        try:
            action(self._tracker)
        except Exception as error:
            self._tracker = Tracker()
            _warn(f"{self._name} is off for the rest of the run: {error}")
