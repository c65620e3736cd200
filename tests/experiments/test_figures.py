"""The figures that an evaluation writes."""

import html
import itertools
import math
import re
import zlib

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.evaluation.flights import SETTING_FIELDS
from orchid_uav.experiments.evaluation.methods import RELEASED, known_methods
from orchid_uav.experiments.figures.contact_sheet import write_evaluation_sheet
from orchid_uav.experiments.figures.evaluation_figures import MOST_LINES, draw_figures, draw_metric
from orchid_uav.experiments.figures.style import COLUMN_IN, line_styles, setting_of
from orchid_uav.experiments.metrics import HEADROOM, METRICS
from orchid_uav.experiments.statistics.intervals import UNKNOWN, MetricSummary
from orchid_uav.experiments.statistics.results import (
    EvaluationResult,
    EvaluationSettings,
    EvaluationSummary,
)

RUN = "20261122T180343Z-orchid-s0-abcd"
FEW = ("orchid", "maddpg-pf", "static-mmf", "planner")
ALL = (*known_methods(), RUN, f"{RUN}-zero")
SHARES = ("coverage", "rate_jfi", "load_jfi", "gbs_coverage", "total_coverage")


def hovers_as(method):
    objective = "pf" if "-pf" in method else "mmf"
    is_hover = method.endswith("-zero") and "random" not in method
    return f"static-{objective}" if is_hover else method


def result(method, uavs=4, users=100, speed_mps=0.0, **changes):
    """One flight's numbers: the same for the same method and setting, about what is measured."""
    setting = {
        "distribution": "tcp",
        "uavs": uavs,
        "users": users,
        "speed_mps": speed_mps,
        "heading_hold_s": 1.0,
        "episodes": 100,
        "deterministic": True,
        "comparable": True,
    } | changes
    summaries = {}
    for name in METRICS:
        height = zlib.crc32(f"{hovers_as(method)} {name}".encode()) / 2**32
        mean = 0.5 + 0.4 * height + 0.01 * uavs - 0.01 * speed_mps + 1e-4 * users
        mean, std = mean / METRICS[name].scale, 0.2 / METRICS[name].scale
        if name in SHARES:
            mean = min(mean, 1.0)
        if name == HEADROOM:
            std = None
        if name == "nearest_uav_m" and uavs == 1:
            mean = std = None
        ci95 = None if mean is None else [mean, mean]
        summaries[name] = MetricSummary(mean=mean, std=std, ci95=ci95)
    objective = hovers_as(method).removeprefix("static-")
    objective = objective if objective in ("pf", "mmf") else "pf" if "-pf" in method else "mmf"
    return EvaluationResult(method=method, run=None, objective=objective, **setting, **summaries)


def results(methods, **settings):
    """Every method in every combination of settings given as lists."""
    combinations = [{}]
    for name, values in settings.items():
        combinations = [{**one, name: value} for one in combinations for value in values]
    return [result(method, **one) for one in combinations for method in methods]


SHAPES = {
    "UAVs": results(FEW, uavs=range(1, 8)),
    "UAVs, all methods": results(ALL, uavs=(1, 4, 7)),
    "speeds and distributions": results(
        FEW, speed_mps=(0.0, 0.5, 5.0), distribution=("tcp", "uniform")
    ),
    "users crossed with speeds": results(
        FEW, users=(20, 60, 100, 140, 200), speed_mps=(0.0, 1.0, 5.0)
    ),
    "five panels": results(("orchid",), users=(20, 40, 60, 80, 100, 120), uavs=(1, 2, 3, 4, 5)),
    "a single setting": results(ALL),
    "a single setting of each distribution": results(FEW, distribution=("tcp", "uniform")),
    "a single number": results(("orchid",)),
    "sampled actions": results((RUN, "orchid"), uavs=(2, 4), deterministic=(True, False)),
}


def legends(figure, with_marks=False):
    """Labels of each block, without the marks of identical curves unless they are asked for."""
    return [
        [
            text.get_text() if with_marks else text.get_text().partition(" [")[0]
            for text in legend.get_texts()
            if text.get_text().strip()
        ]
        for block in figure.subfigs
        for legend in block.legends
    ]


