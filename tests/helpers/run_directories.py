"""Run directories that were never trained, for tests of the code that reads them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training.listeners import Tracker
from orchid_uav.experiments.training.trackers import open_tracker
from tests.helpers.processes import COLUMNS, WHOLE_NUMBERS, tiny_config

COMMAND = ["orchid", "train", "--name", "lab's"]
POLICY = {"policy.safetensors": b"weights" * 50, "policy.json": b"{}\n"}


def row(episode: int, **metrics: float) -> dict[str, float]:
    """An episode's row, whose values differ between columns and between episodes."""
    values = {name: place + episode / 7.0 for place, name in enumerate(COLUMNS)}
    whole = dict.fromkeys(WHOLE_NUMBERS, 0.0)
    return values | whole | {"episode": float(episode)} | metrics


def rows(count: int, **metrics: float) -> list[dict[str, float]]:
    return [row(episode, **metrics) for episode in range(1, count + 1)]


def make_run(
    runs_dir: Path,
    name: str = "lab",
    *,
    status: str = "completed",
    log: Sequence[dict[str, float]] | None = None,
    resets: Sequence[int] = (),
    config: dict[str, Any] | None = None,
    checkpoints: Sequence[int] = (),
    episodes: int = 3,
) -> Path:
    """Make a run with a given status; "died" is a run whose process is gone.

    Args:
        runs_dir: the directory in which it is made.
        name: the name of the run.
        status: how it ended.
        log: its rows; by default as many as planned.
        resets: the episodes of resets.
        config: values by "section.key", with two underscores instead of the dot.
        checkpoints: the episodes of checkpoints, with made-up content.
        episodes: the number of episodes planned.
    """
    run = RunDirectory.create(
        runs_dir, name, tiny_config(episodes=episodes, **(config or {})), COMMAND
    )
    log = rows(episodes) if log is None else log
    run.append_episodes(log)
    run.write_policy(POLICY)
    for episode in checkpoints:
        folder = run.path / "checkpoints" / str(episode)
        folder.mkdir(parents=True)
        (folder / "state.json").write_text(json.dumps({"episode": episode}))
        (folder / "weights.safetensors").write_bytes(b"w" * 1000)
    if status == "died":
        run._lock.release()
    else:
        run.finish(status, log, resets, seconds=1.5, error="NaN" if status == "failed" else None)
    return run.path


def begin_run(runs_dir: Path, **options: Any) -> RunDirectory:
    """Make a run that this process continues to write."""
    return RunDirectory.create(runs_dir, "live", tiny_config(**options), COMMAND)


def begun(runs_dir: Path, name: str, **values: Any) -> tuple[RunDirectory, RunConfig]:
    """A run that this process writes, and its configuration."""
    config = tiny_config(**values)
    return RunDirectory.create(runs_dir, name, config, COMMAND), config


def begin_export(name: str, run: RunDirectory, config: RunConfig) -> Tracker:
    return open_tracker(name, run.path, config)


def end_export(
    tracker: Tracker,
    run: RunDirectory,
    status: str,
    log: Sequence[dict[str, float]],
    known: int = 0,
    waits: bool = True,
) -> Path:
    """End a run as ``train`` does, with every row's reward in its tracker.

    Args:
        tracker: where it is exported to.
        run: the run.
        status: how it ends.
        log: all of its rows.
        known: how many of them another process logged.
        waits: whether the tracker is closed as well.
    """
    if run.is_resumed:
        run.keep_episodes(0, "")
        run.append_episodes(log[:known])
    run.append_episodes(log[known:])
    for one in log[known:]:
        tracker.log(int(one["episode"]), {"episode/reward": one["reward"]})
    run.write_policy(POLICY)
    run.finish(status, log, [], seconds=1.0)
    if waits:
        tracker.close(status)
    return run.path
