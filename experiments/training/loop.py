"""One training run, from its configuration to a complete run directory."""

import math
import re
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.logger import Logger

from orchid_uav.agents.deployed_actor import policy_files
from orchid_uav.callbacks import (
    Checkpoints,
    EpisodeCallback,
    EpisodeLog,
    LearningRateDecay,
    ProgressSchedules,
    StoppedError,
)
from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError, RunFailedError
from orchid_uav.experiments.interruption import Interruption, interruption_requests
from orchid_uav.experiments.provenance import Status
from orchid_uav.experiments.runs.directory import Row, RunDirectory, final_metrics
from orchid_uav.experiments.training.builders import (
    build_model,
    build_reset_and_finetune,
    is_maddpg,
    schedule_episodes,
    torch_settings,
)
from orchid_uav.experiments.training.checkpoints import STATE_ERRORS, CheckpointStore
from orchid_uav.experiments.training.imitation import Imitation, build_dagger
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.experiments.training.state import Training
from orchid_uav.experiments.training.trackers import SafeTracker
from orchid_uav.notices import in_one_line, kind_and_reason
from orchid_uav.storage.files import write_json


class LearnedPolicy(NamedTuple):
    """What a learner leaves behind."""

    layers: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]]
    """(weight (out, in), bias (out,)) of every layer of the actor, in order."""
    log_std: NDArray[np.float32]
    """Log standard deviation (4,) of the noise used in training."""


WATCHED_FILE = "watched.json"
"""What the further callbacks of a run have seen, where it has any."""
_LONGEST_REASON = 300
_ESCAPE_CODE = re.compile(r"\x1b\[[0-9;]*m")  # numba colours its messages


@dataclass
class TrainingOutcome:
    """How a run ended."""

    run: RunDirectory
    status: Status = "running"
    seconds: float = 0.0
    """Duration of the learning loop, without imports and compilation, over all resumptions."""
    rows: list[Row] = field(default_factory=list)
    reset_episodes: list[int] = field(default_factory=list)
    is_restored: bool = True
    """False while a resumed run has not yet read back what it had achieved."""

    def finish(self, status: Status, error: str | None = None) -> None:
        """Record how the run ended, with its results if they are known."""
        self.status = status
        if self.is_restored:
            self.run.finish(status, self.rows, self.reset_episodes, self.seconds, error)
        else:
            self.run.give_up(status, error)

    def summary(self) -> dict[str, Any]:
        """The document of ``orchid train --json``."""
        return {
            "schema": 1,
            "run": self.run.id,
            "path": str(self.run.path.resolve()),
            "status": self.status,
            "episodes": len(self.rows),
            "seconds": round(self.seconds, 3),
            "reset_episodes": self.reset_episodes,
            "final": final_metrics(self.rows),
        }


def _compile(config: RunConfig) -> None:
    """Compile the simulator, or read it from numba's cache, before the time is measured."""
    world = WorldBatch(config.network_parameters)  # not of the run, whose seeds stay unused
    world.reset()
    world.step(np.zeros((1, world.uav_count, ACTION_SIZE)))


def train(
    config: RunConfig,
    run: RunDirectory,
    reporter: Reporter,
    trackers: Sequence[SafeTracker] = (),
    interruption: Interruption | None = None,
    watchers: Sequence[EpisodeCallback] = (),
) -> TrainingOutcome:
    """Train to the end, or until a signal asks to stop, and leave a complete run directory.

    A reopened run goes on from its latest undamaged checkpoint, or from the beginning if it has no
    checkpoint. Its results are those that it would have had without the interruption.

    Args:
        config: what to train.
        run: the run's directory, newly made or reopened.
        reporter: shows the run.
        trackers: exporters of its metrics.
        interruption: given by a caller that already handles signals; by default they are handled
            here.
        watchers: further callbacks, which act on each update before its checkpoint, and whose state
            is kept in checkpoints: a run that is resumed needs the same ones. Not for DAgger.

    Raises:
        RunFailedError: training could not go on; the run's status is "failed".
        KeyboardInterrupt: a second, urgent ctrl-C, which waits for no update and no checkpoint.
    """
    outcome = TrainingOutcome(run, is_restored=not run.is_resumed)
    try:
        with (
            torch_settings(config.training.threads),
            interruption_requests() if interruption is None else nullcontext(interruption) as noted,
        ):
            if config.training.algorithm == "dagger":
                learned = _imitate(config, outcome, reporter, trackers, noted)
            else:
                learned = _learn(config, outcome, reporter, trackers, noted, watchers)
            run.write_policy(_describe_policy(config, outcome, learned))
            if watchers:
                _write_watched(run, watchers)
            is_complete = len(outcome.rows) == config.training.episodes
            outcome.finish("completed" if is_complete else "interrupted")
    except (KeyboardInterrupt, SystemExit):
        with suppress(OSError):
            outcome.finish("interrupted")
        raise
    except Exception as error:
        reason = _in_one_line(error)
        # If a full disk caused the failure, it may not be possible to record it either.
        with suppress(OSError):
            outcome.finish("failed", reason)
        if not outcome.is_restored:
            raise RunFailedError(f"run {run.id} cannot go on: {reason}") from error
        latest = CheckpointStore(run.path, run.id, config.checkpoint.keep).episodes()
        kept = f"the checkpoint of episode {latest[0]} is kept" if latest else "no checkpoint yet"
        raise RunFailedError(
            f"run {run.id} failed after {len(outcome.rows)} episodes: {reason} ({kept})"
        ) from error
    finally:
        run.release()  # the lock is still held if the end could not be recorded
        for tracker in trackers:
            tracker.close(outcome.status)
    return outcome


