"""The document inside a replay: everything that its page and its pictures show.

Distances are in metres, east and north from the south-west corner of ``area_m``, and up. Slots are
counted from 0, the state before the first action, to ``slots``; metrics belong to the slots from 1
on. Arrays are :class:`orchid_uav.experiments.replay.packing.Packed`, which says how to unpack them
and, in its functions, how exact they are. How finely each is written stands in this file.
"""

from pydantic import Field

from orchid_uav.experiments.replay.packing import Packed
from orchid_uav.storage.documents import Document

SCHEMA = 1
USER_SCALE_M = 0.5
"""Users are shown within half of this."""
DRONE_SCALE_M = 0.1
POWER_SCALE_W = 1e-4
RATE_RATIO = 1.005
"""Rates are shown within 0.25 %."""
UNSERVED = -1
"""In ``association``: nobody serves the user. Drones are 0, 1, …, and mast k is -2 - k."""


class ReplayUsers(Document):
    """The people on the ground, the same for all flights."""

    count: int
    names: list[str] | None
    """Of each, or None."""
    weights: list[int] | None
    """How many people each stands for; None where each is one."""
    targets: Packed
    """1 for those whom the drones are there for, 0 for those left to the masts; uint8, (M,)."""
    positions: Packed
    """East and north, (T + 1, M, 2), or (1, M, 2) where nobody moves."""


class ReplayMast(Document):
    """A base station on the ground."""

    name: str
    position_m: list[float]
    """East, north, and height of the antenna."""


class ReplayMetric(Document):
    """A metric of every slot; values are in ``unit`` already."""

    key: str
    """A name of ``experiments/metrics.py``."""
    label: str
    unit: str
    """Empty for plain numbers."""
    better: str | None
    """``higher``, ``lower``, or None."""
    digits: int
    """Shown after the decimal point."""


class ReplayStations(Document):
    """The places that drones circle."""

    centres: Packed
    """East and north, (T + 1, N, 2), or (1, N, 2) where they stay."""
    radius_m: float


class ReplayDrones(Document):
    """The drones of a flight."""

    count: int
    names: list[str]
    positions: Packed
    """East, north, up, (T + 1, N, 3)."""
    powers_w: Packed
    """Transmit powers, (T + 1, N), or (1, N) where they stay; 0 for a drone out of service."""
    stations: ReplayStations | None
    """None where drones fly as they like."""


class ReplayFlight(Document):
    """How one method flew."""

    key: str
    label: str
    note: str
    """What the method is, in a sentence; may be empty."""
    drones: ReplayDrones
    association: Packed
    """Who serves each user, (T + 1, M), or (1, M) where that stays: see ``UNSERVED``."""
    rates: Packed
    """Rates in bit/s, (T + 1, M), or (1, M) where they stay; 0 for those who are not served."""
    metrics: dict[str, Packed]
    """By key: float32, (T,), the value of slot t + 1 at t. NaN where there is none."""


class ReplayPlace(Document):
    """Where on earth the middle of the area is."""

    lat: float
    lon: float


class ReplayDocument(Document):
    """A replay."""

    schema_version: int = Field(alias="schema")
    title: str
    subtitle: str
    slot_s: float
    slots: int
    """T: there are T + 1 states."""
    area_m: list[float]
    """Sides, east and north."""
    altitudes_m: list[float]
    """Lowest and highest."""
    users: ReplayUsers
    masts: list[ReplayMast]
    metrics: list[ReplayMetric]
    """The most telling ones come first."""
    flights: list[ReplayFlight]
    """One, or two side by side."""
    place: ReplayPlace | None
    """None for a simulated area."""
