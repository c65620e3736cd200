"""From people and places to a plan with everything that it tells."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from pydantic import JsonValue

from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.configuration import flatten
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.methods import Contender
from orchid_uav.experiments.planning.clusterings import best_clustering
from orchid_uav.experiments.planning.flown import flown_plan
from orchid_uav.experiments.planning.judging.endurance import (
    Battery,
    Way,
    endurance_s,
    rotation_of,
)
from orchid_uav.experiments.planning.judging.robustness import check_robustness
from orchid_uav.experiments.planning.judging.served import count_served
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.missions import ardupilot, px4
from orchid_uav.experiments.planning.missions.fence import Fence, fence_of
from orchid_uav.experiments.planning.missions.transit import Transit, plan_transit
from orchid_uav.experiments.planning.model import (
    Budget,
    Floats,
    Mast,
    People,
    Station,
    Surroundings,
)
from orchid_uav.experiments.planning.network import Fleet, Service, station_speed_mps
from orchid_uav.experiments.planning.region import backhaul_snr_db, region_of
from orchid_uav.experiments.planning.result import (
    SCHEMA,
    FleetSize,
    PeopleServed,
    PlanDocument,
    PlannedDrone,
    PlannedSite,
)
from orchid_uav.experiments.planning.search import Found, search
from orchid_uav.experiments.planning.settings import PlanConfig

MOST_DRONES = 1000
FLEET_SIZES = (-2, -1, 1, 2)
"""Other numbers of drones for which figures stand beside the plan's, as differences."""
_SHARE_OF_TIME = 0.5
"""Of a budget in seconds, for the plan itself; the other fleet sizes have the rest."""
_OTHER_SHARE = 4
"""The search for another fleet size judges this many times fewer plans."""
_BESIDE_OTHERS = 4000
"""The same share is of this number beside a plan that was not searched."""
_PROBE_EVALUATIONS = 3000
"""Plans judged for each number of drones that ``auto`` tries."""
PLANNER, BALANCED = "planner", "balanced"
_TIMING = (
    "Start each drone at its time, and clear the place for the next: ways keep drones apart by "
    "altitude and by time, and missions count circles for an air without wind."
)
Firmware = Literal["px4", "ardupilot", "both"]
"""For which autopilots a plan is."""


@dataclass(frozen=True)
class Task:
    """What is to be planned, in the metres of a site."""

    people: People
    surroundings: Surroundings
    config: PlanConfig
    budget: Budget
    method: str = PLANNER
    """PLANNER, BALANCED, or what ``flies`` is called."""
    flies: Contender | None = None
    """A method that flies to its stations."""
    firmware: Firmware = "both"
    notes: tuple[str, ...] = ()
    """Decisions taken in reading, in plain words."""


class PlanningListener:
    """Is told how far planning is; does nothing by default."""

    def begins(self, stage: str) -> None:
        """A stage begins."""

    def searches(self, share: float, utility: float) -> None:
        """The share of the search's budget that is used, and the best utility so far."""

    def ends(self) -> None:
        """All is done, or nothing more will be."""


@dataclass(frozen=True)
class Planned:
    """A plan with all that its files are made of."""

    mapped: MappedPlan
    transit: Transit
    fence: Fence | None
    """None for a site without a place on earth."""
    stay_s: tuple[float, ...]
    """Time on station of each drone."""


