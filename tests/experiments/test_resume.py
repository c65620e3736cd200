"""Exact resume: a run that was stopped, killed or damaged becomes the run it would have been.

Bits are compared with an undisturbed run's on the same machine: others have other late digits.
"""

import json
import os
import random
import re
import shlex
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import load_file

from orchid_uav.agents import MADDPG, MAPPO
from orchid_uav.cli.main import main
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.experiments import provenance
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.evaluation.methods import read_policy
from orchid_uav.experiments.interruption import Interruption
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.runs.records import NUMERICS, read_config, read_record, status_of
from orchid_uav.experiments.training import listeners
from orchid_uav.experiments.training import loop as training
from orchid_uav.experiments.training.checkpoints import CheckpointStore
from orchid_uav.experiments.training.trackers import open_tracker
from tests.helpers.damage import reseal, write_sealed
from tests.helpers.processes import (
    TINY_FLAGS,
    Audience,
    assert_is_an_error,
    cells,
    columns,
    files_of,
    fingerprint,
    forked,
    killed_at_step,
    learned_files,
    record_of,
    tell_of_file_steps,
    tiny_config,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="fork and signals are POSIX")

GIVE_UP_AFTER_S = 60.0

RESETS = {
    "reset__enabled": True,
    "reset__window": 1,
    "reset__tolerance_jfi": 1e9,
    "reset__tolerance_reward": 1e9,
    "reset__max_resets": 2,
}
"""Reset-and-Finetune acts as soon as its windows are full: after episodes 2 and 4."""

MOVING = {"network__user_speed_mps": 15.0, "network__heading_hold_s": 3.0}
"""Users walk, so that the middle of an episode depends on how it began."""

SMALL_MADDPG = {
    "training__algorithm": "maddpg",
    "maddpg__hidden_sizes": [16, 16],
    "maddpg__batch_size": 8,
    "maddpg__update_every_slots": 4,  # of ten: most updates lie in the middle of an episode
    **MOVING,
}

CASES = {
    "mappo": MOVING,
    "mappo, resets": RESETS | {"training__final_learning_rate_scale": 0.2},
    "mappo, resets that keep the optimizer": RESETS | {"reset__clear_optimizer": False},
    "mappo, resets drawn before": RESETS | {"reset__trigger": "random"},
    "mappo, three worlds": RESETS | MOVING | {"training__worlds": 3},
    "mappo, schedules that end early": {
        "training__schedule_episodes": 5,
        "training__final_learning_rate_scale": 0.3,
        "ppo__entropy_coef": [0.05, 0.001],
    },
    "mappo, small batches, pf": {
        "ppo__batch_size": 7,
        "ppo__epochs": 2,
        "reward__objective": "pf",
        "network__distribution": "uniform",
    },
    "mappo, rows, centred rewards": MOVING
    | {"ppo__minibatch": "rows", "training__center_rewards": True, "training__worlds": 2},
    "maddpg": SMALL_MADDPG,
    "maddpg, centred rewards": SMALL_MADDPG | {"training__center_rewards": True},
    "maddpg, buffer wrapped around": SMALL_MADDPG | {"maddpg__buffer_size": 24},
    "maddpg, first update in episode 5": SMALL_MADDPG | {"maddpg__batch_size": 44},
    "maddpg, three worlds": SMALL_MADDPG
    | RESETS
    | {
        "training__worlds": 3,
        "maddpg__buffer_size": 50,
        "maddpg__update_every_slots": 7,
        "training__final_learning_rate_scale": 0.5,
        "training__schedule_episodes": 5,
    },
    "maddpg, resets": SMALL_MADDPG | RESETS,
    "dagger": {
        "training__algorithm": "dagger",
        "reset__enabled": False,
        "uav__flight": "station",
        "uav__observation": "informed",
        "dagger__hidden_sizes": (8,),
        "dagger__batch_size": 16,
        "dagger__gradient_steps": 3,
        "dagger__examples": 150,
    },
}
EPISODES = 8


