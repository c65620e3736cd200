"""Values of options: what they mean, and what is told where they mean nothing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.places import (
    parse_altitudes,
    parse_budget,
    parse_home,
    parse_mast,
    parse_reserve,
    parse_want,
)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("17.3,-62.7", (17.3, -62.7, None)),
        (" 17.3 , -62.7 , 30 ", (17.3, -62.7, 30)),
        ("-1200,3.5e2,0.5", (-1200, 350, 0.5)),
        ("-17.3,-62.7,1000", (-17.3, -62.7, 1000)),
    ],
)
def test_masts(text, values):
    assert parse_mast(text)[1:] == values
    assert parse_mast(text).given == f"--mast {text}"


def test_homes_lie_above_or_below_the_sea():
    assert parse_home("52.3,4.9,-3.5")[1:] == (52.3, 4.9, -3.5)
    assert parse_home("0,0") == ("--home 0,0", 0, 0, None)


@pytest.mark.parametrize(
    ("parse", "text", "told"),
    [
        (parse_mast, "17.3", "LAT,LON or LAT,LON,HEIGHT_M, such as 17.2964,-62.7243,30"),
        (parse_mast, "17.3,-62.7,30,1", "write LAT,LON"),
        (parse_mast, "17,3,-62,7", "write LAT,LON"),
        (parse_mast, "", "write LAT,LON"),
        (parse_mast, "17.3,west", "'west' is not a number"),
        (parse_mast, "17.3,", "missing"),
        (parse_mast, "nan,0", "'nan' is not a number"),
        (parse_mast, "1e999,0", "not a finite number"),
        (parse_mast, "17.3,-62.7,0", "above 0 and at most 1,000 m"),
        (parse_mast, "17.3,-62.7,1000.5", "above 0 and at most 1,000 m"),
        (parse_home, "17.3 -62.7", "LAT,LON or LAT,LON,AMSL_M"),
        (parse_home, "17.3,-62.7,9001", "between -500 and 9,000 m"),
    ],
)
def test_places_that_are_none(parse, text, told):
    with pytest.raises(InputError) as caught:
        parse(text)
    assert told in str(caught.value)
    assert text in str(caught.value)
    assert str(caught.value).count("\n") <= 1


@pytest.mark.parametrize(
    ("text", "rate_bps", "share"),
    [
        ("1Mbps:95%", 1e6, 0.95),
        ("500 kbps : 0.9", 5e5, 0.9),
        ("0.5Gbps:100 %", 5e8, 1.0),
        ("1 mbps:1", 1e6, 1.0),
        ("1Mbps:1%", 1e6, 0.01),
        ("1.5Mbps:0.5", 1.5e6, 0.5),
        (" 2Kbps:99.9% ", 2e3, 0.999),
    ],
)
def test_wants(text, rate_bps, share):
    assert parse_want(text) == pytest.approx((rate_bps, share))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1Mbps", "a colon and a share, such as 1Mbps:95%"),
        ("1:95%", "such as 1Mbps:95%"),
        ("95%:1Mbps", "such as 1Mbps:95%"),
        ("1MBps:95%", "B stands for bytes, b for bits"),
        ("1MB/s:95%", "B stands for bytes"),
        ("1Mbps:95", "has the share 95: write one above 0, and at most 100% or 1"),
        ("1Mbps:0%", "has the share 0%"),
        ("1Mbps:101%", "has the share 101%"),
        ("0Mbps:95%", "has a rate that nobody can have"),
        ("1001Gbps:95%", "has a rate that nobody can have"),
        ("1,5Mbps:95%", "such as 1Mbps:95%"),
        ("-1Mbps:95%", "such as 1Mbps:95%"),
        ("nanMbps:95%", "such as 1Mbps:95%"),
        ("", "such as 1Mbps:95%"),
    ],
)
def test_wants_that_are_none(text, told):
    with pytest.raises(InputError) as caught:
        parse_want(text)
    assert str(caught.value).startswith("--want ")
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "altitudes"),
    [("80..120", (80, 120)), ("100", (100, 100)), ("90.5..90.5", (90.5, 90.5)), (" 1 ", (1, 1))],
)
def test_altitudes(text, altitudes):
    assert parse_altitudes(text) == altitudes


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("120..80", "write the lower altitude first, 80..120"),
        ("80-120", "such as 100 or 80..120"),
        ("80...120", "such as 100 or 80..120"),
        ("100m", "such as 100 or 80..120"),
        ("..120", "such as 100 or 80..120"),
        ("-5", "such as 100 or 80..120"),
        ("0..50", "not between 1 and 10,000 m"),
        ("10001", "not between 1 and 10,000 m"),
        ("nan", "such as 100 or 80..120"),
    ],
)
def test_altitudes_that_are_none(text, told):
    with pytest.raises(InputError) as caught:
        parse_altitudes(text)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "budget"),
    [
        ("5s", (5, None)),
        ("500ms", (0.5, None)),
        ("2min", (120, None)),
        ("0.5 min", (30, None)),
        ("5000", (None, 5000)),
        ("1", (None, 1)),
        ("1440min", (86_400, None)),
    ],
)
def test_budgets(text, budget):
    assert parse_budget(text) == budget


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("5m", "such as 5s, 500ms or 2min, or a number of evaluations such as 5000"),
        ("5h", "such as 5s, 500ms or 2min"),
        ("5.5", "such as 5s, 500ms or 2min"),
        ("5,000", "such as 5s, 500ms or 2min"),
        ("-5s", "such as 5s, 500ms or 2min"),
        ("", "such as 5s, 500ms or 2min"),
        ("0s", "not a time above 0 and up to a day"),
        ("1441min", "not a time above 0 and up to a day"),
        ("0", "from 1 to 1,000,000,000"),
        ("1000000001", "from 1 to 1,000,000,000"),
    ],
)
def test_budgets_that_are_none(text, told):
    with pytest.raises(InputError) as caught:
        parse_budget(text)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "reserve"), [("20%", 0.2), ("0.2", 0.2), ("0", 0), ("99.9 %", 0.999), ("0%", 0)]
)
def test_reserves(text, reserve):
    assert parse_reserve(text) == pytest.approx(reserve)


@pytest.mark.parametrize("text", ["20", "1", "100%", "-1%", "", "nan", "20%%", "20 percent"])
def test_reserves_that_are_none(text):
    with pytest.raises(InputError, match=r"such as 20% or 0\.2"):
        parse_reserve(text)


@given(st.text() | st.from_regex(r"[0-9.,:%a-zA-Z +-]{0,12}", fullmatch=True))
def test_any_text_is_understood_or_refused(text):
    parsers = (parse_mast, parse_home, parse_want, parse_altitudes, parse_budget, parse_reserve)
    for parse in parsers:
        try:
            parse(text)
        except InputError as error:
            assert str(error)
