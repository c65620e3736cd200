"""The worked example of docs/planning.md: ``python -m studies.plan_example``.

Makes the plan that ``COMMAND`` asks for, and keeps ``plan.json`` and the map.
"""

import argparse
import shlex
import tempfile
from pathlib import Path

from orchid_uav.cli.main import main as orchid
from orchid_uav.storage.files import read_document, write_json
from studies.recording import RESULTS, ROOT, add_recording_options, record, require_commit

NAME = "plan_example"
COMMAND = (
    "orchid plan examples/planning/people.csv --drones 6 "
    "--area examples/planning/area.geojson --no-fly examples/planning/airport.geojson "
    "--mast 17.2966,-62.7243,30 --home 17.2975,-62.7250,10 --want 500kbps:95%"
)
EVALUATIONS = 40_000
"""In place of the default budget, which is a time: the plan is the same whenever it is made."""
PICTURE = ROOT / "docs" / "figures" / f"{NAME}.svg"


def map_of(report: str) -> str:
    """The map of a report as a picture of its own."""
    style = report.partition("<style>")[2].partition("</style>")[0]
    start = report.index("<svg", report.index('class="map"') - 400)
    drawn = report[start : report.index("</svg>", start)]
    head, _, rest = drawn.partition(">")
    return f'{head} xmlns="http://www.w3.org/2000/svg"><style>{style}</style>{rest}</svg>\n'


def main() -> None:
    """Make the plan, and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_recording_options(parser)
    options = parser.parse_args()
    path = RESULTS / f"{NAME}.json"
    require_commit(parser, options, path)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "plan"
        given = [*shlex.split(COMMAND)[1:], "--budget", str(EVALUATIONS)]
        if orchid([*given, "--out", str(out), "--quiet"]) != 0:
            parser.exit(1, "the plan could not be made\n")
        document = read_document(out / "plan.json")
        report = (out / "report.html").read_text(encoding="utf-8")
    document["command"] = shlex.split(COMMAND)
    PICTURE.write_text(map_of(report), encoding="utf-8")
    settings = {"budget": EVALUATIONS, "example": COMMAND}
    write_json(path, record(settings, plan=document))  # places need all of their digits


if __name__ == "__main__":
    main()
