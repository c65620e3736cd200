"""Run directories that were never trained, for tests of the code that reads them."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from orchid_uav.experiments.runs.directory import RunDirectory
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
