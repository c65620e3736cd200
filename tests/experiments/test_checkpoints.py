"""Checkpoints: when they are written, that none is ever half there, and what is refused."""

import json
import os
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from orchid_uav.agents import MAPPO
from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training import loop as training
from orchid_uav.experiments.training.checkpoints import CheckpointStore
from orchid_uav.experiments.training.state import TrainingState
from orchid_uav.storage.files import sealed
from orchid_uav.storage.tensors import TensorSpec
from tests.helpers.processes import (
    Audience,
    columns,
    fingerprint,
    killed_at_step,
    record_of,
    tell_of_file_steps,
    tiny_config,
)

RUN = "20260101T000000Z-lab-s0-abcd"
LOG = 123, "0" * 64
FILES = {"state.json", "weights.safetensors", "replay.safetensors"}


def state_of(number: int) -> TrainingState:
    """A state that says which one it is in each of its files."""
    return TrainingState(
        {"learner": {"number": number}},
        {
            "weights": {"w": np.full((3, 2), number, np.float32), "b": np.array(number, np.int64)},
            "replay": {"rewards": np.arange(number, dtype=np.float32)},
        },
    )


def kinds_of(document) -> dict[str, dict[str, TensorSpec]]:
    tensors = state_of(document["learner"]["number"]).tensors
    return {
        name: {key: TensorSpec.of(array) for key, array in arrays.items()}
        for name, arrays in tensors.items()
    }


def number_of(store: CheckpointStore, episode: int) -> int:
    """Which state a checkpoint is, once all of it was checked."""
    found = store.read(episode, kinds_of)
    number = found.document["learner"]["number"]
    for name, arrays in state_of(number).tensors.items():
        assert set(found.tensors[name]) == set(arrays)
        for key, array in arrays.items():
            assert found.tensors[name][key].dtype == array.dtype
            np.testing.assert_array_equal(found.tensors[name][key], array)
    return number


def all_of(store: CheckpointStore) -> dict[int, int]:
    """The states of all checkpoints, by episode, latest first."""
    return {episode: number_of(store, episode) for episode in store.episodes()}


@pytest.fixture
def store(tmp_path) -> CheckpointStore:
    return CheckpointStore(tmp_path, RUN, keep=3)


@pytest.fixture
def quick_disk(monkeypatch):
    """What is written outlives a process without it; only a power cut would show a difference."""
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)


class TestContent:
    def test_comes_back_bit_for_bit(self, store):
        special = np.array([np.nan, -0.0, np.inf, 5e-324, 1 / 3], np.float64)
        arrays = {
            "special": special,
            "truth": np.array([[True, False]]),
            "bytes": np.arange(256, dtype=np.uint8),
            "keys": np.array([2**64 - 1, 0], np.uint64),
            "none": np.zeros((0, 7), np.float32),
            "one": np.array(2.5, np.float32),
        }
        written = {"odd": 1 / 3, "large": 2**127, "text": "µ", "nothing": None}
        specs = {"things": {name: TensorSpec.of(array) for name, array in arrays.items()}}
        store.save(5, TrainingState({"learner": written}, {"things": arrays}), LOG)
        document, tensors = store.read(5, lambda document: specs)
        assert document["learner"] == written
        assert (document["log_size"], document["log_sha256"]) == LOG
        for name, array in arrays.items():
            found = tensors["things"][name]
            assert (found.dtype, found.shape) == (array.dtype, array.shape)
            assert found.tobytes() == array.tobytes()

    def test_is_json_and_safetensors(self, store):
        store.save(5, state_of(5), LOG)
        assert {path.name for path in (store.folder / "5").iterdir()} == FILES
        document = json.loads((store.folder / "5" / "state.json").read_text())
        assert (document["run"], document["episode"]) == (RUN, 5)

    def test_without_any_there_is_none(self, store):
        assert store.episodes() == []
        with pytest.raises(InputError, match=r"cannot read .*5: No such file"):
            store.read(5, kinds_of)

    def test_other_things_in_the_folder_are_none_and_stay(self, store):
        store.save(5, state_of(5), LOG)
        (store.folder / "7").touch()
        for name in ("notes", ".notes", "-3", "8.bak", "1e3", ".x.old"):
            (store.folder / name).mkdir()
        before = set(store.folder.iterdir())
        assert store.episodes() == [5]
        store.save(6, state_of(6), LOG)
        store.forget_later_than(5)
        assert set(store.folder.iterdir()) == before


