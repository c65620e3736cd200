"""Base classes of what follows a run while it trains; their hooks do nothing."""

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

# A process that only starts jobs must not import these.
if TYPE_CHECKING:
    from orchid_uav.experiments.configuration import RunConfig
    from orchid_uav.experiments.runs.directory import Row, RunDirectory


class Reporter:
    """Shows a run to people; this base class only prints warnings."""

    def begin(
        self,
        run: "RunDirectory",
        config: "RunConfig",
        rows: "Sequence[Row]",
        reset_episodes: Sequence[int],
    ) -> None:
        """The learning loop is about to begin, or to go on after the given earlier rows."""

    def show(self, rows: "Sequence[Row]", reset_episodes: Sequence[int]) -> None:
        """The learner has been updated on new episodes."""

    def warn(self, message: str) -> None:
        """Print on stderr something that the user should know and that does not end the run."""
        print(f"warning: {message}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """The learning loop has ended."""


class Tracker:
    """Exports a run to another program; this base class exports nothing.

    What it is not told stands in the run directory, where the record is complete before
    :meth:`close`.
    """

    def resume(self, episodes: int) -> None:
        """The run goes on after this many episodes, which another process logged."""

    def log(self, episode: int, metrics: Mapping[str, float]) -> None:
        """The learner has been updated on an episode."""

    def close(self, status: str) -> None:
        """The run has ended."""
