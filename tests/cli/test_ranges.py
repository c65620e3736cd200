"""Lists of numbers as people write them."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.cli.ranges import MOST_VALUES, parse_counts, parse_numbers
from orchid_uav.experiments.errors import InputError


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("6", [6]),
        ("0", [0]),
        ("-3.5", [-3.5]),
        ("+4", [4]),
        (".5", [0.5]),
        ("1e3", [1000]),
        ("2.5E-1", [0.25]),
        ("4,6,8", [4, 6, 8]),
        ("8,4,6", [8, 4, 6]),
        ("4..10", [4, 5, 6, 7, 8, 9, 10]),
        ("50..200:50", [50, 100, 150, 200]),
        ("50..199:50", [50, 100, 150]),
        ("50..201:50", [50, 100, 150, 200]),
        ("7..7", [7]),
        ("7..7.5", [7]),
        ("0.5..3", [0.5, 1.5, 2.5]),
        ("-2..2:2", [-2, 0, 2]),
        ("-4..-2", [-4, -3, -2]),
        (".5...9:.2", [0.5, 0.7, 0.9]),
        ("1..2:5", [1]),
        ("0..1e3:5e2", [0, 500, 1000]),
        ("1,4..6,10..30:10", [1, 4, 5, 6, 10, 20, 30]),
        (" 4 , 6..7 ,8", [4, 6, 7, 8]),
        ("5,4..6,5", [5, 4, 6]),
        ("1,1.0,1e0", [1]),
        ("3..5,1..4", [3, 4, 5, 1, 2]),
    ],
)
def test_forms(text, values):
    found = parse_numbers(text, "--speeds")
    assert found == values
    assert all(isinstance(value, float) for value in found)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0..0.3:0.1", [0.0, 0.1, 0.2, 0.3]),
        ("0..1:0.1", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("1.1..1.4:0.1", [1.1, 1.2, 1.3, 1.4]),
        ("0..0.29:0.1", [0.0, 0.1, 0.2]),
    ],
)
def test_steps_are_decimal_and_values_those_that_one_would_write(text, values):
    assert parse_numbers(text, "--speeds") == values


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        ",",
        "4,",
        ",4",
        "4,,6",
        "four",
        "4-10",
        "4...10...2",
        "4..",
        "..10",
        "..",
        "4..10:",
        "4:2",
        "4..10:2:2",
        "4..6..8",
        "4 .. 10",
        "4 6",
        "4;6",
        "5.",
        "1_000",
        "0x10",
        "1e",
        "--4",
        "nan",
        "inf",
        "4..inf",
        "4..10\n5",
        "[4]",
    ],
)
def test_malformed_text_is_told_with_the_option_and_the_part(text):
    with pytest.raises(InputError) as raised:
        parse_numbers(text, "--users")
    message = str(raised.value)
    bad = {"4,": "", ",4": "", "4,,6": "", ",": "", " ": ""}.get(text, text)
    assert message.startswith(f"--users {bad!r} is not a number or a range: write it ")
    assert "4..10" in message and "50..200:50" in message


def test_in_a_mix_the_malformed_part_is_told():
    with pytest.raises(InputError, match=r"^--users '7\.\.x' is not a number or a range"):
        parse_numbers("4..6, 7..x ,9", "--users")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("10..4", "--users 10..4 is empty: write the smaller number first"),
        ("1,10..4,x", "--users 10..4 is empty: write the smaller number first"),
        ("10..4:2", "--users 10..4:2 is empty: write the smaller number first"),
        ("4..10:0", "--users 4..10:0 has the step 0: it must be above 0"),
        ("4..10:-2", "--users 4..10:-2 has the step -2: it must be above 0"),
        ("4..10:0e5", "--users 4..10:0e5 has the step 0e5: it must be above 0"),
        ("0..10000", "--users 0..10000 has 10,001 values, more than 10,000"),
        ("0..1:1e-9", "--users 0..1:1e-9 has 1,000,000,001 values, more than 10,000"),
        ("0..6000,7000..12000", "--users 0..6000,7000..12000 has more than 10,000 values"),
    ],
)
def test_other_faults_are_told_with_the_option_and_the_part(text, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        parse_numbers(text, "--users")


@pytest.mark.parametrize(
    "text",
    [
        "1e400",
        "-1e400",
        "1e400..2e400:1e400",
        "1..1e5000",
        "0..10:1e-999999",
        "1e99999999999999999999",
        "0..1:1e-99999999999999999999",
    ],
)
@pytest.mark.parametrize("parse", [parse_numbers, parse_counts])
def test_enormous_numbers_are_told_with_the_option(text, parse):
    with pytest.raises(InputError, match=r"^--users "):
        parse(text, "--users")


def test_as_many_values_as_allowed():
    assert len(parse_numbers(f"1..{MOST_VALUES}", "--users")) == MOST_VALUES
    twice = f"1..{MOST_VALUES},1..{MOST_VALUES}"
    assert len(parse_numbers(twice, "--users")) == MOST_VALUES
    halves = f"1..{MOST_VALUES // 2},{MOST_VALUES // 2 + 1}..{MOST_VALUES}"
    assert len(parse_numbers(halves, "--users")) == MOST_VALUES


class TestCounts:
    @pytest.mark.parametrize(
        ("text", "values"),
        [("4..10:2", [4, 6, 8, 10]), ("1", [1]), ("1e2", [100]), ("7.0,3", [7, 3])],
    )
    def test_are_whole_numbers(self, text, values):
        found = parse_counts(text, "--uavs")
        assert found == values
        assert all(type(value) is int for value in found)

    @pytest.mark.parametrize(
        ("text", "value"),
        [("0", "0"), ("-1", "-1"), ("2.5", "2.5"), ("1..3:0.5", "1.5"), ("0..4", "0")],
    )
    def test_of_less_than_one_or_of_parts_are_refused(self, text, value):
        message = f"--uavs {text} contains {value}, which is not a whole number of 1 or more"
        with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
            parse_counts(text, "--uavs")

    def test_may_begin_at_zero_where_the_caller_says_so(self):
        assert parse_counts("0..2", "--seeds", least=0) == [0, 1, 2]
        with pytest.raises(InputError, match="whole number of 0 or more"):
            parse_counts("-1", "--seeds", least=0)

    def test_malformed_text_is_told_as_for_numbers(self):
        with pytest.raises(InputError, match=r"^--uavs 'some' is not a number or a range"):
            parse_counts("some", "--uavs")


whole = st.integers(-10_000, 10_000)


@given(whole, st.integers(0, 500), st.integers(1, 1000))
def test_a_range_of_whole_numbers_is_pythons_with_its_end(first, count, step):
    last = first + count
    expected = [float(value) for value in range(first, last + 1, step)]
    assert parse_numbers(f"{first}..{last}:{step}", "--x") == expected
    if step == 1:
        assert parse_numbers(f"{first}..{last}", "--x") == expected


@given(whole, st.integers(0, 300), st.integers(1, 50), st.integers(0, 6))
def test_a_decimal_range_is_a_range_of_whole_numbers_with_a_point_in_it(
    first, count, step, decimals
):
    def written(value: int) -> str:
        return f"{value}e-{decimals}"

    last = first + count * step
    text = f"{written(first)}..{written(last)}:{written(step)}"
    expected = [float(written(first + index * step)) for index in range(count + 1)]
    assert parse_numbers(text, "--x") == expected


@given(st.lists(st.one_of(whole, st.floats(-1e6, 1e6)), min_size=1, max_size=20))
def test_a_list_keeps_its_order_and_each_value_once(values):
    text = ",".join(repr(value) for value in values)
    assert parse_numbers(text, "--x") == list(dict.fromkeys(float(value) for value in values))


@given(st.text(alphabet="0123456789.,:+- ", max_size=9))
def test_any_text_gives_numbers_or_says_what_is_wrong(text):
    try:
        values = parse_numbers(text, "--x")
    except InputError as error:
        assert str(error).startswith("--x ")
    else:
        assert 1 <= len(values) <= MOST_VALUES
        assert len(set(values)) == len(values)
