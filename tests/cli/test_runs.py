"""``orchid runs``: listing, filtering, sorting, showing, comparing and deleting."""

import hashlib
import io
import json
import os
import re
import shlex
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.cli.console import plain
from orchid_uav.cli.tables import runs as runs_display
from orchid_uav.cli.tables.runs import LIST_COLUMNS, SHOWN_ON_TERMINAL, columns_that_fit
from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs import removal as run_removal
from orchid_uav.experiments.runs.filters import Keys, select
from orchid_uav.experiments.runs.index import (
    Run,
    differences,
    read_index,
    read_log,
    read_run,
    short_names,
)
from orchid_uav.experiments.runs.records import find_run
from orchid_uav.experiments.runs.removal import plan_removal, remove
from tests.helpers.damage import reseal
from tests.helpers.processes import (
    ESCAPE,
    assert_is_an_error,
    fingerprint,
    record_of,
    without_privileges,
)
from tests.helpers.run_directories import begin_run, make_run, row, rows

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _no_git(monkeypatch):
    """It would be asked for every run that is made."""
    monkeypatch.setattr(provenance, "git_commit", lambda: None)


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Where runs are looked for. Its own, without the earlier run of ``runs_dir``."""
    directory = tmp_path / "tracked"
    directory.mkdir()
    monkeypatch.chdir(tmp_path)
    return directory


@pytest.fixture
def listed(orchid, runs):
    """``orchid runs list --json``, the ids and the document."""

    def run(*arguments):
        finished = orchid("runs", "list", "--json", "--runs-dir", runs, *arguments)
        assert finished.code == 0, finished.err
        document = json.loads(finished.out)
        return [one["id"] for one in document["runs"]], document

    return run


@pytest.fixture
def type_in(monkeypatch):
    """Calls make stdin a terminal at which that is typed."""

    class Keyboard(io.StringIO):
        def isatty(self):
            return True

    return lambda text: monkeypatch.setattr(sys, "stdin", Keyboard(text))


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self):
        return True


def on_terminal(monkeypatch, orchid, width, *arguments):
    """What a command writes on a terminal, without its colours."""
    screen = Terminal()
    monkeypatch.setenv("COLUMNS", str(width))
    made = runs_display.Console
    monkeypatch.setattr(
        "orchid_uav.cli.console.Console",
        lambda **options: made(
            **options | {"file": screen, "width": width, "force_terminal": True}
        ),
    )
    assert orchid(*arguments).code == 0
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue())


class TestList:
    def test_a_row_a_run_latest_first(self, orchid, runs):
        first = make_run(runs, "first", config={"training__seed": 4}, episodes=60)
        reseal(first / "run.json", started="2026-01-01T00:00:00+00:00")
        second = make_run(runs, "second", status="failed", log=rows(2), episodes=7)
        finished = orchid("runs", "list", "--runs-dir", runs)
        assert (finished.code, finished.err) == (0, "")
        header, *lines = [line.split("\t") for line in finished.out.splitlines()]
        assert header[:5] == ["id", "status", "algorithm", "seed", "episodes"]
        assert [line[:5] for line in lines] == [
            [second.name, "failed", "mappo", "0", "2/7"],
            [first.name, "completed", "mappo", "4", "60/60"],
        ]
        # Energy efficiency is column 3 of episodes.csv: 3 + episode / 7, episodes 11 to 60.
        mean = statistics.fmean(3 + episode / 7 for episode in range(11, 61))
        place = header.index("energy efficiency (Mbit/J)")
        assert float(lines[1][place]) == pytest.approx(mean * 1e-6, abs=5e-4)
        reward = statistics.fmean(1 + episode / 7 for episode in range(11, 61))
        assert float(lines[1][header.index("reward")]) == pytest.approx(reward, abs=0.05)

    def test_as_json_everything_a_program_may_ask_for(self, listed, runs):
        path = make_run(runs, resets=[2], config={"reset__kappa": 0.25})
        _, document = listed()
        assert document["schema"] == 1
        (run,) = document["runs"]
        assert run["path"] == str(path)
        assert run["config"]["reset.kappa"] == 0.25
        assert run["config"]["network.area_m"] == 2000.0
        assert run["final"] == record_of(path)["final"]
        assert (run["episodes"], run["planned_episodes"]) == (3, 3)
        assert (run["reset_episodes"], run["resume"]) == ([2], None)

    @pytest.mark.parametrize("there", [True, False])
    def test_no_runs_are_no_error(self, orchid, runs, there):
        directory = runs if there else runs / "missing"
        finished = orchid("runs", "list", "--runs-dir", directory)
        assert (finished.code, finished.out) == (0, "")
        assert finished.err == f"note: no runs in {directory}\n"
        finished = orchid("runs", "list", "--json", "--runs-dir", directory)
        assert json.loads(finished.out) == {"schema": 1, "runs": [], "damaged": []}

    def test_what_is_no_run_is_passed_over_in_silence(self, listed, runs):
        path = make_run(runs)
        (runs / "reference" / "orchid").mkdir(parents=True)
        (runs / "README.md").write_text("runs\n")
        shutil.copytree(path, runs / ".hidden")
        ids, document = listed()
        assert ids == [path.name]
        assert document["damaged"] == []

    def test_what_cannot_be_read_is_named_and_the_others_listed(self, orchid, tmp_path):
        other, own = (make_run(tmp_path, name) for name in ("theirs", "own"))
        other.chmod(0)
        try:
            with without_privileges():
                listed = orchid("runs", "list", "--runs-dir", tmp_path, "--json")
                shown = orchid("runs", "show", own.name[:-2], "--runs-dir", tmp_path)
                refused = orchid("runs", "show", other, "--runs-dir", tmp_path)
                unknown = orchid("runs", "show", other.name, "--runs-dir", tmp_path)
        finally:
            other.chmod(0o755)
        document = json.loads(listed.out)
        assert [run["id"] for run in document["runs"]] == [own.name]
        assert [run["id"] for run in document["damaged"]] == [other.name]
        assert "Permission denied" in document["damaged"][0]["reason"]
        assert listed.code == 0
        assert listed.err.startswith(f"note: left out, {other.name}: cannot read {other}")
        assert shown.code == 0, shown.err
        assert_is_an_error(refused, str(other), "Permission denied")
        assert unknown.code == 2

    def test_damaged_runs_are_named_and_the_others_listed(self, orchid, listed, runs):
        good = make_run(runs, "good")
        broken = [make_run(runs, name) for name in ("flipped", "config", "foreign", "odd")]
        text = (broken[0] / "run.json").read_text()
        (broken[0] / "run.json").write_text(text.replace('"completed"', '"running"'))
        with (broken[1] / "config.json").open("a") as file:
            file.write("\n")
        (broken[2] / "run.json").write_text('{"mlflow": true}')
        reseal(broken[3] / "run.json", final=["not", "figures"])
        directory = runs / "directory"
        (directory / "run.json").mkdir(parents=True)
        ids, document = listed()
        assert ids == [good.name]
        names = sorted([*(path.name for path in broken), "directory"])
        assert [one["id"] for one in document["damaged"]] == names
        finished = orchid("runs", "list", "--runs-dir", runs)
        assert finished.code == 0
        assert len(finished.out.splitlines()) == 2
        assert all(name in finished.err for name in names)

    def test_a_run_in_progress_shows_what_it_has_done_so_far(self, listed, runs):
        live = begin_run(runs, episodes=100)
        live.append_episodes(rows(70))
        with (live.path / "episodes.csv").open("a") as file:
            file.write("71,0.5")  # the line that is just being written
        _, document = listed()
        (run,) = document["runs"]
        assert (run["status"], run["episodes"], run["planned_episodes"]) == ("running", 70, 100)
        expected = statistics.fmean(1 + episode / 7 for episode in range(21, 71))
        assert run["final"]["reward"] == pytest.approx(expected)
        live.finish("completed", rows(70), [], 1.0)

    def test_a_run_whose_process_is_gone_died_and_can_be_resumed(self, orchid, listed, runs):
        path = make_run(runs, status="died", log=rows(2))
        _, document = listed()
        (run,) = document["runs"]
        assert (run["status"], run["episodes"]) == ("died", 2)
        assert run["resume"].split()[:3] == ["orchid", "train", "--resume"]
        assert Path(run["resume"].split()[3]).resolve() == path.resolve()
        finished = orchid("runs", "list", "--runs-dir", runs)
        assert "died" in finished.out
        assert run["resume"] in finished.err

    def test_limit_takes_the_first_and_says_so(self, orchid, runs):
        for number in range(3):
            path = make_run(runs, f"run-{number}")
            reseal(path / "run.json", started=f"2026-01-0{number + 1}T00:00:00+00:00")
        finished = orchid("runs", "list", "--runs-dir", runs, "--limit", 2)
        names = [line.split("\t")[0] for line in finished.out.splitlines()[1:]]
        assert [re.search(r"run-\d", name)[0] for name in names] == ["run-2", "run-1"]
        assert finished.err == "note: 2 of 3 runs are shown; --limit 0 shows all\n"

    def test_people_see_the_latest_fifty_and_programs_all(self, monkeypatch, orchid, runs, listed):
        template = make_run(runs, "run-00")
        for number in range(1, SHOWN_ON_TERMINAL + 2):
            copy = shutil.copytree(template, runs / template.name.replace("-00-", f"-{number:02}-"))
            started = f"2099-01-01T00:00:{number:02}+00:00"
            reseal(copy / "run.json", id=copy.name, started=started)
        total = SHOWN_ON_TERMINAL + 2
        assert len(listed()[0]) == len(listed("--limit", 0)[0]) == total
        piped = orchid("runs", "list", "--runs-dir", runs)
        assert len(piped.out.splitlines()) == 1 + total and piped.err == ""

        def seen(*arguments):
            given = ("runs", "list", "--runs-dir", runs, *arguments)
            text = on_terminal(monkeypatch, orchid, 100, *given)
            return re.findall(r"^run-(\d\d)", text, re.MULTILINE), text

        newest_first = [f"{number:02}" for number in range(total - 1, -1, -1)]
        shown, text = seen()
        assert shown == newest_first[:SHOWN_ON_TERMINAL]
        assert f"note: {SHOWN_ON_TERMINAL} of {total} runs are shown; --limit 0 shows all" in text
        assert seen("--limit", 0)[0] == newest_first
        assert "are shown" not in seen("--limit", 0)[1]

    @pytest.mark.parametrize("width", [60, 80, 140])
    @pytest.mark.parametrize("columns", [[], ["--columns", "status,seed,kappa,reward"]])
    def test_an_id_that_is_too_long_is_broken_and_the_table_is_not(
        self, monkeypatch, orchid, runs, width, columns
    ):
        name = ("a-study-of-the-threshold-" * 3)[:64]
        make_run(runs, name)
        make_run(runs, "short")
        given = ("runs", "list", "--runs-dir", runs, *columns)
        lines = on_terminal(monkeypatch, orchid, width, *given).splitlines()
        # Commands to be copied are never broken.
        table = [line for line in lines if not line.startswith(("note:", "next:"))]
        assert all(len(line) <= width for line in table)
        first = re.split(r"  +", table[[line.split("  ")[0] for line in table].index("short-s0")])
        assert "completed" in first
        parts = [line.split("  ")[0] for line in table]
        assert f"{name}-s0" in "".join(parts)

    def test_columns_are_the_ones_asked_for(self, orchid, runs):
        make_run(runs, config={"reset__kappa": 0.1, "ppo__discount": 0.9})
        finished = orchid(
            *("runs", "list", "--runs-dir", runs),
            *("--columns", "kappa,ppo.discount,maddpg.discount,host.cores,resets"),
        )
        header, line = [line.split("\t") for line in finished.out.splitlines()]
        assert header == [
            *("id", "kappa", "ppo.discount", "maddpg.discount", "cores", "resets"),
        ]
        assert line[1:] == ["0.1", "0.9", "0.99", str(os.cpu_count()), "0"]

    def test_the_directory_may_come_from_the_environment(self, orchid, runs, monkeypatch):
        path = make_run(runs)
        monkeypatch.setenv("ORCHID_RUNS_DIR", str(runs))
        assert path.name in orchid("runs", "list").out

    def test_a_name_that_would_steer_a_terminal_does_not(self, orchid, runs):
        path = make_run(runs, status="failed")
        reseal(path / "run.json", error="\x1b[31mred\x07\n\tsecond", name="\x1b]0;title\x07")
        for arguments in (
            ["list", "--columns", "name,error"],
            ["show", path.name],
            ["compare", path.name, make_run(runs).name],
        ):
            finished = orchid("runs", *arguments, "--runs-dir", runs)
            assert finished.code == 0
            assert not re.search(r"[\x00-\x08\x0b-\x1f]", finished.out + finished.err)

    def test_a_run_that_was_interrupted_last_is_to_be_continued(self, monkeypatch, orchid, runs):
        make_run(runs, "first")
        path = make_run(runs, "second", status="interrupted")
        text = on_terminal(monkeypatch, orchid, 90, "runs", "list", "--runs-dir", runs)
        assert text.splitlines()[-1] == f"next: orchid train --resume {path}"

    def test_on_a_narrow_terminal_columns_give_way_but_ids_do_not(self, monkeypatch, orchid, runs):
        path = make_run(runs, "quite-a-long-name")
        for width in (80, 100, 140, 200):
            text = on_terminal(monkeypatch, orchid, width, "runs", "list", "--runs-dir", runs)
            *lines, last = text.splitlines()
            assert all(len(line) <= width for line in lines)
            noted = [index for index, line in enumerate(lines) if line.startswith("note: ")]
            note = " ".join(lines[noted[0] :]) if noted else ""
            del lines[noted[0] if noted else len(lines) :]
            assert lines[-1].startswith("quite-a-long-name-s0  ")
            assert "status" in lines[0] and "episodes" in lines[0]
            # What has no room is named as --columns takes it.
            told = re.search("no room for (.*):", note)
            left_out = told[1].split(", ") if told else []
            assert width < 200 or not left_out
            for key in left_out:
                finished = orchid("runs", "list", "--runs-dir", runs, "--columns", key)
                assert finished.code == 0
            if width == 80:
                assert left_out == ["seed", "load_jfi", "worst_rate_bps"]
            assert last == f"next: orchid runs show {path}"
        assert "worst user's rate (Mbit/s)" in lines[0]

    def test_columns_are_left_out_only_where_there_is_no_room(self, runs):
        found = [read_run(make_run(runs))]

        class Out:
            is_terminal = True
            width = 1000

        assert columns_that_fit(Out, found) == list(LIST_COLUMNS)
        Out.width = 20
        assert "status" in columns_that_fit(Out, found)
        Out.is_terminal = False
        assert columns_that_fit(Out, found) == list(LIST_COLUMNS)

    @given(st.text())
    def test_plain_text_stays_and_the_rest_keeps_its_length(self, text):
        shown = plain(text)
        assert shown.isprintable() and len(shown) == len(text)
        assert all(a == b for a, b in zip(text, shown, strict=True) if a.isprintable())


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Five runs that differ in what tests ask for."""
    directory = tmp_path_factory.mktemp("lab") / "runs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "git_commit", lambda: None)
        make_run(directory, "a", config={"reset__kappa": 0.1}, log=rows(3, rate_jfi=0.7))
        make_run(directory, "b", config={"reset__kappa": 0.5}, log=rows(3, rate_jfi=0.9))
        make_run(directory, "c", config={"training__algorithm": "maddpg"}, log=[], status="failed")
        make_run(directory, "d", config={"network__shares": "pf"}, log=rows(2, rate_jfi=0.8))
        make_run(directory, "e", config={"training__seed": 10}, log=rows(3, rate_jfi=float("nan")))
    for number, path in enumerate(sorted(directory.iterdir(), key=lambda path: path.name[17])):
        reseal(path / "run.json", started=f"2026-01-0{number + 1}T00:00:00+00:00")
    return directory