def curves(axes):
    return {line.get_label(): line for line in axes.lines}


def bands(axes):
    return [
        path.vertices
        for collection in axes.collections
        if isinstance(collection, PolyCollection)
        for path in collection.get_paths()
    ]


def looks(figure):
    """Colour, marker, its filling and line style of each method."""
    return {
        label: (
            to_hex(line.get_color()),
            line.get_marker(),
            to_hex(line.get_markerfacecolor()).replace(to_hex(line.get_color()), "full"),
            str(line._unscaled_dash_pattern),
        )
        for axes in figure.axes
        for label, line in curves(axes).items()
    }


class TestFiles:
    @pytest.mark.parametrize("shape", SHAPES)
    def test_both_formats_are_written(self, shape, tmp_path):
        directory = tmp_path / "new" / "figures"
        picture, drawing = draw_figures(SHAPES[shape], directory, ("worst_rate_bps",))
        assert picture == directory / "worst_rate_bps.png"
        assert drawing == directory / "worst_rate_bps.svg"
        assert set(directory.iterdir()) == {picture, drawing}
        assert picture.read_bytes().startswith(b"\x89PNG")
        assert drawing.read_text().startswith("<?xml")

    def test_the_same_results_give_the_same_bytes(self, tmp_path):
        shape = SHAPES["users crossed with speeds"]
        first = draw_figures(shape, tmp_path / "first", ("utility",))
        again = draw_figures(shape, tmp_path / "again", ("utility",))
        assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]

    def test_text_in_svg_is_text(self, tmp_path):
        _, path = draw_figures(SHAPES["UAVs"], tmp_path, ("worst_rate_bps",))
        text = path.read_text()
        for words in ("worst user's rate (Mbit/s)", "UAVs", *FEW, "Band: ±1 standard deviation"):
            assert f">{words}" in text
        assert "<dc:date>" not in text

    def test_nothing_is_drawn_of_what_was_not_measured(self, tmp_path):
        paths = draw_figures(results(FEW, uavs=[1], users=(20, 40)), tmp_path, ("nearest_uav_m",))
        assert paths == []
        assert draw_figures([], tmp_path) == []
        assert list(tmp_path.iterdir()) == []

    def test_the_callers_matplotlib_stays_as_it_was(self, tmp_path):
        with mpl.rc_context({"svg.hashsalt": "the caller's", "font.size": 31.0}):
            before = dict(mpl.rcParams)
            _, styled = draw_figures(SHAPES["a single number"], tmp_path / "styled", ("coverage",))
            assert dict(mpl.rcParams) == before
        _, plain = draw_figures(SHAPES["a single number"], tmp_path / "plain", ("coverage",))
        assert styled.read_bytes() == plain.read_bytes()


