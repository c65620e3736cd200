"""Tables of people: every trap of CSV, and mistakes that are named as a spreadsheet names them."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.reading.people import read_people

PLACES = [(17.3012, -62.7204), (17.302, -62.7199)]


def write(folder: Path, content: str | bytes, name: str = "people.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def refusal(folder: Path, content: str | bytes) -> str:
    with pytest.raises(InputError) as caught:
        read_people(write(folder, content))
    return str(caught.value)


GOOD = {
    "plain": "lat,lon\n17.3012,-62.7204\n17.302,-62.7199\n",
    "no line end at the end": "lat,lon\n17.3012,-62.7204\n17.302,-62.7199",
    "names spelt otherwise": " Latitude ,LNG\n17.3012,-62.7204\n17.302,-62.7199\n",
    "columns in another order": "name,long,id,lat\nA,-62.7204,1,17.3012\nB,-62.7199,2,17.302\n",
    "semicolons": "lat;lon\n17.3012;-62.7204\n17.302;-62.7199\n",
    "tabs": "lat\tlon\n17.3012\t-62.7204\n17.302\t-62.7199\n",
    "decimal commas": "lat;lon\n17,3012;-62,7204\n17,302;-62,7199\n",
    "decimal commas after tabs": "lat\tlon\n17,3012\t-62,7204\n17,302\t-62,7199\n",
    "Windows line ends": "lat,lon\r\n17.3012,-62.7204\r\n17.302,-62.7199\r\n",
    "line ends of old": "lat,lon\r17.3012,-62.7204\r17.302,-62.7199\r",
    "quotes": '"lat","lon"\n"17.3012","-62.7204"\n"17.302","-62.7199"\n',
    "a comma in quotes": 'name,lat,lon\n"A, B",17.3012,-62.7204\n"C ""D""",17.302,-62.7199\n',
    "a line end in quotes": 'name,lat,lon\n"A\nB",17.3012,-62.7204\n"C",17.302,-62.7199\n',
    "blank lines": "\n\nlat,lon\n\n17.3012,-62.7204\n , \n17.302,-62.7199\n\n\n",
    "cells without values": ",,\n;;\nlat;lon\n17.3012;-62.7204\n17.302;-62.7199\n",
    "empty cells at the end": "lat,lon,,\n17.3012,-62.7204,,,,\n17.302,-62.7199\n",
    "blanks and a plus": "lat,lon\n +17.3012 ,\u00a0-62.7204\u00a0\n17.302,-62.7199\n",
    "exponents": "lat,lon\n1.73012e1,-6.27204E+1\n17.302,-62.7199\n",
    "a typographic minus": "lat,lon\n17.3012,\u221262.7204\n\u200e17.302,-62.7199\n",
    "UTF-8 with a mark": "\ufefflat,lon\n17.3012,-62.7204\n17.302,-62.7199\n",
}


@pytest.mark.parametrize("content", GOOD.values(), ids=GOOD)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_the_same_people_however_they_are_written(tmp_path, content, encoding):
    table = read_people(write(tmp_path, content.encode(encoding)))
    assert table.on_earth
    assert table.coordinates.tolist() == [list(place) for place in PLACES]
    assert table.coordinates.dtype == np.float64
    assert table.weights.dtype == np.int64
    assert table.weights.tolist() == [1, 1]
    assert any("counts as one person" in note for note in table.notes)


def test_big_endian_utf16(tmp_path):
    table = read_people(write(tmp_path, b"\xfe\xff" + GOOD["plain"].encode("utf-16-be")))
    assert table.coordinates.tolist() == [list(place) for place in PLACES]


@pytest.mark.parametrize("name", ["people", "Weight", " COUNT "])
def test_weights(tmp_path, name):
    content = f"x_m,y_m,{name}\n0,10,1\n-5.5,20,40\n3,4,100000\n5,6,7.0\n"
    table = read_people(write(tmp_path, content))
    assert not table.on_earth
    assert table.coordinates.tolist() == [[0, 10], [-5.5, 20], [3, 4], [5, 6]]
    assert table.weights.tolist() == [1, 40, 100_000, 7]
    assert table.notes == ()


def test_rows_are_called_what_a_spreadsheet_calls_them(tmp_path):
    content = '\nlat,lon,name\n\n17.3,-62.7,"A\nB"\n17.3,-62.71,C\n,,\n17.3,-62.72,D\n'
    table = read_people(write(tmp_path, content))
    assert table.sources == ("people.csv, row 4", "people.csv, row 5", "people.csv, row 7")


def test_bytes_that_are_not_utf8_cost_a_note_and_no_row(tmp_path):
    content = "name,lat,lon\nCafé,17.3012,-62.7204\nSão João,17.302,-62.7199\n"
    table = read_people(write(tmp_path, content.encode("latin-1")))
    assert table.coordinates.tolist() == [list(place) for place in PLACES]
    assert any("not UTF-8" in note for note in table.notes)
    told = read_people(write(tmp_path, content)).notes
    assert not any("UTF-8" in note for note in told)


