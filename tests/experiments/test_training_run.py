"""A training run: what it leaves behind, that it can be repeated, and how it ends otherwise."""

import itertools
import json
import math
import os
import random
import re
import signal
import statistics
import time
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from orchid_uav.agents import MAPPO, load_policy
from orchid_uav.agents.mappo.rollout_buffer import CentralizedRolloutBuffer
from orchid_uav.envs import WorldBatch
from orchid_uav.experiments import interruption
from orchid_uav.experiments.configuration import file_layer, merge
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training import loop as training
from orchid_uav.experiments.training import tracker_process, trackers
from orchid_uav.experiments.training.listeners import Reporter, Tracker
from orchid_uav.experiments.training.trackers import SafeTracker, open_tracker
from tests.helpers.processes import (
    COLUMNS,
    WHOLE_NUMBERS,
    cells,
    columns,
    files_of,
    record_of,
    signals_by_default,
    tiny_config,
)

GIVE_UP_AFTER_S = 60.0

ALWAYS = {"reset__window": 2, "reset__tolerance_jfi": 1e9, "reset__tolerance_reward": 1e9}
"""Both windows always look alike, so that Reset-and-Finetune acts as soon as they are full."""

COMPLETE = {
    *("run.json", "config.json", "episodes.csv", "policy.safetensors", "policy.json"),
    *("events.out.tfevents", "checkpoints", ".lock"),
}
STOPPING = [
    signal.Signals[name]
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGXCPU")
    if hasattr(signal, name)
]


class Watcher(Reporter):
    """A reporter that calls a function after each update."""

    def __init__(self, on_show=lambda watcher: None, on_begin=lambda: None):
        self.on_show, self.on_begin = on_show, on_begin
        self.episodes = 0
        self.ended = False

    def begin(self, run, config, rows, reset_episodes):
        self.on_begin()

    def warn(self, message):
        raise AssertionError(message)

    def show(self, rows, reset_episodes):
        self.episodes += len(rows)
        self.on_show(self)

    def end(self):
        self.ended = True


class Trail(Tracker):
    """A tracker that remembers what it is told."""

    def __init__(self):
        self.told = {}
        self.status = None

    def log(self, episode, figures):
        self.told[episode] = dict(figures)

    def close(self, status):
        self.status = status


@pytest.fixture
def train(runs_dir):
    """Makes a run and trains it; gives the outcome."""

    def run(config, reporter=None, name="lab", with_trackers=None):
        directory = RunDirectory.create(runs_dir, name, config, ["orchid", "train"])
        if with_trackers is None:
            with_trackers = [open_tracker("tensorboard", directory.path, config)]
        return training.train(config, directory, reporter or Watcher(), with_trackers)

    return run


@pytest.fixture
def models(monkeypatch):
    """The models of all runs made from here on."""
    made = []
    build = training.build_model

    def build_and_keep(config, env):
        made.append(build(config, env))
        return made[-1]

    monkeypatch.setattr(training, "build_model", build_and_keep)
    return made


@contextmanager
def signals_as_before():
    """Fail if the handlers of signals are others at the end than at the beginning."""
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    assert {number: signal.getsignal(number) for number in before} == before


def learned_files(directory: Path) -> tuple[bytes, bytes]:
    return (
        (directory / "episodes.csv").read_bytes(),
        (directory / "policy.safetensors").read_bytes(),
    )


@pytest.mark.parametrize("algorithm", ["mappo", "maddpg"])
def test_the_worlds_of_a_run_are_seeded_once(train, monkeypatch, algorithm):
    seeded, seed = [], WorldBatch.seed

    def note(world, value, *rest):
        if value is not None:
            seeded.append((world.world_count, value))
        seed(world, value, *rest)

    monkeypatch.setattr(WorldBatch, "seed", note)
    train(tiny_config(4, training__seed=5, training__worlds=2, training__algorithm=algorithm))
    assert seeded == [(2, 5)]


