"""``orchid ablate``: plans, statistics by hand, and whole studies, disturbed and undisturbed."""

import contextlib
import errno
import io
import json
import math
import os
import shlex
import shutil
import signal
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from orchid_uav import notices
from orchid_uav.callbacks import ResetAndFinetune
from orchid_uav.cli.main import main
from orchid_uav.cli.tables.ablation import comparison_rows, print_ablation, reached_rows
from orchid_uav.experiments import provenance
from orchid_uav.experiments.ablation import calibration
from orchid_uav.experiments.ablation import study as ablation_study
from orchid_uav.experiments.ablation.calibration import seconds_per_episode
from orchid_uav.experiments.ablation.design import (
    FLOWN,
    TOLERANCES,
    TRAINED,
    WINDOWS,
    Ablation,
    compare,
    describe_values,
    differing_worlds,
    late_changes,
    replayed_trigger,
    trained_values,
    world_values,
)
from orchid_uav.experiments.ablation.result import AblationResult, TriggerReplay
from orchid_uav.experiments.ablation.variants import Variant, apply_variant, assigned
from orchid_uav.experiments.errors import RunFailedError
from orchid_uav.experiments.evaluation import flights as evaluation
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import rules
from orchid_uav.experiments.jobs import choice
from orchid_uav.experiments.jobs.executor import JobEnd
from orchid_uav.experiments.statistics.intervals import MetricSummary
from orchid_uav.experiments.training.job import TrainingJob, run_one
from tests.helpers.damage import reseal
from tests.helpers.processes import (
    COLUMNS,
    TINY,
    assert_is_an_error,
    columns,
    fingerprint,
    record_of,
    tiny_config,
)

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are POSIX")

GIVE_UP_AFTER_S = 120.0
EPISODES, TOPOLOGIES = 8, 4
_BASE = TINY | {
    "ppo.actor_learning_rate": 0.01,
    "reset.window": 2,
    "reset.tolerance_jfi": 1e9,
    "reset.tolerance_reward": 1e9,
    "checkpoint.every_episodes": 2,
}
"""Reset-and-Finetune acts after episode 4 of 8."""
STUDY = [
    "ablate",
    *(f"--base={key}={json.dumps(value)}" for key, value in _BASE.items()),
    f"--episodes={EPISODES}",
    f"--topologies={TOPOLOGIES}",
]
NO_RF = Variant("no-rf", {"reset.enabled": False})


class InThisProcess:
    """An executor that starts no processes, and notes the jobs that it is given."""

    note = None
    was_stopped = False
    names: list[str] = []
    """Of all executors of a test."""

    def __init__(self, processes):
        self.processes = processes

    def check(self, folder):
        pass

    def close(self):
        pass

    def run(self, given, progress):
        progress.begin(given, 1)
        ends = []
        for job in given:
            self.names.append(job.name)
            try:
                with contextlib.redirect_stdout(io.StringIO()):
                    code, error = run_one(TrainingJob.read(Path(job.command[-1]))), None
            except RunFailedError as failure:
                code, error = 1, str(failure)
            status = {0: "completed", 130: "interrupted", 1: "failed"}[code]
            ends.append(JobEnd(job, status, code, 1, 0.0, error))
            progress.ended(ends[-1])
        progress.end()
        return ends


def hurry(patch) -> None:
    """Jobs in this process, and nothing measured; no git, and no waiting for the disk."""
    patch.setattr(choice, "LocalProcesses", InThisProcess)
    patch.setattr(InThisProcess, "names", [])
    patch.setattr(calibration, "seconds_per_episode", lambda config: 0.1)
    patch.setattr(provenance, "git_commit", lambda: None)
    patch.setattr(os, "fsync", lambda descriptor: None)


@pytest.fixture
def quick(monkeypatch):
    """As :func:`hurry` has it."""
    hurry(monkeypatch)


@pytest.fixture
def ablate(orchid, quick, tmp_path, monkeypatch):
    """Runs a study in this process, without its figures, which ``finished`` and ``grown`` have."""
    monkeypatch.chdir(tmp_path)
    for step in ("draw_learning_curves", "write_ablation_sheet"):
        monkeypatch.setattr(ablation_study, step, lambda *given, **options: None)
    return lambda *arguments: orchid(*STUDY, *arguments)


