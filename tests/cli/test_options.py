"""Options come from the fields of the configuration: a key with a flag is a change in one place."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import orchid_uav
from orchid_uav.experiments.configuration import (
    FLAGS,
    SETTING_KEYS,
    merge,
    preset_layer,
)
from orchid_uav.experiments.evaluation.flights import SETTING_FIELDS
from orchid_uav.experiments.presets import PRESETS
from tests.helpers.processes import Finished, assert_is_an_error

FURTHER_KEYS = '''
    antenna_count: Annotated[int, within(1, 8), Flag("antennas")] = 1
    """Antennas of a UAV (M2)."""
    beam_width_deg: Annotated[Pair, Flag("beam")] = (60.0, 30.0)
    """Beam's widths."""
    is_windy: Annotated[bool, Flag("wind", help="With wind.")] = False
    """Whether there is wind."""
    pace: Annotated[Literal["calm", "brisk"], Flag("pace", "method")] = "calm"
    """How UAVs fly."""
'''


def words_of(help_text: str) -> str:
    """What a help says, without its boxes and the ends of its lines."""
    return " ".join(re.sub("[╭╮╰╯─│]", " ", help_text).split())


@pytest.fixture(scope="module")
def further(tmp_path_factory):
    """Runs ``orchid`` from a copy of the package in which nothing but FURTHER_KEYS was added."""
    root = tmp_path_factory.mktemp("further")
    shutil.copytree(Path(orchid_uav.__file__).parent, root / "orchid_uav")
    file = root / "orchid_uav/envs/parameters.py"
    text, place = file.read_text(encoding="utf-8"), "    area_m: "
    assert text.count(place) == 1
    file.write_text(text.replace(place, FURTHER_KEYS.lstrip("\n") + place), encoding="utf-8")

    def run(*arguments: str) -> Finished:
        finished = subprocess.run(
            [sys.executable, "-m", "orchid_uav", *arguments],
            cwd=root,
            env=os.environ | {"PYTHONPATH": str(root), "COLUMNS": "100", "NO_COLOR": "1"},
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        return Finished(finished.returncode, finished.stdout, finished.stderr)

    return run


class TestAFurtherKey:
    @pytest.mark.parametrize("command", [["train"], ["config", "show"]])
    def test_is_in_the_help(self, further, command):
        told = words_of(further(*command, "--help").out)
        assert "--antennas" in told
        assert "Antennas of a UAV (default: 1)." in told
        assert "Beam's widths (°; default: 60,30)." in told
        assert "--wind With wind." in told
        assert "How UAVs fly (default: calm)." in told
        assert "calm|brisk" in told

    def test_takes_effect(self, further):
        given = ["--antennas=4", "--beam", "20,10", "--wind", "--pace=brisk"]
        shown = json.loads(further("config", "show", "--json", *given).out)
        expected = {"antenna_count": 4, "beam_width_deg": [20.0, 10.0]}
        expected |= {"is_windy": True, "pace": "brisk"}
        assert {key: shown["network"][key] for key in expected} == expected
        rows = [line.split("\t") for line in further("config", "show", *given).out.splitlines()]
        assert ["network.antenna_count", "4", "", "1..8", "--antennas"] in rows

    @pytest.mark.parametrize(
        ("given", "parts"),
        [
            ("--antennas=9", ["network.antenna_count = 9", "1..8", "--antennas"]),
            ("--antennas=many", ["--antennas", "many"]),
            ("--beam=20", ["network.beam_width_deg", "--beam"]),
            ("--pace=slow", ["--pace", "slow", "calm", "brisk"]),
        ],
    )
    def test_refuses_a_wrong_value(self, further, given, parts):
        assert_is_an_error(further("train", given), *parts)

    def test_of_methods_is_a_variant_and_any_other_one_of_the_base(self, further):
        told = words_of(further("ablate", "--help").out)
        assert "--pace LIST How UAVs fly (calm, brisk; default: calm)." in told
        assert "Antennas of a UAV (default: 1)." in told
        finished = further("ablate", "--pace=brisk,slow")
        assert_is_an_error(finished, "--pace 'slow'", "network.pace is one of calm, brisk")


class TestOptions:
    def test_have_names_of_their_own(self):
        names = [flag.name for flag in FLAGS.values()]
        assert len(set(names)) == len(names)

    @pytest.mark.parametrize(
        ("command", "wanted"),
        [
            ("train", [flag for flag in FLAGS.values() if flag.is_of_runs]),
            ("ablate", [flag for flag in FLAGS.values() if flag.varies == "method"]),
            ("eval", [flag for flag in FLAGS.values() if flag.varies == "world"]),
        ],
    )
    def test_are_in_the_help_of_their_commands(self, orchid, command, wanted):
        told = words_of(orchid(command, "--help").out)
        assert wanted
        for flag in wanted:
            assert f"--{flag.name} " in told

    @pytest.mark.parametrize(
        ("command", "given", "meant"),
        [("plan", "--uavs", "--drones"), ("eval", "--drones", "--uavs")],
    )
    def test_are_told_to_who_says_drones_for_uavs(self, orchid, command, given, meant):
        refused = orchid(command, given, "3")
        assert_is_an_error(refused, given, meant)  # in words of Typer's
        assert "--mast" not in refused.err

    def test_of_an_evaluation_list_what_a_setting_consists_of(self):
        assert set(SETTING_KEYS) == set(SETTING_FIELDS)

    def test_of_words_in_a_list_refuse_others(self, orchid):
        finished = orchid("eval", "--distribution=tcp,even")
        assert_is_an_error(finished, "--distribution 'even'", "tcp, uniform")


class TestPresets:
    @pytest.mark.parametrize("name", PRESETS)
    def test_leave_reset_and_finetune_something_to_do(self, orchid, name):
        config, _ = merge([preset_layer(name)])
        assert 2 * config.reset.window < config.training.episodes / 2
        assert name in words_of(orchid("train", "--help").out)

    def test_quick_is_the_papers_network_in_a_seventh_of_the_episodes(self, orchid):
        shown = orchid("config", "show", "--preset=quick").out.splitlines()
        changed = {line.split("\t")[0]: line.split("\t")[1] for line in shown if "preset" in line}
        assert changed == {
            "reset.window": "20",
            "checkpoint.every_episodes": "20",
            "training.episodes": "100",
        }

    def test_are_documented(self):
        page = Path(__file__).parents[2] / "docs/configuration.md"
        for name in PRESETS:
            assert f"| `{name}` |" in page.read_text(encoding="utf-8")