class TestDirectory:
    def test_is_complete_and_holds_nothing_else(self, train):
        outcome = train(tiny_config(3))
        assert outcome.status == "completed"
        assert files_of(outcome.run.path) == COMPLETE

    def test_log_has_exactly_the_promised_columns_and_a_row_an_episode(self, train):
        path = train(tiny_config(4)).run.path
        header, *rows = cells(path)
        assert header == COLUMNS
        assert [row[0] for row in rows] == ["1", "2", "3", "4"]

    def test_log_has_whole_numbers_where_things_are_counted_and_finite_ones_elsewhere(self, train):
        header, *rows = cells(train(tiny_config(4)).run.path)
        for row in rows:
            for name, text in zip(header, row, strict=True):
                assert bool(re.fullmatch(r"\d+", text)) == (name in WHOLE_NUMBERS), f"{name} {text}"
                assert math.isfinite(float(text))

    def test_a_reporter_that_is_no_display_tells_nothing_but_warnings(self, train, capfd):
        silent = Reporter()
        assert train(tiny_config(2), reporter=silent).status == "completed"
        assert capfd.readouterr() == ("", "")
        silent.warn("the disk is nearly full")
        assert capfd.readouterr() == ("", "warning: the disk is nearly full\n")

    def test_log_lies_within_what_its_columns_can_be(self, train):
        logged = columns(train(tiny_config(5)).run.path)
        for name in ("coverage", "rate_jfi", "load_jfi"):
            assert all(0.0 <= value <= 1.0 for value in logged[name])
        for name in ("worst_rate_bps", "sum_rate_bps", "energy_efficiency_bit_per_joule"):
            assert all(value >= 0.0 for value in logged[name])
        for worst, total in zip(logged["worst_rate_bps"], logged["sum_rate_bps"], strict=True):
            assert worst <= total
        # Two UAVs take between the least propulsion power and far less than ten hovers.
        assert all(2 * 190.0 < power < 20 * 394.0 for power in logged["propulsion_power_w"])
        # Ten slots, one pair, two UAVs.
        assert max(logged["collisions"]) <= 10
        assert max(logged["boundary_violations"]) <= 20

    def test_record_at_the_end(self, train):
        outcome = train(tiny_config(3, training__seed=5))
        record = record_of(outcome.run.path)
        assert record["status"] == "completed"
        assert record["episodes"] == 3
        assert record["error"] is None
        assert record["finished"] >= record["started"]
        assert record["seconds"] == round(outcome.seconds, 3) > 0

    def test_final_figures_are_means_of_the_last_fifty_rows(self, train):
        outcome = train(tiny_config(55, reset__enabled=False))
        logged = columns(outcome.run.path)
        assert len(logged["episode"]) == 55
        means = {name: statistics.fmean(logged[name][-50:]) for name in COLUMNS[1:]}
        assert record_of(outcome.run.path)["final"] == pytest.approx(means, rel=1e-12)
        assert outcome.summary()["final"] == record_of(outcome.run.path)["final"]

    def test_summary_holds_what_other_programs_rely_on(self, train):
        outcome = train(tiny_config(5, **ALWAYS))
        summary = json.loads(json.dumps(outcome.summary(), allow_nan=False))
        assert summary["schema"] == 1
        assert summary["run"] == outcome.run.id
        assert Path(summary["path"]) == outcome.run.path
        assert summary["episodes"] == 5
        assert summary["seconds"] > 0
        assert summary["reset_episodes"] == [4]
        assert list(summary["final"]) == COLUMNS[1:]

    def test_configuration_in_it_gives_the_same_run_again(self, train):
        first = train(tiny_config(4, training__seed=3, reward__objective="pf")).run.path
        config, _ = merge([file_layer(first / "config.json")])
        assert learned_files(train(config).run.path) == learned_files(first)

    def test_policy_flies_as_the_learner_does(self, train, models):
        outcome = train(tiny_config(3))
        policy = load_policy(outcome.run.path)
        observations = np.random.default_rng(0).random((5, 16), dtype=np.float32)
        with torch.no_grad():
            expected = models[0].policy.action_mean(torch.from_numpy(observations)).numpy()
        np.testing.assert_allclose(policy.act(observations), expected, rtol=1e-5, atol=1e-6)
        assert policy.description.run == outcome.run.id
        assert policy.description.episodes == 3

    def test_tensorboard_shows_every_episode(self, train):
        from tensorboard.backend.event_processing.event_file_loader import LegacyEventFileLoader

        path = train(tiny_config(4)).run.path
        [events] = path.glob("events.out.tfevents.*[0-9]")
        shown = {
            (value.tag, event.step): value.simple_value
            for event in LegacyEventFileLoader(str(events)).Load()
            for value in event.summary.value
        }
        for name, values in columns(path).items():
            for episode, value in enumerate(values, start=1):
                if name != "episode":
                    assert shown[f"episode/{name}", episode] == pytest.approx(value, rel=1e-6)
        assert ("train/value_loss", 4) in shown

    def test_trackers_are_told_every_episode_and_how_it_ended(self, train):
        trail = Trail()
        path = train(tiny_config(3), with_trackers=[SafeTracker("trail", trail)]).run.path
        assert sorted(trail.told) == [1, 2, 3]
        assert trail.status == "completed"
        logged = columns(path)
        for episode, figures in trail.told.items():
            for name in COLUMNS[1:]:
                assert figures[f"episode/{name}"] == logged[name][episode - 1]