class TestNumber:
    def test_the_latest_are_kept(self, store):
        for episode in (2, 4, 6, 8, 10):
            store.save(episode, state_of(episode), LOG)
            assert store.episodes() == [e for e in (10, 8, 6, 4, 2) if e <= episode][:3]
        assert all_of(store) == {10: 10, 8: 8, 6: 6}
        assert {path.name for path in store.folder.iterdir()} == {"10", "8", "6"}

    def test_in_the_order_of_numbers_not_of_names(self, tmp_path):
        store = CheckpointStore(tmp_path, RUN, keep=1)
        for episode in (9, 10, 100):
            store.save(episode, state_of(episode), LOG)
            assert store.episodes() == [episode]

    def test_one_of_the_same_episode_takes_the_place_of_the_other(self, store):
        for number in (1, 2, 3):
            store.save(5, state_of(number), LOG)
            assert all_of(store) == {5: number}
        assert {path.name for path in store.folder.iterdir()} == {"5"}

    def test_those_behind_where_a_run_goes_on_are_forgotten(self, store):
        for episode in (2, 4, 6):
            store.save(episode, state_of(episode), LOG)
        store.forget_later_than(4)
        assert all_of(store) == {4: 4, 2: 2}


SAVES = [(2, 2), (4, 4), (4, 5), (6, 6), (8, 8), (8, 9)]
"""Episode and state of saves that add, remove, and take the place of another."""


class TestAtomicity:
    @pytest.mark.parametrize("keep", [1, 2])
    def test_whoever_looks_at_any_moment_finds_whole_ones_the_last_or_the_new(
        self, tmp_path, monkeypatch, keep
    ):
        store = CheckpointStore(tmp_path, RUN, keep)
        looks, looking, allowed = [], False, {None, SAVES[0][1]}

        def look(step):
            nonlocal looking
            if looking:
                return
            looking = True
            found = all_of(store)
            looks.append(step)
            assert max(found.values(), default=None) in allowed, f"before {step}: {found}"
            looking = False

        tell_of_file_steps(monkeypatch, look)
        for episode, number in SAVES:
            allowed |= {number}
            store.save(episode, state_of(number), LOG)
            allowed = {number}
        allowed = {None, 6, 9}
        store.forget_later_than(6)
        assert {"mkdir", "open", "write", "fsync", "rename", "unlink", "rmdir"} <= set(looks)
        assert store.episodes() == [6][: keep - 1]

    @pytest.mark.parametrize(("keep", "stride"), [(1, 1), (2, 5)])
    def test_a_process_killed_at_any_moment_leaves_the_last_or_the_new_one(
        self, tmp_path, quick_disk, keep, stride
    ):
        def save() -> None:
            store = CheckpointStore(here, RUN, keep)
            for episode, number in SAVES[2:5]:  # the same again, one more, one too many
                store.save(episode, state_of(number), LOG)

        at, was_killed = 1, True
        while was_killed:
            here = tmp_path / str(at)
            here.mkdir()
            store = CheckpointStore(here, RUN, keep)
            for episode, number in SAVES[:2]:
                store.save(episode, state_of(number), LOG)
            was_killed = killed_at_step(save, at, tell_of_file_steps)
            found = all_of(store)
            assert found, f"killed at step {at}"
            assert max(found.values()) >= 4
            # Whatever it left is cleared away by the next save.
            store.save(10, state_of(10), LOG)
            assert number_of(store, 10) == 10
            assert len(store.episodes()) <= keep
            assert {path.name for path in store.folder.iterdir()} == set(map(str, store.episodes()))
            at += stride
        assert at > 50

    def test_a_write_that_fails_at_any_moment_leaves_the_others(self, tmp_path, quick_disk):
        at, failed = 0, True
        while failed:
            at += 1
            store = CheckpointStore(tmp_path / str(at), RUN, keep=2)
            store.folder.parent.mkdir()
            for episode, number in SAVES[:2]:
                store.save(episode, state_of(number), LOG)
            with pytest.MonkeyPatch.context() as patch:
                failed = self.fail_at(patch, at, lambda: store.save(6, state_of(6), LOG))  # noqa: B023
            found = all_of(store)
            assert found in ({4: 4, 2: 2}, {6: 6, 4: 4, 2: 2}, {6: 6, 4: 4}), f"at step {at}"
            store.save(8, state_of(8), LOG)
            assert len(all_of(store)) == 2
            assert {path.name for path in store.folder.iterdir()} == set(map(str, store.episodes()))
        assert at > 15

    @staticmethod
    def fail_at(patch, at, save) -> bool:
        """Whether the save came as far as the step at which the disk is full from then on."""
        steps = 0

        def tell(step):
            nonlocal steps
            steps += 1
            if steps >= at and step in {"mkdir", "open", "write", "fsync", "rename"}:
                raise OSError(28, "No space left on device")

        tell_of_file_steps(patch, tell)
        try:
            save()
        except OSError as error:
            assert error.errno == 28
        return steps >= at

    def test_content_reaches_the_disk_before_the_name_does(self, store, monkeypatch):
        store.save(2, state_of(2), LOG)
        steps = []
        tell_of_file_steps(monkeypatch, steps.append)
        store.save(4, state_of(4), LOG)
        renamed = steps.index("rename")
        # Each file, the directory that lists them; then the folder that has the new name.
        assert steps[:renamed].count("fsync") == len(FILES) + 1
        assert steps[renamed - 1] == "fsync"
        assert steps[renamed + 1] == "fsync"

    def test_the_first_one_makes_sure_that_its_folder_is_there_after_a_power_cut(
        self, store, monkeypatch
    ):
        synced = []
        sync = os.fsync
        monkeypatch.setattr(
            os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_ino), sync(fd))[1]
        )
        store.save(2, state_of(2), LOG)
        assert store.folder.parent.stat().st_ino in synced


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def flip_a_bit(path: Path, place: float = 0.9, bit: int = 2) -> None:
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1 << bit
    path.write_bytes(content)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def make_a_directory(path: Path) -> None:
    path.unlink()
    path.mkdir()