def names(found: list[Run]) -> str:
    return "".join(run.record.name for run in found)


def chosen(lab: Path, *conditions: str, order: str = "") -> str:
    index = read_index(lab)
    keys = Keys(index.runs)
    return names(select(index.runs, keys, [keys.condition(text) for text in conditions], order))


class TestWhere:
    @pytest.mark.parametrize(
        ("condition", "expected"),
        [
            ("reset.kappa=0.1", "a"),
            ("kappa=0.1", "a"),
            ("kappa==0.1", "a"),
            ("kappa = 1e-1", "a"),
            ("kappa!=0.5", "a"),
            ("kappa<0.5", "a"),
            ("kappa<=0.5", "edcba"),
            ("kappa>0.1", "edcb"),
            ("training.algorithm=maddpg", "c"),
            ("algorithm~DDPG", "c"),
            ("reset.enabled=false", "c"),
            ("reset.enabled=0", ""),  # 0 is not false
            ("reset.max_resets=true", ""),
            ("network.shares=none", "ecba"),
            ("network.shares!=pf", "ecba"),
            ("rate_jfi>0.75", "db"),
            ("rate_jfi<=0.8", "da"),
            ("rate_jfi=none", "ec"),
            ("rate_jfi!=none", "dba"),
            ("ppo.hidden_sizes=[16, 16]", "edcba"),
            ("hidden_sizes~16", None),
            ("status=completed", "edba"),
            ('status="completed"', "edba"),
            ("status<failed", "edba"),
            ("episodes<3", "dc"),
            ("name>=d", "ed"),
            ("seed>9", "e"),
            ("started>=2026-01-04", "ed"),
            ("started<2026-01-02", "a"),
            ("id~-b-s0-", "b"),
            ("error=NaN", "c"),
            ("resets=0", "edcba"),
            ("versions.python~3.", "edcba"),
            ("host.cores>0", "edcba"),
            ("command~lab", "edcba"),
        ],
    )
    def test_keeps_what_fulfils_it(self, lab, condition, expected):
        if expected is None:
            with pytest.raises(InputError, match=r"ppo\.hidden_sizes, maddpg\.hidden_sizes"):
                chosen(lab, condition)
        else:
            assert chosen(lab, condition) == expected

    def test_several_must_all_be_fulfilled(self, lab):
        assert chosen(lab, "rate_jfi>=0.7", "kappa=0.5") == "db"
        assert chosen(lab, "rate_jfi>=0.7", "kappa=0.5", "status=failed") == ""

    @pytest.mark.parametrize(
        ("condition", "parts"),
        [
            ("reset.kapa=0.1", ["reset.kapa", "did you mean 'reset.kappa'"]),
            ("kapa=0.1", ["did you mean 'reset.kappa'"]),
            ("train.seed=1", ["did you mean 'training.seed'"]),
            ("zzzzzzzzzzzzzz.kappa=1", ["did you mean 'reset.kappa'"]),
            ("rate_jfy>0", ["did you mean 'rate_jfi'"]),
            ("statsu=died", ["did you mean 'status'"]),
            ("xyzzy=1", ["xyzzy", "orchid config show", "rate_jfi", "status"]),
            ("discount=0.9", ["ppo.discount, maddpg.discount"]),
            ("rate_jfi", ["KEY OP VALUE", "rate_jfi"]),
            ("=3", ["KEY OP VALUE"]),
            ("kappa>high", ["'high' is not a number"]),
        ],
    )
    def test_what_is_wrong_with_a_condition_is_said(self, orchid, lab, condition, parts):
        finished = orchid("runs", "list", "--runs-dir", lab, f"--where={condition}")
        assert_is_an_error(finished, *parts)

    def test_when_nothing_fits_the_values_that_there_are_are_told(self, orchid, lab):
        finished = orchid("runs", "list", "--runs-dir", lab, "--where", "status=complete")
        assert (finished.code, finished.out) == (0, "")
        assert "none of the 5 runs fits" in finished.err
        assert "status is completed, failed" in finished.err

    @given(st.sampled_from(["<", "<=", ">", ">=", "=", "!="]), st.floats(0.0, 1.0))
    def test_compares_as_numbers_do(self, lab, operator, bound):
        # As recorded: the mean of three times 0.7 is not 0.7.
        runs = {run.record.name: run.record.final for run in read_index(lab).runs}
        values = {name: runs[name]["rate_jfi"] for name in "abd"}
        python = {"=": "=="}.get(operator, operator)
        expected = {name for name, value in values.items() if eval(f"{value!r} {python} {bound!r}")}
        if operator == "!=":
            expected |= {"c", "e"}  # those without the metric
        assert set(chosen(lab, f"rate_jfi{operator}{bound!r}")) == expected


