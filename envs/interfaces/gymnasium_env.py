"""The fleet as one Gymnasium agent that flies all UAVs: ``orchid/Fleet-v0``."""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from orchid_uav.envs.interfaces.make import fleet_parameters
from orchid_uav.envs.interfaces.spaces import action_space, observation_space
from orchid_uav.envs.metrics import EPISODE_METRICS, SLOT_METRICS
from orchid_uav.envs.world import WorldBatch

Rows = NDArray[np.float32]


class FleetEnv(gymnasium.Env[Rows, Rows]):
    """Joint problem: observation (N, O), action (N, 4), reward the mean over UAVs.

    ``info["metrics"]`` holds the slot's fleet metrics, and at the end ``info["episode_metrics"]``
    the episode's. The keywords are those of :func:`orchid_uav.envs.parallel_env`.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]

    def __init__(self, *, render_mode: None = None, **keywords: Any) -> None:
        self.render_mode = render_mode
        self.world = WorldBatch(**fleet_parameters(**keywords))
        one = observation_space(self.world.parameters, self.world.own_observation_size)
        self.observation_space = batch_space(one, self.world.uav_count)
        self.action_space = batch_space(action_space(), self.world.uav_count)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Rows, dict[str, Any]]:
        """Draw a new topology and run Phase I; with a seed, the course begins anew."""
        super().reset(seed=seed)
        if seed is not None:
            self.world.seed(seed)
        self.world.reset()
        return self.world.observations()[0].copy(), {}

    def step(self, action: ArrayLike) -> tuple[Rows, float, bool, bool, dict[str, Any]]:
        """Fly one slot."""
        self.world.step(np.asarray(action)[None])
        info: dict[str, Any] = {"metrics": self.world.slot_metrics(0)}
        truncated = bool(self.world.finished[0])
        if truncated:
            info["episode_metrics"] = self.world.episode_metrics(0)
        reward = float(self.world.arrays.rewards[0].mean())
        return self.world.observations()[0].copy(), reward, False, truncated, info

    def state(self) -> Rows:
        """Global state for a centralised critic."""
        return self.world.arrays.states[0].copy()

    def snapshot(self) -> dict[str, Any]:
        """Copies of the physical state; see :meth:`WorldBatch.snapshot`."""
        return self.world.snapshot()

    def set_progress(self, progress: float) -> None:
        """Training progress tau of the weight schedules, kept across resets (default 0)."""
        self.world.set_progress(progress)


class FleetVectorEnv(VectorEnv[Rows, Rows, NDArray[Any]]):
    """Many joint problems stepped as one batch.

    ``info["metrics"]`` holds the slot's metrics as arrays over worlds, and where an episode has
    ended (``info["_episode_metrics"]``), ``info["episode_metrics"]`` its metrics. What follows an
    episode's end is Gymnasium's to define:

    * ``SAME_STEP``, the default: the next episode begins in the same step. ``info["final_obs"]``
      and ``info["final_info"]`` have the last observation and the last figures.
    * ``NEXT_STEP``: the step returns the last observation; the next one ignores the world's action,
      begins an episode and rewards 0.
    * ``DISABLED``: the caller resets, with ``options={"reset_mask": finished}``.

    Args:
        num_envs: number of worlds.
        autoreset_mode: one of the above, or its value.
        render_mode: nothing is rendered.
        keywords: those of :func:`orchid_uav.envs.parallel_env`.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": [],
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: None = None,
        **keywords: Any,
    ) -> None:
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}  # type: ignore[misc]
        self.render_mode = render_mode
        self.world = WorldBatch(**fleet_parameters(**keywords), worlds=num_envs)
        one = observation_space(self.world.parameters, self.world.own_observation_size)
        self.single_observation_space = batch_space(one, self.world.uav_count)
        self.single_action_space = batch_space(action_space(), self.world.uav_count)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Rows, dict[str, Any]]:
        """Begin an episode in every world, or where ``options["reset_mask"]`` is True.

        One seed is turned into one per world; worlds that are not reset keep their course.
        """
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_))
        if getattr(mask, "dtype", None) != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask is {mask!r}, not {self.num_envs} booleans as an array")
        chosen = np.flatnonzero(mask)
        if seed is not None:
            self.world.seed(seed, chosen)
        self.world.reset(chosen)
        return self.world.observations().copy(), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Rows, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Fly one slot in every world."""
        begun = np.zeros(self.num_envs, np.bool_)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            begun = self.world.finished
            if begun.any():
                self.world.reset(np.flatnonzero(begun))
        self.world.step_except(begun, actions)
        rewards = np.where(begun, 0.0, self.world.arrays.rewards.mean(axis=1))
        truncated = self.world.finished
        metrics = dict(zip(SLOT_METRICS, self.world.arrays.metrics.T.copy(), strict=True))
        info: dict[str, Any] = {"metrics": metrics, "_metrics": ~begun}
        if truncated.any():
            info |= self._ends(truncated)
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                info |= self._last_views(truncated, info)
                self.world.reset(np.flatnonzero(truncated))
        terminated = np.zeros(self.num_envs, dtype=np.bool_)
        return self.world.observations().copy(), rewards, terminated, truncated, info

    def _ends(self, truncated: NDArray[np.bool_]) -> dict[str, Any]:
        episodes = [self.world.episode_metrics(world) for world in range(self.num_envs)]
        metrics = {
            name: np.array([episode[name] for episode in episodes]) for name in EPISODE_METRICS
        }
        return {"episode_metrics": metrics, "_episode_metrics": truncated}

    def _last_views(self, truncated: NDArray[np.bool_], info: dict[str, Any]) -> dict[str, Any]:
        final_observations = np.empty(self.num_envs, dtype=object)
        observations = self.world.observations()
        for world in np.flatnonzero(truncated):
            final_observations[world] = observations[world].copy()
        final_info = info | {"_metrics": truncated}
        return {
            **{"final_obs": final_observations, "_final_obs": truncated},
            **{"final_info": final_info, "_final_info": truncated},
        }

    def state(self) -> Rows:
        """Global states of all worlds for a centralised critic."""
        return self.world.arrays.states.copy()

    def snapshot(self, world: int = 0) -> dict[str, Any]:
        """Copies of one world's physical state; see :meth:`WorldBatch.snapshot`."""
        return self.world.snapshot(world)

    def set_progress(self, progress: float) -> None:
        """Training progress tau of the weight schedules, kept across resets (default 0)."""
        self.world.set_progress(progress)