class TestDamage:
    @pytest.fixture(autouse=True)
    def saved(self, store, quick_disk):
        for episode in (2, 4):
            store.save(episode, state_of(episode), LOG)

    def refused(self, store, *parts, episode=4) -> None:
        with pytest.raises(InputError) as error:
            store.read(episode, kinds_of)
        assert len(str(error.value).splitlines()) == 1
        for part in parts:
            assert part in str(error.value)
        assert number_of(store, 2) == 2

    @pytest.mark.parametrize("name", sorted(FILES))
    @pytest.mark.parametrize("damage", [cut, flip_a_bit, empty, make_a_directory, Path.unlink])
    def test_of_any_file_is_found(self, store, name, damage):
        damage(store.folder / "4" / name)
        self.refused(store, str(store.folder / "4"))

    def test_of_any_bit_is_found_or_changes_nothing(self, store):
        draw, harmless = random.Random(4), 0
        originals = {name: (store.folder / "4" / name).read_bytes() for name in FILES}
        for _ in range(300):
            name = draw.choice(sorted(FILES))
            flip_a_bit(store.folder / "4" / name, draw.random(), draw.randrange(8))
            try:
                assert number_of(store, 4) == 4
                harmless += 1  # "1e-05" and "1E-05" are the same number
            except InputError:
                pass
            (store.folder / "4" / name).write_bytes(originals[name])
        assert harmless < 5

    def test_of_a_file_that_another_checkpoint_of_the_run_has_there_is_found(self, store):
        for name in FILES:
            shutil.copytree(store.folder / "4", store.folder / "whole")
            shutil.copy(store.folder / "2" / name, store.folder / "4" / name)
            self.refused(store)
            shutil.rmtree(store.folder / "4")
            (store.folder / "whole").rename(store.folder / "4")
        assert number_of(store, 4) == 4

    def test_another_number_is_found(self, store):
        (store.folder / "4").rename(store.folder / "9")
        assert store.episodes() == [9, 2]
        self.refused(store, "checkpoint 4", "9", episode=9)

    def test_another_run_is_found(self, store, tmp_path):
        other = CheckpointStore(tmp_path / "other", "20260101T000000Z-lab-s0-wxyz", 3)
        other.folder.parent.mkdir()
        other.save(4, state_of(4), LOG)
        shutil.rmtree(store.folder / "4")
        shutil.copytree(other.folder / "4", store.folder / "4")
        self.refused(store, "20260101T000000Z-lab-s0-wxyz")

    @pytest.mark.parametrize("schema", [0, 2, "1", None])
    def test_another_schema_is_found(self, store, schema):
        self.change(store, schema=schema)
        self.refused(store)

    @pytest.mark.parametrize(
        "change",
        [
            {"files_sha256": {}},
            {"files_sha256": {"weights": "0" * 64, "replay": "0" * 64}},
            {"files_sha256": None},
            {"learner": {"number": 5}},
            {"learner": None},
            {"episode": "4"},
        ],
    )
    def test_a_state_that_somebody_wrote_and_sealed_is_checked_all_the_same(self, store, change):
        self.change(store, **change)
        self.refused(store)

    @staticmethod
    def change(store, **values) -> None:
        path = store.folder / "4" / "state.json"
        path.write_text(json.dumps(sealed(json.loads(path.read_text()) | values)))


