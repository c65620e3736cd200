"""A configuration reaches the learner number by number."""

from orchid_uav.envs.vector import FleetVecEnv
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.training import build_model, build_reset_and_finetune

UNUSUAL = RunConfig.model_validate(
    {
        "network": {"episode_slots": 17, "uav_count": 2, "user_count": 9},
        "ppo": {
            "actor_learning_rate": 2e-4,
            "critic_learning_rate": 3e-3,
            "discount": 0.91,
            "gae_lambda": 0.83,
            "clip_ratio": 0.13,
            "batch_size": 33,
            "epochs": 3,
            "entropy_coef": [0.03, 0.01],
            "value_coef": 0.7,
            "max_grad_norm": 0.3,
            "hidden_sizes": [8, 9],
            "log_std_init": -1.5,
            "adam_epsilon": 1e-6,
        },
        "reset": {
            "window": 7,
            "tolerance_jfi": 0.01,
            "tolerance_reward": 0.02,
            "kappa": 0.1,
            "max_resets": 3,
        },
    }
)


def test_every_number_of_ppo_is_used():
    model = build_model(UNUSUAL, FleetVecEnv(UNUSUAL.network_parameters))
    assert model.learning_rates == (2e-4, 3e-3)
    assert (model.gamma, model.gae_lambda) == (0.91, 0.83)
    assert (model.rollout_buffer.gamma, model.rollout_buffer.gae_lambda) == (0.91, 0.83)
    assert model.clip_range(1.0) == 0.13
    assert (model.batch_size, model.n_epochs, model.n_steps) == (33, 3, 17)
    assert (model.ent_coef, model.vf_coef, model.max_grad_norm) == (0.03, 0.7, 0.3)
    assert [len(bias) for _, bias in model.policy.actor_layers()] == [8, 9, 4]
    assert model.policy.log_std.tolist() == [-1.5] * 4
    optimizer = model.policy.optimizer
    assert all(group["eps"] == 1e-6 and group["fused"] for group in optimizer.param_groups)


def test_every_number_of_the_reset_is_used():
    callback = build_reset_and_finetune(UNUSUAL)
    assert callback.window == 7
    assert (callback.tolerance_jfi, callback.tolerance_reward) == (0.01, 0.02)
    assert (callback.kappa, callback.max_resets) == (0.1, 3)
    off = UNUSUAL.model_copy(update={"reset": UNUSUAL.reset.model_copy(update={"enabled": False})})
    assert build_reset_and_finetune(off) is None


def test_defaults_are_table_i():
    config = RunConfig()
    assert (config.ppo.actor_learning_rate, config.ppo.critic_learning_rate) == (1e-4, 1e-3)
    assert (config.ppo.discount, config.ppo.gae_lambda, config.ppo.clip_ratio) == (0.99, 0.95, 0.2)
    assert (config.ppo.batch_size, config.ppo.epochs) == (128, 4)
    assert config.ppo.entropy_coef == (0.01, 0.0)
    assert config.ppo.hidden_sizes == (256, 256, 256)
    assert (config.reset.window, config.reset.kappa, config.reset.max_resets) == (50, 0.5, 1)
    assert config.reset.tolerance_jfi == config.reset.tolerance_reward == 0.05
    assert config.training.episodes == 700
