"""Number by number against BenchMARL on TorchRL.

``studies/simple_spread/fixed_batch.py`` made the file.

Both sides start from the same weights, transitions and noise. What is compared is what came out
there. The head of MAPPO's policy, tanh and a deviation without input, is ours there too: of actions
and log probabilities only network and density are compared.
"""

import json
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from orchid_uav.agents import MADDPG, MAPPO
from orchid_uav.agents.maddpg.replay_buffer import JointBatch
from orchid_uav.agents.networks import perceptron
from studies.simple_spread.task import Settings

DOCUMENT = json.loads((Path(__file__).parents[1] / "data" / "benchmarl_batch.json").read_text())
GIVEN = {
    name: np.array(value, bool if name in ("truncated", "terminated") else np.float32)
    for name, value in DOCUMENT["inputs"].items()
    if "actor" not in name and "critic" not in name
}
STEPS, WORLDS, AGENTS, OBSERVATION = GIVEN["observation"].shape
STATE, ACTIONS = GIVEN["state"].shape[-1], GIVEN["noise"].shape[-1]
SETTINGS = DOCUMENT["settings"]
CLOSE = {"rtol": 2e-4, "atol": 2e-5}
"""float32 on both sides, seven digits in the file; parameters after three updates included."""


def close(found: Any, expected: Any) -> None:
    if isinstance(found, torch.Tensor):
        found = found.detach().numpy()
    np.testing.assert_allclose(found, np.array(expected), **CLOSE)


def load(network: nn.Sequential, layers: list[list[Any]]) -> None:
    with torch.no_grad():
        for layer, (weight, bias) in zip(linear(network), layers, strict=True):
            layer.weight.copy_(torch.tensor(weight))
            layer.bias.copy_(torch.tensor(bias))


def linear(network: nn.Sequential) -> list[nn.Linear]:
    return [layer for layer in network if isinstance(layer, nn.Linear)]


def layers_close(network: nn.Sequential, expected: list[list[Any]], gradient: bool = False) -> None:
    for layer, (weight, bias) in zip(linear(network), expected, strict=True):
        close(layer.weight.grad if gradient else layer.weight, weight)
        close(layer.bias.grad if gradient else layer.bias, bias)


def is_orthogonal(network: nn.Sequential) -> bool:
    """Whether the hidden layers stretch every direction that they pass on by sqrt(2)."""
    stretches = [torch.linalg.svdvals(layer.weight.detach()) for layer in linear(network)[:-1]]
    return all(torch.allclose(one, torch.tensor(2.0).sqrt(), atol=1e-5) for one in stretches)


class Recorded(VecEnv):
    """Plays the transitions of the file, whatever the actions."""

    agents_per_world = AGENTS
    render_mode = None

    def __init__(self) -> None:
        space = spaces.Dict(
            {
                "observation": spaces.Box(-np.inf, np.inf, (OBSERVATION,), np.float32),
                "state": spaces.Box(-np.inf, np.inf, (STATE,), np.float32),
            }
        )
        super().__init__(WORLDS * AGENTS, space, spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32))

    def rows(self, prefix: str, step: int) -> dict[str, np.ndarray]:
        return {
            "observation": GIVEN[f"{prefix}observation"][step].reshape(-1, OBSERVATION),
            "state": GIVEN[f"{prefix}state"][step].repeat(AGENTS, axis=0),
        }

    def reset(self) -> dict[str, np.ndarray]:
        self.step_count = 0
        return self.rows("", 0)

    def step_async(self, actions: np.ndarray) -> None:
        pass

    def step_wait(self) -> Any:
        step, self.step_count = self.step_count, self.step_count + 1
        following = self.rows("next_", step)
        truncated, terminated = (
            GIVEN[name][step].repeat(AGENTS) for name in ("truncated", "terminated")
        )
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(truncated | terminated):
            infos[row] = {
                "TimeLimit.truncated": bool(truncated[row]),
                "terminal_observation": {key: array[row] for key, array in following.items()},
            }
        is_last = self.step_count == STEPS
        seen = following if is_last else self.rows("", self.step_count)
        return seen, GIVEN["reward"][step].reshape(-1), truncated | terminated, infos

    def close(self) -> None:
        pass

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


POLICY = {
    "net_arch": SETTINGS["hidden_sizes"],
    "optimizer_kwargs": {"eps": SETTINGS["adam_epsilon"], "fused": True},
}
SHARED = {
    "learning_rate": SETTINGS["learning_rate"],
    "critic_learning_rate": SETTINGS["learning_rate"],
    "gamma": SETTINGS["gamma"],
    "max_grad_norm": SETTINGS["max_grad_norm"],
    "policy_kwargs": POLICY,
}


