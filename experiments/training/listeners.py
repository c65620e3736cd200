"""What is told of a run while it goes on: base classes whose hooks do nothing."""

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

# A process that only starts jobs needs none of them.
if TYPE_CHECKING:
    from orchid_uav.experiments.configuration import RunConfig
    from orchid_uav.experiments.runs.directory import Row, RunDirectory


class Reporter:
    """Shows a run to people; this one says nothing but warnings."""

    def begin(
        self,
        run: "RunDirectory",
        config: "RunConfig",
        rows: "Sequence[Row]",
        reset_episodes: Sequence[int],
    ) -> None:
        """The learning loop is about to begin, or to go on behind the rows of before."""

    def show(self, rows: "Sequence[Row]", reset_episodes: Sequence[int]) -> None:
        """New episodes have been learned from."""

    def warn(self, message: str) -> None:
        """The user should know this, and the run survives it; it is printed on stderr."""
        print(f"warning: {message}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """The learning loop has ended."""


class Tracker:
    """Exports a run's metrics to another program; this one exports nothing."""

    def resume(self, episodes: int) -> None:
        """The run goes on behind so many episodes, which another process logged."""

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """An episode has been learned from."""

    def close(self, status: str) -> None:
        """The run has ended."""
