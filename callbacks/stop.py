"""Stopping between two updates."""

from collections.abc import Callable

from stable_baselines3.common.callbacks import BaseCallback


class StopOnRequest(BaseCallback):
    """Ends training at the next step once ``is_requested()`` is true.

    A step that ends episodes is let through: the update on them follows, and no episode is counted
    that was not learned from.
    """

    def __init__(self, is_requested: Callable[[], bool]) -> None:
        super().__init__()
        self._is_requested = is_requested

    def _on_step(self) -> bool:
        return bool(self.locals["dones"].any()) or not self._is_requested()
