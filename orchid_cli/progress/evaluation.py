"""The progress of an evaluation, on terminals and in logs."""

from rich.console import Console
from rich.progress import TextColumn

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.cli.progress.displays import Pace, bars, time_left
from orchid_uav.experiments.evaluation.flights import Flight, FlightProgress, describe
from orchid_uav.experiments.metrics import label_of
from orchid_uav.experiments.runs.records import short_ids

_LEAST_FRACTION = 0.02


def evaluation_progress(out: Console, quiet: bool) -> FlightProgress:
    """The display that suits a console."""
    if quiet:
        return FlightProgress()
    return LiveProgress(out) if has_cursor(out) else LineProgress(out)


def _describe(flight: Flight) -> str:
    setting, described = flight.setting, describe(flight)
    run = described["run"]
    if run is not None:  # beside a bar there is no room for more
        described["method"] = described["method"].replace(run, short_ids([run])[run], 1)
    label = label_of(described["method"], described["deterministic"])
    return (
        f"{label}, {setting.uavs} UAVs, {setting.users} users, "
        f"{setting.speed_mps:g} m/s, {setting.distribution}"
    )


class _Display(FlightProgress):
    """What both displays share."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def end(self) -> None:
        """Print what follows."""
        print_line(self._out, "summarising ...")


class LineProgress(_Display):
    """A line every few seconds, for logs."""

    def begin(self, total_cost: float) -> None:
        """Note the time."""
        self._total, self._done = total_cost, 0.0
        self._pace = Pace()

    def start(self, flight: Flight) -> None:
        """Show the name of this flight from now on."""
        self._flight = flight

    def advance(self, cost: float) -> None:
        """Print a line if one is due."""
        self._done += cost
        # The first flight includes compilation, so it does not predict the rest.
        if self._pace.is_due() and self._done >= _LEAST_FRACTION * self._total:
            left_s = self._pace.elapsed_s * (self._total - self._done) / self._done
            fraction_done = self._done / self._total
            print_line(
                self._out,
                f"{fraction_done:.0%}: {_describe(self._flight)}; about {left_s:.0f} s left",
            )


class LiveProgress(_Display):
    """A progress bar, for terminals."""

    def __init__(self, out: Console) -> None:
        super().__init__(out)
        self._progress = bars(
            out,
            *time_left(),
            TextColumn("{task.description}"),
            transient=True,
        )

    def begin(self, total_cost: float) -> None:
        """Open the display."""
        self._task = self._progress.add_task("", total=total_cost)
        self._progress.start()

    def start(self, flight: Flight) -> None:
        """Show the name of this flight from now on."""
        self._progress.update(self._task, description=_describe(flight))

    def advance(self, cost: float) -> None:
        """Move on."""
        self._progress.update(self._task, advance=cost)

    def end(self) -> None:
        """Close the display, and print what follows."""
        self._progress.stop()
        super().end()
