"""Learning curves: their numbers, the figure, and the drawing in a terminal."""

import itertools
import math
import statistics
import zlib

import matplotlib as mpl
import matplotlib.image
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from rich.console import Console

from orchid_uav.cli.tables.terminal_curves import (
    Line,
    can_show_braille,
    sampled_table,
    terminal_curves,
)
from orchid_uav.experiments.figures import learning_curves
from orchid_uav.experiments.figures.learning_curves import draw_learning_curves
from orchid_uav.experiments.figures.style import line_styles
from orchid_uav.experiments.statistics.curves import (
    DEFAULT_COLUMNS,
    curve_table,
    group_curve,
    single_curve,
    smoothed,
)
from orchid_uav.experiments.statistics.intervals import MIN_SEEDS
from tests.helpers.run_directories import row

NUMBERS = st.floats(-1e6, 1e6)


def run_of(values, column="rate_jfi", resets=()):
    """Rows of a run whose figure takes these values."""
    return [
        row(episode, **{column: value, "reset": float(episode in resets)})
        for episode, value in enumerate(values, start=1)
    ]


class TestSmoothed:
    def test_by_hand(self):
        assert smoothed([1, 2, 6, 3, 0], 3).tolist() == [1.0, 1.5, 3.0, 11 / 3, 3.0]
        assert smoothed([4, 8], 5).tolist() == [4.0, 6.0]
        assert smoothed([], 3).tolist() == []
        assert smoothed([5, 7], 1).tolist() == [5.0, 7.0]

    @given(st.lists(NUMBERS, max_size=40), st.integers(1, 50))
    def test_is_the_mean_of_the_last_values(self, values, window):
        expected = [
            statistics.fmean(values[max(0, at + 1 - window) : at + 1]) for at in range(len(values))
        ]
        np.testing.assert_allclose(smoothed(values, window), expected, rtol=1e-9, atol=1e-6)

    def test_what_is_no_number_is_forgotten_behind_the_window(self):
        values = [1.0, math.nan, 3.0, 5.0, 7.0]
        np.testing.assert_array_equal(smoothed(values, 2), [1.0, math.nan, math.nan, 4.0, 6.0])

    def test_a_window_of_nothing_is_an_error(self):
        with pytest.raises(ValueError, match="window"):
            smoothed([1.0], 0)


