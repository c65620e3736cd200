"""Pictures of a replay: what they show, and what their files say."""

import io

import numpy as np
import pytest
from PIL import Image

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.maps.colours import ON_WHITE
from orchid_uav.experiments.replay.animation import animation, frame_slots, still_png
from orchid_uav.experiments.replay.drawing import Painter
from orchid_uav.experiments.replay.packing import pack_states
from orchid_uav.experiments.replay.scene import unpack
from tests.helpers.replays import AREA_M, made_up_replay

WIDTH_PX = 420


@pytest.fixture(scope="module")
def scene():
    return unpack(made_up_replay().document)


def opened(content):
    return Image.open(io.BytesIO(content))


def pixels_of(picture, colour):
    """How many pixels have a colour, and where they are in the mean: (column, row)."""
    wanted = [int(colour[place : place + 2], 16) for place in (1, 3, 5)]
    rows, columns = np.nonzero((np.abs(picture.astype(int) - wanted) <= 6).all(axis=2))
    return len(rows), (columns.mean(), rows.mean()) if len(rows) else (np.nan, np.nan)


def test_a_gif_begins_again_and_shows_every_slot_asked_for(scene):
    slots = frame_slots(scene.slots, 6)
    assert slots == [0, 6, 12, 18, 24, 30, 36, 40]
    told = []
    content = animation(scene, slots, "gif", WIDTH_PX, 8.0, lambda: told.append(1))
    picture = opened(content)
    assert (picture.format, picture.n_frames, picture.width) == ("GIF", 8, WIDTH_PX)
    assert picture.info["loop"] == 0 and len(told) == 8
    painter = Painter(scene, WIDTH_PX)
    painted = np.stack([painter.paint(slot).copy() for slot in slots]).astype(int)
    for number in range(len(slots)):
        picture.seek(number)
        assert picture.info["duration"] == pytest.approx(125, abs=5)  # in hundredths
        apart = np.abs(np.asarray(picture.convert("RGB")) - painted).mean(axis=(1, 2, 3))
        assert apart[number] < 3.0
        assert (np.delete(apart, number) > apart[number]).all()


def test_a_webp_has_as_many_pictures(scene):
    picture = opened(animation(scene, [0, 20, 40], "webp", WIDTH_PX, 4.0))
    assert (picture.format, picture.n_frames, picture.width) == ("WEBP", 3, WIDTH_PX)
    assert picture.info["loop"] == 0


@pytest.mark.parametrize("width_px", [200, 421, 1000])
def test_a_png_is_the_picture_of_its_slot(scene, width_px):
    picture = np.asarray(opened(still_png(scene, 20, width_px)))
    assert picture.shape[1] == width_px
    np.testing.assert_array_equal(picture, Painter(scene, width_px).paint(20))
    assert (picture != Painter(scene, width_px).paint(21)).any()


def test_the_order_of_slots_does_not_matter(scene):
    forth, back = Painter(scene, WIDTH_PX), Painter(scene, WIDTH_PX)
    pictures = {slot: forth.paint(slot) for slot in (0, 10, 40)}
    for slot in (40, 0, 10):
        np.testing.assert_array_equal(back.paint(slot), pictures[slot])


def test_a_drone_that_flies_east_and_north_goes_right_and_up():
    made = made_up_replay(flights=1, users=1)
    (flight,) = made.document.flights
    ways_m = np.full((41, 4, 3), -1e5)  # out of sight
    ways_m[:, 0] = np.linspace([400.0, 300.0, 100.0], [1600.0, 1200.0, 100.0], 41)
    flight.drones.positions = pack_states(ways_m, 0.1)
    flight.association = pack_states(np.full((41, 1), -1), 1.0)
    made.document.masts = []
    scene = unpack(made.document)
    painter = Painter(scene, 800)
    begin, end = (pixels_of(painter.paint(slot), ON_WHITE[0])[1] for slot in (1, 40))
    # Its trail is behind it.
    assert end[0] - begin[0] > 0.25 * 800
    assert begin[1] - end[1] > 0.25 * 800 * 0.75 * AREA_M[1] / AREA_M[0]


def test_people_have_the_colour_of_whom_they_are_served_by(scene):
    made = made_up_replay(flights=1, users=30)
    (flight,) = made.document.flights
    counts = []
    for drone in (1, 2):
        flight.association = pack_states(np.full((41, 30), drone), 1.0)
        picture = Painter(unpack(made.document), 800).paint(5)
        counts.append([pixels_of(picture, ON_WHITE[other])[0] for other in (1, 2)])
    assert counts[0][0] > 3 * counts[1][0] and counts[1][1] > 3 * counts[0][1]


def test_titles_that_nobody_foresaw_are_drawn():
    """Warnings are errors here, and formulas would be set."""
    document = made_up_replay().document
    document.title = "$x^2$ \N{FIRE} 中文 </script> " * 300
    document.flights[0].label = "$\\frac{" * 50
    assert opened(still_png(unpack(document), 3, WIDTH_PX)).width == WIDTH_PX


def test_the_worst_off_is_the_farthest_of_those_with_the_least_rate(scene):
    flight = scene.flights[0]
    everybody = np.ones(30, np.bool_)
    found = flight.worst_off(7, scene.users_m[7], everybody)
    assert flight.rates_bps[7, found] == flight.rates_bps[7].min()
    alike = np.flatnonzero(flight.rates_bps[7] == flight.rates_bps[7].min())
    away_m = np.linalg.norm(
        scene.users_m[7, alike] - flight.drones_m[7, flight.association[7, alike], :2], axis=1
    )
    assert found == alike[away_m.argmax()]
    assert flight.worst_off(7, scene.users_m[7], ~everybody) is None


def test_the_pictures_of_a_moving_one_are_counted():
    assert frame_slots(1000, None) == [*range(0, 1000, 10), 1000]
    assert frame_slots(3, None) == [0, 1, 2, 3]
    with pytest.raises(InputError, match=r"50,001 pictures .* as in --every 500"):
        frame_slots(50_000, 1)
