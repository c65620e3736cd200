"""Checks mission files of anyone's: ``.plan`` and ``.waypoints``.

The rules are those of QGroundControl's loaders and of the autopilots; MAVSDK accepts more.
"""

import json
from pathlib import Path
from typing import Any, NoReturn

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.missions.check_fence import check_routes, fence_shapes
from orchid_uav.experiments.planning.missions.check_mission import ReadItem, check_items
from orchid_uav.experiments.planning.missions.findings import (
    Finding,
    Findings,
    check_degrees,
    is_number,
    position_of,
    shown,
)
from orchid_uav.experiments.planning.missions.items import Firmware
from orchid_uav.experiments.planning.missions.plan_file import (
    FILE_TYPE,
    MISSION_VERSION,
    RALLY_VERSION,
    RELATIVE_TO_HOME,
    VERSION,
)
from orchid_uav.experiments.planning.missions.waypoints_file import COLUMNS, HEADER
from orchid_uav.experiments.planning.site import Place

MOST_BYTES = 20_000_000
_MOST_FINDINGS = 200
_SAME_M = 0.01


def check_plan_file(path: Path) -> list[Finding]:
    """What is wrong or doubtful in a ``.plan`` or ``.waypoints`` file; errors first.

    Raises:
        InputError: it cannot be read, or is neither JSON nor a table of waypoints.
    """
    text = _read(path)
    findings = Findings()
    if text.startswith("QGC WPL"):
        _check_waypoints(findings, text)
    else:
        document = _parsed(path, text)
        if isinstance(document, dict):
            _check_plan(findings, document)
        else:
            findings.error("the file", f"it holds {shown(document)}; a plan is an object")
    found = sorted(findings.all, key=lambda finding: finding.severity)
    if len(found) > _MOST_FINDINGS:
        rest = Finding("error", "the file", f"{len(found) - _MOST_FINDINGS} more are not listed")
        return [*found[:_MOST_FINDINGS], rest]
    return found


def _read(path: Path) -> str:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(
                f"{path} has {path.stat().st_size / 1e6:.0f} MB; plans have up to "
                f"{MOST_BYTES / 1e6:.0f} MB"
            )
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text: byte {error.start} is not UTF-8") from None


def _parsed(path: Path, text: str) -> Any:
    try:
        return json.loads(text, parse_constant=_refuse)
    except RecursionError:
        raise InputError(f"{path} is no plan: it is nested too deeply") from None
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path} is no JSON: {error.msg} in line {error.lineno}, column {error.colno}"
        ) from None
    except ValueError as error:
        raise InputError(f"{path} is no JSON: {error}") from None


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number of JSON; null stands for what is not given")


def _check_plan(findings: Findings, document: dict[str, Any]) -> None:
    file_type = findings.member(document, "", "fileType", "a text")
    if file_type not in (None, FILE_TYPE):
        findings.error("fileType", f'this is {shown(file_type)}; it has to be "{FILE_TYPE}"')
    findings.version(document, "", VERSION)
    findings.member(document, "", "groundStation", "a text")
    home: Place | None = None
    routes = []
    mission = findings.member(document, "", "mission", "an object")
    if mission is not None:
        home, height_m = _home(findings, mission)
        firmware = _firmware(findings, mission)
        items = _items(findings, mission)
        routes = check_items(findings, items, firmware, home, height_m)
    check_routes(findings, fence_shapes(findings, document), home, routes)
    rally = findings.member(document, "", "rallyPoints", "an object")
    if rally is not None:
        findings.version(rally, "rallyPoints", RALLY_VERSION)
        points = findings.member(rally, "rallyPoints", "points", "a list") or []
        for index, point in enumerate(points):
            position_of(findings, point, f"rallyPoints.points[{index}]", 3)


def _home(findings: Findings, mission: dict[str, Any]) -> tuple[Place | None, float]:
    written = findings.member(mission, "mission", "plannedHomePosition", "a list")
    if written is None:
        return None, 0.0
    home = position_of(findings, written, "mission.plannedHomePosition", 3)
    return (None, 0.0) if home is None else (Place(home[0], home[1]), home[2])


def _firmware(findings: Findings, mission: dict[str, Any]) -> int | None:
    findings.version(mission, "mission", MISSION_VERSION)
    findings.member(mission, "mission", "vehicleType", "a number", required=False)
    for key in ("cruiseSpeed", "hoverSpeed", "globalPlanAltitudeMode"):
        findings.member(mission, "mission", key, "a number or null", required=False)
    firmware = findings.member(mission, "mission", "firmwareType", "a number")
    if firmware is not None and firmware not in (Firmware.PX4, Firmware.ARDUPILOT):
        findings.warning(
            "mission.firmwareType",
            f"{firmware} is neither PX4 (12) nor ArduPilot (3): rules of autopilots not checked",
        )
    return firmware


