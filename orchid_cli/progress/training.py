"""How a training run looks while it goes on."""

import time
from collections.abc import Sequence

from rich.console import Console, Group
from rich.live import Live
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from orchid_uav.cli.console import print_line, print_warning
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import FINAL_EPISODES, Row, RunDirectory

_SECONDS_BETWEEN_LINES = 5.0


def metric_texts(metrics: Row) -> dict[str, str]:
    """An episode's metrics, or means of several, as people read them."""
    return {
        "reward": f"{metrics['reward']:.1f}",
        "coverage": f"{metrics['coverage']:.3f}",
        "energy efficiency": f"{metrics['energy_efficiency_bit_per_joule'] / 1e6:.3f} Mbit/J",
        "rate JFI": f"{metrics['rate_jfi']:.3f}",
        "load JFI": f"{metrics['load_jfi']:.3f}",
        "worst user": f"{metrics['worst_rate_bps'] / 1e6:.2f} Mbit/s",
    }


def _behind(rows: Sequence[Row]) -> str:
    return f", going on behind episode {len(rows)}" if rows else ""


class SilentReporter:
    """Shows nothing."""

    def begin(
        self,
        run: RunDirectory,
        config: RunConfig,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
    ) -> None:
        """Nothing."""

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Nothing."""

    def warn(self, message: str) -> None:
        """Say it all the same, on stderr."""
        print_warning(message)

    def end(self) -> None:
        """Nothing."""


class _RunningMetrics:
    """What both displays know of the run."""

    def __init__(
        self, config: RunConfig, rows: Sequence[Row], reset_episodes: Sequence[int]
    ) -> None:
        self.config = config
        self.rows = list(rows)
        self.resets = list(reset_episodes)
        self._rows_before = len(rows)
        self._began = time.monotonic()

    def add(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        self.rows += rows
        self.resets = list(reset_episodes)

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self._began

    @property
    def steps_per_s(self) -> float:
        """Slots flown per second, those of all worlds together."""
        slots = self._new_rows * self.config.network.episode_slots
        return slots / max(self.elapsed_s, 1e-9)

    @property
    def remaining_s(self) -> float:
        left = self.config.training.episodes - len(self.rows)
        return left * self.elapsed_s / max(self._new_rows, 1)

    @property
    def _new_rows(self) -> int:
        """Since the run was resumed."""
        return len(self.rows) - self._rows_before

    def recent_means(self) -> Row:
        recent = self.rows[-FINAL_EPISODES:]
        return {name: sum(row[name] for row in recent) / len(recent) for name in recent[0]}

    def reset_state(self) -> str:
        reset = self.config.reset
        if not reset.enabled:
            return "off"
        if self.resets:
            episodes = ", ".join(map(str, self.resets))
            return f"reset at {episodes}; {reset.max_resets - len(self.resets)} left"
        first = 2 * reset.window
        if len(self.rows) < first:
            return f"windows fill until episode {first}"
        return "watching for a plateau"


class LineReporter:
    """A line every few seconds, for logs."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def begin(
        self,
        run: RunDirectory,
        config: RunConfig,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
    ) -> None:
        """Say where the run is."""
        self._metrics = _RunningMetrics(config, rows, reset_episodes)
        self._last_line_s = -_SECONDS_BETWEEN_LINES
        print_line(self._out, f"run {run.id} in {run.path}{_behind(rows)}")

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Print a line if one is due."""
        known_resets = len(self._metrics.resets)
        self._metrics.add(rows, list(reset_episodes))
        for episode in reset_episodes[known_resets:]:
            actor, critic = rows[-1]["actor_lr"], rows[-1]["critic_lr"]
            print_line(
                self._out,
                f"episode {episode}: plateau, optimizer reset, learning rates {actor:g} {critic:g}",
            )
        is_last = len(self._metrics.rows) == self._metrics.config.training.episodes
        if is_last or self._metrics.elapsed_s - self._last_line_s >= _SECONDS_BETWEEN_LINES:
            self._last_line_s = self._metrics.elapsed_s
            print_line(self._out, self._line())

    def warn(self, message: str) -> None:
        """On stderr."""
        print_warning(message)

    def _line(self) -> str:
        metrics = self._metrics
        texts = metric_texts(metrics.recent_means())
        shown = ", ".join(f"{name} {text}" for name, text in texts.items())
        return (
            f"episode {len(metrics.rows)}/{metrics.config.training.episodes}: {shown}; "
            f"{metrics.steps_per_s:.0f} steps/s, {metrics.remaining_s:.0f} s left"
        )

    def end(self) -> None:
        """Nothing more to say."""


class LiveReporter:
    """A progress bar over a table of metrics, for terminals."""

    def __init__(self, out: Console) -> None:
        self._out = out
        print_line(out, "getting ready ...")

    def begin(
        self,
        run: RunDirectory,
        config: RunConfig,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
    ) -> None:
        """Open the display."""
        self._metrics = _RunningMetrics(config, rows, reset_episodes)
        self._progress = Progress(
            TextColumn("[bold]episode"),
            MofNCompleteColumn(),
            BarColumn(bar_width=None),
            TextColumn("{task.percentage:.0f} %"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=self._out,
            expand=True,
        )
        self._task = self._progress.add_task(
            "", total=config.training.episodes, completed=len(rows)
        )
        print_line(self._out, f"run {run.id}{_behind(rows)}")
        self._live = Live(self._progress, console=self._out, refresh_per_second=2)
        self._live.start()

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Move on."""
        self._metrics.add(rows, list(reset_episodes))
        self._progress.update(self._task, completed=len(self._metrics.rows))
        self._live.update(Group(self._progress, self._table()))

    def warn(self, message: str) -> None:
        """Above the display."""
        print_warning(message)

    def _table(self) -> Table:
        metrics = self._metrics
        last = metrics.rows[-1]
        now, recent = metric_texts(last), metric_texts(metrics.recent_means())
        table = Table(box=None, pad_edge=False, header_style="dim")
        table.add_column("")
        table.add_column("last episode", justify="right")
        table.add_column(f"mean of {min(FINAL_EPISODES, len(metrics.rows))}", justify="right")
        for name, text in now.items():
            table.add_row(name, text, recent[name])
        table.add_row("learning rates", f"{last['actor_lr']:g} / {last['critic_lr']:g}", "")
        table.add_row("Reset-and-Finetune", metrics.reset_state(), "")
        table.add_row("steps/s", f"{metrics.steps_per_s:.0f}", "")
        return table

    def end(self) -> None:
        """Close the display, leaving its last state."""
        self._live.stop()