def _write_watched(run: RunDirectory, watchers: Sequence[EpisodeCallback]) -> None:
    """Write what the watchers have seen, by the names of their classes."""
    watched = {type(watcher).__name__: watcher.state() for watcher in watchers}
    write_json(run.path / WATCHED_FILE, watched)


def _in_one_line(error: Exception) -> str:
    is_ours = isinstance(error, InputError | RunFailedError)  # their messages are meant for people
    plain = _ESCAPE_CODE.sub("", in_one_line(error) if is_ours else kind_and_reason(error))
    text = " ".join(plain.split())
    return text if len(text) <= _LONGEST_REASON else text[:_LONGEST_REASON] + " ..."


def _learn(
    config: RunConfig,
    outcome: TrainingOutcome,
    reporter: Reporter,
    trackers: Sequence[SafeTracker],
    interruption: Interruption,
    watchers: Sequence[EpisodeCallback],
) -> LearnedPolicy:
    """Build the learner, restore it if the run is resumed, and train it; update ``outcome``."""
    run = outcome.run
    _compile(config)
    # The worlds get no seed of their own: SB3 seeds them when it builds the model, together with
    # torch, NumPy and Python. A second seed here would only be overwritten.
    env = FleetVecEnv(config.network_parameters, config.training.worlds, seed=None)
    model = build_model(config, env)  # SB3 seeds torch and the worlds here, and nobody else does
    model.set_logger(Logger(folder=None, output_formats=[]))
    reset_and_finetune = build_reset_and_finetune(config)
    checkpoints = CheckpointStore(run.path, run.id, config.checkpoint.keep, run.record.former_ids)

    def take(rows: Sequence[Row]) -> None:
        run.append_episodes(rows)
        outcome.rows += rows
        if reset_and_finetune is not None:
            outcome.reset_episodes = reset_and_finetune.reset_episodes
        for row in rows:
            metrics = _metrics(row, model.logger.name_to_value)
            for tracker in trackers:
                tracker.log(int(row["episode"]), metrics)
        reporter.show(rows, outcome.reset_episodes)

    def save(episodes_done: int) -> None:
        checkpoints.save(episodes_done, training.state(), run.sync_episodes())

    # All of these act between an update and the next rollout, in this order. Rates fall before the
    # log, which records those in force after an episode. Weights and the entropy coefficient move
    # on behind it, since it records those of the update. The checkpoint comes last and holds all.
    callbacks: list[EpisodeCallback] = [
        LearningRateDecay(schedule_episodes(config), config.training.final_learning_rate_scale),
        EpisodeLog(take, reset_and_finetune),
        ProgressSchedules(
            schedule_episodes(config),
            None if is_maddpg(config) else config.ppo.entropy_coef,
        ),
        *watchers,
        Checkpoints(config.checkpoint.every_episodes, save, lambda: interruption.requested),
    ]
    if reset_and_finetune is not None:
        callbacks.insert(0, reset_and_finetune)  # so that the log sees the reset of its episode
    training = Training(model, env, callbacks)
    # Everything is built, and so has drawn its first random numbers, before a state is restored.
    if run.is_resumed:
        # Everything exists by now, so that the checkpoint overwrites what building it has set. The
        # generators come last in `Training.restore`: building and restoring may draw from them.
        _resume(training, checkpoints, outcome, reporter, trackers)
        if reset_and_finetune is not None:
            outcome.reset_episodes = reset_and_finetune.reset_episodes
    # SB3 counts the rows of all agents as timesteps.
    rows_per_episode = config.network.episode_slots * env.agents_per_world
    reporter.begin(run, config, outcome.rows, outcome.reset_episodes)
    started = time.perf_counter() - outcome.seconds
    try:
        with suppress(StoppedError):  # a requested stop; the checkpoint was saved before it
            model.learn(
                # SB3 adds what was flown before to the steps that it is asked for.
                config.training.episodes * rows_per_episode - model.num_timesteps,
                callback=list(callbacks),
                log_interval=None,  # type: ignore[arg-type]  # EpisodeLog takes the metrics instead
                reset_num_timesteps=False,
            )
    finally:
        outcome.seconds = time.perf_counter() - started
        reporter.end()
    return LearnedPolicy(model.policy.actor_layers(), model.exploration_log_std())


