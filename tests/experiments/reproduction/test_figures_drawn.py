"""Figures of rows whose effects are known: what they show, and what they say in words."""

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.figures import convergence, scaling, strategy
from orchid_uav.experiments.reproduction.figures.all_figures import TRAINED, axes, draw_figures
from orchid_uav.experiments.reproduction.figures.convergence import draw_convergence
from orchid_uav.experiments.reproduction.figures.drawn import (
    extremes_text,
    listed_text,
    missing_text,
)
from orchid_uav.experiments.reproduction.figures.scaling import FAMILIES, draw_scaling
from orchid_uav.experiments.reproduction.figures.strategy import draw_strategy
from orchid_uav.experiments.reproduction.job import HOVERING, RULES
from orchid_uav.experiments.reproduction.settings import base, uavs, users
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from tests.helpers.reproductions import EFFICIENCY, make_row, make_rows

FIG3, _, FIG7 = TRAINED
FIG4 = next(axes())


@pytest.fixture(scope="module")
def rows():
    """Two of the paper's methods with three seeds, and two rules."""
    some = list(make_rows(["orchid", "maddpg-mmf"], SEEDS[:3], ["static-pf", "best-response"]))
    return [row for row in some if row.method != "static-mmf"]


@pytest.fixture(scope="module")
def long():
    """Both objectives with two seeds, and one of the two ways of hovering."""
    own = list(make_rows(["orchid-long", "orchid-pf"], SEEDS[:2], ["static-mmf"]))
    return [row for row in own if row.method != "static-pf"]


def texts_of(path):
    return "".join(ET.parse(path).getroot().itertext())


class TestWords:
    def test_name_the_highest_and_the_lowest_as_they_are_shown(self):
        told = extremes_text(EFFICIENCY, {"a": 0.2e6, "b": 0.31e6, "c": 0.25e6})
        assert told == "highest b 0.310 Mbit/J, lowest a 0.200 Mbit/J"

    def test_list_all_from_the_highest_on(self):
        values = {"a": 0.7, "b": np.nan, "c": 0.9, "d": 0.70001}
        assert listed_text("rate_jfi", values) == "c 0.900, d and a 0.700"

    def test_make_no_difference_that_cannot_be_seen(self):
        assert extremes_text("coverage", {"a": 1.0, "b": 0.99999}) == "all 1.000"

    def test_name_all_that_are_shown_alike(self):
        values = {"a": 1.0, "b": 0.9, "c": 0.99999, "d": 0.90001, "e": 0.95}
        assert extremes_text("coverage", values) == "highest a and c 1.000, lowest b and d 0.900"
        many = dict.fromkeys("abcd", 1.0) | {"e": 0.9}
        assert extremes_text("coverage", many) == "highest 4 methods 1.000, lowest e 0.900"

    def test_leave_out_what_is_not_known(self):
        told = extremes_text("rate_jfi", {"a": np.nan, "b": 0.5})
        assert told == "b 0.500"
        assert extremes_text("rate_jfi", {"a": np.nan}) == "not measured"

    def test_tell_methods_and_seeds_that_are_missing(self):
        told = missing_text({"a": 10, "b": 7}, ["a", "b", "c"], 10)
        assert told == "Missing: c. Fewer than 10 seeds: b 7."
        assert missing_text({"a": 10}, ["a"], 10) == ""


class TestLearningCurves:
    def test_are_interquartile_means_of_seeds_with_a_band_from_five_on(self):
        rows = [make_row("orchid", seed) for seed in SEEDS[:5]]
        sheet = convergence._Sheet({"orchid": rows}, "")
        curve = sheet.trained["rate_jfi"]["orchid"]
        table = np.sort([row.curve.mean["rate_jfi"] for row in rows], axis=0)
        np.testing.assert_allclose(curve.values, table[1:4].mean(axis=0))
        assert (curve.band[0] <= curve.values).all()
        assert (curve.values <= curve.band[1]).all()
        np.testing.assert_array_equal(curve.episodes[:2], [5.0, 15.0])
        fewer = convergence._Sheet({"orchid": rows[:4]}, "")
        assert fewer.trained["rate_jfi"]["orchid"].band is None

    def test_show_the_policy_without_noise_where_it_was_flown(self):
        sheet = convergence._Sheet({"orchid": [make_row("orchid", 10)]}, "")
        curve = sheet.flown["reward"]["orchid"]
        np.testing.assert_array_equal(curve.episodes, np.arange(50.0, 701.0, 50.0))

    def test_are_drawn_with_what_is_there(self, rows, tmp_path):
        figure = draw_convergence(FIG3, rows, 10, tmp_path)
        assert "Missing: orchid-no-rf, maddpg-pf, static-mmf." in figure.caption
        assert "Fewer than 10 seeds: orchid 3, maddpg-mmf 3, static-pf 3." in figure.caption
        shown = texts_of(figure.path)
        for label in ("orchid (trained with 3 seeds)", "static-pf (topologies of 3 seeds)"):
            assert label in shown
        assert "orchid-no-rf" not in shown

    def test_tell_the_end_of_training(self, rows, tmp_path):
        figure = draw_convergence(FIG3, rows, 10, tmp_path)
        ends = {
            method: np.mean(
                [
                    row.curve.mean["reward"][-5:]
                    for row in rows
                    if row.method == method and row.curve
                ]
            )
            for method in ("orchid", "static-pf")
        }
        [told] = re.findall("episodes of training: ([^;]*); orchid begins at", figure.alternative)[
            :1
        ]
        for method, end in ends.items():
            assert re.search(rf"\b{method}(?: and [a-z-]+)* {end:.1f}\b", told)

    def test_are_left_out_without_a_training(self, rows, tmp_path):
        rules = [row for row in rows if row.seed is None]
        assert draw_convergence(FIG7, rules, 10, tmp_path) is None
        assert not list(tmp_path.iterdir())


