"""How far ``orchid replay`` is."""

from rich.console import Console
from rich.progress import TextColumn

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.cli.progress.displays import Pace, bars
from orchid_uav.experiments.replay.flown import ReplayListener


def replay_progress(out: Console, quiet: bool) -> ReplayListener:
    """A bar on a terminal, lines elsewhere, nothing if it shall be quiet."""
    if quiet:
        return ReplayListener()
    return _Bar(out) if has_cursor(out) else _Lines(out)


class _Bar(ReplayListener):
    def __init__(self, out: Console) -> None:
        before = (TextColumn("{task.description}", markup=False),)
        self._bars = bars(out, before=before, transient=True)
        self._task = self._bars.add_task("", total=1.0)
        self._bars.start()

    def begins(self, stage: str, steps: int) -> None:
        self._bars.update(self._task, description=stage, completed=0.0, total=steps)

    def advances(self) -> None:
        self._bars.update(self._task, advance=1.0)

    def ends(self) -> None:
        self._bars.stop()


class _Lines(ReplayListener):
    def __init__(self, out: Console) -> None:
        self._out, self._pace = out, Pace()

    def begins(self, stage: str, steps: int) -> None:
        self._stage, self._steps, self._done = stage, steps, 0

    def advances(self) -> None:
        self._done += 1
        if self._pace.is_due():
            print_line(self._out, f"{self._stage}: {self._done / self._steps:.0%}")
