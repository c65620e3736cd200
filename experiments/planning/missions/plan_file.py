"""QGroundControl's ``.plan`` files."""

import json
from pathlib import Path
from typing import Any

from orchid_uav.experiments.planning.missions.fence import Fence
from orchid_uav.experiments.planning.missions.items import Command, Mission, MissionItem
from orchid_uav.experiments.planning.site import Place

FILE_TYPE = "Plan"
VERSION, MISSION_VERSION, FENCE_VERSION, SHAPE_VERSION, RALLY_VERSION = 1, 2, 2, 1, 2
QUADROTOR = 2
"""MAV_TYPE, which stands for all multicopters."""
RELATIVE_TO_HOME = 1
"""QGroundControl's altitude mode."""
_WRITER = "ORCHID"


def plan_document(mission: Mission, fence: Fence) -> dict[str, Any]:
    """The content of a ``.plan`` file."""
    home = mission.home
    return {
        "fileType": FILE_TYPE,
        "version": VERSION,
        "groundStation": _WRITER,
        "mission": {
            "version": MISSION_VERSION,
            "firmwareType": int(mission.firmware),
            "vehicleType": QUADROTOR,
            "plannedHomePosition": [
                home.latitude_deg,
                home.longitude_deg,
                mission.home_height_amsl_m,
            ],
            "cruiseSpeed": mission.cruise_mps,
            "hoverSpeed": mission.cruise_mps,
            "globalPlanAltitudeMode": RELATIVE_TO_HOME,
            "items": [_item(item, number) for number, item in enumerate(mission.items, 1)],
        },
        "geoFence": {
            "version": FENCE_VERSION,
            "circles": [],
            "polygons": [
                {
                    "version": SHAPE_VERSION,
                    "inclusion": inclusion,
                    "polygon": [list(place) for place in corners],
                }
                for inclusion, corners in fence.polygons
            ],
        },
        "rallyPoints": {"version": RALLY_VERSION, "points": []},
    }


def plan_text(document: dict[str, Any]) -> str:
    """A document as it is written."""
    return json.dumps(document, indent=4, allow_nan=False) + "\n"


def write_plan(path: Path, document: dict[str, Any]) -> None:
    """Write a ``.plan`` file; equal documents give equal bytes."""
    path.write_text(plan_text(document), encoding="utf-8", newline="\n")


def items_of(document: dict[str, Any]) -> list[MissionItem]:
    """The items of a ``.plan`` file that was written here.

    Raises:
        ValueError: an item has a command that is not written here.
    """
    items = []
    for item in document["mission"]["items"]:
        first, second, third, fourth, latitude_deg, longitude_deg, altitude_m = item["params"]
        place = Place(latitude_deg, longitude_deg) if "AltitudeMode" in item else None
        params = (first, second, third, fourth)
        items.append(MissionItem(Command(item["command"]), params, place, altitude_m))
    return items


def _item(item: MissionItem, number: int) -> dict[str, Any]:
    latitude_deg, longitude_deg = item.place or (0, 0)
    written: dict[str, Any] = {
        "type": "SimpleItem",
        "command": int(item.command),
        "frame": int(item.frame),
        "params": [*item.params, latitude_deg, longitude_deg, item.altitude_m],
        "autoContinue": True,
        "doJumpId": number,
    }
    if item.place is not None:
        written["AltitudeMode"] = RELATIVE_TO_HOME
        written["Altitude"] = item.altitude_m
        written["AMSLAltAboveTerrain"] = None
    return written