class TestCurves:
    def test_of_one_run_are_its_smoothed_and_scaled_figures(self):
        rows = run_of([2e6, 4e6, 6e6], "worst_rate_bps")
        curve = single_curve(rows, "worst_rate_bps", 2)
        assert curve.episodes.tolist() == [1, 2, 3]
        assert curve.values.tolist() == [2.0, 3.0, 5.0]  # in Mbit/s
        assert curve.band is None

    def test_of_several_are_their_interquartile_mean(self):
        # Of eight, two are left out at each end.
        levels = [9.0, -50.0, 1.0, 2.0, 3.0, 4.0, 1000.0, 0.0]
        curve = group_curve([run_of([level, 2 * level]) for level in levels], "rate_jfi", 1)
        assert curve.values.tolist() == [2.5, 5.0]
        assert curve.runs == 8

    @given(st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=5, max_size=12))
    @settings(max_examples=15, deadline=None)
    def test_the_band_lies_around_the_middle_and_within_the_runs(self, values):
        curve = group_curve([run_of(one) for one in values], "rate_jfi", 1)
        low, high = curve.band
        table = np.array(values)
        room = 1e-9 * (1 + np.abs(table).max())
        assert (table.min(axis=0) - room <= low).all() and (low <= high).all()
        assert (high <= table.max(axis=0) + room).all()
        ordered = np.sort(table, axis=0)
        cut = len(values) // 4
        middle = ordered[cut : len(values) - cut].mean(axis=0)
        np.testing.assert_allclose(curve.values, middle, rtol=1e-9, atol=1e-6)

    def test_the_band_is_the_percentile_bootstrap_over_runs(self):
        levels = np.random.default_rng(7).normal(size=8)
        drawn = np.random.default_rng(8).choice(levels, (40_000, 8))
        middles = np.sort(drawn)[:, 2:6].mean(axis=1)
        exact, narrower = (np.percentile(middles, ends) for ends in ([2.5, 97.5], [5, 95]))
        width = np.ptp(exact)
        low, high = group_curve([run_of([level] * 2) for level in levels], "rate_jfi", 1).band
        assert (np.abs(exact - narrower) > 0.06 * width).all(), "the levels tell nothing"
        np.testing.assert_allclose([low[0], high[0]], exact, atol=0.06 * width)
        assert low[0] == low[1]  # the same runs are drawn at each episode

    def test_runs_that_are_all_the_same_have_a_band_of_no_width(self):
        curve = group_curve([run_of([3.0, 4.0])] * 5, "rate_jfi", 1)
        for edge in curve.band:
            np.testing.assert_allclose(edge, [3.0, 4.0])

    def test_below_five_runs_there_is_no_band(self):
        curve = group_curve([run_of([level]) for level in (1.0, 2.0, 6.0)], "rate_jfi", 1)
        assert curve.band is None
        assert curve.values.tolist() == [3.0]  # of three, none is left out

    def test_a_run_that_ended_early_counts_until_then(self):
        lengths = [4, 4, 4, 4, 3, 2, 4]
        runs = [run_of([10.0 * at] * length) for at, length in enumerate(lengths)]
        curve = group_curve(runs, "rate_jfi", 1)
        # 7 runs, of which 1 is left out at each end; without the last but one, without both.
        expected = [(10 + 20 + 30 + 40 + 50) / 5] * 2 + [(10 + 20 + 30 + 40) / 4]
        expected.append((10 + 20 + 30) / 3)
        np.testing.assert_allclose(curve.values, expected)
        assert curve.episodes.tolist() == [1, 2, 3, 4]

    def test_the_curve_ends_where_fewer_than_five_go_on(self):
        runs = [run_of([1.0] * length) for length in (9, 9, 9, 9, 6, 3)]
        curve = group_curve(runs, "rate_jfi", 1)
        assert len(curve.values) == len(curve.episodes) == len(curve.band[0]) == 6

    def test_what_is_no_number_in_one_run_is_none_in_the_middle(self):
        runs = [run_of([1.0, math.nan if at == 2 else 2.0, 3.0]) for at in range(6)]
        curve = group_curve(runs, "rate_jfi", 1)
        np.testing.assert_array_equal(curve.values, [1.0, math.nan, 3.0])
        np.testing.assert_array_equal(curve.band, [[1.0, math.nan, 3.0]] * 2)

    def test_no_runs_and_no_episodes_give_no_curve(self):
        assert len(group_curve([], "rate_jfi").values) == 0
        assert len(group_curve([[]] * 6, "rate_jfi").values) == 0
        assert len(single_curve([], "rate_jfi").values) == 0

    def test_are_the_same_each_time(self):
        runs = [run_of(np.random.default_rng(seed).normal(size=70)) for seed in range(6)]
        one, other = (group_curve(runs, "rate_jfi", 3) for _ in range(2))
        np.testing.assert_array_equal(one.band, other.band)


class TestTable:
    def test_has_the_plotted_numbers_unscaled(self):
        groups = {
            "base": [run_of([1e6 * level] * 4, "worst_rate_bps") for level in range(1, 7)],
            "variant": [run_of([2e6, 4e6, 6e6], "worst_rate_bps")],
        }
        table = curve_table(groups, ["worst_rate_bps"], window=1, every=2)
        base, variant = table["base"]["worst_rate_bps"], table["variant"]["worst_rate_bps"]
        assert (base.runs, base.episodes, base.iqm) == (6, [2, 4], [3.5e6, 3.5e6])
        assert len(base.low) == len(base.high) == 2
        assert 1e6 <= base.low[0] < 3.5e6 < base.high[0] <= 6e6
        # The last episode is always there.
        assert variant.to_json() == {
            "runs": 1,
            "episodes": [2, 3],
            "iqm": [4e6, 6e6],
            "low": None,
            "high": None,
        }

    def test_six_digits_and_none_for_what_is_no_number(self):
        table = curve_table({"one": [run_of([1 / 3, math.nan])]}, ["rate_jfi"], window=1)
        assert table["one"]["rate_jfi"].iqm == [0.333333, None]


