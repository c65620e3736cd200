"""The progress of a training run."""

from collections.abc import Sequence

from rich.console import Console, Group
from rich.live import Live
from rich.progress import MofNCompleteColumn, TextColumn
from rich.table import Table

from orchid_uav.cli.console import has_cursor, print_line
from orchid_uav.cli.progress.displays import Pace, bars, time_left
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import FINAL_EPISODES, Row, RunDirectory
from orchid_uav.experiments.training.listeners import Reporter


def training_reporter(out: Console, quiet: bool) -> Reporter:
    """The display that suits a console."""
    if quiet:
        return Reporter()
    return LiveReporter(out) if has_cursor(out) else LineReporter(out)


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


class _Display(Reporter):
    """What both displays know about the run."""

    def __init__(self, out: Console) -> None:
        self._out = out

    def begin(
        self,
        run: RunDirectory,
        config: RunConfig,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
    ) -> None:
        """Note the time, and print which run this is."""
        self._config = config
        self._rows, self._resets = list(rows), list(reset_episodes)
        self._rows_before = len(rows)
        self._pace = Pace(at_once=True)
        behind = f", continuing after episode {len(rows)}" if rows else ""
        print_line(self._out, f"run {self._name(run)}{behind}")

    def _name(self, run: RunDirectory) -> str:
        return run.id

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Note the new episodes."""
        self._rows += rows
        self._resets = list(reset_episodes)

    @property
    def _new_rows(self) -> int:
        """Seconds since the run began or was resumed."""
        return len(self._rows) - self._rows_before

    def _steps_per_s(self) -> float:
        """Slots flown per second, summed over all worlds."""
        slots = self._new_rows * self._config.network.episode_slots
        return slots / max(self._pace.elapsed_s, 1e-9)

    def _recent_means(self) -> Row:
        recent = self._rows[-FINAL_EPISODES:]
        return {name: sum(row[name] for row in recent) / len(recent) for name in recent[0]}


class LineReporter(_Display):
    """A line every few seconds, for logs."""

    def _name(self, run: RunDirectory) -> str:
        return f"{run.id} in {run.path}"

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Print a line for every reset, and one of metrics if it is due."""
        new_resets = reset_episodes[len(self._resets) :]
        super().show(rows, reset_episodes)
        for episode in new_resets:
            actor, critic = rows[-1]["actor_lr"], rows[-1]["critic_lr"]
            print_line(
                self._out,
                f"episode {episode}: plateau, optimizer reset, learning rates {actor:g} {critic:g}",
            )
        is_last = len(self._rows) == self._config.training.episodes
        if self._pace.is_due() or is_last:
            print_line(self._out, self._line())

    def _line(self) -> str:
        texts = metric_texts(self._recent_means())
        shown = ", ".join(f"{name} {text}" for name, text in texts.items())
        episodes = self._config.training.episodes
        left_s = (episodes - len(self._rows)) * self._pace.elapsed_s / max(self._new_rows, 1)
        return (
            f"episode {len(self._rows)}/{episodes}: {shown}; "
            f"{self._steps_per_s():.0f} steps/s, {left_s:.0f} s left"
        )


class LiveReporter(_Display):
    """A progress bar over a table of metrics, for terminals."""

    def __init__(self, out: Console) -> None:
        super().__init__(out)
        print_line(out, "getting ready ...")

    def begin(
        self,
        run: RunDirectory,
        config: RunConfig,
        rows: Sequence[Row],
        reset_episodes: Sequence[int],
    ) -> None:
        """Open the display."""
        super().begin(run, config, rows, reset_episodes)
        self._progress = bars(
            self._out,
            *time_left(),
            before=(TextColumn("[bold]episode"), MofNCompleteColumn()),
        )
        self._task = self._progress.add_task(
            "", total=config.training.episodes, completed=len(rows)
        )
        self._live = Live(self._progress, console=self._out, refresh_per_second=2)
        self._live.start()

    def show(self, rows: Sequence[Row], reset_episodes: Sequence[int]) -> None:
        """Move on."""
        super().show(rows, reset_episodes)
        self._progress.update(self._task, completed=len(self._rows))
        self._live.update(Group(self._progress, self._table()))

    def _table(self) -> Table:
        last = self._rows[-1]
        now, recent = metric_texts(last), metric_texts(self._recent_means())
        table = Table(box=None, pad_edge=False, header_style="dim")
        table.add_column("")
        table.add_column("last episode", justify="right")
        table.add_column(f"mean of {min(FINAL_EPISODES, len(self._rows))}", justify="right")
        for name, text in now.items():
            table.add_row(name, text, recent[name])
        table.add_row("learning rates", f"{last['actor_lr']:g} / {last['critic_lr']:g}", "")
        table.add_row("Reset-and-Finetune", self._reset_state(), "")
        table.add_row("steps/s", f"{self._steps_per_s():.0f}", "")
        return table

    def _reset_state(self) -> str:
        reset = self._config.reset
        if not reset.enabled:
            return "off"
        if self._resets:
            episodes = ", ".join(map(str, self._resets))
            return f"reset at {episodes}; {reset.max_resets - len(self._resets)} left"
        first = 2 * reset.window
        if len(self._rows) < first:
            return f"windows fill until episode {first}"
        return "watching for a plateau"

    def end(self) -> None:
        """Close the display, leaving its last state."""
        self._live.stop()
