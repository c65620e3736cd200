"""The comparison with public learners: its task, its judging, its runs and its statistics."""

import importlib
import json
import math
import stat
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mpe2 import simple_spread_v3
from scipy.stats import t

from benchmarks import measuring
from benchmarks.training_speed import FLEET_SETTINGS
from orchid_uav.envs import make_supersuit_vec_env
from orchid_uav.experiments.configuration import RunConfig
from studies import recording
from studies.pages.performance import recorded
from studies.simple_spread import rules, task
from studies.simple_spread import study as validation
from studies.simple_spread.comparison import CONTROLS, PAIRS, compare, compare_arms
from studies.simple_spread.orchid_learners import LocalState, learn, make_learner
from studies.simple_spread.study import Arm, compact, jobs, run
from studies.simple_spread.task import Progress, Settings
from studies.simple_spread.train import changed
from tests.helpers.processes import NEEDS_SUPERSUIT
from tests.test_architecture import imports_of

TINY = Settings(
    frames=100,
    worlds=2,
    frames_per_iteration=50,
    minibatch_frames=10,
    batch_frames=10,
    updates_per_iteration=2,
    epochs=1,
    hidden_sizes=(8,),
    curve_points=2,
    curve_episodes=1,
    final_episodes=2,
)


class TestTask:
    def test_a_return_is_the_mean_over_agents_of_what_they_were_rewarded(self):
        def act(observations: np.ndarray) -> np.ndarray:
            return np.tile(np.float32([0.0, 0.2, 0.9, 0.1, 0.4]), (3, 1))

        env = simple_spread_v3.parallel_env(
            N=3, local_ratio=0.5, max_cycles=25, continuous_actions=True
        )
        env.reset(seed=5)
        total = 0.0
        for _ in range(25):
            _, rewards, *_ = env.step({agent: act(None)[0] for agent in env.agents})
            total += sum(rewards.values())
        assert not env.agents
        assert task.returns(act, range(5, 6)) == pytest.approx([total / 3])

    def test_where_no_force_acts_nobody_moves(self):
        env = task.make_spread()
        before, _ = env.reset(seed=0)
        action = rules.no_force()(None)[0].astype(np.float32)
        after, *_ = env.step(dict.fromkeys(env.agents, action))
        for agent in env.agents:
            np.testing.assert_array_equal(after[agent], before[agent])

    def test_who_flies_to_the_assigned_landmark_gets_there(self):
        env = task.make_spread()
        observations, _ = env.reset(seed=3)
        act = rules.assigned_landmarks()
        while env.agents:
            agents = env.possible_agents
            actions = act(np.stack([observations[agent] for agent in agents]))
            observations, *_ = env.step(
                {agent: actions[index].astype(np.float32) for index, agent in enumerate(agents)}
            )
        distances = [
            np.linalg.norm(observations[agent][4:10].reshape(3, 2), axis=1) for agent in agents
        ]
        assert all(distances[index].min() < 0.1 for index in range(3))
        assert {int(own.argmin()) for own in distances} == {0, 1, 2}

    def test_actions_beyond_the_space_are_clipped_before_the_environment_sees_them(self, caplog):
        task.returns(lambda _: np.full((3, 5), 7.0), range(2))
        assert not caplog.records  # MPE2 says so for each action that it has to clip

    @pytest.mark.parametrize("change", ["gama=0.5", "frames", "hidden_sizes=3", "frames=many"])
    def test_changes_that_are_none(self, change):
        with pytest.raises(ValueError):
            changed(Settings(), [change])

    def test_changes_keep_their_kind(self):
        settings = changed(Settings(), ["frames=50", "learning_rate=1"])
        assert (settings.frames, settings.learning_rate) == (50, 1.0)
        assert isinstance(settings.learning_rate, float)


