"""A run's directory: its name, what is in it, and what is left of it when writing fails."""

import itertools
import json
import os
import platform
import re
import secrets
import socket
import statistics
import subprocess
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path

import pytest

from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.runs import directory as run_directory
from orchid_uav.experiments.runs.directory import RunDirectory, read_episodes
from orchid_uav.storage import files
from orchid_uav.storage.files import write_atomically, write_json
from tests.helpers.processes import (
    COLUMNS,
    WHOLE_NUMBERS,
    cells,
    columns,
    file_size_limit,
    fingerprint,
    record_of,
    tiny_config,
)

CONFIG = tiny_config(training__seed=7)
COMMAND = ["orchid", "train", "--seed", "7"]


def create(runs_dir: Path, name: str = "lab") -> RunDirectory:
    return RunDirectory.create(runs_dir, name, CONFIG, COMMAND)


def row(episode: int) -> dict[str, float]:
    """An episode's row whose numbers are awkward to write, and differ from column to column."""
    values = {name: (place + 0.1) / (3 + episode) for place, name in enumerate(COLUMNS)}
    return values | {name: float(episode % 3) for name in WHOLE_NUMBERS} | {"episode": episode}


def rows(count: int) -> list[dict[str, float]]:
    return [row(episode) for episode in range(1, count + 1)]


@pytest.fixture
def stopped_clock(monkeypatch):
    """All runs begin within one second; ``tick()`` moves on by one."""

    class Clock(datetime):
        moment = datetime(2026, 2, 3, 4, 5, 59, tzinfo=UTC)

        @classmethod
        def now(cls, tz=None):
            return cls.moment.astimezone(tz)

        @classmethod
        def tick(cls):
            cls.moment += timedelta(seconds=1)

    monkeypatch.setattr(run_directory, "datetime", Clock)
    return Clock


@pytest.fixture
def no_git(monkeypatch):
    """A child process would inherit a limit on file sizes, and git leave its lock behind."""
    monkeypatch.setattr(provenance, "git_commit", lambda: None)


class TestName:
    def test_is_utc_time_name_seed_and_four_letters(self, runs_dir, stopped_clock):
        run = create(runs_dir)
        assert re.fullmatch(r"20260203T040559Z-lab-s7-[a-z]{4}", run.id)
        assert run.path == runs_dir / run.id

    def test_sorts_by_time_whatever_the_runs_are_called(self, runs_dir, stopped_clock):
        ids = []
        for name in ("zebra", "ant", "Mole", "9"):
            ids.append(create(runs_dir, name).id)
            stopped_clock.tick()
        assert sorted(ids) == ids

    def test_one_that_is_taken_is_passed_over(self, runs_dir, stopped_clock, monkeypatch):
        letters = itertools.chain("aaaa", "aaaa", "aaaa", "aaab", itertools.repeat("z"))
        monkeypatch.setattr(secrets, "choice", lambda _: next(letters))
        first = create(runs_dir)
        before = fingerprint(first.path)
        second = create(runs_dir)
        assert [run.id[-4:] for run in (first, second)] == ["aaaa", "aaab"]
        assert fingerprint(first.path) == before

    def test_when_all_are_taken_none_is_shared(self, runs_dir, stopped_clock, monkeypatch):
        monkeypatch.setattr(secrets, "choice", lambda _: "a")
        first = create(runs_dir)
        before = fingerprint(first.path)
        with pytest.raises(InputError, match=re.escape(str(runs_dir))):
            create(runs_dir)
        assert fingerprint(first.path) == before

    def test_runs_begun_at_once_each_have_their_own(
        self, runs_dir, new_runs, stopped_clock, monkeypatch, no_git
    ):
        # Three letters in four places: 81 names for 24 runs, so that most collide at first.
        choose = secrets.SystemRandom().choice
        monkeypatch.setattr(secrets, "choice", lambda _: choose("abc"))
        start = threading.Barrier(8)

        def create_three(worker: int) -> list[RunDirectory]:
            start.wait()
            return [create(runs_dir) for _ in range(3)]

        with ThreadPoolExecutor(8) as pool:
            runs = [run for made in pool.map(create_three, range(8)) for run in made]
        assert Counter(run.id for run in runs).most_common(1)[0][1] == 1
        assert new_runs() == sorted(run.path for run in runs)
        for run in runs:
            assert record_of(run.path)["id"] == run.id
            assert len(cells(run.path)) == 1

    @pytest.mark.parametrize("name", ["a", "9", "pf-8", "v1.2_b", "A" * 64])
    def test_good_ones(self, runs_dir, name):
        run = create(runs_dir, name)
        assert f"-{name}-s7-" in run.id
        assert record_of(run.path)["name"] == name

    @pytest.mark.parametrize(
        "name",
        ["", ".", "..", ".hidden", "-rf", "a/b", "a\\b", "a b", "a\n", "é", "a\0", "A" * 65, "a:b"],
    )
    def test_bad_ones(self, runs_dir, new_runs, name):
        with pytest.raises(InputError, match="--name") as error:
            create(runs_dir, name)
        assert repr(name) in str(error.value)
        assert new_runs() == []