@pytest.fixture
def mappo() -> MAPPO:
    """Ours, with the rollout of the file collected."""
    model = MAPPO(
        "CentralizedCriticPolicy",
        Recorded(),
        n_steps=STEPS,
        batch_size=STEPS * WORLDS,
        minibatch="slots",
        n_epochs=SETTINGS["epochs"],
        gae_lambda=SETTINGS["gae_lambda"],
        clip_range=SETTINGS["clip_range"],
        ent_coef=SETTINGS["entropy_coefficient"],
        vf_coef=1.0,
        normalize_advantage=False,
        **SHARED,
    )
    load(model.policy.actor, DOCUMENT["inputs"]["actor"])
    load(model.policy.critic, DOCUMENT["inputs"]["critic"])
    with torch.no_grad():
        model.policy.log_std.copy_(torch.from_numpy(GIVEN["log_std"]))
    noise = torch.from_numpy(GIVEN["noise"].reshape(STEPS, -1, ACTIONS))
    total, callback = model._setup_learn(STEPS * WORLDS * AGENTS, None)
    with mock.patch("torch.randn", return_value=noise):
        model.collect_rollouts(model.env, callback, model.rollout_buffer, STEPS)
    assert model.num_timesteps == total
    return model


class TestMappo:
    PUBLIC = DOCUMENT["mappo"]

    @pytest.mark.parametrize(
        ("ours", "theirs"),
        [
            ("actions", "action"),
            ("log_probs", "log_prob"),
            ("values", "value"),
            ("advantages", "advantage"),
            ("returns", "return"),
        ],
    )
    def test_the_rollout_is_valued_alike(self, mappo, ours, theirs):
        found = getattr(mappo.rollout_buffer, ours)
        close(found.reshape(np.shape(self.PUBLIC[theirs])), self.PUBLIC[theirs])

    def test_a_time_limit_is_bootstrapped_there_too_and_an_end_is_not(self, mappo):
        # The numbers above hold it; here what they mean: of a step with an end the return is the
        # reward, plus the value of the last state only if time had run out.
        returns = np.array(self.PUBLIC["return"])
        step, world = np.argwhere(GIVEN["terminated"])[0]
        close(returns[step, world], GIVEN["reward"][step, world])
        step, world = np.argwhere(GIVEN["truncated"])[0]
        last = mappo.policy.state_value(torch.from_numpy(GIVEN["next_state"][step, [world]]))
        bootstrap = SETTINGS["gamma"] * last.item()
        close(returns[step, world], GIVEN["reward"][step, world] + bootstrap)

    def moved_loss(self, model: MAPPO) -> tuple[torch.Tensor, list[float]]:
        deviation = GIVEN["deviation"].reshape(model.rollout_buffer.log_probs.shape)
        model.rollout_buffer.log_probs += deviation
        (batch,) = model.rollout_buffer.get()
        loss, figures = model._loss(batch)
        return loss, figures.tolist()

    def test_losses(self, mappo):
        loss, (policy, value, entropy, _, clipped) = self.moved_loss(mappo)
        assert 0.2 < clipped < 0.8  # else clipping would not be tried
        close(clipped, self.PUBLIC["clip_fraction"])
        close(entropy, self.PUBLIC["entropy"])
        close(policy, self.PUBLIC["loss_objective"])
        close(value, self.PUBLIC["loss_critic"])
        names = ("loss_objective", "loss_entropy", "loss_critic")
        close(loss.item(), sum(self.PUBLIC[name] for name in names))

    def test_loss_of_normalized_advantages(self, mappo):
        mappo.normalize_advantage = True
        _, (policy, *_) = self.moved_loss(mappo)
        close(policy, self.PUBLIC["loss_objective_of_normalized_advantages"])

    def test_gradients(self, mappo):
        loss, _ = self.moved_loss(mappo)
        mappo.policy.optimizer.zero_grad()
        loss.backward()
        layers_close(mappo.policy.actor, self.PUBLIC["actor_gradient"], gradient=True)
        layers_close(mappo.policy.critic, self.PUBLIC["critic_gradient"], gradient=True)
        close(mappo.policy.log_std.grad, self.PUBLIC["log_std_gradient"])

    def test_networks_after_updates_with_clipped_gradients(self, mappo):
        norms = self.PUBLIC["gradient_norms"].values()
        assert all(max(own) > SETTINGS["max_grad_norm"] for own in norms)  # clipping is tried
        mappo.train()
        layers_close(mappo.policy.actor, self.PUBLIC["actor"])
        layers_close(mappo.policy.critic, self.PUBLIC["critic"])
        close(mappo.policy.log_std, self.PUBLIC["log_std"])

    def test_where_values_are_clipped_ours_is_sb3s_and_theirs_the_worse_of_both(self, mappo):
        value, returns = (np.array(self.PUBLIC[name]) for name in ("value", "return"))
        old, limit = value + GIVEN["deviation"], SETTINGS["clip_range"]
        clipped = old + (value - old).clip(-limit, limit)
        errors, clipped_errors = (value - returns) ** 2, (clipped - returns) ** 2
        worse = np.maximum(errors, clipped_errors).mean()
        close(worse, self.PUBLIC["loss_critic_of_clipped_values"])
        mappo.clip_range_vf = lambda _: limit
        mappo.rollout_buffer.values += GIVEN["deviation"].reshape(STEPS, -1)
        _, (_, loss, *_) = self.moved_loss(mappo)
        close(loss, clipped_errors.mean())
        assert loss < worse

    def test_fresh_networks_without_orthogonal_weights(self):
        initial = DOCUMENT["initial"]
        plain = {"policy_kwargs": POLICY | {"ortho_init": False}, "seed": initial["seed"]}
        policy = MAPPO("CentralizedCriticPolicy", Recorded(), n_steps=STEPS, **plain).policy
        layers_close(policy.actor, initial["actor"])
        layers_close(policy.critic, initial["critic"])
        deterministic = MADDPG("JointCriticPolicy", Recorded(), **plain).policy
        layers_close(deterministic.actor, initial["actor"])
        assert deterministic._get_constructor_parameters()["ortho_init"] is False
        for one in (policy, deterministic):
            assert not is_orthogonal(one.actor) and not is_orthogonal(one.critic)

    def test_fresh_networks_are_orthogonal_by_default(self):
        for learner, policy in ((MAPPO, "CentralizedCriticPolicy"), (MADDPG, "JointCriticPolicy")):
            made = learner(policy, Recorded(), policy_kwargs=POLICY).policy
            assert is_orthogonal(made.actor) and is_orthogonal(made.critic)