def make_plan(task: Task, command: list[str], listener: PlanningListener) -> Planned:
    """Search, judge, and find the ways.

    Raises:
        InputError: what is asked for cannot be had; the message says what could.
    """
    config = task.config
    parameters, settings = config.network_parameters, config.plan
    maker = _Maker(task, listener)
    notes = list(task.notes)
    drones = settings.drones
    if drones is None:
        listener.begins("how many drones")
        drones, told = maker.least_number()
        notes.append(told)
    if drones > task.people.total:
        notes.append(
            f"There are more drones ({drones}) than people ({task.people.total}): some drones "
            "serve nobody."
        )
    fleet = maker.fleet_of(drones)
    listener.begins("stations")
    found = maker.find(fleet)
    stations = stations_of(fleet, found.plan)
    listener.begins("ways")
    cruise_mps = parameters.uav.max_speed_mps
    transit = plan_transit(task.surroundings, stations, cruise_mps)
    ways = [Way(way.level_s, way.vertical_s) for way in transit.ways]
    fence = None
    if task.surroundings.site.center is not None:
        fence = fence_of(task.surroundings, transit)
        notes += [_TIMING, *([fence.note] if fence.note else [])]
    battery = Battery(settings.battery_wh, settings.reserve)
    stay_s = tuple(
        endurance_s(parameters, station, battery, way, cruise_mps)
        for station, way in zip(stations, ways, strict=True)
    )
    service = fleet.service_of(found.plan)
    served = count_served(service, task.people, drones, settings.want)
    robustness = check_robustness(
        fleet,
        maker.region,
        found.plan,
        [station.name for station in stations],
        settings.seed,
        settings.want,
        listener.begins,
    )
    others, told_of_others = maker.other_sizes(drones, found.evaluations)
    size = FleetSize(drones=drones, utility=found.utility, people=served)
    document = PlanDocument(
        schema=SCHEMA,
        command=command,
        settings=_settings(task),
        site=_site(task.surroundings, stations),
        drones=_planned_drones(task, stations, service, stay_s),
        people=served,
        utility=found.utility,
        evaluations=found.evaluations,
        rotation=rotation_of(stay_s, ways, settings.swap_minutes * 60.0),
        robustness=robustness,
        fleet_sizes=sorted([*others, size], key=lambda one: one.drones),
        launches=[
            {"drone": way.name, "after_s": way.launch_s, "way_altitude_m": way.layer_m}
            for way in sorted(transit.ways, key=lambda way: way.launch_s)
        ],
        notes=[
            _sentence(note)
            for note in (*notes, *told_of_others, *_notes_on(task, stations, service, served))
        ],
    )
    mapped = MappedPlan(
        document=document,
        surroundings=task.surroundings,
        people=task.people,
        stations=tuple(stations),
        server=service.server,
        rates_bps=service.rates_bps,
        want=settings.want,
        ways_m=[way.outbound_m for way in transit.ways],
    )
    return Planned(mapped, transit, fence, stay_s)


