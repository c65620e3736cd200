"""The ``orchid`` command: what it prints where, its exit codes, and what it leaves behind."""

import contextlib
import errno
import importlib.metadata
import io
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from orchid_uav.agents import MAPPO, load_policy
from orchid_uav.cli.console import console, print_table
from orchid_uav.cli.main import app, main
from orchid_uav.experiments import interruption
from orchid_uav.experiments.configuration import assignment_layer
from orchid_uav.experiments.evaluation.methods import known_methods
from orchid_uav.experiments.training import listeners, trackers
from orchid_uav.extras import install_command
from tests.helpers.processes import (
    COLUMNS,
    ESCAPE,
    TINY_FLAGS,
    Finished,
    assert_is_an_error,
    cells,
    columns,
    files_of,
    forked,
    record_of,
)

TINY_TRAIN = ["train", *TINY_FLAGS, "--episodes=3", "--no-rf"]
FEW_FLIGHTS = ["--episodes=2", "--uavs=2", "--users=20", "--no-figures", "--quiet"]
ENDLESS = ["train", *TINY_FLAGS, "--episodes=1000000", "--no-rf"]
COMPLETE = {
    *("run.json", "config.json", "episodes.csv", "policy.safetensors", "policy.json"),
    *("events.out.tfevents", "checkpoints", ".lock"),
}
GIVE_UP_AFTER_S = 120
"""Only so that a test that hangs fails: no test takes a twentieth of it."""


NO_PATHS = ["~nosuchuser/x", os.fsdecode(b"of-1998-\xe9")]


@pytest.mark.parametrize("given", NO_PATHS)
@pytest.mark.parametrize(
    "command",
    [
        [*TINY_TRAIN, "--runs-dir", ...],
        ["train", "--resume", ...],
        ["train", "--resume=x", "--runs-dir", ...],
        ["train", "--config", ...],
        ["eval", ...],
        ["eval", "--out", ...],
        ["eval", "x", "--runs-dir", ...],
        ["eval", "--config", ...],
        ["ablate", "--init=random", "--out", ...],
        ["config", "show", "--config", ...],
        ["runs", "list", "--runs-dir", ...],
        ["runs", "show", ...],
        ["runs", "delete", ..., "--yes"],
        ["runs", "compare", "a", "b", "--runs-dir", ...],
        ["runs", "export", ...],
        ["runs", "import", ...],
        ["runs", "import", "x.zip", "--runs-dir", ...],
    ],
)
def test_a_path_that_cannot_be_one_is_an_error_of_a_line(
    orchid, tmp_path, monkeypatch, command, given
):
    monkeypatch.chdir(tmp_path)
    finished = orchid(*(given if part is ... else part for part in command))
    assert_is_an_error(finished, given if given.isascii() else "of-1998-")
    assert list(tmp_path.iterdir()) == []


def test_a_path_of_the_environment_that_cannot_be_one_is_as_well(orchid, monkeypatch):
    monkeypatch.setenv("ORCHID_RUNS_DIR", NO_PATHS[0])
    assert_is_an_error(orchid("runs", "list"), NO_PATHS[0], "without '~'")


def test_without_a_home_a_path_with_one_is_an_error(orchid, tmp_path, monkeypatch):
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.setattr(pytest.importorskip("pwd"), "getpwuid", {}.__getitem__)
    assert_is_an_error(orchid("runs", "list", "--runs-dir", "~/runs"), "~/runs", "without '~'")
    assert orchid("runs", "list", "--runs-dir", tmp_path).code == 0


def test_a_command_with_bytes_that_are_no_text_is_recorded_as_text(
    orchid, runs_dir, new_runs, tmp_path
):
    config = tmp_path / os.fsdecode(b"of-1998-\xe9.json")
    try:
        config.write_text('{"training": {"seed": 3}}')
    except OSError:
        pytest.skip("names here are text")
    finished = orchid(*TINY_TRAIN, "--config", config, "--runs-dir", runs_dir, "--quiet")
    assert finished.code == 0, finished.err
    [run] = new_runs()
    assert str(tmp_path / "of-1998-\N{REPLACEMENT CHARACTER}.json") in record_of(run)["command"]
    assert orchid("runs", "show", run).code == 0


