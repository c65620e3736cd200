"""Keys that had another name: what was written then is still read, and goes on as it was."""

import dataclasses
import hashlib
import json
import signal

import pytest

from orchid_uav.envs.keys import FORMER_KEYS, with_current_keys
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.ablation.design import Ablation
from orchid_uav.experiments.ablation.study import AblationStudy
from orchid_uav.experiments.ablation.variants import Variant, assigned
from orchid_uav.experiments.configuration import (
    Layer,
    RunConfig,
    assignment_layer,
    configuration_keys,
    file_layer,
    merge,
)
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.directory import describe_plan, read_interrupted
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting
from orchid_uav.experiments.evaluation.methods import read_policy, rules
from orchid_uav.experiments.runs.index import read_run
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.experiments.training.listeners import Reporter
from orchid_uav.storage.files import write_json
from tests.helpers.damage import reseal
from tests.helpers.processes import (
    TINY_FLAGS,
    assert_is_an_error,
    fingerprint,
    record_of,
    tiny_config,
)
from tests.helpers.run_directories import make_run

ONE = "[reward]\nshares = 'se'\n"
BOTH = f"{ONE}[network]\nshares = 'pf'\n"


def as_formerly(sections):
    """Sections of a configuration as the first version wrote them."""
    former = json.loads(json.dumps(sections))
    former["reward"]["shares"] = former["network"].pop("shares")
    return former


def write_as_formerly(run):
    """Make of a run one of the first version."""
    former = as_formerly(json.loads((run / "config.json").read_text()))
    (run / "config.json").write_text(json.dumps(former))
    digest = hashlib.sha256((run / "config.json").read_bytes()).hexdigest()
    reseal(run / "run.json", config_sha256=digest)


def test_names_are_keys_of_today_and_of_no_key_twice():
    assert set(FORMER_KEYS.values()) <= set(configuration_keys())
    assert not set(FORMER_KEYS) & set(configuration_keys())


class TestTranslation:
    @pytest.mark.parametrize(
        ("values", "expected"),
        [
            ({"reward.shares": "se", "a": 1}, {"network.shares": "se", "a": 1}),
            ({"reward.shares": None, "network.shares": None}, {"network.shares": None}),
            ({"reward": {"shares": "se"}}, {"reward": {}, "network": {"shares": "se"}}),
            (
                {"reward": {"shares": "se", "x": 1}, "network": {"y": 2}},
                {"reward": {"x": 1}, "network": {"shares": "se", "y": 2}},
            ),
            ({"reward": 3, "network": "x"}, {"reward": 3, "network": "x"}),
        ],
    )
    def test_gives_the_names_of_today(self, values, expected):
        before = json.dumps(values)
        assert with_current_keys(values) == expected
        assert json.dumps(values) == before

    @pytest.mark.parametrize(
        "values",
        [
            {"reward.shares": "se", "network.shares": "pf"},
            {"reward": {"shares": "se"}, "network": {"shares": None}},
        ],
    )
    def test_of_two_different_values_there_is_none(self, values):
        with pytest.raises(ValueError, match=r"shares.* 'se' and .* are given"):
            with_current_keys(values)

    def test_is_made_of_configurations_and_overrides(self):
        sections = tiny_config(network__shares="se").model_dump(mode="json")
        assert RunConfig.model_validate(as_formerly(sections)) == RunConfig.model_validate(sections)
        assert Parameters().with_overrides({"reward.shares": "se"}).network.shares == "se"
        with pytest.raises(ValueError, match="are given"):
            RunConfig.model_validate({"reward": {"shares": "se"}, "network": {"shares": "pf"}})