class _Maker:
    """Searches for any number of drones over the same people."""

    def __init__(self, task: Task, listener: PlanningListener) -> None:
        self._task, self._listener = task, listener
        self._parameters = task.config.network_parameters
        settings = task.config.plan
        self._seed, self._want = settings.seed, settings.want
        self._radius_m = 0.0 if settings.hover else self._parameters.uav.station.circle_radius_m
        self._speed_mps = _speed_mps(self._parameters, self._radius_m, task.firmware)
        self.region = region_of(task.surroundings, self._radius_m, self._parameters)

    def fleet_of(self, drones: int) -> Fleet:
        """So many drones."""
        return Fleet(
            self._parameters,
            self._task.people,
            self._task.surroundings.masts,
            drones,
            self._radius_m,
            self._speed_mps,
        )

    def find(self, fleet: Fleet) -> Found:
        """The plan itself."""
        if self._task.flies is not None:
            plan = flown_plan(
                self._task.flies, fleet, self._task.surroundings, self.region, self._seed
            )
            return Found(plan, fleet.utility(plan), 1)
        if self._task.method == BALANCED:
            return Found(*best_clustering(fleet, self.region, self._seed))
        seconds, evaluations = self._task.budget
        budget = Budget(None if seconds is None else _SHARE_OF_TIME * seconds, evaluations)
        return search(fleet, self.region, budget, self._seed, self._listener.searches)

    def _tried(self, drones: int, evaluations: int) -> FleetSize:
        fleet = self.fleet_of(drones)
        found = search(fleet, self.region, Budget(evaluations=evaluations), self._seed)
        served = count_served(fleet.service_of(found.plan), self._task.people, drones, self._want)
        return FleetSize(drones=drones, utility=found.utility, people=served)

    def other_sizes(self, drones: int, evaluations: int) -> tuple[list[FleetSize], list[str]]:
        """Figures for some drones fewer and more, and notes on numbers that have no room."""
        if self._task.method != PLANNER:
            evaluations = _BESIDE_OTHERS
        sizes, notes = [], []
        for number in (drones + difference for difference in FLEET_SIZES):
            if not 1 <= number <= MOST_DRONES:
                continue
            self._listener.begins(f"with {number} drones")
            try:
                sizes.append(self._tried(number, max(evaluations // _OTHER_SHARE, 1)))
            except InputError as error:
                notes.append(f"There are no figures for {number} drones: {error}.")
        return sizes, notes

    def least_number(self) -> tuple[int, str]:
        """The least number of drones that meets what is wanted, and a sentence that says so.

        Doubles the number until it does, then halves the interval.

        Raises:
            InputError: nothing is wanted, or no number meets it.
        """
        want = self._want
        if want is None:
            raise InputError("--drones auto needs --want, as in --want 1Mbps:95%")

        def share_with(drones: int) -> float:
            self._listener.begins(f"are {drones} drones enough?")
            size = self._tried(drones, _PROBE_EVALUATIONS)
            return size.people.share_above_want or 0.0

        wanted = f"{want.rate_bps / 1e6:g} Mbit/s for {want.share:.0%} of the people"
        short, best, enough = 0, 0.0, 1
        while True:
            try:
                reached = share_with(enough)
            except InputError as error:
                raise InputError(
                    f"no number of drones that there is room for gives {wanted}: {short} drones "
                    f"reach {best:.1%} ({error})"
                ) from error
            if reached >= want.share:
                break
            short, best = enough, reached
            if enough == MOST_DRONES:
                raise InputError(
                    f"{MOST_DRONES} drones do not give {wanted}: they reach {best:.1%}"
                )
            enough = min(2 * enough, MOST_DRONES)
        while enough - short > 1:
            middle = (short + enough) // 2
            if share_with(middle) >= want.share:
                enough = middle
            else:
                short = middle
        return enough, f"{enough} drones are the least that were found to give {wanted}."


def _speed_mps(parameters: Parameters, radius_m: float, firmware: Firmware) -> float:
    """Speed of least power on a circle, or what the slowest of the autopilots holds there (P10)."""
    speed_mps = station_speed_mps(parameters, radius_m)
    if radius_m == 0.0:
        return speed_mps
    wanted = Station("", 0.0, 0.0, 0.0, 0.0, radius_m, speed_mps)
    held = {"px4": px4.circling_mps(wanted), "ardupilot": ardupilot.circling_mps(wanted)}
    return min(held.values()) if firmware == "both" else held[firmware]


def stations_of(fleet: Fleet, plan: Floats) -> list[Station]:
    """The stations of a plan (N, 4)."""
    return [
        Station(
            f"uav_{number}",
            east_m,
            north_m,
            altitude_m,
            transmit_w,
            fleet.circle_radius_m,
            fleet.speed_mps,
        )
        for number, (east_m, north_m, altitude_m, transmit_w) in enumerate(plan.tolist())
    ]


def _planned_drones(
    task: Task, stations: Sequence[Station], service: Service, stay_s: Sequence[float]
) -> list[PlannedDrone]:
    site, parameters = task.surroundings.site, task.config.network_parameters
    places: list[list[float | None]] = [[None, None] for _ in stations]
    if site.center is not None:
        places = site.to_places([[one.east_m, one.north_m] for one in stations]).tolist()
    return [
        PlannedDrone(
            id=station.name,
            lat=_rounded(places[number][0], 8),
            lon=_rounded(places[number][1], 8),
            east_m=round(station.east_m, 3),
            north_m=round(station.north_m, 3),
            altitude_m=round(station.altitude_m, 2),
            transmit_power_w=round(station.transmit_power_w, 4),
            circle_radius_m=station.circle_radius_m,
            speed_mps=round(station.speed_mps, 3),
            people=int(task.people.weights[service.server == number].sum()),
            endurance_minutes=round(stay_s[number] / 60.0, 2),
            backhaul_snr_db=_backhaul_db(task.surroundings.masts, station, parameters),
        )
        for number, station in enumerate(stations)
    ]


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _backhaul_db(masts: Sequence[Mast], station: Station, parameters: Parameters) -> float | None:
    """SNR to the best mast from the point of the circle that is farthest from it."""
    if not masts:
        return None
    distances_m = [
        math.hypot(
            math.hypot(station.east_m - mast.east_m, station.north_m - mast.north_m)
            + station.circle_radius_m,
            station.altitude_m - mast.height_m,
        )
        for mast in masts
    ]
    return round(backhaul_snr_db(parameters, min(distances_m)), 2)


def _site(surroundings: Surroundings, stations: Sequence[Station]) -> PlannedSite:
    """The box of everything that is written: area, stations, masts, home."""
    points_m = [(station.east_m, station.north_m) for station in stations]
    points_m += [(mast.east_m, mast.north_m) for mast in surroundings.masts]
    shape = shapely.union_all(
        [surroundings.area, shapely.MultiPoint([*points_m, surroundings.home_m])]
    )
    west, south, east, north = shape.bounds
    center = surroundings.site.center
    if center is None:
        return PlannedSite(center=None, box=[west, south, east, north])
    corners = surroundings.site.to_places([(x, y) for x in (west, east) for y in (south, north)])
    south_deg, north_deg = corners[:, 0].min(), corners[:, 0].max()
    # Longitudes go on beyond the antimeridian, so that west lies below east.
    turned = (corners[:, 1] - center.longitude_deg + 180.0) % 360.0 - 180.0
    ends = center.longitude_deg + np.array([turned.min(), turned.max()])
    box = [round(float(one), 8) for one in (ends[0], south_deg, ends[1], north_deg)]
    return PlannedSite(
        center={"lat": round(center.latitude_deg, 8), "lon": round(center.longitude_deg, 8)},
        box=box,
    )


_USED = ("channel.", "rotor.", "reward.", "plan.")
"""Sections of which a plan uses every key."""
_USED_KEYS = {
    *("network.subband_bandwidth_hz", "network.total_bandwidth_hz", "network.shares"),
    *("uav.min_altitude_m", "uav.max_altitude_m", "uav.max_speed_mps"),
    *("uav.min_transmit_power_w", "uav.max_transmit_power_w"),
    *("uav.station.circle_radius_m", "uav.station.speed_limit_mps"),
    *("gbs.transmit_power_dbm", "gbs.path_loss_exponent", "gbs.shadowing_std_db"),
    *("gbs.access_bandwidth_hz", "gbs.height_m"),
}


def _settings(task: Task) -> dict[str, JsonValue]:
    """The settings that a plan depends on, and its places."""
    values = flatten(task.config)
    if task.flies is None:  # else they are the method's world, too
        values = {
            key: value
            for key, value in values.items()
            if key.startswith(_USED) or key in _USED_KEYS
        }
    surroundings = task.surroundings
    points_m = [surroundings.home_m, *((mast.east_m, mast.north_m) for mast in surroundings.masts)]
    if surroundings.site.center is not None:
        points_m = [(one[0], one[1]) for one in surroundings.site.to_places(points_m).tolist()]
    home, *masts = [[round(first, 8), round(second, 8)] for first, second in points_m]
    return values | {
        "method": task.method,
        "budget": _budget_text(task.budget),
        "home": home,
        "home_height_amsl_m": surroundings.home_height_amsl_m,
        "masts": masts,
        "mast_heights_m": [mast.height_m for mast in surroundings.masts],
    }


def _notes_on(
    task: Task, stations: Sequence[Station], service: Service, served: PeopleServed
) -> list[str]:
    """What of a plan might surprise."""
    config, notes = task.config, []
    idle = [one.name for number, one in enumerate(stations) if not (service.server == number).any()]
    if idle:
        notes.append(f"Nobody is served by {', '.join(idle)}: fewer drones would do.")
    if task.surroundings.masts and not served.served_by_masts:
        notes.append(
            "Masts serve nobody, since everybody receives a drone better; they carry on what "
            "drones send, and serve people where a drone is lost."
        )
    notes.append(
        f"Times on station are those of a drone as in the paper, of {config.rotor.mass_kg:g} kg, "
        f"with {config.plan.battery_wh:g} Wh and {config.plan.reserve:.0%} in reserve; other "
        "drones need other values of rotor.* and --battery-wh."
    )
    return notes


def _sentence(note: str) -> str:
    """A note as it stands in the report; a name of a file keeps its letters."""
    if "." in note.split(" ", 1)[0]:
        return note if note.endswith(".") else note + "."
    return note[:1].upper() + note[1:] + ("" if note.endswith(".") else ".")


def _budget_text(budget: Budget) -> str:
    return f"{budget.evaluations}" if budget.seconds is None else f"{budget.seconds:g}s"
