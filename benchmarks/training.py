"""What a training run costs beyond the gradient steps themselves, and its memory.

"learning loop" is the loop as ``orchid train`` runs it, :func:`orchid_uav.experiments.training.
train` with the paper's configuration, episodes.csv, TensorBoard's events and the live display (on a
terminal that goes nowhere); its seconds begin after imports and compilation, as those of
``orchid train --json``.

"bare updates" is the least that any implementation in torch has to do for the same result: the
forward passes, losses, backward passes, clippings and optimizer steps of as many minibatches, on
the tensors of one stored rollout that lie ready; no environment, no rollout, no shuffling, no
figures. Before each episode's worth of updates the weights are put back, outside the time taken, so
that they never leave the region in which the rollout makes sense.

Both take turns in one process with one thread.
"""

import io
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import orchid_uav.experiments.training as loop
import torch
from orchid_uav.agents.mappo import MAPPO
from orchid_uav.agents.policies import CentralizedCriticPolicy
from orchid_uav.agents.rollout import MiniBatch
from orchid_uav.callbacks import EpisodeLog
from orchid_uav.cli.display import LiveReporter
from orchid_uav.envs import deployment
from orchid_uav.envs.vector import FleetVecEnv
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.run_directory import RunDirectory
from orchid_uav.experiments.trackers import SafeTracker, open_tracker
from rich.console import Console
from stable_baselines3.common.callbacks import CallbackList
from threadpoolctl import threadpool_limits
from torch.nn import functional

from benchmarks.measuring import alternate, arguments, record, report, settle_allocator

EPISODES = 30
DENORMAL_EPISODES = 60
MEMORY_EPISODES = 20
_HALF_LOG_TWO_PI = 0.5 * float(np.log(2.0 * np.pi))


def configuration(episodes: int, seed: int) -> RunConfig:
    """The paper's, but shorter."""
    paper = RunConfig().model_dump()
    paper["training"] |= {"episodes": episodes, "seed": seed}
    return RunConfig.model_validate(paper)


def learning_loop_s(episodes: int, repetition: int) -> float:
    """Seconds of the learning loop as users run it."""
    config = configuration(episodes, repetition)
    terminal = Console(file=io.StringIO(), force_terminal=True, width=120)
    with tempfile.TemporaryDirectory() as directory:
        run = RunDirectory.create(Path(directory), "benchmark", config, sys.argv)
        trackers = [open_tracker("tensorboard", run.path, config)]
        return loop.train(config, run, LiveReporter(terminal), trackers).seconds