@pytest.fixture
def interrupts():
    """A shell starts background jobs, such as a whole test run, with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def study_in(path: Path, *arguments: str) -> SimpleNamespace:
    """A study that is complete, what the command printed, and the jobs that were run for it."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        hurry(patch)
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            assert main([*STUDY, *arguments, f"--out={path}"]) == 0, err.getvalue()
        names = list(InThisProcess.names)
    return SimpleNamespace(path=path, out=out.getvalue(), err=err.getvalue(), names=names)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of two seeds."""
    path = tmp_path_factory.mktemp("finished") / "study"
    return study_in(path, "--no-rf", "--seeds=0,1", "--json")


@pytest.fixture
def study(finished, tmp_path):
    """A copy of the finished study."""
    shutil.copytree(finished.path, tmp_path / "study")
    return tmp_path / "study"


def document_of(study: Path) -> dict:
    return json.loads((study / "ablation.json").read_text())


def run_of(study: Path, name: str, seed: int = 0) -> Path:
    [path] = (study / "runs").glob(f"*Z-{name}-s{seed}-????")
    return path


TIMES = {"date", "updated", "command", "versions", "seconds", "run"}


def without_times(part):
    """A document without what differs from call to call."""
    if isinstance(part, dict):
        return {key: without_times(value) for key, value in part.items() if key not in TIMES}
    return [without_times(one) for one in part] if isinstance(part, list) else part


def flown(study: Path) -> dict:
    """Of each method, and whether it is deterministic, the metrics of all topologies."""
    table = pq.read_table(study / "evaluation" / "episodes.parquet").to_pylist()
    metrics: dict = {}
    for row in table:
        metrics.setdefault((row["method"], row["deterministic"]), []).append(row)
    return metrics


# What is flown


class TestPlan:
    BASE = tiny_config(3, network__user_speed_mps=2.0)

    def test_a_run_for_every_variant_and_seed(self, tmp_path):
        ablation = Ablation(self.BASE, [NO_RF], [3, 1], 4, 0, 0.05)
        made = [
            (job.name, job.config.training.seed, job.config.reset.enabled)
            for job in ablation.jobs(tmp_path, ["orchid"])
        ]
        assert made == [
            ("base", 3, True),
            ("no-rf", 3, False),
            ("base", 1, True),
            ("no-rf", 1, False),
        ]

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("network.user_speed_mps=15", {"network.user_speed_mps": 15.0}),
            ("rotor.disc_area_m2=0.6", {"rotor.disc_area_m2": 0.6}),
            ("reset.kappa=0.1", {}),
            ("ppo.epochs=2", {}),
            ("network.shares=pf", {}),
            ("deployment.init=random", {}),
            ("reward.coverage_weight=9", {}),
        ],
    )
    def test_the_world_of_a_variant_is_what_flights_depend_on(self, text, expected):
        [variant] = assigned([text])
        assert world_values(apply_variant(variant, self.BASE), self.BASE) == expected
        ablation = Ablation(self.BASE, [variant], [0], 4, 0, 0.05)
        assert differing_worlds(ablation) == ({variant.name: list(expected)} if expected else {})

    def test_worlds_have_topologies_of_their_own_and_rewards_have_not(self, monkeypatch):
        original, seen = evaluation._fly_batch, {}

        def spy(contender, parameters, topologies, *others):
            seen[contender.key] = (topologies.users_m, parameters)
            return original(contender, parameters, topologies, *others)

        monkeypatch.setattr(evaluation, "_fly_batch", spy)
        rule = rules()["static-mmf"]
        contenders = [rule] + [
            replace(rule.with_overrides({key: value}), key=key)
            for key, value in (
                ("network.scatter_std_m", 5.0),
                ("network.user_speed_mps", 15.0),
                ("reward.coverage_weight", 9.0),
            )
        ]
        network = self.BASE.network
        setting = Setting("tcp", network.uav_count, network.user_count, 2.0, 1.0)
        evaluate(EvaluationPlan(contenders, [setting], 3, 0, self.BASE.network_parameters))
        own, _ = seen["static-mmf"]
        assert not np.array_equal(seen["network.scatter_std_m"][0], own)
        assert np.array_equal(seen["network.user_speed_mps"][0], own)
        assert np.array_equal(seen["reward.coverage_weight"][0], own)
        assert seen["network.user_speed_mps"][1].network.user_speed_mps == 15.0


# Statistics by hand


def log(**series):
    """Rows of a run; metrics that are not given are 0."""
    count = len(next(iter(series.values())))
    metrics = dict.fromkeys(COLUMNS, [0.0] * count) | series
    return [{name: values[row] for name, values in metrics.items()} for row in range(count)]


class TestStatistics:
    def test_late_changes_are_last_minus_settled_episodes(self):
        steps = [float(episode) for episode in range(1, 271)]
        # Means: of 221..270 it is 245.5, of 151..200 it is 175.5.
        runs = [
            log(reward=steps),
            log(reward=[2.0 * step for step in steps]),
            [],
        ]
        found = late_changes({"base": runs, "no-rf": runs[:1]})
        assert found["base"]["reward"].mean == pytest.approx((70.0 + 140.0) / 2)
        assert (found["base"]["reward"].n, found["base"]["reward"].failed) == (2, 1)
        assert found["no-rf"]["reward"].mean == pytest.approx(70.0)
        assert found["base"]["coverage"].mean == 0.0
        assert set(found["base"]) == set(TRAINED)

    @pytest.mark.parametrize(("length", "is_known"), [(249, False), (250, True)])
    def test_late_changes_need_fifty_episodes_behind_the_settled_ones(self, length, is_known):
        logs = {"base": [log(reward=[1.0] * 300)], "no-rf": [[], log(reward=[1.0] * length)]}
        assert (late_changes(logs) is not None) is is_known
        assert late_changes({"base": [[]]}) is None

    def test_trained_values_are_means_of_the_last_fifty_episodes(self):
        found = trained_values([log(reward=[100.0] * 9 + [1.0, 3.0] * 25), [], log(reward=[5.0])])
        assert found["reward"][0] == 2.0
        assert math.isnan(found["reward"][1])
        assert found["reward"][2] == 5.0
        assert set(found) == set(TRAINED)

    @settings(max_examples=15, deadline=None)
    @given(st.integers(0, 2**32 - 1), st.integers(1, 230), st.floats(0.0, 0.2))
    def test_the_replayed_trigger_is_what_the_callback_would_have_done(self, seed, length, noise):
        generator = np.random.default_rng(seed)
        jfi, reward = 1.0 + noise * generator.standard_normal((2, length)).cumsum(axis=1)
        runs = [log(rate_jfi=jfi.tolist(), reward=reward.tolist()), []]
        table = replayed_trigger(runs)
        assert [(row.window, row.tolerance) for row in table] == [
            (window, tolerance) for window in WINDOWS for tolerance in TOLERANCES
        ]
        for row in table:
            window, tolerance = row.window, row.tolerance
            fired = []
            for end in range(2 * window, length + 1):
                old, new = (
                    np.array([jfi, reward])[:, end - back * window : end - (back - 1) * window]
                    for back in (2, 1)
                )
                change = abs(new.mean(axis=1) - old.mean(axis=1)) / abs(old.mean(axis=1))
                if (change < tolerance).all():
                    fired.append(end)
            expected = (1, 1, fired[0]) if fired else (1, 0, None)
            assert (row.runs, row.fired, row.median_episode) == expected
            callback = ResetAndFinetune(window, tolerance, tolerance, clear_optimizer=False)
            callback.model = SimpleNamespace(learning_rate_scale=1.0)
            callback._on_episodes(runs[0])
            assert callback.reset_episodes == fired[:1]

    def test_the_replayed_trigger_counts_runs_and_gives_their_median_episode(self):
        flat, rising = [1.0] * 40, [1.1**step for step in range(40)]
        late = rising[:10] + [3.0] * 30  # flat windows of 10 from episode 30 on
        runs = [log(rate_jfi=jfi, reward=flat) for jfi in (flat, flat, late, rising)]
        found = {(row.window, row.tolerance): row for row in replayed_trigger([*runs, []])}
        assert found[10, 0.01] == TriggerReplay(
            window=10, tolerance=0.01, runs=4, fired=3, median_episode=20
        )
        assert found[25, 0.05].fired == 0

    def test_a_margin_is_a_share_of_the_bases_mean(self):
        base = {"utility": [2.0, 2.2, 1.8, 2.0, 2.0, math.nan], "coverage": [0.0] * 6}
        own = {"utility": [2.0, 2.2, 1.8, 2.0, 2.1, 2.0], "coverage": [0.0] * 6}
        found = compare({"base": base, "own": own}, ("utility", "coverage"), 0.1)
        assert set(found) == {"own"}
        assert found["own"]["utility"].equivalence.margin == pytest.approx(0.2)
        assert found["own"]["coverage"].equivalence is None  # of 0 there is no share
        assert found["own"]["utility"].n == 5
        assert found["own"]["utility"].failed_base == 1

    def test_metrics_of_one_variant_are_one_family(self):
        base = {metric: [0.0] * 8 for metric in ("utility", "coverage")}
        # All eight differences have one sign: p = 2/2^8, twice that in a family of two.
        own = {"utility": [1.0 + seed for seed in range(8)], "coverage": [-1.0, 1.0] * 4}
        alone = compare({"base": base, "own": own}, ("utility", "coverage"), 0.05)
        found = compare({"base": base, "own": own, "same": own}, ("utility", "coverage"), 0.05)
        assert alone["own"]["utility"].p_holm == pytest.approx(2 * 2 / 2**8)
        assert alone["own"]["utility"].verdict == "better"
        assert found["own"] == found["same"] == alone["own"]

    def test_more_reward_is_better(self):
        base = {"reward": [0.0] * 8}
        found = compare({"base": base, "own": {"reward": [1.0] * 8}}, ["reward"], 0.05)
        assert found["own"]["reward"].better == "higher"

    def test_rewards_of_another_function_are_shown_and_not_judged(self):
        base = {"reward": [0.0] * 8, "rate_jfi": [0.0] * 8}
        own = {"reward": [1.0] * 7 + [math.nan], "rate_jfi": [1.0] * 8}
        values = {"base": base, "own": own, "pf": own}
        found = compare(values, ("reward", "rate_jfi"), 0.05, ["pf"])
        assert found["own"]["reward"].verdict == "undecided"  # a run failed
        reward = found["pf"]["reward"]
        assert list(reward.to_json()) == list(found["own"]["reward"].to_json())
        assert reward.verdict == "not compared"
        assert (reward.n, reward.failed_base, reward.failed_variant) == (7, 0, 1)
        assert reward.difference.mean is reward.p_holm is reward.equivalence is None
        # It belongs to no family: the others are judged as if it were not there.
        alone = compare({"base": base, "pf": own}, ("rate_jfi",), 0.05)
        assert found["pf"]["rate_jfi"] == alone["pf"]["rate_jfi"]
        document = SimpleNamespace(
            values={"training": describe_values(values)}, comparisons={"training": found}
        )
        [row] = [row for row in comparison_rows(document, "training") if row[6] == "not compared"]
        assert row[:7] == ["pf", "reward", "-", "-", "-", "-", "not compared"]
        assert row[7:] == ["0.0", "1.0", "7 (1 of the variant failed)"]

    def test_the_objective_makes_rewards_another_function(self):
        base = tiny_config()
        variants = [
            Variant("pf", {"reward.objective": "pf"}),
            Variant("se", {"network.shares": "se"}),
        ]
        ablation = Ablation(base, variants, [0], 1, 0, 0.05)
        assert ablation.rewarded_otherwise() == ["pf"]

    def test_values_are_described_by_variant_and_metric(self):
        found = describe_values({"base": {"utility": [1.0, 2.0, 3.0, 4.0, 50.0, math.nan]}})
        assert found["base"]["utility"].iqm == 3.0  # of 2, 3, 4
        assert found["base"]["utility"].mean == 12.0
        assert found["base"]["utility"].failed == 1


# How long it takes


class TestCalibration:
    @pytest.mark.parametrize("algorithm", ["mappo", "maddpg"])
    def test_is_a_positive_time_and_leaves_no_files(self, tmp_path, monkeypatch, algorithm):
        monkeypatch.chdir(tmp_path)
        config = tiny_config(training__algorithm=algorithm, training__worlds=2)
        began_s = time.perf_counter()
        assert 0.0 < seconds_per_episode(config) < (time.perf_counter() - began_s) / 4
        assert not list(tmp_path.iterdir())

    def test_a_configuration_that_diverges_at_once_is_told(self):
        with pytest.raises(RunFailedError, match="in the first episodes"):
            seconds_per_episode(tiny_config(ppo__actor_learning_rate=1e30))


# Wrong input


class TestInput:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            ((), ["nothing to compare", "--no-rf"]),
            (("--controls", "frosen"), ["'frosen'", "did you mean 'frozen'"]),
            (("--init", "kmeans"), ["'init-kmeans' is the same as the base"]),
            (("--init", "nowhere"), ["deployment.init", "nowhere"]),
            (("--kappa", "a"), ["--kappa 'a' is not a number"]),
            (("--set", "reset.kapa=1"), ["did you mean 'reset.kappa'"]),
            (("--set", "reset.kappa"), ["--set reset.kappa is not of the form"]),
            (("--no-rf", "--base", "reset.kappa"), ["--base reset.kappa is not of the form"]),
            (("--no-rf", "--margin", "0"), ["--margin 0.0"]),
            (("--no-rf", "--margin", "nan"), ["--margin nan"]),
            (("--no-rf", "--margin", "inf"), ["--margin inf"]),
            (("--no-rf", "--seeds", "-1"), ["--seeds -1"]),
            (("--no-rf", "--topologies", "0"), ["--topologies"]),
            (("--no-rf", "--jobs", "0"), ["0 jobs at once"]),
        ],
    )
    def test_that_is_wrong_is_told_before_anything_is_made(
        self, orchid, tmp_path, monkeypatch, arguments, parts
    ):
        monkeypatch.chdir(tmp_path)
        assert_is_an_error(orchid(*STUDY, *arguments), *parts)
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        "content",
        [None, "{", "[]", "{}", '{"settings": []}', '{"settings": {"base": {}}}'],
    )
    def test_a_directory_with_other_content_is_left_alone(self, ablate, tmp_path, content):
        out = tmp_path / "out"
        out.mkdir()
        (out / "thesis.tex").write_text("ten years of work")
        if content is not None:
            (out / "ablation.json").write_text(content)
        before = fingerprint(out)
        finished = ablate("--no-rf", f"--out={out}")
        assert_is_an_error(finished, f"--out {out} holds no ablation, and is left alone")
        assert fingerprint(out) == before

    def test_a_file_in_the_place_of_the_directory_is_left_alone(self, ablate, tmp_path):
        out = tmp_path / "out"
        out.write_text("ten years of work")
        assert_is_an_error(ablate("--no-rf", f"--out={out}"), "holds no ablation")
        assert out.read_text() == "ten years of work"

    @pytest.mark.parametrize(
        ("other", "named"),
        [
            (["--episodes=9"], "another base"),
            (["--topologies=5"], "another topologies"),
            (["--evaluation-seed=1", "--margin=0.1"], "another evaluation_seed, margin"),
        ],
    )
    def test_another_base_in_the_same_directory_is_refused(self, ablate, study, other, named):
        before = fingerprint(study)
        assert_is_an_error(ablate("--no-rf", f"--out={study}", *other), str(study), named)
        assert fingerprint(study) == before


# Whole studies


class TestFinished:
    def test_prints_its_document_alone_on_stdout(self, finished):
        document = json.loads(finished.out)  # which nothing can follow
        assert document == document_of(finished.path)
        assert document["status"] == "completed"
        assert document["settings"]["variants"] == {"no-rf": {"reset.enabled": False}}
        assert "seeds 0, 1\n" in finished.err
        assert (
            "base, no-rf: 2 x 2 seeds = 4 runs of 8 episodes, 0 of them already done"
            in finished.err
        )
        assert "if it stops, continue with: orchid ablate --base=" in finished.err

    def test_leaves_runs_flights_curves_and_nothing_unknown(self, finished):
        assert {path.name for path in finished.path.iterdir()} == {
            "ablation.json",
            "learning_curves.png",
            "index.html",
            "runs",
            "jobs",
            "evaluation",
        }
        assert (finished.path / "learning_curves.png").read_bytes().startswith(b"\x89PNG")
        page = (finished.path / "index.html").read_text(encoding="utf-8")
        assert '<img src="learning_curves.png"' in page and "base, no-rf" in page
        for name, seed in (("base", 0), ("base", 1), ("no-rf", 0), ("no-rf", 1)):
            record = record_of(run_of(finished.path, name, seed))
            assert record["status"] == "completed"
            assert record["command"][:2] == ["orchid", "ablate"]
            assert record["reset_episodes"] == ([4] if name == "base" else [])

    def test_runs_of_a_seed_are_the_same_until_reset_and_finetune_acts(self, finished):
        for seed in (0, 1):
            base, own = (
                columns(run_of(finished.path, name, seed))["reward"] for name in ("base", "no-rf")
            )
            assert base[:5] == own[:5]  # the reset comes between the updates on 4 and on 5
            assert base[5:] != own[5:]

    def test_all_fly_the_same_topologies(self, finished):
        metrics = flown(finished.path)
        policies = {f"{name}-s{seed}" for name in ("base", "no-rf") for seed in (0, 1)}
        silent = {("base-s0-zero", True), ("no-rf-s0-zero", True)}
        noisy = {(f"{key}-zero", False) for key in policies}
        rules = {(key, True) for key in ("static-mmf", "loiter-mmf", "balanced-loiter")}
        sampled = {(key, False) for key in policies}
        assert set(metrics) == {(key, True) for key in policies} | sampled | silent | noisy | rules
        seeds = [row["seed"] for row in metrics["base-s0", True]]
        assert len(set(seeds)) == TOPOLOGIES
        for rows in metrics.values():
            assert [row["seed"] for row in rows] == seeds
        # What does nothing does the same on the same topologies.
        for metric in FLOWN:
            zero, again = (
                [row[metric] for row in metrics[f"{name}-s0-zero", True]]
                for name in ("base", "no-rf")
            )
            assert zero == again

    def test_a_table_of_tabs_has_the_effect_first(self, ablate, study):
        finished = ablate("--no-rf", "--seeds=0,1", f"--out={study}")
        assert finished.code == 0
        assert "4 of them already done" in finished.out
        lines = [line.split("\t") for line in finished.out.splitlines()]
        heads = (
            "variant|metric|difference [95 %]|relative|P(better)|p (Holm)|verdict|base|variant's"
        )
        assert lines.count([*heads.split("|"), "seeds"]) == 3
        metrics = flown(study)
        means = {
            (name, seed): np.mean([row["utility"] for row in metrics[f"{name}-s{seed}", True]])
            for name in ("base", "no-rf")
            for seed in (0, 1)
        }
        effect = np.mean([means["no-rf", seed] - means["base", seed] for seed in (0, 1)])
        [row, _] = [line for line in lines if line[:2] == ["no-rf", "utility"]]
        assert row[2] == f"{effect:+.4f}"
        assert row[-1] == "2"
        [base] = [line for line in lines if line[0] == "base"]
        assert base[-1] == f"{np.mean([means['base', 0], means['base', 1]]):.3f}"
        assert {"base, no actions", "base, noise alone", "static-mmf"} <= {row[0] for row in lines}
        assert f"completed: {study}" in finished.out

    @pytest.mark.parametrize("width", [80, 140])
    def test_tables_of_a_terminal_fit_it_and_keep_their_words(self, finished, width):
        screen = io.StringIO()
        out = Console(file=screen, width=width, force_terminal=True, color_system=None)
        print_ablation(out, AblationResult.from_json(document_of(finished.path)))
        lines = [line.rstrip() for line in screen.getvalue().splitlines()]
        assert max(map(len, lines)) <= width
        heads = [line for line in lines if line.startswith("metric ")]
        assert len(heads) == 3
        for name in ("difference [95 %]", "P(better)", "p (Holm)", "verdict"):
            assert name in heads[0]
        assert len(heads[0]) <= width
        assert "no-rf, pairs of seeds: 2" in lines
        assert sum(line.endswith("undecided") for line in lines) == 3 * 6


@pytest.fixture(scope="module")
def grown(finished, tmp_path_factory):
    """The finished study with three more seeds and two more variants, one in a world of its own."""
    path = tmp_path_factory.mktemp("grown") / "study"
    shutil.copytree(finished.path, path)
    more = ["--controls=frozen", "--set=network.user_speed_mps=15", "--seeds=0..4"]
    return study_in(path, "--no-rf", *more)


WALKING = "network.user_speed_mps-15"


class TestGrown:
    def test_finished_runs_are_kept(self, grown, finished):
        before, after = (fingerprint(study.path / "runs") for study in (finished, grown))
        assert {name: after[name] for name in before} == before
        expected = {f"{name}-s{seed}" for name in ("frozen", WALKING) for seed in range(5)}
        expected |= {f"{name}-s{seed}" for name in ("base", "no-rf") for seed in (2, 3, 4)}
        assert Counter(grown.names) == Counter(expected)
        assert "4 of them already done" in grown.out
        document = document_of(grown.path)
        assert document["status"] == "completed"
        assert len(document["runs"]) == 20

    @pytest.mark.parametrize("is_deterministic", [True, False])
    def test_flown_metrics_are_means_over_topologies_compared_by_seed(
        self, grown, is_deterministic
    ):
        document, metrics = document_of(grown.path), flown(grown.path)
        kind = "evaluation" if is_deterministic else "sampled"
        names = ["base", "no-rf", "frozen", WALKING]
        for metric in FLOWN:
            means = {
                name: np.array(
                    [
                        np.mean(
                            [row[metric] for row in metrics[f"{name}-s{seed}", is_deterministic]]
                        )
                        for seed in range(5)
                    ]
                )
                for name in names
            }
            assert_compared(document, kind, metric, means)

    def test_trained_metrics_are_means_of_the_last_episodes(self, grown):
        document = document_of(grown.path)
        names = ["base", "no-rf", "frozen", WALKING]
        for metric in TRAINED:
            means = {
                name: np.array(
                    [
                        np.mean(columns(run_of(grown.path, name, seed))[metric][-50:])
                        for seed in range(5)
                    ]
                )
                for name in names
            }
            assert_compared(document, "training", metric, means)

    def test_a_variant_with_another_world_flies_in_its_own(self, grown, orchid, tmp_path):
        assert f"note: {WALKING} is flown in its own world, which differs in {WALKING[:-3]}" in (
            grown.err
        )
        metrics = flown(grown.path)
        world = ["--set=network.episode_slots=10", "--uavs=2", "--users=20", "--no-figures"]
        for name, speed in ((WALKING, 15), ("base", 0)):
            flight = orchid(
                *("eval", run_of(grown.path, name), "--methods=static-mmf", *world, "--json"),
                *(f"--speeds={speed}", f"--episodes={TOPOLOGIES}", f"--out={tmp_path / name}"),
            )
            rule, own, _ = json.loads(flight.out)["results"]
            for metric in FLOWN:
                mean = np.mean([row[metric] for row in metrics[f"{name}-s0", True]])
                assert own[metric]["mean"] == pytest.approx(mean, rel=1e-12)
            utilities = [row["utility"] for row in metrics["static-mmf", True]]
            is_same_world = rule["utility"]["mean"] == pytest.approx(np.mean(utilities), rel=1e-12)
            assert is_same_world == (name == "base")

    def test_a_frozen_policy_is_the_one_it_began_with(self, grown):
        rewards = {
            name: columns(run_of(grown.path, name))["reward"][0] for name in ("base", "frozen")
        }
        assert rewards["base"] == rewards["frozen"]
        assert set(columns(run_of(grown.path, "frozen"))["actor_lr"]) == {0.0}

    def test_the_trigger_is_replayed_where_it_was_off(self, grown):
        document = document_of(grown.path)
        assert set(document["replayed_trigger"]) == {"no-rf", "frozen"}
        assert {row["runs"] for row in document["replayed_trigger"]["frozen"]} == {5}
        assert document["late_changes"] is None  # of 8 episodes

    def test_fewer_seeds_of_it_are_described_as_they_were(self, grown, ablate, finished, tmp_path):
        shutil.copytree(grown.path, tmp_path / "study")
        assert ablate("--no-rf", "--seeds=0,1", f"--out={tmp_path / 'study'}").code == 0
        assert InThisProcess.names == []
        assert without_times(document_of(tmp_path / "study")) == without_times(
            document_of(finished.path)
        )


def assert_compared(document, kind, metric, means) -> None:
    """A document holds what follows from the mean of each variant and seed."""
    middle = {name: np.mean(np.sort(values)[1:4]) for name, values in means.items()}
    for name, values in means.items():
        described = document["values"][kind][name][metric]
        assert (described["n"], described["failed"]) == (5, 0)
        assert described["mean"] == pytest.approx(np.mean(values), rel=1e-12)
        assert described["iqm"] == pytest.approx(middle[name], rel=1e-12)
        assert [
            run[kind][metric] for run in document["runs"] if run["variant"] == name
        ] == pytest.approx(list(values), rel=1e-12)
        if name != "base":
            found = document["comparisons"][kind][name][metric]
            differences = values - means["base"]
            assert found["difference"]["mean"] == pytest.approx(
                np.mean(differences), rel=1e-9, abs=1e-12
            )
            assert found["difference"]["median"] == pytest.approx(
                np.median(differences), rel=1e-9, abs=1e-12
            )
            higher = (values[:, None] > means["base"]).mean()
            ties = (values[:, None] == means["base"]).mean()
            assert found["probability_of_improvement"] == pytest.approx(higher + ties / 2)


class TestFailures:
    def test_a_variant_that_always_fails_counts_as_that(self, ablate, study):
        kept = fingerprint(study / "runs")
        arguments = ("--no-rf", "--set=ppo.actor_learning_rate=1e30", "--seeds=0,1")
        failed = ablate(*arguments, f"--out={study}")
        assert failed.code == 1
        assert "try the failed runs again with: orchid ablate" in failed.err
        after = fingerprint(study / "runs")
        assert {name: after[name] for name in kept} == kept
        document = document_of(study)
        name = "ppo.actor_learning_rate-1e30"
        assert document["status"] == "failed"
        for kind in ("evaluation", "sampled", "training"):
            for found in document["comparisons"][kind][name].values():
                counts = found["n"], found["failed_base"], found["failed_variant"]
                assert counts == (0, 0, 2)
                assert found["probability_of_improvement"] == 0.0  # no run is worse than failed
                assert found["difference"]["mean"] is None
            assert all(one["n"] == 2 for one in document["comparisons"][kind]["no-rf"].values())
        runs = [run for run in document["runs"] if run["variant"] == name]
        assert [run["status"] for run in runs] == ["failed", "failed"]
        assert all(run["error"] and run["evaluation"]["utility"] is None for run in runs)
        assert f"{name}\tutility\t-\t-\t0.00\t-\tundecided" in failed.out
        assert "0 (2 of the variant failed)" in failed.out
        first = list(InThisProcess.names)
        assert ablate(*arguments, f"--out={study}").code == 1
        assert InThisProcess.names == first * 2 == [f"{name}-s0", f"{name}-s1"] * 2

    def test_a_seed_that_failed_is_left_out_of_pairs_and_tried_again(self, ablate, study, finished):
        run = run_of(study, "no-rf", 1)
        reseal(run / "run.json", status="failed", error="NaN")
        for state in (run / "checkpoints").glob("*/state.json"):
            state.write_text("{}")
        arguments = ("--no-rf", "--seeds=0,1", f"--out={study}", "--json")
        failed = ablate(*arguments)
        assert failed.code == 1
        document = json.loads(failed.out)
        assert [run["status"] for run in document["runs"]] == ["completed"] * 3 + ["failed"]
        whole = document_of(finished.path)
        for kind in ("evaluation", "training"):
            found = document["comparisons"][kind]["no-rf"]["rate_jfi"]
            assert (found["n"], found["seeds"], found["failed_variant"]) == (1, 2, 1)
            base, own = (run[kind]["rate_jfi"] for run in whole["runs"][:2])
            assert found["difference"]["mean"] == pytest.approx(own - base, abs=1e-15)
            assert document["values"][kind]["base"] == whole["values"][kind]["base"]
        shutil.rmtree(run)
        again = ablate(*arguments)
        assert again.code == 0
        assert InThisProcess.names == ["no-rf-s1", "no-rf-s1"]
        assert without_times(json.loads(again.out)) == without_times(whole)

    def test_that_leave_nothing_to_fly_are_told(self, ablate, tmp_path):
        arguments = ("--no-rf", "--base=ppo.critic_learning_rate=1e30", "--seeds=0")
        assert_is_an_error(
            ablate(*arguments, f"--out={tmp_path / 'study'}", "--quiet", "--json"),
            "no run was completed; see ",
            "try again with: orchid ablate",
            code=1,
        )
        assert document_of(tmp_path / "study")["status"] == "failed"

    def test_of_the_disk_are_told(self, ablate, study, monkeypatch):
        def full(path, document):
            if document["status"] == "completed":
                raise OSError(errno.ENOSPC, "No space left on device")

        monkeypatch.setattr(ablation_study, "write_json", full)
        failed = ablate("--no-rf", "--seeds=0,1", f"--out={study}", "--quiet", "--json")
        assert_is_an_error(failed, f"cannot write to {study}", "No space", "try again with", code=1)

    def test_of_drawing_cost_no_result(self, ablate, study, finished, monkeypatch):
        def fail(*arguments, **options):
            raise ValueError("a font\nis missing")

        monkeypatch.setattr(notices, "_told", set())
        for step in ("draw_learning_curves", "write_ablation_sheet"):
            monkeypatch.setattr(ablation_study, step, fail)
        drawn = ablate("--no-rf", "--seeds=0,1", f"--out={study}", "--quiet")
        assert drawn.code == 0
        [warning] = drawn.err.splitlines()
        assert warning.startswith(f"warning: no figures in {study}, ")
        assert without_times(document_of(study)) == without_times(document_of(finished.path))

    def test_a_directory_that_cannot_be_written_is_wrong_input(self, ablate, tmp_path):
        (tmp_path / "file").touch()
        assert_is_an_error(ablate("--no-rf", "--out=file/x"), "cannot write to --out file/x")


class TestInterruption:
    def test_of_a_process_goes_on_by_the_line_that_it_prints(
        self, start_orchid, orchid, finished, tmp_path, monkeypatch, interrupts
    ):
        monkeypatch.chdir(tmp_path)
        process = start_orchid(*STUDY, "--no-rf", "--seeds=0", "--jobs=1", "--out=study")
        runs = tmp_path / "study" / "runs"

        def completed():
            found = [path.parent for path in runs.glob("*/run.json")]
            return [path for path in found if record_of(path)["status"] == "completed"]

        deadline = time.monotonic() + GIVE_UP_AFTER_S
        while not completed():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=GIVE_UP_AFTER_S)
        assert process.returncode == 130, out + err
        assert "Traceback" not in err
        assert "2 jobs, 1 at once" in out
        assert document_of(tmp_path / "study")["status"] == "interrupted"
        [kept] = completed()
        before = fingerprint(kept), kept.stat().st_mtime_ns
        line = err.splitlines()[-1]
        assert line.startswith("interrupted; continue with: orchid ablate ")
        # Measured, and trained by processes, like the first part.
        again = orchid(*shlex.split(line.partition(": orchid ")[2]))
        assert again.code == 0, again.err
        assert "measuring how long a run takes ..." in again.out
        assert "= 2 runs of 8 episodes, 1 of them already done" in again.out
        assert "no-rf-s0: completed after " in again.out
        assert (fingerprint(kept), kept.stat().st_mtime_ns) == before
        shutil.copytree(finished.path, tmp_path / "copy")
        undisturbed = study_in(tmp_path / "copy", "--no-rf", "--seeds=0")
        assert undisturbed.names == []
        assert without_times(document_of(tmp_path / "study")) == without_times(
            document_of(tmp_path / "copy")
        )

    def test_of_flights_goes_on_with_the_others(self, ablate, study, finished, monkeypatch):
        # The flights that are there are those of other runs, as if some had been added.
        summary = study / "evaluation" / "summary.json"
        summary.write_text(summary.read_text().replace(run_of(study, "base").name, "another"))
        original, flights = evaluation._fly, []

        def fly(plan, flight, *others):
            if not flights:
                assert not summary.exists()  # it would call these flights complete
            flights.append(flight.key)
            if len(flights) == 6:
                signal.raise_signal(signal.SIGTERM)
            return original(plan, flight, *others)

        monkeypatch.setattr(evaluation, "_fly", fly)
        arguments = ("--no-rf", "--seeds=0,1", f"--out={study}", "--json")
        stopped = ablate(*arguments)
        assert (stopped.code, stopped.out) == (130, "")
        assert "interrupted; continue with: orchid ablate" in stopped.err
        assert document_of(study)["status"] == "interrupted"
        assert ablate(*arguments).code == 0
        # The sixth was lost, and is flown twice.
        assert Counter(Counter(flights).values()) == {1: len(flown(study)) - 1, 2: 1}
        assert without_times(document_of(study)) == without_times(document_of(finished.path))

    @pytest.mark.parametrize(
        ("owner", "step"),
        [(calibration, "seconds_per_episode"), (ablation_study, "draw_learning_curves")],
    )
    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_at_any_other_time_says_how_to_go_on(
        self, ablate, study, monkeypatch, interrupts, owner, step, number
    ):
        shutil.rmtree(run_of(study, "no-rf", 1))
        monkeypatch.setattr(owner, step, lambda *given, **options: signal.raise_signal(number))
        arguments = ("--no-rf", "--seeds=0,1", f"--out={study}", "--quiet")
        stopped = ablate(*arguments)
        assert (stopped.code, stopped.out) == (130, "")
        command = shlex.join(["orchid", *STUDY, *arguments])
        assert stopped.err == f"interrupted; continue with: {command}\n"
        assert document_of(study)["status"] == "interrupted"

    def test_without_out_the_line_names_the_directory(self, ablate, tmp_path, monkeypatch):
        monkeypatch.setattr(
            calibration,
            "seconds_per_episode",
            lambda config: signal.raise_signal(signal.SIGTERM),
        )
        stopped = ablate("--no-rf", "--quiet")
        [study] = (tmp_path / "orchid-ablate").iterdir()
        assert stopped.err.endswith(f" --no-rf --quiet --out orchid-ablate/{study.name}\n")
        monkeypatch.setattr(calibration, "seconds_per_episode", lambda config: 0.1)
        assert ablate("--no-rf", "--quiet", "--seeds=0", f"--out={study}").code == 0
        assert InThisProcess.names == ["base-s0", "no-rf-s0"]


@pytest.mark.parametrize(
    ("seeds", "at_once", "rounds"), [("0", 16, 1), ("0", 2, 1), ("0,1", 3, 2), ("0,1", 1, 4)]
)
def test_the_time_it_takes_is_told_before_it_begins(ablate, monkeypatch, seeds, at_once, rounds):
    def begin_and_stop(self, given, progress):
        progress.begin(given, 1)
        signal.raise_signal(signal.SIGTERM)
        return []

    monkeypatch.setattr(InThisProcess, "run", begin_and_stop)
    monkeypatch.setattr(InThisProcess, "was_stopped", True)
    monkeypatch.setattr(calibration, "seconds_per_episode", lambda config: 60.0)
    stopped = ablate("--no-rf", f"--seeds={seeds}", f"--jobs={at_once}")
    assert stopped.code == 130
    told = stopped.out
    before, begun, _ = told.partition(" jobs, 1 at once")  # of the executor in this process
    assert begun
    assert f"about {rounds * EPISODES} min with {at_once} at once" in before


def test_rows_of_a_document_are_what_programs_find(finished):
    document = AblationResult.from_json(document_of(finished.path))
    rows = comparison_rows(document, "evaluation")
    assert [len(row) for row in rows] == [10] * len(FLOWN)
    for other in document.others:
        if not other.deterministic:
            mean = {"base-s0-zero": 1.0, "base-s1-zero": 3.0}.get(other.method)
            other.metrics["utility"] = MetricSummary(mean=mean, std=None, ci95=None)
    reached = {row[0]: row[-1] for row in reached_rows(document)}
    assert list(reached) == [
        "base",
        "base, sampled",
        "base, no actions",
        "base, noise alone",
        "no-rf",
        "no-rf, sampled",
        "no-rf, noise alone",  # without actions it does what the base's twin does
        "static-mmf",
        "loiter-mmf",
        "balanced-loiter",
    ]
    assert reached["base, noise alone"] == "2.000"
    assert reached["no-rf, noise alone"] == "-"
