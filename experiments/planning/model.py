"""What a plan is about: people, masts, and drones that circle."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from orchid_uav.experiments.planning.site import Site

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class People:
    """Where people are."""

    positions_m: Floats
    """East and north in the site's metres, (P, 2)."""
    weights: NDArray[np.int64]
    """People that each position stands for, (P,), at least 1."""

    @property
    def total(self) -> int:
        """How many people that are."""
        return int(self.weights.sum())


class Want(NamedTuple):
    """The rate that a share of people is to have."""

    rate_bps: float
    share: float
    """Above 0, at most 1."""


class Budget(NamedTuple):
    """When a search ends: after a time, or after a number of plans that are judged."""

    seconds: float | None = None
    evaluations: int | None = None
    """Those of the clusterings counted."""


class Mast(NamedTuple):
    """A base station on the ground that still works."""

    east_m: float
    north_m: float
    height_m: float


class Station(NamedTuple):
    """Where a drone stays: it circles a centre, or hovers there."""

    name: str
    """``uav_0``, ``uav_1``, …"""
    east_m: float
    north_m: float
    altitude_m: float
    """Above home."""
    transmit_power_w: float
    circle_radius_m: float
    """0 for one that hovers."""
    speed_mps: float


@dataclass(frozen=True)
class Surroundings:
    """The site and what limits drones in it, all in the site's metres."""

    site: Site
    area: BaseGeometry
    """Where drones and their circles may be: a polygon."""
    no_fly: BaseGeometry
    """Where neither drones nor their circles may be: polygons, or an empty geometry."""
    masts: tuple[Mast, ...]
    home_m: tuple[float, float]
    """From where drones start and where they land."""
    home_height_amsl_m: float
    """Height of home above mean sea level, which some mission files ask for; 0 if not known."""
    lowest_m: float
    """Lowest altitude of a station, above home."""
    highest_m: float
    """Highest altitude of a station, above home."""
    clearance_m: float
    """Between the circles of two drones."""
