"""The time of a training run compared with its gradient steps alone, and its memory.

"learning loop" is the loop as ``orchid train`` runs it: the paper's configuration, episodes.csv,
TensorBoard's events and the live display (on a terminal whose output is discarded). Its time begins
after imports and compilation, as in ``orchid train --json``.

"bare updates" is the least that an implementation in torch has to do for as many gradient steps:
forward passes, losses, backward passes, clipping and optimizer steps, on prepared minibatches of
one stored rollout. There is no environment, no rollout, no shuffling and no logging. Before the
updates of each episode the weights are restored, outside the measured time, so that the rollout
still belongs to them. "plain updates" are the same with torch's own ``Sequential``, which leaves
out what :class:`orchid_uav.agents.networks.Perceptron` spares.

Both units of minibatches are measured. All cases take turns in one process with one thread.
"""

import io
import os
import subprocess
import sys
import tempfile
import time
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import Logger
from threadpoolctl import threadpool_limits
from torch import nn
from torch.nn import functional

from benchmarks.measuring import Case, alternate, arguments, ratio, report
from benchmarks.stopwatch import Stopwatch
from orchid_uav.agents.mappo.mappo import MAPPO
from orchid_uav.agents.mappo.policy import CentralizedCriticPolicy
from orchid_uav.agents.mappo.rollout_buffer import MiniBatch
from orchid_uav.callbacks import EpisodeLog
from orchid_uav.cli.progress.training import LiveReporter
from orchid_uav.envs import deployment
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.envs.world import WorldBatch
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import RunDirectory
from orchid_uav.experiments.training import loop
from orchid_uav.experiments.training.trackers import SafeTracker, open_tracker
from studies.recording import record

EPISODES = 30
UNITS = ("rows", "slots")
UNIT = "rows"
"""Of what is measured for one unit alone."""
DENORMAL_EPISODES, DENORMAL_LAST = 80, 20
MEMORY_EPISODES = 20
_HALF_LOG_TWO_PI = 0.5 * float(np.log(2.0 * np.pi))

WATCHED: dict[str, tuple[Any, str]] = {
    "rollout": (MAPPO, "collect_rollouts"),
    "update": (MAPPO, "train"),
    "evaluate": (MAPPO, "_evaluate_rollout"),
    "actor": (CentralizedCriticPolicy, "action_mean"),
    "step": (FleetVecEnv, "step"),
    "reset": (WorldBatch, "reset"),
    "kmeans": (deployment, "gbs_aware_kmeans"),
    "callbacks": (CallbackList, "on_step"),
    "log": (EpisodeLog, "_on_episodes"),
    "csv": (RunDirectory, "append_episodes"),
    "tensorboard": (SafeTracker, "log"),
    "display": (LiveReporter, "show"),
}
SHARES = {
    "update": "updates of actor and critic",
    "evaluate": "rollout: values, log probabilities, advantages",
    "tensorboard": "log: TensorBoard",
    "csv": "log: episodes.csv",
    "display": "log: display",
    "log": "log: rest",
    "kmeans": "rollout: reset, K-Means",
    "reset": "rollout: reset, rest",
    "step": "rollout: simulator",
    "actor": "rollout: actor",
    "callbacks": "rollout: callbacks at every step",
    "rollout": "rollout: rest",
}
"""Titles of the time under each label; of several labels in a path the first here counts."""
REST = "rest of the loop"


def configuration(unit: str, episodes: int, seed: int) -> RunConfig:
    """The paper's configuration with fewer episodes, and minibatches of a unit."""
    paper = RunConfig().model_dump()
    paper["training"] |= {"episodes": episodes, "seed": seed}
    paper["ppo"]["minibatch"] = unit
    return RunConfig.model_validate(paper)


