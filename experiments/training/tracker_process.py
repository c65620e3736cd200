"""A tracker in its own process, where it cannot delay a run or disturb its random generators.

``python -m orchid_uav.experiments.training.tracker_process NAME FOLDER`` is that process. It reads
orders from its standard input, one JSON document per line. It ends when its standard input ends,
however the run ended.
"""

import importlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.interruption import ignore_signals
from orchid_uav.experiments.jobs.child_process import shortened
from orchid_uav.experiments.training.listeners import Tracker
from orchid_uav.notices import in_one_line

_SECONDS_AT_THE_END = 5.0
"""How long a run waits in the end for what its tracker has not exported yet, at most. It waits no
longer than that from the tracker's last word on: one that stands still costs a run nothing more."""
_SECONDS_WITHOUT_A_WORD = 60.0
_SECONDS_FOR_LAST_WORDS = 1.0
_SECONDS_BETWEEN_LOOKS = 0.02
_ENDED = "its process has ended"
_MOST_WAITING = 10_000
"""The most orders kept for a tracker; with more it would never catch up."""
_REPORT = "\x1e"
"""Marks a line that is a report for this module; all others are the tracker's own output."""
_IMPATIENCE = {"MLFLOW_HTTP_REQUEST_MAX_RETRIES": "1", "MLFLOW_HTTP_REQUEST_TIMEOUT": "20"}
"""Defaults for the environment of the process, unless the user sets these variables. MLflow's own
defaults are seven tries of two minutes each."""


class TrackerProcess(Tracker):
    """A tracker that never keeps its caller waiting.

    Only :meth:`close` waits, for a few seconds. If something went wrong in the process, the next
    method that is called raises RunFailedError.

    Args:
        name: the tracker's name.
        directory: the run directory.
        config: the run's configuration.
    """

    def __init__(self, name: str, directory: Path, config: RunConfig) -> None:
        self._orders: queue.Queue[dict[str, Any] | None] = queue.Queue(_MOST_WAITING)
        self._error: str | None = None
        self._last = self._exported = 0
        self._last_word_s = time.monotonic()
        self._is_imported = False
        self._process = subprocess.Popen(
            # -P: a file in the user's working directory must not replace a module of that name.
            [sys.executable, "-P", "-m", __name__, name, str(directory.absolute())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            bufsize=1,
            env=_IMPATIENCE | os.environ | {"PYTHONIOENCODING": "utf-8"},
            start_new_session=True,  # ctrl-C must reach only the run, which then reports its end
        )
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        threading.Thread(target=self._send, daemon=True).start()
        self._order(config=config.model_dump(mode="json"))

    def resume(self, episodes: int) -> None:
        """Tell the tracker that the run goes on after this many episodes."""
        self._order(resume=episodes)

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """Queue an episode's metrics for export."""
        self._order(episode=episode, metrics=dict(metrics))
        self._last = episode

    def close(self, status: str) -> None:
        """Wait until everything is exported, for some seconds at most, and end the process."""
        self._order(status=status)
        ended_s = time.monotonic()
        try:
            while self._process.poll() is None:
                now_s = time.monotonic()
                # Until its package is imported, it has had no chance to say anything.
                silent_s = now_s - self._last_word_s if self._is_imported else 0.0
                if max(silent_s, now_s - ended_s) > _SECONDS_AT_THE_END:
                    raise self._given_up(
                        f"no answer in {silent_s:.0f} s"
                        if silent_s > now_s - ended_s
                        else f"not done {_SECONDS_AT_THE_END:g} s after the run"
                    )
                time.sleep(_SECONDS_BETWEEN_LOOKS)
        finally:
            self._end()
        if self._process.returncode:
            raise self._given_up(self._error or _ENDED)

    def _order(self, **order: Any) -> None:
        if self._exported == self._last:
            self._last_word_s = time.monotonic()
        reason = self._error
        if time.monotonic() - self._last_word_s > _SECONDS_WITHOUT_A_WORD:
            reason = reason or f"no answer in {_SECONDS_WITHOUT_A_WORD:g} s"
        try:
            self._orders.put_nowait(order)
        except queue.Full:
            reason = reason or f"{_MOST_WAITING:,} episodes behind"
        if reason:
            self._end()
            raise self._given_up(reason)

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        with suppress(queue.Full):  # then the sender is not waiting for an order
            self._orders.put_nowait(None)
        self._listener.join(_SECONDS_FOR_LAST_WORDS)

    def _given_up(self, reason: str) -> RunFailedError:
        done = f"exported up to episode {self._exported}, no later ones"
        return RunFailedError(
            f"{shortened(reason)} ({done if self._exported else 'nothing exported'})"
        )

    def _send(self) -> None:
        assert self._process.stdin is not None
        # If the process has ended, the listening thread notices and says so.
        with suppress(OSError), self._process.stdin as orders:
            while (order := self._orders.get()) is not None:
                orders.write(json.dumps(order) + "\n")
                if "status" in order:
                    return

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                text, is_report, report = line.rstrip("\n").partition(_REPORT)
                if text.strip():
                    print(shortened(text), file=sys.stderr)
                if is_report:
                    self._last_word_s = time.monotonic()
                    document = json.loads(report)
                    self._is_imported = True
                    self._exported = document.get("exported", self._exported)
                    self._error = document.get("error", self._error)
        self._error = self._error or _ENDED


def _report(**document: Any) -> None:
    print(_REPORT + json.dumps(document), flush=True)


def _serve(name: str, folder: str) -> None:
    from orchid_uav.experiments.training.trackers import EXPORTERS

    importlib.import_module(name)
    _report(imported=name)
    tracker = None
    for line in sys.stdin:
        order = json.loads(line)
        if tracker is None:
            tracker = EXPORTERS[name](Path(folder), RunConfig.model_validate(order["config"]))
        elif "resume" in order:
            tracker.resume(order["resume"])
        elif "metrics" in order:
            tracker.log(order["episode"], order["metrics"])
            _report(exported=order["episode"])
        else:
            tracker.close(order["status"])
            return
    if tracker is not None:
        tracker.close("died")


def main() -> int:
    """Export the metrics of a run until its orders end."""
    ignore_signals()  # batch systems signal every process; the run itself says how it ended
    try:
        _serve(*sys.argv[1:3])
    except Exception as error:
        _report(error=in_one_line(error))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
