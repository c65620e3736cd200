"""The mission files of a plan, flown once by a program before anybody else does."""

import json
from collections.abc import Sequence

from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.planning.missions import ardupilot, plan_file, px4
from orchid_uav.experiments.planning.missions.fence import fence_of
from orchid_uav.experiments.planning.missions.proof import prove
from orchid_uav.experiments.planning.missions.stays import plan_stays
from orchid_uav.experiments.planning.missions.transit import Transit
from orchid_uav.experiments.planning.missions.waypoints_file import waypoints_text
from orchid_uav.experiments.planning.model import Station, Surroundings

_WRITERS = {"px4": px4, "ardupilot": ardupilot}


def mission_files(
    surroundings: Surroundings,
    stations: Sequence[Station],
    transit: Transit,
    stay_s: Sequence[float],
    firmware: str,
) -> list[tuple[str, bytes]]:
    """Names and contents of all missions for a firmware, or for ``both``.

    Args:
        surroundings: limits of drones.
        stations: of all drones.
        transit: their ways.
        stay_s: how long a battery lasts on each station.
        firmware: ``px4``, ``ardupilot`` or ``both``.

    Raises:
        InputError: a drone would have to come back before it has flown one circle.
        RunFailedError: flown second by second, the missions break a limit.
    """
    files = []
    fence = fence_of(surroundings, transit)
    for name, writer in _WRITERS.items():
        if firmware not in (name, "both"):
            continue
        turns_s = [writer.turn_s(station) for station in stations]
        stays = plan_stays(surroundings, stations, transit, stay_s, turns_s)
        documents = []
        for station, way, stay in zip(stations, transit.ways, stays, strict=True):
            mission = writer.mission_of(surroundings, station, way, stay)
            documents.append(plan_file.plan_document(mission, fence))
            text = json.dumps(documents[-1], indent=4, allow_nan=False)
            files.append((f"missions/{name}/{station.name}.plan", f"{text}\n".encode()))
            if writer is ardupilot:
                rows = waypoints_text(mission).encode()
                files.append((f"missions/{name}/{station.name}.waypoints", rows))
        _prove(surroundings, stations, transit, documents)
    return files


def _prove(
    surroundings: Surroundings,
    stations: Sequence[Station],
    transit: Transit,
    documents: Sequence[dict[str, object]],
) -> None:
    flown = prove(
        surroundings,
        stations,
        [plan_file.items_of(document) for document in documents],
        [way.launch_s for way in transit.ways],
        transit.speeds,
    )
    if flown.conflicts:
        first = flown.conflicts[0]
        raise RunFailedError(
            f"the missions break a limit when they are flown, which is a fault of this program: "
            f"{', '.join(first.drones)} after {first.second:.0f} s: {first.what}"
        )
