"""How far an evaluation is, on terminals and in logs."""

import time

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.experiments.evaluation.flights import Flight, SilentProgress, describe
from orchid_uav.experiments.evaluation.flights import Progress as FlightProgress
from orchid_uav.experiments.metrics import label_of
from orchid_uav.experiments.runs.records import short_ids

_SECONDS_BETWEEN_LINES = 5.0
_LEAST_SHARE = 0.02
_NEXT = "summarising ..."


def evaluation_progress(out: Console, quiet: bool) -> FlightProgress:
    """The display that suits a console."""
    if quiet:
        return SilentProgress()
    return LiveProgress(out) if has_cursor(out) else LineProgress(out)


def _describe(flight: Flight) -> str:
    setting, described = flight.setting, describe(flight)
    run = described["run"]
    if run is not None:  # in a line with a bar there is room for no more
        described["method"] = described["method"].replace(run, short_ids([run])[run], 1)
    return (
        f"{label_of(described)}, {setting.uavs} UAVs, {setting.users} users, "
        f"{setting.speed_mps:g} m/s, {setting.distribution}"
    )


class LineProgress:
    """A line every few seconds, for logs."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def begin(self, total_cost: float) -> None:
        """Take the time."""
        self._total, self._done = total_cost, 0.0
        self._began_s = self._last_line_s = time.monotonic()

    def start(self, flight: Flight) -> None:
        """Name it from now on."""
        self._flight = flight

    def advance(self, cost: float) -> None:
        """Print a line if one is due."""
        self._done += cost
        now_s = time.monotonic()
        if now_s - self._last_line_s >= _SECONDS_BETWEEN_LINES:
            self._last_line_s = now_s
            if self._done < _LEAST_SHARE * self._total:  # compilation tells nothing of the rest
                return
            left_s = (now_s - self._began_s) * (self._total - self._done) / self._done
            share = self._done / self._total
            print_line(
                self._out, f"{share:.0%}: {_describe(self._flight)}; about {left_s:.0f} s left"
            )

    def end(self) -> None:
        """Say what follows."""
        print_line(self._out, _NEXT)


class LiveProgress:
    """A progress bar, for terminals."""

    def __init__(self, out: Console) -> None:
        self._out = out
        self._progress = Progress(
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
            console=out,
            expand=True,
            transient=True,
        )

    def begin(self, total_cost: float) -> None:
        """Open the display."""
        self._task = self._progress.add_task("", total=total_cost)
        self._progress.start()

    def start(self, flight: Flight) -> None:
        """Name it from now on."""
        self._progress.update(self._task, description=_describe(flight))

    def advance(self, cost: float) -> None:
        """Move on."""
        self._progress.update(self._task, advance=cost)

    def end(self) -> None:
        """Close the display, and say what follows."""
        self._progress.stop()
        print_line(self._out, _NEXT)