class TestRepeatability:
    def test_the_same_seed_gives_the_same_bits_another_seed_others(self, train):
        first = learned_files(train(tiny_config(4, training__seed=1)).run.path)
        # Whatever else draws random numbers in the process, and whatever the run is called.
        torch.rand(3), np.random.rand(3), random.random()  # noqa: NPY002
        again = learned_files(train(tiny_config(4, training__seed=1), name="again").run.path)
        other = learned_files(train(tiny_config(4, training__seed=2)).run.path)
        assert again == first
        assert other[0] != first[0]
        assert other[1] != first[1]

    def test_with_several_worlds_too(self, train):
        config = tiny_config(5, training__worlds=2)
        assert learned_files(train(config).run.path) == learned_files(train(config).run.path)

    def test_what_is_shown_and_tracked_does_not_matter(self, train):
        config = tiny_config(3)
        tracked = learned_files(train(config).run.path)
        assert learned_files(train(config, with_trackers=[]).run.path) == tracked


class TestWorlds:
    @pytest.mark.parametrize(("episodes", "worlds"), [(7, 3), (6, 3), (2, 3)])
    def test_episodes_and_samples_are_as_many_as_with_one_world(
        self, train, models, monkeypatch, episodes, worlds
    ):
        samples = []
        batches_of = CentralizedRolloutBuffer.get

        def count(buffer, batch_size, unit):
            for batch in batches_of(buffer, batch_size, unit):
                samples[-1] += len(batch.actions)
                yield batch

        monkeypatch.setattr(CentralizedRolloutBuffer, "get", count)
        for count_of_worlds in (1, worlds):
            samples.append(0)
            outcome = train(tiny_config(episodes, training__worlds=count_of_worlds))
            assert outcome.status == "completed"
            assert columns(outcome.run.path)["episode"] == list(range(1, episodes + 1))
            assert record_of(outcome.run.path)["episodes"] == episodes
        slots, uavs, epochs = 10, 2, 4
        assert samples == [episodes * slots * uavs * epochs] * 2
        assert [model.num_timesteps for model in models] == [episodes * slots * uavs] * 2

    def test_world_zero_flies_the_topologies_of_a_single_one(self, train):
        # An untrained policy's first episode: the same users, another exploration noise.
        one, three = (
            columns(
                train(tiny_config(3, training__worlds=worlds, ppo__log_std_init=-20.0)).run.path
            )
            for worlds in (1, 3)
        )
        assert three["rate_jfi"][0] == pytest.approx(one["rate_jfi"][0], rel=1e-3)
        assert len(set(three["rate_jfi"])) == 3