def learning_loop_s(unit: str, episodes: int, repetition: int) -> float:
    """Seconds of the learning loop as users run it."""
    config = configuration(unit, episodes, repetition)
    terminal = Console(file=io.StringIO(), force_terminal=True, width=120)
    with tempfile.TemporaryDirectory() as directory:
        run = RunDirectory.create(Path(directory), "benchmark", config, sys.argv)
        trackers = [open_tracker("tensorboard", run.path, config)]
        outcome = loop.train(config, run, LiveReporter(terminal), trackers)
    if outcome.status != "completed":
        raise RuntimeError(f"the run is {outcome.status}, so its time cannot be used")
    return outcome.seconds


class BareUpdates:
    """Gradient steps on one stored rollout, and nothing else.

    Args:
        unit: of minibatches.
        plain: with torch's own way through the layers.
    """

    def __init__(self, unit: str, plain: bool = False) -> None:
        config = configuration(unit, episodes=1, seed=0)
        env = FleetVecEnv(config.network_parameters, seed=None)
        model = loop.build_model(config, env)
        model.set_logger(Logger(folder=None, output_formats=[]))
        self._policy = model.policy
        self._weights = deepcopy(self._policy.state_dict())
        model.learn(config.network.episode_slots * env.num_envs)
        self._ppo = config.ppo
        self._through = nn.Sequential.forward if plain else nn.Module.__call__
        self._minibatches = [
            batch
            for _ in range(config.ppo.epochs)
            for batch in model.rollout_buffer.get(config.ppo.batch_size, config.ppo.minibatch)
        ]

    @property
    def sizes(self) -> list[int]:
        """Samples of each gradient step of an episode."""
        return [len(batch.actions) for batch in self._minibatches]

    def seconds(self, episodes: int, repetition: int) -> float:
        """Seconds of the gradient steps of ``episodes`` episodes."""
        total_s = 0.0
        for _ in range(episodes):
            self._policy.load_state_dict(self._weights)
            begin_s = time.perf_counter()
            for batch in self._minibatches:
                self._update(batch)
            total_s += time.perf_counter() - begin_s
        return total_s

    def _update(self, batch: MiniBatch) -> None:
        policy, ppo = self._policy, self._ppo
        mean = torch.tanh(self._through(policy.actor, batch.observations))
        deviations = (batch.actions - mean) / policy.log_std.exp()
        log_prob = -(0.5 * deviations**2 + policy.log_std + _HALF_LOG_TWO_PI).sum(dim=1)
        entropy = (policy.log_std + 0.5 + _HALF_LOG_TWO_PI).sum()
        advantages = batch.advantages
        advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        likelihood = (log_prob - batch.old_log_prob).exp()
        clipped = likelihood.clamp(1.0 - ppo.clip_ratio, 1.0 + ppo.clip_ratio)
        policy_loss = -torch.min(advantages * likelihood, advantages * clipped).mean()
        values = self._through(policy.critic, batch.states).squeeze(-1)[batch.state_of_row]
        value_loss = functional.mse_loss(values, batch.returns)
        loss = policy_loss - ppo.entropy_coef[0] * entropy + ppo.value_coef * value_loss
        policy.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(policy.actor_parameters(), ppo.max_grad_norm)
        torch.nn.utils.clip_grad_norm_(policy.critic_parameters(), ppo.max_grad_norm)
        policy.optimizer.step()


def update_phase_s(flush: bool, repetition: int) -> float:
    """Seconds of updates per episode, late in a run, with denormal numbers flushed to 0 or kept."""
    seconds: list[float] = []
    train, set_flush_denormal = MAPPO.train, torch.set_flush_denormal

    def timed_train(model: MAPPO) -> None:
        begin_s = time.perf_counter()
        train(model)
        seconds.append(time.perf_counter() - begin_s)

    with (
        mock.patch.object(MAPPO, "train", timed_train),
        mock.patch.object(torch, "set_flush_denormal", lambda _: set_flush_denormal(flush)),
    ):
        learning_loop_s(UNIT, DENORMAL_EPISODES, repetition)
    return sum(seconds[-DENORMAL_LAST:]) / DENORMAL_LAST


