"""Plans that nobody planned, for tests of maps and of the report: plausible, and quick to make."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.model import Mast, People, Station, Surroundings, Want
from orchid_uav.experiments.planning.result import PlanDocument
from orchid_uav.experiments.planning.site import Place, Site

UTUADO = Place(18.2655, -66.7005)
WANT = Want(500e3, 0.95)
_BANDWIDTH_HZ = 10e6
_DRONE_REACH_M, _MAST_REACH_M = 520.0, 640.0


def make_plan(
    drones: int = 6,
    rows: int = 220,
    masts: int = 1,
    *,
    center: Place | None = UTUADO,
    across_m: float = 2400.0,
    greatest_weight: int = 40,
    want: Want | None = WANT,
    zone: bool = True,
    ways: bool = True,
    hover: bool = False,
    seed: int = 0,
    **fields: Any,
) -> MappedPlan:
    """Make a plan for clustered people.

    Args:
        drones: how many of them.
        rows: positions of people.
        masts: how many of them.
        center: where on earth; None for a site in local metres.
        across_m: width of the site.
        greatest_weight: of a position.
        want: the wanted rate and share.
        zone: whether there is a no-fly zone.
        ways: whether the ways of the drones are known.
        hover: whether drones hover.
        seed: of all that is drawn.
        fields: fields of the document that are replaced.
    """
    generator = np.random.default_rng(seed)
    people = _people(generator, rows, across_m, greatest_weight)
    site = Site(center)
    area = shapely.box(-0.55 * across_m, -0.45 * across_m, 0.55 * across_m, 0.45 * across_m)
    no_fly = shapely.Point(0.2 * across_m, 0.22 * across_m).buffer(0.07 * across_m, 3)
    surroundings = Surroundings(
        site=site,
        area=area,
        no_fly=no_fly if zone else shapely.Polygon(),
        masts=tuple(Mast(-0.22 * across_m + 900.0 * mast, -150.0, 30.0) for mast in range(masts)),
        home_m=(-0.05 * across_m, -0.4 * across_m),
        home_height_amsl_m=0.0,
        lowest_m=80.0,
        highest_m=120.0,
        clearance_m=50.0,
    )
    stations = _stations(generator, people, drones, hover)
    server, rates_bps = _served(people, stations, surroundings.masts)
    return MappedPlan(
        document=_document(people, stations, surroundings, server, rates_bps, want, fields),
        surroundings=surroundings,
        people=people,
        stations=stations,
        server=server,
        rates_bps=rates_bps,
        want=want,
        ways_m=_ways(surroundings, stations) if ways else [],
    )


def _people(generator: np.random.Generator, rows: int, across_m: float, most: int) -> People:
    middles = generator.uniform(-0.42, 0.42, (max(3, rows // 60), 2)) * across_m * (1.0, 0.8)
    positions = middles[generator.integers(len(middles), size=rows)]
    positions = positions + generator.normal(0.0, 0.06 * across_m, (rows, 2))
    stray = generator.random(rows) < 0.12
    positions[stray] = generator.uniform(-0.48, 0.48, (int(stray.sum()), 2)) * across_m
    limits = (0.5 * across_m, 0.42 * across_m)
    weights = np.ones(rows, np.int64)
    if most > 1:
        weights = np.minimum(generator.geometric(0.6, rows), most)
        weights[generator.random(rows) < 0.02] = most
    return People(np.clip(positions, np.negative(limits), limits), weights)


def _stations(
    generator: np.random.Generator, people: People, drones: int, hover: bool
) -> tuple[Station, ...]:
    positions_m = people.positions_m
    middles_m = positions_m[generator.choice(len(positions_m), drones, replace=drones > 50)]
    middles_m = middles_m + generator.normal(0.0, 5.0, middles_m.shape)
    for _ in range(8):
        nearest = _distances_m(positions_m, middles_m).argmin(axis=1)
        for drone in range(drones):
            if (nearest == drone).any():
                middles_m[drone] = np.average(
                    positions_m[nearest == drone], axis=0, weights=people.weights[nearest == drone]
                )
    return tuple(
        Station(
            name=f"uav_{drone}",
            east_m=round(float(east_m), 2),
            north_m=round(float(north_m), 2),
            altitude_m=80.0 + 5.0 * (drone % 8),
            transmit_power_w=round(0.5 + 0.1 * (drone % 6), 2),
            circle_radius_m=0.0 if hover else 48.0,
            speed_mps=0.0 if hover else 11.5,
        )
        for drone, (east_m, north_m) in enumerate(middles_m)
    )


def _served(
    people: People, stations: Sequence[Station], masts: Sequence[Mast]
) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    heights_m = [one.altitude_m for one in stations] + [one.height_m for one in masts]
    scaled = _scaled_distances(people, stations, masts)
    reaches_m = _reaches_m(stations, masts)
    server = scaled.argmin(axis=1)
    server[scaled.min(axis=1) > 1.0] = NOBODY
    rates_bps = np.zeros(len(server))
    for index, height_m in enumerate(heights_m):
        own = server == index
        load = people.weights[own].sum()
        distances_m = reaches_m[index] * scaled[own, index]
        snr = (4e6 if index < len(stations) else 1e6) / (distances_m**2 + height_m**2)
        rates_bps[own] = _BANDWIDTH_HZ / max(load, 1) * np.log2(1.0 + snr)
    return server.astype(np.int64), rates_bps


def _reaches_m(stations: Sequence[Station], masts: Sequence[Mast]) -> Any:
    return np.array([_DRONE_REACH_M] * len(stations) + [_MAST_REACH_M] * len(masts))


def _scaled_distances(people: People, stations: Sequence[Station], masts: Sequence[Mast]) -> Any:
    """Of each person to each drone and mast, as a share of its reach."""
    places_m = np.array([(one.east_m, one.north_m) for one in (*stations, *masts)])
    return _distances_m(people.positions_m, places_m) / _reaches_m(stations, masts)


def _distances_m(positions_m: Any, places_m: Any) -> Any:
    return np.hypot(*(positions_m[:, None, :] - places_m[None, :, :]).transpose(2, 0, 1))


def _ways(surroundings: Surroundings, stations: Sequence[Station]) -> list[Any]:
    home_m = surroundings.home_m
    return [
        np.array(
            [
                (*home_m, 0.0),
                (*home_m, station.altitude_m),
                (station.east_m - station.circle_radius_m, station.north_m, station.altitude_m),
            ]
        )
        for station in stations
    ]


def people_served(
    people: People, server: Any, rates_bps: Any, drones: int, want: Want | None
) -> dict[str, Any]:
    """The figures of ``people`` in ``plan.json``, counted by weights."""
    weights, total = people.weights, people.total
    order = np.argsort(rates_bps)
    half = np.searchsorted(weights[order].cumsum(), total / 2.0)
    return {
        "total": total,
        "served_by_drones": int(weights[(server >= 0) & (server < drones)].sum()),
        "served_by_masts": int(weights[server >= drones].sum()),
        "unserved": int(weights[server == NOBODY].sum()),
        "worst_rate_bps": float(rates_bps.min()),
        "median_rate_bps": float(rates_bps[order][half]),
        "share_above_want": None
        if want is None
        else float(weights[rates_bps >= want.rate_bps].sum() / total),
    }


def _document(
    people: People,
    stations: Sequence[Station],
    surroundings: Surroundings,
    server: Any,
    rates_bps: Any,
    want: Want | None,
    fields: dict[str, Any],
) -> PlanDocument:
    drones, site = len(stations), surroundings.site
    places = [(station.east_m, station.north_m) for station in stations]
    on_earth = site.to_places(places) if site.center else [(None, None)] * drones
    served = people_served(people, server, rates_bps, drones, want)
    document = {
        "schema": 1,
        "command": ["orchid", "plan", "people.csv", "--drones", str(drones), "--seed", "7"],
        "settings": {"drones": drones, "environment": "suburban", "seed": 7, "reserve": 0.2},
        "site": {"center": _center(site.center), "box": [-1.0, -1.0, 1.0, 1.0]},
        "drones": [
            {
                "id": station.name,
                "lat": None if latitude is None else float(latitude),
                "lon": None if longitude is None else float(longitude),
                "east_m": station.east_m,
                "north_m": station.north_m,
                "altitude_m": station.altitude_m,
                "transmit_power_w": station.transmit_power_w,
                "circle_radius_m": station.circle_radius_m,
                "speed_mps": station.speed_mps,
                "people": int(people.weights[server == index].sum()),
                "endurance_minutes": 38.2 + 0.7 * (index % 5),
                "backhaul_snr_db": 18.5 + index % 9 if surroundings.masts else None,
            }
            for index, (station, (latitude, longitude)) in enumerate(
                zip(stations, on_earth, strict=True)
            )
        ],
        "people": served,
        "utility": 2.613,
        "evaluations": 12_000,
        "rotation": {"batteries_for_24_h": 38 * drones, "drones_for_24_h": 2 * drones + 1},
        "robustness": {
            "position_error_50m": _drawn(served, 0.99),
            "position_error_150m": _drawn(served, 0.93),
            "shadowing": _drawn(served, 0.97),
            "walking_10_minutes": _drawn(served, 0.955),
            "one_drone_lost": _one_lost(people, stations, surroundings.masts, served, want),
        },
        "fleet_sizes": [
            _fleet(size, drones, served) for size in range(max(1, drones - 2), drones + 3)
        ],
        "launches": [
            {
                "drone": station.name,
                "after_s": 45.0 * order,
                "way_altitude_m": 60.0 + 10.0 * (order % 6),
            }
            for order, station in enumerate(stations)
        ],
        "notes": ["Altitudes are above home: there is no terrain in this plan."],
    }
    return PlanDocument.from_json(document | fields)


def _center(center: Place | None) -> dict[str, float] | None:
    return center and {"lat": center.latitude_deg, "lon": center.longitude_deg}


def _drawn(served: dict[str, Any], factor: float) -> dict[str, Any]:
    share = 1.0 - served["unserved"] / served["total"]
    above = served["share_above_want"]
    return {
        "draws": 100,
        "share_served": share * factor,
        "share_served_worst": share * (2.5 * factor - 1.5),
        "worst_rate_bps": served["worst_rate_bps"] * factor,
        "worst_rate_bps_worst": 0.0,
        "median_rate_bps": served["median_rate_bps"] * factor,
        "median_rate_bps_worst": served["median_rate_bps"] * factor**3,
        "share_above_want": above and above * factor,
        "share_above_want_worst": above and above * factor**3,
    }


def _one_lost(
    people: People,
    stations: Sequence[Station],
    masts: Sequence[Mast],
    before: dict[str, Any],
    want: Want | None,
) -> dict[str, Any] | None:
    if len(stations) == 1:
        return None
    server, rates_bps = _served(people, stations, masts)
    scaled = _scaled_distances(people, stations, masts)
    names = [station.name for station in stations] + [f"mast_{mast}" for mast in range(len(masts))]
    each = []
    for lost, name in enumerate(names[: len(stations)]):
        own = np.flatnonzero(server == lost)
        other = np.delete(np.arange(len(names)), lost)
        second = other[scaled[own][:, other].argmin(axis=1)]
        second[scaled[own, second] > 1.0] = NOBODY
        now, rates_now_bps = server.copy(), rates_bps.copy()
        now[own] = second
        rates_now_bps[own] = np.where(second == NOBODY, 0.0, 0.6 * rates_bps[own])
        left = people_served(people, now, rates_now_bps, len(stations), want)
        weights = people.weights[own]
        taken = {
            names[one]: int(weights[second == one].sum()) for one in np.unique(second[second >= 0])
        }
        back = (before["unserved"] + left["unserved"]) // 2
        regained = left | {"unserved": back}
        regained["served_by_drones"] += left["unserved"] - back
        each.append(
            {
                "drone": name,
                "people_before": int(weights.sum()),
                "taken_over": taken,
                "left": left,
                "regained": regained,
                "regained_after_s": 75.0 + 10.0 * lost,
            }
        )
    shares = [1.0 - one["left"]["unserved"] / before["total"] for one in each]
    again = [1.0 - one["regained"]["unserved"] / before["total"] for one in each]
    return {
        "share_served": float(np.mean(shares)),
        "share_served_worst": min(shares),
        "share_served_regained": float(np.mean(again)),
        "share_served_regained_worst": min(again),
        "each": each,
    }


def _fleet(size: int, drones: int, served: dict[str, Any]) -> dict[str, Any]:
    unserved = round(served["unserved"] * 1.45 ** (drones - size))
    by_drones = served["total"] - served["served_by_masts"] - unserved
    above = served["share_above_want"]
    people = served | {
        "served_by_drones": by_drones,
        "unserved": unserved,
        "median_rate_bps": served["median_rate_bps"] * size / drones,
        "share_above_want": above and min(1.0, above * (size / drones) ** 0.5),
    }
    return {"drones": size, "utility": 2.613 + 0.05 * (size - drones), "people": people}