class Terminal(io.StringIO):
    def isatty(self):
        return True

    def fileno(self):
        raise io.UnsupportedOperation

    @property
    def text(self):
        """What is written, without escape codes."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.getvalue())


@pytest.fixture
def terminal(monkeypatch):
    """Calls make stdout and stderr a terminal from then on."""

    def become():
        screen = Terminal()
        monkeypatch.setattr(sys, "stdout", screen)
        monkeypatch.setattr(sys, "stderr", screen)
        return screen

    return become


@pytest.fixture
def train(orchid, runs_dir):
    """``orchid train`` of a tiny network, in this process."""

    def run(*arguments):
        return orchid(*TINY_TRAIN, "--runs-dir", runs_dir, *arguments)

    return run


def interrupt_with(monkeypatch, number, at=2):
    """Have the signal arrive after as many episodes."""
    show = listeners.Reporter.show

    def show_and_interrupt(self, rows, reset_episodes):
        show(self, rows, reset_episodes)
        if rows[-1]["episode"] == at:
            signal.raise_signal(number)

    monkeypatch.setattr(listeners.Reporter, "show", show_and_interrupt)


def until_rows_are_written(process, runs_dir, there_before, rows=3):
    """Wait for the process's log to hold some rows; gives its run directory."""
    deadline = time.monotonic() + GIVE_UP_AFTER_S
    while time.monotonic() < deadline and process.poll() is None:
        for path in set(runs_dir.iterdir()) - there_before:
            log = path / "episodes.csv"
            if log.is_file() and log.read_bytes().count(b"\n") > rows:
                return path
        time.sleep(0.01)
    raise AssertionError(f"no episodes; exit code {process.poll()}")


def commands():
    """All commands with their parameters, by the words that call them."""

    def below(group, words):
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                yield from below(command, (*words, name))
            else:
                yield (*words, name), command.params

    return dict(below(typer.main.get_command(app), ()))


COMMANDS = commands()
METHODS = known_methods()
GROUPS = {words[:length] for words in COMMANDS for length in range(len(words))}


def ragged(paragraph, room):
    """Lines of a paragraph that end although the next word would have had room."""
    return [
        line
        for line, following in itertools.pairwise(paragraph)
        if len(line) + 1 + len(following.split()[0]) <= room
    ]


class TestHelp:
    @pytest.mark.parametrize("words", sorted({*COMMANDS, *GROUPS}))
    @pytest.mark.parametrize("width", [80, 100])
    def test_is_whole_and_flows(self, orchid, monkeypatch, words, width):
        monkeypatch.setenv("COLUMNS", str(width))
        text = orchid(*words, "--help").out
        lines = [line.rstrip() for line in text.splitlines()]
        assert max(map(len, lines)) <= width
        assert "…" not in text
        assert "<bool>" not in text and "BOOLEAN" not in text
        prose = itertools.takewhile(lambda line: not line.startswith("╭"), lines)
        for filled, group in itertools.groupby(prose, key=bool):
            assert not filled or ragged([line.strip() for line in group], width - 2) == []
        # Names of options and ranges are in one piece, and the example can be copied.
        for parameter in COMMANDS.get(words, ()):
            assert all(name in text.split() for name in parameter.opts if name.startswith("--"))
        assert all(text.count(sign) == text.count(other) for sign, other in ("[]", "()"))
        ranges = re.findall(r"\[\d*(?:<=)?x\S*", text)
        assert all(found.endswith("]") for found in ranges)
        if words in COMMANDS:
            (example,) = (line for line in lines if line.startswith(" Example: "))
            code = [word for word in shlex.split(example) if word.startswith("--")]
            assert set(code) <= {name for one in COMMANDS[words] for name in one.opts}
            assert lines[lines.index(example) + 1] == ""

    def test_the_bare_command_shows_what_there_is(self, orchid):
        finished = orchid()
        assert finished.code == 0
        for command in ("train", "config"):
            assert command in finished.out

    @pytest.mark.parametrize("command", [["train"], ["config", "show"]])
    def test_each_command_has_panels_and_an_example(self, orchid, command):
        finished = orchid(*command, "--help")
        assert finished.code == 0
        assert finished.err == ""
        assert f"Example: orchid {' '.join(command)}" in finished.out
        for panel in ("Configuration", "Network", "Learning", "Output"):
            assert f" {panel} " in finished.out
        assert ESCAPE not in finished.out

    def test_version(self, orchid):
        version = importlib.metadata.version("orchid-uav")
        assert orchid("--version").out == f"orchid-uav {version}\n"

    def test_both_names_of_the_command_and_the_module_are_the_same(self):
        scripts = importlib.metadata.entry_points(group="console_scripts")
        names = {
            script.name: script.value for script in scripts if script.name.startswith("orchid")
        }
        assert names["orchid"] == names["orchid-uav"]


