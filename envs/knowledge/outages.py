"""Slots in which UAVs are not in service (M42)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from orchid_uav.envs.keys import Form

Failure = Annotated[str, Field(pattern=r"^\d{1,4}@\d{1,7}(-\d{1,7})?$"), Form("UAV@slot[-slot]")]
"""Slots in which a UAV is not in service."""
NEVER = 2**62
"""A slot that no episode reaches."""


class Outage(NamedTuple):
    """Slots in which a UAV is not in service."""

    uav: int
    """Index of the UAV."""
    first_slot: int
    """The first of them."""
    end_slot: int
    """The slot in which it joins again."""

    @classmethod
    def read(cls, text: str) -> Outage:
        """Read one of `network.failures`."""
        uav, _, slots = text.partition("@")
        first, _, end = slots.partition("-")
        return cls(int(uav), int(first), int(end) if end else NEVER)
