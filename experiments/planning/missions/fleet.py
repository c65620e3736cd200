"""The missions of all drones for one firmware, and the proof that they can be flown together."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from orchid_uav.experiments.planning.missions import ardupilot, px4
from orchid_uav.experiments.planning.missions.fence import Fence
from orchid_uav.experiments.planning.missions.items import Firmware, Mission
from orchid_uav.experiments.planning.missions.plan_file import items_of, plan_document
from orchid_uav.experiments.planning.missions.proof import FlightProof, prove
from orchid_uav.experiments.planning.missions.stays import Stay, plan_stays
from orchid_uav.experiments.planning.missions.transit import Transit
from orchid_uav.experiments.planning.model import Station, Surroundings


class FleetMissions(NamedTuple):
    """Missions for one firmware, in the order of the stations."""

    missions: tuple[Mission, ...]
    documents: tuple[dict[str, Any], ...]
    """The contents of ``.plan`` files."""
    stays: tuple[Stay, ...]
    proof: FlightProof


def plan_missions(
    firmware: Firmware,
    surroundings: Surroundings,
    stations: Sequence[Station],
    transit: Transit,
    fence: Fence,
    longest_s: Sequence[float],
) -> FleetMissions:
    """Plan all missions, and fly what is written.

    Args:
        firmware: of all drones.
        surroundings: limits of drones; their site has a place on earth.
        stations: of all drones.
        transit: their ways.
        fence: of all drones.
        longest_s: how long the battery of each lasts on station, (N,).

    Raises:
        InputError: the drones cannot come back without meeting.
    """
    autopilot = {Firmware.PX4: px4, Firmware.ARDUPILOT: ardupilot}[firmware]
    turns_s = [autopilot.turn_s(station) for station in stations]
    stays = plan_stays(surroundings, stations, transit, longest_s, turns_s)
    missions = tuple(
        autopilot.mission_of(surroundings, station, way, stay)
        for station, way, stay in zip(stations, transit.ways, stays, strict=True)
    )
    documents = tuple(plan_document(mission, fence) for mission in missions)
    read = [items_of(json.loads(json.dumps(document))) for document in documents]
    launches_s = [way.launch_s for way in transit.ways]
    proof = prove(surroundings, stations, read, launches_s, transit.speeds)
    return FleetMissions(missions, documents, stays, proof)