class TestResetAndFinetune:
    def test_up_to_the_trigger_a_run_without_it_is_the_same(self, train):
        with_it = train(tiny_config(8, **ALWAYS)).run.path
        without = train(tiny_config(8, **ALWAYS, reset__enabled=False)).run.path
        assert cells(with_it)[:4] == cells(without)[:4]
        marks = {"actor_lr", "critic_lr", "reset"}
        logged, plain = columns(with_it), columns(without)
        for name in set(COLUMNS) - marks:
            # The reset follows episode 4; episode 5 still flies with the weights of that moment.
            assert logged[name][:5] == plain[name][:5], name
        assert logged["reward"][5:] != plain["reward"][5:]
        assert plain["reset"] == [0] * 8
        assert set(plain["actor_lr"]) == {1e-4}
        assert learned_files(with_it)[1] != learned_files(without)[1]

    @pytest.mark.parametrize("kappa", [0.5, 0.1, 0.3])
    def test_rates_after_it_are_exactly_kappa_times_the_first(self, train, kappa):
        outcome = train(tiny_config(6, **ALWAYS, reset__kappa=kappa))
        logged = columns(outcome.run.path)
        assert logged["reset"] == [0, 0, 0, 1, 0, 0]
        assert logged["actor_lr"] == [1e-4] * 3 + [kappa * 1e-4] * 3
        assert logged["critic_lr"] == [1e-3] * 3 + [kappa * 1e-3] * 3
        assert record_of(outcome.run.path)["reset_episodes"] == [4]

    def test_each_further_one_needs_two_fresh_windows_and_rates_stay_above_a_hundredth(
        self, train, models
    ):
        values = ALWAYS | {"reset__kappa": 0.2, "reset__max_resets": 3}
        outcome = train(tiny_config(14, **values))
        logged = columns(outcome.run.path)
        assert record_of(outcome.run.path)["reset_episodes"] == [4, 8, 12]
        assert [episode for episode, reset in enumerate(logged["reset"], 1) if reset] == [4, 8, 12]
        scales = [1.0] * 3 + [0.2] * 4 + [0.04] * 4 + [0.01] * 3
        assert logged["actor_lr"] == pytest.approx([1e-4 * scale for scale in scales], rel=1e-12)
        assert logged["critic_lr"] == pytest.approx([1e-3 * scale for scale in scales], rel=1e-12)
        used = [group["lr"] for group in models[0].policy.optimizer.param_groups]
        assert used == [logged["actor_lr"][-1], logged["critic_lr"][-1]]

    def test_windows_that_differ_set_off_nothing(self, train):
        strict = {"reset__tolerance_jfi": 1e-12, "reset__tolerance_reward": 1e-12}
        logged = columns(train(tiny_config(8, **ALWAYS | strict)).run.path)
        assert logged["reset"] == [0] * 8

    def test_entropy_coefficient_falls_linearly_whatever_happens(self, train):
        logged = columns(train(tiny_config(5, **ALWAYS)).run.path)
        expected = [0.01 * (1 - done / 5) for done in range(5)]
        assert logged["entropy_coef"] == pytest.approx(expected, rel=1e-12)


