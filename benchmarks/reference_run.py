"""The paper's run and its policy on held-out topologies, as one committed JSON.

    orchid train
    python -m benchmarks.reference_run RUN_DIRECTORY

The learned policy is flown deterministically and with the noise of training, beside itself before
training, its zero-action twin (the same start, no action at all), and the simplest rule there is:
circling the start.
"""

import argparse
import json
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents import LocalActor, load_policy
from orchid_uav.envs import EPISODE_METRICS, WorldBatch, evaluation_seeds
from orchid_uav.envs.vector import FleetVecEnv
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.files import write_json
from orchid_uav.experiments.run_directory import EPISODE_COLUMNS, read_episodes
from orchid_uav.experiments.training import build_model

RESULTS = Path(__file__).parent / "results" / "reference_run.json"
TOPOLOGIES = 100
EVALUATION_SEED = 1_000_000
CIRCLE_RADIUS_M = 40.0
CIRCLE_SPEED_MPS = 12.0
DIGITS = 6

Actions = NDArray[np.float64]
Rule = Callable[[WorldBatch], Actions]


def learned(actor: LocalActor, noise: np.random.Generator | None) -> Rule:
    """The policy's mean, plus the Gaussian noise of training if a generator is given."""

    def act(world: WorldBatch) -> Actions:
        rows = world.arrays.observations.reshape(-1, actor.observation_size)
        actions = actor.act(rows).astype(float)
        if noise is not None:
            actions += np.exp(actor.log_std) * noise.standard_normal(actions.shape)
        return actions.reshape(world.world_count, world.uav_count, -1)

    return act


def untrained(config: RunConfig) -> LocalActor:
    """The actor that the run began with."""
    policy = build_model(config, FleetVecEnv(config.network_parameters)).policy
    return LocalActor(policy.actor_layers(), policy.log_std.detach().numpy())


def hover(world: WorldBatch) -> Actions:
    """No action at all."""
    return np.zeros((world.world_count, world.uav_count, 4))


def circle(start_m: NDArray[np.float64]) -> Rule:
    """Round the start (B, N, 3) at constant speed and full transmit power."""

    def act(world: WorldBatch) -> Actions:
        uav = world.parameters.uav
        slot_s = world.parameters.network.slot_s
        angle = CIRCLE_SPEED_MPS / CIRCLE_RADIUS_M * slot_s * (world.arrays.slot[:, None] + 1)
        offset_m = CIRCLE_RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        actions = np.zeros((world.world_count, world.uav_count, 4))
        wanted_m = start_m[..., :2] + offset_m - world.arrays.positions_m[..., :2]
        actions[..., :2] = wanted_m / uav.displacement_scale_m[:2]
        actions[..., 3] = 1.0
        return actions

    return act


def fly(config: RunConfig, make_rule: Callable[[WorldBatch], Rule]) -> dict[str, dict[str, float]]:
    """Mean and standard deviation over the held-out topologies of every figure at tau = 1."""
    seeds = evaluation_seeds(EVALUATION_SEED, TOPOLOGIES)
    world = WorldBatch(config.network_parameters, worlds=TOPOLOGIES, seed=seeds)
    world.set_progress(1.0)
    world.reset()
    rule = make_rule(world)
    for _ in range(config.network.episode_slots):
        world.step(rule(world))
    episodes = [world.episode_metrics(index) for index in range(TOPOLOGIES)]
    values = {name: [episode[name] for episode in episodes] for name in EPISODE_METRICS}
    return {
        name: {"mean": rounded(float(np.mean(found))), "std": rounded(float(np.std(found, ddof=1)))}
        for name, found in values.items()
    }


def rounded(value: float) -> float:
    """To the digits that are shown anywhere, so that the file stays small."""
    return float(f"{value:.{DIGITS}g}")


def collect(directory: Path) -> dict[str, Any]:
    """The run's record, its episodes by column, and the flights."""
    record = json.loads((directory / "run.json").read_text())
    config = RunConfig.model_validate_json((directory / "config.json").read_text())
    actor = load_policy(directory)
    rows = read_episodes(directory / "episodes.csv")
    noise = np.random.default_rng(EVALUATION_SEED)
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "command": ["orchid train", "python -m benchmarks.reference_run RUN_DIRECTORY"],
        "topologies": TOPOLOGIES,
        "evaluation_seed": EVALUATION_SEED,
        "run": {
            key: record[key]
            for key in ("command", "versions", "host", "seconds", "reset_episodes", "final")
        },
        "flights": {
            "learned, deterministic": fly(config, lambda _: learned(actor, None)),
            "learned, sampled": fly(config, lambda _: learned(actor, noise)),
            "untrained, sampled": fly(config, lambda _: learned(untrained(config), noise)),
            "zero action (hover at the start)": fly(config, lambda _: hover),
            "circle the start, full power": fly(
                config, lambda world: circle(world.arrays.positions_m.copy())
            ),
        },
        "episodes": {column: [rounded(row[column]) for row in rows] for column in EPISODE_COLUMNS},
    }


def main() -> None:
    """Write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run_directory", type=Path)
    parser.add_argument("--json", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    write_json(arguments.json, collect(arguments.run_directory))
    print(f"wrote {arguments.json}")


if __name__ == "__main__":
    main()
