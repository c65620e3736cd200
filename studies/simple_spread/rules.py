"""Policies that learn nothing: the ends of the scale for the learners."""

from collections.abc import Callable
from statistics import fmean

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from studies.simple_spread.task import ACTIONS, AGENTS, Policy, Settings, final_returns

Floats = NDArray[np.floating]
_POSITION_GAIN, _VELOCITY_GAIN = 10.0, 2.5


def random_actions() -> Policy:
    """Actions uniform over the action space, from a generator of its own."""
    generator = np.random.default_rng(0)
    return lambda _: generator.random((AGENTS, ACTIONS))


def no_force() -> Policy:
    """The middle of the action space, where opposite forces cancel, as with an untrained actor."""
    return lambda _: np.full((AGENTS, ACTIONS), 0.5)


def assigned_landmarks() -> Policy:
    """Each agent flies to its landmark in the shortest assignment of agents to landmarks.

    An agent observes the landmarks relative to itself (entries 4 to 9) and its velocity (0 and 1);
    the force is proportional to the distance left, minus a share of the velocity.
    """

    def act(observations: Floats) -> Floats:
        landmarks = observations[:, 4:10].reshape(AGENTS, AGENTS, 2)
        agents, chosen = linear_sum_assignment(np.linalg.norm(landmarks, axis=-1))
        force = np.zeros((AGENTS, 2))
        force[agents] = _POSITION_GAIN * landmarks[agents, chosen]
        force -= _VELOCITY_GAIN * observations[:, :2]
        actions = np.zeros((AGENTS, ACTIONS))
        actions[:, [1, 3]], actions[:, [2, 4]] = -force, force  # left and down, right and up
        return actions.clip(0.0, 1.0)

    return act


RULES: dict[str, Callable[[], Policy]] = {
    "random": random_actions,
    "no force": no_force,
    "assigned landmarks": assigned_landmarks,
}


def baselines(settings: Settings) -> dict[str, float]:
    """Mean return of every rule on the final episodes."""
    return {name: fmean(final_returns(make(), settings)) for name, make in RULES.items()}