class TestSort:
    @pytest.mark.parametrize(
        ("order", "expected"),
        [
            ("", "edcba"),
            ("rate_jfi", "adbec"),  # without the metric last, latest first among them
            ("-rate_jfi", "bdaec"),
            ("name", "abcde"),
            ("-name", "edcba"),
            ("kappa", "aedcb"),
            ("-kappa", "edcba"),
            ("kappa,name", "abcde"),
            ("-kappa,name", "bcdea"),
            ("status,-seed,rate_jfi", "eadbc"),
            ("algorithm , -episodes", "cebad"),
            ("reset.enabled", "cedba"),
        ],
    )
    def test_by_keys_the_first_first(self, lab, order, expected):
        assert chosen(lab, order=order) == expected

    def test_a_minus_is_no_option(self, orchid, lab):
        for arguments in (["--sort", "-rate_jfi"], ["--sort=-rate_jfi"]):
            finished = orchid("runs", "list", "--json", "--runs-dir", lab, *arguments)
            found = [run["name"] for run in json.loads(finished.out)["runs"]]
            assert found == list("bdaec")

    def test_an_unknown_key_is_an_error(self, orchid, lab):
        finished = orchid("runs", "list", "--runs-dir", lab, "--sort", "-rate_jf")
        assert_is_an_error(finished, "rate_jf", "did you mean 'rate_jfi'")


