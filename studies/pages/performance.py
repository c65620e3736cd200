"""docs/performance.md from the committed results: ``make docs-data``."""

from collections.abc import Mapping, Sequence
from typing import Any

from studies.pages.markdown import ROOT, recorded, table
from studies.recording import read

PAGE = ROOT / "docs" / "performance.md"

INTRODUCTION = """\
# Performance

`make bench` measures this anew. All numbers here come from the JSON files under
[studies/results](../studies/results), which hold every repetition, through
`make docs-data`. Everything runs on one core. Absolute numbers belong to the machine
named. Ratios were taken side by side within one run, but they too depend on the processor.
Training beside BenchMARL's is [elsewhere](validation.md#speed-of-training).
"""

BEFORE_TEXT = """\
## Beside the code before

This code and commit `{before:.7}` in turns, every measurement a process with one thread of its own,
medians of {repetitions} repetitions. Trainings: seconds of processor time for {episodes} episodes
of the paper's configuration, with minibatches of rows unless slots are named. Simulators, by UAVs
and users: world-steps per second of the best of three episodes.
"""

BEFORE_REASONS = """\
The simulator has its own arcsine, exponential and logarithms (`envs/elementary.py`), which
vectorise, and takes users in tiles whose links stay in the processor's cache. The learner sends a
state through the critic once per minibatch, takes log densities from the noise that was drawn, and
multiplies large matrices with oneDNN where that is faster: on AMD's processors with AVX-512, which
MKL, torch's own choice, does not use there. On other processors the trainings gain less.

What the simulator says changed in the last digits only. Every mean that `orchid eval --methods
static-pf,static-mmf,static-pf-full-power,static-mmf-full-power,loiter-pf,loiter-mmf --speeds 0,10`
gives for 100 topologies agrees with that commit's to 6e-16, relatively (2026-11-27, AMD EPYC).
"""

SIMULATOR_TEXT = """\
## The simulator

{uavs} UAVs, {users} users, {slots} slots per episode, random actions, observations and state
included; {worlds} worlds unless one is named, resets left out unless named, moving users at up to
{moving_users_mps:g} m/s with a new heading every slot. A world-step is one slot of one world.
Medians of {repetitions} repetitions, in which all cases took turns.

`numpy` is [the same step on whole arrays](../benchmarks/numpy_world.py), which a
[test](../tests/studies/test_numpy_world.py) holds to the compiled one in every array. `few links`
leaves out most link evaluations, as the compiled step does (a UAV that is farther, weighted by
power, and seen lower cannot be received better); `all links` goes without that. The C library is
told to keep freed memory, as it does by itself in a process that has once freed a large array;
`fresh process` shows NumPy without that. `20 x 1,000` are UAVs and users of larger networks.
`step` is `WorldBatch.step` on {worlds_on_threads} worlds, as an evaluation calls it, over one
thread and two. `SB3 interface` is `make_vec_env(…).step`, as the learner calls it.
"""

MOBILE_ENV_TEXT = """\
`mobile-env` is PyPI's mobile-env {mobile_env} with {mobile_env_stations} stations and {users}
walking users: no flight, no propulsion, no fairness, no batch.
"""

RATIO_TEXT = """\
Ratios, each the median of the ratios within a round:
"""

LOOP_TEXT = """\
## The learning loop

`learning loop` is what `orchid train` does between its first and its last episode: the paper's
configuration with {episodes} episodes, `episodes.csv`, TensorBoard's events and the live display.
`bare updates` are as many gradient steps ({sizes} samples) with the same
networks, loss, clipping and optimizer on minibatches that lie ready: no simulator, no rollout, no
shuffling, no figures. `plain updates` are the same through torch's own layers one by one, as one
would usually write it. One torch thread, one process, medians of {repetitions} repetitions in
turns.

With slots the updates take less than half the time of those with rows, and the rollout stays: 200
slots one after the other, each of six rows through the actor. So the loop is a greater multiple of
them, though the run is shorter.
"""

SPENT_TEXT = """\
What an episode of the loop is spent on. The live display is drawn by a thread of its own, whose
time is spread over all parts.
"""

DENORMAL_TEXT = """\
Adam's averages of vanishing gradients decay into denormal numbers, which some processors compute
with many times more slowly; `orchid train` has them flushed to 0. Time of the updates per episode
over the last {denormal_last_episodes} of {denormal_episodes} episodes:
"""

MEMORY_TEXT = """\
## Memory

Greatest resident memory of `orchid train --quiet --episodes {memory_episodes}` in a process of its
own; it does not grow with the episodes. The first run after an installation compiles the simulator:
"""

EVALUATION_TEXT = """\
## Evaluation

The UAV study: {first} to {last} UAVs, {method_count} methods ({methods}), {episodes} topologies
each, {flights:,} episodes in all, from the drawing of the topologies to the metrics of every
episode. `one at a time` does the same one world after the other: SuperSuit's rows, SB3's `predict`,
the same metrics ({episodes_one_at_a_time} episode of every UAV count and method). One thread,
medians of {repetitions} repetitions in turns.
"""


SPENT_ON = """\
What is left of a learned flight is mostly the policy's
own matrix products, at the processor's rate, and the simulator's step; so the ratio stays below the
20 that were hoped for.
"""


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return table(header, rows) + "\n"


