"""Processes that are killed while they write: the same command goes on, and clears up."""

import os
from pathlib import Path

import pytest

from orchid_uav.cli.main import main
from orchid_uav.experiments.ablation.design import Ablation
from orchid_uav.experiments.ablation.study import AblationStudy
from orchid_uav.experiments.ablation.variants import Variant
from orchid_uav.storage.files import leftovers, remove_leftovers
from tests.helpers.processes import (
    assert_is_an_error,
    killed_at_step,
    tell_of_file_steps,
    tiny_config,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="fork and signals are POSIX")

EVAL = ["eval", "--methods=static-mmf", "--uavs=2", "--users=20", "--set=network.episode_slots=10"]
EVAL += ["--episodes=2", "--no-figures", "--quiet"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch, plain_environment):
    monkeypatch.chdir(tmp_path)


def steps(patch, tell) -> None:
    """All steps but those in which numba looks for its cache."""
    tell_of_file_steps(patch, lambda kind: kind == "mkdir" or tell(kind))


def hidden(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.rglob(".*"))


# In the folder that tries whether something can be written, in the first summary, in the flights.
@pytest.mark.parametrize("at", [1, 2, 3, 4, 5, 7, 8, 10])
def test_an_evaluation_goes_on(orchid, tmp_path, at):
    out = tmp_path / "out"
    command = [*EVAL, f"--out={out}"]
    assert killed_at_step(lambda: main(command), at, steps)
    finished = orchid(*command)
    assert finished.code == 0, finished.err
    assert {path.name for path in out.iterdir()} == {"summary.json", "episodes.parquet"}


def test_an_evaluation_leaves_what_is_somebody_elses(orchid, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in (".summary.json.bak", "thesis.tex"):
        (out / name).write_text("ten years of work")
        assert_is_an_error(orchid(*EVAL, f"--out={out}"), "is left alone")
        assert (out / name).read_text() == "ten years of work"
        (out / name).unlink()


def test_an_ablation_goes_on(tmp_path):
    out = tmp_path / "out"

    def reserved() -> None:
        ablation = Ablation(
            tiny_config(4), [Variant("no-rf", {"reset.enabled": False})], [0], 2, 0, 0.05
        )
        AblationStudy(ablation, out, ["orchid", "ablate"]).reserve()

    at = 0
    while killed_at_step(reserved, at := at + 1, tell_of_file_steps):
        reserved()
        assert sorted(path.name for path in out.iterdir()) == ["ablation.json", "jobs", "runs"]
        if at % 2:  # every second one begins anew
            for path in sorted(out.iterdir()):
                path.rmdir() if path.is_dir() else path.unlink()
            out.rmdir()
    assert at > 5


def test_a_plan_is_written_anew(orchid, tmp_path):
    people = tmp_path / "people.csv"
    rows = "".join(f"{37 * k % 101},{53 * k % 97}\n" for k in range(20))
    people.write_text("x_m,y_m\n" + rows)
    command = ["plan", str(people), "--drones=2", "--budget=20", "--quiet", "--out=plan"]
    assert killed_at_step(lambda: main(command), 5, steps)
    assert len(hidden(tmp_path)) == 1
    (tmp_path / ".plan-archived").mkdir()  # as many letters as temporary names end with
    assert orchid(*command).code == 0
    assert hidden(tmp_path) == [".plan-archived"]


def test_only_what_was_being_written_is_removed(tmp_path):
    names = [".a.json.abcdefg0", ".a.json-abcdefg0", ".b.json.abcdefg0", ".a.json.bak", "a.json"]
    for name in [*names, ".axjson.abcdefg0", ".a.json.abcdefg0.abcdefg0"]:
        (tmp_path / name).write_text("")
    (tmp_path / ".a.json-folder_0").mkdir()
    (tmp_path / ".a.json-folder_0" / "inside").write_text("")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / ".a.json-linked_0").symlink_to(tmp_path / "elsewhere")
    found = {".a.json.abcdefg0", ".a.json-abcdefg0", ".a.json-folder_0", ".a.json-linked_0"}
    before = {path.name for path in tmp_path.iterdir()}
    assert {path.name for path in leftovers(tmp_path, ["a.json"])} == found
    remove_leftovers(tmp_path, ["a.json"])
    assert {path.name for path in tmp_path.iterdir()} == before - found
