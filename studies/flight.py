"""The flight of README.md and docs/replay.md: ``python -m studies.flight``.

Flies what ``COMMAND`` asks for, keeps the replay's document, and draws the moving picture. The page
of the documentation is made from the document when the site is built.
"""

import argparse
from pathlib import Path

from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.evaluation.flights import Setting
from orchid_uav.experiments.evaluation.methods import select
from orchid_uav.experiments.replay.animation import animation, frame_slots
from orchid_uav.experiments.replay.document import ReplayDocument
from orchid_uav.experiments.replay.flown import Topology, replay_of_flights
from orchid_uav.experiments.replay.scene import unpack
from orchid_uav.storage.files import write_atomically, write_json
from studies.recording import RESULTS, ROOT, add_recording_options, read, record, require_commit

NAME = "flight"
METHODS = ("orchid-distilled", "balanced-loiter")
SETTING = Setting(speed_mps=15.0, heading_hold_s=20.0)
WIDTH_PX, EVERY, FRAMES_PER_S = 760, 4, 8.0
COMMAND = (
    f"orchid replay --methods {','.join(METHODS)} --speeds {SETTING.speed_mps:g} "
    f"--heading-hold {SETTING.heading_hold_s:g}"
)
"""Makes the same page."""
PICTURE_COMMAND = (
    f"{COMMAND} --width {WIDTH_PX} --every {EVERY} --fps {FRAMES_PER_S:g} -o {NAME}.webp"
)
PICTURE = ROOT / "docs" / "figures" / f"{NAME}.webp"


def fly() -> ReplayDocument:
    """The replay of ``COMMAND``."""
    contenders = [select([method])[0] for method in METHODS]
    return replay_of_flights(contenders, RunConfig().network_parameters, SETTING, Topology(0, 0))


def committed() -> ReplayDocument:
    """The replay that is committed."""
    return ReplayDocument.from_json(read(NAME)["replay"])


def draw_flight(path: Path = PICTURE) -> Path:
    """Draw the moving picture of the committed replay."""
    scene = unpack(committed())
    slots = frame_slots(scene.slots, EVERY)
    write_atomically(path, animation(scene, slots, "webp", WIDTH_PX, FRAMES_PER_S))
    return path


def main() -> None:
    """Fly, write, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_recording_options(parser)
    options = parser.parse_args()
    path = RESULTS / f"{NAME}.json"
    require_commit(parser, options, path)
    settings = {"page": COMMAND, "picture": PICTURE_COMMAND}
    write_json(path, record(settings, replay=fly().to_json()))
    draw_flight()


if __name__ == "__main__":
    main()
