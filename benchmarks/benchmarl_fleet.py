"""BenchMARL's MAPPO on this project's PettingZoo environment, timed: for ``training_speed``.

This runs in BenchMARL's Python environment, with ``orchid_uav`` installed there too, and prints one
JSON document.
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
    """This project's environment in TorchRL's wrapper; ``slots`` is the length of an episode."""

    def __init__(self, slots: int) -> None:
        super().__init__(
            "SIMPLE_SPREAD", {"max_cycles": slots}
        )  # the name determines its capabilities

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        """Return a function that makes one world."""
        return lambda: PettingZooWrapper(env=parallel_env(), return_state=True, seed=seed)


class _Parts(Callback):
    """Seconds of collecting and of learning."""

    def __init__(self) -> None:
        super().__init__()
        self.collecting_s = self.learning_s = 0.0
        self.last_s = time.perf_counter()

    def on_batch_collected(self, batch: Any) -> None:
        """Note the end of collecting."""
        self.collecting_s += self._lap()

    def on_train_end(self, training_td: Any, group: str) -> None:
        """Note the end of learning."""
        self.learning_s += self._lap()

    def _lap(self) -> float:
        before, self.last_s = self.last_s, time.perf_counter()
        return self.last_s - before


def train(settings: Settings, seed: int) -> dict[str, Any]:
    """Return the seconds of the training loop, after imports and construction."""
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
    """Read the settings, as JSON, and a seed from the command line, and train."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("settings", type=json.loads)
    parser.add_argument("seed", type=int)
    arguments = parser.parse_args()
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)
    print(json.dumps(train(Settings(**arguments.settings), arguments.seed)))


if __name__ == "__main__":
    main()
