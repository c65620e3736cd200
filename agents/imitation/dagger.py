"""DAgger: a student flies, a teacher that knows the truth says what it would have done.

Ross, Gordon, Bagnell: A reduction of imitation learning and structured prediction to no-regret
online learning (2011). The teacher is best response on the users' true positions; the student sees
an observation of what it would know, which may be wrong and late.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from orchid_uav.agents.controllers.best_response import BestResponse
from orchid_uav.agents.imitation.examples import Examples
from orchid_uav.agents.imitation.tasks import Variety, draw_task
from orchid_uav.agents.learner_state import (
    OPTIMIZER,
    WEIGHTS,
    DivergedError,
    moments_of,
    restore,
    specs_of,
    weights_of,
)
from orchid_uav.agents.networks import perceptron
from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.metrics import COUNTS, EPISODE_METRICS
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.seeds import IMITATION_STREAM
from orchid_uav.envs.world import WorldBatch
from orchid_uav.storage.tensors import Tensors, TensorSpec

WORLDS_ALIKE = 5
"""Worlds that fly the same task, so that a slot is a call for several."""
_DETERMINISTIC_LOG_STD = math.log(1e-12)


class Dagger:
    """A local policy that learns from a teacher on the flights that it flies itself.

    An iteration flies some worlds for an episode each, with the teacher at the controls in the
    first one, adds what the teacher says to the examples, and takes some gradient steps. All that
    is drawn in an iteration depends on the seed and its number alone.

    Args:
        parameters: the network; what :class:`Variety` names is drawn anew in every flight.
        worlds: flown in each iteration.
        iterations: over which the learning rate falls.
        learning_rate: at the first and at the last iteration, geometric in between.
        batch_size: examples of a gradient step.
        gradient_steps: of an iteration.
        label_every: slots from one label to the next.
        capacity: newest examples that are kept.
        decisiveness: factor on the output before tanh in flight, against what the loss leads to:
            where the student cannot know what the teacher wants, it learns the mean of the
            directions that this may be, which is shorter than each of them.
        hidden_sizes: of the network.
        seed: of everything.
        variety: of the flights.
    """

    def __init__(
        self,
        parameters: Parameters,
        worlds: int = 20,
        iterations: int = 600,
        learning_rate: tuple[float, float] = (1e-3, 5e-5),
        batch_size: int = 2048,
        gradient_steps: int = 60,
        label_every: int = 3,
        capacity: int = 400_000,
        decisiveness: float = 2.5,
        hidden_sizes: tuple[int, ...] = (192, 192),
        seed: int = 0,
        variety: Variety | None = None,
    ) -> None:
        self.parameters = parameters
        self.worlds = worlds
        self.iterations = iterations
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.gradient_steps = gradient_steps
        self.label_every = label_every
        self.decisiveness = decisiveness
        self.seed = seed
        self.variety = variety or Variety()
        trial = WorldBatch(parameters, seed=seed)
        trial.reset()
        observation_size = trial.observations().shape[-1]
        torch.manual_seed(seed)
        self.network = perceptron(observation_size, hidden_sizes, ACTION_SIZE)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=learning_rate[0])
        self.examples = Examples(capacity, observation_size, ACTION_SIZE)
        self.iteration = 0
        """Iterations that are done."""
        self.loss = math.nan
        """Mean over the last iteration's gradient steps."""
        self._teacher = BestResponse(knows_truth=True)

    @property
    def rate(self) -> float:
        """Learning rate of the iteration that was done last."""
        first, last = self.learning_rate
        share = min(max(self.iteration - 1, 0) / max(self.iterations - 1, 1), 1.0)
        return first * (last / first) ** share

    def iterate(self, folder: Path | None = None) -> dict[str, float]:
        """Fly, ask, learn; return ``EPISODE_METRICS`` over the flights.

        They are means, but for counts, which are sums.

        Args:
            folder: of the files of examples; None writes none.

        Raises:
            DivergedError: the loss is no finite number.
        """
        generator = np.random.default_rng([self.seed, self.iteration, IMITATION_STREAM])
        self.iteration += 1
        observations: list[NDArray[np.float16]] = []
        actions: list[NDArray[np.float16]] = []
        metrics = []
        for first in range(0, self.worlds, WORLDS_ALIKE):
            task = draw_task(self.parameters, generator, self.variety)
            alike = min(WORLDS_ALIKE, self.worlds - first)
            world = WorldBatch(task, alike, int(generator.integers(2**63)))
            # Within the flight, so that each gives at least one example.
            first_label = generator.integers(min(self.label_every, task.network.episode_slots))
            self._fly(world, int(first_label), observations, actions)
            metrics += [world.episode_metrics(index) for index in range(alike)]
        self.examples.add(
            self.iteration, np.concatenate(observations), np.concatenate(actions), folder
        )
        self._learn(generator)
        values = {name: [episode[name] for episode in metrics] for name in EPISODE_METRICS}
        return {
            name: float(sum(found) if name in COUNTS else np.mean(found))
            for name, found in values.items()
        }

    def _fly(
        self,
        world: WorldBatch,
        first_label: int,
        observations: list[NDArray[np.float16]],
        actions: list[NDArray[np.float16]],
    ) -> None:
        world.set_progress(1.0)
        world.reset()
        self._teacher.begin(world)
        flies_itself = self.iteration > 1
        for slot in range(world.parameters.network.episode_slots):
            seen = world.observations()
            is_labelled = slot % self.label_every == first_label
            flown = self.act(seen) if flies_itself else self._teacher.act(world)
            if is_labelled:
                wanted = self._teacher.act(world) if flies_itself else flown
                in_service = world.arrays.in_service
                observations.append(seen[in_service].astype(np.float16))
                actions.append(wanted[in_service].astype(np.float16))
            world.step(flown)

    def act(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        """Actions (..., 4) for observations (..., O)."""
        with torch.inference_mode():
            wanted = self.network(torch.from_numpy(observations))
            return torch.tanh(self.decisiveness * wanted).numpy()

    def _learn(self, generator: np.random.Generator) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = self.rate
        total = 0.0
        for _step in range(self.gradient_steps):
            rows = generator.integers(self.examples.count, size=self.batch_size)
            seen = torch.from_numpy(self.examples.observations[rows].astype(np.float32))
            wanted = torch.from_numpy(self.examples.actions[rows].astype(np.float32))
            loss = functional.mse_loss(torch.tanh(self.network(seen)), wanted)
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            self.optimizer.step()
            total += loss.item()
        self.loss = total / self.gradient_steps
        if not math.isfinite(self.loss):
            raise DivergedError(f"iteration {self.iteration}: the loss is {self.loss}")

    def actor_layers(self) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """Copies of the weights (out, in) and biases (out,) that it flies with, layer by layer."""
        linear = cast(list[torch.nn.Linear], list(self.network)[::2])
        layers = [(one.weight.detach().numpy(), one.bias.detach().numpy()) for one in linear]
        factors = [1.0] * (len(layers) - 1) + [self.decisiveness]
        return [
            (weight * np.float32(factor), bias * np.float32(factor))
            for (weight, bias), factor in zip(layers, factors, strict=True)
        ]

    def exploration_log_std(self) -> NDArray[np.float32]:
        """Log standard deviation (4,) of noise in training: none, as a finite number."""
        return np.full(ACTION_SIZE, _DETERMINISTIC_LOG_STD, np.float32)

    # What it has to remember between two iterations; the examples are in files of their own.

    def training_state(self) -> tuple[dict[str, Any], dict[str, Tensors]]:
        """Counters, and tensors by the name of the file that they belong in.

        Raises:
            DivergedError: a weight is not a finite number.
        """
        weights = weights_of(self.network, f"after iteration {self.iteration}")
        moments = moments_of(self.optimizer, list(self.network.parameters()))
        document = {"iteration": self.iteration, "examples": self.examples.document()}
        return document, {WEIGHTS: weights, OPTIMIZER: moments}

    def training_state_specs(self, document: Mapping[str, Any]) -> dict[str, dict[str, TensorSpec]]:
        """Shapes and types of the tensors that belong to counters of :meth:`training_state`."""
        parameters = list(self.network.parameters())
        return specs_of(
            self.network, parameters, range(len(parameters)) if document["iteration"] else ()
        )

    def restore_training_state(
        self, document: Mapping[str, Any], tensors: Mapping[str, Tensors], folder: Path
    ) -> None:
        """Take over a state that :meth:`training_state` gave, and read its examples.

        Raises:
            LookupError, OSError, TypeError, ValueError: the state belongs to something else.
        """
        self.examples.restore(document["examples"], folder)
        self.iteration = int(document["iteration"])
        restore(self.network, self.optimizer, list(self.network.parameters()), tensors)
