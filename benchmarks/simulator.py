"""Speed of the simulator on one core, against plain NumPy and against mobile-env.

All our cases fly 6 UAVs among 100 users, including observations and global state, with new random
actions every slot from a pool made beforehand. A world-step is one slot of one world. Unless resets
are named, the time is that of the 200 slots of an episode, without the reset before it.

The NumPy version (:mod:`benchmarks.numpy_world`) computes the same arrays from the same equations.
There are two variants: "numpy" evaluates all links, as one would usually write it; "numpy, few
links" leaves out most of them, as the compiled step does. "compiled, all links" is the compiled
step that evaluates all links. All cases except those named "fresh process" run with a C library
that keeps freed memory, which helps NumPy with its large temporaries: see
:func:`benchmarks.measuring.keep_freed_memory`.

mobile-env (PyPI) is a Gymnasium environment of a cellular network, with an object per station and
user, and loops over both. Here it has 5 fixed stations (numbers 0 to 4 of its large scenario), 100
walking users, Okumura-Hata loss, equal shares, the observation of its central agent, and random
requests for connections as actions. It has no batches, flight, propulsion or fairness, so one of
its steps is less work than one of our world-steps. It is left out where it is not installed.
"""

import importlib.metadata
import importlib.util
import time
from collections.abc import Callable
from functools import partial
from unittest import mock

import numba
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks import numpy_world
from benchmarks.measuring import Case, alternate, arguments, keep_freed_memory, ratio, report
from benchmarks.second_copy import second_copy
from orchid_uav.envs import association, channel, compilation, dynamics, make_vec_env
from orchid_uav.envs.arrays import ACTION_SIZE
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.world import WorldBatch
from studies.recording import record

WORLDS, SLOTS = 64, 200
EVALUATED = 100
"""Worlds of an evaluation, for threads."""
LARGE = ((20, 1000, 8, 20), (200, 20_000, 1, 4))
"""Larger networks: UAVs, users, worlds, slots."""
MOVING_MPS = 10.0
PROGRESS = 0.5
STATIONS_M = ((50, 100), (60, 210), (90, 60), (120, 130), (130, 215))
STATIONS_AREA_M = 300
STATION_STEPS = 50

Step = Callable[..., None]


def compiled_without_pruning() -> Step:
    """Make a compiled step whose association evaluates every link.

    Compiled code keeps the constants with which it was compiled, and its cache does not distinguish
    the two. So this makes second copies of the modules, which do not use the cache.
    """
    with (
        mock.patch.object(compilation, "compiled", numba.njit(error_model="numpy")),
        mock.patch.object(channel, "LOSS_ALLOWS_PRUNING", False),
    ):
        all_links = second_copy(association, {})
        return second_copy(dynamics, {association.__name__: all_links}).step_worlds


def batch_speed(
    batch: WorldBatch,
    pool: NDArray[np.float64],
    step: Step,
    repetition: int,
    with_reset: bool = False,
) -> float:
    """World-steps per second of one episode in every world."""
    batch.seed(repetition)
    begin_s = time.perf_counter()
    batch.reset()
    if not with_reset:
        begin_s = time.perf_counter()
    for actions in pool:
        step(batch.constants, batch.arrays, actions, PROGRESS)
    return batch.world_count * len(pool) / (time.perf_counter() - begin_s)


def threads_speed(threads: int, pool: NDArray[np.float64], repetition: int) -> float:
    """World-steps per second through :meth:`WorldBatch.step`, over some threads."""
    batch = WorldBatch(worlds=pool.shape[1], seed=repetition, threads=threads)
    batch.reset()
    begin_s = time.perf_counter()
    for actions in pool:
        batch.step(actions)
    return batch.world_count * len(pool) / (time.perf_counter() - begin_s)


def fresh_process_speed(case: Case, repetition: int) -> float:
    """The speed of a case with a C library that handles memory as in a new process."""
    keep_freed_memory(False)
    try:
        return case(repetition)
    finally:
        keep_freed_memory(True)


def interface_speed(worlds: int, pool: NDArray[np.float32], repetition: int) -> float:
    """World-steps per second through the SB3 interface, one slot short of the reset."""
    env = make_vec_env(worlds=worlds, seed=repetition)
    env.reset()
    begin_s = time.perf_counter()
    for actions in pool[: SLOTS - 1, : env.num_envs]:
        env.step(actions)
    return worlds * (SLOTS - 1) / (time.perf_counter() - begin_s)


def _mobile_env_version() -> str | None:
    try:
        return importlib.metadata.version("mobile-env")
    except importlib.metadata.PackageNotFoundError:
        return None


def mobile_env_speed(repetition: int) -> float:
    """Steps per second of mobile-env."""
    from mobile_env.core.base import MComCore  # type: ignore[import-untyped]
    from mobile_env.core.entities import (  # type: ignore[import-untyped]
        BaseStation,
        UserEquipment,
    )

    users = Parameters().network.user_count
    config = MComCore.default_config()
    area = {"width": STATIONS_AREA_M, "height": STATIONS_AREA_M}
    config |= {**area, "seed": repetition}
    config["movement_params"] |= area
    env = MComCore(
        [BaseStation(number, place, **config["bs"]) for number, place in enumerate(STATIONS_M)],
        [UserEquipment(number, **config["ue"]) for number in range(users)],
        config,
    )
    env.reset()
    generator = np.random.default_rng(repetition)
    pool = generator.integers(0, len(STATIONS_M) + 1, (STATION_STEPS, users))
    begin_s = time.perf_counter()
    for actions in pool:
        env.step(actions)
    return STATION_STEPS / (time.perf_counter() - begin_s)


