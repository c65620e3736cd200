"""What the progress displays of training, evaluations and jobs share."""

import time

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

SECONDS_BETWEEN_LINES = 5.0


class Pace:
    """Decides when a log should get its next line.

    Args:
        at_once: whether the first line is due immediately.
    """

    def __init__(self, at_once: bool = False) -> None:
        self._began_s = time.monotonic()
        self._next_s = self._began_s + (0.0 if at_once else SECONDS_BETWEEN_LINES)

    @property
    def elapsed_s(self) -> float:
        """Seconds since the display began."""
        return time.monotonic() - self._began_s

    def is_due(self) -> bool:
        """Whether a line is due now; if so, the next one is due some seconds later."""
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + SECONDS_BETWEEN_LINES
        return True


def time_left() -> tuple[ProgressColumn, ...]:
    """Columns to stand behind the time taken."""
    return TextColumn("and"), TimeRemainingColumn(), TextColumn("left")


def bars(
    out: Console,
    *behind: ProgressColumn,
    before: tuple[ProgressColumn, ...] = (),
    **options: object,
) -> Progress:
    """Bars as wide as the terminal, with the share done and the time taken.

    Args:
        out: the console to draw on.
        behind: further columns on the right.
        before: columns to the left of the bar.
        options: arguments for Rich's ``Progress``.
    """
    return Progress(
        *before,
        BarColumn(bar_width=None),
        TextColumn("{task.percentage:.0f} % in"),
        TimeElapsedColumn(),
        *behind,
        console=out,
        expand=True,
        **options,  # type: ignore[arg-type]
    )