@pytest.fixture
def drawn(tmp_path, monkeypatch):
    """Calls draw a figure and give the matplotlib figure and its path."""
    figures = []
    make = learning_curves.Figure

    def remember(*arguments, **options):
        figures.append(make(*arguments, **options))
        return figures[-1]

    monkeypatch.setattr(learning_curves, "Figure", remember)

    def draw(groups, name="curves.png", **options):
        draw_learning_curves(groups, tmp_path / name, **options)
        return figures[-1], tmp_path / name

    return draw


def noisy(seed, episodes=30, resets=()):
    generator = np.random.default_rng(seed)
    levels = {column: zlib.crc32(column.encode()) % 7 for column in DEFAULT_COLUMNS}
    return [
        row(
            episode,
            **{column: generator.normal(level) for column, level in levels.items()},
            reset=float(episode in resets),
        )
        for episode in range(1, episodes + 1)
    ]


def lines_of(axes):
    """Drawn curves, without ticks of resets."""
    return [line for line in axes.lines if line.get_marker() != "|"]


def pixels(path, colour):
    """How many pixels of a picture have a colour."""
    picture = mpl.image.imread(path)[:, :, :3]
    return int((np.abs(picture - to_rgb(colour)).max(axis=2) < 0.02).sum())


class TestFigure:
    def test_a_group_of_one_is_a_line(self, drawn):
        rows = noisy(0)
        figure, _ = drawn({"one": [rows]}, columns=["rate_jfi"], window=3)
        (axes,) = figure.axes
        (line,) = lines_of(axes)
        np.testing.assert_array_equal(line.get_xdata(), range(1, 31))
        np.testing.assert_allclose(line.get_ydata(), smoothed([r["rate_jfi"] for r in rows], 3))
        assert not [one for one in axes.collections if isinstance(one, PolyCollection)]

    def test_a_group_of_five_is_a_line_and_a_band(self, drawn):
        runs = [noisy(seed) for seed in range(MIN_SEEDS)]
        figure, _ = drawn({"group": runs}, columns=["rate_jfi"])
        (axes,) = figure.axes
        (line,) = lines_of(axes)
        curve = group_curve(runs, "rate_jfi")
        np.testing.assert_allclose(line.get_ydata(), curve.values)
        (band,) = [one for one in axes.collections if isinstance(one, PolyCollection)]
        edges = band.get_paths()[0].vertices[:, 1]
        assert edges.min() == pytest.approx(curve.band[0].min())
        assert edges.max() == pytest.approx(curve.band[1].max())

    def test_a_group_of_few_is_thin_lines(self, drawn):
        figure, _ = drawn({"few": [noisy(seed) for seed in range(4)], "one": [noisy(9)]})
        for axes in figure.axes:
            *few, one = lines_of(axes)
            assert len(few) == 4
            assert len({line.get_color() for line in few}) == 1
            assert all(line.get_linewidth() < one.get_linewidth() for line in few)
            assert not axes.collections

    def test_a_run_looks_as_it_does_in_an_evaluation(self, drawn):
        for labels in (["orchid"], ["maddpg-pf", "20261122T211505Z-orchid-s0-zknc"]):
            figure, _ = drawn({label: [noisy(0)] for label in labels}, columns=["reward"])
            for line, look in zip(
                lines_of(figure.axes[0]), line_styles(labels).values(), strict=True
            ):
                assert line.get_color() == look["color"]
                assert line.get_marker() == look["marker"]
                dashes = mpl.lines.Line2D([], [], linestyle=look["linestyle"])
                assert line._unscaled_dash_pattern == dashes._unscaled_dash_pattern

    @pytest.mark.parametrize("episodes", [1, 2])
    @pytest.mark.parametrize("others", [0, 200])
    def test_a_run_of_an_episode_or_two_is_seen(self, drawn, episodes, others):
        groups = {"orchid": [noisy(0, others)]} if others else {}
        _, without = drawn(groups | {"static-pf": [noisy(1, others or 9)]}, "without.png")
        groups |= {"maddpg-pf": [noisy(1, episodes)]}
        figure, path = drawn(groups, columns=["reward"])
        line = lines_of(figure.axes[0])[-1]
        legend = 150  # pixels of the line's sample there
        assert pixels(without, line.get_color()) == 0
        assert pixels(path, line.get_color()) > legend + 50 * (1 + (episodes > 1 and not others))
        assert len(line.get_markevery()) >= 1
        assert all(0 <= place < episodes for place in line.get_markevery())

    def test_points_without_neighbours_are_seen(self, drawn):
        values = [1.0, *[math.nan] * 9, 2.0, *[math.nan] * 9, *[3.0] * 80]
        for runs in ([values], [[0.0] * 100, values]):
            figure, _ = drawn(
                {"one": [run_of(one) for one in runs]}, columns=["rate_jfi"], window=1
            )
            assert {0, 10} <= set(lines_of(figure.axes[0])[-1].get_markevery())

    @pytest.mark.parametrize(
        ("column", "value", "least", "greatest"),
        [
            ("coverage", 1.0, 0.9, 1.01),
            ("collisions", 0.0, -0.01, 0.5),
            ("reward", -300.0, -330.0, -270.0),
            ("actor_lr", 3e-4, 2e-4, 4e-4),
            ("critic_lr", 3e-9, 2e-9, 4e-9),
            ("entropy_coef", 0.0, -1.0, 1.0),
        ],
    )
    def test_a_constant_has_an_axis_of_numbers_that_can_be_read(
        self, drawn, column, value, least, greatest
    ):
        rows = run_of([value * (1 + 1e-9 * at) for at in range(30)], column)
        figure, _ = drawn({"one": [rows]}, columns=[column])
        (axes,) = figure.axes
        low, high = axes.get_ylim()
        assert least <= low < high <= greatest
        assert high - low > 0.04 * max(abs(value), 1e-9)
        assert axes.yaxis.get_offset_text().get_text() == ""
        texts = [
            label.get_text().replace("\N{MINUS SIGN}", "-") for label in axes.get_yticklabels()
        ]
        assert len(set(texts)) == len(texts) and all(len(text) <= 8 for text in texts)
        assert [float(text) for text in texts] == pytest.approx(list(axes.get_yticks()), rel=1e-6)

    def test_values_that_cannot_be_get_no_room(self, drawn):
        rows = run_of([0.2 + 0.8 * (at > 3) for at in range(30)], "coverage")
        figure, _ = drawn({"one": [rows]}, columns=["coverage"], window=1)
        assert 1.0 < figure.axes[0].get_ylim()[1] < 1.05

    def test_identical_runs_are_both_seen_and_named(self, drawn):
        groups = {"maddpg-mmf": [noisy(0, 200)], "maddpg-pf": [noisy(0, 200)], "x": [noisy(1)]}
        figure, path = drawn(groups, columns=["reward", "rate_jfi"])
        (legend,) = [legend for block in figure.subfigs for legend in block.legends]
        texts = [text.get_text() for text in legend.get_texts()]
        assert texts == ["maddpg-mmf [1]", "maddpg-pf [1]", "x"]
        footnote = " ".join(figure.get_supxlabel().split())
        assert "[1] Identical curves: maddpg-mmf, maddpg-pf." in footnote
        alone = drawn({"maddpg-mmf": [noisy(0, 200)]}, columns=["reward", "rate_jfi"])[1]
        colour = line_styles(["maddpg-mmf"])["maddpg-mmf"]["color"]
        alone_pixels = pixels(alone, colour)
        drawn(groups, columns=["reward", "rate_jfi"])
        assert pixels(path, colour) > 0.5 * alone_pixels

    @pytest.mark.parametrize("episodes", [1, 2])
    def test_markers_of_short_identical_runs_lie_side_by_side(self, drawn, episodes):
        groups = {name: [noisy(0, episodes)] for name in ("base", "no-rf", "x")}
        figure, _ = drawn(groups, columns=["reward"])
        places = [
            line.get_transform().transform(line.get_xydata())[0, 0] * 72 / figure.dpi
            for line in lines_of(figure.axes[0])
        ]
        assert (np.diff(places) > 3).all()

    @pytest.mark.parametrize("episodes", [1, 2, 6])
    @pytest.mark.parametrize("others", [0, 1])
    def test_curves_of_short_identical_runs_lie_within_the_axes(self, drawn, episodes, others):
        groups = {name: [noisy(0, episodes)] for name in ("base", "no-rf", "x")}
        groups |= {f"other {number}": [noisy(1, episodes)] for number in range(others)}
        figure, _ = drawn(groups, columns=["reward", "coverage", "worst_rate_bps"])
        for axes in figure.axes:
            for line in lines_of(axes):
                values = np.asarray(line.get_ydata(), float)
                low, high = axes.get_ylim()
                assert (low <= values).all() and (values <= high).all()
                assert axes.get_xlim()[0] <= np.max(line.get_xdata()) <= axes.get_xlim()[1]

    def test_what_is_identical_in_one_panel_is_said_of_it(self, drawn):
        one = noisy(0)
        other = [row | {"reward": row["reward"] + 1.0} for row in one]
        figure, _ = drawn({"a": [one], "b": [other]}, columns=["reward", "coverage"])
        footnote = " ".join(figure.get_supxlabel().split())
        assert footnote.endswith("Identical in coverage alone: a, b.")
        (legend,) = [legend for block in figure.subfigs for legend in block.legends]
        assert [text.get_text() for text in legend.get_texts()] == ["a", "b"]

    def test_the_title_is_above_the_panels(self, drawn):
        figure, _ = drawn({"one": [noisy(0)]}, title="6 UAVs, 100 clustered users at rest")
        assert figure.get_suptitle() == "6 UAVs, 100 clustered users at rest"

    def test_every_figure_has_a_panel_with_its_unit(self, drawn):
        figure, _ = drawn({"one": [noisy(0)]})
        titles = [axes.get_title().replace("\n", " ") for axes in figure.axes]
        assert titles == [
            "reward",
            "energy efficiency (Mbit/J)",
            "rate JFI",
            "load JFI",
            "worst user's rate (Mbit/s)",
            "coverage",
        ]
        assert {axes.get_xlabel() for axes in figure.axes[-3:]} == {"episode"}

    def test_resets_are_marked_in_the_colour_of_their_group(self, drawn):
        groups = {"with": [noisy(0, resets=(7, 20))], "without": [noisy(1)]}
        figure, _ = drawn(groups, columns=["rate_jfi"])
        (axes,) = figure.axes
        ticks = {to_hex(line.get_color()): list(line.get_xdata()) for line in axes.lines[1::2]}
        colours = [to_hex(line.get_color()) for line in lines_of(axes)]
        assert ticks == {colours[0]: [7.0, 20.0], colours[1]: []}
        figure, _ = drawn(groups, columns=["rate_jfi"], marks=False)
        assert all(len(line.get_xdata()) != 2 for line in figure.axes[0].lines)

    def test_the_footnote_says_what_is_drawn(self, drawn):
        many = [noisy(seed) for seed in range(6)]

        def footnote(groups, **options):
            return (
                drawn(groups, columns=["reward"], **options)[0].get_supxlabel().replace("\n", " ")
            )

        text = footnote({"many": many})
        assert "Trailing means of 20 episodes" in text
        assert "interquartile mean" in text and "95% percentile-bootstrap" in text
        assert "ended early" not in text and "resets" not in text and "single runs" not in text
        assert "ended early" in footnote({"many": [*many, noisy(8, 10)]})
        assert "single runs" in footnote({"few": many[:2]})
        assert "resets" in footnote({"one": [noisy(0, resets=(3,))]})
        assert footnote({"one": [noisy(0)]}, window=1) == ""

    def test_the_legend_names_groups_and_counts_runs(self, drawn):
        figure, _ = drawn({"many": [noisy(seed) for seed in range(6)], "one": [noisy(9)]})
        (legend,) = [legend for block in figure.subfigs for legend in block.legends]
        assert [text.get_text() for text in legend.get_texts()] == ["many (6 runs)", "one"]

    def test_groups_differ_in_colour_and_marker(self, drawn):
        groups = {f"run-{number}": [noisy(number)] for number in range(5)}
        figure, _ = drawn(groups, columns=["reward"])
        looks = [(line.get_color(), str(line.get_marker())) for line in lines_of(figure.axes[0])]
        assert len({colour for colour, _ in looks}) == len({marker for _, marker in looks}) == 5

    @pytest.mark.parametrize("columns", range(1, len(DEFAULT_COLUMNS) + 1))
    def test_nothing_overlaps_or_is_cut_off(self, drawn, columns):
        groups = {
            "20261122T211505Z-orchid-s0-zknc": [noisy(0, resets=(3,))],
            "many": [noisy(seed, 20 + seed) for seed in range(1, 8)],
            "few": [noisy(seed) for seed in range(3)],
        }
        figure, _ = drawn(groups, columns=DEFAULT_COLUMNS[:columns])
        renderer = FigureCanvasAgg(figure).get_renderer()
        boxes = [axes.get_tightbbox(renderer) for axes in figure.axes]
        boxes += [legend.get_window_extent() for b in figure.subfigs for legend in b.legends]
        boxes.append(figure._supxlabel.get_window_extent(renderer))
        whole = figure.bbox.padded(1)
        for box in boxes:
            assert whole.x0 <= box.x0 and box.x1 <= whole.x1
            assert whole.y0 <= box.y0 and box.y1 <= whole.y1
        for one, other in itertools.combinations(boxes, 2):
            overlap = one.intersection(one, other)
            assert overlap is None or min(overlap.width, overlap.height) < 2

    @pytest.mark.parametrize("name", ["curves.png", "curves.svg", "curves.pdf"])
    def test_the_same_rows_give_the_same_bytes(self, drawn, name):
        groups = {"many": [noisy(seed) for seed in range(5)]}
        first = drawn(groups, name, columns=["reward"])[1].read_bytes()
        assert drawn(groups, name, columns=["reward"])[1].read_bytes() == first

    def test_curves_of_one_episode_and_of_no_numbers_can_be_drawn(self, drawn):
        drawn({"short": [noisy(0, 1)], "none": [run_of([math.nan, math.nan])]})

    def test_runs_without_an_episode_are_passed_over(self, drawn):
        figure, _ = drawn({"failed": [[]], "good": [noisy(0), []]}, columns=["reward"])
        assert len(lines_of(figure.axes[0])) == 1

    def test_nothing_to_draw_is_an_error(self, tmp_path):
        nothing = [({}, ["reward"]), ({"a": [[]]}, ["reward"]), ({"a": [noisy(0)]}, [])]
        for groups, columns in nothing:
            with pytest.raises(ValueError, match="nothing to draw"):
                draw_learning_curves(groups, tmp_path / "x.png", columns)

    def test_leaves_the_callers_matplotlib_alone(self, drawn):
        before = dict(mpl.rcParams)
        drawn({"one": [noisy(0)]})
        assert dict(mpl.rcParams) == before