class TestLines:
    def test_means_and_bands_are_in_the_units_of_the_label(self):
        shape = SHAPES["UAVs"]
        (axes,) = draw_metric(shape, "worst_rate_bps").axes
        assert axes.get_ylabel() == "worst user's rate (Mbit/s)"
        assert axes.get_xlabel() == "UAVs"
        mine = [one for one in shape if one.method == "orchid"]
        means = np.array([one.metrics["worst_rate_bps"].mean for one in mine]) * 1e-6
        stds = np.array([one.metrics["worst_rate_bps"].std for one in mine]) * 1e-6
        line = curves(axes)["orchid"]
        np.testing.assert_allclose(line.get_xdata(), range(1, 8))
        np.testing.assert_allclose(line.get_ydata(), means)
        band = bands(axes)[0]
        assert band[:, 1].min() == pytest.approx((means - stds).min())
        assert band[:, 1].max() == pytest.approx((means + stds).max())

    @pytest.mark.parametrize(
        ("settings", "label"),
        [
            ({"uavs": (1, 2), "users": (20, 60, 100)}, "users"),
            ({"uavs": (1, 2), "speed_mps": (0.0, 1.0, 2.0)}, "users' greatest speed (m/s)"),
            ({"uavs": (1, 2), "users": (20, 60)}, "UAVs"),
        ],
    )
    def test_the_longest_dimension_is_the_x_axis(self, settings, label):
        for axes in draw_metric(results(FEW, **settings), "coverage").axes:
            assert axes.get_xlabel() == label

    @pytest.mark.parametrize(
        ("shape", "titles"),
        [
            ("UAVs", [""]),
            ("speeds and distributions", ["clustered users", "uniform users"]),
            ("users crossed with speeds", ["users at rest", "up to 1 m/s", "up to 5 m/s"]),
            ("five panels", ["1 UAV", "2 UAVs", "3 UAVs", "4 UAVs", "5 UAVs"]),
            ("a single setting of each distribution", ["clustered users", "uniform users"]),
        ],
    )
    def test_titles_name_only_what_differs(self, shape, titles):
        figure = draw_metric(SHAPES[shape], "coverage")
        assert [axes.get_title() for axes in figure.axes] == titles

    def test_titles_name_all_that_differs(self):
        shape = results(
            FEW, users=(20, 60, 100), distribution=("tcp", "uniform"), heading_hold_s=(1.0, 20.0)
        )
        titles = [axes.get_title() for axes in draw_metric(shape, "coverage").axes]
        assert " ".join(titles[0].split()) == "clustered users, heading held for 1 s"
        assert " ".join(titles[3].split()) == "uniform users, heading held for 20 s"

    @pytest.mark.parametrize(
        ("settings", "title"),
        [
            ({"uavs": (1, 2, 3)}, "100 clustered users at rest"),
            ({"users": (20, 60), "uavs": [1]}, "1 UAV, clustered users at rest"),
            ({"uavs": [6], "distribution": ["uniform"]}, "6 UAVs, 100 uniform users at rest"),
            (
                {"speed_mps": (0.0, 5.0), "heading_hold_s": [20.0]},
                "4 UAVs, 100 clustered users, heading held for 20 s",
            ),
            (
                {"uavs": (2, 4), "users": [1], "speed_mps": [2.5]},
                "1 clustered user, up to 2.5 m/s, heading held for 1 s",
            ),
            ({"uavs": (2, 4, 6), "distribution": ("tcp", "uniform")}, "100 users at rest"),
        ],
    )
    def test_the_title_is_the_setting_that_all_panels_have(self, settings, title):
        figure = draw_metric(results(FEW, **settings), "utility")
        assert " ".join(figure.get_suptitle().split()) == title

    def test_the_setting_of_configurations_is_what_an_evaluation_calls_so(self):
        given = dict(zip(SETTING_FIELDS, ("uniform", 3, 20, 2.0, 5.0), strict=True))
        assert setting_of([given]).replace("\N{NO-BREAK SPACE}", " ") == (
            "3 UAVs, 20 uniform users, up to 2 m/s, heading held for 5 s"
        )
        other = given | {"network.uav_count": 4, "network.user_speed_mps": 0.0}
        assert "UAV" not in setting_of([given, other])

    def test_the_spread_is_over_topologies(self):
        footnote = draw_metric(SHAPES["UAVs"], "utility").get_supxlabel()
        assert footnote.endswith("over 100 topologies.")

    def test_panels_have_the_same_axes(self):
        figure = draw_metric(SHAPES["UAVs, all methods"], "coverage")
        assert len({axes.get_ylim() for axes in figure.axes}) == 1
        assert len({axes.get_xlim() for axes in figure.axes}) == 1

    def test_counts_have_whole_ticks(self):
        (axes,) = draw_metric(SHAPES["UAVs"], "coverage").axes
        assert list(axes.get_xticks()) == list(range(1, 8))
        many = results(FEW, users=range(10, 410, 10))
        (axes,) = draw_metric(many, "coverage").axes
        ticks = axes.get_xticks()
        assert 4 <= len(ticks) <= 10
        assert set(ticks) <= set(range(10, 410, 10))

    @pytest.mark.parametrize("metric", SHARES)
    def test_bands_of_shares_end_at_0_and_1(self, metric):
        shape = results(FEW, uavs=(2, 4, 6))
        for one, (mean, std) in zip(shape, [(0.95, 0.1), (0.02, 0.1), (0.5, 0.7)] * 4, strict=True):
            one.metrics[metric] = MetricSummary(mean=mean, std=std, ci95=None)
        (axes,) = draw_metric(shape, metric).axes
        heights = np.concatenate(bands(axes))[:, 1]
        assert (heights.min(), heights.max()) == (0.0, 1.0)
        assert -0.05 < axes.get_ylim()[0] < 0.0
        assert 1.0 < axes.get_ylim()[1] < 1.05

    def test_bands_of_what_has_a_sign_go_below_0(self):
        shape = results(FEW, uavs=(2, 4))
        for one in shape:
            one.metrics["reward"] = MetricSummary(mean=-1.0, std=3.0, ci95=None)
            one.metrics["collisions"] = MetricSummary(mean=1.0, std=3.0, ci95=None)
        for metric, least in (("reward", -4.0), ("collisions", 0.0)):
            (axes,) = draw_metric(shape, metric).axes
            assert np.concatenate(bands(axes))[:, 1].min() == least

    @pytest.mark.parametrize(
        ("metric", "value", "least", "greatest"),
        [
            ("coverage", 1.0, 0.9, 1.01),
            ("backhaul_violations", 0.0, -0.05, 0.5),
            ("reward", -300.0, -330.0, -270.0),
            ("worst_rate_bps", 5e6, 4.5, 5.5),
        ],
    )
    @pytest.mark.parametrize("settings", [{"uavs": (2, 4)}, {}])
    def test_what_does_not_differ_is_not_looked_at_through_a_microscope(
        self, metric, value, least, greatest, settings
    ):
        shape = results(FEW, **settings)
        for turn, one in enumerate(shape):
            one.metrics[metric] = MetricSummary(mean=value * (1 - 1e-9 * turn), std=0.0, ci95=None)
        figure = draw_metric(shape, metric)
        figure.draw_without_rendering()
        axis = figure.axes[0].yaxis if settings else figure.axes[0].xaxis
        low, high = sorted(axis.get_view_interval())
        assert least <= low < high <= greatest
        assert high - low > 0.04 * max(abs(value * METRICS[metric].scale), 1)
        assert axis.get_offset_text().get_text() == ""
        assert all(len(label.get_text()) <= 5 for label in axis.get_ticklabels())

    def test_missing_means_are_left_out(self):
        (axes,) = draw_metric(SHAPES["UAVs"], "nearest_uav_m").axes
        for line in curves(axes).values():
            assert list(line.get_xdata()) == list(range(2, 8))
        shape = results(FEW, uavs=(2, 4))
        for one in shape:
            if one.method == "planner":
                one.metrics[HEADROOM] = MetricSummary(mean=None, std=None, ci95=None)
        figure = draw_metric(shape, HEADROOM)
        assert list(curves(figure.axes[0])) == [name for name in FEW if name != "planner"]
        assert legends(figure) == [[name for name in FEW if name != "planner"]]

    def test_without_standard_deviations_none_are_spoken_of(self):
        assert "deviation" in draw_metric(SHAPES["UAVs"], "utility").get_supxlabel()
        assert draw_metric(SHAPES["UAVs"], HEADROOM).get_supxlabel() == ""

    def test_a_lone_point_has_a_bar(self):
        shape = [*results(("orchid",), uavs=(2, 4, 6)), result("planner", uavs=4)]
        (axes,) = draw_metric(shape, "utility").axes
        (bar,) = [
            collection.get_segments()[0]
            for collection in axes.collections
            if not isinstance(collection, PolyCollection)
        ]
        mean = shape[-1].metrics["utility"].mean
        np.testing.assert_allclose(bar, [[4, mean - 0.2], [4, mean + 0.2]])