class TestProgress:
    def test_points_come_at_equal_distances_and_judging_does_not_count(self, monkeypatch):
        clock = [0.0]
        monkeypatch.setattr(task.time, "perf_counter", lambda: clock[0])

        def judging(policy: object, seeds: range) -> list[float]:
            clock[0] += 100.0
            return [1.0, 3.0]

        monkeypatch.setattr(task, "returns", judging)
        progress = Progress(Settings(frames=100, curve_points=4), _begun_s=0.0)
        judged_at = []
        for frames in range(0, 101, 10):
            clock[0] += 1.0
            if progress.due(frames):
                judged_at.append(frames)
                progress.judge(frames, rules.no_force())
        assert judged_at == [30, 50, 80, 100]
        assert progress.curve == [(frames, 2.0) for frames in judged_at]
        assert progress.training_s == 11.0


@NEEDS_SUPERSUIT
class TestOurLearners:
    @pytest.mark.parametrize("method", ["mappo", "maddpg", "ippo"])
    def test_a_seed_gives_the_same_policy_again_and_all_frames_are_used(self, method):
        observations = np.random.default_rng(0).standard_normal((3, 18)).astype(np.float32)
        learned = [learn(method, seed, TINY) for seed in (1, 1, 2)]
        actions = [one.policy(observations) for one in learned]
        np.testing.assert_array_equal(actions[0], actions[1])
        assert not np.array_equal(actions[0], actions[2])
        assert [frames for frames, _ in learned[0].progress.curve] == [50, 100]

    def test_independent_ppo_values_what_the_agent_itself_observes(self):
        env = LocalState(make_supersuit_vec_env(task.make_spread, worlds=2, seed=0))
        observation = env.reset()
        assert env.get_attr("agents_per_world") == [1] * 6
        for _ in range(25):
            np.testing.assert_array_equal(observation["state"], observation["observation"])
            observation, _, dones, infos = env.step(np.full((6, 5), 0.5, np.float32))
        assert dones.all()
        for info in infos:
            last = info["terminal_observation"]
            np.testing.assert_array_equal(last["state"], last["observation"])
        model = make_learner("ippo", 0, TINY)
        assert model.agents_per_world == 1
        assert model.policy.critic[0].in_features == task.OBSERVATION
        assert make_learner("mappo", 0, TINY).policy.critic[0].in_features == task.STATE

    def test_the_settings_arrive(self):
        settings = replace(
            TINY,
            learning_rate=0.011,
            adam_epsilon=0.012,
            gamma=0.13,
            max_grad_norm=0.14,
            gae_lambda=0.15,
            clip_range=0.16,
            entropy_coefficient=0.17,
            target_rate=0.18,
            exploration_std=0.19,
        )
        mappo, maddpg = (make_learner(name, 0, settings) for name in ("mappo", "maddpg"))
        for model in (mappo, maddpg):
            assert model.learning_rates == (0.011, 0.011)
            assert model.policy.optimizer.defaults["eps"] == 0.012
            assert (model.gamma, model.max_grad_norm) == (0.13, 0.14)
            assert model.policy.net_arch == [8]
        assert (mappo.gae_lambda, mappo.clip_range(1.0), mappo.ent_coef) == (0.15, 0.16, 0.17)
        assert (mappo.vf_coef, mappo.normalize_advantage) == (1.0, False)
        # On [-1, 1] as wide as the others' on [0, 1].
        assert (maddpg.tau, maddpg.exploration_std) == (0.18, 0.38)
        assert maddpg.preactivation_penalty == 0.0

    def test_as_many_updates_as_the_settings_say(self):
        model = make_learner("maddpg", 0, TINY)
        model.learn(TINY.frames * 3)
        assert model._n_updates == 2 * TINY.updates_per_iteration
        tripled = make_learner("maddpg-tripled", 0, TINY)
        tripled.learn(TINY.frames * 3)
        assert tripled._n_updates == 3 * model._n_updates
        assert tripled.tau == model.tau / 3
        model = make_learner("mappo", 0, TINY)
        model.learn(TINY.frames * 3)
        steps = model.policy.optimizer.state[model.policy.log_std]["step"]
        assert int(steps) == 2 * TINY.epochs * 5


