"""The mission files of a plan, flown once by a program before anybody else does."""

from collections.abc import Sequence

from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.planning.missions.fence import Fence
from orchid_uav.experiments.planning.missions.fleet import plan_missions
from orchid_uav.experiments.planning.missions.items import Firmware
from orchid_uav.experiments.planning.missions.plan_file import plan_text
from orchid_uav.experiments.planning.missions.transit import Transit
from orchid_uav.experiments.planning.missions.waypoints_file import waypoints_text
from orchid_uav.experiments.planning.model import Station, Surroundings

_FOLDERS = {"px4": Firmware.PX4, "ardupilot": Firmware.ARDUPILOT}


def mission_files(
    surroundings: Surroundings,
    stations: Sequence[Station],
    transit: Transit,
    fence: Fence,
    stay_s: Sequence[float],
    firmware: str,
) -> list[tuple[str, bytes]]:
    """Names and contents of all missions for a firmware, or for ``both``.

    Args:
        surroundings: limits of drones.
        stations: of all drones.
        transit: their ways.
        fence: of all drones.
        stay_s: how long a battery lasts on each station.
        firmware: ``px4``, ``ardupilot`` or ``both``.

    Raises:
        InputError: the drones cannot come back without meeting.
        RunFailedError: flown second by second, the missions break a limit.
    """
    files = []
    for folder, autopilot in _FOLDERS.items():
        if firmware not in (folder, "both"):
            continue
        made = plan_missions(autopilot, surroundings, stations, transit, fence, stay_s)
        if made.proof.conflicts:
            first = made.proof.conflicts[0]
            raise RunFailedError(
                f"the missions for {folder} break a limit when they are flown, which is a fault "
                f"of this program: {', '.join(first.drones)} after {first.second:.0f} s: "
                f"{first.what}"
            )
        for mission, document in zip(made.missions, made.documents, strict=True):
            name = f"missions/{folder}/{mission.drone}"
            files.append((f"{name}.plan", plan_text(document).encode()))
            if autopilot is Firmware.ARDUPILOT:
                files.append((f"{name}.waypoints", waypoints_text(mission).encode()))
    return files