class TestNewDirectory:
    def test_holds_record_configuration_and_an_empty_log(self, runs_dir):
        run = create(runs_dir)
        assert {path.name for path in run.path.iterdir()} == {
            "run.json",
            "config.json",
            "episodes.csv",
            ".lock",
            ".reserve",
        }
        assert json.loads((run.path / "config.json").read_text()) == CONFIG.model_dump(mode="json")
        assert (run.path / "episodes.csv").read_text() == ",".join(COLUMNS) + "\n"

    def test_the_record_says_on_what_and_with_what_the_run_is_made(self, runs_dir):
        record = record_of(create(runs_dir).path)
        assert record["schema"] == 1
        assert record["status"] == "running"
        assert record["command"] == COMMAND
        assert record["versions"]["python"] == platform.python_version()
        for package in ("torch", "stable-baselines3", "numpy", "orchid-uav"):
            assert record["versions"][package.replace("-", "_")] == version(package)
        assert record["host"]["name"] == socket.gethostname()
        assert record["host"]["cores"] == os.cpu_count()
        assert record["reset_episodes"] == []
        assert record["final"] == {}
        assert record["error"] is None

    def test_the_record_tells_a_dead_process_from_a_live_one(self, runs_dir):
        record = record_of(create(runs_dir).path)
        assert record["pid"] == os.getpid()
        boot_id = Path("/proc/sys/kernel/random/boot_id")
        if boot_id.is_file():
            assert record["boot_id"] == boot_id.read_text().strip()

    def test_the_record_names_the_commit_of_the_code(self, runs_dir):
        checkout = Path(__file__).resolve().parents[2]
        source = Path(provenance.__file__).resolve()
        if not (checkout / ".git").exists() or not source.is_relative_to(checkout):
            pytest.skip("the code does not lie in a checkout")
        head = ["git", "-C", checkout, "rev-parse", "HEAD"]
        found = subprocess.run(head, capture_output=True, text=True, check=True)
        commit = record_of(create(runs_dir).path)["versions"]["git_commit"]
        assert commit.removesuffix("+changes") == found.stdout.strip()

    @pytest.mark.parametrize(
        ("path", "counts"),
        [
            ("envs/dynamics.py", True),
            ("experiments/new.py", True),
            ("pyproject.toml", True),
            ("studies/evaluations.py", True),
            ("studies/results/uavs.json", False),
            ("runs/reference/orchid/run.json", False),
            ("docs/figures/uavs.png", False),
            ("docs/evaluation.md", False),
            ("tests/test_new.py", False),
            ("README.md", False),
        ],
    )
    def test_a_commit_is_of_what_is_measured(self, tmp_path, monkeypatch, path, counts):
        def git(*arguments):
            who = ("-c", "user.name=n", "-c", "user.email=e@example.org")
            command = ["git", "-C", tmp_path, *who, *arguments]
            return subprocess.run(command, capture_output=True, text=True, check=True).stdout

        git("init", "--quiet")
        for name in ("envs/dynamics.py", "experiments/provenance.py", "docs/evaluation.md"):
            (tmp_path / name).parent.mkdir()
            (tmp_path / name).write_text("")
        git("add", ".")
        git("commit", "--quiet", "-m", "first")
        commit = git("rev-parse", "HEAD").strip()
        monkeypatch.setattr(provenance, "__file__", str(tmp_path / "experiments/provenance.py"))
        assert provenance.git_commit() == commit
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("changed\n")
        assert provenance.git_commit() == commit + ("+changes" if counts else "")

    def test_a_machine_without_git_is_no_obstacle(self, runs_dir, monkeypatch):
        monkeypatch.setenv("PATH", "")
        assert record_of(create(runs_dir).path)["versions"]["git_commit"] is None

    def test_times_are_utc(self, runs_dir):
        before = datetime.now(UTC).replace(microsecond=0)
        record = record_of(create(runs_dir).path)
        assert before <= datetime.fromisoformat(record["started"]) <= datetime.now(UTC)
        assert record["finished"] is None

    def test_missing_parents_are_made(self, tmp_path):
        assert create(tmp_path / "a" / "b").path.is_dir()


