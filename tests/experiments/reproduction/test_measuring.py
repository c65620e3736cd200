"""What is measured while a method is trained, and afterwards."""

import numpy as np
import pytest
import torch

from orchid_uav.callbacks import UpdateVariance
from orchid_uav.envs import Parameters, WorldBatch
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.envs.metrics import EPISODE_METRICS
from orchid_uav.envs.seeds import evaluation_seeds
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.reproduction.measuring import hover, row_of_hovering, training_curve
from orchid_uav.experiments.reproduction.settings import CURVE_SEED, CURVE_TOPOLOGIES
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS, configured
from orchid_uav.experiments.training.builders import build_model


def short(**training) -> RunConfig:
    return RunConfig.model_validate(
        {
            "network": {"episode_slots": 10},
            "ppo": {"hidden_sizes": [8], "batch_size": 8},
            "training": {"episodes": 3, "seed": 11, **training},
        }
    )


class TestHovering:
    def test_flies_the_topologies_of_the_training(self):
        config = short()
        env = FleetVecEnv(config.network_parameters, 1, seed=None)
        model = build_model(config, env)
        seen = []

        def note(local, _):
            if local["dones"].any():
                seen.append(local["infos"][0]["episode_metrics"])
            elif env.world.arrays.slot[0] == 1:
                users.append(env.world.users_m[0].copy())
            return True

        users: list = []
        model.learn(3 * 10 * 6, callback=note, log_interval=None)
        alone = WorldBatch(config.network_parameters)
        alone.seed(11)
        for known in users:
            alone.reset()
            np.testing.assert_array_equal(alone.users_m[0], known)
        hovered = hover(config)
        assert len(hovered) == len(seen) == len(users) == 3
        # Whoever flies, topologies have the same number of target users, all of them covered.
        assert [row["coverage"] for row in hovered] == [1.0] * 3

    def test_is_rewarded_at_the_progress_of_the_training(self):
        rows = hover(short(schedule_episodes=2))
        world = WorldBatch(Parameters().with_overrides({"episode_slots": 10}))
        world.seed(11)
        for row, progress in zip(rows, (0.0, 0.5, 1.0), strict=True):
            world.set_progress(progress)
            world.reset()
            for _ in range(10):
                world.step(np.zeros((1, 6, 4)))
            assert row["reward"] == pytest.approx(world.episode_metrics(0)["reward"])

    def test_flies_on_its_way_where_policies_do(self):
        config = short(episodes=100)
        row = row_of_hovering("static-mmf-uniform", "static-mmf", config)
        assert row.method == "static-mmf-uniform"
        assert list(row.evaluations) == ["50", "100"]
        world = WorldBatch(config.network_parameters, CURVE_TOPOLOGIES)
        rewards = []
        for progress in (0.5, 1.0):
            world.seed(evaluation_seeds(CURVE_SEED, CURVE_TOPOLOGIES))
            world.set_progress(progress)
            world.reset()
            for _ in range(10):
                world.step(np.zeros((CURVE_TOPOLOGIES, 6, 4)))
            each = [world.episode_metrics(number)["reward"] for number in range(CURVE_TOPOLOGIES)]
            rewards.append(np.mean(each))
        first, last = (row.evaluations[key]["reward"] for key in ("50", "100"))
        assert [first, last] == pytest.approx(rewards)


def test_a_curve_is_of_whole_blocks():
    rows = [dict.fromkeys(EPISODE_METRICS, float(number)) for number in range(25)]
    curve = training_curve(rows)
    assert curve.block == 10
    assert curve.mean["rate_jfi"] == [4.5, 14.5]
    assert curve.std["rate_jfi"] == pytest.approx([np.std(range(10), ddof=1)] * 2)
    assert training_curve(rows * 60).block == 20  # 1,500 episodes


def test_the_variance_of_updates_is_that_of_single_steps():
    config = short()
    env = FleetVecEnv(config.network_parameters, 1, seed=None)
    model = build_model(config, env)
    steps: list[np.ndarray] = []
    watcher = UpdateVariance()

    def weights() -> np.ndarray:
        parts = [weight.detach().flatten() for weight in model.policy.actor_parameters()]
        return torch.cat(parts).double().numpy().copy()

    model.policy.optimizer.register_step_pre_hook(lambda *_: steps.append(weights()))
    model.learn(2 * 10 * 6, callback=watcher, log_interval=None)
    assert len(watcher.variances) == 2
    per_update = len(steps) // 2
    assert per_update > 2
    ends = [*steps[1:], weights()]
    changes = np.array(ends) - np.array(steps)
    for update, measured in enumerate(watcher.variances):
        own = changes[update * per_update : (update + 1) * per_update]
        assert measured == pytest.approx(own.var(axis=0, ddof=1).mean(), rel=1e-9)


class TestTrainings:
    def test_have_seeds_that_nothing_was_tuned_on(self):
        assert tuple(range(10, 20)) == SEEDS
        assert {training.config(13).training.seed for training in TRAININGS.values()} == {13}

    def test_quick_ones_are_short(self):
        quick = TRAININGS["orchid"].config(10, is_quick=True)
        assert (quick.training.episodes, quick.reset.window) == (150, 15)
        assert quick.reset.enabled
        assert not TRAININGS["maddpg-mmf"].config(10, is_quick=True).reset.enabled

    def test_options_make_the_configuration(self):
        config = configured(("--objective", "pf", "--episodes", "9", "--set", "reset.kappa=0.2"))
        assert config.reward.objective == "pf"
        assert (config.training.episodes, config.reset.kappa) == (9, 0.2)