class TestShow:
    def test_says_all_that_is_known(self, orchid, runs):
        path = make_run(
            *(runs, "lab"),
            config={"reset__kappa": 0.1},
            resets=[2],
            checkpoints=[50, 100, 3],
            episodes=120,
        )
        finished = orchid("runs", "show", path.name[:12], "--runs-dir", runs)
        assert (finished.code, finished.err) == (0, "")
        facts = dict(
            line.split("\t", 1) for line in finished.out.splitlines() if line.count("\t") == 1
        )
        assert facts["run"] == path.name
        assert facts["status"] == "completed"
        assert facts["episodes"] == "120 of 120"
        assert facts["resets"] == "after episode 2"
        assert facts["checkpoints"] == "3, 50, 100"
        assert facts["command"] == "orchid train --name 'lab'\"'\"'s'"
        assert facts["directory"] == str(path)
        assert f"python {sys.version.split()[0]}" in facts["versions"]
        assert "reset.kappa\t0.1\t0.5" in finished.out
        assert "network.area_m" not in finished.out
        mean = statistics.fmean(4 + episode / 7 for episode in range(71, 121))
        assert f"rate JFI\t{mean:.3f}" in finished.out

    def test_shows_a_learning_curve_as_numbers_off_a_terminal(self, orchid, runs):
        path = make_run(runs, episodes=40)
        finished = orchid(
            *("runs", "show", path.name, "--runs-dir", runs),
            *("--metric", "rate_jfi", "--smooth", 2),
        )
        table = [line.split("\t") for line in finished.out.split("trailing means")[1].splitlines()]
        assert table[1][0] == "episode"
        assert [int(line[0]) for line in table[2:]] == list(range(4, 41, 4))
        # The mean of two values of a line: that at half an episode before.
        for episode, value in table[2:]:
            assert float(value) == pytest.approx(4 + (int(episode) - 0.5) / 7, abs=6e-4)

    def test_draws_the_curve_on_a_terminal(self, monkeypatch, orchid, runs):
        path = make_run(runs, episodes=40)
        text = on_terminal(monkeypatch, orchid, 90, "runs", "show", path.name, "--runs-dir", runs)
        assert "reward, trailing means of 20 episodes" in text
        assert re.search("[\u2801-\u28ff]", text)
        *curve, following = text[text.index("reward, trailing") :].splitlines()
        assert following == f"next: orchid eval {path}"
        assert all(len(line) <= 90 for line in curve)

    def test_draws_the_curve_of_one_run(self, orchid, runs, tmp_path):
        path = make_run(runs, episodes=1, config={"network__uav_count": 7})
        target = tmp_path / "curve.svg"
        for command, extra in (("show", []), ("compare", ["--json"])):
            finished = orchid(
                "runs", command, path.name, "--runs-dir", runs, "--out", target, *extra
            )
            assert (finished.code, finished.err) == (0, "")
            if extra:
                assert json.loads(finished.out)["figure"] == str(target)
            else:
                assert finished.out.splitlines()[-1] == f"figure: {target}"
            text = target.read_text()
            assert ">lab-s0<" in text and ">7 UAVs, " in text
            target.unlink()
        finished = orchid("runs", "show", path.name, "--runs-dir", runs, "--json")
        assert json.loads(finished.out)["figure"] is None

    def test_of_a_running_one_tells_of_its_resets_too(self, orchid, runs):
        live = begin_run(runs, episodes=900)
        log = rows(700)  # more than is read of the log's end
        for episode in (2, 11, 650):
            log[episode - 1]["reset"] = 1.0
        live.append_episodes(log)
        with (live.path / "episodes.csv").open("a") as file:
            file.write("701,0.5,1")  # the line that is just being written
        arguments = ["runs", "show", live.id, "--runs-dir", runs]
        assert "resets\tafter episode 2, 11, 650\n" in orchid(*arguments).out
        assert json.loads(orchid(*arguments, "--json").out)["reset_episodes"] == [2, 11, 650]
        finished = orchid("runs", "list", "--runs-dir", runs, "--columns", "resets")
        assert finished.out.splitlines()[1].split("\t")[1] == "3"
        live.finish("completed", log, [2, 11, 650], 1.0)

    def test_of_one_that_can_go_on_says_how(self, orchid, runs):
        path = make_run(runs, status="interrupted", log=rows(1))
        finished = orchid("runs", "show", path.name, "--runs-dir", runs, "--json")
        document = json.loads(finished.out)
        assert document["schema"] == 1
        assert document["resume"] in orchid("runs", "show", path.name, "--runs-dir", runs).out
        assert document["changed"]["training.episodes"] == {"value": 3, "default": 700}
        assert document["command"] == ["orchid", "train", "--name", "lab's"]
        assert document["checkpoints"] == []

    def test_one_without_an_episode_has_no_figures(self, orchid, runs):
        path = make_run(runs, status="failed", log=[])
        finished = orchid("runs", "show", path.name, "--runs-dir", runs)
        assert finished.code == 0
        assert "no episode is finished yet" in finished.out
        assert "error\tNaN" in finished.out

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["show", "20990101"], ["no run '20990101'"]),
            (["show", "{run}", "--metric", "rate_jfy"], ["rate_jfy", "did you mean 'rate_jfi'"]),
            (["show", "{run}", "--smooth", "0"], ["--smooth"]),
            (["compare", "{run}"], ["name another run", "--out FILE"]),
            (["show", "{run}", "--out", "x.gif"], ["x.gif", ".png"]),
            (["compare", "{run}", "{run}"], ["given twice"]),
            (["compare", "{run}", "{other}", "--out", "x.gif"], ["x.gif", ".png"]),
            (["compare", "{run}", "20990101"], ["no run '20990101'"]),
        ],
    )
    def test_wrong_usage_is_an_error(self, orchid, runs, arguments, parts):
        given = {"{run}": make_run(runs).name, "{other}": make_run(runs).name}
        finished = orchid("runs", *(given.get(one, one) for one in arguments), "--runs-dir", runs)
        assert_is_an_error(finished, *parts)

    def test_a_damaged_log_is_an_error_and_no_traceback(self, orchid, runs):
        path = make_run(runs)
        log = path / "episodes.csv"
        for content in ("episode,reward\n1,2\n", log.read_text().replace("1,", "x,", 1)):
            log.write_text(content)
            checksum = hashlib.sha256(log.read_bytes()).hexdigest()
            finished = orchid("runs", "show", path.name, "--runs-dir", runs)
            assert "episodes.csv is not what was written" in finished.err
            reseal(path / "run.json", episodes_sha256=checksum)
            finished = orchid("runs", "show", path.name, "--runs-dir", runs)
            assert finished.code == 2
            assert "episodes.csv is damaged" in finished.err
        log.unlink()
        assert read_log(read_run(path)) == []


