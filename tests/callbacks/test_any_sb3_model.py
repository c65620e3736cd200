"""Reset-and-Finetune on the algorithms of Stable-Baselines3 and sb3-contrib, as they come."""

from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from examples.reset_any_model import train
from gymnasium import spaces
from sb3_contrib import ARS, QRDQN, TQC, TRPO, RecurrentPPO
from stable_baselines3 import A2C, DDPG, DQN, PPO, SAC, TD3
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor

from orchid_uav.callbacks import ResetAndFinetune
from orchid_uav.callbacks.learning_rates import optimizers_of

SLOTS = 10
ON_POLICY = {"n_steps": SLOTS}
OFF_POLICY = {"learning_starts": 2 * SLOTS, "batch_size": 8, "buffer_size": 1000}
ALGORITHMS = {
    "PPO": (PPO, "Box", ON_POLICY | {"batch_size": 5}, ["policy"]),
    "A2C": (A2C, "Discrete", ON_POLICY, ["policy"]),
    "SAC": (SAC, "Box", OFF_POLICY, ["actor", "critic", "ent_coef"]),
    "SAC, temperature fixed": (SAC, "Box", OFF_POLICY | {"ent_coef": 0.1}, ["actor", "critic"]),
    "TD3": (TD3, "Box", OFF_POLICY, ["actor", "critic"]),
    "DDPG": (DDPG, "Box", OFF_POLICY, ["actor", "critic"]),
    "DQN": (DQN, "Discrete", OFF_POLICY, ["policy"]),
    "TQC": (TQC, "Box", OFF_POLICY, ["actor", "critic", "ent_coef"]),
    "QRDQN": (QRDQN, "Discrete", OFF_POLICY, ["policy"]),
    "TRPO": (TRPO, "Box", ON_POLICY | {"batch_size": 5}, ["policy"]),
}
PLATEAU = {"r": 1e9}
"""What changes less than this always plateaus."""


class Walk(gymnasium.Env[Any, Any]):
    """A random walk of ten slots, whose reward is the action taken."""

    observation_space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    def __init__(self, action: str = "Box") -> None:
        self.action_space = spaces.Box(-1.0, 1.0, (1,)) if action == "Box" else spaces.Discrete(2)
        self._slot = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self._slot = 0
        return self.observation_space.sample(), {}

    def step(self, action: Any) -> Any:
        self._slot += 1
        ends = self._slot == SLOTS
        info = {"distance": float(self._slot)}
        return self.observation_space.sample(), float(np.sum(action)), False, ends, info


def make(name: str, **changes: Any) -> Any:
    algorithm, action, options, _ = ALGORITHMS[name]
    env = Monitor(Walk(action), info_keywords=("distance",))
    env.action_space.seed(0)
    env.observation_space.seed(0)
    small: dict[str, Any] = {"policy_kwargs": {"net_arch": [8]}, "seed": 0, "device": "cpu"}
    return algorithm("MlpPolicy", env, **(small | options | changes))


class Watch(BaseCallback):
    """The learning rates of all optimizers, and how many parameters they remember something of."""

    def __init__(self) -> None:
        super().__init__()
        self.rates: list[set[float]] = []
        self.remembered: list[int] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        optimizers = optimizers_of(self.model)
        self.rates.append({group["lr"] for one in optimizers for group in one.param_groups})
        self.remembered.append(sum(len(one.state) for one in optimizers))


@pytest.mark.parametrize("name", ALGORITHMS)
def test_a_reset_clears_all_optimizers_and_the_next_update_has_lower_rates(name):
    model = make(name, learning_rate=1e-3)
    assert len(optimizers_of(model)) == len(ALGORITHMS[name][3])
    before, after = Watch(), Watch()
    callback = ResetAndFinetune(window=3, kappa=0.25, tolerances=PLATEAU)
    model.learn(10 * SLOTS, callback=[before, callback, after])
    assert callback.reset_episodes == [6]
    # SB3 writes its schedule into the groups at every update: the lower rate comes from there.
    assert before.rates[-1] == {2.5e-4}
    reset = next(
        index
        for index, remembered in enumerate(after.remembered)
        if remembered < before.remembered[index]
    )
    assert after.remembered[reset] == 0, "everything was forgotten"
    assert before.rates[reset] == {1e-3}, "until then the rates were the first ones"
    assert before.remembered[-1] > 0, "it learned on"
    assert {group["lr"] for one in optimizers_of(model) for group in one.param_groups} == {2.5e-4}


def test_an_edited_group_alone_would_be_rewritten_at_the_next_update():
    """Why the callback scales ``lr_schedule``."""
    model = make("PPO", learning_rate=1e-3)
    model.policy.optimizer.param_groups[0]["lr"] = 1e-5
    model.learn(SLOTS)
    assert model.policy.optimizer.param_groups[0]["lr"] == 1e-3


@pytest.mark.parametrize("name", ["PPO", "SAC", "DQN"])
def test_a_schedule_goes_on_below_the_factor(name):
    model = make(name, learning_rate=lambda left: 1e-3 * left)
    model.learn(10 * SLOTS, callback=ResetAndFinetune(window=2, tolerances=PLATEAU))
    [rate] = {group["lr"] for one in optimizers_of(model) for group in one.param_groups}
    assert rate == pytest.approx(0.5e-3 * model._current_progress_remaining, rel=1e-12)


