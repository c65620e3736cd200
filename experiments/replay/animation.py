"""Moving pictures and single frames of a replay, as GIF, WebP and PNG."""

import io
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from PIL import Image

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.replay.drawing import Painter, Pixels
from orchid_uav.experiments.replay.scene import Scene

MOST_FRAMES = 2000
"""Of a moving picture."""
USUAL_FRAMES = 100
_SAMPLES, _COLOURS = 6, 128
"""Frames from which the colours of a GIF are chosen, and their number."""
_QUALITY, _EFFORT = 80, 4
"""Of a WebP, from 0 to 100, and from 0 to 6."""


def frame_slots(slots: int, every: int | None) -> list[int]:
    """The slots that a moving picture shows: every so many, and the last one.

    Args:
        slots: the replay's last slot.
        every: slots from picture to picture; by default as many as make some hundred pictures.

    Raises:
        InputError: that would be too many pictures.
    """
    step = every or -(-slots // USUAL_FRAMES)
    shown = [*range(0, slots, step), slots]
    if len(shown) > MOST_FRAMES:
        raise InputError(
            f"{len(shown):,} pictures are more than the {MOST_FRAMES:,} of a moving picture: "
            f"show only every few slots, as in --every {-(-slots // USUAL_FRAMES)}"
        )
    return shown


def still_png(scene: Scene, slot: int, width_px: int) -> bytes:
    """The picture of one slot as PNG."""
    return _encoded(Image.fromarray(Painter(scene, width_px).paint(slot)), "PNG")


def animation(
    scene: Scene,
    slots: Sequence[int],
    kind: str,
    width_px: int,
    frames_per_s: float,
    drawn: Callable[[], None] = lambda: None,
) -> bytes:
    """A moving picture that begins again at its end.

    Args:
        scene: the replay.
        slots: those that are shown.
        kind: ``gif`` or ``webp``.
        width_px: of the picture.
        frames_per_s: pictures per second; formats count in whole hundredths (GIF) or thousandths.
        drawn: called after each picture.
    """
    painter = Painter(scene, width_px)

    def pictures() -> Iterator[Image.Image]:
        for slot in slots:
            yield Image.fromarray(painter.paint(slot))
            drawn()

    shown = pictures()
    options = {"save_all": True, "duration": round(1000.0 / frames_per_s), "loop": 0}
    if kind == "webp":
        first = next(shown)
        return _encoded(
            first, "WEBP", append_images=shown, quality=_QUALITY, method=_EFFORT, **options
        )
    palette = _palette([painter.paint(slot) for slot in _samples(slots)])
    reduced = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in shown)
    return _encoded(next(reduced), "GIF", append_images=reduced, optimize=False, **options)


def _samples(slots: Sequence[int]) -> list[int]:
    chosen = np.linspace(0, len(slots) - 1, min(_SAMPLES, len(slots))).round().astype(int)
    return [slots[place] for place in chosen]


def _palette(pictures: Sequence[Pixels]) -> Image.Image:
    """One palette for all frames: with one for each, still parts would flicker."""
    together = Image.fromarray(np.concatenate(pictures))
    return together.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _encoded(picture: Image.Image, kind: str, **options: object) -> bytes:
    content = io.BytesIO()
    picture.save(content, kind, **options)
    return content.getvalue()
