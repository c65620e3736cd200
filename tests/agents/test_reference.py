"""The released policies are what their records say."""

import hashlib
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.evaluation.methods import (
    COMMANDS,
    METHOD_KEYS,
    RELEASED,
    read_released,
    select,
)
from orchid_uav.experiments.runs.directory import final_metrics, read_episodes
from studies.reference_policies import EVALUATION_FILE, KEPT_FILES, REFERENCE, TOPOLOGIES, fly

KEYS = sorted(RELEASED)
EPISODES = {"orchid-pf": 1000, "orchid-distilled": 400, "orchid-informed": 3000}
"""Of policies that have others than the paper's."""


def record_of(key):
    return json.loads((REFERENCE / key / "run.json").read_text())


@pytest.mark.parametrize("setting", ["core.autocrlf=true", "core.eol=crlf"])
def test_a_checkout_has_the_same_bytes_on_every_system(tmp_path, setting):
    root = REFERENCE.parent.parent

    def git(*arguments):
        return subprocess.run(
            ["git", "-C", root, "-c", setting, *arguments],
            capture_output=True,
            text=True,
            check=False,
        )

    listed = git("ls-files", "--", "runs/reference", "tests/data", "studies/results", "Makefile")
    if listed.returncode != 0 or not listed.stdout:
        pytest.skip(f"this is no checkout of git: {listed.stderr}")
    names = [name for name in listed.stdout.splitlines() if (root / name).is_file()]
    written = git("checkout-index", f"--prefix={tmp_path}/", "--", *names)
    assert written.returncode == 0, written.stderr
    for name in names:
        # What is being worked on may differ from what is kept, but not in its ends of lines.
        assert (b"\r\n" in (tmp_path / name).read_bytes()) == (
            b"\r\n" in (root / name).read_bytes()
        ), name
    for key in KEYS:
        folder = tmp_path / "runs/reference" / key
        record = json.loads((folder / "run.json").read_text())
        content = (folder / "config.json").read_bytes()
        assert hashlib.sha256(content).hexdigest() == record["config_sha256"], key


def test_every_released_policy_is_there_and_small():
    assert (
        sorted(
            path.name
            for path in REFERENCE.iterdir()
            if path.is_dir() and path.name != ("__pycache__")
        )
        == KEYS
        == sorted(COMMANDS)
    )
    for key in KEYS:
        names = {path.name for path in (REFERENCE / key).iterdir()}
        assert names == {*KEPT_FILES, "run.json", EVALUATION_FILE}
    assert sum(path.stat().st_size for path in REFERENCE.rglob("*")) < 8e6


@pytest.mark.parametrize("key", KEYS)
def test_weights_are_those_that_were_recorded(key):
    description = json.loads((REFERENCE / key / "policy.json").read_text())
    weights = (REFERENCE / key / "policy.safetensors").read_bytes()
    assert hashlib.sha256(weights).hexdigest() == description["sha256"]
    assert description["run"] == record_of(key)["id"] == read_released(key).run


@pytest.mark.parametrize("key", KEYS)
def test_the_documented_command_gives_the_recorded_configuration(orchid, key):
    merged = RunConfig.model_validate_json(orchid("config", "show", "--json", *COMMANDS[key]).out)
    stored = RunConfig.model_validate_json((REFERENCE / key / "config.json").read_text())
    assert flatten(stored) == flatten(merged)
    assert record_of(key)["command"] == ["orchid", "train", *COMMANDS[key], "--name", key]


@pytest.mark.parametrize("key", KEYS)
def test_it_is_evaluated_with_what_it_was_trained_with(key):
    (entry,) = select([key])
    stored = flatten(entry.policy.config)
    defaults = flatten(RunConfig())
    for name in METHOD_KEYS:
        assert entry.overrides.get(name, defaults[name]) == stored[name], name


@pytest.mark.parametrize("key", KEYS)
def test_the_record_agrees_with_the_episodes(key):
    record = record_of(key)
    rows = read_episodes(REFERENCE / key / "episodes.csv")
    assert record["status"] == "completed"
    assert len(rows) == record["episodes"] == EPISODES.get(key, 700)
    assert record["final"] == pytest.approx(final_metrics(rows))
    resets = [row["episode"] for row in rows if row["reset"]]
    assert resets == record["reset_episodes"]
    assert bool(resets) == (
        key in ("orchid", "orchid-pf", "orchid-random-init", "orchid-tuned", "orchid-informed")
    )


def test_no_record_names_a_machine_or_a_path_of_one():
    for path in REFERENCE.rglob("*.json"):
        text = path.read_text()
        assert str(Path.home()) not in text and "/tmp" not in text and '"boot_id"' not in text
    for key in KEYS:
        assert "name" not in record_of(key)["host"]


@pytest.mark.parametrize("key", KEYS)
def test_its_evaluation_is_reproduced(key):
    recorded = json.loads((REFERENCE / key / EVALUATION_FILE).read_text())
    figures = fly(key)
    assert set(figures) == set(recorded)
    for name, values in figures.items():
        assert len(values) == len(recorded[name]) == TOPOLOGIES
        # Matrices are multiplied in another order on other processors, and flights drift apart.
        close = {"rel": 1e-3, "abs": 0.1 if "violations" in name or "pairs" in name else 1e-6}
        assert np.mean(values) == pytest.approx(np.mean(recorded[name]), **close), name
