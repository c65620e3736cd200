"""The figures that an evaluation writes."""

import math
import zlib

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

from orchid_uav.experiments.figures import COLUMN_IN, MOST_LINES, draw_figures, draw_metric
from orchid_uav.experiments.methods import RELEASED, known_methods
from orchid_uav.experiments.metrics import HEADROOM, METRICS

RUN = "20261122T180343Z-orchid-s0-abcd"
FEW = ("orchid", "maddpg-pf", "static-mmf", "planner")
ALL = (*known_methods(), RUN, f"{RUN}-zero")
SHARES = ("coverage", "rate_jfi", "load_jfi", "gbs_coverage")


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
        summaries[name] = {"mean": mean, "std": std, "ci95": mean and [mean, mean]}
    objective = hovers_as(method).removeprefix("static-")
    objective = objective if objective in ("pf", "mmf") else "pf" if "-pf" in method else "mmf"
    return {"method": method, "run": None, "objective": objective} | setting | summaries


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


def legends(figure):
    return [
        [text.get_text() for text in legend.get_texts()]
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

    def test_every_metric_is_drawn_unless_others_are_asked_for(self, tmp_path):
        paths = draw_figures(SHAPES["a single number"], tmp_path)
        assert [path.stem for path in paths[::2]] == list(METRICS)

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
        mine = [one for one in shape if one["method"] == "orchid"]
        means = np.array([one["worst_rate_bps"]["mean"] for one in mine]) * 1e-6
        stds = np.array([one["worst_rate_bps"]["std"] for one in mine]) * 1e-6
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
            one[metric] = {"mean": mean, "std": std, "ci95": None}
        (axes,) = draw_metric(shape, metric).axes
        heights = np.concatenate(bands(axes))[:, 1]
        assert (heights.min(), heights.max()) == (0.0, 1.0)
        assert -0.05 < axes.get_ylim()[0] < 0.0
        assert 1.0 < axes.get_ylim()[1] < 1.05

    def test_bands_of_what_has_a_sign_go_below_0(self):
        shape = results(FEW, uavs=(2, 4))
        for one in shape:
            one["reward"] = {"mean": -1.0, "std": 3.0, "ci95": None}
            one["collisions"] = {"mean": 1.0, "std": 3.0, "ci95": None}
        for metric, least in (("reward", -4.0), ("collisions", 0.0)):
            (axes,) = draw_metric(shape, metric).axes
            assert np.concatenate(bands(axes))[:, 1].min() == least

    def test_missing_means_are_left_out(self):
        (axes,) = draw_metric(SHAPES["UAVs"], "nearest_uav_m").axes
        for line in curves(axes).values():
            assert list(line.get_xdata()) == list(range(2, 8))
        shape = results(FEW, uavs=(2, 4))
        for one in shape:
            if one["method"] == "planner":
                one[HEADROOM] = {"mean": None, "std": None, "ci95": None}
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
        mean = shape[-1]["utility"]["mean"]
        np.testing.assert_allclose(bar, [[4, mean - 0.2], [4, mean + 0.2]])


class TestFamilies:
    @pytest.fixture
    def figure(self):
        return draw_metric(SHAPES["UAVs, all methods"], "utility")

    def test_many_methods_get_a_row_a_family_with_one_of_the_other(self, figure):
        assert [block.get_suptitle() for block in figure.subfigs] == [
            "Learned policies",
            "Rules and planners (1 of 2)",
            "Rules and planners (2 of 2)",
        ]
        learned, *rules = legends(figure)
        twins = ["orchid-random-init-zero"]
        assert set(learned) == {*RELEASED, *twins, RUN, "static-pf"}
        assert all("orchid" in shown for shown in rules)
        assert all(len(shown) <= MOST_LINES + 1 for shown in [learned, *rules])
        for shown in (learned, *rules):
            assert shown == [label for label in ALL if label in shown]

    def test_every_method_is_drawn_or_in_the_footnote(self, figure):
        drawn = {label for shown in legends(figure) for label in shown}
        footnote = " ".join(figure.get_supxlabel().split())
        left_out = [label for label in ALL if label not in drawn]
        assert (
            f"the same as static-pf: {', '.join(n for n in left_out if '-pf-' in n)}." in footnote
        )
        assert f"the same as static-mmf: {', '.join(n for n in left_out if '-pf-' not in n)}." in (
            footnote
        )
        assert all(label.endswith("-zero") for label in left_out)

    def test_a_twin_that_does_otherwise_is_drawn(self):
        shape = results(("orchid", "orchid-zero", "static-mmf"), uavs=(2, 4))
        assert legends(draw_metric(shape, "utility")) == [["orchid", "static-mmf"]]
        shape[1]["utility"]["mean"] += 0.1
        figure = draw_metric(shape, "utility")
        assert legends(figure) == [["orchid", "orchid-zero", "static-mmf"]]
        assert "orchid-zero" not in figure.get_supxlabel()

    def test_a_twin_without_its_static_method_is_drawn(self):
        shape = results(("orchid", "orchid-zero", "static-pf"), uavs=(2, 4))
        shape = [one for one in shape if (one["method"], one["uavs"]) != ("static-pf", 2)]
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
        first = SHAPES["a single setting"][0]["worst_rate_bps"]
        assert axes.lines[0].get_xdata()[0] == pytest.approx(first["mean"] * 1e-6)
        (bar,) = axes.collections[0].get_segments()
        expected = [(first["mean"] + sign * first["std"]) * 1e-6 for sign in (-1, 1)]
        np.testing.assert_allclose(bar[:, 0], expected)

    def test_who_was_not_measured_has_no_row(self):
        shape = results(FEW)
        shape[1]["utility"] = {"mean": None, "std": None, "ci95": None}
        (axes,) = draw_metric(shape, "utility").axes
        rows = [text.get_text() for text in axes.get_yticklabels()]
        assert rows == ["orchid", "static-mmf", "planner"]

    def test_bars_of_shares_end_at_1(self):
        shape = results(FEW)
        for one in shape:
            one["coverage"] = {"mean": 0.98, "std": 0.1, "ci95": None}
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
            one["utility"]["mean"] += 0.001 * index  # twins, too
        shape += results(["orchid", RUN], uavs=(2, 4), deterministic=[False])
        found = looks(draw_metric(shape, "utility"))
        assert len(found) == len(ALL) + 2
        assert len(set(found.values())) == len(found)
        marks = {look[1:3] for look in found.values()}
        assert len(marks) == len(found), "alike in black and white"
        lines = [look[3] for label, look in found.items() if label in RELEASED]
        assert len(set(lines)) == len(lines)

    def test_runs_get_theirs_in_order_of_appearance(self):
        runs = [RUN.replace("s0", f"s{seed}") for seed in range(15)]
        found = looks(draw_metric(results(runs, uavs=(2, 4)), "utility"))
        assert len(set(found.values())) == 15
        with_others = results(("orchid", *runs[::-1]), uavs=(2, 4))
        others = looks(draw_metric(with_others, "utility"))
        assert [others[run] for run in runs[::-1]] == [found[run] for run in runs]

    def test_a_run_keeps_its_look_where_an_earlier_one_was_not_measured(self):
        runs = [RUN, RUN.replace("s0", "s1")]
        shape = results(runs, uavs=(2, 4))
        for one in shape:
            if one["method"] == RUN:
                one["utility"] = {"mean": None, "std": None, "ci95": None}
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