class TestWhen:
    """Of checkpoints during a training."""

    @pytest.fixture(autouse=True)
    def quick(self, quick_disk, monkeypatch):
        monkeypatch.setattr(provenance, "git_commit", lambda: None)

    @pytest.fixture
    def saves(self, monkeypatch):
        """The episodes of all saves."""
        made, save = [], CheckpointStore.save

        def noting(store, episode, state, log):
            made.append(episode)
            save(store, episode, state, log)

        monkeypatch.setattr(CheckpointStore, "save", noting)
        return made

    @staticmethod
    def train(runs_dir, config, audience=None) -> Path:
        run = RunDirectory.create(runs_dir, "lab", config, ["orchid", "train"])
        return training.train(config, run, audience or Audience(), []).run.path

    @pytest.mark.parametrize("algorithm", ["mappo", "maddpg"])
    @pytest.mark.parametrize(
        ("every", "episodes", "worlds", "expected"),
        [
            (3, 8, 1, [3, 6, 8]),
            (3, 6, 1, [3, 6]),
            (1, 3, 1, [1, 2, 3]),
            (50, 4, 1, [4]),
            (2, 8, 3, [3, 6, 8]),
            (5, 9, 3, [6, 9]),
        ],
    )
    def test_every_few_episodes_and_at_the_end(
        self, runs_dir, saves, algorithm, every, episodes, worlds, expected
    ):
        values = {
            "checkpoint__every_episodes": every,
            "checkpoint__keep": 2,
            "training__worlds": worlds,
            "training__algorithm": algorithm,
            "maddpg__hidden_sizes": [8],
            "maddpg__batch_size": 16,
        }
        path = self.train(runs_dir, tiny_config(episodes, **values))
        assert saves == expected
        kept = {path.name for path in (path / "checkpoints").iterdir()}
        assert kept == {str(episode) for episode in expected[-2:]}

    def test_three_of_them_are_kept_and_fifty_episodes_lie_between_them_by_default(self):
        assert tiny_config().checkpoint.every_episodes == 50
        assert tiny_config().checkpoint.keep == 3

    def test_weights_that_are_no_numbers_are_never_saved(self, runs_dir, new_runs, monkeypatch):
        update = MAPPO.train

        def diverge(model):
            update(model)
            if model._n_updates == 4 * 5:  # four passes over each of five episodes
                with torch.no_grad():
                    next(model.policy.parameters()).fill_(torch.nan)

        monkeypatch.setattr(MAPPO, "train", diverge)
        config = tiny_config(8, checkpoint__every_episodes=2)
        with pytest.raises(RunFailedError, match="checkpoint of episode 4 is kept"):
            self.train(runs_dir, config)
        [path] = new_runs()
        assert record_of(path)["status"] == "failed"
        assert {path.name for path in (path / "checkpoints").iterdir()} == {"2", "4"}
        monkeypatch.setattr(MAPPO, "train", update)
        run = RunDirectory.reopen(path, config, ["orchid", "train", "--resume", path.name])
        assert training.train(config, run, Audience(), []).status == "completed"
        assert columns(path)["episode"] == list(range(1, 9))

    def test_a_disk_that_is_full_for_them_costs_no_checkpoint_that_was_written(
        self, runs_dir, new_runs, monkeypatch
    ):
        before = {}

        def fill(episodes):
            if episodes == 5:
                before.update(fingerprint(new_runs()[0] / "checkpoints"))

                def refuse(self, mode="r", *arguments, **options):
                    if self.parent.parent.name == "checkpoints" and "w" in mode:
                        raise OSError(28, "No space left on device")
                    return open_path(self, mode, *arguments, **options)

                open_path = Path.open
                monkeypatch.setattr(Path, "open", refuse)

        config = tiny_config(8, checkpoint__every_episodes=2)
        with pytest.raises(RunFailedError, match=r"No space left .*of episode 4 is kept"):
            self.train(runs_dir, config, Audience(fill))
        assert len(before) == 2 * (1 + 4)  # state, weights, optimizer, worlds
        assert fingerprint(new_runs()[0] / "checkpoints") == before