def line(values, name="run"):
    return Line(name, list(range(1, len(values) + 1)), values)


def plot(lines, width=60, **options):
    """Lines of text: heading, plot, axis, episodes, legend."""
    return [text.plain for text in terminal_curves(lines, "rate JFI", width, **options)]


class TestTerminal:
    def test_a_rising_line_in_letters(self):
        shown = plot([line([0.0, 1.0, 2.0, 3.0])], width=20, height=4, digits=1, braille=False)
        # Worked out by hand: 15 columns for 3 steps, so that a letter rises every fifth column.
        assert shown == [
            "rate JFI",
            "3.0 |            AAA",
            "    |        AAAA   ",
            "1.0 |   AAAAA       ",
            "0.0 |AAA            ",
            "    +---------------",
            "     1     2       4",
            "A run",
        ]

    def test_braille_dots_lie_where_the_values_are(self):
        shown = plot([line([0.0, 0.0, 4.0, 4.0])], width=26, height=2, digits=0)
        top, bottom = (text.split("┤")[1] for text in shown[1:3])
        # The upper left dot of a character is bit 0, the lower left one bit 6.
        assert ord(top[-1]) - 0x2800 & 0x09 and not ord(top[-1]) - 0x2800 & 0xF6 & ~0x09
        assert ord(bottom[0]) - 0x2800 & 0xC0
        assert top[0] == " " and bottom[-1] == " "

    @given(
        st.lists(st.lists(st.floats(-1e9, 1e9) | st.just(math.nan), max_size=30), max_size=5),
        st.integers(0, 150),
        st.booleans(),
    )
    @settings(max_examples=60, deadline=None)
    def test_no_line_is_wider_than_asked_and_none_is_missing(self, values, width, braille):
        names = [f"run-{number}" for number in range(len(values))]
        lines = [line(one, name) for one, name in zip(values, names, strict=True)]
        shown = plot(lines, width, braille=braille)
        if not any(math.isfinite(value) for one in values for value in one):
            assert shown == ["rate JFI: nothing to draw"]
            return
        # Numbers of ten digits leave a narrow plot no room at all.
        assert all(len(text) <= max(width, 40) for text in shown)
        legend = " ".join(shown[15:])
        assert all(name in legend for name in names)
        assert len(shown[1:13]) == 12
        if not braille:
            assert "\n".join(shown).isascii()

    def test_every_curve_shows_even_where_they_lie_on_each_other(self):
        same = [0.1, 0.5, 0.2, 0.7]
        body = "".join(
            plot([line(same, "a"), line(same, "b"), line(same, "c")], braille=False)[1:13]
        )
        assert {"A", "B", "C"} <= set(body)

    def test_a_flat_curve_lies_in_the_middle(self):
        shown = plot([line([0.5] * 9)], height=5, braille=False)
        assert "A" in shown[3] and not any("A" in shown[row] for row in (1, 2, 4, 5))

    @pytest.mark.parametrize("hole", [math.nan, math.inf, -math.inf])
    def test_what_is_no_number_leaves_a_gap(self, hole):
        shown = plot([line([1.0, 1.0, hole, 1.0, 1.0])], 20, height=3, digits=1, braille=False)
        assert shown[1:4] == ["1.5 |" + " " * 15, "1.0 |AAAAA     AAAAA", "0.5 |" + " " * 15]

    def test_axes_tell_the_greatest_and_least_value_and_the_last_episode(self):
        shown = plot([line([0.25, 0.75] * 100)], width=80)
        assert shown[1].startswith("0.750 ┤")
        assert shown[12].startswith("0.250 ┤")
        assert shown[14].split() == ["1", "100", "episode", "200"]

    def test_colours_are_those_of_the_legend(self):
        console = Console(width=60, color_system="truecolor", force_terminal=True)
        texts = terminal_curves([line([1.0, 2.0], "a"), line([2.0, 1.0], "b")], "x", 60)
        styles = [{str(segment.style) for segment in text.render(console)} for text in texts]
        in_plot = set().union(*styles[1:13]) - {"none"}
        in_legend = styles[-1]
        assert len(in_plot) == 2 and in_plot <= in_legend

    @pytest.mark.parametrize(
        ("encoding", "expected"),
        [("utf-8", True), ("ascii", False), ("latin-1", False), ("no-such-encoding", False)],
    )
    def test_braille_needs_an_encoding_that_has_it(self, encoding, expected):
        assert can_show_braille(encoding) is expected

    def test_the_table_has_ten_episodes_up_to_the_last(self):
        headings, rows = sampled_table([line([float(n) for n in range(1, 101)], "a")], 1)
        assert headings == ["episode", "a"]
        assert rows == [[str(at), f"{at}.0"] for at in range(10, 101, 10)]

    def test_the_table_of_short_and_of_different_runs(self):
        _, rows = sampled_table([line([1.0, 2.0], "a"), line([3.0, 4.0, 5.0], "b")], 0)
        assert rows == [["1", "1", "3"], ["2", "2", "4"], ["3", "-", "5"]]
        assert sampled_table([]) == (["episode"], [])
        assert sampled_table([line([])])[1] == []
