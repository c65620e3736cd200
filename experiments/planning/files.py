"""A plan from files to files: what ``orchid plan`` does, without its display."""

import math
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from orchid_uav.experiments.configuration import Layer
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.planning.flown import find_method
from orchid_uav.experiments.planning.maps.geojson import people_geojson, stations_geojson
from orchid_uav.experiments.planning.maps.kml import plan_kml
from orchid_uav.experiments.planning.maps.people_csv import people_csv
from orchid_uav.experiments.planning.maps.report import report_html
from orchid_uav.experiments.planning.mission_files import mission_files
from orchid_uav.experiments.planning.missions.fence import fence_geojson
from orchid_uav.experiments.planning.model import Budget, Mast, People, Surroundings
from orchid_uav.experiments.planning.planner import (
    BALANCED,
    PLANNER,
    Firmware,
    Planned,
    PlanningListener,
    Task,
    make_plan,
)
from orchid_uav.experiments.planning.reading.people import read_people
from orchid_uav.experiments.planning.reading.places import parse_home, parse_mast
from orchid_uav.experiments.planning.reading.site import (
    default_area,
    locate,
    mast_of,
    notes_on_area,
    notes_on_zones,
    people_of,
    place_m,
    zones_m,
)
from orchid_uav.experiments.planning.reading.table import PeopleTable
from orchid_uav.experiments.planning.reading.zones import read_zones
from orchid_uav.experiments.planning.settings import PlanConfig, plan_configuration
from orchid_uav.experiments.planning.site import Site
from orchid_uav.experiments.runs.records import DEFAULT_RUNS_DIR
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import json_bytes, remove_leftovers

DEFAULT_PARENT = Path("orchid-plan")
PLAN_FILE, REPORT_FILE = "plan.json", "report.html"
PEOPLE_MAP, PEOPLE_TABLE = "people.geojson", "people.csv"
"""Who is served by whom; the table is for plans in local metres."""
_INHABITED_DEG = (-56.0, 79.0)
"""Latitudes of the southernmost and the northernmost town."""
_BESIDE_ZONES_M = 50.0
"""A home that nobody gave keeps this far from no-fly zones."""
_LEAST_FROM_MASTS_M = 20.0
"""Of a home that is given."""
_BESIDE_MASTS_M = 60.0
"""And this far from masts: drones climb straight up over home."""


@dataclass(frozen=True)
class Given:
    """People and places as they were given."""

    people: Path | PeopleTable
    masts: Sequence[str] = ()
    home: str | None = None
    area: Path | None = None
    no_fly: Path | None = None


def plan_from_files(
    given: Given,
    layers: Iterable[Layer],
    budget: Budget,
    method: str,
    runs_dir: Path,
    command: list[str],
    out: Path | None,
    firmware: Firmware,
    listener: PlanningListener,
) -> tuple[Planned, Path]:
    """Read, plan, and write everything or nothing; returns the plan and its directory.

    Args:
        given: people and places.
        layers: of the configuration, later ones win.
        budget: of the search.
        method: ``planner``, ``balanced``, or a method of ``orchid eval`` or a run.
        runs_dir: where a run is looked up.
        command: what is recorded as the command.
        out: a new or empty directory; by default ``./orchid-plan/<UTC time>``.
        firmware: for which missions are written.
        listener: is told how far it is.

    Raises:
        InputError: something given is wrong, or cannot be had.
        RunFailedError: the files cannot be written.
    """
    try:
        check_free(out)
        config, _ = plan_configuration(layers)
        planned = make_plan(
            task_of(given, config, budget, method, runs_dir, firmware), command, listener
        )
        listener.begins("files")
        return planned, write_plan(planned, out, firmware)
    finally:
        listener.ends()


def task_of(
    given: Given,
    config: PlanConfig,
    budget: Budget,
    method: str = PLANNER,
    runs_dir: Path = DEFAULT_RUNS_DIR,
    firmware: Firmware = "both",
) -> Task:
    """Bring people and places into the metres of one site.

    Raises:
        InputError: a file or place is wrong, or does not fit the others.
    """
    flies = find_method(method, runs_dir, (PLANNER, BALANCED))
    table = given.people if isinstance(given.people, PeopleTable) else read_people(given.people)
    zones = {
        name: read_zones(path)
        for name, path in (("area", given.area), ("no_fly", given.no_fly))
        if path is not None
    }
    masts = [parse_mast(text) for text in given.masts]
    home = None if given.home is None else parse_home(given.home)
    site = locate(table, list(zones.values()), [*masts, *([home] if home else [])])
    people = people_of(table, site)
    notes = list(table.notes)
    if not table.on_earth:
        notes.append(
            "People are given in metres, so the plan has no place on earth: it gets a "
            "report and a table of people, and neither maps nor missions."
        )
    elif site.center is not None and not (
        _INHABITED_DEG[0] <= site.center.latitude_deg <= _INHABITED_DEG[1]
    ):
        notes.append(
            f"The people are at latitude {site.center.latitude_deg:.1f}°, where hardly anybody "
            "lives: are latitude and longitude swapped?"
        )
    for one in zones.values():
        notes += notes_on_zones(one, site)
    area = default_area(people, config.plan.area_margin_m)
    if "area" in zones:
        area = zones_m(zones["area"], site)
        notes += notes_on_area(table, zones["area"], site)
    no_fly = zones_m(zones["no_fly"], site) if "no_fly" in zones else Polygon()
    standing = tuple(mast_of(mast, site, config.gbs.height_m) for mast in masts)
    if home is None:
        home_m, height_m = _home_m(people, standing, no_fly), 0.0
        where = f"{_BESIDE_MASTS_M:g} m beside the first mast" if standing else "amid the people"
        notes.append(
            f"No --home is given: drones start and land {where}, at {_told(home_m, site)}."
        )
    else:
        home_m, height_m = place_m(home, site), home.height_m or 0.0
        near_m = min((math.dist(home_m, mast[:2]) for mast in standing), default=math.inf)
        if near_m < _LEAST_FROM_MASTS_M:
            raise InputError(
                f"{home.given} is {near_m:.0f} m from a mast, and drones climb straight up over "
                f"home: name a place at least {_LEAST_FROM_MASTS_M:g} m from every mast"
            )
    surroundings = Surroundings(
        site=site,
        area=area,
        no_fly=no_fly,
        masts=standing,
        home_m=home_m,
        home_height_amsl_m=height_m,
        lowest_m=config.uav.min_altitude_m,
        highest_m=config.uav.max_altitude_m,
        clearance_m=config.plan.clearance_m,
    )
    return Task(people, surroundings, config, budget, method, flies, firmware, tuple(notes))


