"""What a server that never answers costs a run: ``python -m benchmarks.dead_tracker``.

A run is trained with ``--track mlflow`` at a server that accepts connections and is silent. Taken
is the share of the run's time that it spends on its tracker, from making it to giving it up, within
one run: comparing two runs would show the machine's other work. What the tracker's own process
computes, mainly the import of MLflow, is told beside it. It needs the extra ``mlflow``.
"""

import argparse
import os
import resource
import socket
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from orchid_uav.experiments.configuration import Layer, merge
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training.listeners import Reporter, Tracker
from orchid_uav.experiments.training.loop import train
from orchid_uav.experiments.training.trackers import SafeTracker, open_tracker


class Stopwatch(SafeTracker):
    """A tracker whose calls are timed."""

    def __init__(self, make: Callable[[], Tracker]) -> None:
        self.seconds = 0.0
        self._made = self._timed(make)
        super().__init__("mlflow", self._made)

    def _timed(self, action: Callable[[], Any]) -> Any:
        began = time.perf_counter()
        try:
            return action()
        finally:
            self.seconds += time.perf_counter() - began

    def _try(self, action: Callable[[Tracker], None]) -> None:
        self._timed(lambda: action(self._made))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=700)
    arguments = parser.parse_args()
    config, _ = merge([Layer("benchmark", {"training.episodes": arguments.episodes})])
    # Connections are completed by the kernel, and nobody ever reads what is sent.
    with (
        socket.create_server(("127.0.0.1", 0), backlog=128) as server,
        tempfile.TemporaryDirectory() as folder,
    ):
        os.environ["MLFLOW_TRACKING_URI"] = f"http://127.0.0.1:{server.getsockname()[1]}"
        run = RunDirectory.create(Path(folder), "dead", config, ["orchid", "train"])
        began = time.perf_counter()
        tracker = Stopwatch(lambda: open_tracker("mlflow", run.path, config))
        train(config, run, Reporter(), [tracker])
        seconds = time.perf_counter() - began
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{arguments.episodes} episodes in {seconds:.1f} s, of which {tracker.seconds:.2f} s "
        f"({tracker.seconds / seconds:.2%}) went to the tracker; its process computed for "
        f"{children.ru_utime + children.ru_stime:.1f} s"
    )


if __name__ == "__main__":
    main()
