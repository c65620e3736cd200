"""Imitation as a run: iterations are its episodes, logged, saved and resumed like those of others.

The examples grow by a file an iteration, ``checkpoints/examples/<iteration>.safetensors``. A
checkpoint names the files that it needs, with their checksums.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from orchid_uav.agents.imitation.dagger import Dagger
from orchid_uav.agents.imitation.examples import remove_shards
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.runs.directory import Row
from orchid_uav.experiments.training.builders import schedule_episodes
from orchid_uav.experiments.training.checkpoints import CheckpointStore
from orchid_uav.experiments.training.state import TrainingState
from orchid_uav.storage.tensors import TensorSpec

EXAMPLES_FOLDER = "examples"


def build_dagger(config: RunConfig) -> Dagger:
    """The learner of a configuration."""
    dagger = config.dagger
    return Dagger(
        config.network_parameters,
        worlds=config.training.worlds,
        iterations=schedule_episodes(config),
        learning_rate=dagger.learning_rate,
        batch_size=dagger.batch_size,
        gradient_steps=dagger.gradient_steps,
        label_every=dagger.label_every_slots,
        capacity=dagger.examples,
        decisiveness=dagger.decisiveness,
        hidden_sizes=tuple(dagger.hidden_sizes),
        seed=config.training.seed,
    )


class Imitation:
    """A learner and the files of its examples, whose state can be taken and restored.

    Args:
        learner: the learner.
        checkpoints: of the run.
    """

    def __init__(self, learner: Dagger, checkpoints: CheckpointStore) -> None:
        self.learner = learner
        self._checkpoints = checkpoints
        self._folder: Path = checkpoints.folder / EXAMPLES_FOLDER
        self._first_needed: dict[int, int] = {}

    def iterate(self) -> Row:
        """An iteration, and its row of ``episodes.csv``; what does not apply is NaN."""
        metrics = self.learner.iterate(self._folder)
        return {
            "episode": self.learner.iteration,
            **metrics,
            "actor_lr": self.learner.rate,
            "critic_lr": math.nan,
            "entropy_coef": math.nan,
            "reset": 0,
        }

    def save(self, log: tuple[int, str]) -> None:
        """Save a checkpoint, and delete the files that no checkpoint needs any more.

        Args:
            log: size and SHA-256 of ``episodes.csv``.
        """
        iteration = self.learner.iteration
        self._checkpoints.save(iteration, self.state(), log)
        shards = self.learner.examples.shards
        self._first_needed[iteration] = shards[0].iteration if shards else 0
        # Of checkpoints that another process saved it is not known what they need.
        remove_shards(
            self._folder,
            before=min(self._first_needed.get(kept, 0) for kept in self._checkpoints.episodes()),
        )

    def state(self) -> TrainingState:
        """The state between two iterations."""
        document, tensors = self.learner.training_state()
        return TrainingState({"learner": document}, tensors)

    def specs(self, document: Mapping[str, Any]) -> dict[str, dict[str, TensorSpec]]:
        """Shapes and types of the tensors that belong to a document, by file and name."""
        return self.learner.training_state_specs(document["learner"])

    def restore(self, state: TrainingState) -> None:
        """Take over a state that :meth:`state` of a run with the same configuration gave.

        Raises:
            LookupError, TypeError, ValueError: the state belongs to something else, or a file of
                examples is missing or damaged.
        """
        document, tensors = state
        try:
            self.learner.restore_training_state(document["learner"], tensors, self._folder)
        except OSError as error:
            raise ValueError(f"its examples cannot be read: {error}") from error
        if self.learner.training_state()[0] != document["learner"]:
            raise ValueError("its entry on the learner does not fit this run")
        remove_shards(self._folder, after=self.learner.iteration)