class TestInterruption:
    @pytest.fixture(autouse=True)
    def _heeded(self):
        with signals_by_default():
            yield

    @pytest.mark.parametrize("number", STOPPING)
    def test_keeps_what_is_done(self, train, number):
        def interrupt(watcher):
            if watcher.episodes == 3:
                signal.raise_signal(number)

        watcher = Watcher(interrupt)
        with signals_as_before():
            outcome = train(tiny_config(9), watcher)
        assert outcome.status == "interrupted"
        assert watcher.ended
        path = outcome.run.path
        assert files_of(path) == COMPLETE
        record = record_of(path)
        assert (record["status"], record["episodes"]) == ("interrupted", 3)
        assert record["error"] is None
        assert record["final"] == pytest.approx(
            {name: statistics.fmean(columns(path)[name]) for name in COLUMNS[1:]}, rel=1e-12
        )
        assert load_policy(path).description.episodes == 3
        assert outcome.summary()["episodes"] == 3

    def test_changes_nothing_about_what_came_before(self, train):
        def interrupt(watcher):
            if watcher.episodes == 4:
                signal.raise_signal(signal.SIGINT)

        whole = cells(train(tiny_config(6)).run.path)
        part = cells(train(tiny_config(6), Watcher(interrupt)).run.path)
        assert part == whole[:5]

    def test_before_the_first_episode_leaves_a_complete_directory(self, train):
        watcher = Watcher(on_begin=lambda: signal.raise_signal(signal.SIGINT))
        outcome = train(tiny_config(9), watcher)
        assert outcome.status == "interrupted"
        assert files_of(outcome.run.path) == COMPLETE
        assert record_of(outcome.run.path)["final"] == {}
        assert len(cells(outcome.run.path)) == 1
        assert load_policy(outcome.run.path).act(np.zeros((1, 16))).shape == (1, 4)

    def test_with_the_last_episode_comes_too_late(self, train):
        def interrupt(watcher):
            if watcher.episodes == 3:
                signal.raise_signal(signal.SIGINT)

        assert train(tiny_config(3), Watcher(interrupt)).status == "completed"

    @pytest.mark.parametrize(
        ("owner", "step"), [(training, "build_model"), (RunDirectory, "write_policy")]
    )
    def test_while_the_run_is_set_up_or_written_down_is_told_by_the_record(
        self, train, new_runs, monkeypatch, owner, step
    ):
        original = getattr(owner, step)

        def interrupted(*arguments):
            signal.raise_signal(signal.SIGINT)
            return original(*arguments)

        monkeypatch.setattr(owner, step, interrupted)
        with signals_as_before(), suppress(KeyboardInterrupt):
            train(tiny_config(3))
        [path] = new_runs()
        assert record_of(path)["status"] in {"interrupted", "completed"}

    @pytest.mark.parametrize(
        "numbers",
        # By shell and kernel, by a batch system and its steps, by a hand that trembles.
        [(number, number) for number in STOPPING]
        + [(signal.SIGTERM, signal.SIGINT), (STOPPING[-1], signal.SIGTERM, signal.SIGTERM)],
    )
    def test_told_several_times_at_once_is_one(self, train, numbers):
        def interrupt(watcher):
            if watcher.episodes == 3:
                for number in numbers:
                    signal.raise_signal(number)

        outcome = train(tiny_config(9), Watcher(interrupt))
        assert outcome.status == "interrupted"
        assert (outcome.run.path / "checkpoints" / "3").is_dir()

    @pytest.fixture
    def later(self, monkeypatch):
        """Every signal comes more than a second after the one before."""
        moments = itertools.count(1000.0, 1.1)
        monkeypatch.setattr(interruption, "time", SimpleNamespace(monotonic=moments.__next__))

    @pytest.mark.parametrize("first", STOPPING)
    def test_by_a_person_who_insists_ends_at_once_and_is_told_by_the_record(
        self, train, new_runs, later, first
    ):
        def interrupt(watcher):
            if watcher.episodes == 3:
                signal.raise_signal(first)
                signal.raise_signal(signal.SIGINT)
                raise AssertionError("it goes on")

        with signals_as_before(), pytest.raises(KeyboardInterrupt):
            train(tiny_config(9), Watcher(interrupt))
        [path] = new_runs()
        record = record_of(path)
        assert record["status"] == "interrupted"
        assert columns(path)["episode"] == list(range(1, record["episodes"] + 1)) == [1, 2, 3]
        assert not (path / "checkpoints" / "3").exists()

    @pytest.mark.parametrize("second", STOPPING[1:])
    def test_by_a_machine_that_insists_still_saves(self, train, later, second):
        def interrupt(watcher):
            if watcher.episodes == 3:
                for number in (signal.SIGINT, second, second):
                    signal.raise_signal(number)

        outcome = train(tiny_config(9), Watcher(interrupt))
        assert (outcome.run.path / "checkpoints" / "3").is_dir()

    @pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="the signal is POSIX")
    def test_leaves_a_batch_programs_own_signal_to_it(self, train):
        told = []
        before = signal.signal(signal.SIGUSR1, lambda *_: told.append(1))
        try:
            outcome = train(
                tiny_config(2), Watcher(lambda watcher: signal.raise_signal(signal.SIGUSR1))
            )
        finally:
            signal.signal(signal.SIGUSR1, before)
        assert outcome.status == "completed"
        assert told == [1, 1]

    def test_a_signal_that_the_caller_ignores_stays_ignored(self, train):
        # nohup and shells' background jobs rely on it.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            outcome = train(
                tiny_config(3), Watcher(lambda watcher: signal.raise_signal(signal.SIGINT))
            )
        finally:
            signal.signal(signal.SIGINT, before)
        assert outcome.status == "completed"

    def test_outside_the_main_thread_runs_are_trained_all_the_same(self, train):
        with ThreadPoolExecutor(1) as pool:
            assert pool.submit(train, tiny_config(2)).result().status == "completed"


