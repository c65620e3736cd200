"""Where people are: from a file of any format to a table that was checked."""

from dataclasses import replace
from pathlib import Path

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.csv_rows import read_csv
from orchid_uav.experiments.planning.reading.geojson import read_geojson_people
from orchid_uav.experiments.planning.reading.gis import FORMATS, read_gis_people
from orchid_uav.experiments.planning.reading.kml import read_kml_people
from orchid_uav.experiments.planning.reading.nearness import check_nearness
from orchid_uav.experiments.planning.reading.site import locate, notes_on_area
from orchid_uav.experiments.planning.reading.table import PeopleTable
from orchid_uav.experiments.planning.reading.zones import Zones

_READERS = (
    {".csv": read_csv, ".tsv": read_csv, ".txt": read_csv}
    | {".geojson": read_geojson_people, ".json": read_geojson_people}
    | {".kml": read_kml_people, ".kmz": read_kml_people}
    | dict.fromkeys(FORMATS, read_gis_people)
)
_WORKBOOKS = (".xlsx", ".xls", ".ods", ".numbers")


def read_people(path: Path, area: Zones | None = None) -> PeopleTable:
    """Read and check where people are; the file's ending says its format.

    At most 20,000 positions, each of which may stand for up to 100,000 people; 10 million people
    altogether.

    Args:
        path: the file.
        area: where drones may be. People outside it are people to be served all the same, and a
            note says how many they are.

    Raises:
        InputError: the file cannot be read, or something in it is wrong; the message names up to
            twenty wrong rows.
    """
    suffix = path.suffix.lower()
    if suffix in _WORKBOOKS:
        raise InputError(f"{path} is a workbook: save its table as CSV with the encoding UTF-8")
    reader = _READERS.get(suffix)
    if reader is None:
        raise InputError(
            f"{path} ends in none of {', '.join(_READERS)}: give people as CSV, GeoJSON or KML"
        )
    table = reader(path)
    check_nearness(table)
    if area is None:
        return table
    notes = notes_on_area(table, area, locate(table, [area]))
    return replace(table, notes=(*table.notes, *notes))