class TestCompare:
    def test_shows_the_keys_that_differ_and_no_others(self, orchid, runs):
        paths = [
            make_run(runs, "one", config={"reset__kappa": 0.1}, log=rows(3, rate_jfi=0.5)),
            make_run(runs, "two", log=rows(3, rate_jfi=0.75)),
        ]
        found = [read_run(path) for path in paths]
        assert differences(found) == {"reset.kappa": [0.1, 0.5]}
        finished = orchid("runs", "compare", *(path.name for path in paths), "--runs-dir", runs)
        assert (finished.code, finished.err) == (0, "")
        lines = [line.split("\t") for line in finished.out.splitlines()]
        assert lines[0] == ["", *short_names(found)]
        assert lines[0][1:] == ["one-s0", "two-s0"]
        assert ["reset.kappa", "0.1", "0.5"] in lines
        assert ["rate JFI", "0.500", "0.750", "0.250"] in lines
        configured = [line[0] for line in lines if "." in line[0] and not line[0][0].isdigit()]
        assert configured == ["reset.kappa"]

    @pytest.mark.parametrize(
        ("config", "episodes", "told"),
        [
            ({"reward__objective": "pf"}, 3, "reward.objective"),
            ({}, 4, "the number of episodes so far (it sets the reward's weights)"),
        ],
    )
    def test_rewards_of_two_functions_have_no_difference(
        self, orchid, runs, config, episodes, told
    ):
        paths = [
            make_run(runs, "one", log=rows(3, reward=10.0)),
            make_run(runs, "two", config=config, log=rows(episodes, reward=12.0)),
        ]
        finished = orchid("runs", "compare", *(path.name for path in paths), "--runs-dir", runs)
        assert "reward\t10.0\t12.0\t-\n" in finished.out
        assert (
            finished.err
            == f"note: rewards cannot be compared, as these change their meaning: {told}\n"
        )

    def test_three_runs_have_no_difference_column(self, orchid, runs):
        paths = [make_run(runs, log=rows(3, rate_jfi=value)) for value in (0.1, 0.2, 0.3)]
        finished = orchid("runs", "compare", *(path.name for path in paths), "--runs-dir", runs)
        assert "the configurations are the same" in finished.out
        assert "rate JFI\t0.100\t0.200\t0.300\n" in finished.out

    def test_as_json(self, orchid, runs):
        paths = [make_run(runs), make_run(runs, config={"training__seed": 3})]
        finished = orchid(
            "runs", "compare", *(path.name for path in paths), "--runs-dir", runs, "--json"
        )
        document = json.loads(finished.out)
        assert document["differences"] == {"training.seed": [0, 3]}
        assert [run["id"] for run in document["runs"]] == [path.name for path in paths]
        assert document["figure"] is None

    def test_draws_a_figure(self, orchid, runs, tmp_path):
        paths = [make_run(runs, "one", episodes=30), make_run(runs, "two", episodes=20)]
        arguments = ["runs", "compare", *(path.name for path in paths), "--runs-dir", runs]
        target = tmp_path / "curves.png"
        finished = orchid(*arguments, "--metric", "rate_jfi,reward", "--out", target)
        assert finished.code == 0, finished.err
        assert f"figure: {target}" in finished.out
        assert target.read_bytes().startswith(b"\x89PNG")
        finished = orchid(*arguments, "--out", tmp_path / "missing" / "curves.png")
        assert finished.code == 1
        assert "cannot write" in finished.err

    def test_without_colours_curves_are_letters(self, monkeypatch, orchid, runs):
        paths = [make_run(runs, "one", episodes=30), make_run(runs, "two", episodes=20)]
        monkeypatch.setenv("NO_COLOR", "1")
        text = on_terminal(
            monkeypatch, orchid, 90, "runs", "compare", *(p.name for p in paths), "--runs-dir", runs
        )
        curve = text[text.index("reward, trailing") :]
        assert re.search(r"^A one-s0   B two-s0$", curve, re.MULTILINE)
        assert curve.isascii()

    def test_ids_are_shortened_only_while_they_stay_different(self, orchid, runs):
        path = make_run(runs)
        other = path.with_name(f"{path.name[:-4]}zzzz")
        twin = path.with_name(f"20200101T000000Z{path.name[16:]}")
        tenth = path.with_name(f"{path.name[:16]}-lab-s10-abcd")
        mine = path.with_name("my best")
        for place in (other, twin, tenth, mine):
            shutil.copytree(path, place)
        for paths, shown in (
            ([path], ["lab-s0"]),
            ([path, tenth, mine], ["lab-s0", "lab-s10", "my best"]),
            ([path, other], [path.name[17:], "lab-s0-zzzz"]),
            ([path, twin, tenth], [path.name, twin.name, "lab-s10"]),
        ):
            assert short_names([read_run(one) for one in paths]) == shown
        elsewhere = runs.parent / "elsewhere" / path.name
        shutil.copytree(path, elsewhere)
        both = [str(path), str(elsewhere)]
        assert short_names([read_run(Path(one)) for one in both]) == both

    def test_copies_are_told_apart(self, orchid, runs, tmp_path):
        path = make_run(runs)
        copy, namesake = runs / "copy", tmp_path / "elsewhere" / path.name
        for place in (copy, namesake):
            shutil.copytree(path, place)
        compare = ["runs", "compare", "--runs-dir", runs]
        for other, names in ((copy, ["lab-s0", "copy"]), (namesake, [str(path), str(namesake)])):
            finished = orchid(*compare, path, other)
            assert finished.out.splitlines()[0].split("\t")[1:] == names
        assert_is_an_error(orchid(*compare, path, path.name), "given twice")
        target = tmp_path / "both.zip"
        finished = orchid("runs", "export", path, copy, "--out", target)
        assert_is_an_error(finished, str(path), str(copy), "given twice")
        assert not target.exists()
        shown = orchid("runs", "show", "copy", "--runs-dir", runs).out
        assert "run\tcopy\n" in shown and f"recorded as\t{path.name}\n" in shown
        reseal(copy / "run.json", id="copy", former_ids=[path.name])
        shown = orchid("runs", "show", "copy", "--runs-dir", runs).out
        assert f"formerly\t{path.name}\n" in shown and "recorded as" not in shown
        assert orchid("runs", "export", path, copy, "--out", target).code == 0
        assert orchid("runs", "import", target, "--runs-dir", tmp_path / "new").code == 0
        ids = {one.name for one in (tmp_path / "new").iterdir()}
        assert ids == {"copy", path.name}

    def test_in_its_own_directory_a_run_is_called_as_elsewhere(self, orchid, runs, monkeypatch):
        path = make_run(runs)
        monkeypatch.chdir(path)
        assert json.loads(orchid("runs", "show", ".", "--json").out)["id"] == path.name

    def test_what_is_shown_of_an_id_is_taken_for_it(self, runs):
        paths = [make_run(runs, name) for name in ("one", "two", "two")]
        tenth = make_run(runs, "one", config={"training__seed": 10})
        found = [*(read_run(path) for path in paths), read_run(tenth)]
        for name, run in zip(short_names(found), found, strict=True):
            assert find_run(name, runs) == run.path
        assert find_run("one-s1", runs) == tenth
        with pytest.raises(InputError, match="the ids of 2 runs begin with 'two-s0'"):
            find_run("two-s0", runs)