class TestFamilies:
    @pytest.fixture
    def figure(self):
        return draw_metric(SHAPES["UAVs, all methods"], "utility")

    def test_many_methods_get_a_row_a_family_with_one_of_the_other(self, figure):
        assert [block.get_suptitle() for block in figure.subfigs] == [
            "Learned policies and their zero-action twins (1 of 3)",
            "Learned policies and their zero-action twins (2 of 3)",
            "Learned policies and their zero-action twins (3 of 3)",
            "Rules and planners (1 of 3)",
            "Rules and planners (2 of 3)",
            "Rules and planners (3 of 3)",
        ]
        shown = legends(figure)
        learned, rules = shown[:3], shown[3:]
        policies = {*RELEASED, RUN}
        twins = {f"{policy}-zero" for policy in policies}
        assert {label for part in learned for label in part} == policies | twins | {"static-pf"}
        assert all("static-pf" in part for part in learned)
        assert all("orchid" in part for part in rules)
        assert all(len(part) <= MOST_LINES + 1 for part in shown)
        assert {label for part in shown for label in part} == set(ALL)

    def test_a_twin_is_drawn_beside_its_policy(self, figure):
        for part in legends(figure):
            for place, label in enumerate(part):
                if label.endswith("-zero"):
                    assert part[place - 1] == label.removesuffix("-zero")

    def test_the_legend_says_which_are_identical(self, figure):
        marks: dict[str, set[str]] = {}
        for label in [label for part in legends(figure, with_marks=True) for label in part]:
            method, _, mark = label.partition(" ")
            marks.setdefault(mark, set()).add(method)
        same = {"": set(), "static-mmf": set(), "static-pf": set()}
        for method in ALL:
            same[hovers_as(method) if hovers_as(method) in same else ""].add(method)
        del marks[""]
        assert sorted(map(sorted, marks.values())) == sorted(
            sorted(methods) for name, methods in same.items() if name
        )
        footnote = " ".join(figure.get_supxlabel().split())
        for mark, methods in marks.items():
            names = footnote.partition(f"{mark} Identical curves: ")[2]
            assert set(names.partition(".")[0].split(", ")) == methods

    def test_what_is_identical_in_some_panels_is_said_of_them(self):
        shape = results(("orchid", "track", "planner"), uavs=(2, 4, 6), speed_mps=(0.0, 5.0))
        for one in shape:
            if one.method == "track" and one.speed_mps == 0.0:
                one.metrics["utility"] = next(
                    other.metrics["utility"]
                    for other in shape
                    if (other.method, other.uavs) == ("orchid", one.uavs)
                )
        figure = draw_metric(shape, "utility")
        assert legends(figure, with_marks=True) == [["orchid", "track", "planner"]]
        footnote = " ".join(figure.get_supxlabel().split())
        assert footnote.endswith("Identical in users at rest alone: orchid, track.")

    @pytest.mark.parametrize("difference", [0.0, 1e-4])
    def test_curves_that_lie_on_each_other_are_all_seen(self, difference):
        methods = ("static-mmf", "orchid-zero", "maddpg-mmf-zero", "balanced-loiter", "planner")
        shape = results(methods, uavs=range(4, 11))
        for turn, one in enumerate(shape):
            if one.method != "planner":
                one.metrics["utility"] = MetricSummary(
                    mean=1.0 + difference * (turn % 2), std=0.0, ci95=None
                )
        figure = draw_metric(shape, "utility")
        figure.draw_without_rendering()
        (axes,) = figure.axes
        lines = [curves(axes)[method] for method in methods[:-1]]
        places = np.array([line.get_transform().transform(line.get_xydata()) for line in lines])
        points = places[:, :, 0] * 72 / figure.dpi
        for one, other in itertools.combinations(points, 2):
            assert (np.abs(one - other) > 2.5).all(), "a marker hides another"
        shifts = points - points.mean(axis=0)
        assert (np.abs(shifts) < 0.5 * np.diff(points.mean(axis=0)).min()).all()
        widths = [line.get_linewidth() for line in lines]
        assert widths == sorted(widths, reverse=True) and len(set(widths)) == len(widths)
        for line in lines:  # the data themselves are as they are
            np.testing.assert_array_equal(line.get_xdata(), range(4, 11))

    def test_a_twin_without_its_static_method_is_drawn(self):
        shape = results(("orchid", "orchid-zero", "static-pf"), uavs=(2, 4))
        shape = [one for one in shape if (one.method, one.uavs) != ("static-pf", 2)]
        assert legends(draw_metric(shape, "utility")) == [["orchid", "orchid-zero", "static-pf"]]

    def test_runs_alone_are_shown_with_the_only_rule(self):
        runs = [RUN.replace("s0", f"s{seed}") for seed in range(10)]
        shown = legends(draw_metric(results((*runs, "static-mmf"), uavs=(2, 4)), "utility"))
        assert shown == [[*runs[:5], "static-mmf"], [*runs[5:], "static-mmf"]]


