"""The map of the report: everything in its place, to scale, and nobody left out."""

import dataclasses
import re

import numpy as np
import pytest
import shapely

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.maps.dots import speeds_of
from orchid_uav.experiments.planning.maps.frame import WIDTH, frame_of, round_length_m
from orchid_uav.experiments.planning.maps.map_svg import label_of, map_svg
from orchid_uav.experiments.planning.maps.report import report_html
from orchid_uav.experiments.planning.model import People
from tests.helpers.plans import make_plan

PLAN = make_plan(masts=2, seed=2)
STEP = re.compile(r"m(-?\d+) ?(-?\d+)h1")


def group_of(drawing, pattern):
    """The content of a group that holds no other."""
    return re.search(rf'<g class="{pattern}">(.*?)</g>', drawing).group(1)


def dots_of(group):
    """Where the dots of a group are; holes of dots are left out."""
    places = []
    for path in re.findall(r"<path [^>]*>", group):
        if 'class="core"' in path:
            continue
        at = np.zeros(2, int)
        for step in STEP.findall(path):
            at = at + np.array(step, int)
            places.append(tuple(at.tolist()))
            at = at + np.array([1, 0])
    return places


def crosses_of(drawing):
    paths = re.findall(r'<path d="M([\d -]*)" marker-start', drawing)
    numbers = [np.array(path.split(), int).reshape(-1, 2).tolist() for path in paths]
    return [tuple(place) for part in numbers for place in part]


def units_of(plan, server):
    positions_m = plan.people.positions_m[plan.server == server]
    return {tuple(place) for place in frame_of(plan).units(positions_m).astype(int).tolist()}


class TestPeople:
    @pytest.mark.parametrize("drone", range(6))
    def test_each_is_a_dot_in_the_group_of_the_drone_that_serves_them(self, drone):
        group = group_of(map_svg(PLAN), rf"dots drone h{drone} k\d")
        assert sorted(dots_of(group)) == sorted(units_of(PLAN, drone))

    def test_those_of_masts_have_a_group_each(self):
        groups = re.findall(r'<g class="dots by-mast">(.*?)</g>', map_svg(PLAN))
        assert [sorted(dots_of(group)) for group in groups] == [
            sorted(units_of(PLAN, mast)) for mast in (6, 7)
        ]

    def test_those_not_served_are_crosses(self):
        crosses = crosses_of(map_svg(PLAN))
        assert sorted(crosses) == sorted(units_of(PLAN, NOBODY))
        assert len(crosses) > 0

    def test_dots_of_slow_people_have_a_hole(self):
        slow = (PLAN.rates_bps < 500e3) & (PLAN.server != NOBODY)
        assert 0 < slow.sum() < len(slow)
        holes = re.findall(r'<path d="([^"]*)" class="core"', map_svg(PLAN))
        assert sum(len(STEP.findall(hole)) for hole in holes) == slow.sum()

    def test_without_a_wish_a_round_rate_above_the_median_parts_them(self):
        plan = make_plan(want=None)
        assert 500e3 < np.median(plan.rates_bps[plan.server != NOBODY]) < 1e6
        speeds = speeds_of(plan)
        assert (speeds.middling_bps, speeds.fast_bps) == (500e3, 1e6)
        rates_bps = np.array([0.0, 499e3, 500e3, 999e3, 1e6])
        assert speeds.classes(rates_bps).tolist() == [0, 0, 1, 1, 2]

    def test_nobody_served_is_drawn_too(self):
        nobody = np.full(len(PLAN.server), NOBODY)
        plan = dataclasses.replace(PLAN, server=nobody, rates_bps=np.zeros(len(nobody)))
        assert len(crosses_of(map_svg(plan))) == len(units_of(plan, NOBODY))

    def test_people_at_one_place_are_one_dot(self):
        people = People(np.zeros((40, 2)), np.ones(40, np.int64))
        server = np.zeros(40, np.int64)
        alike = {"people": people, "server": server, "rates_bps": np.full(40, 1e6)}
        plan = dataclasses.replace(PLAN, **alike)
        assert len(dots_of(group_of(map_svg(plan), r"dots drone h0 k\d"))) == 1