class TestGiven:
    def test_by_assignment_or_file_sets_the_key(self, orchid, tmp_path):
        (tmp_path / "lab.toml").write_text(ONE)
        for given in ("--set=reward.shares=se", f"--config={tmp_path / 'lab.toml'}"):
            shown = json.loads(orchid("config", "show", "--json", given).out)
            assert shown["network"]["shares"] == "se"
            assert "shares" not in shown["reward"]
        _, sources = merge([file_layer(tmp_path / "lab.toml")])
        assert sources["network.shares"] == str(tmp_path / "lab.toml")
        assert assigned(["reward.shares=se"])[0].values == {"network.shares": "se"}

    def test_a_later_layer_wins_whatever_it_calls_the_key(self):
        layers = [Layer("lab.toml", {"network.shares": "pf"})]
        assert merge([*layers, assignment_layer(["reward.shares=se"])])[0].network.shares == "se"
        layers = [Layer("lab.toml", {"reward.shares": "pf"})]
        assert merge([*layers, assignment_layer(["network.shares=se"])])[0].network.shares == "se"

    def test_twice_and_differently_in_a_file_is_an_error(self, orchid, tmp_path):
        (tmp_path / "lab.toml").write_text(BOTH)
        finished = orchid("config", "show", "--config", tmp_path / "lab.toml")
        assert_is_an_error(finished, "'se'", "'pf'", "lab.toml")
        both = ("--set=reward.shares=se", "--set=network.shares=pf")
        assert_is_an_error(orchid("config", "show", *both), "'se'", "'pf'", "--set")

    def test_a_wrong_value_is_told_with_the_name_of_today(self):
        with pytest.raises(InputError, match=r"network\.shares = 'even'.*--set"):
            merge([assignment_layer(["reward.shares=even"])])


class TestRuns:
    def test_are_listed_and_compared_by_either_name(self, orchid, runs_dir):
        old = make_run(runs_dir, "old", config={"network__shares": "se"})
        write_as_formerly(old)
        new = make_run(runs_dir, "new", config={"network__shares": "pf"})
        for key in ("reward.shares", "network.shares"):
            listed = json.loads(
                orchid("runs", "list", "--runs-dir", runs_dir, "--json", f"--where={key}=se").out
            )
            assert [run["id"] for run in listed["runs"]] == [old.name]
        config = json.loads(orchid("runs", "show", old, "--json").out)["config"]
        assert config["network.shares"] == "se"
        assert "reward.shares" not in config
        assert "network.shares\tse\tpf" in orchid("runs", "compare", old, new).out

    def test_of_the_first_version_go_on_bit_for_bit(self, orchid, runs_dir, new_runs, monkeypatch):
        flags = [*TINY_FLAGS, "--shares=se", "--episodes=6", "--quiet", "--runs-dir", runs_dir]
        assert orchid("train", *flags).code == 0
        [whole] = new_runs()
        show = Reporter.show

        def show_and_interrupt(self, rows, reset_episodes):
            show(self, rows, reset_episodes)
            if rows[-1]["episode"] == 3:
                signal.raise_signal(signal.SIGINT)

        with monkeypatch.context() as patch:
            patch.setattr(Reporter, "show", show_and_interrupt)
            assert orchid("train", *flags).code == 130
        [stopped] = set(new_runs()) - {whole}
        write_as_formerly(stopped)
        config = (stopped / "config.json").read_bytes()
        assert b'"network": {"area_m"' in config
        assert orchid("train", "--resume", stopped, "--quiet").code == 0
        assert (stopped / "config.json").read_bytes() == config
        for name in ("episodes.csv", "policy.safetensors"):
            assert (stopped / name).read_bytes() == (whole / name).read_bytes()
        assert read_policy(stopped).config == read_policy(whole).config
        # Extended, it is written anew, as all that is new.
        assert orchid("train", "--resume", stopped, "--episodes=7", "--quiet").code == 0
        written = json.loads((stopped / "config.json").read_text())
        assert written["network"]["shares"] == "se"
        assert "shares" not in written["reward"]
        assert record_of(stopped)["status"] == "completed"