class TestDots:
    def test_methods_go_down_in_their_order(self):
        figure = draw_metric(SHAPES["a single setting"], "worst_rate_bps")
        (axes,) = figure.axes
        assert [text.get_text() for text in axes.get_yticklabels()] == list(ALL)
        assert [line.get_ydata()[0] for line in axes.lines] == list(range(len(ALL)))
        assert axes.get_ylim()[0] > axes.get_ylim()[1]
        assert axes.get_xlabel().split() == ["worst", "user's", "rate", "(Mbit/s)"]
        first = SHAPES["a single setting"][0].metrics["worst_rate_bps"]
        assert axes.lines[0].get_xdata()[0] == pytest.approx(first.mean * 1e-6)
        (bar,) = axes.collections[0].get_segments()
        expected = [(first.mean + sign * first.std) * 1e-6 for sign in (-1, 1)]
        np.testing.assert_allclose(bar[:, 0], expected)

    def test_who_was_not_measured_has_no_row(self):
        shape = results(FEW)
        shape[1].metrics["utility"] = UNKNOWN
        (axes,) = draw_metric(shape, "utility").axes
        rows = [text.get_text() for text in axes.get_yticklabels()]
        assert rows == ["orchid", "static-mmf", "planner"]

    def test_bars_of_shares_end_at_1(self):
        shape = results(FEW)
        for one in shape:
            one.metrics["coverage"] = MetricSummary(mean=0.98, std=0.1, ci95=None)
        (axes,) = draw_metric(shape, "coverage").axes
        assert max(bar.get_segments()[0][1, 0] for bar in axes.collections) == 1.0

    def test_few_methods_fit_a_column(self):
        assert draw_metric(results(FEW), "coverage").get_figwidth() == COLUMN_IN


