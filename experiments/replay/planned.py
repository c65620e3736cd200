"""Replays of plans: drones circle their stations over the people of the plan.

Who serves whom, rates and metrics are the plan's own: means over the circles, which do not change
from slot to slot. Where on its circle a drone begins, a plan does not say; here it is the east.
"""

import csv
import io
import math
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.markup import harmless
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.planning.files import PEOPLE_MAP, PEOPLE_TABLE, PLAN_FILE
from orchid_uav.experiments.planning.maps.drawing import mast_name
from orchid_uav.experiments.planning.maps.people_csv import COLUMNS
from orchid_uav.experiments.planning.maps.wording import number_text, people_text
from orchid_uav.experiments.planning.model import Floats
from orchid_uav.experiments.planning.result import SCHEMA as PLAN_SCHEMA
from orchid_uav.experiments.planning.result import PlanDocument
from orchid_uav.experiments.planning.site import Place, Site
from orchid_uav.experiments.replay.document import (
    DRONE_SCALE_M,
    POWER_SCALE_W,
    RATE_RATIO,
    SCHEMA,
    UNSERVED,
    USER_SCALE_M,
    ReplayDocument,
    ReplayDrones,
    ReplayFlight,
    ReplayMast,
    ReplayPlace,
    ReplayStations,
    ReplayUsers,
)
from orchid_uav.experiments.replay.flown import described
from orchid_uav.experiments.replay.packing import pack, pack_magnitudes, pack_states
from orchid_uav.experiments.replay.recording import check_size
from orchid_uav.notices import in_one_line, reason_of
from orchid_uav.storage.documents import Document
from orchid_uav.storage.files import read_bytes, read_document

SLOTS = 120
"""Of 1 s: some five turns of a usual circle."""
SHOWN = ("total_coverage", "worst_rate_bps", "utility")
LARGEST_PEOPLE_FILE = 64 * 2**20
"""Bytes."""


class PlanPerson(NamedTuple):
    """A position of people in a plan."""

    position_m: tuple[float, float]
    """In the metres of the plan's site."""
    weight: int
    server: str | None
    rate_bps: float


class _Point(Document):
    type: Literal["Point"]
    coordinates: list[float]


class _Served(Document):
    people: int
    served_by: str | None
    rate_bps: float


class _Feature(Document):
    geometry: _Point
    properties: _Served


class _People(Document):
    features: list[_Feature]


def plan_directory(name: str) -> Path | None:
    """The directory of a plan, if a name given as a run is that of a plan or its ``plan.json``."""
    try:
        path = Path(name).expanduser()
        if path.name == PLAN_FILE and path.is_file():
            return path.parent
        return path if (path / PLAN_FILE).is_file() else None
    except (OSError, ValueError, RuntimeError):  # too long, no text, nobody's home
        return None


def replay_of_plan(directory: Path) -> ReplayDocument:
    """The replay of what ``orchid plan`` wrote into a directory.

    Raises:
        InputError: a file is missing, damaged, or not of the same plan as the others.
    """
    path = directory / PLAN_FILE
    try:
        content = read_document(path)
        if content.get("schema") != PLAN_SCHEMA:
            raise ValueError(f"schema is {content.get('schema')!r:.20}, not {PLAN_SCHEMA}")
        plan = PlanDocument.from_json(content)
        site = _site(plan)
        people = _people(directory, plan, site)
        return _document(plan, site, people)
    except OSError as error:
        raise InputError(f"cannot read {error.filename or path}: {reason_of(error)}") from error
    except (ValueError, TypeError, LookupError) as error:
        raise InputError(f"cannot replay the plan {path}: {in_one_line(error)}") from error


def _site(plan: PlanDocument) -> Site:
    center = plan.site.center
    if center is None:
        return Site()
    return Site(Place(float(center["lat"]), float(center["lon"])))


def _people(directory: Path, plan: PlanDocument, site: Site) -> list[PlanPerson]:
    path = directory / (PEOPLE_TABLE if site.center is None else PEOPLE_MAP)
    try:
        if site.center is None:
            people = _of_table(read_bytes(path, LARGEST_PEOPLE_FILE).decode())
        else:
            people = _of_map(_People.from_json(read_document(path, LARGEST_PEOPLE_FILE)), site)
    except ValueError as error:
        raise ValueError(f"{path}: {in_one_line(error)}") from error
    total = sum(person.weight for person in people)
    if total != plan.people.total:
        raise ValueError(f"{path} has {total} people, and the plan {plan.people.total}")
    return people


def _of_map(people: _People, site: Site) -> list[PlanPerson]:
    found = []
    for feature in people.features:
        longitude_deg, latitude_deg = feature.geometry.coordinates[:2]
        (place_m,) = site.to_local_m([(latitude_deg, longitude_deg)]).tolist()
        one = feature.properties
        found.append(PlanPerson((place_m[0], place_m[1]), one.people, one.served_by, one.rate_bps))
    return found


def _of_table(text: str) -> list[PlanPerson]:
    rows = csv.DictReader(io.StringIO(text))
    missing = [column for column in COLUMNS if column not in (rows.fieldnames or ())]
    if missing:
        raise ValueError(f"it has no column {missing[0]}")
    try:
        return [
            PlanPerson(
                (float(row["x_m"]), float(row["y_m"])),
                int(row["people"]),
                row["served_by"] or None,
                float(row["rate_bps"]),
            )
            for row in rows
        ]
    except (TypeError, csv.Error) as error:
        raise ValueError(f"a row is not complete: {error}") from error


