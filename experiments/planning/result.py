"""``plan.json``: what a plan says, as a typed document."""

from pydantic import Field, JsonValue

from orchid_uav.storage.documents import Document

SCHEMA = 1


class PlannedSite(Document):
    """Where the plan lies."""

    center: dict[str, float] | None
    """``lat`` and ``lon`` in degrees; None for a site in local metres."""
    box: list[float]
    """Least and greatest of all written positions: west, south, east, north, in degrees (or m)."""


class PlannedDrone(Document):
    """A drone and its station."""

    id: str
    lat: float | None
    lon: float | None
    east_m: float
    north_m: float
    altitude_m: float
    """Above home."""
    transmit_power_w: float
    circle_radius_m: float
    """0 for one that hovers."""
    speed_mps: float
    people: int
    """Whom it serves, weights counted."""
    endurance_minutes: float
    """On station, with the battery given, transit and reserve taken off."""
    backhaul_snr_db: float | None
    """To the best mast, at the worst point of the circle; None without a mast."""


class PeopleServed(Document):
    """How people are served; all are counted by their weights."""

    total: int
    served_by_drones: int
    served_by_masts: int
    unserved: int
    worst_rate_bps: float
    """0 if somebody is not served."""
    median_rate_bps: float
    share_above_want: float | None
    """Share of all people with the rate of ``--want``; None without it."""

    @property
    def share_served(self) -> float:
        """Share of all people who are served at all."""
        return 1.0 - self.unserved / self.total


class Rotation(Document):
    """What keeps every station manned for a day."""

    batteries_for_24_h: int
    drones_for_24_h: int
    """In the air, on the way, or being made ready."""


class DrawnFigures(Document):
    """Mean and worst of the draws of a robustness check."""

    draws: int
    share_served: float
    share_served_worst: float
    worst_rate_bps: float
    worst_rate_bps_worst: float
    median_rate_bps: float
    median_rate_bps_worst: float
    share_above_want: float | None
    share_above_want_worst: float | None


class DroneLost(Document):
    """What is left when one drone is lost (decision P6)."""

    drone: str
    people_before: int
    """Whom it served."""
    taken_over: dict[str, int]
    """Of those, who is served at once by which other drone or mast."""
    left: PeopleServed
    """At once, the others staying where they are."""
    regained: PeopleServed
    """After the others have moved by best response."""
    regained_after_s: float


class OneDroneLost(Document):
    """What is left of the plan without one of its drones."""

    share_served: float
    """At once, mean over the drone that is lost."""
    share_served_worst: float
    share_served_regained: float
    """After the others have moved, mean over the drone that is lost."""
    share_served_regained_worst: float
    each: list[DroneLost]


class Robustness(Document):
    """The same plan where things are otherwise than planned."""

    position_error_50m: DrawnFigures
    position_error_150m: DrawnFigures
    shadowing: DrawnFigures
    walking_10_minutes: DrawnFigures
    one_drone_lost: OneDroneLost | None
    """None where there is but one drone."""


class FleetSize(Document):
    """The figures of a plan with another number of drones."""

    drones: int
    utility: float
    people: PeopleServed


class PlanDocument(Document):
    """The content of ``plan.json``."""

    schema_version: int = Field(alias="schema")
    command: list[str]
    settings: dict[str, JsonValue]
    site: PlannedSite
    drones: list[PlannedDrone]
    people: PeopleServed
    utility: float
    evaluations: int
    rotation: Rotation
    robustness: Robustness
    fleet_sizes: list[FleetSize]
    launches: list[dict[str, JsonValue]]
    """In which order and when drones take off, and the altitude of their way."""
    notes: list[str]
    """Decisions that the planner should know of, in plain words."""
