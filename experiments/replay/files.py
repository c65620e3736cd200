"""A replay as a file: a page, a picture, or a moving picture, as the file's name says."""

import json
import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.replay.animation import animation, frame_slots, still_png
from orchid_uav.experiments.replay.document import ReplayDocument
from orchid_uav.experiments.replay.flown import ReplayListener
from orchid_uav.experiments.replay.page.page import page_html
from orchid_uav.experiments.replay.scene import unpack
from orchid_uav.notices import reason_of
from orchid_uav.storage.files import write_atomically

DEFAULT_PARENT = Path("orchid-replay")
PAGE, STILL, MOVING = ".html", ".png", (".gif", ".webp")
WIDTH_PX, FRAMES_PER_S = 900, 10.0
"""Of pictures, if nothing else is asked for."""


@dataclass(frozen=True)
class Output:
    """What is to be written; what is None was not asked for."""

    path: Path | None = None
    """By default a page, ``./orchid-replay/<UTC time>.html``."""
    frame: int | None = None
    """Slot of a still picture; by default the last."""
    every: int | None = None
    """Slots from picture to picture of a moving one."""
    frames_per_s: float | None = None
    width_px: int | None = None
    force: bool = False
    """Whether a file that is there may be replaced."""

    @property
    def kind(self) -> str:
        """The ending of the file."""
        return PAGE if self.path is None else self.path.suffix.lower()

    def check(self) -> None:
        """Check all that can be known before anything is flown.

        Raises:
            InputError: the file's name says nothing that can be written, it is there already or
                cannot be made, or something asked for has no effect.
        """
        if self.kind not in (PAGE, STILL, *MOVING):
            raise InputError(
                f"--out {self.path}: a replay is a page (.html), a picture (.png) or a moving "
                "picture (.gif, .webp)"
            )
        for option, value, kinds in (
            ("--frame", self.frame, (STILL,)),
            ("--every", self.every, MOVING),
            ("--fps", self.frames_per_s, MOVING),
            ("--width", self.width_px, (STILL, *MOVING)),
        ):
            if value is not None and self.kind not in kinds:
                raise InputError(
                    f"{option} has no effect on a {self.kind}: it is for {', '.join(kinds)}, as in "
                    f"-o flight{kinds[0]}"
                )
        if self.path is None:
            return
        if not self.force and os.path.lexists(self.path):
            raise InputError(f"{self.path} exists: give another name, or --force to replace it")
        if self.path.is_dir():
            raise InputError(f"{self.path} is a directory: give the name of a file")
        parent = self.path.absolute().parent
        if not parent.is_dir() or not os.access(parent, os.W_OK):
            raise InputError(f"cannot write {self.path}: {parent} is not a directory to write in")


def write_replay(
    document: ReplayDocument, output: Output, listener: ReplayListener | None = None
) -> tuple[Path, int]:
    """Write a replay in one step; returns where, and its bytes.

    Args:
        document: the replay.
        output: what is to be written.
        listener: is told how far it is.

    Raises:
        InputError: the replay has no such slot, or too many for a moving picture.
        RunFailedError: the file cannot be written.
    """
    content = _content(document, output, listener or ReplayListener())
    try:
        path = output.path
        if path is None:
            DEFAULT_PARENT.mkdir(exist_ok=True)
            path = _free_name()
        write_atomically(path, content)
    except OSError as error:
        raise RunFailedError(
            f"cannot write {output.path or DEFAULT_PARENT}: {reason_of(error)}"
        ) from error
    return path, len(content)


def _free_name() -> Path:
    now = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    for suffix in ("", *(f"-{number}" for number in range(2, 100))):
        path = DEFAULT_PARENT / f"{now}{suffix}{PAGE}"
        if not os.path.lexists(path):
            return path
    raise RunFailedError(f"cannot find a free name in {DEFAULT_PARENT}")


def check_frame(output: Output, slots: int) -> None:
    """Raise InputError where a picture is of a later slot, or a moving one of too many."""
    if output.frame is not None and output.frame > slots:
        raise InputError(f"--frame {output.frame}: the last slot is {slots}")
    if output.kind in MOVING:
        frame_slots(slots, output.every)


def _content(document: ReplayDocument, output: Output, listener: ReplayListener) -> bytes:
    check_frame(output, document.slots)
    if output.kind == PAGE:
        text = json.dumps(document.to_json(), ensure_ascii=False, allow_nan=False)
        return page_html(text, document.title).encode()
    scene, width_px = unpack(document), output.width_px or WIDTH_PX
    if output.kind == STILL:
        return still_png(scene, document.slots if output.frame is None else output.frame, width_px)
    shown = frame_slots(document.slots, output.every)
    listener.begins("pictures", len(shown))
    return animation(
        scene,
        shown,
        output.kind.removeprefix("."),
        width_px,
        output.frames_per_s or FRAMES_PER_S,
        listener.advances,
    )
