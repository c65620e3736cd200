"""``orchid reproduce`` on rows that there are; how rows are made is tested where they are made."""

import json

import pytest

from orchid_uav.experiments.reproduction.rows import write_row
from tests.helpers.processes import assert_is_an_error
from tests.helpers.reproductions import make_rows


@pytest.fixture
def rows(tmp_path):
    """Ten seeds of one method."""
    folder = tmp_path / "rows"
    for row in make_rows(["orchid"], range(10, 20), ["static-pf"]):
        write_row(folder, row)
    return folder


@pytest.fixture
def reproduce(orchid, rows, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*words, out="made"):
        return orchid("reproduce", "--no-train", f"--rows={rows}", f"--out={out}", *words)

    return run


def test_writes_what_the_rows_say(reproduce, tmp_path):
    finished = reproduce("--only=q1,c29")
    assert finished.code == 0, finished.err
    assert "not testable in this model" in finished.out
    assert (tmp_path / "made" / "report.html").read_text().startswith("<!DOCTYPE html>")
    document = json.loads((tmp_path / "made" / "claims.json").read_text())
    assert [claim["key"] for claim in document["claims"]] == ["c29"]
    assert [question["key"] for question in document["questions"]] == ["q1"]
    assert document["rows"]["orchid"] == list(range(10, 20))
    assert document["missing"] == 0


def test_json_is_the_document(reproduce, tmp_path):
    finished = reproduce("--only=c29", "--json")
    assert finished.code == 0
    assert json.loads(finished.out) == json.loads((tmp_path / "made" / "claims.json").read_text())


def test_goes_on_in_its_directory_and_in_no_other(reproduce, tmp_path):
    assert reproduce("--only=c29").code == 0
    assert reproduce("--only=c29").code == 0
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    assert_is_an_error(reproduce("--only=c29", out="other"), "other", "left alone")
    assert [path.name for path in other.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--only=c99"], ["c99"]),
        (["--only=fgi5"], ["fgi5", "fig5"]),
        (["--quick", "--only=c29"], ["full"]),
    ],
)
def test_refuses_what_does_not_fit_and_leaves_nothing(reproduce, tmp_path, words, parts):
    assert_is_an_error(reproduce(*words), *parts)
    assert not (tmp_path / "made").exists()


def test_a_row_of_another_training_is_told(reproduce, rows):
    [row] = make_rows(["orchid"], [12], (), command=["orchid", "train", "--no-rf", "--seed", "12"])
    write_row(rows, row)
    assert_is_an_error(reproduce("--only=c29"), "seed-12.json", "train --no-rf --seed 12")


def test_a_damaged_row_is_told(reproduce, rows):
    path = rows / "orchid" / "seed-12.json"
    path.write_text("{}")
    assert_is_an_error(reproduce("--only=c29"), str(path))
