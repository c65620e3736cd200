"""The torture finds what is wrong: pretended commands that forget, litter, fail or say nothing."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from studies.torture import __main__ as command
from studies.torture import cycles, faults, kills
from studies.torture.subjects import Subject, differences, litter

COUNTING = """
import sys, time
from pathlib import Path
place, how = Path("work"), sys.argv[1]
place.mkdir(exist_ok=True)
state = place / "state"
begun, count = map(int, state.read_text().split()) if state.exists() else (0, 0)
if how == "fails" and begun:
    sys.exit("error: it was killed before")
if how == "litters" and begun:
    (place / ".left").write_text("")
begun += 1
for count in range(count, 15):
    new = place / ".new"
    new.write_text(f"{begun} {count + 1}")
    time.sleep(0.005)
    new.replace(state)
    time.sleep(0.005)
new = place / ".new"
new.write_text("done" + (f" {begun}" if how == "forgets" else ""))
new.replace(place / "result")
"""


@pytest.fixture
def pretended(tmp_path, monkeypatch):
    """Calls give a subject that counts to 15, in a way of its own."""
    script = tmp_path / "counting.py"
    script.write_text(COUNTING)
    monkeypatch.setattr(kills, "ORCHID", (sys.executable, "-I", "-S", str(script)))

    def make(how: str) -> Subject:
        def phase(working: Path) -> str:
            return "after its end" if (working / "work" / "result").exists() else "while it counts"

        return Subject(
            name=how,
            command=(how,),
            going_on=lambda working: None if (working / "work" / "result").exists() else (how,),
            outcome=lambda working: {"result": (working / "work" / "result").read_text()},
            phase=phase,
            phases=("in the start", "while it counts", "after its end"),
        )

    return make


@pytest.mark.parametrize(
    ("how", "found"),
    [
        ("goes on", None),
        ("forgets", "forgets: differs: result"),
        ("litters", "litters: left behind: work/.left"),
        ("fails", "fails: orchid fails ends with 1: error: it was killed before"),
    ],
)
def test_kills_find_what_a_command_does_wrong(pretended, how, found):
    told = kills.run(0.06, 1, [pretended(how)])
    [subject] = told["subjects"]
    assert subject["kills"] == len(told["kills"]) >= 6
    assert sum(subject["phases"].values()) == subject["kills"]
    assert subject["phases"]["while it counts"] > 0
    assert set(told["failures"]) == (set() if found is None else {found})


def test_a_command_that_fails_by_itself_is_not_tortured(pretended, monkeypatch, tmp_path):
    script = tmp_path / "failing.py"
    script.write_text("import sys; sys.exit('error: no')")
    monkeypatch.setattr(kills, "ORCHID", (sys.executable, "-I", str(script)))
    with pytest.raises(RuntimeError, match="error: no"):
        kills.run(0.01, 0, [pretended("goes on")])


def test_outcomes_differ_in_what_was_changed_or_is_missing():
    assert differences({"a": "1", "b": "2"}, {"b": "2", "a": "1"}) == []
    assert differences({"a": "1", "b": "2", "c": "3"}, {"b": "3", "a": "1", "d": "4"}) == [
        *("b", "c", "d"),
    ]


def test_litter_is_hidden_and_no_lock(tmp_path):
    run = tmp_path / "runs" / "a"
    run.mkdir(parents=True)
    for name in ("run.json", ".lock", ".reserve", ".run.json.abcd1234", "a.json"):
        (run / name).write_text("")
    assert [path.name for path in litter(tmp_path)] == [".reserve", ".run.json.abcd1234"]


@pytest.mark.parametrize(
    ("told", "code", "found"),
    [
        ("warning: no\nerror: no room\ncontinue with: it", 1, []),
        ("error: no room", 2, ["it ended with 2, which is none of (1,)"]),
        ("no room", 1, ["not one line that begins with error:"]),
        ("", 1, ["no clear message: ", "not one line that begins with error:"]),
        ("Traceback\nerror: no", 1, ["no clear message: Traceback\nerror: no"]),
        ("error: a\nerror: b", 1, ["not one line that begins with error:"]),
    ],
)
def test_faults_judge_how_a_command_ends(pretended, tmp_path, monkeypatch, told, code, found):
    script = tmp_path / "failing.py"
    script.write_text(
        "import os, sys, time\nprint('stations:', flush=True)\n"
        "while os.path.exists('people.csv'): time.sleep(0.01)\n"
        f"print({told!r}, file=sys.stderr, end='')\nsys.exit({code})"
    )
    monkeypatch.setattr(kills, "ORCHID", (sys.executable, "-I", "-S", str(script)))

    class Removed(faults.Fault):
        name = how = "removed"

        def strike(self, working, process):
            (working / "people.csv").unlink()

        def heal(self, working):
            pass

    subject = Subject("plan", ("plan",), lambda _: None, lambda _: {}, lambda _: "", ())
    case = faults.Case(subject, Removed())
    faults.suffer(case, tmp_path / "case", {})
    assert list(case.failures) == found
    assert case.code == code
    other = faults.Case(subject, Removed())
    faults.suffer(other, tmp_path / "case", {"plan.json": "other"})
    assert other.failures[len(found) :] == ("differs: plan.json",)


def test_stops_and_goes_are_compared(monkeypatch):
    told = cycles.of_learner("MAPPO", 3, 0)
    assert (told["cycles"], told["differences"]) == (3, [])
    assert [one["cycle"] for one in told["noted"]] == [3]


@pytest.mark.parametrize("failures", [[], ["something differs"]])
def test_the_command_fails_where_a_part_does(monkeypatch, tmp_path, capsys, failures):
    part = SimpleNamespace(run=lambda scale, seed: {"failures": failures, "seen": scale})
    monkeypatch.setitem(sys.modules, "studies.torture.pretended", part)
    monkeypatch.setitem(command.PARTS, "pretended", "nothing")
    arguments = ["pretended", "--scale=0.5", "--seed=7", f"--json-dir={tmp_path}"]
    assert command.main(arguments) == bool(failures)
    document = json.loads((tmp_path / "pretended.json").read_text())
    assert document["failures"] == failures
    assert (document["seen"], document["settings"]) == (0.5, {"scale": 0.5, "seed": 7})
    again = "python -m studies.torture pretended --scale 0.5 --seed 7"
    assert document["command"] == again
    assert (again in capsys.readouterr().err) == bool(failures)
