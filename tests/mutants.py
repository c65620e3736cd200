"""Plant faults, each of which must turn a test red: ``make mutants``.

Each fault is one that other people's code is known for. It is planted in a copy of the package,
which the named tests then import instead of the installed one.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
ROOMS = {
    "src/orchid_uav": ".",
    "envs": "envs",
    "agents": "agents",
    "callbacks": "callbacks",
    "experiments": "experiments",
    "orchid_cli": "cli",
    "runs/reference": "reference",
}


class Mutant(NamedTuple):
    """A fault: ``old`` is replaced by ``new`` in ``file``, and ``tests`` must notice."""

    name: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = [
    Mutant(
        "radians for degrees",
        "envs/channel.py",
        "return np.degrees(arcsine(altitude_m / distance_m))",
        "return arcsine(altitude_m / distance_m)",
        "envs/test_channel.py",
    ),
    Mutant(
        "natural logarithm for log2",
        "envs/channel.py",
        "logarithm_2(1.0 + snr)",
        "np.log(1.0 + snr)",
        "envs/test_channel.py",
    ),
    Mutant(
        "sign of a level in dB",
        "envs/channel.py",
        "decibel_to_linear(-excess_db)",
        "decibel_to_linear(excess_db)",
        "envs/test_world.py",
    ),
    Mutant(
        "ten for twenty in the free-space loss",
        "envs/channel.py",
        "return ratio * ratio",
        "return ratio",
        "envs/test_channel.py",
    ),
    Mutant(
        "shares swapped",
        "envs/sharing.py",
        '{"mmf": MAX_MIN, "pf": PROPORTIONAL,',
        '{"mmf": PROPORTIONAL, "pf": MAX_MIN,',
        "envs/test_world.py",
    ),
    Mutant(
        "Jain's index over all users instead of the served",
        "envs/dynamics.py",
        "jain_index_from_sums(sum_rate, sum_rate_squared, served_count)",
        "jain_index_from_sums(sum_rate, sum_rate_squared, target_count)",
        "envs/test_world.py",
    ),
    Mutant(
        "association with the nearest UAV, whatever its altitude and power",
        "envs/association.py",
        "return is_higher & (best_case_w_m2",
        "return False & (best_case_w_m2",
        "envs/test_world.py",
    ),
    Mutant(
        "pressing against a wall counts as flight",
        "envs/dynamics.py",
        "velocity[0] = (x_m - position[0]) / slot_s",
        "velocity[0] = dx / slot_s",
        "envs/test_world.py",
    ),
    Mutant(
        "a rectangle taken for a square",
        "envs/observation.py",
        "rows_per_m = HISTOGRAM_CELLS / constants.area_size_m[1]",
        "rows_per_m = HISTOGRAM_CELLS / constants.area_size_m[0]",
        "envs/test_world.py",
    ),
    Mutant(
        "a backhaul to the first mast instead of the best",
        "envs/dynamics.py",
        "for mast in range(len(masts_m)):",
        "for mast in range(1):",
        "envs/test_world.py",
    ),
    Mutant(
        "masts that share one band",
        "envs/world.py",
        "np.take_along_axis(loads, own_mast, axis=1)",
        "loads.sum(axis=1, keepdims=True)",
        "envs/test_places.py",
    ),
    Mutant(
        "every world the same generator",
        "envs/world.py",
        "np.random.default_rng(seeds[world])",
        "np.random.default_rng(0)",
        "envs/test_world.py",
    ),
    Mutant(
        "a critic that sees one UAV only",
        "envs/observation.py",
        "    for uav in range(uavs):\n        for number",
        "    for uav in range(1):\n        for number",
        "envs/test_world.py",
    ),
    Mutant(
        "an actor that sees the state",
        "agents/mappo/policy.py",
        'return self.distribution(obs["observation"].float())',
        'return self.distribution(obs["observation"] + obs["state"][:, :16])',
        "agents/test_mappo.py",
    ),
    Mutant(
        "no bootstrap at the time limit",
        "agents/mappo/mappo.py",
        "buffer.rewards[step, row] += self.gamma * value",
        "buffer.rewards[step, row] += 0.0 * value",
        "agents/test_mappo.py",
    ),
    Mutant(
        "gamma squared for gamma lambda",
        "experiments/training/builders.py",
        "gae_lambda=ppo.gae_lambda",
        "gae_lambda=ppo.discount",
        "experiments/test_model_building.py",
    ),
    Mutant(
        "one learning rate for both networks",
        "agents/centralized_training.py",
        'group["lr"] = rate',
        'group["lr"] = self.learning_rates[0]',
        "agents/test_mappo.py",
    ),
    Mutant(
        "one clip over both gradients",
        "agents/mappo/mappo.py",
        "groups = self.policy.actor_parameters(), self.policy.critic_parameters()",
        "groups = (self.policy.actor_parameters() + self.policy.critic_parameters(),)",
        "agents/test_mappo.py",
    ),
    Mutant(
        "moments zeroed but not the step count",
        "callbacks/reset_and_finetune.py",
        "    optimizer.state.clear()",
        "    for state in optimizer.state.values():\n"
        '        state["exp_avg"].zero_()\n'
        '        state["exp_avg_sq"].zero_()',
        "callbacks/test_reset_and_finetune.py",
    ),
    Mutant(
        "a trigger that either metric fires",
        "callbacks/reset_and_finetune.py",
        "return all(\n        len(series[name])",
        "return any(\n        len(series[name])",
        "callbacks/test_reset_and_finetune.py",
    ),
    Mutant(
        "a reset that forgets the critic's rate",
        "agents/centralized_training.py",
        "self.critic_lr_schedule(progress) * scale",
        "self.critic_lr_schedule(progress) * self.scheduled_rate_scale",
        "callbacks/test_reset_and_finetune.py",
    ),
    Mutant(
        "a target from the critic itself",
        "agents/maddpg/policy.py",
        "return _joint_value(self.critic_target, next_state, actions)",
        "return _joint_value(self.critic, next_state, actions)",
        "agents/test_maddpg_update.py",
    ),
    Mutant(
        "the last state's value not discounted",
        "agents/mappo/mappo.py",
        "buffer.rewards[step, row] += self.gamma * value",
        "buffer.rewards[step, row] += value",
        "studies/test_public_batch.py",
    ),
    Mutant(
        "ratios clipped from above alone",
        "agents/mappo/mappo.py",
        "ratio.clamp(1.0 - clip_range, 1.0 + clip_range)",
        "ratio.clamp(max=1.0 + clip_range)",
        "studies/test_public_batch.py",
    ),
    Mutant(
        "a value of what follows an end",
        "agents/maddpg/maddpg.py",
        "self.gamma * (1.0 - batch.terminated) * following",
        "self.gamma * following",
        "studies/test_public_batch.py",
    ),
    Mutant(
        "a replay that runs on into the next episode",
        "agents/maddpg/maddpg.py",
        "following[key][row] = last",
        "pass",
        "agents/test_replay.py",
    ),
    Mutant(
        "a pair that blocks though the UAV loses",
        "envs/diagnostics.py",
        "return throughput_bps > enough_for_uav_bps",
        "return True",
        "envs/test_diagnostics.py",
    ),
    Mutant(
        "turns that cost nothing",
        "envs/diagnostics.py",
        "factor = load_factor(np.sqrt(change_squared) / constants.slot_s)",
        "factor = 1.0",
        "envs/test_diagnostics.py",
    ),
    Mutant(
        "topologies that depend on the kind of start",
        "envs/deployment.py",
        "np.random.default_rng([seed, START_STREAM])",
        "generator",
        "experiments/test_evaluation.py",
    ),
    Mutant(
        "a resume that forgets Adam's moments",
        "agents/learner_state.py",
        "optimizer.state[parameter][name] = torch.from_numpy(array)",
        "forgotten = torch.from_numpy(array)",
        "experiments/test_resume.py",
    ),
    Mutant(
        "a resume that forgets torch's generator",
        "experiments/training/state.py",
        'torch.set_rng_state(_tensor(states["torch"]))',
        "pass",
        "experiments/test_resume.py",
    ),
    Mutant(
        "a resume that forgets the worlds' generators",
        "envs/world.py",
        "generator.bit_generator.state = state",
        "pass",
        "experiments/test_resume.py",
    ),
    Mutant(
        "a resume that writes over the first transitions",
        "agents/maddpg/replay_buffer.py",
        'self.pos, self.full = place["pos"], place["full"]',
        'self.pos, self.full = 0, place["full"] or place["pos"] > 0',
        "experiments/test_resume.py",
    ),
    Mutant(
        "a resume that forgets the windows of the trigger",
        "callbacks/reset_and_finetune.py",
        "name: [float(value) for value in windows[name]] for name in self.tolerances",
        "name: [] for name in self.tolerances",
        "experiments/test_resume.py",
    ),
    Mutant(
        "tensors whose checksum nobody looks at",
        "src/orchid_uav/storage/tensors.py",
        "if checksum_of_file(path, largest_file(specs)) != checksum:",
        "if False:",
        "storage/test_safe_files.py",
    ),
    Mutant(
        "seals that nobody looks at",
        "src/orchid_uav/storage/files.py",
        "if not unbroken:",
        "if False:",
        "storage/test_safe_files.py",
    ),
    Mutant(
        "Bonferroni under the name of Holm",
        "experiments/statistics/comparison.py",
        "(len(tested) - rank) * p_value",
        "len(tested) * p_value",
        "experiments/test_comparison.py",
    ),
    Mutant(
        "runs that failed and count as the best",
        "experiments/statistics/comparison.py",
        "merits[np.isnan(merits)] = -np.inf",
        "merits[np.isnan(merits)] = np.inf",
        "experiments/test_comparison.py",
    ),
    Mutant(
        "jobs that were killed and stay so",
        "experiments/jobs/executor.py",
        "_MOST_KILLS = 2",
        "_MOST_KILLS = 1",
        "experiments/jobs/test_jobs.py",
    ),
    Mutant(
        "runs that are lost with their machine",
        "experiments/jobs/executor.py",
        "was_lost and self._losses[index] <= self.place.most_losses",
        "was_lost and self._losses[index] <= 0",
        "experiments/jobs/test_ray_cluster.py",
    ),
    Mutant(
        "a cluster that is joined by accident",
        "experiments/jobs/ray_cluster.py",
        "if address != AUTO:",
        "if address == AUTO:",
        "experiments/jobs/test_ray_cluster.py",
    ),
    Mutant(
        "a claim that asks for the other side",
        "experiments/reproduction/checks.py",
        'yield _strategy(SNR, LONG_PF, "higher", LONG_MMF)',
        'yield _strategy(SNR, LONG_MMF, "higher", LONG_PF)',
        "experiments/reproduction/test_claims.py",
    ),
    Mutant(
        "fairness over the wrong axis",
        "experiments/reproduction/checks.py",
        "yield from fairer_than_maddpg(settings.users(distribution))",
        "yield from fairer_than_maddpg(settings.uavs(distribution))",
        "experiments/reproduction/test_claims.py",
    ),
    Mutant(
        "a claim judged among the wrong users",
        "experiments/reproduction/checks.py",
        "yield from narrowest_efficiency(settings.uavs(distribution))",
        'yield from narrowest_efficiency(settings.uavs("tcp"))',
        "experiments/reproduction/test_claims.py",
    ),
    Mutant(
        "few and many users exchanged",
        "experiments/reproduction/checks.py",
        "few, *_, many = settings.users(distribution)",
        "many, *_, few = settings.users(distribution)",
        "experiments/reproduction/test_claims.py",
    ),
    Mutant(
        "updates before and after a reset exchanged",
        "experiments/reproduction/evidence.py",
        "np.log10(np.mean(after) / np.mean(before))",
        "np.log10(np.mean(before) / np.mean(after))",
        "experiments/reproduction/test_evidence.py",
    ),
    Mutant(
        "a difference within its margin that refutes a claim",
        "experiments/reproduction/verdicts.py",
        "and p_value_above(differences * np.sign(mean), check.margin) <= ALPHA",
        "",
        "experiments/reproduction/test_verdicts.py",
    ),
    Mutant(
        "a claim that is refuted while most of it is open",
        "experiments/reproduction/verdicts.py",
        'return "undecided" if "undecided" in findings else "does not hold"',
        'return "does not hold" if "no" in findings else "undecided"',
        "experiments/reproduction/test_verdicts.py",
    ),
]


def copy_package(directory: Path) -> Path:
    """A copy of the package below a directory, importable with that in ``PYTHONPATH``."""
    package = directory / "orchid_uav"
    for room, target in ROOMS.items():
        shutil.copytree(
            ROOT / room,
            package / target,
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    return package


def is_green(tests: Iterable[str], mutant: Mutant | None = None) -> bool:
    """Whether the tests pass on a copy of the package, with the fault planted in it if any."""
    with tempfile.TemporaryDirectory() as directory:
        package = copy_package(Path(directory))
        if mutant is not None:
            plant(mutant, package)
        finished = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", *(f"tests/{name}" for name in tests)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": directory},
            capture_output=True,
            text=True,
            check=False,
        )
        if finished.returncode not in (0, 1):  # 1: tests failed; others: they did not run
            raise SystemExit(f"pytest broke\n{finished.stdout}{finished.stderr}")
        return finished.returncode == 0


def plant(mutant: Mutant, package: Path) -> None:
    """Replace the one place that the fault is about."""
    room = next(room for room in ROOMS if mutant.file.startswith(f"{room}/"))
    path = package / ROOMS[room] / mutant.file.removeprefix(f"{room}/")
    path.write_text(faulty(mutant, path.read_text(encoding="utf-8")), encoding="utf-8")


def faulty(mutant: Mutant, text: str) -> str:
    """The text of a mutant's file with the fault in it."""
    if text.count(mutant.old) != 1:
        raise SystemExit(f"'{mutant.name}' does not apply to {mutant.file}: the code changed")
    return text.replace(mutant.old, mutant.new)


def main() -> int:
    """Try every fault, two at a time."""
    if not is_green(sorted({mutant.tests for mutant in MUTANTS})):
        raise SystemExit("the tests are red without any fault")
    with ThreadPoolExecutor(max_workers=2) as pool:
        outcomes = pool.map(lambda mutant: is_green([mutant.tests], mutant), MUTANTS)
        survivors = 0
        for mutant, has_survived in zip(MUTANTS, outcomes, strict=True):
            survivors += has_survived
            print(f"{'SURVIVED' if has_survived else 'caught':8}  {mutant.name}", flush=True)
    print(f"{len(MUTANTS) - survivors} of {len(MUTANTS)} faults caught")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