def pool_of(worlds: int, uavs: int, slots: int) -> NDArray[np.float64]:
    """Random actions of an episode."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (slots, worlds, uavs, ACTION_SIZE))


def cases() -> dict[str, Case]:
    """All cases; each returns world-steps per second."""
    still, single = WorldBatch(worlds=WORLDS), WorldBatch(worlds=1)
    moving = WorldBatch(Parameters().with_overrides({"user_speed_mps": MOVING_MPS}), WORLDS)
    pool = pool_of(WORLDS, still.uav_count, SLOTS)
    many = pool_of(EVALUATED, still.uav_count, SLOTS)
    rows = pool.reshape(SLOTS, -1, ACTION_SIZE).astype(np.float32)
    compiled, numpy_step = dynamics.step_worlds, numpy_world.step_worlds
    numpy_few_links = partial(numpy_world.step_worlds, prune=True)
    large = {
        f"{uavs} x {users:,}": (
            WorldBatch(
                Parameters().with_overrides({"uav_count": uavs, "user_count": users}), count
            ),
            pool_of(count, uavs, slots),
        )
        for uavs, users, count, slots in LARGE
    }
    named: dict[str, Case] = {
        "compiled": partial(batch_speed, still, pool, compiled),
        "compiled, all links": partial(batch_speed, still, pool, compiled_without_pruning()),
        "numpy": partial(batch_speed, still, pool, numpy_step),
        "numpy, few links": partial(batch_speed, still, pool, numpy_few_links),
        "numpy, fresh process": partial(
            fresh_process_speed, partial(batch_speed, still, pool, numpy_step)
        ),
        "compiled, with resets": partial(batch_speed, still, pool, compiled, with_reset=True),
        "numpy, with resets": partial(batch_speed, still, pool, numpy_step, with_reset=True),
        "numpy, with resets, fresh process": partial(
            fresh_process_speed, partial(batch_speed, still, pool, numpy_step, with_reset=True)
        ),
        "compiled, moving users": partial(batch_speed, moving, pool, compiled),
        "numpy, moving users": partial(batch_speed, moving, pool, numpy_step),
        "compiled, 1 world": partial(batch_speed, single, pool[:, :1], compiled),
        "numpy, 1 world": partial(batch_speed, single, pool[:, :1], numpy_step),
        **{
            f"{kind}, {name}": partial(batch_speed, batch, actions, step)
            for name, (batch, actions) in large.items()
            for kind, step in (("compiled", compiled), ("numpy", numpy_step))
        },
        "step, 1 thread": partial(threads_speed, 1, many),
        "step, 2 threads": partial(threads_speed, 2, many),
        "SB3 interface": partial(interface_speed, WORLDS, rows),
        "SB3 interface, 1 world": partial(interface_speed, 1, rows),
    }
    if _mobile_env_version() is not None:
        named["mobile-env"] = mobile_env_speed
    return named


RATIOS = {
    "compiled / numpy": ("compiled", "numpy"),
    "compiled / numpy, few links": ("compiled", "numpy, few links"),
    "compiled / numpy, fresh process": ("compiled", "numpy, fresh process"),
    "compiled / numpy, with resets": ("compiled, with resets", "numpy, with resets"),
    "compiled / numpy, with resets, fresh process": (
        "compiled, with resets",
        "numpy, with resets, fresh process",
    ),
    "compiled / mobile-env": ("compiled", "mobile-env"),
    "compiled / numpy, moving users": ("compiled, moving users", "numpy, moving users"),
    "compiled / numpy, 1 world": ("compiled, 1 world", "numpy, 1 world"),
    "what sparing links brings, compiled": ("compiled", "compiled, all links"),
    "what sparing links brings, numpy": ("numpy, few links", "numpy"),
    **{
        f"compiled / numpy, {uavs} x {users:,}": (
            f"compiled, {uavs} x {users:,}",
            f"numpy, {uavs} x {users:,}",
        )
        for uavs, users, _, _ in LARGE
    },
    "2 threads / 1 thread": ("step, 2 threads", "step, 1 thread"),
    "compiled, moving users / mobile-env": ("compiled, moving users", "mobile-env"),
    "SB3 interface, 1 world / mobile-env": ("SB3 interface, 1 world", "mobile-env"),
}
"""Ratios by name: the case divided, and the case by which it is divided."""


def main() -> None:
    """Measure and report."""
    options = arguments("Speed of the simulator on one core.", repetitions=11)
    keep_freed_memory(True)
    with threadpool_limits(1):
        speeds = alternate(cases(), options.repetitions)
    ratios = {
        name: ratio(speeds, over, under)
        for name, (over, under) in RATIOS.items()
        if under in speeds
    }
    network = Parameters().network
    document = record(
        {
            "worlds": WORLDS,
            "uavs": network.uav_count,
            "users": network.user_count,
            "slots": SLOTS,
            "worlds_on_threads": EVALUATED,
            "moving_users_mps": MOVING_MPS,
            "mobile_env": _mobile_env_version(),
            "mobile_env_stations": len(STATIONS_M),
            "repetitions": options.repetitions,
        },
        world_steps_per_s=speeds,
        ns_per_link={
            f"{uavs} x {users:,}": round(1e9 / speeds[case]["median"] / uavs / users, 2)
            for case, uavs, users in (
                ("compiled", network.uav_count, network.user_count),
                *((f"compiled, {uavs} x {users:,}", uavs, users) for uavs, users, _, _ in LARGE),
            )
        },
        ratios=ratios,
    )
    rows = {name: f"{speed['median']:,.0f} world-steps/s" for name, speed in speeds.items()}
    rows |= {name: f"{value:.1f} x" for name, value in ratios.items()}
    report("Simulator, one core", rows, document, options.json)


if __name__ == "__main__":
    main()