class TestTheWindow:
    @pytest.mark.parametrize(
        "plan",
        [
            PLAN,
            make_plan(1, 1, 0, zone=False, ways=False),
            make_plan(center=None, across_m=40_000.0),
            make_plan(across_m=3.0),
        ],
        ids=["usual", "one person", "large", "tiny"],
    )
    def test_it_shows_all_that_is_planned(self, plan):
        frame = frame_of(plan)
        points_m = np.concatenate(
            [
                plan.people.positions_m,
                [(station.east_m, station.north_m) for station in plan.stations],
                [plan.surroundings.home_m],
                *([(mast.east_m, mast.north_m)] for mast in plan.surroundings.masts),
            ]
        )
        units = frame.units(points_m)
        assert (units >= 0).all()
        assert (units <= (WIDTH, frame.height)).all()
        assert 0.45 * WIDTH < frame.height < 0.85 * WIDTH

    def test_north_is_up_and_east_is_right(self):
        frame = frame_of(PLAN)
        (west, south), (east, north) = frame.units(np.array([[-100.0, -100.0], [100.0, 100.0]]))
        assert north < south
        assert west < east
        assert south - north == pytest.approx(east - west, abs=1)

    def test_a_huge_area_does_not_make_people_tiny(self):
        huge = shapely.box(-1e5, -1e5, 1e5, 1e5)
        surroundings = dataclasses.replace(PLAN.surroundings, area=huge, no_fly=huge.buffer(-9e4))
        plan = dataclasses.replace(PLAN, surroundings=surroundings)
        frame = frame_of(plan)
        assert frame.units_per_m > 1.0
        numbers = re.findall(r"[ML](-?\d+) (-?\d+)", map_svg(plan))
        places = np.array(numbers, int)
        assert (places >= -300).all()  # outlines of people end a little beyond the outermost
        assert (places <= WIDTH + 300).all()

    def test_the_scale_bar_is_as_long_as_it_says(self):
        frame = frame_of(PLAN)
        bar = re.search(r'class="scale-bar">(.*?)</g></g>', map_svg(PLAN)).group(1)
        length = int(re.search(r"V0H(\d+)V", bar).group(1))
        number, unit = re.search(r">([\d.]+)\xa0(k?m)<", bar).groups()
        length_m = float(number) * (1000.0 if unit == "km" else 1.0)
        assert length == pytest.approx(length_m * frame.units_per_m, abs=1)
        assert 0.09 < length / WIDTH <= 0.25

    @pytest.mark.parametrize(
        ("longest_m", "length_m"), [(999.0, 500.0), (1000.0, 1000.0), (4999.0, 2000.0), (9.0, 5.0)]
    )
    def test_its_length_is_round(self, longest_m, length_m):
        assert round_length_m(longest_m) == length_m


class TestWhatIsDrawn:
    def test_circles_are_to_scale(self):
        frame = frame_of(PLAN)
        drawing = map_svg(PLAN)
        circles = group_of(drawing, "circles")
        outlines = re.findall(r'd="([^"]*)"', circles)
        assert len(outlines) == 6
        for outline, station in zip(outlines, PLAN.stations, strict=True):
            corners = np.array(re.findall(r"[ML](-?\d+) (-?\d+)", outline), int)
            middle = frame.units(np.array([[station.east_m, station.north_m]]))[0]
            radii = np.hypot(*(corners - middle).T)
            assert radii == pytest.approx(station.circle_radius_m * frame.units_per_m, abs=2)

    def test_the_outline_of_a_drone_holds_all_its_people(self):
        outlines = re.findall(r'd="([^"]*)"', group_of(map_svg(PLAN), "cells"))
        assert len(outlines) == 6
        for drone, outline in enumerate(outlines):
            corners = np.array(re.findall(r"[ML](-?\d+) (-?\d+)", outline), int)
            cell = shapely.Polygon(corners)
            people = shapely.MultiPoint(list(units_of(PLAN, drone)))
            assert cell.contains(people)
            assert people.convex_hull.buffer(90.0).contains(cell)

    def test_zones_ways_masts_and_home_are_there_if_there_are_any(self):
        drawing, bare = map_svg(PLAN), map_svg(make_plan(masts=0, zone=False, ways=False))
        for kind, count in {'class="mast"': 2, "No-fly zone": 1, 'class="home"': 1}.items():
            assert drawing.count(kind) == count
        assert len(re.findall("<path", group_of(drawing, "ways"))) == 6
        for kind, count in {'class="mast"': 0, "No-fly zone": 0, 'class="home"': 1}.items():
            assert bare.count(kind) == count

    def test_drones_with_the_same_colour_have_different_forms(self):
        drawing = map_svg(make_plan(24, 400))
        form = r'class="station point drone h\d+ (k\d)">.*?<path d="([^"]*)" class="pin"'
        marks = re.findall(form, drawing)
        assert len(marks) == 24
        assert len(set(marks)) == 24

    @pytest.mark.parametrize(
        ("name", "label"), [("uav_0", "0"), ("uav_17", "17"), ("rescue", "3"), ("x\u0663", "3")]
    )
    def test_a_mark_is_labelled_by_the_number_of_its_name(self, name, label):
        assert label_of(PLAN.stations[0]._replace(name=name), 3) == label

    def test_a_mark_tells_its_drone_when_pointed_at(self):
        drawing = map_svg(PLAN).replace("\xa0", " ")
        for drone in PLAN.document.drones:
            assert f"<title>{drone.id}: {drone.people} people, the slowest with" in drawing

    def test_a_drone_stands_out_when_it_or_its_row_is_pointed_at(self):
        page = report_html(PLAN)
        for drone in range(6):
            assert f"body:has(.point.h{drone}:hover) .map .drone:not(.h{drone})" in page
            assert len(re.findall(rf'class="(station )?point( drone)? h{drone}( k\d)?"', page)) == 2

    def test_home_at_a_mast_is_drawn_beside_it(self):
        mast = PLAN.surroundings.masts[0]
        at_mast = dataclasses.replace(PLAN.surroundings, home_m=(mast.east_m, mast.north_m))
        drawing = map_svg(dataclasses.replace(PLAN, surroundings=at_mast))
        assert 'transform="translate(-21 4)"' in drawing
        assert 'transform="translate(-21 4)"' not in map_svg(PLAN)
