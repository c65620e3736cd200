"""How long training takes on this machine, measured before an ablation begins."""

import time

from stable_baselines3.common.logger import Logger

from orchid_uav.agents.imitation.dagger import Dagger
from orchid_uav.envs.interfaces.sb3_vec_env import FleetVecEnv
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.training.builders import build_model, torch_settings
from orchid_uav.experiments.training.imitation import build_dagger

_ROUNDS = 2


def seconds_per_episode(config: RunConfig) -> float:
    """Seconds that an episode and its updates take, after compilation and a first round.

    Of DAgger, whose runs count iterations, those that an iteration takes.

    Raises:
        RunFailedError: training fails in the first episodes.
    """
    worlds = config.training.worlds
    try:
        with torch_settings(config.training.threads):
            if config.training.algorithm == "dagger":
                return _seconds_per_iteration(build_dagger(config))
            env = FleetVecEnv(config.network_parameters, worlds, seed=None)
            model = build_model(config, env)  # SB3 seeds the worlds here
            model.set_logger(Logger(folder=None, output_formats=[]))
            rows = worlds * config.network.episode_slots * env.agents_per_world
            model.learn(rows, log_interval=None)  # type: ignore[arg-type]  # nothing is logged
            began_s = time.perf_counter()
            model.learn(_ROUNDS * rows, log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
            return (time.perf_counter() - began_s) / (_ROUNDS * worlds)
    except Exception as error:  # whatever a training run would record as its failure
        raise RunFailedError(f"{type(error).__name__} in the first episodes") from error


def _seconds_per_iteration(learner: Dagger) -> float:
    learner.iterate(None)  # the first is the teacher's alone
    began_s = time.perf_counter()
    for _ in range(_ROUNDS):
        learner.iterate(None)
    return (time.perf_counter() - began_s) / _ROUNDS