@pytest.fixture(autouse=True, scope="module")
def quick():
    """No looking for versions, no waiting for the disk: a process that dies loses nothing by it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(provenance, "git_commit", lambda: None)
        patch.setattr(provenance, "version", lambda package: "1.0")
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


def case(name: str, episodes: int = EPISODES, **values):
    return tiny_config(episodes, **{"checkpoint__every_episodes": 2} | CASES[name] | values)


def begin(runs_dir, config, audience=None, interruption=None, with_trackers=()) -> Path:
    """The directory of a new run that was trained until it ended."""
    run = RunDirectory.create(Path(runs_dir), "lab", config, ["orchid", "train"])
    audience, interruption = audience or Audience(), interruption or Interruption()
    training.train(config, run, audience, with_trackers, interruption)
    return run.path


def go_on(path, audience=None, interruption=None, config=None) -> training.TrainingOutcome:
    config = config or read_config(path, read_record(path))
    run = RunDirectory.reopen(path, config, ["orchid", "train", "--resume", path.name])
    audience, interruption = audience or Audience(), interruption or Interruption()
    return training.train(config, run, audience, (), interruption)


def store_of(path: Path) -> CheckpointStore:
    return CheckpointStore(path, record_of(path)["id"], keep=3)


def document_of(path: Path, episode: int) -> dict:
    """What a checkpoint holds as JSON, besides the name of its run."""
    document = json.loads((path / "checkpoints" / str(episode) / "state.json").read_text())
    return {key: value for key, value in document.items() if key not in {"run", "seal"}}


def assert_same(path: Path, whole: Path) -> None:
    """The run is the uninterrupted one, in what it learned and in what its future depends on."""
    assert learned_files(path) == learned_files(whole)
    mine, other = record_of(path), record_of(whole)
    for name in ("status", "episodes", "reset_episodes", "final", "error"):
        assert mine[name] == other[name]
    assert mine["status"] == "completed"
    # Weights, optimizer, replay and worlds by their checksums; counters and generators themselves.
    assert document_of(path, mine["episodes"]) == document_of(whole, mine["episodes"])


def copy_of(path: Path, to: Path, latest: int | None = None) -> Path:
    """The run as it was when its checkpoint ``latest`` was new, but for a log that went on."""
    copy = to / path.name
    shutil.copytree(path, copy)
    for name in ("policy.json", "policy.safetensors"):
        (copy / name).unlink(missing_ok=True)
    for episode in store_of(copy).episodes():
        if latest is not None and episode > latest:
            shutil.rmtree(copy / "checkpoints" / str(episode))
    return copy


def stopping(interruption: Interruption, after: int) -> Audience:
    """Asks for a stop after as many episodes."""

    def stop(episodes):
        interruption.requested = interruption.requested or episodes >= after

    return Audience(stop)


def interrupted(runs_dir, config, after: int) -> Path:
    """A run that was stopped in the update that follows ``after`` episodes."""
    interruption = Interruption()
    path = begin(runs_dir, config, stopping(interruption, after), interruption)
    assert record_of(path)["status"] == "interrupted"
    return path


class TestRestOfTheRun:
    @pytest.mark.parametrize("name", CASES)
    def test_is_the_same_bit_for_bit_from_every_checkpoint(self, name, runs_dir, tmp_path):
        config = case(name, checkpoint__every_episodes=1, checkpoint__keep=100)
        whole = begin(runs_dir, config)
        plain = begin(runs_dir, case(name, checkpoint__every_episodes=100))
        assert learned_files(whole) == learned_files(plain), "saving changes the run"
        episodes = sorted(store_of(whole).episodes())
        worlds = config.training.worlds
        assert episodes == sorted({*range(worlds, EPISODES, worlds), EPISODES})
        # Before, between and after the resets, and with nothing left to do.
        for episode in episodes if worlds > 1 else (1, 3, 6, EPISODES):
            path = copy_of(whole, tmp_path / str(episode), episode)
            np.random.seed(episode)  # noqa: NPY002 - whatever the process did before
            audience = Audience()
            assert go_on(path, audience).status == "completed"
            assert (audience.began_behind, audience.warnings) == (episode, [])
            assert_same(path, whole)

    def test_cases_are_what_they_are_called(self, runs_dir):
        logged = columns(begin(runs_dir, case("mappo, resets")))
        assert logged["reset"] == [0, 1, 0, 1, 0, 0, 0, 0]
        rates = [1e-4 * 0.5 ** ((e >= 2) + (e >= 4)) for e in range(1, 9)]
        decay = [1 - 0.8 * done / 8 for done in range(1, 9)]
        assert logged["actor_lr"] == pytest.approx(np.multiply(rates, decay), rel=1e-12)
        logged = columns(begin(runs_dir, case("mappo, schedules that end early")))
        assert logged["entropy_coef"] == pytest.approx(
            [0.05 + (0.001 - 0.05) * min(done / 5, 1) for done in range(8)], rel=1e-12
        )
        drawn = record_of(begin(runs_dir, case("mappo, resets drawn before")))["reset_episodes"]
        assert len(drawn) == 2
        assert set(drawn) <= set(range(2, 8))

    def test_of_maddpg_begins_in_the_middle_of_an_episode_and_of_its_buffer(self, runs_dir):
        all_of_them = {"checkpoint__every_episodes": 1, "checkpoint__keep": 100}
        path = begin(runs_dir, case("maddpg, buffer wrapped around", **all_of_them))
        # Updates follow slots 4, 8, 12 ...; those of the first episode are flown after ten.
        assert load_file(path / "checkpoints/1/worlds.safetensors")["slot"].tolist() == [2]
        places = [document_of(path, episode)["learner"]["replay"] for episode in range(1, 5)]
        assert places == [
            {"pos": 12, "full": False},
            {"pos": 20, "full": False},
            {"pos": 32 - 24, "full": True},
            {"pos": 40 - 24, "full": True},
        ]
        late = begin(runs_dir, case("maddpg, first update in episode 5", **all_of_them))
        updates = [document_of(late, e)["learner"]["_n_updates"] for e in (1, 4, 5, 8)]
        assert updates == [0, 0, 3, 10]  # after slots 44, 48 and 52; ten up to slot 80

    def test_without_a_checkpoint_is_the_run_from_its_beginning(self, runs_dir, monkeypatch):
        config = case("mappo", checkpoint__every_episodes=100)
        whole = begin(runs_dir, config)
        failing_at(monkeypatch, MAPPO, "train", 4)
        with pytest.raises(RunFailedError, match="no checkpoint yet"):
            begin(runs_dir, config)
        monkeypatch.undo()
        [path] = set(runs_dir.glob("*-lab-*")) - {whole}
        assert len(cells(path)) == 4
        audience = Audience()
        go_on(path, audience)
        assert audience.began_behind == 0
        assert learned_files(path) == learned_files(whole)

    def test_may_be_learned_in_many_pieces(self, runs_dir):
        for name in ("mappo, resets", "maddpg, buffer wrapped around", "maddpg, three worlds"):
            whole = begin(runs_dir, case(name))
            path = interrupted(runs_dir, case(name), 1)
            pieces = 1
            while record_of(path)["status"] != "completed":
                interruption = Interruption()
                after = record_of(path)["episodes"] + 1
                go_on(path, stopping(interruption, after), interruption)
                pieces += 1
            assert pieces >= 3
            assert len(record_of(path)["resumed"]) == pieces - 1
            assert_same(path, whole)


def failing_at(patch, owner, name, call, error=None) -> None:
    """Have the n-th call of a method raise instead."""
    original, calls = getattr(owner, name), 0

    def fail(*arguments, **options):
        nonlocal calls
        calls += 1
        if calls == call:
            raise error or ArithmeticError("the loss is not a number")
        return original(*arguments, **options)

    patch.setattr(owner, name, fail)


class TestInterruption:
    @pytest.mark.parametrize(
        "name", ["mappo, resets", "mappo, three worlds", "maddpg", "maddpg, three worlds"]
    )
    def test_at_any_slot_loses_nothing(self, name, runs_dir, monkeypatch):
        whole = begin(runs_dir, case(name))
        fly, worlds = FleetVecEnv.step_wait, 3 if "three" in name else 1
        # Not in the last rollout, with which the run is complete; but once in the middle of the
        # last episodes of MADDPG's three worlds, one of which is not counted (M33).
        drawn = random.Random(4).sample(range(1, 60 // worlds), 4)
        for at in [*drawn, 23] if name == "maddpg, three worlds" else drawn:
            interruption, slots = Interruption(), 0

            def fly_and_stop(env, at=at, interruption=interruption):
                nonlocal slots
                slots += 1
                interruption.requested = interruption.requested or slots >= at
                return fly(env)

            monkeypatch.setattr(FleetVecEnv, "step_wait", fly_and_stop)
            path = begin(runs_dir, case(name), None, interruption)
            monkeypatch.setattr(FleetVecEnv, "step_wait", fly)
            record = record_of(path)
            assert record["status"] == "interrupted"
            assert record["episodes"] // worlds in {at // 10, (at - 1) // 10 + 1}
            assert record["episodes"] in store_of(path).episodes()
            assert go_on(path).status == "completed"
            assert_same(path, whole)

    def test_before_the_first_episode_leaves_a_run_that_goes_on(self, runs_dir):
        for name in ("mappo", "maddpg"):
            interruption = Interruption()
            interruption.requested = True
            path = begin(runs_dir, case(name), None, interruption)
            assert record_of(path)["status"] == "interrupted"
            assert store_of(path).episodes() == [0]
            go_on(path)
            assert_same(path, begin(runs_dir, case(name)))

    def test_of_a_run_that_has_just_been_resumed_changes_nothing(self, runs_dir):
        whole = begin(runs_dir, case("maddpg"))
        path = interrupted(runs_dir, case("maddpg"), 3)
        before = fingerprint(path / "checkpoints"), learned_files(path)
        for _ in range(2):
            interruption = Interruption()
            interruption.requested = True
            assert go_on(path, None, interruption).status == "interrupted"
            assert (fingerprint(path / "checkpoints"), learned_files(path)) == before
        go_on(path)
        assert_same(path, whole)

    @pytest.mark.parametrize(
        ("name", "slots", "episodes"),
        [("maddpg", 9, 1), ("maddpg", 5, 5), ("mappo, resets", 1, 4)],
    )
    def test_with_the_last_slot_but_before_the_last_update_is_no_completion(
        self, name, slots, episodes, runs_dir, monkeypatch
    ):
        # The first slot of the rollout behind the checkpoint ends the last episode.
        config = case(name, episodes, network__episode_slots=slots)
        whole = begin(runs_dir, config)
        learner = MADDPG if name == "maddpg" else MAPPO
        update, updates, interruption = learner.train, 0, Interruption()
        total = -(-slots * episodes // 4) if name == "maddpg" else episodes

        def update_and_stop(model, *arguments, **options):
            nonlocal updates
            updates += 1
            update(model, *arguments, **options)
            interruption.requested = updates == total - 1

        monkeypatch.setattr(learner, "train", update_and_stop)
        path = begin(runs_dir, config, None, interruption)
        monkeypatch.setattr(learner, "train", update)
        assert updates == total - 1
        record = record_of(path)
        assert record["status"] == "interrupted"
        assert record["reset_episodes"] == document_resets(path)
        go_on(path)
        assert_same(path, whole)

    def test_of_a_run_that_failed_and_goes_on(self, runs_dir, monkeypatch):
        whole = begin(runs_dir, case("mappo, resets"))
        for call in (2, 3, 5, 8):
            with monkeypatch.context() as patch:
                failing_at(patch, MAPPO, "train", call)
                with pytest.raises(RunFailedError):
                    begin(runs_dir, case("mappo, resets"))
            path = max(runs_dir.glob("*-lab-*"), key=lambda path: path.stat().st_ctime_ns)
            assert record_of(path)["status"] == "failed"
            go_on(path)
            assert_same(path, whole)


def document_resets(path: Path) -> list[int]:
    """The resets that the latest checkpoint knows of."""
    latest = max(store_of(path).episodes())
    kinds = {entry["kind"]: entry for entry in document_of(path, latest)["callbacks"]}
    return kinds.get("ResetAndFinetune", {"reset_episodes": []})["reset_episodes"]


def watch_all(patch, tell) -> None:
    """Tell of slots flown, steps of the optimizer, and all that happens to files."""
    tell_of_file_steps(patch, tell)
    fly, descend = FleetVecEnv.step_wait, torch.optim.Adam.step

    def flying(env):
        tell("fly")
        return fly(env)

    def learning(optimizer, *arguments, **options):
        tell("learn")
        return descend(optimizer, *arguments, **options)

    learning.hooked = True  # torch wraps it again otherwise
    patch.setattr(FleetVecEnv, "step_wait", flying)
    patch.setattr(torch.optim.Adam, "step", learning)


_KILLED_IN = ("fly", "learn", "write", "fsync")


def _places(steps, kind):
    return [place for place, step in enumerate(steps) if step == kind]


class TestKilled:
    @pytest.mark.parametrize("name", ["mappo, resets", "maddpg, three worlds"])
    def test_at_any_step_of_flying_learning_and_writing_and_again(self, name, runs_dir, tmp_path):
        every = 3 if "three" in name else 2
        config = case(name, checkpoint__every_episodes=every, checkpoint__keep=1)
        steps = []
        with pytest.MonkeyPatch.context() as patch:
            watch_all(patch, steps.append)
            whole = begin(runs_dir, config)
        draw, kinds, made_anew = random.Random(name), set(), 0
        of_each_kind = [draw.choice(_places(steps, kind)) for kind in _KILLED_IN]
        for trial in range(7):
            here = tmp_path / str(trial)
            at = of_each_kind[trial] if trial < len(of_each_kind) else draw.randrange(len(steps))
            again = draw.randrange(len(steps))
            assert killed_at_step(lambda: begin(here, config), at + 1, watch_all)  # noqa: B023
            kinds.add(steps[at])
            [path] = here.iterdir() if here.is_dir() else [here / "none"]
            if not (path / "run.json").is_file():
                with pytest.raises(InputError, match="is not a run directory"):
                    read_record(path)
                made_anew += 1
                continue
            assert status_of(path, read_record(path)) in {"died", "completed"}
            rows = (path / "episodes.csv").read_bytes().count(b"\n") - 1
            # Not more is lost than since the last checkpoint that was due.
            assert [*store_of(path).episodes(), 0][0] >= (rows - 1) // every * every
            if status_of(path, read_record(path)) == "died":
                killed_at_step(lambda: go_on(path), again + 1, watch_all)  # noqa: B023
                audience = Audience()
                go_on(path, audience)
                assert audience.warnings == [], f"killed at steps {at} and {again}"
            assert_same(path, whole)
        assert set(_KILLED_IN) <= kinds
        assert made_anew <= 2

    def test_while_a_file_is_replaced_leaves_no_litter_behind(self, runs_dir, tmp_path):
        steps = []
        with pytest.MonkeyPatch.context() as patch:
            tell_of_file_steps(patch, steps.append)
            whole = begin(runs_dir, case("mappo", 2))
        replaced = [at for at, step in enumerate(steps) if step == "replace"]
        for at in replaced[-3:]:  # weights, policy.json, run.json
            here = tmp_path / str(at)
            assert killed_at_step(lambda: begin(here, case("mappo", 2)), at + 1, tell_of_file_steps)  # noqa: B023
            [path] = here.iterdir()
            go_on(path)
            assert files_of(path) == files_of(whole)

    def test_at_any_time(self, runs_dir, tmp_path):
        config = case("maddpg, three worlds", 30)
        whole = begin(runs_dir, config)
        began = time.monotonic()
        begin(runs_dir, config)
        takes_s = time.monotonic() - began
        draw = random.Random(9)
        path, died = None, 0
        for _ in range(6):
            child = forked(lambda: go_on(path) if path else begin(tmp_path / "killed", config))  # noqa: B023
            time.sleep(draw.uniform(0.0, 0.5 * takes_s))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            found = [*tmp_path.glob("killed/*/run.json")]
            path = found[0].parent if found else path
            if path and status_of(path, read_record(path)) == "completed":
                break
            died += 1
        assert died >= 1
        path = path or begin(tmp_path / "killed", config)
        if record_of(path)["status"] != "completed":
            audience = Audience()
            go_on(path, audience)
            assert audience.warnings == []
        assert_same(path, whole)


class TestExtension:
    @pytest.fixture
    def complete(self, runs_dir):
        return begin(runs_dir, case("mappo, resets", 6))

    def extended(self, path: Path, to: Path, **options) -> Path:
        copy = copy_of(path, to)
        config = read_config(copy, read_record(copy)).extended_to(10)
        go_on(copy, config=config, **options)
        return copy

    def test_goes_on_where_the_run_ended_with_schedules_that_stand_still(self, complete, tmp_path):
        path = self.extended(complete, tmp_path)
        assert cells(path)[:7] == cells(complete)
        logged = columns(path)
        assert logged["episode"] == list(range(1, 11))
        assert logged["entropy_coef"][6:] == [0.0] * 4
        # Two resets, and the rates' decay at its end.
        assert logged["actor_lr"][6:] == pytest.approx([1e-4 * 0.25 * 0.2] * 4, rel=1e-12)
        assert logged["reset"] == [0, 1, 0, 1, *[0] * 6]
        record = record_of(path)
        assert (record["status"], record["episodes"]) == ("completed", 10)
        assert len(record["resumed"]) == 1

    @pytest.mark.parametrize(
        "name", ["mappo, resets drawn before", "mappo, three worlds", "maddpg, three worlds"]
    )
    def test_is_the_same_however_often_it_is_asked_for_and_stopped(self, name, runs_dir, tmp_path):
        complete = begin(runs_dir, case(name, 6))
        whole = self.extended(complete, tmp_path / "0")
        assert_same(self.extended(complete, tmp_path / "1"), whole)
        for after in (7, 9):
            interruption = Interruption()
            path = self.extended(
                complete,
                tmp_path / f"after {after}",
                audience=stopping(interruption, after),
                interruption=interruption,
            )
            assert go_on(path).status == "completed"
            assert_same(path, whole)

    def test_twice_leaves_the_schedules_where_the_first_episodes_led_them(self, complete):
        for episodes in (8, 9):
            config = read_config(complete, read_record(complete)).extended_to(episodes)
            assert config.training.schedule_episodes == 6
            go_on(complete, config=config)
        assert columns(complete)["entropy_coef"][6:] == [0.0] * 3

    def test_killed_at_any_step_of_its_beginning_can_be_asked_for_again(
        self, complete, tmp_path, orchid
    ):
        whole = self.extended(complete, tmp_path / "whole")

        def reopen() -> None:
            config = read_config(path, read_record(path)).extended_to(10)
            RunDirectory.reopen(path, config, ["orchid", "train"])

        at, was_killed = 0, True
        while was_killed:
            at += 1
            path = copy_of(complete, tmp_path / str(at))
            was_killed = killed_at_step(reopen, at, tell_of_file_steps)
            finished = orchid("train", "--resume", path, "--episodes=10", "--quiet")
            assert finished.code == 0, f"killed at step {at}: {finished.err}"
            assert_same(path, whole)
        assert at > 10

    def test_of_a_copy_is_the_same_under_an_id_of_its_own(self, complete, tmp_path, orchid):
        whole = self.extended(complete, tmp_path / "whole")
        before = fingerprint(complete)
        for name, known_as in (("longer", "longer"), ("a copy (2)", "a-copy--2-")):
            copy = complete.with_name(name)
            shutil.copytree(complete, copy)
            finished = orchid("train", "--resume", copy, "--episodes=8", "--quiet")
            assert finished.code == 0
            assert f"copy of run {complete.name}" in finished.err and known_as in finished.err
            # What is left of it are the new checkpoints and the policy, and the old ones too.
            finished = orchid("train", "--resume", copy, "--episodes=10", "--quiet")
            assert finished.code == 0
            assert "copy of run" not in finished.err
            record = record_of(copy)
            assert record["id"] == known_as
            assert record["former_ids"] == [complete.name]
            assert learned_files(copy) == learned_files(whole)
            assert json.loads((copy / "policy.json").read_text())["run"] == known_as
            assert read_policy(copy).run == known_as
        assert fingerprint(complete) == before
        assert record_of(whole)["id"] == complete.name
        assert "former_ids" not in record_of(whole)

    def test_of_a_link_keeps_the_id_and_of_a_renamed_run_does_not(self, complete, tmp_path):
        link = tmp_path / "link"
        link.symlink_to(complete)
        config = read_config(complete, read_record(complete))
        go_on(link, config=config.extended_to(7))
        assert record_of(complete)["id"] == complete.name
        moved = complete.rename(tmp_path / "best")
        go_on(moved, config=config.extended_to(7).extended_to(8))
        assert record_of(moved)["id"] == "best"

    def test_of_a_complete_run_without_checkpoints_does_not_throw_its_episodes_away(
        self, complete, orchid
    ):
        # One that was exported and imported, or released.
        shutil.rmtree(complete / "checkpoints")
        before = learned_files(complete)
        finished = orchid("train", "--resume", complete, "--episodes=10")
        assert_is_an_error(finished, "checkpoint")
        assert learned_files(complete) == before
        assert record_of(complete)["status"] == "completed"


def truncated(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 10)


def flipped(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-20] ^= 1
    path.write_bytes(content)


class TestDamage:
    """Of the newest checkpoint: behind episode 5, where the run was stopped, after 2 and 4."""

    NAME = "maddpg, buffer wrapped around"

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls, tmp_path_factory):
        return begin(tmp_path_factory.mktemp("whole"), case(cls.NAME))

    @pytest.fixture(scope="class")
    @classmethod
    def original(cls, tmp_path_factory):
        path = interrupted(tmp_path_factory.mktemp("stopped"), case(cls.NAME), 5)
        assert store_of(path).episodes() == [5, 4, 2]
        return path

    @pytest.fixture
    def stopped(self, original, tmp_path):
        return copy_of(original, tmp_path / "runs")

    def goes_on_from(self, path, whole, episode, damaged=(5,)) -> None:
        audience = Audience()
        assert go_on(path, audience).status == "completed"
        assert audience.began_behind == episode
        assert len(audience.warnings) == len(damaged)
        for warning, number in zip(audience.warnings, damaged, strict=True):
            assert warning.startswith(f"checkpoint {number} cannot be used: ")
            assert len(warning.splitlines()) == 1
        assert_same(path, whole)
        assert store_of(path).episodes() == [8, 6, max(episode, 4)]

    @pytest.mark.parametrize("damage", [truncated, flipped, Path.unlink])
    def test_of_any_file_has_the_one_before_taken(self, whole, stopped, tmp_path, damage):
        names = ("state.json", *(f"{n}.safetensors" for n in ("optimizer", "replay", "worlds")))
        assert {path.name for path in (stopped / "checkpoints/5").iterdir()} == {
            *names,
            "weights.safetensors",
        }
        for name in names if damage is flipped else names[:2]:
            path = copy_of(stopped, tmp_path / name)
            damage(path / "checkpoints" / "5" / name)
            self.goes_on_from(path, whole, 4)

    def test_of_several_has_the_one_before_them_taken(self, whole, stopped):
        truncated(stopped / "checkpoints" / "5" / "state.json")
        flipped(stopped / "checkpoints" / "4" / "weights.safetensors")
        self.goes_on_from(stopped, whole, 2, damaged=(5, 4))

    def test_another_name_is_seen_through(self, whole, stopped, tmp_path):
        path = copy_of(stopped, tmp_path)
        (path / "checkpoints" / "5").rename(path / "checkpoints" / "7")
        self.goes_on_from(path, whole, 4, damaged=(7,))
        path = copy_of(stopped, tmp_path / "2")
        (path / "checkpoints" / "5").rename(path / "checkpoints" / "3")
        (path / "checkpoints" / "4").rename(path / "checkpoints" / "5")
        self.goes_on_from(path, whole, 2, damaged=(5, 3))

    def test_another_runs_state_is_not_taken_for_its_own(self, whole, stopped, tmp_path):
        reseal(stopped / "run.json", former_ids="20260101T000000Z-lab-s0-wxyz")  # no list
        other = interrupted(tmp_path / "other", case(self.NAME, training__seed=1), 5)
        shutil.rmtree(stopped / "checkpoints" / "5")
        shutil.copytree(other / "checkpoints" / "5", stopped / "checkpoints" / "5")
        self.goes_on_from(stopped, whole, 4)

    def test_found_only_when_half_of_it_is_restored_leaves_no_trace(self, whole, stopped):
        # Well written, but by a version with other callbacks.
        reseal(stopped / "checkpoints" / "5" / "state.json", callbacks=[])
        self.goes_on_from(stopped, whole, 4)

    def test_of_the_log_before_it_makes_it_useless(self, whole, stopped):
        # Rows 3 to 5 gone, as far as the checkpoint behind episode 2 knows nothing is amiss.
        log = stopped / "episodes.csv"
        log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:3]))
        self.goes_on_from(stopped, whole, 2, damaged=(5, 4))

    def test_of_one_digit_in_the_log_too(self, whole, stopped):
        log = stopped / "episodes.csv"
        lines = log.read_bytes().splitlines(keepends=True)
        lines[5] = lines[5].replace(b".", b".1", 1)
        log.write_bytes(b"".join(lines))
        self.goes_on_from(stopped, whole, 4)

    @pytest.mark.parametrize("rest", [b"6", b"6,1.5,0.9", b"6,1.5\n7,2.5\n", b"\xff\x00" * 99])
    def test_of_the_log_behind_it_does_no_harm(self, whole, stopped, rest):
        with (stopped / "episodes.csv").open("ab") as file:
            file.write(rest)
        self.goes_on_from(stopped, whole, 5, damaged=())

    @pytest.mark.parametrize("harm", ["checkpoints", "callbacks", "log", "no log"])
    def test_of_all_is_an_error_that_deletes_nothing(self, stopped, orchid, harm):
        places = [stopped / "checkpoints" / str(episode) for episode in (2, 4, 5)]
        if harm == "checkpoints":
            for place in places:
                flipped(place / "weights.safetensors")
        elif harm == "callbacks":
            for place in places:
                reseal(place / "state.json", callbacks=[])
        elif harm == "log":
            log = stopped / "episodes.csv"
            log.write_bytes(log.read_bytes().replace(b"episode", b"Episode", 1))
        else:
            (stopped / "episodes.csv").unlink()
        before, record = fingerprint(stopped), record_of(stopped)
        finished = orchid("train", "--resume", stopped, "--quiet")
        assert finished.code == 1
        assert "Traceback" not in finished.err
        for episode in (5, 4, 2):
            assert f"warning: checkpoint {episode} cannot be used" in finished.err
        assert "none of the checkpoints can be used" in finished.err
        after = fingerprint(stopped)
        changed = {name for name in before if after.get(name) != before[name]}
        assert changed <= {"run.json"}
        assert files_of(stopped / "checkpoints") == {"2", "4", "5"}
        # What the run has achieved is still on record.
        for name in ("episodes", "final", "reset_episodes", "seconds"):
            assert record_of(stopped)[name] == record[name], name

    def test_the_message_promises_no_checkpoint_that_cannot_be_used(self, stopped, orchid):
        for episode in (2, 4, 5):
            truncated(stopped / "checkpoints" / str(episode) / "state.json")
        finished = orchid("train", "--resume", stopped, "--quiet")
        [error] = [line for line in finished.err.splitlines() if line.startswith("error: ")]
        assert "is kept" not in error
        assert "after 0 episodes" not in error


class TestCommand:
    """``orchid train --resume``."""

    @pytest.fixture
    def stopped(self, runs_dir):
        return interrupted(runs_dir, case("mappo"), 3)

    @pytest.fixture
    def complete(self, runs_dir):
        return begin(runs_dir, case("mappo", 4))

    @pytest.mark.parametrize("how", ["path", "id", "beginning"])
    def test_goes_on_with_a_run_given_as(self, stopped, runs_dir, orchid, how):
        whole = begin(runs_dir, case("mappo"))
        shutil.move(whole, runs_dir.parent / "whole")  # which would begin alike
        given = {"path": stopped, "id": stopped.name, "beginning": stopped.name[:9]}[how]
        finished = orchid("train", "--runs-dir", runs_dir, "--resume", given)
        assert finished.code == 0
        assert "continuing after episode 3" in finished.out
        assert "completed: 8 episodes" in finished.out
        assert_same(stopped, runs_dir.parent / "whole")
        [resumed] = record_of(stopped)["resumed"]
        assert resumed["command"][:2] == ["orchid", "train"]
        assert resumed["command"][-1] == str(given)

    def test_says_that_a_run_began_with_other_last_digits(self, stopped, orchid):
        record = record_of(stopped)
        assert record.pop("numerics") == NUMERICS
        write_sealed(stopped / "run.json", record)  # of a version that did not count them yet
        finished = orchid("train", "--resume", stopped)
        assert finished.code == 0
        assert "note: run" in finished.err
        assert "last digits" in finished.err
        assert record_of(stopped)["status"] == "completed"
        assert "numerics" not in record_of(stopped)  # it stays a run of that version
        again = orchid("train", "--resume", begin(stopped.parent, case("mappo", 2)), "--episodes=3")
        assert again.code == 0
        assert "last digits" not in again.err

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    @pytest.mark.parametrize("where", ["--runs-dir", "ORCHID_RUNS_DIR"])
    def test_is_what_an_interrupted_run_prints_and_what_really_goes_on(
        self, runs_dir, new_runs, orchid, monkeypatch, number, where
    ):
        show = listeners.Reporter.show

        def show_and_interrupt(self, rows, reset_episodes):
            show(self, rows, reset_episodes)
            if rows[-1]["episode"] in {3, 5}:
                signal.raise_signal(number)

        monkeypatch.setattr(listeners.Reporter, "show", show_and_interrupt)
        arguments = ["train", *TINY_FLAGS, "--episodes=7", "--quiet"]
        if where == "--runs-dir":
            finished = orchid(*arguments, "--runs-dir", runs_dir)
        else:
            monkeypatch.setenv("ORCHID_RUNS_DIR", str(runs_dir))
            finished = orchid(*arguments)
        for episodes in (3, 5):
            assert finished.code == 130
            [path] = new_runs()
            record = record_of(path)
            assert (record["status"], record["episodes"]) == ("interrupted", episodes)
            assert episodes in store_of(path).episodes()
            [line] = [line for line in finished.err.splitlines() if "continue with: " in line]
            command = shlex.split(line.partition("continue with: ")[2])
            assert command[:3] == ["orchid", "train", "--resume"]
            finished = orchid(*command[1:], "--quiet")
        assert finished.code == 0
        assert columns(path)["episode"] == list(range(1, 8))

    def test_of_a_failed_run_is_printed_too(self, runs_dir, orchid, monkeypatch):
        failing_at(monkeypatch, RunDirectory, "append_episodes", 3, OSError(28, "No space left"))
        finished = orchid("train", *TINY_FLAGS, "--episodes=3", "--quiet", "--runs-dir", runs_dir)
        assert finished.code == 1
        [line] = [line for line in finished.err.splitlines() if "continue with: " in line]
        command = shlex.split(line.partition("continue with: ")[2])
        assert orchid(*command[1:], "--quiet").code == 0

    def test_on_a_complete_run_needs_more_episodes(self, complete, orchid):
        before = fingerprint(complete)
        for arguments in ([], ["--episodes=4"]):
            finished = orchid("train", "--resume", complete, *arguments)
            assert_is_an_error(finished, complete.name, "complete", "--episodes above 4")
        assert_is_an_error(orchid("train", "--resume", complete, "--episodes=3"), "3", "4")
        assert fingerprint(complete) == before

    def test_with_more_episodes_extends_and_says_what_that_means(self, complete, orchid):
        finished = orchid("train", "--resume", complete, "--episodes=6", "--json", "--quiet")
        assert finished.code == 0
        assert json.loads(finished.out)["episodes"] == 6
        [note] = [line for line in finished.err.splitlines() if line.startswith("note: ")]
        for part in ("from 4 to 6", "reward weights", "entropy", "rates", "episode 4"):
            assert part in note
        config = json.loads((complete / "config.json").read_text())
        assert config["training"]["episodes"] == 6
        assert config["training"]["schedule_episodes"] == 4
        record = record_of(complete)
        assert (record["status"], record["episodes"]) == ("completed", 6)
        assert "next_config_sha256" not in record
        assert read_config(complete, read_record(complete)).training.episodes == 6
        assert record["resumed"][0]["command"][-3:] == ["--episodes=6", "--json", "--quiet"]

    def test_with_as_many_episodes_as_planned_changes_nothing(self, stopped, orchid):
        before = (stopped / "config.json").read_bytes()
        finished = orchid("train", "--resume", stopped, "--episodes=8", "--quiet")
        assert finished.code == 0
        assert "note: " not in finished.err
        assert (stopped / "config.json").read_bytes() == before

    def test_refuses_every_option_of_a_new_run_by_its_name(self, stopped, orchid):
        options = re.findall(r"^\W*(--[a-z-]+)", orchid("train", "--help").out, re.MULTILINE)
        allowed = {"--episodes", "--runs-dir", "--resume", "--track", "--json", "--quiet"}
        values = {
            "--set": "reset.kappa=0.1",
            "--distribution": "uniform",
            "--init": "random",
            "--objective": "pf",
            "--shares": "se",
            "--algorithm": "maddpg",
        }
        before, refused = fingerprint(stopped), set(options) - allowed - {"--debug", "--help"}
        for option in sorted(refused):
            text = option if option == "--no-rf" else f"{option}={values.get(option, '1')}"
            finished = orchid("train", "--resume", stopped, text)
            assert_is_an_error(finished, "--resume", option)
        assert {"--seed", "--worlds", "--kappa", "--preset", "--config", "--name"} < refused
        finished = orchid("train", "--resume", stopped, "--seed=1", "--no-rf")
        assert_is_an_error(finished, "--seed", "--no-rf")
        assert fingerprint(stopped) == before

    def test_of_an_unknown_run_is_an_error_that_names_what_is_near(self, stopped, runs_dir, orchid):
        near = stopped.name[:-1] + "!"
        finished = orchid("train", "--runs-dir", runs_dir, "--resume", near)
        assert_is_an_error(finished, near, stopped.name)
        finished = orchid("train", "--runs-dir", runs_dir, "--resume", runs_dir)
        assert_is_an_error(finished, "is not a run directory")
        earlier = next(runs_dir.glob("*-earlier-*"))  # whose run.json is no JSON
        assert_is_an_error(orchid("train", "--resume", earlier), str(earlier / "run.json"))

    def test_of_a_run_whose_configuration_was_changed_is_refused(self, stopped, orchid):
        config = stopped / "config.json"
        config.write_text(config.read_text().replace('"kappa": 0.5', '"kappa": 0.4'))
        before = fingerprint(stopped)
        finished = orchid("train", "--resume", stopped)
        assert_is_an_error(finished, str(config), "not the configuration")
        assert fingerprint(stopped) == before

    def test_shows_warnings_quietly_too(self, stopped, orchid):
        flipped(stopped / "checkpoints" / "3" / "weights.safetensors")
        finished = orchid("train", "--resume", stopped, "--quiet", "--json")
        assert finished.code == 0
        assert "warning: checkpoint 3 cannot be used" in finished.err
        assert json.loads(finished.out)["episodes"] == 8


class TestTensorBoard:
    @pytest.fixture
    def logged(self, runs_dir, monkeypatch):
        """A function that trains, stops, goes on and reads what TensorBoard would show."""

        def run(seconds_later: float) -> tuple[Path, list[int], list[int]]:
            from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
            from tensorboard.backend.event_processing.event_file_loader import (
                LegacyEventFileLoader,
            )

            moment = time.time()
            monkeypatch.setattr(time, "time", lambda: moment)
            config = case("mappo", checkpoint__every_episodes=3)
            run = RunDirectory.create(runs_dir, "lab", config, ["orchid", "train"])
            failing_at(monkeypatch, MAPPO, "train", 6)
            with pytest.raises(RunFailedError):
                training.train(
                    config, run, Audience(), [open_tracker("tensorboard", run.path, config)]
                )
            moment += seconds_later
            run = RunDirectory.reopen(run.path, config, ["orchid", "train"])
            tracker = open_tracker("tensorboard", run.path, config)
            training.train(config, run, Audience(), [tracker])
            events = EventAccumulator(str(run.path)).Reload()
            starts = [
                event.step
                for file in sorted(run.path.glob("events.*"))
                for event in LegacyEventFileLoader(str(file)).Load()
                if event.HasField("session_log") and event.session_log.status == 1
            ]
            shown = events.Scalars("episode/reward")
            values = [scalar.value for scalar in shown]
            assert values == pytest.approx(columns(run.path)["reward"], rel=1e-6)
            return run.path, [scalar.step for scalar in shown], starts

        return run

    def test_shows_each_episode_once_and_is_told_where_the_run_went_on(self, logged):
        # Five episodes are on record when it fails, three of them in a checkpoint.
        path, steps, starts = logged(seconds_later=60)
        assert starts == [4]
        assert steps == list(range(1, 9))
        assert len([*path.glob("events.*[0-9]")]) == 2

    def test_loses_nothing_where_time_and_process_number_are_the_same_again(self, logged):
        # The clock was set back, and in a container every process is number 1.
        _, steps, _ = logged(seconds_later=0)
        assert steps == list(range(1, 9))


class Process:
    """The command in a process of its own, which has nothing left to import."""

    def __init__(self, log: Path, *arguments: object) -> None:
        self.log = log
        self.code: int | None = None
        self.number = forked(lambda: self._run(arguments))

    def _run(self, arguments) -> None:
        with self.log.open("w", buffering=1) as file:
            sys.stdout = sys.stderr = file
            code = main([str(argument) for argument in arguments])
        os._exit(code)

    def has_ended(self) -> bool:
        if self.code is None:
            found, status = os.waitpid(self.number, os.WNOHANG)
            self.code = os.waitstatus_to_exitcode(status) if found else None
        return self.code is not None

    def signal(self, number: int) -> None:
        if not self.has_ended():
            os.kill(self.number, number)

    def until(self, condition, message="it has ended"):
        """Wait for something to be true; it fails if the process ends before."""
        deadline = time.monotonic() + GIVE_UP_AFTER_S
        while time.monotonic() < deadline:
            found = condition()
            if found:
                return found
            time.sleep(0.01)
        raise AssertionError(f"waited too long for this: {message}; {self.log.read_text()}")


class TestTwoProcesses:
    @pytest.fixture
    def start(self, tmp_path, plain_environment):
        started = []

        def start(*arguments) -> Process:
            log = tmp_path / f"{len(started)}.log"
            started.append(Process(log, *arguments, "--quiet"))
            return started[-1]

        yield start
        for process in started:
            process.signal(signal.SIGKILL)
            process.until(process.has_ended)

    @pytest.fixture
    def endless(self, start, runs_dir, new_runs):
        """A run that another process trains, with a checkpoint."""
        flags = ["--episodes=100000", "--set=checkpoint.every_episodes=3"]
        process = start("train", *TINY_FLAGS, *flags, "--runs-dir", runs_dir)

        def begun():
            return [path for path in new_runs() if (path / "checkpoints" / "3").is_dir()]

        [path] = process.until(begun, "a checkpoint")
        return process, path

    def test_cannot_resume_a_run_that_is_trained(self, endless, orchid):
        process, path = endless
        assert status_of(path, read_record(path)) == "running"
        assert_is_an_error(orchid("train", "--resume", path), path.name, "still running")
        with pytest.raises(InputError, match="another process"):
            RunDirectory.reopen(path, read_config(path, read_record(path)), ["orchid"])
        assert not process.has_ended()
        assert record_of(path)["resumed"] == []
        process.signal(signal.SIGKILL)
        process.until(process.has_ended)
        assert status_of(path, read_record(path)) == "died"

    def test_one_after_the_other_do_not_take_back_what_the_other_asked_for(self, runs_dir):
        # The second looked at the run before the first extended it, and imported torch meanwhile.
        path = begin(runs_dir, case("mappo", 4))
        seen = read_config(path, read_record(path))
        go_on(path, config=seen.extended_to(6))
        with suppress(InputError):
            RunDirectory.reopen(path, seen, ["orchid"])
        assert read_config(path, read_record(path)).training.episodes == 6

    def test_that_resume_one_run_at_once_are_one_that_does_and_others_that_say_so(
        self, endless, start
    ):
        first, path = endless
        first.signal(signal.SIGKILL)
        first.until(first.has_ended)
        kept = store_of(path).episodes()[0]
        three = [start("train", "--resume", path) for _ in range(3)]
        three[0].until(lambda: sum(one.has_ended() for one in three) == 2, "two have given up")
        [winner] = [one for one in three if not one.has_ended()]
        for loser in set(three) - {winner}:
            text = loser.log.read_text()
            assert loser.code == 2
            assert path.name in text
            assert "still running" in text or "another process" in text
            assert "Traceback" not in text
        assert status_of(path, read_record(path)) == "running"
        winner.until(lambda: store_of(path).episodes()[0] > kept, "it goes on")
        winner.signal(signal.SIGTERM)
        winner.until(winner.has_ended)
        assert winner.code == 130
        assert f"continue with: orchid train --resume {path}" in winner.log.read_text()
        record = record_of(path)
        assert record["status"] == "interrupted"
        assert len(record["resumed"]) == 1
        assert columns(path)["episode"] == list(range(1, record["episodes"] + 1))