class TestWrongUsage:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["trian"], ["trian", "train"]),
            (["config", "shwo"], ["shwo", "show"]),
            (["train", "--episode=3"], ["--episode", "--episodes"]),
            (["train", "--uavs"], ["--uavs"]),
            (["train", "--quiet=1"], ["--quiet"]),
            (["train", "extra"], ["extra"]),
            (["train", "--preset=papr"], ["'papr'", "'paper'"]),
            (["train", "--set=network.uav_cuont=3"], ["network.uav_cuont", "network.uav_count"]),
            (["train", "--set=network.area_m=nan"], ["network.area_m", "nan"]),
            (["train", "--users=6", "--uavs=6"], ["user_count", "7"]),
            (["train", "--episodes=0"], ["training.episodes", "0"]),
            (["train", "--episodes=-5"], ["training.episodes", "-5"]),
            (["train", "--config=missing.toml"], ["missing.toml"]),
            (["train", "--name=a/b"], ["--name", "a/b"]),
            (["train", "--name="], ["--name"]),
            (["train", "--track=mlflw"], ["mlflw", "mlflow"]),
        ],
    )
    @pytest.mark.parametrize("output", [[], ["--json"]])
    def test_is_told_in_two_lines_and_makes_no_run(
        self, orchid, runs_dir, new_runs, monkeypatch, arguments, parts, output
    ):
        monkeypatch.setenv("ORCHID_RUNS_DIR", str(runs_dir))
        if arguments[0] != "train":
            output = []
        assert_is_an_error(orchid(*arguments, *output), *parts)
        assert new_runs() == []

    @pytest.mark.parametrize(
        ("words", "option"),
        [
            (words, parameter.opts[0])
            for words, parameters in sorted(COMMANDS.items())
            for parameter in parameters
            if parameter.opts[0].startswith("--") and not parameter.is_flag
        ],
    )
    def test_an_empty_value_is_no_default(self, orchid, tmp_path, monkeypatch, words, option):
        monkeypatch.chdir(tmp_path)
        required = []
        for parameter in COMMANDS[words]:
            name = parameter.opts[0]
            if parameter.required and name != option:
                required.append(f"{name}=x" if name.startswith("--") else "x")
        for value in ([f"{option}="], [option, " "]):
            assert_is_an_error(orchid(*words, *required, *value), option)
        assert list(tmp_path.iterdir()) == []

    def test_nor_is_an_empty_argument(self, orchid, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        for words in (["eval"], ["runs", "show"], ["runs", "export"], ["runs", "import"]):
            assert_is_an_error(orchid(*words, ""), "empty")
        assert list(tmp_path.iterdir()) == []

    def test_a_seed_that_is_too_large_is_told(self, orchid):
        assert_is_an_error(orchid("eval", f"--seed={2**63}"), "--seed", str(2**63), "2**63")
        assert_is_an_error(orchid("eval", "--seed=-1"), "--seed", "-1")

    def test_a_tracker_whose_package_is_missing_makes_no_run(self, train, new_runs, monkeypatch):
        monkeypatch.setitem(sys.modules, "mlflow", None)
        assert_is_an_error(train("--track=mlflow"), "--track mlflow", install_command("mlflow"))
        assert new_runs() == []

    def test_a_traceback_is_shown_only_on_demand(self, train):
        assert "Traceback" not in train("--uavs=0").err
        finished = train("--uavs=0", "--debug")
        assert "Traceback" in finished.err
        assert finished.code == 2


class TestWhereRunsAreMade:
    def test_in_runs_below_the_working_directory(self, orchid, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        assert orchid(*TINY_TRAIN).code == 0
        [run] = (tmp_path / "runs").iterdir()
        assert record_of(run)["status"] == "completed"

    def test_or_where_the_environment_says(self, orchid, runs_dir, new_runs, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("ORCHID_RUNS_DIR", str(tmp_path / "elsewhere"))
        assert orchid(*TINY_TRAIN).code == 0
        [run] = (tmp_path / "elsewhere").iterdir()
        assert record_of(run)["status"] == "completed"
        assert new_runs() == []

    def test_the_flag_comes_before_the_environment(self, train, new_runs, tmp_path, monkeypatch):
        monkeypatch.setenv("ORCHID_RUNS_DIR", str(tmp_path / "elsewhere"))
        assert train().code == 0
        assert len(new_runs()) == 1
        assert not (tmp_path / "elsewhere").exists()

    def test_not_under_a_file(self, orchid, tmp_path):
        file = tmp_path / "notes.txt"
        file.write_text("mine\n")
        for wanted in (file, file / "runs"):
            assert_is_an_error(orchid(*TINY_TRAIN, "--runs-dir", wanted), str(wanted))
        assert file.read_text() == "mine\n"

    def test_not_on_a_disk_that_is_full(self, train, new_runs, runs_dir, monkeypatch):
        def write(path, document):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr("orchid_uav.experiments.runs.directory.write_json", write)
        assert_is_an_error(train(), str(runs_dir), "No space left on device")
        assert new_runs() == []


class TestTrain:
    def test_names_the_run_and_its_directory_and_is_done(self, train, new_runs):
        finished = train("--name=lab", "--seed=7")
        assert finished.code == 0
        assert finished.err == ""
        [run] = new_runs()
        assert re.fullmatch(r"\d{8}T\d{6}Z-lab-s7-[a-z]{4}", run.name)
        assert files_of(run) == COMPLETE
        assert f"run directory: {run}" in finished.out.splitlines()
        assert "completed: 3 episodes" in finished.out

    def test_records_the_command_as_it_was_given(self, train, new_runs, runs_dir):
        train("--seed=7")
        expected = ["orchid", *TINY_TRAIN, "--runs-dir", str(runs_dir), "--seed=7"]
        assert record_of(new_runs()[0])["command"] == expected

    def test_flags_reach_the_run(self, train, new_runs):
        train("--kappa=0.25", "--objective=pf", "--init=random", "--distribution=uniform")
        config = json.loads((new_runs()[0] / "config.json").read_text())
        assert config["reset"]["kappa"] == 0.25
        assert config["reset"]["enabled"] is False
        assert config["reward"]["objective"] == "pf"
        assert config["deployment"]["init"] == "random"
        assert config["network"]["distribution"] == "uniform"
        assert config["network"]["uav_count"] == 2

    def test_off_a_terminal_prints_lines_of_any_length_without_escape_codes(
        self, orchid, runs_dir, monkeypatch
    ):
        monkeypatch.setenv("COLUMNS", "40")
        deep = runs_dir / ("a" * 60) / ("b" * 60)
        finished = orchid(*TINY_TRAIN, "--runs-dir", deep)
        assert ESCAPE not in finished.out
        [run] = deep.iterdir()
        lines = finished.out.splitlines()
        assert lines[0] == f"run {run.name} in {run}"
        assert lines[-2] == f"run directory: {run}"
        # In the words of a command that does what it says, however narrow the place is.
        assert lines[-1] == f"next: orchid eval {run}"
        assert (
            orchid(
                *shlex.split(lines[-1])[2:],
                "--methods=static-pf",
                *FEW_FLIGHTS,
                "--out",
                runs_dir.parent / "flown",
            ).code
            == 0
        )
        progress = [line for line in lines if line.startswith("episode 3/3: ")]
        assert len(progress) == 1
        for figure in ("reward", "coverage", "energy efficiency", "rate JFI", "load JFI"):
            assert f"{figure} " in progress[0]
        table = dict(line.split("\t") for line in lines if "\t" in line)
        assert table["mean of the last episodes"] == "3"
        final = record_of(run)["final"]
        assert table["reward"] == f"{final['reward']:.1f}"
        assert table["worst user"] == f"{final['worst_rate_bps'] / 1e6:.2f} Mbit/s"

    def test_directories_are_printed_as_they_are_called(self, orchid, runs_dir):
        odd = runs_dir / "a[bold]b[red]c"
        finished = orchid(*TINY_TRAIN, "--runs-dir", odd)
        assert finished.code == 0
        [run] = odd.iterdir()
        assert str(run) in finished.out.splitlines()[0]
        assert str(run) in finished.out.splitlines()[-2]

    def test_a_place_that_knows_only_ascii_gets_the_configuration_too(
        self, start_orchid, monkeypatch
    ):
        # Of the units, m² and kg/m³ are not in ASCII, and ³ is not in Japanese Windows' code page.
        monkeypatch.setenv("PYTHONIOENCODING", "ascii")
        process = start_orchid("config", "show")
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert (process.returncode, err) == (0, "")
        assert "rotor.disc_area_m2\t0.503\t" in out

    def test_quietly_shows_no_progress(self, train, new_runs):
        finished = train("--quiet")
        assert finished.err == ""
        assert "episode 3/3" not in finished.out and "next:" not in finished.out
        assert str(new_runs()[0]) in finished.out

    def test_resets_are_shown(self, orchid, runs_dir):
        finished = orchid(
            *("train", *TINY_FLAGS, "--episodes=6", "--runs-dir", runs_dir, "--set=reset.window=2"),
            *("--set=reset.tolerance_jfi=1e9", "--set=reset.tolerance_reward=1e9"),
        )
        assert "episode 4: plateau" in finished.out
        assert "5e-05 0.0005" in finished.out
        assert "resets at episode: 4" in finished.out

    @pytest.mark.parametrize(
        ("episodes", "arguments", "warns"),
        [(3, [], True), (4, [], True), (5, [], False), (3, ["--no-rf"], False)],
    )
    def test_windows_that_do_not_fit_are_pointed_out(
        self, orchid, runs_dir, episodes, arguments, warns
    ):
        finished = orchid(
            *("train", *TINY_FLAGS, "--set=reset.window=2", "--runs-dir", runs_dir),
            *("--quiet", f"--episodes={episodes}", *arguments),
        )
        assert finished.code == 0
        assert ("Reset-and-Finetune" in finished.err) == warns


class TestJson:
    def test_is_one_document_and_progress_goes_to_stderr(self, train, new_runs):
        finished = train("--json")
        document = json.loads(finished.out)
        [run] = new_runs()
        assert finished.code == 0
        assert document["schema"] == 1
        assert document["run"] == run.name
        assert Path(document["path"]) == run
        assert document["episodes"] == 3
        assert document["reset_episodes"] == []
        assert document["final"] == record_of(run)["final"]
        assert list(document["final"]) == COLUMNS[1:]
        assert run.name in finished.err
        assert ESCAPE not in finished.err

    def test_quietly_is_nothing_but_the_document(self, train):
        finished = train("--json", "--quiet")
        assert finished.err == ""
        assert finished.out.count("\n") == 1
        assert json.loads(finished.out)["episodes"] == 3

    def test_is_one_document_whatever_a_tracker_prints(self, train, monkeypatch):
        log = trackers.TensorBoardTracker.log

        def chatter(tracker, episode, figures):
            print(f"View episode {episode} at http://localhost")
            log(tracker, episode, figures)

        monkeypatch.setattr(trackers.TensorBoardTracker, "log", chatter)
        finished = train("--json", "--quiet")
        assert json.loads(finished.out)["episodes"] == 3
        assert "View episode 3" in finished.err

    def test_of_an_interrupted_run_is_whole_too(self, train, monkeypatch):
        interrupt_with(monkeypatch, signal.SIGINT)
        finished = train("--json", "--quiet", "--episodes=9")
        assert finished.code == 130
        assert json.loads(finished.out)["episodes"] == 2


class TestOnATerminal:
    def test_a_bar_and_a_table_show_how_the_run_goes(self, train, terminal):
        screen = terminal()
        assert train("--set=reset.enabled=true").code == 0
        assert ESCAPE in screen.getvalue()
        for shown in (
            *("3/3", "100 %", "reward", "coverage", "energy efficiency", "rate JFI", "load JFI"),
            *("worst user", "0.0001 / 0.001", "Reset-and-Finetune", "steps/s", "left"),
        ):
            assert shown in screen.text

    def test_no_color_takes_the_colours_away(self, train, terminal, monkeypatch):
        colour = re.compile(r"\x1b\[(?:[0-9;]*;)?(?:3[0-7]|38|9[0-7]|4[0-7]|48|10[0-7])[;m]")
        coloured = terminal()
        train()
        monkeypatch.setenv("NO_COLOR", "1")
        plain = terminal()
        train()
        assert colour.search(coloured.getvalue())
        assert not colour.search(plain.getvalue())

    def test_a_dumb_one_gets_lines(self, train, terminal, monkeypatch):
        monkeypatch.setenv("TERM", "dumb")
        screen = terminal()
        assert train().code == 0
        assert ESCAPE not in screen.getvalue()
        assert "episode 3/3: " in screen.getvalue()

    def test_a_narrow_one_does_not_break_the_directory(
        self, train, terminal, new_runs, monkeypatch
    ):
        monkeypatch.setenv("COLUMNS", "40")
        screen = terminal()
        assert train().code == 0
        assert f"run directory: {new_runs()[0]}" in screen.text

    def test_a_narrow_one_cuts_no_keys(self, orchid, terminal, monkeypatch):
        monkeypatch.setenv("COLUMNS", "50")
        screen = terminal()
        assert orchid("config", "show").code == 0
        assert "reset.kappa" in screen.text
        assert "…" not in screen.text

    def test_json_stays_one_document(self, train, monkeypatch, capsys):
        screen = Terminal()
        monkeypatch.setattr(sys, "stderr", screen)
        assert json.loads(train("--json").out)["episodes"] == 3
        assert "3/3" in screen.text


WORDS = st.text("abc.-[]é漢:", min_size=1, max_size=9)
CELLS = st.lists(WORDS, max_size=3).map(" ".join)


class TestCompletion:
    """What a shell asks for at a press of the tab key."""

    @pytest.fixture
    def complete(self, plain_environment, monkeypatch, capsys, tmp_path):
        """Completions of the last of some words, in a directory with three runs."""
        monkeypatch.chdir(tmp_path)
        for name in ("20261122T211205Z-lab-s0-abcd", "20261122T211206Z-lab-s1-efgh", "best"):
            (tmp_path / "runs" / name).mkdir(parents=True)
            (tmp_path / "runs" / name / "run.json").touch()
        (tmp_path / "runs" / "20261122-notes").mkdir()

        def run(*words):
            monkeypatch.setenv("_ORCHID_COMPLETE", "complete_bash")
            monkeypatch.setenv("COMP_WORDS", shlex.join(["orchid", *words]))
            monkeypatch.setenv("COMP_CWORD", str(len(words)))
            capsys.readouterr()
            with pytest.raises(SystemExit):
                main([])
            printed = capsys.readouterr()
            assert printed.err == ""
            return printed.out.split()

        return run

    LAB = ("20261122T211205Z-lab-s0-abcd", "20261122T211206Z-lab-s1-efgh")

    @pytest.mark.parametrize(
        "words",
        [
            ("eval",),
            ("eval", "best"),
            ("train", "--resume"),
            *(("runs", command) for command in ("show", "compare", "delete", "export")),
        ],
    )
    def test_of_runs_are_ids_or_their_parts_behind_the_time(self, complete, words):
        assert complete(*words, "20261122T") == list(self.LAB)
        assert complete(*words, "lab-s1") == ["lab-s1-efgh"]
        assert complete(*words, "b") == ["best"]
        assert complete(*words, "nothing") == []

    def test_of_runs_are_those_of_the_directory_that_is_given(
        self, complete, tmp_path, monkeypatch
    ):
        (tmp_path / "other" / "mine").mkdir(parents=True)
        (tmp_path / "other" / "mine" / "run.json").touch()
        assert complete("runs", "show", "--runs-dir", "other", "m") == ["mine"]
        assert complete("runs", "show", "--runs-dir", "missing", "m") == []
        assert complete("runs", "show", "--runs-dir", "runs/best/run.json", "m") == []
        monkeypatch.setenv("ORCHID_RUNS_DIR", "other")
        assert complete("runs", "show", "m") == ["mine"]

    def test_of_lists_go_on_behind_the_comma_and_repeat_nothing(self, complete):
        assert complete("eval", "--methods", "static-m") == ["static-mmf", "static-mmf-full-power"]
        assert complete("eval", "--methods", "static-mmf,static-m") == [
            "static-mmf,static-mmf-full-power"
        ]
        assert set(complete("eval", "--methods", "")) == {"all", "learned", "rules", *METHODS}
        assert complete("eval", "--metrics", "util") == ["utility"]
        assert complete("runs", "show", "x", "--metric", "reward,rate") == ["reward,rate_jfi"]
        assert complete("runs", "list", "--sort", "seconds,-wor") == ["seconds,-worst_rate_bps"]
        assert complete("runs", "list", "--columns", "reset.kap") == ["reset.kappa"]
        assert complete("runs", "list", "--where", "stat") == ["status"]
        assert complete("train", "--track", "ml") == ["mlflow"]
        assert complete("train", "--preset", "q") == ["quick"]
        assert complete("ablate", "--preset", "") == ["paper", "quick", "informed", "distilled"]

    @pytest.mark.parametrize(
        "words", [("train", "--set"), ("eval", "--set"), ("ablate", "--set"), ("ablate", "--base")]
    )
    def test_of_keys_end_with_the_sign_and_of_one_show_its_default(self, complete, words):
        assert complete(*words, "reset.w") == ["reset.window=", "reset.window=50"]
        found = complete(*words, "reset.")
        assert found[:2] == ["reset.enabled=", "reset.window="]
        assert complete(*words, "ppo.hidd") == [
            "ppo.hidden_sizes=",
            "ppo.hidden_sizes=[256,256,256]",
        ]
        for text in (found[1] + "20", "ppo.hidden_sizes=[256,256,256]", "network.shares=none"):
            assignment_layer([text])

    def test_load_nothing_that_is_slow(self, plain_environment, tmp_path):
        code = (
            "import atexit, os, sys; from orchid_uav.cli.main import main;"
            "slow = ('numba', 'sklearn', 'scipy', 'pandas', 'torch', 'pyarrow', 'matplotlib');"
            "atexit.register(lambda: print([one for one in slow if one in sys.modules]));"
            "main([])"
        )
        for words in ("eval --methods stat", "runs list --sort se", "train --set reset.ka"):
            variables = {"COMP_WORDS": f"orchid {words}", "_ORCHID_COMPLETE": "complete_bash"}
            finished = subprocess.run(
                [sys.executable, "-c", code],
                env=os.environ | variables | {"COMP_CWORD": str(len(words.split()))},
                capture_output=True,
                text=True,
                check=True,
            )
            *found, loaded = finished.stdout.splitlines()
            assert found and loaded == "[]" and finished.stderr == ""


class TestTables:
    """On terminals; elsewhere they are lines with tabs."""

    def shown(self, width, columns, rows, **options):
        screen = io.StringIO()
        out = Console(file=screen, width=width, force_terminal=True, color_system=None, emoji=False)
        print_table(out, columns, rows, **options)
        return screen.getvalue()

    @given(st.data(), st.integers(10, 90), st.integers(1, 8))
    def test_no_cell_is_broken_and_none_is_missing(self, data, width, count):
        # Each cell ends in a number of its own.
        rows = [
            [f"{data.draw(CELLS)} {row}{column}".strip() for column in range(count)]
            for row in range(3)
        ]
        columns = [f"{data.draw(CELLS)} head{column}" for column in range(count)]
        text = self.shown(width, columns, rows)
        for row in rows:
            assert all(text.count(cell) >= 1 for cell in row)
        tables = text.split("\n\n")
        for table in tables:
            body = table.rstrip("\n").split("\n")[-3:]
            for line, row in zip(body, rows, strict=True):
                assert line.startswith(row[0])
            if max(cell_len(line) for line in table.split("\n")) > width:
                assert len(re.findall(r"\bhead\d", table)) <= 2, "it could be divided further"
        words = text.split()
        assert all(word in words for column in columns for word in column.split())

    def test_columns_go_into_a_further_table_only_where_there_is_no_room(self):
        columns, rows = ["method", "the rate", "load"], [["a", "1.25 ± 0.25", "7"]]
        assert self.shown(27, columns, rows) == (
            "method  the rate     load\na       1.25 ± 0.25  7\n"
        )
        assert self.shown(24, columns, rows) == (
            "method  the rate\na       1.25 ± 0.25\n\nmethod  load\na       7\n"
        )
        # Too narrow for anything: whole all the same.
        assert "a       1.25 ± 0.25" in self.shown(5, columns, rows).splitlines()

    def test_headings_are_broken_between_words_and_the_shortest_last(self):
        columns = ["key", "energy efficiency (Mbit/J)", "no of it"]
        text = self.shown(26, columns, [["k", "0.271", "1.5"]])
        assert text.splitlines() == [
            *("key  energy      no of it", "     efficiency", "     (Mbit/J)"),
            "k    0.271       1.5",
        ]

    def test_a_text_is_broken_between_words_where_that_is_enough(self):
        rows = [["planner", "CMA-ES over positions and powers"], ["track", "K-Means"]]
        assert self.shown(30, ["method", "idea"], rows, wraps_last=True).splitlines() == [
            *("method   idea", "planner  CMA-ES over positions", "         and powers"),
            "track    K-Means",
        ]

    def test_what_looks_like_markup_or_a_smiley_is_shown_as_it_is(self, orchid, terminal):
        screen = terminal()
        print_table(console(), ["a"], [["[red]x[/red] :smile: \\[b]"]])
        assert "[red]x[/red] :smile: \\[b]" in screen.text


class TestFailure:
    @pytest.fixture
    def failing_update(self, monkeypatch):
        def fail(model):
            raise ArithmeticError("the loss is not a number")

        monkeypatch.setattr(MAPPO, "train", fail)

    @pytest.mark.parametrize("output", [[], ["--json"]])
    def test_while_learning_is_one_line_and_exit_code_1(
        self, train, new_runs, failing_update, output
    ):
        finished = train("--quiet", *output)
        assert_is_an_error(finished, "the loss is not a number", new_runs()[0].name, code=1)
        record = record_of(new_runs()[0])
        assert record["status"] == "failed"
        assert record["error"] == "ArithmeticError: the loss is not a number"

    def test_shows_its_traceback_on_demand(self, train, failing_update):
        finished = train("--debug")
        assert finished.code == 1
        assert "Traceback" in finished.err
        assert "ArithmeticError: the loss is not a number" in finished.err

    def test_whose_reason_is_coloured_is_told_without_escape_codes(
        self, train, new_runs, monkeypatch
    ):
        # numba colours its messages.
        def fail(model):
            raise TypeError("\x1b[1mno pyobject\x1b[0m")

        monkeypatch.setattr(MAPPO, "train", fail)
        finished = train("--quiet")
        assert_is_an_error(finished, "no pyobject", code=1)
        assert ESCAPE not in finished.err
        assert record_of(new_runs()[0])["error"] == "TypeError: no pyobject"

    def test_of_a_policy_that_diverges_is_two_lines_at_most(self, train):
        finished = train("--quiet", "--set=ppo.actor_learning_rate=1e30")
        assert_is_an_error(finished, code=1)

    @pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
    def test_to_print_is_no_traceback(self, start_orchid):
        with Path("/dev/full").open("w") as stdout:
            process = start_orchid("config", "show", "--json", stdout=stdout)
        _, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert_is_an_error(Finished(process.returncode, "", err), "No space left", code=1)

    def test_of_a_full_disk_during_a_run_costs_no_row_that_was_written(
        self, start_orchid, runs_dir, new_runs
    ):
        resource = pytest.importorskip("resource")
        if not hasattr(resource, "prlimit"):
            pytest.skip("limits of another process are Linux's")
        there_before = set(runs_dir.iterdir())
        process = start_orchid(*ENDLESS, "--quiet", "--runs-dir", runs_dir)
        run = until_rows_are_written(process, runs_dir, there_before)
        size = (run / "episodes.csv").stat().st_size
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (size + 3000, size + 3000))
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert process.returncode == 1
        assert out == ""
        assert "Traceback" not in err
        assert "error: " in err
        assert "File too large" in err
        record = record_of(run)
        assert record["status"] == "failed"
        assert columns(run)["episode"] == list(range(1, record["episodes"] + 1))
        assert record["episodes"] > 3
        assert {name for name in files_of(run) if name.startswith(".")} == {".lock"}


class TestInterruption:
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_ends_with_130_and_says_what_is_kept(self, train, new_runs, monkeypatch, number):
        interrupt_with(monkeypatch, number)
        finished = train("--quiet", "--episodes=9")
        assert finished.code == 130
        assert "interrupted: 2 episodes" in finished.out
        assert str(new_runs()[0]) in finished.out
        assert "Traceback" not in finished.err

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_of_a_process_leaves_a_complete_directory(self, start_orchid, runs_dir, number):
        there_before = set(runs_dir.iterdir())
        process = start_orchid(*ENDLESS, "--json", "--runs-dir", runs_dir)
        run = until_rows_are_written(process, runs_dir, there_before)
        process.send_signal(number)
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert process.returncode == 130
        assert "Traceback" not in err
        assert files_of(run) == COMPLETE
        record = record_of(run)
        assert record["status"] == "interrupted"
        assert columns(run)["episode"] == list(range(1, record["episodes"] + 1))
        assert json.loads(out)["episodes"] == record["episodes"] >= 3
        assert load_policy(run).description.episodes == record["episodes"]

    @pytest.mark.parametrize(("seconds", "is_urgent"), [(0.0, False), (1.1, True)])
    def test_twice_within_a_second_is_once_and_later_ends_at_once(
        self, train, new_runs, monkeypatch, seconds, is_urgent
    ):
        show, moments = listeners.Reporter.show, itertools.count(1000.0, seconds)
        monkeypatch.setattr(interruption, "time", SimpleNamespace(monotonic=moments.__next__))

        def interrupt_twice(self, rows, reset_episodes):
            show(self, rows, reset_episodes)
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)

        monkeypatch.setattr(listeners.Reporter, "show", interrupt_twice)
        finished = train("--quiet", "--episodes=9")
        assert finished.code == 130
        assert "Traceback" not in finished.err
        [run] = new_runs()
        assert f"continue with: orchid train --resume {run}" in finished.err
        assert record_of(run)["status"] == "interrupted"
        assert len(cells(run)) == 2
        assert (run / "checkpoints" / "1").exists() is not is_urgent

    def test_before_training_begins_is_told_by_the_record(self, train, new_runs, monkeypatch):
        open_tracker = trackers.open_tracker

        def interrupted(*arguments):
            signal.raise_signal(signal.SIGINT)
            return open_tracker(*arguments)

        monkeypatch.setattr(trackers, "open_tracker", interrupted)
        assert train("--quiet").code == 130
        assert [record_of(run)["status"] for run in new_runs()] in ([], ["interrupted"])

    @pytest.mark.skipif(os.name != "posix", reason="fork is POSIX")
    def test_by_a_scheduler_before_training_begins_is_told_by_the_record(
        self, plain_environment, runs_dir, new_runs, tmp_path, monkeypatch
    ):
        # SIGTERM, of which the process would otherwise die on the spot: hence one of its own.
        open_tracker = trackers.open_tracker

        def interrupted(*arguments):
            signal.raise_signal(signal.SIGTERM)
            return open_tracker(*arguments)

        def train():
            with (tmp_path / "err").open("w") as err, contextlib.redirect_stderr(err):
                assert main([*TINY_TRAIN, "--quiet", "--runs-dir", str(runs_dir)]) == 130

        monkeypatch.setattr(trackers, "open_tracker", interrupted)
        _, status = os.waitpid(forked(train), 0)
        assert os.waitstatus_to_exitcode(status) == 0
        assert "Traceback" not in (tmp_path / "err").read_text()
        assert [record_of(run)["status"] for run in new_runs()] in ([], ["interrupted"])

    @pytest.mark.parametrize("module", ["typer", "torch"])
    def test_while_it_starts_is_no_traceback(self, tmp_path, plain_environment, module):
        # The installed script, whose imports take a second or two, with a ctrl-C in the middle.
        script = shutil.which("orchid", path=Path(sys.executable).parent)
        if script is None:
            pytest.skip("the command is not installed beside this Python")
        code = f"""
import importlib.abc, runpy, signal, sys
class Interrupt(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            sys.meta_path.remove(self)
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
sys.argv = ["orchid", "train", "--runs-dir", {str(tmp_path / "runs")!r}]
runpy.run_path({script!r}, run_name="__main__")
"""
        finished = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            timeout=GIVE_UP_AFTER_S,
            check=False,
        )
        assert finished.returncode in {130, -signal.SIGINT}
        assert "Traceback" not in finished.stderr
        assert not (tmp_path / "runs").exists()

    def test_of_what_reads_the_output_does_not_leave_the_run_running(self, start_orchid, runs_dir):
        # orchid train | head -1
        there_before = set(runs_dir.iterdir())
        flags = [
            "--set=reset.window=1",
            "--set=reset.tolerance_jfi=1e9",
            "--set=reset.max_resets=99",
        ]
        process = start_orchid(
            *("train", *TINY_FLAGS, "--episodes=60", "--runs-dir", runs_dir, *flags),
            "--set=reset.tolerance_reward=1e9",
        )
        assert process.stdout.readline().startswith("run ")
        process.stdout.close()
        process.stdout = None
        _, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert "Traceback" not in err
        [run] = set(runs_dir.iterdir()) - there_before
        assert record_of(run)["status"] != "running"