WRONG_CELLS = {
    "abc": "'abc' is not a number",
    "": "missing",
    "nan": "'nan' is not a number",
    "NaN": "is not a number",
    "-inf": "is not a number",
    "1e999": "is not a finite number",
    "1_7": "is not a number",
    "0x11": "is not a number",
    "\uff11\uff17": "is not a number",  # digits, but not of ASCII
    "17°18'": "write decimal degrees instead of minutes and seconds",
    "90.5": "90.5 is not a latitude, which lies between -90 and 90 degrees",
    "-89.95": "too near to a pole",
    "1e308": "is not a latitude",
}


@pytest.mark.parametrize(("cell", "told"), WRONG_CELLS.items())
def test_what_is_wrong_with_a_latitude_is_told_with_its_row_and_column(tmp_path, cell, told):
    message = refusal(tmp_path, f"id,Lat,lon\n1,17.3,-62.7\n2,{cell},-62.7\n")
    first, second = message.splitlines()
    assert first.startswith(f"{tmp_path / 'people.csv'} has 1 mistake;")
    assert second.startswith("  people.csv, row 3: column Lat: ")
    assert told in second


@pytest.mark.parametrize(
    "cell", ["0", "-1", "2.5", "many", "", "nan", "1,5", "1.000", "100001", "1e2", "9" * 400]
)
def test_what_is_no_number_of_people(tmp_path, cell):
    message = refusal(tmp_path, f"lat;lon;people\n17.3;-62.7;4\n17.3;-62.71;{cell}\n")
    assert "people.csv, row 3: column people: " in message
    assert "number of people" in message


def test_all_mistakes_are_told_up_to_twenty(tmp_path):
    rows = "".join(f"17.3,-62.7,{'x' if row % 2 else 1}\n" for row in range(2, 102))
    lines = refusal(tmp_path, "lat,lon,people\n" + rows).splitlines()
    assert "has 50 mistakes" in lines[0]
    assert [line.split(":")[0] for line in lines[1:21]] == [
        f"  people.csv, row {row}" for row in range(3, 43, 2)
    ]
    assert lines[21:] == ["  and 30 more"]


def test_a_row_may_have_several_mistakes(tmp_path):
    message = refusal(tmp_path, "lat,lon,people\nnorth,181,0\n")
    assert [line.split(":")[1] for line in message.splitlines()[1:]] == [
        " column lat",
        " column lon",
        " column people",
    ]


HEADERS = {
    "latitud,longitud": "did you mean 'latitude' or 'longitude'?",
    "lat,y": "no column for longitude; it has 'lat', 'y'",
    "name,place": "no columns for positions; it has 'name', 'place'",
    "easting,northing": "eastings and northings, which mean nothing without their grid",
    "17.3,-62.7": "numbers in its first row",
    "lat,lon,x_m,y_m": "degrees and in metres, 'lat' and 'lon' and 'x_m' and 'y_m'",
    "lat,lon,x_m": "degrees and in metres, 'lat' and 'lon' and 'x_m'",
    "lat,latitude,lon": "'lat' and 'latitude' mean the same",
    "lat,lon,lon": "'lon' and 'lon' mean the same",
    "lat,lon,people,count": "'people' and 'count' mean the same",
    "x,y": "did you mean 'x_m' or 'y_m'?",
}


@pytest.mark.parametrize(("header", "told"), HEADERS.items())
def test_what_is_told_about_columns(tmp_path, header, told):
    message = refusal(tmp_path, f"{header}\n17.3,-62.7,1,1\n")
    assert told in message
    if "mean the same" not in told:
        assert "name two columns" in message or "keep those of one kind" in message


def test_projected_columns_beside_degrees_are_just_more_columns(tmp_path):
    table = read_people(write(tmp_path, "easting,northing,lat,lon\n1,2,17.3,-62.7\n"))
    assert table.coordinates.tolist() == [[17.3, -62.7]]


def test_decimal_marks_are_not_mixed(tmp_path):
    message = refusal(tmp_path, "x_m;y_m\n987,5;12\n1.234;987,5\n")
    assert "people.csv, row 3: column x_m: '1.234' has another decimal mark than row 2" in message


def test_separators_of_thousands_are_refused(tmp_path):
    assert "'1,234' is not a number" in refusal(tmp_path, 'x_m,y_m\n"1,234",12\n')
    assert "'1.234,5' is not a number" in refusal(tmp_path, "x_m;y_m\n1.234,5;12\n")


def test_unquoted_decimal_commas_are_not_two_columns(tmp_path):
    message = refusal(tmp_path, "lat,lon\n17,3012,-62,7204\n")
    assert "people.csv, row 2: 4 cells are more than the 2 columns" in message