class TestWhereNothingCanBeWritten:
    def test_a_file_in_the_place_of_the_directory(self, tmp_path):
        in_the_way = tmp_path / "runs"
        in_the_way.write_text("mine\n")
        for wanted in (in_the_way, in_the_way / "deeper"):
            with pytest.raises(InputError, match=re.escape(str(wanted))):
                create(wanted)
        assert in_the_way.read_text() == "mine\n"

    @pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="no /proc")
    @pytest.mark.parametrize("wanted", ["/proc", "/proc/orchid/runs"])
    def test_a_file_system_that_takes_no_directories(self, wanted):
        with pytest.raises(InputError, match=re.escape(wanted)):
            create(Path(wanted))

    @pytest.mark.parametrize("size", [0, 10, 1000])
    def test_a_disk_that_is_full_leaves_no_half_made_run(self, runs_dir, new_runs, no_git, size):
        with file_size_limit(size), pytest.raises(InputError, match=re.escape(str(runs_dir))):
            create(runs_dir)
        assert new_runs() == []

    @pytest.mark.parametrize("name", ["config.json", "run.json"])
    def test_whichever_file_does_not_fit(self, runs_dir, new_runs, monkeypatch, name):
        def write(path, content):
            if path.name == name:
                raise OSError(28, "No space left on device")
            write_atomically(path, content)

        monkeypatch.setattr(files, "write_atomically", write)
        monkeypatch.setattr(run_directory, "write_atomically", write)
        with pytest.raises(InputError, match="No space left on device"):
            create(runs_dir)
        assert new_runs() == []

    def test_ctrl_c_leaves_no_half_made_run(self, runs_dir, new_runs, monkeypatch):
        def write(path, document):
            raise KeyboardInterrupt

        monkeypatch.setattr(run_directory, "write_json", write)
        with pytest.raises(KeyboardInterrupt):
            create(runs_dir)
        assert new_runs() == []


class TestEpisodes:
    def test_rows_are_appended_under_one_header(self, runs_dir):
        run = create(runs_dir)
        run.append_episodes(rows(4)[:1])
        run.append_episodes([])
        run.append_episodes(rows(4)[1:])
        assert cells(run.path)[0] == COLUMNS
        assert columns(run.path)["episode"] == [1, 2, 3, 4]

    def test_numbers_come_back_bit_by_bit(self, runs_dir):
        run = create(runs_dir)
        run.append_episodes(rows(5))
        assert read_episodes(run.path / "episodes.csv") == rows(5)
        for name, values in columns(run.path).items():
            assert values == [row[name] for row in rows(5)]

    def test_counts_are_written_as_whole_numbers_and_the_rest_as_decimals(self, runs_dir):
        run = create(runs_dir)
        run.append_episodes([dict.fromkeys(COLUMNS, 2.0)])
        written = dict(zip(*cells(run.path), strict=True))
        assert {name for name, text in written.items() if text == "2"} == set(WHOLE_NUMBERS)
        assert set(written.values()) == {"2", "2.0"}

    def test_on_a_disk_that_is_full_no_half_row_is_left(self, runs_dir):
        run = create(runs_dir)
        run.append_episodes(rows(2))
        log = run.path / "episodes.csv"
        before = log.read_bytes()
        # Wherever in the new rows the disk's end lies.
        for room in (0, 1, 50, 150, 151, 250):
            with (
                file_size_limit(len(before) + room),
                pytest.raises(OSError, match="File too large"),
            ):
                run.append_episodes(rows(5)[2:])
            assert log.read_bytes() == before, f"with room for {room} bytes"
        run.append_episodes(rows(5)[2:])
        assert read_episodes(log) == rows(5)


