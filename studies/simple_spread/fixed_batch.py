"""What BenchMARL's MAPPO and MADDPG compute from one small batch, for tests of ours.

Run ``python -m studies.simple_spread.fixed_batch FILE`` in BenchMARL's Python environment. Losses,
advantage estimation, optimizers, clipping and target updates are BenchMARL's, unchanged. Networks,
transitions and noise are drawn here. The file holds inputs and outputs. The head of MAPPO's policy
and the draw of its actions are ours on both sides, since the distributions differ.

One world ends by a time limit, another by termination, and both continue with a new episode. The
minibatch is the whole batch, since the order of samples cannot be the same on both sides.
"""

import argparse
import itertools
import json
import tempfile
import warnings
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from benchmarl.experiment import Experiment
from tensordict import TensorDict

from studies.simple_spread.benchmarl_learners import make_experiment
from studies.simple_spread.benchmarl_worlds import GROUP, SpreadTask
from studies.simple_spread.task import ACTIONS, AGENTS, OBSERVATION, STATE, Settings

WORLDS, STEPS, HIDDEN = 2, 6, (8, 8)
TIME_LIMIT, TERMINAL = (2, 0), (3, 1)
"""(step, world) at which an episode ends, for each kind of end."""
UPDATES = 3
SETTINGS = Settings(
    frames=WORLDS * STEPS,
    worlds=WORLDS,
    frames_per_iteration=WORLDS * STEPS,
    minibatch_frames=WORLDS * STEPS,
    batch_frames=WORLDS * STEPS,
    hidden_sizes=HIDDEN,
    learning_rate=0.003,
    entropy_coefficient=0.01,
    max_grad_norm=0.5,
    target_rate=0.1,
    epochs=UPDATES,
    clip_range=0.02,  # narrow enough to clip some of the ratios
)
Arrays = dict[str, Any]


def inputs(generator: np.random.Generator) -> Arrays:
    """Transitions, noise and weights, rounded so that float32 and a short file hold the same."""

    def normal(*shape: int, scale: float = 1.0) -> np.ndarray:
        return (generator.standard_normal(shape) * scale).round(3).astype(np.float32)

    def layers(inputs: int, outputs: int) -> list[list[np.ndarray]]:
        sizes = (inputs, *HIDDEN, outputs)
        return [
            [normal(wide, narrow, scale=narrow**-0.5), normal(wide, scale=0.1)]
            for narrow, wide in itertools.pairwise(sizes)
        ]

    ended = np.zeros((2, STEPS, WORLDS), bool)
    ended[0][TIME_LIMIT], ended[1][TERMINAL] = True, True
    worlds = (STEPS, WORLDS)
    following, next_state = normal(*worlds, AGENTS, OBSERVATION), normal(*worlds, STATE)
    observation = np.concatenate([normal(1, WORLDS, AGENTS, OBSERVATION), following[:-1]])
    state = np.concatenate([normal(1, WORLDS, STATE), next_state[:-1]])
    for step, world in np.argwhere(ended.any(axis=0)):
        # The next observation belongs to another episode.
        observation[step + 1, world] = normal(AGENTS, OBSERVATION)
        state[step + 1, world] = normal(STATE)
    return {
        "observation": observation,
        "state": state,
        "next_observation": following,
        "next_state": next_state,
        "noise": normal(*worlds, AGENTS, ACTIONS),
        "reward": normal(*worlds, AGENTS),
        "truncated": ended[0],
        "terminated": ended[1],
        "log_std": normal(ACTIONS, scale=0.3),
        "actor": layers(OBSERVATION, ACTIONS),
        "critic": layers(STATE, 1),
        "joint_critic": layers(STATE + AGENTS * ACTIONS, 1),
        "joint_critic_target": layers(STATE + AGENTS * ACTIONS, 1),
        "deviation": normal(*worlds, AGENTS, scale=0.03),
    }


def load_layers(parameters: TensorDict, layers: list[list[np.ndarray]]) -> None:
    """Copy weights and biases into the leaves of a network, in their order."""
    leaves = [leaf for _, leaf in sorted_leaves(parameters)]
    wanted = [array for layer in layers for array in layer]
    for leaf, array in zip(leaves, wanted, strict=True):
        leaf.data.copy_(torch.from_numpy(array).reshape(leaf.shape))