def spent_s(unit: str) -> dict[str, float]:
    """Seconds per episode of the learning loop by what takes them, the largest first."""
    watch = Stopwatch()
    with watch.watching(WATCHED):
        total_s = learning_loop_s(unit, EPISODES, repetition=0)
    spent = dict.fromkeys([*SHARES.values(), REST], 0.0)
    for path, seconds in watch.exclusive_s().items():
        if path[0] in ("rollout", "update", "log"):  # other functions are called before the loop
            spent[next(SHARES[label] for label in SHARES if label in path)] += seconds
    spent[REST] = total_s - sum(spent.values())
    return {
        name: round(seconds / EPISODES, 6)
        for name, seconds in sorted(spent.items(), key=lambda item: -item[1])
    }


def peak_memory_mib() -> dict[str, float]:
    """Greatest resident memory of ``orchid train``, with and without compiling the simulator.

    A process in between measures it, since right after the fork a child has its parent's value.
    """
    launcher = (
        "import resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL)\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)\n"
    )
    unit = 2**20 if sys.platform == "darwin" else 2**10
    peaks: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as directory:
        command = [sys.executable, "-m", "orchid_uav", "train", "--quiet"]
        command += ["--episodes", str(MEMORY_EPISODES), "--runs-dir", directory]
        for name in ("compiling", "compiled before"):
            finished = subprocess.run(
                [sys.executable, "-c", launcher, *command],
                env={**os.environ, "NUMBA_CACHE_DIR": directory},
                check=True,
                capture_output=True,
                text=True,
            )
            peaks[name] = round(int(finished.stdout) / unit)
    return peaks


def main() -> None:
    """Measure and report."""
    options = arguments("Cost of the learning loop, one thread.", repetitions=7)
    with threadpool_limits(1), loop.torch_settings(1):
        bare = {unit: BareUpdates(unit) for unit in UNITS}
        cases: dict[str, Case] = {}
        for unit in UNITS:
            cases[f"learning loop, {unit}"] = partial(learning_loop_s, unit, EPISODES)
            cases[f"bare updates, {unit}"] = partial(bare[unit].seconds, EPISODES)
            plain = BareUpdates(unit, plain=True)
            cases[f"plain updates, {unit}"] = partial(plain.seconds, EPISODES)
        seconds = alternate(cases, options.repetitions)
        update_phase = alternate(
            {
                "denormals flushed": partial(update_phase_s, True),
                "denormals kept": partial(update_phase_s, False),
            },
            max(1, options.repetitions // 2),
        )
        spent = {unit: spent_s(unit) for unit in UNITS}
    memory = peak_memory_mib()
    ratios = {
        f"learning loop / {kind} updates, {unit}": ratio(
            seconds, f"learning loop, {unit}", f"{kind} updates, {unit}"
        )
        for unit in UNITS
        for kind in ("bare", "plain")
    }
    ratios |= {
        "updates, denormals kept / flushed": ratio(
            update_phase, "denormals kept", "denormals flushed"
        ),
    }
    document = record(
        {
            "episodes": EPISODES,
            "repetitions": options.repetitions,
            "samples_per_gradient_step": {unit: bare[unit].sizes for unit in UNITS},
            "denormal_episodes": DENORMAL_EPISODES,
            "denormal_last_episodes": DENORMAL_LAST,
            "memory_episodes": MEMORY_EPISODES,
        },
        seconds=seconds,
        update_phase_s_per_episode=update_phase,
        spent_s_per_episode=spent,
        peak_memory_mib=memory,
        ratios=ratios,
    )
    rows = {name: f"{value['median']:.2f} s" for name, value in seconds.items()}
    rows |= {name: f"{value:.2f} x" for name, value in ratios.items()}
    rows |= {
        f"per episode, {unit}: {name}": f"{value * 1e3:.2f} ms"
        for unit in UNITS
        for name, value in spent[unit].items()
    }
    rows |= {f"peak memory, {name}": f"{value} MiB" for name, value in memory.items()}
    report(f"Training, {EPISODES} episodes, one thread", rows, document, options.json)


if __name__ == "__main__":
    main()