PUBLIC_MODULES = {"task", "train", "fixed_batch"} | {
    f"{library}_{part}"
    for library, part in (
        *(("benchmarl", "learners"), ("benchmarl", "worlds")),
        ("agilerl", "learners"),
    )
}


def test_what_a_public_librarys_environment_imports_does_not_need_ours():
    folder = Path(task.__file__).parent
    for path in (folder / f"{name}.py" for name in PUBLIC_MODULES):
        for module in imports_of(path):
            root, _, rest = module.partition(".")
            assert root != "orchid_uav", f"{path.name} imports {module}"
            if root == "studies":
                name = rest.removeprefix("simple_spread.")
                assert name in PUBLIC_MODULES, f"{path.name}: {module}"


class TestComparison:
    ONE = [-17.2, -17.9, -16.8, -17.4, -18.1, -17.0, -17.6, -17.3, -16.9, -17.5]
    OTHER = [-17.5, -17.1, -17.8, -16.9, -17.7, -18.4, -17.2, -17.0, -17.6, -17.3]

    def test_welch_by_hand(self):
        found = compare_arms(self.ONE, self.OTHER, random_return=-24.7)
        means = [sum(values) / 10 for values in (self.ONE, self.OTHER)]
        errors = [
            sum((value - mean) ** 2 for value in values) / 9 / 10
            for values, mean in zip((self.ONE, self.OTHER), means, strict=True)
        ]
        error = math.sqrt(sum(errors))
        freedom = sum(errors) ** 2 / sum(one**2 / 9 for one in errors)
        difference = means[0] - means[1]
        margin = 0.05 * (means[1] + 24.7)
        reach = t.ppf(0.95, freedom) * error
        assert found["difference"] == pytest.approx(difference)
        assert found["ci90"] == pytest.approx([difference - reach, difference + reach])
        assert found["p_value"] == pytest.approx(2 * t.sf(abs(difference) / error, freedom))
        assert found["margin"] == pytest.approx(margin)
        expected = t.sf((margin - abs(difference)) / error, freedom)
        assert found["equivalence_p"] == pytest.approx(expected)
        assert found["least_margin"] == pytest.approx(max(map(abs, found["ci90"])))

    @pytest.mark.parametrize(
        ("shift", "spread", "verdict"),
        [
            (0.0, 0.1, "equivalent"),
            (-0.2, 0.1, "equivalent"),  # lower for sure, but by less than matters
            (-1.0, 0.1, "lower"),
            (1.0, 0.1, "higher"),
            (-0.1, 5.0, "undecided"),
        ],
    )
    def test_verdicts(self, shift, spread, verdict):
        reference = [-17.0 + spread * (value + 17.35) for value in self.ONE]
        compared = [value + shift for value in reference]
        found = compare_arms(compared, reference, random_return=-24.7)
        assert found["verdict"] == verdict

    def test_five_seeds_give_no_verdict(self):
        found = compare_arms(self.ONE[:5], self.OTHER, random_return=-24.7)
        assert found["verdict"] is None
        assert found["seeds"] == [5, 10]

    def test_arms_and_pairs_of_rows(self):
        rows = [
            {"arm": arm, "final_return": value, "curve": [value - 3.0, value - 1.0]}
            for arm, values in (("orchid mappo", self.ONE), ("benchmarl mappo", self.OTHER))
            for value in values
        ]
        found = compare(rows, random_return=-24.7)
        middle = sorted(self.ONE)[2:8]
        assert found["arms"]["orchid mappo"]["iqm"] == pytest.approx(sum(middle) / 6)
        (pair,) = found["pairs"]
        assert (pair["compared"], pair["reference"]) == ("orchid mappo", "benchmarl mappo")
        (on_the_way,) = found["pairs_of_curves"]
        assert on_the_way["difference"] == pytest.approx(pair["difference"])
        assert on_the_way["margin"] == pytest.approx(pair["margin"] - 0.05 * 2.0)


