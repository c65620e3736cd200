"""What the displays of training, evaluations and jobs have in common."""

import time

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn, TimeElapsedColumn

SECONDS_BETWEEN_LINES = 5.0


class Pace:
    """Says when a log is due another line.

    Args:
        at_once: the first line need not wait.
    """

    def __init__(self, at_once: bool = False) -> None:
        self._began_s = time.monotonic()
        self._next_s = self._began_s + (0.0 if at_once else SECONDS_BETWEEN_LINES)

    @property
    def elapsed_s(self) -> float:
        """Seconds since the display began."""
        return time.monotonic() - self._began_s

    def is_due(self) -> bool:
        """Whether a line is due; if so, the next one is some seconds later."""
        now_s = time.monotonic()
        if now_s < self._next_s:
            return False
        self._next_s = now_s + SECONDS_BETWEEN_LINES
        return True


def bars(
    out: Console,
    *behind: ProgressColumn,
    before: tuple[ProgressColumn, ...] = (),
    **options: object,
) -> Progress:
    """Bars as wide as the terminal, with the share that is done and the time it took.

    Args:
        out: where they are drawn.
        behind: columns to the right of these.
        before: columns to the left of the bar.
        options: of Rich's ``Progress``.
    """
    return Progress(
        *before,
        BarColumn(bar_width=None),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
        *behind,
        console=out,
        expand=True,
        **options,  # type: ignore[arg-type]
    )
