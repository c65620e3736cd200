"""Exporters of a run directory to MLflow, trackio and W&B; they run in processes of their own."""

import importlib
import os
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from filelock import FileLock

from orchid_uav.agents.deployed_actor import DESCRIPTION_FILE, WEIGHTS_FILE
from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.runs.records import (
    CONFIG_FILE,
    EPISODES_FILE,
    RECORD_FILE,
    read_record,
)
from orchid_uav.experiments.training.listeners import Tracker

PROJECT = "orchid"
"""Name of the experiment in MLflow, and of the project in trackio and W&B."""
DATABASE, ARTIFACTS, _LOCK = "mlflow.db", "mlflow-artifacts", ".mlflow.lock"
"""Beside the runs, unless ``MLFLOW_TRACKING_URI`` names another place."""
RUN_TAG = "orchid.run"
"""Tag of a run in MLflow that holds its id here, by which it is found again."""
_EXPORTED_FILES = (RECORD_FILE, CONFIG_FILE, EPISODES_FILE, WEIGHTS_FILE, DESCRIPTION_FILE)
_ALWAYS_LOGGED = "episode/reward"


class MlflowTracker(Tracker):
    """An MLflow run at ``MLFLOW_TRACKING_URI``, else in a database beside the runs.

    It gets the configuration as parameters, the metrics of an episode as one batch, and in the end
    the final metrics, the files of the run and its status. A run that goes on continues its MLflow
    run: what is there already is not logged again.

    Args:
        directory: the run directory.
        config: the run's configuration.
    """

    def __init__(self, directory: Path, config: RunConfig) -> None:
        import mlflow

        self._mlflow, self._directory = mlflow, directory
        client, experiment = _find_experiment(mlflow, directory.parent)
        run_id = directory.name
        quote = '"' if "'" in run_id else "'"
        earlier = client.search_runs(
            [experiment], f"tags.`{RUN_TAG}` = {quote}{run_id}{quote}", max_results=1
        )
        self._episodes_there, known = 0, {}
        if earlier:
            uuid, known = earlier[0].info.run_id, earlier[0].data.params
            mlflow.start_run(run_id=uuid)
            steps = [one.step for one in client.get_metric_history(uuid, _ALWAYS_LOGGED)]
            self._episodes_there = max(steps, default=0)
        else:
            mlflow.start_run(run_name=run_id, experiment_id=experiment, tags={RUN_TAG: run_id})
        values = {key: str(value) for key, value in flatten(config).items()}
        new = {key: value for key, value in values.items() if key not in known}
        if new:
            mlflow.log_params(new)
        # MLflow never changes a parameter, and an extended run has more episodes.
        changed = {key: value for key, value in values.items() if known.get(key, value) != value}
        if changed:
            mlflow.set_tags(changed)

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """Log the metrics of an episode as one batch."""
        if episode > self._episodes_there:
            self._mlflow.log_metrics(dict(metrics), step=episode)

    def close(self, status: str) -> None:
        """Export final metrics and files, and end the run with the matching MLflow status."""
        names = {"completed": "FINISHED", "interrupted": "KILLED"}
        try:
            record = read_record(self._directory)
            if record.final_scalars:
                self._mlflow.log_metrics(record.final_scalars, step=record.episodes)
            for path in map(self._directory.joinpath, _EXPORTED_FILES):
                if path.is_file():
                    self._mlflow.log_artifact(str(path))
        finally:
            self._mlflow.end_run(names.get(status, "FAILED"))


def _find_experiment(mlflow: Any, runs_dir: Path) -> tuple[Any, str]:
    """A client of where to log, and the id of the experiment there, which is made if it is missing.

    Runs that begin at once make one database and one experiment. ``mlflow.set_experiment`` would
    put those that come second into another experiment, without a word.
    """
    is_ours, artifacts = not os.environ.get("MLFLOW_TRACKING_URI"), None
    with FileLock(runs_dir / _LOCK) if is_ours else nullcontext():
        if is_ours:
            mlflow.set_tracking_uri(f"sqlite:///{(runs_dir / DATABASE).resolve()}")
            artifacts = (runs_dir / ARTIFACTS).resolve().as_uri()
        client = mlflow.MlflowClient()
        found = client.get_experiment_by_name(PROJECT)
        if found is None:
            try:
                return client, client.create_experiment(PROJECT, artifacts)
            except mlflow.MlflowException:
                found = client.get_experiment_by_name(PROJECT)
                if found is None:
                    raise
        return client, found.experiment_id


class ProjectTracker(Tracker):
    """A run of the project ``orchid``, in packages with the functions of W&B's: trackio has them.

    A run that goes on continues the run of its id there.

    Args:
        package: ``trackio`` or ``wandb``.
        directory: the run directory.
        config: the run's configuration.
    """

    def __init__(self, package: str, directory: Path, config: RunConfig) -> None:
        self._package, self._directory = importlib.import_module(package), directory
        self._is_wandb = package == "wandb"
        # trackio finds a run by its name.
        own = {"id": directory.name, "dir": str(directory.parent)} if self._is_wandb else {}
        self._package.init(
            project=PROJECT, name=directory.name, config=flatten(config), resume="allow", **own
        )

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """Log the metrics of an episode as one record."""
        self._package.log(dict(metrics), step=episode)

    def close(self, status: str) -> None:
        """Log the final metrics and end the run; W&B is told whether it is complete."""
        record = read_record(self._directory)
        if record.final_scalars:
            self._package.log(record.final_scalars, step=record.episodes)
        own = {"exit_code": int(status != "completed")} if self._is_wandb else {}
        self._package.finish(**own)