def _conditions(result: Mapping[str, Any]) -> str:
    host, versions = result["host"], result["versions"]
    names = ("python", "numpy", "numba", "torch", "stable_baselines3")
    used = ", ".join(f"{name.replace('_', '-')} {versions[name]}" for name in names)
    return (
        f"`{result['command']}`, {recorded(result)}, {host['cores']} cores, "
        f"{host['system']}; {used}.\n"
    )


def spread(case: Mapping[str, Any], scale: float, digits: int) -> list[str]:
    """Two table cells: the median of a case, and its least and greatest repetition."""
    values = [case["median"], min(case["repetitions"]), max(case["repetitions"])]
    median, low, high = (f"{value * scale:,.{digits}f}" for value in values)
    return [median, f"{low} … {high}"]


def _simulator(result: Mapping[str, Any]) -> list[str]:
    speeds = [[name, *spread(case, 1.0, 0)] for name, case in result["world_steps_per_s"].items()]
    ratios = [
        [name, f"{value:,.1f}" if value < 100 else f"{value:,.0f}"]
        for name, value in result["ratios"].items()
    ]
    links = ", ".join(
        f"{nanoseconds:.1f} at {size}" for size, nanoseconds in result["ns_per_link"].items()
    )
    return [
        SIMULATOR_TEXT.format(**result["settings"]),
        *(
            [MOBILE_ENV_TEXT.format(**result["settings"])]
            if result["settings"]["mobile_env"]
            else []
        ),
        _table(["case", "world-steps/s", "least … greatest"], speeds),
        f"Nanoseconds per link (UAV and user) of the compiled step: {links}.\n",
        RATIO_TEXT,
        _table(["ratio", "times"], ratios),
        _conditions(result),
    ]


def _before(result: Mapping[str, Any]) -> list[str]:
    rows = []
    for name, ratio in result["times_as_fast"].items():
        measured = result["results"][name]
        # Of minibatches of slots there was nothing before: they stand beside those of rows.
        former = result["results"].get(f"{name}, before", result["results"]["MAPPO, before"])
        is_training = name.startswith("MA")
        unit, digits = ("s", 1) if is_training else ("world-steps/s", 0)
        cells = [spread(case, 1.0, digits)[0] for case in (former, measured)]
        rows.append([name, unit, *cells, f"**{ratio:.2f}**"])
    return [
        BEFORE_TEXT.format(**result["settings"]),
        _table(["", "unit", "before", "now", "times as fast"], rows),
        BEFORE_REASONS,
        _conditions(result),
    ]


def _training(result: Mapping[str, Any]) -> list[str]:
    settings, ratios = result["settings"], result["ratios"]
    sizes = settings["samples_per_gradient_step"]
    size_text = "; ".join(
        f"{unit}: {len(steps)} per episode on "
        + " or ".join(str(size) for size in sorted(set(steps), reverse=True))
        for unit, steps in sizes.items()
    )
    loop = [[name, *spread(case, 1.0, 2)] for name, case in result["seconds"].items()]
    loop += [
        [name, f"**{ratio:.2f}**", ""] for name, ratio in ratios.items() if name.startswith("learn")
    ]
    spent = []
    for unit, parts in result["spent_s_per_episode"].items():
        total_s = sum(parts.values())
        spent += [
            [unit, name, f"{seconds * 1e3:.2f}", f"{seconds / total_s:.1%}"]
            for name, seconds in parts.items()
        ]
    denormal = [
        [name, *spread(case, 1e3, 1)] for name, case in result["update_phase_s_per_episode"].items()
    ]
    denormal.append(["kept / flushed", f"{ratios['updates, denormals kept / flushed']:.2f}", ""])
    memory = [[name, f"{value:,}"] for name, value in result["peak_memory_mib"].items()]
    return [
        LOOP_TEXT.format(sizes=size_text, **settings),
        _table(["", "seconds", "least … greatest"], loop),
        SPENT_TEXT,
        _table(["minibatches", "part", "ms", "share"], spent),
        DENORMAL_TEXT.format(**settings),
        _table(["", "ms per episode", "least … greatest"], denormal),
        MEMORY_TEXT.format(**settings),
        _table(["simulator", "MiB"], memory),
        _conditions(result),
    ]


def _evaluation(result: Mapping[str, Any]) -> list[str]:
    settings = result["settings"]
    uavs, methods = settings["uavs"], settings["methods"]
    flights = len(uavs) * len(methods) * settings["episodes"]
    rows = [[name, *spread(case, 1e3, 2)] for name, case in result["seconds_per_episode"].items()]
    for name, value in result["ratios"].items():
        rows.append([f"{name}, one at a time / batched", f"**{value:.1f}**", ""])
    text = EVALUATION_TEXT.format(
        **{key: value for key, value in settings.items() if key != "methods"},
        first=uavs[0],
        last=uavs[-1],
        method_count=len(methods),
        methods=", ".join(f"`{method}`" for method in methods),
        flights=flights,
    )
    return [
        text,
        _table(["", "ms per episode", "least … greatest"], rows),
        f"The whole study: **{result['study_s']:.1f} s**. {SPENT_ON}",
        _conditions(result),
    ]


def render() -> str:
    """The whole page."""
    parts = [
        INTRODUCTION,
        *_before(read("before")),
        *_simulator(read("simulator")),
        *_training(read("training")),
        *_evaluation(read("evaluation")),
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(render(), encoding="utf-8")