STAND_IN = """#!{python}
import json, sys
if "{fails}" in sys.argv:
    sys.exit("DivergedError: no such luck")
out = sys.argv[sys.argv.index("--out") + 1]
with open(out + ".calls", "a") as calls:
    calls.write("x")
with open(out, "w") as file:
    json.dump({{"argv": sys.argv[1:], "settings": {settings}}}, file)
"""


class TestRuns:
    ARM = Arm("orchid", "mappo", {"frames": 10, "learning_rate": 0.5})

    @pytest.fixture
    def pythons(self, tmp_path):
        path = tmp_path / "python"
        text = STAND_IN.format(python=sys.executable, fails="maddpg", settings=self.ARM.settings)
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return {"orchid": str(path)}

    def test_a_run_that_is_there_is_not_done_again(self, tmp_path, pythons):
        row = run(self.ARM, 3, pythons, tmp_path)
        assert row == run(self.ARM, 3, pythons, tmp_path)
        assert row["argv"][:2] == ["-m", "studies.simple_spread.train"]
        settings = changed(Settings(), [row["argv"][i + 1] for i in (-4, -2)])
        assert (settings.frames, settings.learning_rate) == (10, 0.5)
        (calls,) = tmp_path.glob("*.calls")
        assert calls.read_text() == "x"

    def test_a_run_with_other_settings_is_done_again(self, tmp_path, pythons):
        path = tmp_path / self.ARM.file(3)
        path.write_text(json.dumps({"settings": self.ARM.settings | {"gamma": 0.5}}))
        assert run(self.ARM, 3, pythons, tmp_path)["settings"] == self.ARM.settings

    def test_settings_of_the_other_algorithm_do_not_count(self):
        maddpg = Arm("orchid", "maddpg", self.ARM.changes)
        for name, ppo, other in (("exploration_std", True, False), ("epochs", False, True)):
            settings = self.ARM.settings | {name: 7}
            assert (self.ARM.is_of(settings), maddpg.is_of(settings)) == (ppo, other)
        assert {*task.PPO_SETTINGS, *task.MADDPG_SETTINGS} < {*self.ARM.settings}

    def test_a_run_that_fails_is_told_with_its_reason_and_tried_again(self, tmp_path, pythons):
        arm = Arm("orchid", "maddpg")
        row = run(arm, 0, pythons, tmp_path)
        assert row["failed"] == "DivergedError: no such luck"
        assert run(arm, 0, pythons, tmp_path) == row
        assert not list(tmp_path.glob("*.json"))
        assert compact(row) == {
            "arm": "orchid maddpg",
            "seed": 0,
            "final_return": None,
            "failed": "DivergedError: no such luck",
        }

    def test_failed_runs_are_counted_not_imputed(self):
        values = [*TestComparison.ONE, None]
        rows = [{"arm": "orchid mappo", "final_return": value} for value in values]
        rows += [{"arm": "benchmarl mappo", "final_return": value} for value in values[:10]]
        found = compare(rows, random_return=-24.7)
        assert found["arms"]["orchid mappo"]["failed"] == 1
        (pair,) = found["pairs"]
        assert (pair["seeds"], pair["failed"]) == ([10, 10], [1, 0])
        assert pair["difference"] == 0.0
        assert pair["verdict"] == "undecided"  # though what is left is the same

    def test_where_nearly_all_failed_there_is_nothing_to_compare(self):
        found = compare_arms([-17.0, None, None], TestComparison.OTHER, random_return=-24.7)
        assert found == {"seeds": [1, 10], "failed": [2, 0], "verdict": None}

    def test_arms_that_differ_have_files_that_differ(self):
        every = [*jobs(validation.ARMS, 2), *validation.TRIALS]
        assert len({arm.file(seed) for arm, seed in every}) == len(every)

    def test_learners_take_turns_seed_by_seed(self):
        few, many = Arm("orchid", "ippo", seeds=1), Arm("orchid", "mappo", seeds=3)
        assert list(jobs((few, many), 2)) == [(few, 0), (many, 0), (many, 1)]

    def test_pairs_have_the_same_settings(self):
        changes = {arm.name: arm.changes for arm in validation.ARMS}
        for one, other in (*PAIRS, *CONTROLS):
            assert changes[one] == changes[other]