def test_an_interrupted_evaluation_of_the_first_version_goes_on(tmp_path):
    plan = EvaluationPlan([rules()["static-mmf"]], [Setting()], 2, 0, Parameters())
    settings = describe_plan(plan, 3000)
    former = json.loads(json.dumps(settings.to_json()))
    former["world"] = as_formerly(former["world"])
    for method in former["methods"]:
        method["overrides"]["reward.shares"] = method["overrides"].pop("network.shares")
    write_json(tmp_path / "summary.json", {"status": "interrupted", "settings": former})
    before = fingerprint(tmp_path)
    assert read_interrupted(tmp_path, plan, settings) == {}
    other = Parameters().with_overrides({"area_m": 500.0})
    other_plan = EvaluationPlan(plan.contenders, plan.settings, 2, 0, other)
    with pytest.raises(InputError, match="other settings: world"):
        read_interrupted(tmp_path, other_plan, describe_plan(other_plan, 3000))
    assert fingerprint(tmp_path) == before


def test_a_study_of_the_first_version_goes_on(tmp_path):
    ablation = Ablation(
        tiny_config(), [Variant("no-rf", {"reset.enabled": False})], [0], 5, 0, 0.05
    )
    AblationStudy(ablation, tmp_path / "study", ["orchid"]).reserve()
    file = tmp_path / "study/ablation.json"
    document = json.loads(file.read_text())
    document["settings"]["base"] = as_formerly(document["settings"]["base"])
    write_json(file, document)
    AblationStudy(ablation, tmp_path / "study", ["orchid"]).reserve()
    assert "shares" in json.loads(file.read_text())["settings"]["base"]["network"]


def test_a_study_goes_on_that_lacks_keys_of_today(tmp_path):
    ablation = Ablation(
        tiny_config(ppo__minibatch="rows"),
        [Variant("no-rf", {"reset.enabled": False})],
        [0],
        5,
        0,
        0.05,
    )
    AblationStudy(ablation, tmp_path / "study", ["orchid"]).reserve()
    file = tmp_path / "study/ablation.json"
    document = json.loads(file.read_text())
    del document["settings"]["base"]["ppo"]["minibatch"]
    del document["settings"]["base"]["training"]["final_learning_rate_scale"]
    write_json(file, document)
    AblationStudy(ablation, tmp_path / "study", ["orchid"])
    slots = dataclasses.replace(ablation, base=tiny_config(ppo__minibatch="slots"))
    with pytest.raises(InputError, match="another base"):
        AblationStudy(slots, tmp_path / "study", ["orchid"])


class TestBatchSizeWithoutMinibatch:
    """Before there was ``ppo.minibatch``, a batch counted rows."""

    @staticmethod
    def without_minibatch(sections):
        del sections["ppo"]["minibatch"]
        return sections

    def test_in_a_file_counts_rows(self, orchid, tmp_path):
        file = tmp_path / "lab.json"
        sections = tiny_config(ppo__minibatch="slots").model_dump(mode="json")
        file.write_text(json.dumps(sections))
        assert merge([file_layer(file)])[0].ppo.minibatch == "slots"
        file.write_text(json.dumps(self.without_minibatch(sections)))
        config, sources = merge([file_layer(file)])
        assert config.ppo.minibatch == "rows"
        assert sources["ppo.minibatch"] == str(file)
        shown = json.loads(orchid("config", "show", "--json", "--config", file).out)
        assert shown["ppo"]["minibatch"] == "rows"

    def test_in_a_file_without_either_it_is_the_default(self, tmp_path):
        file = tmp_path / "lab.toml"
        file.write_text("[ppo]\nepochs = 3\n")
        assert merge([file_layer(file)])[0].ppo == RunConfig().ppo.model_copy(update={"epochs": 3})

    def test_in_a_run_counts_rows(self, runs_dir):
        run = make_run(runs_dir, config={"ppo__minibatch": "rows"})
        sections = self.without_minibatch(json.loads((run / "config.json").read_text()))
        (run / "config.json").write_text(json.dumps(sections))
        digest = hashlib.sha256((run / "config.json").read_bytes()).hexdigest()
        reseal(run / "run.json", config_sha256=digest)
        assert read_config(run, read_record(run)).ppo.minibatch == "rows"
        assert read_run(run).config["ppo.minibatch"] == "rows"
