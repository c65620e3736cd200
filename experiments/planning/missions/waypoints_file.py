"""Mission Planner's ``.waypoints`` files ("QGC WPL 110")."""

from orchid_uav.experiments.planning.missions.items import Command, Frame, Mission, MissionItem
from orchid_uav.experiments.planning.site import Place

HEADER = "QGC WPL 110"
COLUMNS = 12


def waypoints_text(mission: Mission) -> str:
    """The content of a ``.waypoints`` file: home, then the items."""
    rows = [HEADER]
    at_home = MissionItem(Command.WAYPOINT, (0, 0, 0, 0), mission.home, mission.home_height_amsl_m)
    for number, item in enumerate((at_home, *mission.items)):
        latitude_deg, longitude_deg = item.place or (0.0, 0.0)
        frame = Frame.ABOVE_SEA if number == 0 else item.frame
        fields = [
            f"{number:d}",
            f"{int(number == 0):d}",  # the current item
            f"{frame:d}",
            f"{item.command:d}",
            *(f"{param or 0.0:.8f}" for param in item.params),
            f"{latitude_deg:.8f}",
            f"{longitude_deg:.8f}",
            f"{item.altitude_m:.6f}",
            "1",  # go on to the next item
        ]
        rows.append("\t".join(fields))
    return "\n".join(rows) + "\n"


def items_of(text: str) -> list[MissionItem]:
    """The items of a ``.waypoints`` file that was written here, without home.

    Raises:
        ValueError: an item has a command that is not written here.
    """
    items = []
    for row in text.splitlines()[2:]:
        fields = row.split("\t")
        first, second, third, fourth, latitude_deg, longitude_deg, altitude_m = map(
            float, fields[4:11]
        )
        place = Place(latitude_deg, longitude_deg) if int(fields[2]) != Frame.NO_POSITION else None
        command, params = Command(int(fields[3])), (first, second, third, fourth)
        items.append(MissionItem(command, params, place, altitude_m))
    return items