class TestMethodsOverAnAxis:
    def test_every_method_that_flies_the_axes_is_drawn(self):
        drawn = {label for labels in FAMILIES.values() for label in labels}
        wide = {
            key for key, training in TRAININGS.items() if training.flown in ("everything", "tcp")
        }
        hovering = {one.rule for one in HOVERING.values()}
        assert wide | set(RULES) | hovering | {"orchid-informed"} <= drawn
        twins = {label for label in drawn if label.endswith("-zero")}
        assert {f"{key}-zero" for key in ("orchid", "maddpg-pf", "maddpg-mmf")} <= twins

    def test_there_are_all_axes_with_both_kinds_of_users_and_both_headings(self):
        found = {axis.key: axis for axis in axes()}
        assert list(found) == [
            *("fig4_tcp", "fig4_uniform", "fig5_tcp", "fig5_uniform"),
            *("fig6_tcp_1s", "fig6_tcp_20s", "fig6_uniform_1s", "fig6_uniform_20s"),
        ]
        assert list(found["fig4_uniform"].places.values()) == users("uniform")
        assert list(found["fig5_tcp"].places.items())[-1] == (10.0, uavs("tcp")[-1])
        assert set(found["fig6_tcp_20s"].places) == {0.0, 5.0, 10.0, 15.0}

    def test_are_means_over_seeds_with_both_spreads(self, rows):
        sheet = scaling._Sheet(FIG4, rows)
        point = sheet.curves["rate_jfi"]["orchid"][200.0]
        pairs = [
            row.find(users("tcp")[-1]).metrics["rate_jfi"] for row in rows if row.method == "orchid"
        ]
        means, stds = np.transpose(pairs)
        assert point == pytest.approx((means.mean(), stds.mean(), np.std(means, ddof=1)))
        rule = sheet.curves["rate_jfi"]["best-response"][200.0]
        assert rule == pytest.approx((0.97, 0.04, 0.0))

    def test_twins_are_drawn_though_one_seed_alone_flew_them(self, rows):
        sheet = scaling._Sheet(FIG4, rows)
        assert set(sheet.curves["rate_jfi"]["orchid-zero"]) == set(FIG4.places)

    def test_figure_says_what_it_shows_and_lacks(self, rows, tmp_path):
        figure = draw_scaling(FIG4, rows, 10, tmp_path)
        assert "Missing: orchid-no-rf, maddpg-pf." in figure.caption
        assert "Fewer than 10 seeds: orchid 3, maddpg-mmf 3." in figure.caption
        assert "Rate JFI in the mean over the axis: highest best-response 0.970" in (
            figure.alternative
        )
        assert re.search(
            r"Rate JFI [^.]*[^:]*From 50 users to 200 users: [^:]*orchid 0\.7\d\d to 0\.7\d\d; ",
            figure.alternative,
        )
        shown = texts_of(figure.path)
        for title in ("The paper's methods", "orchid-zero", "best-response"):
            assert title in shown
        assert "maddpg-pf" not in shown
        # All of them cover all users: their curves lie on each other, and the figure says so.
        assert "Identical in coverage alone: orchid, maddpg-mmf, static-pf" in shown.replace(
            "\n", " "
        )

    def test_is_left_out_where_an_axis_has_one_place(self, tmp_path):
        row = make_row("orchid", 10)
        only = row.model_copy(update={"flights": [row.find(base("tcp"))]})
        assert draw_scaling(FIG4, [only], 10, tmp_path) is None


class TestBothObjectives:
    def test_figure_shows_every_topology_of_every_seed(self, long, tmp_path):
        figure = draw_strategy(long, 10, tmp_path)
        assert "Missing: static-pf. Fewer than 10 seeds: orchid-long 2, orchid-pf 2." in (
            figure.caption
        )
        cases = [row.find(base("tcp")) for row in long if row.method == "orchid-long"]
        worst = np.mean([case.topologies["worst_rate_bps"] for case in cases]) / 1e6
        assert f"Mean worst user's rate: max-min (orchid-long) {worst:.2f} Mbit/s" in (
            figure.alternative
        )

    def test_distribution_is_that_of_the_topologies(self, long):
        flown = {"orchid-pf": strategy._flown(long, "orchid-pf")}
        figure = strategy._Sheet(flown).draw()
        axes = next(one for one in figure.axes if one.get_ylabel() == "share of topologies")
        values, shares = axes.lines[0].get_data()
        assert len(values) == 40
        middle = np.interp(0.5, shares, values)
        drawn = [v for case in flown["orchid-pf"] for v in case.topologies["worst_rate_bps"]]
        below = np.mean(np.array(drawn) * METRICS["worst_rate_bps"].scale <= middle)
        assert below == pytest.approx(0.5, abs=0.03)

    def test_figure_is_left_out_where_neither_was_trained(self, rows, tmp_path):
        assert draw_strategy(rows, 10, tmp_path) is None


def test_no_rows_make_no_figures(tmp_path):
    assert draw_figures([], tmp_path / "figures") == []


def test_the_same_rows_give_the_same_bytes(rows, tmp_path):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        draw_convergence(FIG7, rows, 10, tmp_path / name)
    one, other = ((tmp_path / name / "fig7.svg").read_bytes() for name in ("one", "other"))
    assert one == other
