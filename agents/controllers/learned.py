"""Learned policies as methods, with the noise of their training and without."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from orchid_uav.agents.controllers.controller import Actions, no_actions
from orchid_uav.agents.deployed_actor import LocalActor
from orchid_uav.envs.seeds import NOISE_STREAM
from orchid_uav.envs.world import WorldBatch


class Learned:
    """Flies every UAV by the same local actor.

    Args:
        actor: the policy.
        noise: adds the Gaussian noise of the actor's training, if given.
    """

    def __init__(self, actor: LocalActor, noise: "ExplorationNoise | None" = None) -> None:
        self.actor = actor
        self.noise = noise

    def begin(self, world: WorldBatch) -> None:
        """Draw the noise of the episode."""
        if self.noise is not None:
            self.noise.draw(world)

    def act(self, world: WorldBatch) -> Actions:
        """The policy's mean for every UAV's observation, plus noise."""
        observations = world.observations()
        actions = self.actor.act(observations.reshape(-1, observations.shape[-1])).astype(float)
        actions = actions.reshape(world.world_count, world.uav_count, -1)
        return actions if self.noise is None else actions + self.noise.now(world)


class ZeroAction:
    """The twin of a learned policy: the same start, and no action, but for the same noise."""

    def __init__(self, noise: "ExplorationNoise | None" = None) -> None:
        self.noise = noise

    def begin(self, world: WorldBatch) -> None:
        """Draw the noise of the episode."""
        if self.noise is not None:
            self.noise.draw(world)

    def act(self, world: WorldBatch) -> Actions:
        """Nothing, plus noise."""
        return no_actions(world) if self.noise is None else self.noise.now(world)


class ExplorationNoise:
    """Gaussian noise on actions, drawn for each world from its own seed.

    So a world's noise depends neither on the number of worlds nor on the policy.

    Args:
        log_std: log standard deviation (A,).
        seeds: one per world.
    """

    def __init__(self, log_std: NDArray[np.float32], seeds: Sequence[int]) -> None:
        self._std = np.exp(log_std.astype(float))
        self._seeds = seeds

    def draw(self, world: WorldBatch) -> None:
        """Draw for whole episodes of all worlds."""
        shape = (world.parameters.network.episode_slots, world.uav_count, len(self._std))
        streams = [np.random.SeedSequence(seed, spawn_key=(NOISE_STREAM,)) for seed in self._seeds]
        drawn = [np.random.default_rng(stream).standard_normal(shape) for stream in streams]
        self._noise = self._std * np.stack(drawn, axis=1)

    def now(self, world: WorldBatch) -> NDArray[np.float64]:
        """Noise (B, N, A) of the next slot."""
        return self._noise[int(world.arrays.slot[0])]