def _items(findings: Findings, mission: dict[str, Any]) -> list[ReadItem]:
    items = []
    for index, item in enumerate(findings.member(mission, "mission", "items", "a list") or []):
        where = f"mission.items[{index}]"
        if not isinstance(item, dict):
            findings.error(where, f"this is {shown(item)}; an item is an object")
            continue
        kind = findings.member(item, where, "type", "a text")
        if kind == "ComplexItem":
            findings.warning(f"{where}.type", "a ComplexItem (a survey or the like) is not checked")
        elif kind == "SimpleItem":
            read = _simple_item(findings, item, where)
            if read is not None:
                items.append(read)
        elif kind is not None:
            findings.error(f"{where}.type", f"{shown(kind)} is neither SimpleItem nor ComplexItem")
    return items


def _simple_item(findings: Findings, item: dict[str, Any], where: str) -> ReadItem | None:
    frame = findings.member(item, where, "frame", "a number")
    command = findings.member(item, where, "command", "a number")
    findings.member(item, where, "autoContinue", "true or false")
    number = findings.member(item, where, "doJumpId", "a number", required=False)
    params = findings.member(item, where, "params", "a list")
    if params is not None and len(params) != 7:
        findings.error(f"{where}.params", f"there are {len(params)}; there have to be 7")
        params = None
    for index, value in enumerate(params or []):
        if value is not None and not is_number(value):
            findings.error(
                f"{where}.params[{index}]", f"this is {shown(value)}; it has to be a number or null"
            )
            params = None
    if frame is None or command is None or params is None:
        return None
    _check_altitude_mode(findings, item, where, frame, params[6])
    numbers = tuple(None if value is None else float(value) for value in params)
    return ReadItem(where, None if number is None else int(number), int(command), frame, numbers)


def _check_altitude_mode(
    findings: Findings, item: dict[str, Any], where: str, frame: float, altitude_m: float | None
) -> None:
    keys = ("AltitudeMode", "Altitude", "AMSLAltAboveTerrain")
    there = [key for key in keys if key in item]
    if not there:
        return
    for key in keys:
        if key not in item:
            findings.error(where, f"there is {there[0]} but no {key}; it has all three or none")
        else:
            findings.member(item, where, key, "a number or null")
    if item.get("AltitudeMode") == RELATIVE_TO_HOME and frame != 3:
        findings.error(
            f"{where}.AltitudeMode", f"1 (above home) goes with frame 3, and the frame is {frame:g}"
        )
    shown_m = item.get("Altitude")
    if shown_m is None or altitude_m is None or not is_number(shown_m):
        return
    if abs(shown_m - altitude_m) > _SAME_M:
        findings.error(
            f"{where}.Altitude",
            f"it is {shown_m:g}, and params[6] is {altitude_m:g}: QGroundControl flies the one, "
            "MAVSDK the other; they have to be equal",
        )


def _check_waypoints(findings: Findings, text: str) -> None:
    header, *rows = text.splitlines()
    if header.strip() != HEADER:
        findings.error("row 1", f'this is {shown(header)}; it has to be "{HEADER}"')
    items: list[ReadItem] = []
    for line, row in enumerate(rows, 2):
        if not row.strip() or row.startswith("#"):
            continue
        item = _row(findings, row, f"row {line}")
        if item is None:
            return
        if item.number != len(items):
            findings.error(f"row {line}", f"its number is {item.number}; {len(items)} follows here")
        items.append(item)
    if not items:
        findings.error("the file", "it has no rows; the first is home")
        return
    home, flown = items[0], items[1:]
    latitude_deg, longitude_deg = home.params[4] or 0.0, home.params[5] or 0.0
    place = None
    if home.command != 16 or home.frame != 0:
        findings.error(home.where, "the first row is not home: command 16 in frame 0")
    elif check_degrees(findings, latitude_deg, longitude_deg, home.where):
        place = Place(latitude_deg, longitude_deg)
    check_items(findings, flown, Firmware.ARDUPILOT, place, home.params[6] or 0.0)


def _row(findings: Findings, row: str, where: str) -> ReadItem | None:
    fields = row.rstrip("\r\n").split("\t")
    if len(fields) != COLUMNS:
        findings.error(
            where, f"there are {len(fields)} columns; there have to be {COLUMNS}, between tabs"
        )
        return None
    try:
        number, _, frame, command = (int(field) for field in fields[:4])
        numbers = [float(field) for field in fields[4:11]]
    except ValueError as error:
        findings.error(where, f"{error}; all columns hold numbers")
        return None
    if not all(is_number(value) for value in numbers):
        findings.error(where, "a number is infinite or missing")
        return None
    return ReadItem(where, number, command, frame, tuple(numbers))