def _told(point_m: tuple[float, float], site: Site) -> str:
    """A place in words."""
    if site.center is None:
        return f"{point_m[0]:.1f} m E, {point_m[1]:.1f} m N"
    latitude_deg, longitude_deg = site.to_places([point_m])[0]
    return f"{latitude_deg:.6f}, {longitude_deg:.6f}"


def _home_m(people: People, masts: Sequence[Mast], no_fly: BaseGeometry) -> tuple[float, float]:
    """Where drones start if nobody says: beside a mast or amid people, not in a no-fly zone."""
    middle_m = people.positions_m.mean(axis=0)
    home = Point(middle_m)
    if masts:
        towards = middle_m - np.array(masts[0][:2])
        length_m = float(np.linalg.norm(towards))
        towards = towards / length_m if length_m > 0.0 else np.array([0.0, -1.0])
        home = Point(np.array(masts[0][:2]) + _BESIDE_MASTS_M * towards)
    around = [Point(mast.east_m, mast.north_m).buffer(_BESIDE_MASTS_M - 1.0) for mast in masts]
    forbidden = shapely.union_all([no_fly.buffer(_BESIDE_ZONES_M), *around])
    if forbidden.intersects(home):
        home = Point(shapely.shortest_line(forbidden.boundary, home).coords[0])
    return home.x, home.y


def check_free(directory: Path | None) -> None:
    """Check that a directory for the files is new or empty, and could be made.

    Raises:
        InputError: it is not, or could not.
    """
    if directory is None:
        return
    if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
        raise InputError(f"--out {directory} is there already: name a new or an empty directory")
    parent = next(one for one in directory.absolute().parents if one.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise InputError(
            f"cannot write to --out {directory}: {parent} is not a directory to write in"
        )


def write_plan(planned: Planned, directory: Path | None, firmware: Firmware) -> Path:
    """Write all files of a plan, or none; returns the directory.

    A plan in local metres has no place on earth, and so gets a table in place of maps and missions.

    Args:
        planned: the plan.
        directory: a new or empty one; by default ``./orchid-plan/<UTC time>``.
        firmware: for which missions are written.

    Raises:
        RunFailedError: they cannot be written; nothing is left behind.
    """
    made = directory or DEFAULT_PARENT / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    try:
        made.parent.mkdir(parents=True, exist_ok=True)
        # Told apart from all that a user may keep beside it, as it is removed if it is left.
        unfinished = f"{made.name}.being-written"
        if directory is not None:  # else others may write theirs at this moment
            remove_leftovers(made.parent, [unfinished])
        beside = Path(tempfile.mkdtemp(prefix=f".{unfinished}-", dir=made.parent))
        try:
            for name, content in files_of(planned, firmware):
                path = beside / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            beside.chmod(0o755)
            for suffix in ("", *(f"-{number}" for number in range(2, 100))):
                target = made.with_name(made.name + suffix) if directory is None else made
                try:
                    beside.rename(target)
                except OSError:
                    if directory is not None or not target.exists():
                        raise
                    continue
                return target
        except BaseException:
            shutil.rmtree(beside, ignore_errors=True)
            raise
    except OSError as error:
        raise RunFailedError(f"cannot write the plan to {made}: {reason_of(error)}") from error
    raise RunFailedError(f"cannot find a free name for {made}")


def files_of(planned: Planned, firmware: Firmware) -> Iterator[tuple[str, bytes]]:
    """Names and contents of all files of a plan."""
    plan = planned.mapped
    yield PLAN_FILE, json_bytes(plan.document.to_json())
    yield REPORT_FILE, report_html(plan).encode()
    if planned.fence is None:
        yield PEOPLE_TABLE, people_csv(plan)
        return
    yield "stations.geojson", json_bytes(stations_geojson(plan))
    yield PEOPLE_MAP, json_bytes(people_geojson(plan))
    yield "plan.kml", plan_kml(plan)
    yield "fence.geojson", json_bytes(fence_geojson(plan.surroundings))
    yield from mission_files(
        plan.surroundings,
        plan.stations,
        planned.transit,
        planned.fence,
        planned.stay_s,
        firmware,
    )