class TestEnd:
    @pytest.mark.parametrize("count", [1, 49, 50, 51, 120])
    def test_final_figures_are_means_of_the_last_fifty_rows(self, runs_dir, count):
        run = create(runs_dir)
        run.append_episodes(rows(count))
        run.finish("completed", rows(count), [], 1.0)
        final = record_of(run.path)["final"]
        assert list(final) == COLUMNS[1:]
        logged = columns(run.path)
        for name, value in final.items():
            assert value == pytest.approx(statistics.fmean(logged[name][-50:]), rel=1e-12)

    def test_without_an_episode_there_are_none(self, runs_dir):
        run = create(runs_dir)
        run.finish("interrupted", [], [], 0.0)
        assert record_of(run.path)["final"] == {}

    def test_the_record_keeps_what_it_said_and_says_how_the_run_ended(self, runs_dir):
        run = create(runs_dir)
        before = record_of(run.path)
        run.finish("failed", rows(3), [2], 1.23456, error="OSError: no")
        after = record_of(run.path)
        assert after["status"] == "failed"
        assert after["episodes"] == 3
        assert after["reset_episodes"] == [2]
        assert after["seconds"] == 1.235
        assert after["error"] == "OSError: no"
        assert datetime.fromisoformat(after["finished"]) >= datetime.fromisoformat(after["started"])
        of_the_end = {
            "status",
            "finished",
            "seconds",
            "episodes",
            "reset_episodes",
            "final",
            "error",
            "episodes_sha256",
            "seal",
        }
        assert after.keys() == before.keys()
        for name in before.keys() - of_the_end:
            assert after[name] == before[name]

    def test_a_figure_that_is_no_number_does_not_hide_how_the_run_ended(self, runs_dir):
        run = create(runs_dir)
        run.finish("failed", [dict.fromkeys(COLUMNS, float("nan"))], [], 1.0, error="diverged")
        text = (run.path / "run.json").read_text()
        assert record_of(run.path)["status"] == "failed"
        assert "NaN" not in text


class TestAtomicWrites:
    def test_replace_the_whole_file(self, tmp_path):
        path = tmp_path / "a.json"
        write_json(path, {"long": "x" * 1000})
        write_json(path, {"unit": "m²"})
        assert path.read_text(encoding="utf-8") == '{\n  "unit": "m²"\n}\n'
        assert list(tmp_path.iterdir()) == [path]

    def test_that_fail_leave_the_old_content_and_nothing_else(self, tmp_path):
        path = tmp_path / "a.bin"
        write_atomically(path, b"old")
        with file_size_limit(100), pytest.raises(OSError, match="File too large"):
            write_atomically(path, b"new" * 1000)
        assert path.read_bytes() == b"old"
        assert list(tmp_path.iterdir()) == [path]

    def test_that_cannot_replace_leave_nothing_behind(self, tmp_path):
        (tmp_path / "taken").mkdir()
        with pytest.raises(OSError, match="taken"):
            write_atomically(tmp_path / "taken", b"content")
        assert [path.name for path in tmp_path.iterdir()] == ["taken"]

    def test_reach_the_disk_before_the_name_does(self, tmp_path, monkeypatch):
        done = []
        sync, replace = os.fsync, Path.replace
        monkeypatch.setattr(files.os, "fsync", lambda fd: (done.append("fsync"), sync(fd)))
        monkeypatch.setattr(
            Path, "replace", lambda self, to: (done.append("replace"), replace(self, to))
        )
        write_atomically(tmp_path / "a", b"content")
        assert done == ["fsync", "replace", "fsync"]  # of the content, and of the name

    def test_can_be_read_by_colleagues(self, tmp_path):
        write_atomically(tmp_path / "a", b"content")
        assert (tmp_path / "a").stat().st_mode & 0o777 == 0o644

    def test_refuse_numbers_that_json_does_not_have(self, tmp_path):
        with pytest.raises(ValueError, match="JSON"):
            write_json(tmp_path / "a.json", [float("nan")])
        assert list(tmp_path.iterdir()) == []
