"""Reset-and-Finetune on a stock algorithm: ``python examples/reset_any_model.py``, a minute.

Stable-Baselines3's PPO swings up Gymnasium's pendulum. Once the return changes by less than 10 %
from one window of 60 episodes to the next, PPO's optimizer is cleared and its learning rate halved.
"""

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env

from orchid_uav.callbacks import ResetAndFinetune


class Returns(BaseCallback):
    """The return of every episode, and the learning rate of the update behind it."""

    def __init__(self) -> None:
        super().__init__()
        self.returns: list[float] = []
        self.learning_rates: list[float] = []

    def _on_step(self) -> bool:
        self.returns += [info["episode"]["r"] for info in self.locals["infos"] if "episode" in info]
        return True

    def _on_rollout_end(self) -> None:
        new = len(self.returns) - len(self.learning_rates)
        self.learning_rates += [self.model.lr_schedule(1.0)] * new


def train(episodes: int = 480, reset: ResetAndFinetune | None = None, seed: int = 0) -> Returns:
    """Train on four pendulums, with or without the callback."""
    env = make_vec_env("Pendulum-v1", n_envs=4, seed=seed)  # which puts a Monitor around each
    noise = {"use_sde": True, "sde_sample_freq": 4}
    settings = {"learning_rate": 1e-3, "n_steps": 1000, "batch_size": 80, "gamma": 0.9}
    model = PPO("MlpPolicy", env, seed=seed, device="cpu", **settings, **noise)
    seen = Returns()
    model.learn(episodes * 200, callback=[seen] if reset is None else [reset, seen])
    return seen


if __name__ == "__main__":
    callback = ResetAndFinetune(window=60, tolerances={"r": 0.1}, kappa=0.5)
    seen = train(reset=callback)
    for first in range(0, len(seen.returns), 40):
        mean = sum(seen.returns[first : first + 40]) / 40
        rate = seen.learning_rates[first]
        print(f"episodes {first + 1:3} to {first + 40:3}: return {mean:7.0f}, rate {rate:g}")
    print("optimizer cleared after episode:", *callback.reset_episodes)