def _imitate(
    config: RunConfig,
    outcome: TrainingOutcome,
    reporter: Reporter,
    trackers: Sequence[SafeTracker],
    interruption: Interruption,
) -> LearnedPolicy:
    """As :func:`_learn`, for a learner that has no use for SB3."""
    run, episodes = outcome.run, config.training.episodes
    _compile(config)
    learner = build_dagger(config)
    checkpoints = CheckpointStore(run.path, run.id, config.checkpoint.keep, run.record.former_ids)
    training = Imitation(learner, checkpoints)
    if run.is_resumed:
        _resume(training, checkpoints, outcome, reporter, trackers)
    reporter.begin(run, config, outcome.rows, outcome.reset_episodes)
    started = time.perf_counter() - outcome.seconds
    try:
        while learner.iteration < episodes and not interruption.requested:
            row = training.iterate()
            run.append_episodes([row])
            outcome.rows.append(row)
            metrics = {name: value for name, value in row.items() if not math.isnan(value)}
            for tracker in trackers:
                tracker.log(learner.iteration, _metrics(metrics, {"train/loss": learner.loss}))
            reporter.show([row], outcome.reset_episodes)
            if learner.iteration % config.checkpoint.every_episodes == 0:
                training.save(run.sync_episodes())
        training.save(run.sync_episodes())
    finally:
        outcome.seconds = time.perf_counter() - started
        reporter.end()
    return LearnedPolicy(learner.actor_layers(), learner.exploration_log_std())


def _resume(
    training: Training | Imitation,
    checkpoints: CheckpointStore,
    outcome: TrainingOutcome,
    reporter: Reporter,
    trackers: Sequence[SafeTracker],
) -> None:
    """Go back to the latest checkpoint, and update ``outcome`` and the trackers."""
    outcome.rows = _go_back(training, checkpoints, outcome.run, reporter)
    outcome.seconds = outcome.run.record.seconds
    outcome.is_restored = True  # from here on, a failure is recorded with these results
    for tracker in trackers:
        tracker.resume(len(outcome.rows))


def _go_back(
    training: Training | Imitation,
    checkpoints: CheckpointStore,
    run: RunDirectory,
    reporter: Reporter,
) -> list[Row]:
    """Restore the latest undamaged checkpoint and return the rows of the episodes up to it."""
    for episode in checkpoints.episodes():
        try:
            state = checkpoints.read(episode, training.specs)
            training.restore(state)
            # Last, since this cuts off the part of the log that a later checkpoint would need.
            rows = run.keep_episodes(state.document["log_size"], state.document["log_sha256"])
            if len(rows) != episode:
                raise ValueError(f"its log has {len(rows)} episodes")
        except (InputError, *STATE_ERRORS) as error:
            reporter.warn(f"checkpoint {episode} cannot be used: {_in_one_line(error)}")
            continue
        checkpoints.forget_later_than(episode)
        return rows
    if checkpoints.episodes():
        raise RunFailedError(
            f"none of the checkpoints can be used; without {checkpoints.folder} it begins anew"
        )
    run.keep_episodes(0, "")
    return []


def _metrics(row: Row, learner: Mapping[str, Any]) -> dict[str, float]:
    episode = {f"episode/{name}": value for name, value in row.items() if name != "episode"}
    return episode | {name: float(value) for name, value in learner.items()}


def _describe_policy(
    config: RunConfig, outcome: TrainingOutcome, learned: LearnedPolicy
) -> dict[str, bytes]:
    return policy_files(
        learned.layers,
        learned.log_std,
        {
            "run": outcome.run.id,
            "algorithm": config.training.algorithm,
            "objective": config.reward.objective,
            "observation": config.uav.observation,
            "flight": config.uav.flight,
            "episodes": len(outcome.rows),
        },
    )
