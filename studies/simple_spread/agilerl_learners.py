"""MADDPG of AgileRL, run in a Python environment of its own.

The loss, the optimizers, the buffer (in version 2.58 there is only one, which serves several agents
too) and the loop ``train_multi_agent_off_policy`` are AgileRL's, unchanged. The population is one,
without selection or mutation. We provide the settings, the networks, and worlds that are stepped
one after the other (AgileRL's take one process each, or hold only one world).

Networks: actor 18-64-64-5, critic on all observations and actions 69-64-64-1, ReLU, PyTorch's
initialisation. AgileRL's default, an encoder and a head, has more layers, layer normalisation and
smaller weights in the last one, so here the encoder only concatenates and the head does the rest.

The same as in the other libraries: agents whose names differ only in their number share one actor
and one critic; the output of the actor is tanh, mapped to [0, 1]; the noise is Gaussian and clipped
with the action; the loss of the critic is the mean squared error to a one-step target.

Different from the other libraries, and left so:

* An update takes the agents in turn, each with a step of the critic and then one of the actor (on
  the critic just stepped) for that agent's own reward and action. So one update is three steps of
  Adam on both of the shared networks, where the others take one on the mean over the agents. The
  targets follow once per update.
* In the loss of the actor the other agents act as they did in the transition, as in the paper,
  where the others let all agents act anew.
* One update every ``frames_per_iteration / updates_per_iteration`` frames, as soon as the buffer
  holds a batch, instead of ``updates_per_iteration`` after each iteration.
* Adam with an epsilon of 1e-8, no clipping of gradients (``adam_epsilon`` and ``max_grad_norm``
  have no counterpart), and batches without repetition while the buffer is small.
* Actions are stored, and seen by the critic, in [-1, 1], as in orchid's but not in BenchMARL's; the
  noise has twice the deviation there.

Time limits: the loop stores only termination as an end, so the target rightly continues beyond the
time limit. But AgileRL's environments replace the last observation of an episode by the first one
of the next, and the target then uses the value of that. The worlds here keep the last observation.
The loop allows this because it resets them after each round, and a round is an episode. After each
round the loop also evaluates the policy; this is cut to a single step, and nothing is learned from
it.
"""

import contextlib
import io
import warnings
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from agilerl.algorithms import MADDPG
from agilerl.components.replay_buffer import ReplayBuffer
from agilerl.modules.base import EvolvableModule
from agilerl.networks import ContinuousQNetwork, DeterministicActor
from agilerl.training.train_multi_agent_off_policy import train_multi_agent_off_policy
from agilerl.utils.algo_utils import concatenate_spaces
from agilerl.vector.pz_vec_env import PettingZooVecEnv
from gymnasium import spaces

from studies.simple_spread.task import STEPS, Learned, Policy, Progress, Settings, make_spread


class SpreadWorlds(PettingZooVecEnv):
    """Several worlds in one process, with the interface of AgileRL's vectorised environments."""

    def __init__(self, worlds: int, seed: int) -> None:
        self._worlds = [make_spread() for _ in range(worlds)]
        first = self._worlds[0]
        agents = first.possible_agents
        super().__init__(
            worlds,
            {agent: first.observation_space(agent) for agent in agents},
            {agent: first.action_space(agent) for agent in agents},
            agents,
        )
        drawn = np.random.SeedSequence(seed).generate_state(worlds)
        self._seeds: list[int | None] = [int(one) for one in drawn]
        self._actions: list[dict[str, Any]] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Return first observations; the worlds are seeded once, by the constructor's seed."""
        views = [
            world.reset(seed=own)[0] for world, own in zip(self._worlds, self._seeds, strict=True)
        ]
        self._seeds = [None] * self.num_envs
        return self._by_agent(views), {agent: {} for agent in self.agents}

    def step_async(self, actions: list[dict[str, Any]]) -> None:
        """Keep the actions of each world for ``step_wait``."""
        self._actions = actions

    def step_wait(self, timeout: float | None = None) -> Any:
        """Step the worlds one after the other."""
        rows = []
        for world, chosen in zip(self._worlds, self._actions, strict=True):
            inside = {
                agent: np.clip(action, 0.0, 1.0, dtype=np.float32)
                for agent, action in chosen.items()
            }
            view, reward, terminated, truncated, _ = world.step(inside)
            rows.append((view, reward, terminated, truncated))
        view, reward, terminated, truncated = map(self._by_agent, zip(*rows, strict=True))
        return view, reward, terminated, truncated, {agent: {} for agent in self.agents}

    def _by_agent(self, rows: Any) -> dict[str, np.ndarray]:
        return {agent: np.array([row[agent] for row in rows], np.float32) for agent in self.agents}