def sorted_leaves(parameters: TensorDict) -> list[tuple[str, torch.Tensor]]:
    """Weights and biases, layer by layer, weights first; without log_std."""
    leaves = [
        (".".join(key) if isinstance(key, tuple) else key, leaf)
        for key, leaf in parameters.items(True, True)
    ]
    networks = [pair for pair in leaves if "log_std" not in pair[0]]
    return sorted(networks, key=lambda pair: (pair[0].rsplit(".", 1)[0], "bias" in pair[0]))


def layers_of(parameters: TensorDict, gradient: bool = False) -> list[list[np.ndarray]]:
    """The inverse of :func:`load_layers`."""
    arrays = [
        (leaf.grad if gradient else leaf).detach().numpy().copy()
        for _, leaf in sorted_leaves(parameters)
    ]
    return [
        [weight.reshape(bias.size, -1), bias.reshape(-1)]
        for weight, bias in zip(arrays[::2], arrays[1::2], strict=True)
    ]


def rollout(given: Arrays, actions: torch.Tensor, log_prob: torch.Tensor | None) -> TensorDict:
    """The batch (worlds, steps) as BenchMARL's collector returns it."""

    def by_world(array: Any) -> torch.Tensor:
        return torch.as_tensor(np.asarray(array)).transpose(0, 1).contiguous()

    shape = (WORLDS, STEPS)
    agents = {"observation": by_world(given["observation"]), "action": by_world(actions)}
    if log_prob is not None:
        agents["log_prob"] = by_world(log_prob)
    ends = {name: by_world(given[name])[..., None] for name in ("truncated", "terminated")}
    following = {
        GROUP: TensorDict(
            {
                "observation": by_world(given["next_observation"]),
                "reward": by_world(given["reward"])[..., None],
            },
            (*shape, AGENTS),
        ),
        "state": by_world(given["next_state"]),
        **ends,
        "done": ends["truncated"] | ends["terminated"],
    }
    return TensorDict(
        {
            GROUP: TensorDict(agents, (*shape, AGENTS)),
            "state": by_world(given["state"]),
            "next": TensorDict(following, shape),
        },
        shape,
    )


def mappo_numbers(given: Arrays) -> Arrays:
    """Advantages, losses, gradients, and the networks after the updates on one rollout."""
    experiment = _experiment("mappo-gaussian")
    algorithm, loss = experiment.algorithm, experiment.losses[GROUP]
    actor, critic = loss.actor_network_params, loss.critic_network_params
    load_layers(actor, given["actor"])
    load_layers(critic, given["critic"])
    (log_std,) = (leaf for key, leaf in actor.items(True, True) if "log_std" in key)
    log_std.data.copy_(torch.from_numpy(given["log_std"]))
    with torch.no_grad():
        seen = TensorDict({GROUP: {"observation": torch.from_numpy(given["observation"])}}, [])
        with actor.to_module(loss.actor_network):
            distribution = loss.actor_network.get_dist(seen)
        noise = torch.from_numpy(given["noise"])
        actions = distribution.base_dist.loc + distribution.base_dist.scale * noise
        log_prob = distribution.log_prob(actions)
    batch = algorithm.process_batch(GROUP, rollout(given, actions, log_prob))
    experiment.replay_buffers[GROUP].extend(batch.reshape(-1))

    def by_step(name: str) -> np.ndarray:
        return batch[GROUP, name].squeeze(-1).transpose(0, 1).numpy()

    found: Arrays = {
        "action": actions.numpy(),
        "log_prob": log_prob.numpy(),
        "value": by_step("state_value"),
        "advantage": by_step("advantage"),
        "return": by_step("value_target"),
    }
    # As if the policy had changed since; otherwise all ratios are 1 and nothing is clipped.
    moved = batch.reshape(-1).clone()
    deviation = torch.from_numpy(given["deviation"]).transpose(0, 1).reshape(-1, AGENTS)
    moved[GROUP, "log_prob"] = moved[GROUP, "log_prob"] + deviation
    loss.normalize_advantage = True
    found["loss_objective_of_normalized_advantages"] = loss(moved)["loss_objective"].item()
    loss.normalize_advantage = False
    value_moved = moved.clone()
    value_moved[GROUP, "state_value"] = value_moved[GROUP, "state_value"] + deviation[..., None]
    loss.clip_value = torch.tensor(SETTINGS.clip_range)  # a setting of TorchRL that BenchMARL lacks
    found["loss_critic_of_clipped_values"] = loss(value_moved)["loss_critic"].item()
    loss.clip_value = None
    losses = loss(moved)
    for name in ("loss_objective", "loss_entropy", "loss_critic", "entropy", "clip_fraction"):
        found[name] = losses[name].item()
    (losses["loss_objective"] + losses["loss_entropy"] + losses["loss_critic"]).backward()
    found["actor_gradient"] = layers_of(actor, gradient=True)
    found["log_std_gradient"] = log_std.grad.numpy().copy()
    found["critic_gradient"] = layers_of(critic, gradient=True)
    experiment.optimizers[GROUP]["loss_objective"].zero_grad()
    experiment.optimizers[GROUP]["loss_critic"].zero_grad()
    steps = [experiment._optimizer_loop(GROUP) for _ in range(UPDATES)]
    found["gradient_norms"] = {
        name: [step[f"grad_norm_{name}"].item() for step in steps]
        for name in ("loss_objective", "loss_critic")
    }
    found["actor"], found["critic"] = layers_of(actor), layers_of(critic)
    found["log_std"] = log_std.detach().numpy().copy()
    return found


