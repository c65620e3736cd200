"""Parts that a lab hands to the worlds: a channel, observations, a term of the reward.

``docs/extending.md`` shows an example of each.
"""

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np
from numba import njit
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from orchid_uav.envs.arrays import Constants
from orchid_uav.envs.compilation import digest_of

if TYPE_CHECKING:
    from orchid_uav.envs.world import WorldBatch


class Extensions(TypedDict, total=False):
    """Keywords of :class:`WorldBatch` and of everything that makes one; all may be left out."""

    air_to_ground_path_loss_db: Callable[..., Any] | None
    """Called in the compiled step as the function of this name in :mod:`orchid_uav.envs.channel`:
    ground distance and altitude in m, and then as many of its further arguments, in its order, as
    the function takes. All links are computed, as pruning rests on the built-in model."""
    observe: Callable[["WorldBatch"], NDArray[Any]] | None
    """What each UAV sees, (B, N, O), instead of the built-in observation. Only reads the world, and
    may be called several times in a slot. The state of the critic remains as it is."""
    extra_reward: Callable[["WorldBatch"], NDArray[Any]] | None
    """Added to every UAV's reward r_n after each step, (B, N), and so to the episode's reward."""


class OwnPathLoss(NamedTuple):
    """A path loss of a lab's own, ready for the compiled step."""

    compiled: Callable[..., Any]
    digest: str | None
    """Digest of all that its machine code depends on; None if that is unknown."""
    link: tuple[float, ...]
    """Arguments after distance and altitude."""


def own_path_loss(function: Callable[..., Any], constants: Constants) -> OwnPathLoss:
    """Compile a path loss, and try it on one link.

    Args:
        function: as in :class:`Extensions`.
        constants: of the worlds that it is for.

    Raises:
        ValueError: it cannot be compiled, or gives no finite number.
    """
    python = getattr(function, "py_func", function)
    name = getattr(python, "__qualname__", repr(python))
    if not inspect.isfunction(python):
        raise ValueError(f"air_to_ground_path_loss_db is {name}, not a function")
    taken = len(inspect.signature(python).parameters)
    if not 2 <= taken <= 2 + len(constants.link):
        raise ValueError(
            f"{name} takes {taken} arguments, not ground_distance_m, altitude_m and at most "
            f"{len(constants.link)} more"
        )
    link = constants.link[: taken - 2]
    compiled = njit(error_model="numpy")(python)
    try:
        loss_db = compiled(500.0, constants.max_altitude_m, *link)
    except NumbaError as error:
        raise ValueError(f"{name} cannot be compiled by numba: {error}") from error
    if not isinstance(loss_db, int | float) or not np.isfinite(loss_db):
        raise ValueError(f"{name} gives {loss_db!r} for a link of 500 m, not a finite loss in dB")
    return OwnPathLoss(compiled, digest_of(python), link)


def checked(
    name: str, values: NDArray[Any], shape: tuple[int, ...], kind: type[np.floating[Any]]
) -> NDArray[Any]:
    """What an extension gave, as an array of this kind.

    Args:
        name: of the extension.
        values: what it gave.
        shape: what is right; -1 stands for any number above 0.
        kind: type of the result.

    Raises:
        ValueError: another shape, or a number that is not finite.
    """
    array = np.asarray(values, kind)
    if array.ndim != len(shape) or any(
        size != wanted if wanted >= 0 else size < 1
        for size, wanted in zip(array.shape, shape, strict=True)
    ):
        wanted_shape = str(shape).replace("-1", "any number")
        raise ValueError(f"{name} gave shape {array.shape}, not {wanted_shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} gave a number that is not finite")
    return array