def _box_m(plan: PlanDocument, site: Site, people_m: Floats) -> tuple[Floats, Floats]:
    """South-west corner and sides of what is shown: the plan's site and everybody, in m."""
    west, south, east, north = plan.site.box
    corners: Floats = np.array([(west, south), (west, north), (east, south), (east, north)])
    if site.center is not None:
        corners = site.to_local_m(corners[:, ::-1])
    points_m = np.concatenate([corners, people_m])
    low_m = points_m.min(axis=0)
    return low_m, np.maximum(points_m.max(axis=0) - low_m, 1.0)


def _document(plan: PlanDocument, site: Site, people: list[PlanPerson]) -> ReplayDocument:
    drones = plan.drones
    if not drones or not people:
        raise ValueError("a plan without drones or people has nothing to show")
    slots = SLOTS if any(drone.circle_radius_m > 0.0 for drone in drones) else 1
    check_size(slots, len(drones), 0)
    people_m = np.array([person.position_m for person in people])
    low_m, sides_m = _box_m(plan, site, people_m)
    masts = _masts(plan, site, low_m)
    servers = [drone.id for drone in drones], [mast.name for mast in masts]
    codes = {name: index for index, name in enumerate(servers[0])}
    codes |= {name: UNSERVED - 1 - index for index, name in enumerate(servers[1])}
    association = [_code(person.server, codes) for person in people]
    served = plan.people
    unserved = f"{served.unserved:,} not at all" if served.unserved else "nobody left out"
    weights = [person.weight for person in people]
    middle_m = low_m + sides_m / 2.0
    return ReplayDocument(
        schema=SCHEMA,
        title=f"Plan of {number_text(len(drones), 'drone', 'drones')} "
        f"for {people_text(served.total)}",
        subtitle=f"{served.served_by_drones:,} served by drones, {served.served_by_masts:,} by "
        f"masts, {unserved}",
        slot_s=1.0,
        slots=slots,
        area_m=sides_m.tolist(),
        altitudes_m=[
            min(drone.altitude_m for drone in drones),
            max(drone.altitude_m for drone in drones),
        ],
        users=ReplayUsers(
            count=len(people),
            names=None,
            weights=weights if max(weights) > 1 else None,
            targets=pack(np.ones(len(people)), "uint8"),
            positions=pack_states((people_m - low_m)[None], USER_SCALE_M),
        ),
        masts=masts,
        metrics=[described(name) for name in SHOWN],
        flights=[_flight(plan, low_m, slots, association, people)],
        place=_place(site, middle_m),
    )


def _place(site: Site, middle_m: Floats) -> ReplayPlace | None:
    if site.center is None:
        return None
    ((latitude_deg, longitude_deg),) = site.to_places([middle_m]).tolist()
    return ReplayPlace(lat=latitude_deg, lon=longitude_deg)


def _masts(plan: PlanDocument, site: Site, low_m: Floats) -> list[ReplayMast]:
    places = np.array(plan.settings.get("masts") or [], np.float64).reshape(-1, 2)
    heights = plan.settings.get("mast_heights_m")
    usual_m = plan.settings.get("gbs.height_m", 30.0)
    heights_m = np.array([usual_m] * len(places) if heights is None else heights, np.float64)
    places_m = (places if site.center is None else site.to_local_m(places)) - low_m
    return [
        ReplayMast(name=mast_name(index), position_m=[*place_m, height_m])
        for index, (place_m, height_m) in enumerate(
            zip(places_m.tolist(), heights_m.tolist(), strict=True)
        )
    ]


def _code(server: str | None, codes: dict[str, int]) -> int:
    if server is None:
        return UNSERVED
    if server not in codes:
        raise ValueError(f"people are served by {server!r:.40}, whom the plan does not have")
    return codes[server]


def _flight(
    plan: PlanDocument,
    low_m: Floats,
    slots: int,
    association: list[int],
    people: list[PlanPerson],
) -> ReplayFlight:
    drones = plan.drones
    centres_m = np.array([(drone.east_m, drone.north_m) for drone in drones]) - low_m
    radii_m = np.array([drone.circle_radius_m for drone in drones])
    speeds_mps = np.array([drone.speed_mps for drone in drones])
    # A drone that hovers has no circle to turn on.
    turns = speeds_mps / np.where(radii_m > 0.0, radii_m, math.inf)
    angles = np.arange(slots + 1)[:, None] * turns
    offsets_m = radii_m[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    altitudes_m = np.array([drone.altitude_m for drone in drones])
    positions_m = np.concatenate(
        [centres_m + offsets_m, np.broadcast_to(altitudes_m[:, None], (*angles.shape, 1))], axis=2
    )
    values = {
        "total_coverage": plan.people.share_served,
        "worst_rate_bps": plan.people.worst_rate_bps,
        "utility": plan.utility,
    }
    return ReplayFlight(
        key="plan",
        label="plan",
        note="Rates, who serves whom and metrics are those of plan.json, means over the circles.",
        drones=ReplayDrones(
            count=len(drones),
            names=[harmless(drone.id) for drone in drones],
            positions=pack_states(positions_m, DRONE_SCALE_M),
            powers_w=pack_states([[drone.transmit_power_w for drone in drones]], POWER_SCALE_W),
            stations=ReplayStations(
                centres=pack_states(centres_m[None], DRONE_SCALE_M), radius_m=float(radii_m.max())
            ),
        ),
        association=pack_states([association], 1.0),
        rates=pack_magnitudes([[person.rate_bps for person in people]], RATE_RATIO),
        metrics={
            name: pack(np.full(slots, value * METRICS[name].scale), "float32")
            for name, value in values.items()
        },
    )