def maddpg_numbers(given: Arrays) -> Arrays:
    """Losses, gradients, and networks and the target after updates on one batch.

    Only the critic has a target: BenchMARL leaves TorchRL's ``delay_actor`` off.
    """
    experiment = _experiment("maddpg")
    loss = experiment.losses[GROUP]
    networks = {
        "actor": loss.actor_network_params,
        "joint_critic": loss.value_network_params,
        "joint_critic_target": loss.target_value_network_params,
    }
    for name, parameters in networks.items():
        load_layers(parameters, given[name])
    actions = torch.from_numpy(given["noise"]).clamp(-1.0, 1.0)
    batch = experiment.algorithm.process_batch(GROUP, rollout(given, actions, None)).reshape(-1)
    losses = loss(batch)
    found: Arrays = {name: losses[name].item() for name in ("loss_value", "loss_actor")}
    for name, network in (("loss_value", "joint_critic"), ("loss_actor", "actor")):
        losses[name].backward()
        found[f"{network}_gradient"] = layers_of(networks[network], gradient=True)
        experiment.optimizers[GROUP][name].zero_grad()
    experiment.replay_buffers[GROUP].sample = batch.clone
    for _ in range(UPDATES):
        experiment._optimizer_loop(GROUP)
    return found | {name: layers_of(parameters) for name, parameters in networks.items()}


def initial_networks(seed: int) -> Arrays:
    """Actor and critic of MAPPO as BenchMARL initialises them."""
    loss = _experiment("mappo-gaussian", seed).losses[GROUP]
    return {
        "seed": seed,
        "actor": layers_of(loss.actor_network_params),
        "critic": layers_of(loss.critic_network_params),
    }


def _experiment(name: str, seed: int = 0) -> Experiment:
    with tempfile.TemporaryDirectory() as directory:
        return make_experiment(name, seed, SETTINGS, SpreadTask(lowest_action=-1.0), directory)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    return float(f"{value:.7g}") if isinstance(value, float) else value


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    path = parser.parse_args().file
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)
    given = inputs(np.random.default_rng(0))
    packages = ("benchmarl", "torchrl", "torch")
    document = {
        "command": "python -m studies.simple_spread.fixed_batch",
        "versions": {package: version(package) for package in packages},
        "settings": asdict(SETTINGS),
        "inputs": given,
        "mappo": mappo_numbers(given),
        "maddpg": maddpg_numbers(given),
        "initial": initial_networks(seed=7),
    }
    path.write_text(json.dumps(_plain(document), separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
