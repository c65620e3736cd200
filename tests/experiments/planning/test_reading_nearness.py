"""Positions that cannot belong to the others, by distances that were reckoned by hand."""

import math
from pathlib import Path

import numpy as np
import pymap3d.vincenty
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.nearness import (
    check_nearness,
    middle_of,
    middle_of_box,
)
from orchid_uav.experiments.planning.reading.table import PeopleTable


def table_of(*places: tuple[float, float], on_earth: bool = True) -> PeopleTable:
    return PeopleTable(
        path=Path("people.csv"),
        coordinates=np.array(places, float),
        on_earth=on_earth,
        weights=np.ones(len(places), np.int64),
        sources=tuple(f"people.csv, row {row}" for row in range(2, 2 + len(places))),
        notes=(),
    )


def refusal(*places: tuple[float, float], on_earth: bool = True) -> str:
    with pytest.raises(InputError) as caught:
        check_nearness(table_of(*places, on_earth=on_earth))
    return str(caught.value)


TOWN = [(17.30, -62.72), (17.31, -62.71), (17.29, -62.73), (17.30, -62.70)]


def test_those_that_lie_elsewhere_are_named():
    message = refusal(*TOWN, (18.30, -62.72), (48.86, 2.35))
    first, *others = message.splitlines()
    assert "people.csv has 2 mistakes" in first
    assert "row 7: 48.86, 2.35 is 6,7" in others[0]  # Paris; the furthest comes first
    assert "row 6: 18.3, -62.72 is 110 km from the others" in others[1]  # 0.995 degrees
    assert len(others) == 2


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ((-62.72, 17.30), "latitude and longitude seem to be swapped, for 17.3, -62.72 lies among"),
        ((17.30, 62.72), "a sign of the longitude seems to be wrong"),
        ((-17.30, -62.72), "a sign of the latitude seems to be wrong"),
        ((0.0, 0.0), "devices write 0, 0 where they do not know"),
    ],
)
def test_hints_at_what_happened(wrong, told):
    assert told in refusal(*TOWN, wrong)


def test_no_hint_where_there_is_none():
    assert refusal(*TOWN, (48.86, 2.35)).endswith("across")


def test_two_towns_are_not_called_mistakes():
    there = [(lat + 1, lon) for lat, lon in TOWN]
    message = refusal(*TOWN, *there)
    assert "people 112.9 km apart" in message  # 1.02 degrees
    assert "make a plan for each part" in message
    assert "row 4" in message and "row 7" in message


def test_most_people_are_not_called_mistakes():
    places = [(0, 0)] * 3 + [(100_000, 0)] * 2 + [(-100_000, 0)] * 2
    assert "people 200.0 km apart" in refusal(*places, on_earth=False)


@pytest.mark.parametrize(
    ("one", "other"),
    [((0.0, 0.0), (0.0, 180.0)), ((45.0, 10.0), (-45.0, -170.0)), ((10.0, 0.0), (12.0, 0.0))],
)
def test_two_people_far_apart(one, other):
    assert "row 2" in refusal(one, other)
    assert "row 3" in refusal(one, other)


# 50 km: 0.449 degrees of latitude; longitudes are 111.3 km · cos(latitude) wide.
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("longitude", [0.0, -62.7, 179.99, -179.9])
@pytest.mark.parametrize("latitude", [0.0, 35.0, 70.0, 80.0, 85.0, 89.0])
def test_degrees_are_not_distances(latitude, longitude, sign):
    radius_m = 6_378_137 / math.sqrt(1 - 0.00669438 * math.sin(math.radians(latitude)) ** 2)
    wide_deg = math.degrees(50_000 / radius_m / math.cos(math.radians(latitude)))

    def pair(share: float) -> list[tuple[float, float]]:
        half = share * wide_deg / 2
        turned = [(longitude + step + 180) % 360 - 180 for step in (-half, 0.0, half)]
        return [(sign * latitude, one) for one in turned]

    check_nearness(table_of(*pair(0.99)))
    # Near a pole the straight way is a little shorter than the parallel.
    assert "km apart" in refusal(*pair(1.02))


def test_metres():
    check_nearness(table_of((0, 0), (30_000, 39_999), on_earth=False))
    message = refusal((600_000.0, 4e6), (630_000.0, 4_040_001.0), on_earth=False)
    assert "people 50.0 km apart" in message
    message = refusal((600_000.0, 4_040_001.0), (630_000.0, 4e6), on_earth=False)
    assert "people 50.0 km apart" in message
    assert "row 3: 100000.0, 0.0 is 100 km" in refusal(
        (0, 0), (100_000, 0), (1, 1), (2, 2), on_earth=False
    )


def test_no_position_is_over_half_of_the_limit_from_all_and_yet_the_site_is_too_large():
    # A ring: every point is 30 km from the middle, and 60 km from the opposite one.
    ring = [
        (30_000 * math.cos(angle), 30_000 * math.sin(angle)) for angle in np.linspace(0, 6.2, 50)
    ]
    assert "people 60.0 km apart" in refusal(*ring, on_earth=False)
    check_nearness(table_of(*[(0.83 * x, 0.83 * y) for x, y in ring], on_earth=False))


@settings(deadline=None, max_examples=50)
@given(latitude=st.floats(-89, 89), longitude=st.floats(-180, 180), far=st.floats(0.001, 2.0))
def test_distances_are_those_on_the_ellipsoid(latitude, longitude, far):
    other = latitude - math.copysign(far, latitude), (longitude + far + 180) % 360 - 180
    middle = middle_of(np.array([[latitude, longitude]]), on_earth=True)
    found_m = middle.distances_m(np.array([other]))[0]
    expected_m, _ = pymap3d.vincenty.vdist(latitude, longitude, *other)
    assert found_m == pytest.approx(float(expected_m), rel=0.01)


@pytest.mark.parametrize(
    ("longitudes", "middle"),
    [([10.0, 12.0], 11.0), ([179.0, -179.0], 180.0), ([-179.9, 179.7], 179.9), ([-180, 180], 180)],
)
def test_the_middle_of_a_box_lies_in_it(longitudes, middle):
    places = np.array([(60.0 + place, one) for place, one in enumerate(longitudes)], float)
    latitude, longitude = middle_of_box(places, on_earth=True)
    assert latitude == 60.5
    assert -180 <= longitude <= 180
    assert (longitude - middle) % 360 == pytest.approx(0, abs=1e-9) or (
        longitude - middle
    ) % 360 == pytest.approx(360, abs=1e-9)
