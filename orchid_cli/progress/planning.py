"""How far ``orchid plan`` is."""

from rich.console import Console
from rich.progress import TaskID, TextColumn

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.cli.progress.displays import Pace, bars
from orchid_uav.experiments.planning.planner import PlanningListener


def planning_progress(out: Console, quiet: bool) -> PlanningListener:
    """A bar on a terminal, lines elsewhere, nothing if it shall be quiet."""
    if quiet:
        return PlanningListener()
    return _Bar(out) if has_cursor(out) else _Lines(out)


class _Bar(PlanningListener):
    def __init__(self, out: Console) -> None:
        self._bars = bars(out, before=(TextColumn("{task.description}"),), transient=True)
        self._task: TaskID = self._bars.add_task("", total=1.0)
        self._bars.start()

    def begins(self, stage: str) -> None:
        self._bars.update(self._task, description=stage, completed=0.0)

    def searches(self, share: float, utility: float) -> None:
        self._bars.update(
            self._task, description=f"stations, utility {utility:.4f}", completed=min(share, 1.0)
        )

    def ends(self) -> None:
        self._bars.stop()


class _Lines(PlanningListener):
    def __init__(self, out: Console) -> None:
        self._out, self._pace = out, Pace()

    def begins(self, stage: str) -> None:
        if self._pace.is_due():
            print_line(self._out, f"{stage} …")

    def searches(self, share: float, utility: float) -> None:
        if self._pace.is_due():
            print_line(self._out, f"stations: {share:.0%} of the budget, utility {utility:.4f}")
