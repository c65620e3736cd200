"""A run's metrics, settings and end as TensorBoard shows them."""

import os
import platform
import time
from collections.abc import Mapping
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.runs.records import RunRecord, read_record
from orchid_uav.experiments.training.listeners import Tracker

_END = ".hparams"
"""Ends the name of the file that a run gets when it ends."""


class TensorBoardTracker(Tracker):
    """``events.out.tfevents.*`` in the run directory, one event per episode.

    When the run ends, a second file gets its settings, final metrics and status, for the page
    HPARAMS. It replaces the one of an earlier end: TensorBoard would go on showing that.

    Args:
        directory: the run directory.
        config: the run's configuration.
    """

    def __init__(self, directory: Path, config: RunConfig) -> None:
        from tensorboard.compat.proto.event_pb2 import SessionLog
        from tensorboard.compat.proto.summary_pb2 import Summary

        self._directory, self._config, self._summary = directory, config, Summary
        self._start = SessionLog(status=SessionLog.START)
        name = f"events.out.tfevents.{int(time.time())}.{platform.node()}.{os.getpid()}"
        # If the clock was set back, an earlier process of the same number may have used the name.
        names = chain([name], (f"{name}.{number}" for number in count(1)))
        self._path = next(path for path in map(directory.joinpath, names) if not path.exists())
        self._events = _Events(self._path)

    def resume(self, episodes: int) -> None:
        """Tell TensorBoard to drop what an earlier process logged of later episodes."""
        self._events.write(step=episodes + 1, session_log=self._start)

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """Write the metrics under the episode's number."""
        self._events.write(step=episode, summary=self._scalars(metrics))

    def close(self, status: str) -> None:
        """Close the file, and write how the run has ended to a file of its own."""
        self._events.close()
        for earlier in self._directory.glob(f"events.out.tfevents.*{_END}"):
            earlier.unlink()
        record = read_record(self._directory)
        # Now, and by a name behind the other's: TensorBoard may read neither again.
        summaries = [
            session_start(record, self._config),
            self._scalars(record.final_scalars),
            session_end(status),
        ]
        events = _Events(self._path.with_name(self._path.name + _END))
        for summary in summaries:
            events.write(step=record.episodes, summary=summary)
        events.close()

    def _scalars(self, metrics: Mapping[str, float]) -> Any:
        values = [
            self._summary.Value(tag=name, simple_value=value) for name, value in metrics.items()
        ]
        return self._summary(value=values)


class _Events:
    """A new file of events, written at once and in this thread.

    The thread of ``SummaryWriter`` would die with a traceback on a full disk.
    """

    def __init__(self, path: Path) -> None:
        from tensorboard.compat.proto.event_pb2 import Event
        from tensorboard.summary.writer.record_writer import RecordWriter

        self._event = Event
        # Unbuffered: Python would try to write a buffer that a full disk refused again at exit.
        self._file = path.open("xb", buffering=0)
        self._records = RecordWriter(self._file)
        self.write(file_version="brain.Event:2")

    def write(self, **content: Any) -> None:
        """Write an event with a time and these fields."""
        event = self._event(wall_time=time.time(), **content)
        try:
            self._records.write(event.SerializeToString())
        except OSError:
            self._file.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._records.close()


def session_start(record: RunRecord, config: RunConfig) -> Any:
    """What the page HPARAMS shows of a run's settings, as a summary.

    ``tensorboard.plugins.hparams.summary`` has the same, but needs TensorFlow.
    """
    from tensorboard.plugins.hparams import metadata, plugin_data_pb2

    started = datetime.fromisoformat(record.started).timestamp()
    content = plugin_data_pb2.SessionStartInfo(start_time_secs=started)
    for key, value in flatten(config).items():
        if isinstance(value, bool):  # before int, which it is as well
            content.hparams[key].bool_value = value
        elif isinstance(value, int | float):
            content.hparams[key].number_value = value
        else:
            content.hparams[key].string_value = "none" if value is None else str(value)
    data = plugin_data_pb2.HParamsPluginData(session_start_info=content)
    return _plugin_summary(metadata.SESSION_START_INFO_TAG, data)


def session_end(status: str) -> Any:
    """How a run has ended, as a summary; what is not complete is a failure for TensorBoard."""
    from tensorboard.plugins.hparams import api_pb2, metadata, plugin_data_pb2

    content = plugin_data_pb2.SessionEndInfo(
        status=api_pb2.STATUS_SUCCESS if status == "completed" else api_pb2.STATUS_FAILURE,
        end_time_secs=time.time(),
    )
    data = plugin_data_pb2.HParamsPluginData(session_end_info=content)
    return _plugin_summary(metadata.SESSION_END_INFO_TAG, data)


def _plugin_summary(tag: str, data: Any) -> Any:
    from tensorboard.compat.proto.summary_pb2 import Summary
    from tensorboard.plugins.hparams import metadata

    about = metadata.create_summary_metadata(data)
    return Summary(value=[Summary.Value(tag=tag, metadata=about, tensor=metadata.NULL_TENSOR)])
