"""MADDPG's losses and updates against NumPy in float64, gradients by finite differences."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.logger import Logger

from orchid_uav.agents import MADDPG
from orchid_uav.agents.maddpg.replay_buffer import JointBatch
from tests.helpers.learners import MADDPG_NETWORKS, Clock, small_maddpg

GAMMA, RATE, PENALTY, LARGEST_NORM, EPSILON = 0.9, 0.3, 0.2, 0.05, 1e-5
STEP_SIZES = {"actor": 1e-2, "critic": 3e-2}
Networks = dict[str, list[np.ndarray]]


def perceptron(parameters: list[np.ndarray], rows: np.ndarray) -> np.ndarray:
    *hidden, last = zip(parameters[::2], parameters[1::2], strict=True)
    for weight, bias in hidden:
        rows = np.maximum(rows @ weight.T + bias, 0.0)
    return rows @ last[0].T + last[1]


def value(critic: list[np.ndarray], states: np.ndarray, actions: np.ndarray) -> np.ndarray:
    first, second = actions[:, 0], actions[:, 1]
    return perceptron(critic, np.concatenate([states, first, second], axis=1))[:, 0]


def expected_critic_loss(networks: Networks, batch: dict[str, np.ndarray]) -> float:
    next_actions = np.tanh(perceptron(networks["actor_target"], batch["next_observations"]))
    following = value(networks["critic_target"], batch["next_states"], next_actions)
    wanted = [
        reward if ended else reward + GAMMA * later
        for reward, ended, later in zip(
            batch["rewards"], batch["terminated"], following, strict=True
        )
    ]
    estimated = value(networks["critic"], batch["states"], batch["actions"])
    return float(np.mean((estimated - wanted) ** 2))


def expected_actor_loss(networks: Networks, batch: dict[str, np.ndarray]) -> float:
    before_tanh = perceptron(networks["actor"], batch["observations"])
    estimated = value(networks["critic"], batch["states"], np.tanh(before_tanh))
    return float(PENALTY * np.mean(before_tanh**2) - np.mean(estimated))


EXPECTED_LOSSES = {"critic": expected_critic_loss, "actor": expected_actor_loss}


def expected_gradient(name: str, networks: Networks, batch: dict[str, np.ndarray]) -> np.ndarray:
    gradient = []
    for array in networks[name]:
        for place in np.ndindex(array.shape):
            kept, losses = array[place], []
            for shift in (1e-6, -1e-6):
                array[place] = kept + shift
                losses.append(EXPECTED_LOSSES[name](networks, batch))
            array[place] = kept
            gradient.append((losses[0] - losses[1]) / 2e-6)
    return np.array(gradient)


class ExpectedAdam:
    def __init__(self, step_size: float) -> None:
        self.step_size, self.steps, self.mean, self.square = step_size, 0, 0.0, 0.0

    def descend(self, parameters: list[np.ndarray], gradient: np.ndarray) -> None:
        assert np.linalg.norm(gradient) > LARGEST_NORM, "nothing to clip"
        gradient = gradient * LARGEST_NORM / np.linalg.norm(gradient)
        self.steps += 1
        self.mean = 0.9 * self.mean + 0.1 * gradient
        self.square = 0.999 * self.square + 0.001 * gradient**2
        mean = self.mean / (1.0 - 0.9**self.steps)
        square = self.square / (1.0 - 0.999**self.steps)
        change = self.step_size * mean / (np.sqrt(square) + EPSILON)
        ends = np.cumsum([array.size for array in parameters])
        for array, part in zip(parameters, np.split(change, ends[:-1]), strict=True):
            np.subtract(array, part.reshape(array.shape), out=array)


def numbers_of(model: MADDPG) -> Networks:
    return {
        name: [p.detach().numpy().copy() for p in getattr(model.policy, name).parameters()]
        for name in MADDPG_NETWORKS
    }


class TestUpdate:
    @pytest.fixture
    def model(self):
        made = MADDPG(
            "JointCriticPolicy",
            Clock((4,), (True,)),
            learning_rate=STEP_SIZES["actor"],
            critic_learning_rate=STEP_SIZES["critic"],
            batch_size=5,
            gamma=GAMMA,
            target_rate=RATE,
            max_grad_norm=LARGEST_NORM,
            preactivation_penalty=PENALTY,
            policy_kwargs={"net_arch": [3, 2]},
            seed=0,
        )
        made.policy.double()
        with torch.no_grad():
            for parameter in made.policy.parameters():
                parameter.normal_(0.0, 0.8)
        return made

    @pytest.fixture
    def batches(self, model):
        """Two batches that the model draws next, for NumPy."""
        random = np.random.default_rng(1)
        shapes = [(5, 2, 4), (5, 3), (5, 2, 2), (5,), (5, 2, 4), (5, 3)]
        made = []
        for _ in range(2):
            arrays = [*(random.normal(size=shape) for shape in shapes), np.array([0, 1, 0, 0, 1.0])]
            made.append(JointBatch(*map(torch.from_numpy, arrays)))
        drawn = iter(made)
        model.replay_buffer.sample = lambda size: next(drawn)
        model.replay_buffer.pos = 5
        model.set_logger(Logger(folder=None, output_formats=[]))
        return [
            {name: tensor.numpy().copy() for name, tensor in batch._asdict().items()}
            for batch in made
        ]

    @pytest.mark.parametrize("name", ["critic", "actor"])
    def test_losses_and_their_gradients(self, model, batches, name):
        batch = JointBatch(**{key: torch.from_numpy(a) for key, a in batches[0].items()})
        wanted = [model.target_values(batch)] if name == "critic" else []
        loss = getattr(model, f"{name}_loss")(batch, *wanted)
        networks = numbers_of(model)
        expected = EXPECTED_LOSSES[name](networks, batches[0])
        assert loss.item() == pytest.approx(expected, rel=1e-12)
        loss.backward()
        gradient = [p.grad.flatten() for p in getattr(model.policy, name).parameters()]
        expected = expected_gradient(name, networks, batches[0])
        np.testing.assert_allclose(torch.cat(gradient), expected, rtol=1e-6, atol=1e-7)
        assert np.count_nonzero(np.abs(expected) > 1e-3) > 8
        # What the critic wants is a number, not a function of the networks.
        targets = (model.policy.actor_target, model.policy.critic_target)
        assert all(p.grad is None for target in targets for p in target.parameters())

    def test_two_updates_are_those_worked_out_by_hand(self, model, batches):
        networks = numbers_of(model)
        adams = {name: ExpectedAdam(size) for name, size in STEP_SIZES.items()}
        for batch in batches:
            for name in ("critic", "actor"):  # the actor follows the critic just updated
                gradient = expected_gradient(name, networks, batch)
                adams[name].descend(networks[name], gradient)
            for name in ("critic", "actor"):
                pairs = zip(networks[f"{name}_target"], networks[name], strict=True)
                networks[f"{name}_target"] = [(1 - RATE) * old + RATE * new for old, new in pairs]
        model.train(gradient_steps=2, batch_size=5)
        for name, arrays in numbers_of(model).items():
            for array, expected in zip(arrays, networks[name], strict=True):
                np.testing.assert_allclose(array, expected, rtol=1e-5, atol=1e-7, err_msg=name)
        assert model._n_updates == 2

    def test_a_step_of_one_network_leaves_the_other_and_its_adam_alone(self, model, batches):
        optimizer, seen = model.policy.optimizer, []

        def note(*_):
            norms = [
                [p.grad.norm() for p in group["params"] if p.grad is not None]
                for group in optimizer.param_groups
            ]
            state = {
                name: [
                    *(p.detach().clone() for p in getattr(model.policy, name).parameters()),
                    *(
                        tensor.clone()
                        for p in getattr(model.policy, name).parameters()
                        for tensor in optimizer.state.get(p, {}).values()
                    ),
                ]
                for name in MADDPG_NETWORKS
            }
            seen.append((norms, state))

        optimizer.register_step_pre_hook(note)
        optimizer.register_step_post_hook(note)
        model.train(gradient_steps=2, batch_size=5)
        assert len(seen) == 8
        for step, ((norms, before), (_, after)) in enumerate(
            zip(seen[::2], seen[1::2], strict=True)
        ):
            mine, others = ("actor", 0) if step % 2 else ("critic", 1), MADDPG_NETWORKS
            name, group = mine
            assert float(torch.stack(norms[group]).norm()) == pytest.approx(LARGEST_NORM, rel=1e-4)
            assert norms[1 - group] == []
            for other in others:
                pairs = zip(before[other], after[other], strict=False)
                is_same = len(before[other]) == len(after[other]) and all(
                    torch.equal(*pair) for pair in pairs
                )
                assert is_same == (other != name), f"{name} moved {other}"

    def test_the_optimizer_holds_both_networks_and_no_target(self, model):
        groups = {group["name"]: group["params"] for group in model.policy.optimizer.param_groups}
        assert list(groups) == ["actor", "critic"]
        for name, parameters in groups.items():
            own = list(getattr(model.policy, name).parameters())
            assert [id(p) for p in parameters] == [id(p) for p in own]

    def test_each_network_has_its_own_rate_whatever_its_schedule(self):
        model = small_maddpg(learning_rate=lambda left: 1e-4 * left, critic_learning_rate=2e-3)
        model.learn(20)
        assert [group["lr"] for group in model.policy.optimizer.param_groups] == [0.0, 2e-3]