@pytest.mark.parametrize("name", ["PPO", "SAC"])
def test_named_optimizers_alone_are_cleared(name):
    names = ALGORITHMS[name][3]
    model = make(name)
    seen = {}

    class Look(Watch):
        def _on_rollout_start(self) -> None:
            if callback.reset_episodes and not seen:
                seen.update({one: len(optimizers_of(self.model, [one])[0].state) for one in names})

    callback = ResetAndFinetune(window=3, tolerances=PLATEAU, optimizers=names[:1])
    model.learn(8 * SLOTS, callback=[callback, Look()])
    assert [remembered == 0 for remembered in seen.values()] == [True] + [False] * (len(names) - 1)


def test_metrics_come_from_monitor_its_keywords_and_the_logger():
    tolerances = {"r": 1e9, "l": 0.01, "distance": 0.01, "train/value_loss": 1e9}
    callback = ResetAndFinetune(window=2, tolerances=tolerances)
    make("PPO").learn(6 * SLOTS, callback=callback)
    assert callback.reset_episodes == [4]
    assert callback.state()["windows"]["l"] == [10.0, 10.0]
    assert callback.state()["windows"]["distance"] == [10.0, 10.0]
    assert len(set(callback.state()["windows"]["train/value_loss"])) == 2


def test_all_metrics_have_to_plateau():
    strict = ResetAndFinetune(window=2, tolerances={"l": 0.01, "train/value_loss": 1e-12})
    make("PPO").learn(10 * SLOTS, callback=strict)
    assert strict.reset_episodes == []
    alone = ResetAndFinetune(window=2, tolerances={"l": 0.01})
    make("PPO").learn(10 * SLOTS, callback=alone)
    assert alone.reset_episodes == [4]


def test_episodes_before_the_first_update_do_not_count_where_the_logger_is_asked():
    callback = ResetAndFinetune(window=2, tolerances={"train/critic_loss": 1e9})
    make("TD3", learning_starts=5 * SLOTS).learn(11 * SLOTS, callback=callback)
    [episode] = callback.reset_episodes
    assert episode > 5 + 2 * 2 - 1


@pytest.mark.parametrize("name", ["PPO", "SAC"])
def test_lower_rates_come_back_with_the_state_of_the_callback(tmp_path, name):
    model, first = make(name, learning_rate=1e-3), ResetAndFinetune(window=2, tolerances=PLATEAU)
    model.learn(6 * SLOTS, callback=first)
    model.save(tmp_path / "model")

    def loaded(callback: Any) -> Any:
        again = type(model).load(tmp_path / "model", env=model.get_env())
        again.learn(3 * SLOTS, callback=callback, reset_num_timesteps=False)
        return {group["lr"] for one in optimizers_of(again) for group in one.param_groups}

    assert loaded(None) == {1e-3}, "what SB3 saves knows the first rates alone"
    second = ResetAndFinetune(window=2, tolerances=PLATEAU)
    second.restore(first.state())
    assert loaded(second) == {5e-4}
    assert second.reset_episodes == [4], "one reset is all that is allowed"
    assert second.state()["episodes_done"] == 9


def test_a_recurrent_policy_too():
    env = Monitor(Walk())
    model = RecurrentPPO("MlpLstmPolicy", env, n_steps=SLOTS, batch_size=5, seed=0, device="cpu")
    callback = ResetAndFinetune(window=2, tolerances=PLATEAU)
    model.learn(5 * SLOTS, callback=callback)
    assert callback.reset_episodes == [4]
    assert model.policy.optimizer.param_groups[0]["lr"] == pytest.approx(0.5 * 3e-4)


class TestRefused:
    def test_a_model_without_an_optimizer(self):
        model = ARS("MlpPolicy", Monitor(Walk()), n_delta=2, seed=0, device="cpu")
        with pytest.raises(ValueError, match="ARS has no optimizer that could be reset"):
            model.learn(10 * SLOTS, callback=ResetAndFinetune(tolerances=PLATEAU))

    def test_an_optimizer_that_the_model_does_not_have(self):
        callback = ResetAndFinetune(tolerances=PLATEAU, optimizers=["actor"])
        with pytest.raises(ValueError, match="PPO has no optimizer 'actor': it has policy"):
            make("PPO").learn(SLOTS, callback=callback)

    def test_a_metric_that_no_episode_has(self):
        callback = ResetAndFinetune(tolerances={"reward": 0.1})
        with pytest.raises(ValueError, match="no metric 'reward': it has r, l, t, distance"):
            make("PPO").learn(2 * SLOTS, callback=callback)

    @pytest.mark.parametrize(
        ("tolerances", "told"), [({}, "names no metric"), ({"r": 0.0}, "tolerance of r is 0.0")]
    )
    def test_tolerances_that_make_no_sense(self, tolerances, told):
        with pytest.raises(ValueError, match=told):
            ResetAndFinetune(tolerances=tolerances)


def test_weights_are_kept_bit_for_bit():
    model, weights = make("PPO"), []

    class Weights(Watch):
        def _on_rollout_start(self) -> None:
            flat = [p.detach().flatten() for p in self.model.policy.parameters()]
            weights.append(torch.cat(flat))

    callback = ResetAndFinetune(window=1, tolerances=PLATEAU)
    model.learn(3 * SLOTS, callback=[Weights(), callback, Weights()])
    assert callback.reset_episodes == [2]
    assert torch.equal(weights[4], weights[5])
    assert not torch.equal(weights[2], weights[4])


def test_the_example_of_the_documentation_learns_and_is_reset():
    callback = ResetAndFinetune(window=10, tolerances={"r": 1e9})
    seen = train(40, callback)
    assert callback.reset_episodes == [20]
    assert seen.learning_rates == [1e-3] * 20 + [5e-4] * 20
    assert len(seen.returns) == 40 and max(seen.returns) < 0.0