class TestFailure:
    @pytest.fixture
    def failing_update(self, monkeypatch):
        """The third update raises."""
        update, updates = MAPPO.train, itertools.count(1)

        def fail(model):
            if next(updates) == 3:
                raise ArithmeticError("the loss is\nnot\na\nnumber")
            update(model)

        monkeypatch.setattr(MAPPO, "train", fail)

    def test_while_learning_is_told_with_its_reason(self, train, new_runs, failing_update):
        watcher, trail = Watcher(), Trail()
        with signals_as_before(), pytest.raises(RunFailedError) as error:
            train(tiny_config(5), watcher, with_trackers=[SafeTracker("trail", trail)])
        [path] = new_runs()
        record = record_of(path)
        assert record["status"] == trail.status == "failed"
        assert record["error"].startswith("ArithmeticError: the loss is")
        assert record["episodes"] == 2
        assert columns(path)["episode"] == [1, 2]
        assert watcher.ended
        assert path.name in str(error.value)
        assert "the loss is" in str(error.value)

    def test_is_told_in_two_lines_at_most(self, train, failing_update):
        with pytest.raises(RunFailedError) as error:
            train(tiny_config(5))
        assert len(str(error.value).splitlines()) <= 2

    def test_of_a_policy_that_diverges_is_told_in_two_lines_at_most(self, train, new_runs):
        with pytest.raises(RunFailedError) as error:
            train(tiny_config(5, ppo__actor_learning_rate=1e30))
        assert len(str(error.value).splitlines()) <= 2
        assert record_of(new_runs()[0])["status"] == "failed"

    def test_before_learning_begins_is_told_too(self, train, new_runs, monkeypatch):
        def fail(config, env):
            raise MemoryError("cannot allocate 1 TiB")

        monkeypatch.setattr(training, "build_model", fail)
        with pytest.raises(RunFailedError, match="cannot allocate 1 TiB"):
            train(tiny_config(2))
        assert record_of(new_runs()[0])["status"] == "failed"

    def test_to_write_an_episode_counts_only_those_that_were_written(
        self, train, new_runs, monkeypatch
    ):
        append = RunDirectory.append_episodes

        def fail_at_the_third(run, rows):
            rows = list(rows)
            if rows and rows[0]["episode"] == 3:
                raise OSError(28, "No space left on device")
            append(run, rows)

        monkeypatch.setattr(RunDirectory, "append_episodes", fail_at_the_third)
        with pytest.raises(RunFailedError, match="No space left on device") as error:
            train(tiny_config(5))
        [path] = new_runs()
        assert "after 2 episodes" in str(error.value)
        assert record_of(path)["episodes"] == 2
        assert columns(path)["episode"] == [1, 2]

    @pytest.mark.parametrize("error", [SystemExit(1), BrokenPipeError(32, "Broken pipe")])
    def test_to_show_a_run_does_not_leave_it_running(self, train, new_runs, error):
        # rich turns a closed pipe, as of "orchid train | head", into SystemExit.
        def fail(watcher):
            if watcher.episodes == 2:
                raise error

        with suppress(RunFailedError, SystemExit):
            train(tiny_config(4), Watcher(fail))
        [path] = new_runs()
        record = record_of(path)
        assert record["status"] != "running"
        assert record["episodes"] == len(cells(path)) - 1 >= 2