class TestDelete:
    def delete(self, orchid, runs, *arguments):
        return orchid("runs", "delete", "--runs-dir", runs, *arguments)

    def test_asks_first_and_says_what_goes(self, orchid, runs, type_in):
        path = make_run(runs, checkpoints=[3])
        type_in("n\n")
        finished = self.delete(orchid, runs, path.name)
        assert (finished.code, finished.out) == (1, "")
        assert path.name in finished.err and "nothing was deleted" in finished.err
        assert path.is_dir()
        type_in("y\n")
        finished = self.delete(orchid, runs, path.name)
        assert finished.code == 0
        assert finished.out == f"deleted: {path.name}\n"
        assert list(runs.iterdir()) == []

    def test_an_answer_that_does_not_come_deletes_nothing(self, orchid, runs, type_in):
        path = make_run(runs)
        type_in("")
        assert self.delete(orchid, runs, path.name).code == 130
        assert path.is_dir()

    def test_where_nobody_can_be_asked_it_refuses(self, orchid, runs, monkeypatch):
        path = make_run(runs)
        monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
        assert_is_an_error(self.delete(orchid, runs, path.name), "--yes")
        assert path.is_dir()
        finished = self.delete(orchid, runs, path.name, "--yes", "--json")
        assert json.loads(finished.out) == {"schema": 1, "deleted": [path.name]}
        assert not path.exists()

    def test_all_are_checked_before_any_is_deleted(self, orchid, runs):
        path = make_run(runs, "old")
        live = begin_run(runs)
        finished = self.delete(orchid, runs, path.name, live.id, "--yes")
        assert_is_an_error(finished, live.id, "is running")
        assert_is_an_error(self.delete(orchid, runs, path.name, "2099", "--yes"), "no run '2099'")
        assert path.is_dir() and live.path.is_dir()
        live.finish("completed", rows(1), [], 1.0)
        assert self.delete(orchid, runs, path.name, live.id, live.id, "--yes").code == 0
        assert list(runs.iterdir()) == []

    @pytest.mark.parametrize("status", ["died", "failed", "interrupted"])
    def test_one_that_goes_on_no_more_can_be_deleted(self, orchid, runs, status):
        path = make_run(runs, status=status)
        assert self.delete(orchid, runs, path.name, "--yes").code == 0
        assert not path.exists()

    def test_a_damaged_one_can_be_deleted(self, orchid, runs):
        path = make_run(runs)
        (path / "run.json").write_text("{")
        assert self.delete(orchid, runs, path.name, "--yes").code == 0
        assert not path.exists()

    def test_what_is_no_run_is_left_alone(self, orchid, runs):
        folder = runs / "thesis"
        folder.mkdir()
        (folder / "chapter.tex").write_text("years of work")
        for name in ("thesis", folder, runs, ".", "..", "/"):
            finished = self.delete(orchid, runs, name, "--yes")
            assert finished.code == 2
        assert (folder / "chapter.tex").read_text() == "years of work"

    def test_a_run_elsewhere_is_left_alone(self, orchid, runs, tmp_path):
        other = make_run(tmp_path / "others")
        inner = make_run(runs / "deeper")
        before = fingerprint(other)
        link = runs / "way-out"
        link.symlink_to(other.parent)
        for name in (other, runs / ".." / "others" / other.name, link / other.name, inner):
            finished = self.delete(orchid, runs, name, "--yes")
            assert_is_an_error(finished, "does not lie in", "--runs-dir")
        assert fingerprint(other) == before
        assert inner.is_dir()

    def test_of_a_link_only_the_link_goes(self, orchid, runs, tmp_path, type_in):
        other = make_run(tmp_path / "others")
        before = fingerprint(other)
        link = runs / "linked"
        link.symlink_to(other)
        type_in("y\n")
        finished = self.delete(orchid, runs, "linked")
        assert finished.code == 0
        assert "only the link" in finished.err
        assert not os.path.lexists(link)
        assert fingerprint(other) == before

    def test_links_inside_are_not_followed(self, orchid, runs, tmp_path):
        precious = tmp_path / "precious"
        (precious / "folder").mkdir(parents=True)
        (precious / "file").write_text("kept")
        path = make_run(runs, checkpoints=[3])
        (path / "to-folder").symlink_to(precious)
        (path / "to-file").symlink_to(precious / "file")
        (path / "checkpoints" / "7").symlink_to(precious)
        before = fingerprint(precious)
        assert self.delete(orchid, runs, path.name, "--yes").code == 0
        assert not path.exists()
        assert fingerprint(precious) == before

    def test_the_directory_of_runs_may_itself_be_a_link(self, orchid, runs, tmp_path):
        path = make_run(runs)
        alias = tmp_path / "alias"
        alias.symlink_to(runs)
        assert self.delete(orchid, alias, path.name, "--yes").code == 0
        assert not path.exists() and alias.is_symlink()

    def test_what_comes_in_a_runs_place_meanwhile_is_left_alone(self, runs):
        path = make_run(runs)
        removals = plan_removal([path.name], runs)
        path.rename(runs / "moved")
        other = make_run(runs)
        other.rename(path)
        before = fingerprint(path)
        with pytest.raises(InputError, match="was replaced"):
            remove(removals)
        assert fingerprint(path).keys() == before.keys()

    def test_a_run_that_is_resumed_meanwhile_is_left_alone(self, runs):
        path = make_run(runs, status="died")
        removals = plan_removal([path.name], runs)
        lock = run_removal.RunLock(path)
        with pytest.raises(InputError, match="another process"):
            remove(removals)
        lock.release()
        assert path.is_dir()
        assert remove(removals) == [path.name]

    def test_ctrl_c_leaves_whole_runs_or_none(self, runs, monkeypatch):
        paths = [make_run(runs, name, checkpoints=[1, 2]) for name in ("a", "b", "c")]
        kept = fingerprint(paths[2])
        removals = plan_removal([path.name for path in paths], runs)
        take_apart = shutil.rmtree
        calls = []

        def interrupted(path, **options):
            calls.append(path)
            if len(calls) == 2:  # in the middle of the second
                next(Path(path).glob("*.csv")).unlink()
                raise KeyboardInterrupt
            take_apart(path, **options)

        monkeypatch.setattr(shutil, "rmtree", interrupted)
        with pytest.raises(KeyboardInterrupt):
            remove(removals)
        assert list(runs.iterdir()) == [paths[2]]
        assert fingerprint(paths[2]) == kept

    def test_what_a_killed_deletion_left_is_hidden_and_removed_by_the_next(
        self, runs, monkeypatch, listed
    ):
        first, second = make_run(runs, "a"), make_run(runs, "b")

        def killed(path, **options):
            raise SystemExit

        with monkeypatch.context() as patch:
            patch.setattr(shutil, "rmtree", killed)
            with pytest.raises(SystemExit):
                remove(plan_removal([first.name], runs))
        assert len(list(runs.iterdir())) == 2
        assert listed()[0] == [second.name]
        remove(plan_removal([second.name], runs))
        assert list(runs.iterdir()) == []

    def test_one_that_cannot_be_removed_is_an_error(self, runs, monkeypatch):
        path = make_run(runs)

        def refuse(self, target):
            raise PermissionError(13, "Permission denied")

        removals = plan_removal([path.name], runs)
        monkeypatch.setattr(Path, "rename", refuse)
        with pytest.raises(RunFailedError, match="Permission denied"):
            remove(removals)
        assert path.is_dir()