class TestLooks:
    def test_a_method_looks_the_same_in_every_figure(self):
        everywhere = {}
        for shape, metric in zip(SHAPES.values(), METRICS, strict=False):
            for label, (*look, _) in looks(draw_metric(shape, metric)).items():  # dots: no line
                assert everywhere.setdefault(label, look) == look, label
        assert set(everywhere) >= set(ALL)

    def test_no_two_methods_look_alike(self):
        shape = results(ALL, uavs=(2, 4))
        for index, one in enumerate(shape):
            utility = one.metrics["utility"]
            shifted = {"mean": utility.mean + 0.001 * index}  # twins, too
            one.metrics["utility"] = utility.model_copy(update=shifted)
        shape += results(["orchid", RUN], uavs=(2, 4), deterministic=[False])
        found = looks(draw_metric(shape, "utility"))
        assert len(found) == len(ALL) + 2
        assert len(set(found.values())) == len(found)
        marks = {look[1:3] for look in found.values()}
        assert len(marks) == len(found), "alike in black and white"
        lines = [look[3] for label, look in found.items() if label in RELEASED]
        assert len(set(lines)) == len(lines)

    def test_of_a_method_does_not_depend_on_what_else_is_drawn(self):
        together = line_styles(ALL)
        for label in ALL:
            assert line_styles([label])[label] == together[label]
        assert line_styles(["base", "no-rf"]) == {
            "base": together["orchid"],
            "no-rf": together["orchid-no-rf"],
        }

    def test_runs_differ_and_their_order_does_not_matter(self):
        runs = [RUN.replace("s0", f"s{seed}") for seed in range(15)]
        found = looks(draw_metric(results(runs, uavs=(2, 4)), "utility"))
        assert len(set(found.values())) == 15
        with_others = results(("orchid", *runs[::-1]), uavs=(2, 4))
        others = looks(draw_metric(with_others, "utility"))
        assert [others[run] for run in runs[::-1]] == [found[run] for run in runs[::-1]]

    @pytest.mark.parametrize("trait", ["color", "marker", "linestyle"])
    def test_few_runs_share_nothing(self, trait):
        runs = [
            RUN.replace("abcd", letters) for letters in ("abcd", "zknc", "bvqf", "niyg", "rekq")
        ]
        assert len({str(look[trait]) for look in line_styles(runs).values()}) == 5

    def test_most_runs_look_the_same_alone_and_beside_another(self):
        runs = [RUN.replace("s0", f"s{seed}") for seed in range(30)]
        kept = [
            line_styles([one, other])[one] == line_styles([one])[one]
            for one, other in itertools.pairwise(runs)
        ]
        assert sum(kept) > 15

    def test_a_run_keeps_its_look_where_an_earlier_one_was_not_measured(self):
        runs = [RUN, RUN.replace("s0", "s1")]
        shape = results(runs, uavs=(2, 4))
        for one in shape:
            if one.method == RUN:
                one.metrics["utility"] = MetricSummary(mean=None, std=None, ci95=None)
        utility, coverage = (looks(draw_metric(shape, name)) for name in ("utility", "coverage"))
        assert utility == {runs[1]: coverage[runs[1]]}

    def test_sampled_actions_are_told_in_the_label(self):
        shown = legends(draw_metric(SHAPES["sampled actions"], "utility"))
        assert shown == [[RUN, "orchid", f"{RUN}, sampled", "orchid, sampled"]]


