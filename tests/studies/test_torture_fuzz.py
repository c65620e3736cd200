"""The torture by fuzzed input can find something."""

import os
import signal
import sys
from pathlib import Path

import pytest

from studies.torture import cases, fuzz
from studies.torture.cases import Bench, Ended, Tally, broken_promises
from studies.torture.fuzz import read_range

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="cases are forked processes")


def ended(code: int, err: str = "", arguments: tuple[str, ...] = ()) -> Ended:
    return Ended(arguments, code, "", err, was_stopped=False)


class TestPromises:
    @pytest.mark.parametrize(
        ("how", "after", "expected"),
        [
            (ended(0), {"made": "x"}, []),
            (ended(2, "error: no"), {}, []),
            (ended(1, "error: no"), {}, ["exit code 1"]),
            (ended(-11), {}, ["exit code -11"]),
            (ended(130), {}, ["exit code 130"]),  # nobody asked it to stop
            (ended(2, "no"), {}, ["0 lines that begin with 'error: '"]),
            (ended(2, "error: a\nerror: b"), {}, ["2 lines that begin with 'error: '"]),
            (ended(2, "error: a\nerror: b", ("plan", "--check")), {}, []),
            (ended(2, "error: no"), {"made": "x"}, ["refused, yet left or changed made"]),
            (ended(0, "Traceback (most recent call last):"), {}, ["a traceback"]),
        ],
    )
    def test_are_seen_to_be_broken(self, how, after, expected):
        assert broken_promises(how, {}, after) == expected

    def test_a_file_that_a_refused_command_removes_is_seen(self):
        broken = broken_promises(ended(2, "error: no"), {"people.csv": "x"}, {})
        assert broken == ["refused, yet left or changed people.csv"]


def faulty(arguments: list[str]) -> int:
    """A command with every fault that is looked for."""
    match arguments[0]:
        case "raise":
            raise RuntimeError("nobody caught this")
        case "leave":
            Path("left").write_text("x")
            print("error: refused", file=sys.stderr)
            return 2
        case "die":
            os.kill(os.getpid(), signal.SIGKILL)
        case "refuse":
            print("error: refused", file=sys.stderr)
            return 2
    return 0


class TestCases:
    @pytest.fixture
    def bench(self, tmp_path, monkeypatch):
        monkeypatch.setattr(cases, "main", faulty)
        template = tmp_path / "template"
        template.mkdir()
        (template / "people.csv").write_text("lat,lon\n")
        return Bench(tmp_path, template)

    @pytest.mark.parametrize("fault", ["raise", "leave", "die"])
    def test_faults_are_found(self, bench, fault):
        with pytest.raises(AssertionError):
            bench.try_one([fault], {}, Tally())

    def test_others_are_counted(self, bench):
        tally = Tally()
        bench.try_one(["refuse"], {"drawn.csv": b"x"}, tally)
        bench.try_one(["accept"], {}, tally)
        assert tally.codes == {"2": 1, "0": 1}
        assert len(tally.messages) == 1

    def test_every_case_finds_the_directory_as_it_was(self, bench, tmp_path):
        bench.try_one(["accept"], {"drawn.csv": b"x"}, Tally())
        assert {path.name for path in (tmp_path / "working").iterdir()} == {"people.csv"}


class TestRanges:
    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("4..10", [4, 5, 6, 7, 8, 9, 10]),
            ("50..200:50", [50, 100, 150, 200]),
            ("4,6,4", [4, 6]),
            ("0..0.3:0.1", [0, 0.1, 0.2, 0.3]),
            ("0..10000", None),
            ("4..", None),
            ("5..4", None),
        ],
    )
    def test_are_read_as_the_documentation_says(self, text, expected):
        assert read_range(text) == expected


def test_some_cases_of_the_quick_surfaces_pass(monkeypatch):
    every = fuzz._surfaces

    def quick(template: Path) -> dict:
        left_out = {"command lines", "ranges", "position files"}
        return {key: value for key, value in every(template).items() if key not in left_out}

    monkeypatch.setattr(fuzz, "_surfaces", quick)
    document = fuzz.run(0.001, 0)
    assert document["failures"] == []
    assert [surface["cases"] >= 10 for surface in document["surfaces"]] == [True] * 3