class TestStart:
    def test_eight_runs_started_in_the_same_second_get_eight_directories(self, tmp_path):
        code = (
            "import sys; from pathlib import Path\n"
            "from orchid_uav.experiments import provenance\n"
            "from orchid_uav.experiments.configuration import RunConfig\n"
            "from orchid_uav.experiments.runs.directory import RunDirectory\n"
            "provenance.git_commit = lambda: None\n"
            "print('ready', flush=True); sys.stdin.readline()\n"
            "run = RunDirectory.create(Path(sys.argv[1]), 'lab', RunConfig(), ['orchid'])\n"
            "print(run.id)\n"
        )
        processes = [
            subprocess.Popen(
                [sys.executable, "-c", code, str(tmp_path / "runs")],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
            )
            for _ in range(8)
        ]
        assert all(process.stdout.readline() == "ready\n" for process in processes)
        time.sleep(1.0 - time.time() % 1.0)  # to the beginning of a second
        for process in processes:
            process.stdin.write("go\n")
        ids = [process.communicate(timeout=60)[0].strip() for process in processes]
        assert all(process.returncode == 0 for process in processes)
        assert len(set(ids)) == 8
        assert len({run[:16] for run in ids}) == 1, "they did not start in the same second"
        assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == sorted(ids)
        for run in ids:
            assert record_of(tmp_path / "runs" / run)["id"] == run

    def test_the_command_needs_none_of_the_slow_packages(self, runs):
        make_run(runs)
        code = (
            "import json, sys; from orchid_uav.cli.main import main;"
            f"main(['runs', 'list', '--json', '--runs-dir', {str(runs)!r}]);"
            "print(json.dumps([m for m in ('numba', 'sklearn', 'scipy', 'pandas', 'pettingzoo',"
            "'matplotlib', 'torch') if m in sys.modules]))"
        )
        finished = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        listing, loaded = finished.stdout.splitlines()
        assert len(json.loads(listing)["runs"]) == 1
        assert json.loads(loaded) == []

    def test_gymnasium_knows_the_environment_after_importing_the_package(self):
        code = (
            "import orchid_uav, gymnasium, sys; assert 'numba' not in sys.modules;"
            "env = gymnasium.make('orchid/Fleet-v0', uavs=2, users=10);"
            "print(env.observation_space.shape)"
        )
        finished = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert finished.stdout == "(2, 16)\n"

    def test_what_is_loaded_late_is_there_all_the_same(self):
        code = (
            "import orchid_uav.envs as envs; names = dir(envs);"
            "assert set(envs.__all__) <= set(names);"
            "assert all(getattr(envs, name) is not None for name in envs.__all__);"
            "assert envs.Parameters is envs.parameters.Parameters;"
            "from orchid_uav.envs import *; print(channel.__name__, WorldBatch.__name__)\n"
            "try: envs.nothing\n"
            "except AttributeError as error: print(error)"
        )
        finished = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert finished.stdout.splitlines() == [
            "orchid_uav.envs.channel WorldBatch",
            "module 'orchid_uav.envs' has no attribute 'nothing'",
        ]

    @pytest.mark.parametrize("command", ["list", "show", "compare", "delete", "export", "import"])
    def test_each_command_has_an_example(self, orchid, command):
        finished = orchid("runs", command, "--help")
        assert finished.code == 0
        assert f"Example: orchid runs {command}" in finished.out
        assert ESCAPE not in finished.out

    def test_what_the_log_of_a_whole_run_says_is_read_back(self, runs):
        path = make_run(runs, episodes=5)
        assert read_log(read_run(path)) == [row(episode) for episode in range(1, 6)]