def test_quotation_marks_that_are_not_closed(tmp_path):
    assert "from row 3 on" in refusal(tmp_path, 'lat,lon,name\n17.3,-62.7,A\n17.3,-62.7,"B\n')


@pytest.mark.parametrize(
    "content", ["", "\n\n", "\ufeff", "lat,lon\n", "lat,lon\n\n,\n", ",", ',"",\n', "\u00a0,\n"]
)
def test_nobody(tmp_path, content):
    assert refusal(tmp_path, content).count("\n") == 0


@pytest.mark.parametrize(
    "content",
    [
        GOOD["plain"].encode("utf-16-le"),  # without a byte-order mark
        GOOD["plain"].encode("utf-32"),
        b"PK\x03\x04\0\0\0\0",
        b"\xff\xfel\0a\0t",
        b"lat,lon\n17.3,-62.7\0\n",
    ],
)
def test_what_is_no_text(tmp_path, content):
    assert "save it as" in refusal(tmp_path, content)


def test_what_is_no_file_of_a_known_format(tmp_path):
    for path, told in (
        (tmp_path / "missing.csv", "cannot read"),
        (tmp_path / "folder.csv", "not a regular file"),
        (write(tmp_path, "", "people.xlsx"), "save its table as CSV"),
        (write(tmp_path, "", "people"), "ends in none of .csv"),
        (write(tmp_path, "", "people.pdf"), "ends in none of .csv"),
    ):
        if path.name == "folder.csv":
            path.mkdir()
        with pytest.raises(InputError, match=told):
            read_people(path)


def test_a_row_that_lies_elsewhere_is_named(tmp_path):
    message = refusal(tmp_path, GOOD["plain"] + "17.301,-62.72\n-62.721,17.302\n")
    assert "people.csv, row 5: -62.721, 17.302 is " in message
    assert "latitude and longitude seem to be swapped" in message


def test_twenty_thousand_rows_and_no_more(tmp_path):
    row = "17.3,-62.7\n"
    table = read_people(write(tmp_path, "lat,lon\n" + "\n" * 100 + row * 20_000))
    assert len(table.weights) == len(table.sources) == 20_000
    assert any("repeat the position" in note for note in table.notes)
    assert "more than 20,000 positions" in refusal(tmp_path, "lat,lon\n" + row * 20_001)


def test_ten_million_people_and_no_more(tmp_path):
    row = "17.3,-62.7,100000\n"
    assert read_people(write(tmp_path, "lat,lon,people\n" + row * 100)).weights.sum() == 10**7
    told = refusal(tmp_path, "lat,lon,people\n" + row * 100 + "17.3,-62.7,1\n")
    assert "10,000,001 people, more than the 10,000,000" in told


@pytest.mark.parametrize(
    ("filling", "told"),
    [
        ("17.3,-62.7,household\n", "more than 20,000 positions"),
        ("1" * 100, "more than 1,048,576 characters in line 2"),
        ('"17.3\n', "cannot be read from row 2 on"),
    ],
)
def test_large_files_are_refused_early_and_in_little_memory(tmp_path, filling, told):
    path = tmp_path / "people.csv"
    count = 12_000_000 // len(filling)
    path.write_text("lat,lon,name\n" + filling * count, encoding="utf-8")
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=told):
            read_people(path)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


def test_more_lines_than_a_spreadsheet_has_are_refused(tmp_path):
    assert "more than 1,048,576 lines" in refusal(tmp_path, b"lat,lon" + b"\n" * (2**20 + 1))


@settings(deadline=None, max_examples=60)
@given(
    places=st.lists(
        st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.integers(1, 100_000)),
        min_size=1,
        max_size=20,
    ),
    latitude=st.floats(-85, 85),
    delimiter=st.sampled_from(",;\t"),
    end=st.sampled_from(["\n", "\r\n"]),
    comma=st.booleans(),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16"]),
)
def test_what_is_written_is_what_is_read(
    tmp_path_factory, places, latitude, delimiter, end, comma, encoding
):
    degrees = [(latitude + north, 12.0 + east) for north, east, _ in places]
    lines = [delimiter.join(("count", "lon", "lat", "née"))]
    for (north, east), (_, _, weight) in zip(degrees, places, strict=True):
        numbers = [f"{east!r}", f"{north!r}"]
        if comma and delimiter != ",":
            numbers = [number.replace(".", ",") for number in numbers]
        lines.append(delimiter.join((str(weight), *numbers, "é")))
    folder = tmp_path_factory.mktemp("tables")
    table = read_people(write(folder, end.join(lines).encode(encoding)))
    assert table.coordinates.tolist() == [list(place) for place in degrees]
    assert table.weights.tolist() == [weight for *_, weight in places]
