"""What displays have in common: when a log gets a line, and how wide bars are."""

import io

import pytest
from rich.console import Console
from rich.progress import TextColumn

from orchid_uav.cli.progress import displays
from orchid_uav.cli.progress.displays import SECONDS_BETWEEN_LINES, Pace, bars, time_left


@pytest.fixture
def clock(monkeypatch):
    """Seconds that a test sets."""
    now = [100.0]
    monkeypatch.setattr(displays.time, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize(("at_once", "first"), [(True, 0.0), (False, SECONDS_BETWEEN_LINES)])
def test_a_log_gets_a_line_every_few_seconds_however_often_it_asks(clock, at_once, first):
    pace, due = Pace(at_once), []
    for tenths in range(160):
        clock[0] = 100.0 + tenths / 10
        if pace.is_due():
            due.append(pace.elapsed_s)
    assert due == [first + number * SECONDS_BETWEEN_LINES for number in range(len(due))]
    assert due[-1] == 3 * SECONDS_BETWEEN_LINES


def test_bars_fill_the_width_of_the_terminal():
    file = io.StringIO()
    out = Console(file=file, force_terminal=True, width=80, color_system=None)
    progress = bars(out, *time_left(), before=(TextColumn("episode"),))
    progress.add_task("", total=4.0, completed=1.0)
    out.print(progress)
    line = file.getvalue().rstrip("\n")
    assert line.startswith("episode ") and line.endswith(" 25 % in 0:00:00 and -:--:-- left")
    assert len(line) == 80