class TestNext:
    """On a terminal, commands whose output programs read suggest another one."""

    def suggested(self, monkeypatch, orchid, *arguments):
        text = on_terminal(monkeypatch, orchid, 40, *arguments)  # far too narrow for a command
        (line,) = (line for line in text.splitlines() if line.startswith("next: "))
        assert text.splitlines()[-1] == line
        return shlex.split(line.removeprefix("next: "))

    def test_is_what_can_be_done_with_the_runs(self, monkeypatch, orchid, runs):
        one = make_run(runs, "one")
        assert self.suggested(monkeypatch, orchid, "runs", "show", one) == [
            *("orchid", "eval", str(one)),
        ]
        monkeypatch.setenv("ORCHID_RUNS_DIR", str(runs))
        two = make_run(runs, "two", status="interrupted")
        reseal(two / "run.json", started="2099-01-01T00:00:00+00:00")
        names = [two.name, one.name]
        for command, arguments, following in (
            ("list", [], ["train", "--resume", two.name]),
            ("list", ["--where", "status=completed"], ["runs", "show", one.name]),
            ("compare", names, ["eval", *names]),
        ):
            assert self.suggested(monkeypatch, orchid, "runs", command, *arguments) == [
                *("orchid", *following),
            ]
        three = make_run(runs, "three")
        reseal(three / "run.json", started="2099-01-02T00:00:00+00:00")
        assert self.suggested(monkeypatch, orchid, "runs", "list") == [
            *("orchid", "runs", "compare", three.name, two.name),
        ]

    def test_of_one_that_died_is_how_it_goes_on(self, monkeypatch, orchid, runs):
        path = make_run(runs, status="died", log=rows(1))
        make_run(runs)
        arguments = ["--runs-dir", runs]
        text = on_terminal(monkeypatch, orchid, 40, "runs", "list", *arguments)
        assert text.splitlines()[-1] == f"died; continue with: orchid train --resume {path}"
        assert "next:" not in text
        text = on_terminal(monkeypatch, orchid, 40, "runs", "show", path, *arguments)
        assert f"orchid train --resume {path}" in text and "next:" not in text

    def test_of_an_empty_directory_is_to_train(self, monkeypatch, orchid, runs):
        suggested = self.suggested(monkeypatch, orchid, "runs", "list", "--runs-dir", runs)
        assert suggested == ["orchid", "train"]

    def test_of_a_configuration_is_to_train_with_it(self, monkeypatch, orchid, runs):
        given = ["--seed", "3", "--set", "ppo.hidden_sizes=[16, 16]"]
        suggested = self.suggested(monkeypatch, orchid, "config", "show", *given)
        assert suggested == ["orchid", "train", *given]

    def test_is_no_part_of_what_programs_read(self, orchid, runs):
        path = make_run(runs)
        for arguments in (["list"], ["show", path], ["compare", path, make_run(runs)]):
            for form in ([], ["--json"]):
                finished = orchid("runs", *arguments, *form, "--runs-dir", runs)
                assert "next:" not in finished.out + finished.err
        assert "next:" not in orchid("config", "show").out