def test_beside_benchmarl_both_sides_take_as_many_gradient_steps():
    settings = Settings(**FLEET_SETTINGS)
    paper = RunConfig()
    samples = paper.network.episode_slots * paper.network.uav_count
    ours = math.ceil(samples / paper.ppo.batch_size)
    theirs = math.ceil(settings.frames_per_iteration / settings.minibatch_frames)
    assert ours == theirs == 10
    assert settings.epochs == paper.ppo.epochs


def test_the_committed_rows_are_those_of_the_comparison():
    path = validation.RESULTS / "validation.json"
    document = json.loads(path.read_text())
    rows = document["runs"]
    assert [(row["arm"], row["seed"]) for row in rows] == [
        (arm.name, seed) for arm, seed in jobs(validation.ARMS, validation.SEEDS)
    ]
    again = compare(rows, document["baselines"]["random"])
    for arm, described in again["arms"].items():
        committed = document["comparison"]["arms"][arm]
        assert described["iqm"] == pytest.approx(committed["iqm"], abs=1e-4)  # six digits are kept
    for pair, committed in zip(again["pairs"], document["comparison"]["pairs"], strict=True):
        assert pair["verdict"] == committed["verdict"]
        assert pair["difference"] == pytest.approx(committed["difference"], abs=1e-4)


KEPT = ("--json", recording.RESULTS / "new.json")
PROGRAMS = {
    **dict.fromkeys(("studies.evaluations", "studies.ablations"), ()),
    **dict.fromkeys(("studies.simple_spread.study", "studies.reference_policies"), ()),
    **dict.fromkeys(("studies.tuning", "benchmarks.evaluation", "benchmarks.simulator"), KEPT),
    **dict.fromkeys(("benchmarks.training", "benchmarks.run_index"), KEPT),
    "benchmarks.training_speed": KEPT,
}


class TestRecords:
    """What is kept under studies/results and runs/reference names the commit that made it."""

    @pytest.mark.parametrize("commit", ["abc+changes", None])
    @pytest.mark.parametrize("name", PROGRAMS)
    def test_are_refused_before_anything_is_measured(self, monkeypatch, capsys, name, commit):
        program = importlib.import_module(name)
        monkeypatch.setattr(recording, "git_commit", lambda: commit)
        monkeypatch.setattr("sys.argv", [name, *map(str, PROGRAMS[name])])
        monkeypatch.setattr(subprocess, "run", None)  # nothing may begin
        with pytest.raises(SystemExit) as ended:
            program.main()
        assert ended.value.code == 2
        said = capsys.readouterr().err
        assert ("uncommitted changes" if commit else "not a git checkout") in said
        assert "--allow-changes" in said

    @pytest.mark.parametrize(
        ("commit", "arguments"),
        [
            ("abc", KEPT),
            ("abc+changes", [*KEPT, "--allow-changes"]),
            ("abc+changes", ["--json", "elsewhere.json"]),
            ("abc+changes", []),
        ],
    )
    def test_others_are_not(self, monkeypatch, tmp_path, commit, arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(recording, "git_commit", lambda: commit)
        monkeypatch.setattr("sys.argv", ["program", *map(str, arguments)])
        assert measuring.arguments("measures", repetitions=3).repetitions == 3

    @pytest.mark.parametrize(
        ("commit", "is_told"), [("a", False), ("a+changes", True), (None, True)]
    )
    def test_pages_tell_of_changes(self, commit, is_told):
        document = {"date": "2026-11-26", "host": {"processor": "P"}}
        text = recorded(document | {"versions": {"git_commit": commit}})
        told = ", with changes that were not committed" if is_told else ""
        assert text == f"2026-11-26{told}, P"