class TestTrackersThatFail:
    class Failing(Trail):
        def __init__(self, at):
            super().__init__()
            self.at = at

        def log(self, episode, figures):
            super().log(episode, figures)
            if self.at == episode:
                raise ConnectionError("the server is gone")

        def close(self, status):
            super().close(status)
            if self.at == "close":
                raise ConnectionError("the server is gone")

    @pytest.mark.parametrize("at", [1, 2, "close"])
    @pytest.mark.parametrize("warnings_are", ["default", "error"])
    def test_stop_no_training_and_no_other_tracker(self, train, at, warnings_are):
        failing, trail = self.Failing(at), Trail()
        with warnings.catch_warnings(record=True):
            warnings.simplefilter(warnings_are)
            outcome = train(
                tiny_config(4),
                with_trackers=[SafeTracker("failing", failing), SafeTracker("trail", trail)],
            )
        assert outcome.status == record_of(outcome.run.path)["status"] == "completed"
        assert len(cells(outcome.run.path)) == 5
        assert sorted(trail.told) == [1, 2, 3, 4]
        assert trail.status == "completed"
        # After its error a tracker is left alone: no second of waiting for a server per episode.
        assert sorted(failing.told) == [1, 2, 3, 4][: at if at != "close" else None]

    def test_the_user_hears_of_it_once(self, train, capsys):
        class AlwaysFailing(Trail):
            def log(self, episode, figures):
                raise ConnectionError("the server is gone")

        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            train(tiny_config(3), with_trackers=[SafeTracker("mlflow", AlwaysFailing())])
        told = capsys.readouterr().err + "".join(f"{warning.message}\n" for warning in caught)
        [line] = [line for line in told.splitlines() if "the server is gone" in line]
        assert "mlflow" in line

    def test_that_cannot_be_opened_stop_nothing_either(self, train, monkeypatch):
        def fail(tracker, directory, config):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(trackers.TensorBoardTracker, "__init__", fail)
        with warnings.catch_warnings(record=True):
            warnings.simplefilter("always")
            outcome = train(tiny_config(2))
        assert outcome.status == "completed"
        assert files_of(outcome.run.path) == COMPLETE - {"events.out.tfevents"}


FAKE_MLFLOW = """
import os, time
from pathlib import Path
from types import SimpleNamespace
here = Path(os.environ["FAKE_MLFLOW"])
behaviour = (here / "behaviour").read_text()
def note(text):
    with (here / "noted").open("a") as file:
        file.write(text + "\\n")
class MlflowClient:
    def get_experiment_by_name(self, name):
        if behaviour == "hangs":
            note(f"process {os.getpid()}")
            time.sleep(600)
        return SimpleNamespace(experiment_id="1")
    def search_runs(self, experiments, query, max_results):
        return []
def set_tracking_uri(uri):
    pass
def start_run(run_name, experiment_id, tags):
    assert (experiment_id, tags) == ("1", {"orchid.run": run_name})
    print(f"View run {run_name}")
def log_params(parameters):
    note(f"params {parameters['training.episodes']}")
def log_metrics(figures, step):
    if behaviour == "fails" and step == 2:
        raise ConnectionError("the server is gone")
    if behaviour == "slows" and step == 2:
        time.sleep(600)
    names = ("episode/reward", "final/reward")
    note(f"{step} {next(figures[name] for name in names if name in figures)!r}")
def log_artifact(path):
    note(Path(path).name)
def end_run(status):
    note(status)
"""