class TestPlaces:
    """Nothing lies over anything else, once laid out."""

    @pytest.mark.parametrize("shape", SHAPES)
    def test_legends_and_footnotes_are_beside_the_data(self, shape):
        figure = draw_metric(SHAPES[shape], "thrust_energy_efficiency_bit_per_joule")
        figure.draw_without_rendering()
        page = figure.bbox
        outside = [figure._supxlabel.get_window_extent()]
        outside += [
            legend.get_window_extent() for block in figure.subfigs for legend in block.legends
        ]
        boxes = [axes.get_tightbbox() for axes in figure.axes]
        for box in [*outside, *boxes]:
            assert not math.isnan(box.x0)
            assert page.x0 - 1 <= box.x0 and box.x1 <= page.x1 + 1
            assert page.y0 - 1 <= box.y0 and box.y1 <= page.y1 + 1
        for index, box in enumerate(outside):
            assert not any(box.overlaps(other) for other in [*boxes, *outside[:index]])
        for index, box in enumerate(boxes):
            assert not any(box.overlaps(other) for other in boxes[:index])


def document_of(flown, command=("orchid", "eval"), status="completed", **world):
    """An evaluation's summary, as far as its page shows it."""
    network = Parameters().model_dump(mode="json")
    network["network"] |= {"user_count": 77} | world
    methods = [
        {"method": name, "run": None, "sha256": None, "deterministic": True, "overrides": {}}
        for name in dict.fromkeys(one.method for one in flown)
    ]
    return EvaluationSummary(
        schema=1,
        status=status,
        date="2026-11-26",
        command=list(command),
        versions={"orchid_uav": "9.8.7"},
        host={},
        settings=EvaluationSettings.from_json(
            {
                "methods": methods,
                "distributions": ["tcp", "uniform"],
                "uavs": [4, 6],
                "users": [77],
                "speeds_mps": [0.0],
                "heading_hold_s": [1.0],
                "episodes": 100,
                "seed": 31,
                "planner_evaluations": 31,
                "world": network,
                "training_progress": 1.0,
                "ci95": "",
                "headroom": "",
            }
        ),
        results=flown,
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A directory with all figures of an evaluation and their page."""
    directory = tmp_path_factory.mktemp("whole")
    flown = results(("orchid",), uavs=(4, 6))
    write_evaluation_sheet(directory, document_of(flown), draw_figures(flown, directory))
    return directory


class TestContactSheet:
    @pytest.fixture
    def page(self, tmp_path):
        """Calls write the page of an evaluation beside its figures, and give its text."""

        def write(metrics=("utility", "collisions"), **options):
            flown = results(FEW, uavs=(4, 6))
            figures = draw_figures(flown, tmp_path, metrics)
            write_evaluation_sheet(tmp_path, document_of(flown, **options), figures)
            return (tmp_path / "index.html").read_text(encoding="utf-8")

        return write

    def test_every_metric_is_drawn_unless_others_are_asked_for(self, whole):
        kinds = {path.stem: set() for path in whole.iterdir()}
        for path in whole.iterdir():
            kinds[path.stem].add(path.suffix)
        assert kinds.pop("index") == {".html"}
        assert kinds == {metric: {".png", ".svg"} for metric in METRICS}

    def test_shows_and_links_every_figure_beside_it_and_nothing_else(self, whole):
        text = (whole / "index.html").read_text(encoding="utf-8")
        pictures = re.findall(r'<img src="([^"]+)"', text)
        assert pictures == [f"{metric}.png" for metric in METRICS]
        linked = set(re.findall(r'href="([^"#]+)"', text))
        assert linked == {path.name for path in whole.iterdir()} - {"index.html"}
        inside = re.findall(r'href="#([^"]+)"', text)
        assert inside == re.findall(r'<article id="([^"]+)"', text) == list(METRICS)
        assert not re.search(r"https?:|//|@import|url\(|<script|<link", text)

    def test_every_metric_has_a_question_of_its_own(self, whole):
        text = (whole / "index.html").read_text(encoding="utf-8")
        questions = re.findall(r"<h3>([^<]+)</h3>", text)
        assert len(questions) == len(set(questions)) == len(METRICS)
        assert all(question.endswith("?") for question in questions)
        assert not any(question.startswith("How do the methods differ") for question in questions)

    def test_says_what_was_evaluated(self, page):
        text = html.unescape(re.sub(r"<[^>]+>", "", page(slot_s=2.0)))
        for words in (
            "UAVs: 4, 6; users: 77, clustered and uniform; at rest",
            "the paper's parameters, but network.slot_s = 2.0\n",
            "100 for each setting, seed 31, the same for all methods",
            "orchid, maddpg-pf, static-mmf, planner",
            "2026-11-26 by orchid 9.8.7",
            "Which method is best in the paper's own objective?",
            "Lower is better.",
        ):
            assert words in text
        assert "not everything" not in text

    def test_of_an_interrupted_evaluation_says_so(self, page):
        assert "Interrupted: not everything that was planned" in page(status="interrupted")

    def test_what_others_wrote_is_text(self, page):
        command = ["orchid", "eval", "--out", "<script>alert('x')</script>&amp;\udc80\u202e"]
        text = page(command=command)
        code = re.search(r"<code>(.*?)</code>", text, re.DOTALL).group(1)
        shown = html.unescape(re.sub("</?span>", "", code))
        assert "<script" not in text and shown.startswith("orchid eval --out ")
        assert "<script>alert(" in shown and "&amp;" in shown and "\\udc80" in shown

    def test_pictures_have_their_size_and_a_description(self, page, tmp_path):
        text = page(("utility",))
        width, height = map(int, re.search(r'width="(\d+)" height="(\d+)"', text).groups())
        assert mpl.image.imread(tmp_path / "utility.png").shape[:2] == (height, width)
        assert re.search(r'alt="Which method is best[^"]+Higher is better."', text)
