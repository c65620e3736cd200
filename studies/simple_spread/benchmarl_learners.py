"""MAPPO and MADDPG of BenchMARL, on TorchRL, run in a Python environment of their own.

The losses, optimizers, buffers, collectors and loops are theirs, unchanged. We provide the settings
and the worlds of ``benchmarl_worlds``. "mappo-gaussian" is their MAPPO with our distribution of
actions, so that the distribution explains no difference from ours.
"""

import tempfile
import warnings
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from benchmarl.algorithms import MaddpgConfig, Mappo, MappoConfig
from benchmarl.algorithms.common import AlgorithmConfig
from benchmarl.environments.common import TaskClass
from benchmarl.experiment import Callback, Experiment, ExperimentConfig
from benchmarl.models.common import ModelConfig
from benchmarl.models.mlp import MlpConfig
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.data import Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import IndependentNormal, ProbabilisticActor

from studies.simple_spread.benchmarl_worlds import GROUP, SpreadTask, StockSpreadTask
from studies.simple_spread.task import AGENTS, Learned, Policy, Progress, Settings


class TanhMean(nn.Module):
    """Our distribution: mean tanh(network), and a learned deviation that depends on no input."""

    def __init__(self, actions: int) -> None:
        super().__init__()
        self.log_std = nn.Parameter(torch.zeros(actions))

    def forward(self, raw: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean and standard deviation of each action."""
        return torch.tanh(raw), self.log_std.exp().expand_as(raw)


class GaussianMappo(Mappo):
    """BenchMARL's MAPPO with another policy head; all else is inherited."""

    def _get_policy_for_loss(
        self, group: str, model_config: ModelConfig, continuous: bool
    ) -> TensorDictModule:
        action_spec = self.action_spec[group, "action"]
        shape = action_spec.shape
        network = model_config.get_model(
            input_spec=Composite({group: self.observation_spec[group].clone()}),
            output_spec=Composite({group: Composite({"raw": Unbounded(shape)}, shape=shape[:1])}),
            agent_group=group,
            input_has_agent_dim=True,
            n_agents=shape[0],
            centralised=False,
            share_params=True,
            device=self.device,
            action_spec=self.action_spec,
        )
        head = TensorDictModule(
            TanhMean(shape[-1]), [(group, "raw")], [(group, "loc"), (group, "scale")]
        )
        return ProbabilisticActor(
            module=TensorDictSequential(network, head),
            # The worlds clip actions beyond their bounds; the learner sees them unclipped.
            spec=Unbounded(shape),
            in_keys=[(group, "loc"), (group, "scale")],
            out_keys=[(group, "action")],
            distribution_class=IndependentNormal,
            return_log_prob=True,
            log_prob_key=(group, "log_prob"),
        )


class GaussianMappoConfig(MappoConfig):
    """The configuration of :class:`GaussianMappo`."""

    @staticmethod
    def associated_class() -> type[Mappo]:
        """Return the class that this configures."""
        return GaussianMappo


class _Judging(Callback):
    """Judges the policy; ``progress`` is set when training begins, so its clock starts then."""

    progress: Progress

    def on_train_end(self, training_td: TensorDictBase, group: str) -> None:
        """Add a point to the curve."""
        frames = self.experiment.total_frames
        if self.progress.due(frames):
            self.progress.judge(frames, deterministic_policy(self.experiment))


def deterministic_policy(experiment: Experiment) -> Policy:
    """The actor of an experiment without its noise."""
    space = experiment.action_spec[GROUP, "action"].space

    def act(observations: np.ndarray) -> np.ndarray:
        seen = TensorDict({"observation": torch.from_numpy(observations)}, [AGENTS])
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            actions = experiment.policy(TensorDict({GROUP: seen}, []))[GROUP, "action"]
        return ((actions - space.low) / (space.high - space.low)).numpy()

    return act


def experiment_config(settings: Settings, directory: str) -> ExperimentConfig:
    """BenchMARL's defaults with the settings."""
    config = ExperimentConfig.get_from_yaml()
    config.max_n_frames = settings.frames
    config.on_policy_collected_frames_per_batch = settings.frames_per_iteration
    config.on_policy_n_envs_per_worker = settings.worlds
    config.on_policy_n_minibatch_iters = settings.epochs
    config.on_policy_minibatch_size = settings.minibatch_frames
    config.off_policy_collected_frames_per_batch = settings.frames_per_iteration
    config.off_policy_n_envs_per_worker = settings.worlds
    config.off_policy_n_optimizer_steps = settings.updates_per_iteration
    config.off_policy_train_batch_size = settings.batch_frames
    config.off_policy_memory_size = settings.buffer_frames
    config.lr = settings.learning_rate
    config.adam_eps = settings.adam_epsilon
    config.gamma = settings.gamma
    config.polyak_tau = settings.target_rate
    config.clip_grad_val = settings.max_grad_norm
    config.exploration_eps_init = config.exploration_eps_end = settings.exploration_std
    config.evaluation, config.render, config.create_json = False, False, False
    config.loggers, config.save_folder = [], directory
    return config


def algorithm_config(name: str, settings: Settings) -> AlgorithmConfig:
    """BenchMARL's defaults with the settings."""
    if name == "maddpg":
        return MaddpgConfig.get_from_yaml()
    algorithm = MappoConfig.get_from_yaml()
    algorithm.lmbda = settings.gae_lambda
    algorithm.clip_epsilon = settings.clip_range
    algorithm.entropy_coef = settings.entropy_coefficient
    return GaussianMappoConfig(**vars(algorithm)) if name == "mappo-gaussian" else algorithm


def make_experiment(
    name: str,
    seed: int,
    settings: Settings,
    task: TaskClass,
    directory: str,
    callbacks: tuple[Callback, ...] = (),
    **config: Any,
) -> Experiment:
    """Make a BenchMARL experiment; ``config`` changes its ``ExperimentConfig``."""

    def network() -> MlpConfig:
        return MlpConfig(
            num_cells=list(settings.hidden_sizes), layer_class=nn.Linear, activation_class=nn.ReLU
        )

    return Experiment(
        task=task,
        algorithm_config=algorithm_config(name, settings),
        model_config=network(),
        critic_model_config=network(),
        seed=seed,
        config=replace(experiment_config(settings, directory), **config),
        callbacks=list(callbacks),
    )


def learn(name: str, seed: int, settings: Settings) -> Learned:
    """Train "mappo", "mappo-gaussian", "maddpg", or "mappo-stock" (in TorchRL's own wrapper)."""
    warnings.filterwarnings("ignore")
    task: TaskClass
    if name == "mappo-stock":
        task = StockSpreadTask()
    else:
        task = SpreadTask(lowest_action=-1.0 if name == "mappo-gaussian" else 0.0)
    with tempfile.TemporaryDirectory() as directory:
        judging = _Judging()
        experiment = make_experiment(name, seed, settings, task, directory, (judging,))
        judging.progress = Progress(settings)
        experiment.run()
        training_s = judging.progress.training_s
    packages = ("benchmarl", "torchrl", "tensordict", "torch", "mpe2")
    return Learned(
        deterministic_policy(experiment),
        judging.progress,
        training_s,
        {package: version(package) for package in packages},
    )
