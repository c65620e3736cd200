"""Exporters of a run's figures to other programs.

A tracker is told of every episode and can never stop a training: an error switches it off with a
warning. Its package is imported only when it is asked for.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.errors import InputError

Figures = Mapping[str, float]


class Tracker(Protocol):
    """What an exporter does."""

    def log(self, episode: int, figures: Figures) -> None:
        """Take an episode's figures."""

    def close(self, status: str) -> None:
        """The run has ended."""


class TensorBoardTracker:
    """``events.out.tfevents.*`` in the run directory, figures over episodes."""

    def __init__(self, directory: Path) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(str(directory), flush_secs=10)

    def log(self, episode: int, figures: Figures) -> None:
        """Write one event per figure."""
        for name, value in figures.items():
            self._writer.add_scalar(name, value, episode)

    def close(self, status: str) -> None:
        """Flush."""
        self._writer.close()


class MlflowTracker:
    """An MLflow run, under the tracking URI in force (``MLFLOW_TRACKING_URI``)."""

    def __init__(self, run_id: str, config: RunConfig) -> None:
        import mlflow

        self._mlflow = mlflow
        mlflow.set_experiment("orchid")
        mlflow.start_run(run_name=run_id)
        mlflow.log_params(flatten(config))

    def log(self, episode: int, figures: Figures) -> None:
        """One batch per episode."""
        self._mlflow.log_metrics(dict(figures), step=episode)

    def close(self, status: str) -> None:
        """End the run with the status that MLflow has for it."""
        names = {"completed": "FINISHED", "interrupted": "KILLED"}
        self._mlflow.end_run(names.get(status, "FAILED"))


class TrackioTracker:
    """A run of the trackio project ``orchid`` on this machine."""

    def __init__(self, run_id: str, config: RunConfig) -> None:
        import trackio

        self._trackio = trackio
        trackio.init(project="orchid", name=run_id, config=flatten(config))

    def log(self, episode: int, figures: Figures) -> None:
        """One record per episode."""
        self._trackio.log(dict(figures), step=episode)

    def close(self, status: str) -> None:
        """End the run."""
        self._trackio.finish()


TRACKERS = ("tensorboard", "mlflow", "trackio")
"""Names for ``--track``; TensorBoard's files are always written."""


def open_tracker(name: str, directory: Path, config: RunConfig) -> "SafeTracker":
    """The tracker of that name for a run.

    Raises:
        InputError: unknown, or its package is not installed.
    """
    makers: dict[str, Any] = {
        "tensorboard": lambda: TensorBoardTracker(directory),
        "mlflow": lambda: MlflowTracker(directory.name, config),
        "trackio": lambda: TrackioTracker(directory.name, config),
    }
    if name not in makers:
        raise InputError(f"unknown tracker '{name}': known are {', '.join(TRACKERS)}")
    try:
        return SafeTracker(name, makers[name]())
    except ImportError as error:
        raise InputError(
            f"--track {name} needs a package that is not installed: "
            f"pip install 'orchid-uav[{name}]' ({error})"
        ) from error
    except Exception as error:
        warnings.warn(f"{name} is off for this run: {error}", stacklevel=2)
        return SafeTracker(name, None)


class SafeTracker:
    """Passes everything on to a tracker until that raises, then warns once and goes quiet."""

    def __init__(self, name: str, tracker: Tracker | None) -> None:
        self._name = name
        self._tracker = tracker

    def log(self, episode: int, figures: Figures) -> None:
        """Take an episode's figures."""
        self._try(lambda tracker: tracker.log(episode, figures))

    def close(self, status: str) -> None:
        """The run has ended."""
        self._try(lambda tracker: tracker.close(status))

    def _try(self, action: Any) -> None:
        if self._tracker is None:
            return
        try:
            action(self._tracker)
        except Exception as error:
            self._tracker = None
            warnings.warn(f"{self._name} is off for the rest of the run: {error}", stacklevel=3)