class TestMaddpg:
    """Theirs has no target of the actor; ours with the actor in its place does what theirs does."""

    PUBLIC = DOCUMENT["maddpg"]
    NETWORKS = {
        "actor": "actor",
        "critic": "joint_critic",
        "critic_target": "joint_critic_target",
    }

    @pytest.fixture
    def maddpg(self) -> MADDPG:
        model = MADDPG(
            "JointCriticPolicy",
            Recorded(),
            buffer_size=100,
            batch_size=STEPS * WORLDS,
            target_rate=SETTINGS["target_rate"],
            preactivation_penalty=0.0,  # BenchMARL has none
            **SHARED,
        )
        for ours, theirs in self.NETWORKS.items():
            load(getattr(model.policy, ours), DOCUMENT["inputs"][theirs])
        load(model.policy.actor_target, DOCUMENT["inputs"]["actor"])
        return model

    @pytest.fixture
    def batch(self) -> JointBatch:
        arrays = (
            GIVEN["observation"],
            GIVEN["state"],
            GIVEN["noise"].clip(-1.0, 1.0),
            GIVEN["reward"].mean(axis=-1),
            GIVEN["next_observation"],
            GIVEN["next_state"],
            GIVEN["terminated"].astype(np.float32),
        )
        return JointBatch(
            *(torch.from_numpy(array.reshape(-1, *array.shape[2:])) for array in arrays)
        )

    def test_losses_and_gradients(self, maddpg, batch):
        critic_loss = maddpg.critic_loss(batch, maddpg.target_values(batch))
        actor_loss = maddpg.actor_loss(batch)
        # There the one critic is held to each agent's reward, here to their mean: the same minimum
        # and gradient, and a loss that differs by the variance between agents.
        close(critic_loss.item() + GIVEN["reward"].var(axis=-1).mean(), self.PUBLIC["loss_value"])
        close(actor_loss.item(), self.PUBLIC["loss_actor"])
        critic_loss.backward(inputs=list(maddpg.policy.critic.parameters()))
        actor_loss.backward(inputs=list(maddpg.policy.actor.parameters()))
        layers_close(maddpg.policy.critic, self.PUBLIC["joint_critic_gradient"], gradient=True)
        layers_close(maddpg.policy.actor, self.PUBLIC["actor_gradient"], gradient=True)

    def test_networks_and_target_after_updates(self, maddpg, batch):
        # There the actor's loss is taken before the critic has moved, here, as by the algorithm's
        # authors, afterwards: done in their order, the numbers are theirs.
        policy, actor_loss = maddpg.policy, maddpg.actor_loss
        before = perceptron(STATE + AGENTS * ACTIONS, SETTINGS["hidden_sizes"], 1)

        def remember_critic(sampled: JointBatch) -> torch.Tensor:
            before.load_state_dict(policy.critic.state_dict())
            policy.actor_target.load_state_dict(policy.actor.state_dict())
            return MADDPG.target_values(maddpg, sampled)

        def earlier_actor_loss(sampled: JointBatch) -> torch.Tensor:
            with mock.patch.object(policy, "critic", before):
                return actor_loss(sampled)

        with (
            mock.patch.object(maddpg.replay_buffer, "size", return_value=STEPS * WORLDS),
            mock.patch.object(maddpg.replay_buffer, "sample", return_value=batch),
            mock.patch.object(maddpg, "target_values", remember_critic),
            mock.patch.object(maddpg, "actor_loss", earlier_actor_loss),
        ):
            maddpg._setup_learn(1, None)
            maddpg.train(SETTINGS["epochs"], STEPS * WORLDS)
        for ours, theirs in self.NETWORKS.items():
            layers_close(getattr(policy, ours), self.PUBLIC[theirs])


def test_the_file_knows_all_settings_of_today():
    assert SETTINGS.keys() == {*Settings.__dataclass_fields__}
