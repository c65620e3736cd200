"""BenchMARL's MAPPO on this project's PettingZoo environment, timed: for ``training_speed``.

Runs in BenchMARL's environment with ``orchid_uav`` installed too, and prints one JSON document.
"""

import argparse
import json
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import torch
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Callback
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from orchid_uav.envs import parallel_env
from studies.simple_spread.benchmarl_learners import make_experiment
from studies.simple_spread.task import Settings


class FleetTask(PettingZooClass):
    """This project's environment in TorchRL's wrapper; ``slots`` are those of an episode."""

    def __init__(self, slots: int) -> None:
        super().__init__("SIMPLE_SPREAD", {"max_cycles": slots})  # the name tells what it can do

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Makes one world."""
        return lambda: PettingZooWrapper(env=parallel_env(), return_state=True, seed=seed)


class _Parts(Callback):
    """Seconds of collecting and of learning."""

    def __init__(self) -> None:
        super().__init__()
        self.collecting_s = self.learning_s = 0.0
        self.last_s = time.perf_counter()

    def on_batch_collected(self, batch: Any) -> None:
        """Collecting has ended."""
        self.collecting_s += self._lap()

    def on_train_end(self, training_td: Any, group: str) -> None:
        """Learning has ended."""
        self.learning_s += self._lap()

    def _lap(self) -> float:
        before, self.last_s = self.last_s, time.perf_counter()
        return self.last_s - before


def train(settings: Settings, seed: int) -> dict[str, Any]:
    """Seconds of the loop, after imports and construction."""
    parts = _Parts()
    with tempfile.TemporaryDirectory() as directory:
        task = FleetTask(settings.frames_per_iteration)
        experiment = make_experiment(
            "mappo", seed, settings, task, directory, (parts,), adam_extra_kwargs={"fused": True}
        )
        begun_s = parts.last_s = time.perf_counter()
        experiment.run()
        seconds = time.perf_counter() - begun_s
    return {
        "seconds": seconds,
        "frames": experiment.total_frames,
        "collecting_s": parts.collecting_s,
        "learning_s": parts.learning_s,
        "versions": {name: version(name) for name in ("benchmarl", "torchrl", "torch")},
    }


def main() -> None:
    """Command line: the settings as JSON, and a seed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("settings", type=json.loads)
    parser.add_argument("seed", type=int)
    arguments = parser.parse_args()
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)
    print(json.dumps(train(Settings(**arguments.settings), arguments.seed)))


if __name__ == "__main__":
    main()