class TestTrackersOfOthers:
    """MLflow, in whose place a module of ours stands."""

    @pytest.fixture
    def mlflow(self, tmp_path, monkeypatch):
        """Calls train with an MLflow that behaves in a way; they give what it was told."""
        folder = tmp_path / "fake"
        folder.mkdir()
        (folder / "mlflow.py").write_text(FAKE_MLFLOW)
        monkeypatch.setenv("FAKE_MLFLOW", str(folder))
        monkeypatch.setenv("PYTHONPATH", str(folder))

        def run(train, behaviour: str) -> tuple[Path, list[str]]:
            (folder / "behaviour").write_text(behaviour)
            config = tiny_config(4)
            run = RunDirectory.create(tmp_path / "runs", "lab", config, ["orchid"])
            tracker = open_tracker("mlflow", run.path, config)
            if behaviour != "works":
                deadline = time.monotonic() + GIVE_UP_AFTER_S
                while not (folder / "noted").exists() and time.monotonic() < deadline:
                    time.sleep(0.01)  # until it stands still
            outcome = training.train(config, run, Watcher(), [tracker])
            assert outcome.status == "completed"
            return run.path, (folder / "noted").read_text().splitlines()

        return run

    def test_are_told_everything_and_are_heard(self, train, mlflow, monkeypatch, capsys):
        monkeypatch.setattr(tracker_process, "_SECONDS_AT_THE_END", GIVE_UP_AFTER_S)
        path, noted = mlflow(train, "works")
        rewards = columns(path)["reward"]
        assert noted[0] == "params 4"
        assert noted[1:5] == [f"{step} {reward!r}" for step, reward in enumerate(rewards, 1)]
        assert noted[5] == f"4 {record_of(path)['final']['reward']!r}"
        files = ["run.json", "config.json", "episodes.csv", "policy.safetensors", "policy.json"]
        assert noted[6:-1] == files
        assert noted[-1] == "FINISHED"
        assert capsys.readouterr().err == f"View run {path.name}\n"

    @pytest.mark.parametrize(
        ("behaviour", "exported"),
        [("hangs", "nothing exported"), ("slows", "exported up to episode 1, no later ones")],
    )
    def test_that_stand_still_are_switched_off_and_change_nothing(
        self, train, mlflow, monkeypatch, capsys, behaviour, exported
    ):
        monkeypatch.setattr(tracker_process, "_SECONDS_AT_THE_END", 0.5)
        path, noted = mlflow(train, behaviour)
        [line] = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
        told = r"warning: mlflow is off for the rest of the run: (not done 0.5 s|no answer in) "
        assert re.match(told, line)
        assert line.endswith(f"({exported})")
        assert learned_files(path) == learned_files(train(tiny_config(4)).run.path)
        if behaviour == "hangs":
            with pytest.raises(ProcessLookupError):
                os.kill(int(noted[0].removeprefix("process ")), 0)

    def test_that_fail_are_switched_off_with_the_reason(self, train, mlflow, monkeypatch, capsys):
        monkeypatch.setattr(tracker_process, "_SECONDS_AT_THE_END", GIVE_UP_AFTER_S)
        mlflow(train, "fails")
        [line] = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
        assert line == (
            "warning: mlflow is off for the rest of the run: the server is gone "
            "(exported up to episode 1, no later ones)"
        )
