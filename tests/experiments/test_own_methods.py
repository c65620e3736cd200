"""``orchid eval --method FILE.py:CLASS``: methods of a lab's own beside all others."""

import hashlib
import json

import pytest

from orchid_uav.envs import Parameters
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation import flights
from orchid_uav.experiments.evaluation.methods import METHOD_KEYS, select
from orchid_uav.experiments.evaluation.own_methods import read_own_methods
from tests.helpers.damage import reseal
from tests.helpers.processes import TINY_FLAGS, assert_is_an_error

RULE = """
import numpy as np
from dataclasses import dataclass
from pathlib import Path

with Path("ran.txt").open("a") as told:
    told.write("ran\\n")


@dataclass
class StandStill:
    objective = "pf"

    def begin(self, world):
        pass

    def act(self, world):
        return np.zeros((world.world_count, world.uav_count, 4))
"""
TINY = ("--uavs=2", "--users=20", "--set=network.episode_slots=10", "--episodes=4", "--no-figures")


@pytest.fixture
def evaluate(orchid, tmp_path, monkeypatch):
    """Flies tiny worlds; the folder is the test's, with the rule above in ``rule.py``."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rule.py").write_text(RULE)
    return lambda *more: orchid("eval", *TINY, *more)


def results_of(folder):
    return json.loads((folder / "summary.json").read_text())


class TestFlights:
    def test_an_own_rule_is_a_row_beside_the_others(self, evaluate, tmp_path):
        methods = "--methods=static-pf,static-mmf"
        finished = evaluate(methods, "--method=rule.py:StandStill", "--out=out")
        assert finished.code == 0, finished.err
        *_, hover, own = results_of(tmp_path / "out")["results"]
        assert [hover["method"], own["method"]] == ["static-mmf", "stand-still"]
        static = results_of(tmp_path / "out")["results"][0]
        assert own == static | {"method": "stand-still"}
        assert "stand-still" in finished.out

    def test_the_summary_says_what_was_run(self, evaluate, tmp_path):
        assert evaluate("--methods=static-pf", "--method=rule.py:StandStill", "--out=out").code == 0
        built_in, own = results_of(tmp_path / "out")["settings"]["methods"]
        assert "file" not in built_in
        digest = hashlib.sha256(RULE.encode()).hexdigest()
        assert own["file"] == {"name": "rule.py", "attribute": "StandStill", "sha256": digest}
        assert own["method"] == "stand-still" and own["run"] is None

    def test_what_belongs_to_a_method_is_set_as_for_others(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "rule.py").write_text(
            RULE.replace('objective = "pf"', 'deployment_init = "random"\n    idea = "stay"')
        )
        (own,) = read_own_methods(["rule.py:StandStill"])
        assert own.idea == "stay"
        assert dict(own.overrides) == {
            "reward.objective": "mmf",
            "network.shares": None,
            "deployment.init": "random",
            "deployment.balanced_on": "sensed",
            "uav.observation": "paper",
            "uav.flight": "direct",
        }
        assert set(own.overrides) == set(METHOD_KEYS)
        assert all(set(one.overrides) == set(METHOD_KEYS) for one in select(["all"]))

    def test_every_batch_gets_a_method_of_its_own(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "rule.py").write_text(
            RULE.replace(
                "        pass", "        assert not hasattr(self, 'begun')\n        self.begun = 1"
            )
        )
        monkeypatch.setattr(flights, "_WORLDS_AT_ONCE", 2)
        own = read_own_methods(["rule.py:StandStill"])
        world = Parameters().with_overrides({"episode_slots": 3})
        plan = flights.EvaluationPlan(own, [flights.Setting(uavs=2, users=9)], 4, 0, world)
        assert flights.evaluate(plan)[1]

    def test_a_function_and_what_lies_beside_the_file_will_do(self, evaluate, tmp_path):
        (tmp_path / "beside_a_rule.py").write_text(RULE)
        (tmp_path / "rule.py").write_text(
            "from beside_a_rule import StandStill\ndef resting(): return StandStill()\n"
        )
        assert evaluate("--methods=static-pf", "--method=rule.py:resting").code == 0


class TestErrors:
    @pytest.mark.parametrize(
        ("given", "told"),
        [
            ("rule.py", "it must be FILE.py:CLASS"),
            ("rule.py:", "it must be FILE.py:CLASS"),
            ("nowhere.py:StandStill", "No such file or directory: nowhere.py"),
            ("rule.py:StandFirm", "rule.py has no class 'StandFirm'"),
            ("rule.py:np", "rule.py has no class 'np'"),
            ("rule.py:told", "rule.py has no class 'told'"),
        ],
    )
    def test_what_is_not_there_is_wrong_input(self, evaluate, given, told):
        finished = evaluate("--methods=static-pf", f"--method={given}", "--out=out")
        assert_is_an_error(finished, told)

    @pytest.mark.parametrize(
        ("old", "new", "told"),
        [
            ("    def act(", "    def fly(", "'StandStill' has no act(world)"),
            ("    def begin(", "    def start(", "'StandStill' has no begin(world)"),
            ('"pf"', '"fair"', "objective is 'fair', not mmf or pf"),
            ("import numpy", "import no_such_module", "No module named 'no_such_module'"),
            ("@dataclass", "raise SystemExit(0)", "SystemExit: 0 (rule.py, line 10)"),
            (
                "class StandStill:",
                "class StandStill",
                "SyntaxError: expected ':' (rule.py, line 11)",
            ),
            ('objective = "pf"', "objective = 1 / 0", "division by zero (rule.py, line 12)"),
            (
                "@dataclass\nclass StandStill:",
                "class StandStill:\n    def __init__(self): self.nothing",
                "no attribute 'nothing' (rule.py, line 11)",
            ),
        ],
    )
    def test_a_file_that_makes_no_method_is_wrong_input(self, evaluate, tmp_path, old, new, told):
        changed = RULE.replace(old, new)
        assert changed != RULE
        (tmp_path / "rule.py").write_text(changed)
        finished = evaluate("--methods=static-pf", "--method=rule.py:StandStill", "--out=out")
        assert_is_an_error(finished, told, "--method rule.py:StandStill")
        assert not (tmp_path / "out").exists()

    @pytest.mark.parametrize(
        ("new", "told"),
        [
            (
                "return np.zeros((2, 4))",
                "act() gave shape (2, 4), not (worlds, UAVs, 4) = (4, 2, 4)",
            ),
            ("return np.full((4, 2, 4), np.nan)", "not finite, in slot 0"),
            ("return [][0]", "IndexError: list index out of range (rule.py, line 18)"),
            ("return 'up'", "ValueError: could not convert string to float"),
        ],
    )
    def test_a_mistake_in_flight_is_a_failure_with_the_methods_name(
        self, evaluate, tmp_path, new, told
    ):
        old = "return np.zeros((world.world_count, world.uav_count, 4))"
        (tmp_path / "rule.py").write_text(RULE.replace(old, new))
        finished = evaluate("--methods=static-pf", "--method=rule.py:StandStill", "--out=out")
        assert finished.code == 1
        assert "method 'stand-still': " in finished.err and told in finished.err
        assert "Traceback" not in finished.err

    def test_debug_shows_where(self, evaluate, tmp_path):
        (tmp_path / "rule.py").write_text(RULE.replace('objective = "pf"', "objective = 1 / 0"))
        finished = evaluate("--method=rule.py:StandStill", "--debug")
        assert "Traceback" in finished.err and "objective = 1 / 0" in finished.err

    @pytest.mark.parametrize("name", ["Planner", "OrchidZero", "orchid"])
    def test_keys_of_others_are_taken(self, tmp_path, monkeypatch, name):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "rule.py").write_text(RULE.replace("StandStill", name))
        with pytest.raises(InputError, match="give the class another name"):
            read_own_methods([f"rule.py:{name}"])

    def test_a_key_is_given_once(self, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        (tmp_path / "rule.py").write_text(RULE)
        with pytest.raises(InputError, match="a method 'stand-still' already"):
            read_own_methods(["rule.py:StandStill"] * 2)
        with pytest.raises(InputError, match="a method 'stand-still' already"):
            read_own_methods(["rule.py:StandStill"], ["stand-still"])


class TestNothingElseIsRun:
    def ran(self, tmp_path) -> int:
        told = tmp_path / "ran.txt"
        return len(told.read_text().splitlines()) if told.exists() else 0

    def interrupt(self, evaluate, monkeypatch):
        original = flights._fly_batch

        def interrupted(contender, *rest):
            if contender.key == "stand-still":
                raise KeyboardInterrupt
            return original(contender, *rest)

        with monkeypatch.context() as patch:
            patch.setattr(flights, "_fly_batch", interrupted)
            return evaluate(*self.ARGUMENTS, "--method=rule.py:StandStill")

    ARGUMENTS = ("--methods=static-pf", "--out=out")

    def test_an_evaluation_goes_on_only_with_the_same_file_given_again(
        self, evaluate, tmp_path, monkeypatch
    ):
        stopped = self.interrupt(evaluate, monkeypatch)
        assert stopped.code == 130 and "--method=rule.py:StandStill" in stopped.err
        assert self.ran(tmp_path) == 1
        assert_is_an_error(evaluate(*self.ARGUMENTS), "other settings: methods")
        assert self.ran(tmp_path) == 1  # the summary names the file, and that is all
        (tmp_path / "rule.py").write_text(RULE + "# changed\n")
        finished = evaluate(*self.ARGUMENTS, "--method=rule.py:StandStill")
        assert_is_an_error(finished, "other settings: methods")
        (tmp_path / "rule.py").write_text(RULE)
        finished = evaluate(*self.ARGUMENTS, "--method=rule.py:StandStill")
        assert finished.code == 0 and "1 batches of them already flown" in finished.out

    def test_a_run_that_names_a_file_does_not_get_it_run(
        self, evaluate, orchid, new_runs, runs_dir, tmp_path
    ):
        trained = orchid(
            *("train", *TINY_FLAGS, "--episodes=1", "--no-rf", "--quiet", "--runs-dir", runs_dir)
        )
        assert trained.code == 0, trained.err
        (run,) = new_runs()
        (run / "rule.py").write_text(RULE)
        specification = f"{run / 'rule.py'}:StandStill"
        reseal(run / "run.json", method=specification, file={"name": specification})
        evaluate("--runs-dir", runs_dir, run.name, "--methods=static-pf", "--out=out")
        for command in (("runs", "show", run.name), ("runs", "list")):
            orchid(*command, "--runs-dir", runs_dir)
        assert self.ran(tmp_path) == 0
        (tmp_path / "out").mkdir(exist_ok=True)
        assert evaluate("--method", specification, "--methods=static-pf").code == 0
        assert self.ran(tmp_path) == 1
