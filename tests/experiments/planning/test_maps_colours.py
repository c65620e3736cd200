"""The colours of drones, as people with each kind of colour vision see them."""

import itertools

import numpy as np
import pytest

from orchid_uav.experiments.pages import DARK_PAGE, WHITE_PAGE
from orchid_uav.experiments.planning.maps.colours import (
    ON_DARK,
    ON_WHITE,
    colour_numbers,
)
from tests.helpers.plans import make_plan

VISIONS = {
    "usual": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
"""Machado, Oliveira and Fernandes (2009), severity 1, for linear RGB."""
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.072175],
        [0.0193339, 0.119192, 0.9503041],
    ]
)


def linear(colour):
    channels = np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)]) / 255.0
    return np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)


def contrast(one, other):
    """WCAG 2.2."""
    dark, light = sorted(float(linear(colour) @ TO_XYZ[1]) for colour in (one, other))
    return (light + 0.05) / (dark + 0.05)


def lab(rgb):
    """CIELAB under D65."""
    scaled = TO_XYZ @ np.clip(rgb, 0.0, 1.0) / (0.95047, 1.0, 1.08883)
    bent = np.where(scaled > 0.008856, np.cbrt(scaled), 7.787 * scaled + 16.0 / 116.0)
    return np.array([116 * bent[1] - 16, 500 * (bent[0] - bent[1]), 200 * (bent[1] - bent[2])])


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("colours", [ON_WHITE, ON_DARK], ids=["white", "dark"])
def test_any_two_can_be_told_apart(vision, colours):
    seen = [lab(np.array(VISIONS[vision]) @ linear(colour)) for colour in colours]
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(one - other) >= 20.0


@pytest.mark.parametrize(("page", "colours"), [(WHITE_PAGE, ON_WHITE), (DARK_PAGE, ON_DARK)])
def test_each_stands_out_from_the_page(page, colours):
    assert contrast("#000000", "#FFFFFF") == pytest.approx(21.0)
    for colour in colours:
        assert contrast(page, colour) >= 3.0


def test_six_drones_have_six_colours():
    assert sorted(colour_numbers(make_plan(6).stations)) == [0, 1, 2, 3, 4, 5]


def test_of_many_drones_neighbours_look_different():
    stations = make_plan(100, 2000, across_m=9000.0, greatest_weight=1).stations
    numbers = colour_numbers(stations)
    places = np.array([(station.east_m, station.north_m) for station in stations])
    alike = sum(
        numbers[index] == numbers[int(np.argsort(np.hypot(*(places - place).T))[1])]
        for index, place in enumerate(places)
    )
    assert alike <= 5  # by chance it were 17
    assert set(numbers) == set(range(6))