class Concatenation(EvolvableModule):
    """An encoder without parameters: the observations as they are, side by side."""

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        num_outputs: int,
        device: str = "cpu",
        name: str = "encoder",
        output_activation: str | None = None,  # AgileRL always gives one
    ) -> None:
        super().__init__(device)
        # To copy a module, AgileRL calls its constructor with these again.
        self.observation_space = observation_space
        self.num_outputs = num_outputs
        self.name = name
        self.output_activation = output_activation

    def forward(self, observations: Any) -> torch.Tensor:
        """Return (frames, inputs) for one observation, or for a mapping of several."""
        if isinstance(observations, Mapping):
            return torch.cat(list(observations.values()), dim=-1)
        return observations


def make_learner(settings: Settings, worlds: PettingZooVecEnv) -> MADDPG:
    """AgileRL's MADDPG with the settings, ready to learn."""
    update_frames, rest = divmod(settings.frames_per_iteration, settings.updates_per_iteration)
    if rest or update_frames < 1 or settings.worlds % update_frames:
        # AgileRL learns after steps of all worlds only, and rounds the number of updates.
        raise ValueError("each step of all worlds must cause a whole number of updates")
    observations = spaces.Dict({a: worlds.single_observation_space(a) for a in worlds.agents})
    actions = spaces.Dict({a: worlds.single_action_space(a) for a in worlds.agents})

    def layers(inputs: int) -> dict[str, Any]:
        return {
            "encoder_cls": Concatenation,
            "encoder_config": {},
            "latent_dim": inputs,
            "head_config": {
                "hidden_size": list(settings.hidden_sizes),
                "activation": "ReLU",
                "layer_norm": False,
                "init_layers": False,
                "output_vanish": False,
            },
        }

    agent = worlds.agents[0]
    actor = DeterministicActor(
        observations[agent], actions[agent], **layers(spaces.flatdim(observations[agent]))
    )
    critic = ContinuousQNetwork(
        observations,
        concatenate_spaces(list(actions.values())),
        **layers(spaces.flatdim(observations)),
    )
    return MADDPG(
        observations,
        actions,
        O_U_noise=False,
        expl_noise=2.0 * settings.exploration_std,  # on actions in [-1, 1]
        vect_noise_dim=settings.worlds,
        batch_size=settings.batch_frames,
        lr_actor=settings.learning_rate,
        lr_critic=settings.learning_rate,
        learn_step=update_frames,
        gamma=settings.gamma,
        tau=settings.target_rate,
        actor_networks=[actor],
        critic_networks=[critic],
    )


def deterministic_policy(model: MADDPG) -> Policy:
    """The actor of a learner without its noise."""

    def act(observations: np.ndarray) -> np.ndarray:
        before = model.training
        model.set_training_mode(False)
        rows = {agent: observations[[row]] for row, agent in enumerate(model.agent_ids)}
        actions, _ = model.get_action(rows)
        model.set_training_mode(before)
        return np.clip(np.concatenate([actions[agent] for agent in model.agent_ids]), 0.0, 1.0)

    return act


def learn(name: str, seed: int, settings: Settings) -> Learned:
    """Train "maddpg"; frames are whole episodes of all worlds."""
    warnings.filterwarnings("ignore")
    torch.manual_seed(seed)
    round_frames = STEPS * settings.worlds
    worlds = SpreadWorlds(settings.worlds, seed)
    model = make_learner(settings, worlds)
    # AgileRL writes to its whole buffer at once, so it is made no larger than needed.
    memory = ReplayBuffer(min(settings.buffer_frames, settings.frames + round_frames))
    progress = Progress(settings)
    distance = settings.frames // settings.curve_points
    while model.metrics.steps < settings.frames:
        target = min((len(progress.curve) + 1) * distance, settings.frames)
        with contextlib.redirect_stderr(io.StringIO()):  # its progress bar
            train_multi_agent_off_policy(
                worlds,
                "simple_spread_v3",
                "MADDPG",
                [model],
                memory,
                max_steps=target,
                evo_steps=round_frames,
                eval_steps=1,
                verbose=False,
            )
        if progress.due(model.metrics.steps):
            progress.judge(model.metrics.steps, deterministic_policy(model))
    return Learned(
        deterministic_policy(model),
        progress,
        progress.training_s,
        {package: version(package) for package in ("agilerl", "tensordict", "torch")},
    )
