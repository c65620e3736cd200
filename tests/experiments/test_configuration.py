"""Presets, files, --set and flags become one configuration; wrong ones are told what is right."""

import json
import math
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from orchid_uav.envs.arrays import Constants
from orchid_uav.envs.keys import Section, unit_of, values_of
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments import presets
from orchid_uav.experiments.configuration import (
    FLAGS,
    Layer,
    RunConfig,
    assignment_layer,
    configuration_keys,
    field_of,
    file_layer,
    flatten,
    merge,
    preset_layer,
    reward_differences,
    spare_uavs_note,
)
from orchid_uav.experiments.errors import InputError
from tests.helpers.processes import ESCAPE, assert_is_an_error

DEFAULTS = flatten(RunConfig())
NUMERIC = [
    key
    for key, value in DEFAULTS.items()
    if key in {"network.total_bandwidth_hz", "uav.initial_transmit_power_w"}
    or (isinstance(value, int | float) and not isinstance(value, bool))
]
UNITS_OF_KEYS = {
    "network.area_m": "m",
    "network.total_bandwidth_hz": "Hz",
    "network.user_speed_mps": "m/s",
    "network.heading_hold_s": "s",
    "uav.displacement_scale_m": "m",
    "uav.initial_transmit_power_w": "W",
    "rotor.air_density_kg_per_m3": "kg/m³",
    "rotor.disc_area_m2": "m²",
    "rotor.mass_kg": "kg",
    "channel.excess_loss_nlos_db": "dB",
    "channel.noise_density_dbm_per_hz": "dBm/Hz",
    "channel.access_receive_gain_dbi": "dBi",
    "gbs.transmit_power_dbm": "dBm",
    "reward.log_rate_floor_bps": "bit/s",
    "network.user_count": "",
    "network.episode_slots": "",
    "channel.s_curve_a": "",
    "ppo.actor_learning_rate": "",
    "ppo.hidden_sizes": "",
    "reset.max_resets": "",
    "training.threads": "",
}
ENDS_THAT_ARE_UNITS = (
    *("_m", "_m2", "_m3", "_hz", "_s", "_mps", "_w", "_kg"),
    *("_db", "_dbi", "_dbm", "_bps", "_deg", "_joule"),
)


def sections() -> dict[str, type[Section]]:
    return {name: type(info.default) for name, info in RunConfig.model_fields.items()}


def table(text: str) -> dict[str, list[str]]:
    """[value, unit, source] by key, from what ``orchid config show`` prints off a terminal."""
    header, *lines = text.splitlines()
    assert header.split("\t") == ["key", "value", "unit", "values", "from"]
    rows = [line.split("\t") for line in lines]
    assert {len(row) for row in rows} == {5}
    return {key: [value, unit, source] for key, value, unit, _, source in rows}


def is_accepted(key: str, value: Any) -> bool:
    try:
        merge([Layer("test", {key: value})])
    except InputError:
        return False
    return True


def as_toml(nested: dict[str, dict[str, Any]]) -> str:
    """TOML of a configuration; it has no null, and none of these values needs more than JSON's."""
    lines = []
    for section, fields in nested.items():
        inner = {name: value for name, value in fields.items() if isinstance(value, dict)}
        lines.append(f"[{section}]")
        own = {name: value for name, value in fields.items() if name not in inner}
        lines += [f"{key} = {json.dumps(value)}" for key, value in own.items()]
        lines.append(as_toml({f"{section}.{name}": value for name, value in inner.items()}))
    return "\n".join(lines)


class TestKeys:
    def test_the_keys_that_other_programs_rely_on_exist(self):
        promised = {
            "network": "area_m user_count uav_count total_bandwidth_hz subband_bandwidth_hz "
            "distribution hotspot_count scatter_std_m sensing_error_std_m user_speed_mps "
            "heading_hold_s slot_s episode_slots",
            "channel": "carrier_frequency_hz s_curve_a s_curve_b excess_loss_los_db "
            "excess_loss_nlos_db noise_density_dbm_per_hz required_snr_db",
            "deployment": "init n_init",
            "reset": "enabled window tolerance_jfi tolerance_reward kappa max_resets",
            "training": "episodes seed worlds algorithm",
        }
        keys = configuration_keys()
        for section, fields in promised.items():
            assert {f"{section}.{field}" for field in fields.split()} <= set(keys)
        assert {key.partition(".")[0] for key in keys} >= {"uav", "rotor", "gbs", "reward", "ppo"}

    def test_every_key_and_section_says_in_a_sentence_what_it_is(self):
        for name, section in sections().items():
            assert (RunConfig.model_fields[name].description or "").endswith("."), name
            for field, info in section.model_fields.items():
                description = info.description or ""
                assert len(description) > 5, f"{name}.{field}"
                assert description.endswith("."), f"{name}.{field}"

    @pytest.mark.parametrize(("key", "unit"), UNITS_OF_KEYS.items())
    def test_units(self, key, unit):
        assert key in DEFAULTS
        assert unit_of(key) == unit

    def test_a_key_shows_a_unit_exactly_if_its_name_ends_in_one(self, orchid):
        shown = table(orchid("config", "show").out)
        assert list(shown) == configuration_keys()
        for key, (_, unit, _) in shown.items():
            assert bool(unit) == key.endswith(ENDS_THAT_ARE_UNITS), key

    def test_the_table_tells_what_a_key_may_hold(self, orchid):
        told = dict(line.split("\t")[0:4:3] for line in orchid("config", "show").out.splitlines())
        assert told["network.slot_s"] == "0.001..86400"
        assert told["network.total_bandwidth_hz"] == "1..1e+12 or none"
        assert told["network.shares"] == "mmf, pf, se or none"
        assert told["reset.enabled"] == "true, false"
        assert told["ppo.hidden_sizes"] == "1..16 × 1..4096"
        assert all(told.values())

    def test_the_paper_preset_is_the_default(self):
        assert merge([preset_layer("paper")])[0] == RunConfig() == merge([])[0]


class TestMerging:
    def test_preset_then_file_then_set_then_flags(self, orchid, tmp_path, monkeypatch):
        network = {"uav_count": 2, "user_count": 22, "area_m": 200.0, "slot_s": 0.5}
        preset = presets.Preset("a lab's", {"network": network})
        monkeypatch.setitem(presets.PRESETS, "lab", preset)
        file = tmp_path / "lab.toml"
        file.write_text("[network]\nuav_count = 3\nuser_count = 33\narea_m = 300.0\n")
        # The order on the command line does not matter.
        arguments = ["--uavs=5", "--set=network.uav_count=4", "--set=network.user_count=44"]
        shown = table(orchid("config", "show", *arguments, "--config", file, "--preset", "lab").out)
        assert shown["network.slot_s"] == ["0.5", "s", "preset lab"]
        assert shown["network.area_m"] == ["300", "m", str(file)]
        assert shown["network.user_count"] == ["44", "", "--set"]
        assert shown["network.uav_count"] == ["5", "", "--uavs"]
        assert shown["network.distribution"] == ["tcp", "", "default"]

    @pytest.mark.parametrize(
        ("flag", "key", "value"),
        [
            ("--uavs=3", "network.uav_count", 3),
            ("--users=30", "network.user_count", 30),
            ("--distribution=uniform", "network.distribution", "uniform"),
            ("--init=random", "deployment.init", "random"),
            ("--objective=pf", "reward.objective", "pf"),
            ("--shares=se", "network.shares", "se"),
            ("--episodes=9", "training.episodes", 9),
            ("--seed=11", "training.seed", 11),
            ("--worlds=4", "training.worlds", 4),
            ("--algorithm=mappo", "training.algorithm", "mappo"),
            ("--kappa=0.1", "reset.kappa", 0.1),
            ("--no-rf", "reset.enabled", False),
        ],
    )
    def test_a_flag_sets_its_key_and_no_other(self, orchid, flag, key, value):
        shown = json.loads(orchid("config", "show", "--json", flag).out)
        assert flatten(RunConfig.model_validate(shown)) == DEFAULTS | {key: value}
        as_table = table(orchid("config", "show", flag).out)
        sources = {name: cells[2] for name, cells in as_table.items()}
        assert sources == dict.fromkeys(DEFAULTS, "default") | {key: flag.partition("=")[0]}

    def test_of_two_assignments_to_a_key_the_later_one_counts(self):
        layer = assignment_layer(["ppo.epochs=3", "ppo.epochs=7"])
        assert merge([layer])[0].ppo.epochs == 7

    def test_a_flag_that_repeats_the_default_still_wins(self):
        layers = [
            Layer("--set", {"network.uav_count": 3}),
            Layer("--uavs", {"network.uav_count": 6}),
        ]
        merged, sources = merge(layers)
        assert merged == RunConfig()
        assert sources["network.uav_count"] == "--uavs"

    @pytest.mark.parametrize(
        ("assignment", "expected"),
        [
            ("network.total_bandwidth_hz=60e6", 60e6),
            ("network.total_bandwidth_hz=none", None),
            ("network.total_bandwidth_hz=null", None),
            (" network.area_m = 500 ", 500.0),
            ("network.distribution=uniform", "uniform"),
            ('network.distribution="uniform"', "uniform"),
            ("reset.enabled=false", False),
            ("ppo.hidden_sizes=[8, 9]", (8, 9)),
            ("ppo.hidden_sizes=8,9", (8, 9)),
            ("maddpg.hidden_sizes=64", (64,)),
            ("uav.displacement_scale_m=15,15,5", (15.0, 15.0, 5.0)),
            ("uav.displacement_scale_m = 1.5, 2e1 ,5", (1.5, 20.0, 5.0)),
            ("reward.backhaul_penalty=0,45", (0.0, 45.0)),
            ("reward.penalty_weight=[0.1,0.2]", (0.1, 0.2)),
        ],
    )
    def test_values_on_the_command_line(self, assignment, expected):
        merged, _ = merge([assignment_layer([assignment])])
        section, field = assignment.partition("=")[0].strip().split(".")
        assert getattr(getattr(merged, section), field) == expected

    def test_several_values_with_commas_for_every_key_that_takes_them(self):
        for key, value in DEFAULTS.items():
            if isinstance(value, list):
                given = ",".join(str(2 * one) for one in value)
                merged = flatten(merge([assignment_layer([f"{key}={given}"])])[0])
                assert merged == DEFAULTS | {key: [2 * one for one in value]}

    def test_only_what_was_changed(self, orchid, tmp_path, monkeypatch):
        preset = presets.Preset("a lab's", {"network": {"user_count": 22}})
        monkeypatch.setitem(presets.PRESETS, "lab", preset)
        file = tmp_path / "lab.toml"
        file.write_text("[uav]\nmax_speed_mps = 20.0\n[network]\nslot_s = 1.0\n")
        arguments = ["--preset=lab", "--algorithm=maddpg", "--uavs=6", "--changed"]
        arguments += ["--set=reward.penalty_weight=0.1,0.4", f"--config={file}"]
        header, *lines = orchid("config", "show", *arguments).out.splitlines()
        assert header.split("\t") == ["key", "value", "preset lab", "unit", "from"]
        assert [line.split("\t") for line in lines] == [
            ["uav.max_speed_mps", "20", "15", "m/s", str(file)],
            ["reward.penalty_weight", "0.1,0.4", "0.1,0.3", "", "--set"],
            ["reset.enabled", "false", "true", "", "algorithm maddpg"],
            ["training.algorithm", "maddpg", "mappo", "", "--algorithm"],
        ]
        document = json.loads(orchid("config", "show", "--json", *arguments).out)
        assert (document["schema"], document["preset"]) == (1, "lab")
        assert document["changed"][1] == {
            "key": "reward.penalty_weight",
            "value": [0.1, 0.4],
            "preset": [0.1, 0.3],
            "unit": "",
            "from": "--set",
        }
        assert len(document["changed"]) == 4
        unchanged = orchid("config", "show", "--changed")
        assert len(unchanged.out.splitlines()) == 1
        assert "nothing differs" in unchanged.err

    def test_what_is_shown_as_json_is_the_same_configuration_as_a_file(self, orchid, tmp_path):
        arguments = [
            *("--uavs=3", "--users=30", "--objective=pf", "--no-rf", "--kappa=0.1", "--seed=7"),
            "--set=ppo.actor_learning_rate=0.00030000000000000003",
            "--set=ppo.hidden_sizes=[7,5]",
            "--set=network.total_bandwidth_hz=6e7",
            "--set=uav.initial_transmit_power_w=0.123456789012345678",
        ]
        shown = orchid("config", "show", "--json", *arguments)
        assert shown.code == 0
        assert shown.err == ""
        file = tmp_path / "config.json"
        file.write_text(shown.out)
        assert orchid("config", "show", "--json", "--config", file).out == shown.out
        as_table = table(orchid("config", "show", "--config", file).out)
        assert {source for _, _, source in as_table.values()} == {str(file)}
        flagged = table(orchid("config", "show", *arguments).out)
        assert [cells[:2] for cells in as_table.values()] == [
            cells[:2] for cells in flagged.values()
        ]

    def test_toml_says_the_same_as_json(self, tmp_path):
        nested = RunConfig().model_dump(mode="json", exclude_none=True)
        nested["network"]["uav_count"] = 4
        toml, as_json = tmp_path / "a.toml", tmp_path / "a.json"
        toml.write_text(as_toml(nested))
        as_json.write_text(json.dumps(nested))
        assert tomllib.loads(toml.read_text()) == nested
        assert merge([file_layer(toml)])[0] == merge([file_layer(as_json)])[0]
        assert merge([file_layer(toml)])[0].network.uav_count == 4

    def test_showing_a_configuration_makes_no_files(self, orchid, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)
        assert orchid("config", "show").code == 0
        assert list(tmp_path.iterdir()) == []

    def test_off_a_terminal_there_are_no_escape_codes_even_for_errors(self, orchid):
        shown, failed = orchid("config", "show"), orchid("config", "show", "--uavs=0")
        assert ESCAPE not in shown.out + shown.err + failed.err


class TestWrongKeys:
    def test_the_nearest_right_key_is_named(self):
        for key in configuration_keys():
            section, _, field = key.partition(".")
            misspelt = f"{section}.{field[:1]}{field[2:]}" if len(field) > 4 else f"{key}x"
            with pytest.raises(InputError) as error:
                merge([assignment_layer([f"{misspelt}=1"])])
            assert f"'{misspelt}'" in str(error.value)
            assert f"'{key}'" in str(error.value)
            assert "--set" in str(error.value)

    @pytest.mark.parametrize(
        ("wrong", "right"),
        [
            ("uav_count", "network.uav_count"),
            ("ppo.uav_count", "network.uav_count"),
            ("netwrk.uav_count", "network.uav_count"),
            ("Network.UAV_count", "network.uav_count"),
            ("training.kappa", "reset.kappa"),
        ],
    )
    def test_a_wrong_or_missing_section_too(self, orchid, wrong, right):
        finished = orchid("config", "show", "--set", f"{wrong}=3")
        assert_is_an_error(finished, f"'{wrong}'", f"'{right}'")

    @pytest.mark.parametrize(("flag", "key"), [(flag.name, key) for key, flag in FLAGS.items()])
    def test_a_flags_name(self, tmp_path, flag, key):
        file = tmp_path / "lab.toml"
        file.write_text(f"{flag} = 3\n")
        for given in (flag, f"ppo.{flag}", f"--{flag}"):
            with pytest.raises(InputError, match=f"'{given}': did you mean '{key}'"):
                merge([assignment_layer([f"{given}=3"])])
        with pytest.raises(InputError, match=f"'{flag}': did you mean '{key}'"):
            file_layer(file)

    def test_a_key_of_several_sections(self, orchid):
        finished = orchid("config", "show", "--set=hidden_sizes=8")
        assert_is_an_error(finished, "'ppo.hidden_sizes' or 'maddpg.hidden_sizes'")

    @pytest.mark.parametrize(
        "assignment", ["=3", "qqq.zzz=3", "network=3", "network.=3", "a.b.c=3"]
    )
    def test_one_that_resembles_nothing(self, orchid, assignment):
        assert_is_an_error(orchid("config", "show", "--set", assignment), "unknown key")

    def test_an_assignment_without_a_value(self, orchid):
        assert_is_an_error(
            orchid("config", "show", "--set", "reset.kappa"), "reset.kappa", "section.key=value"
        )

    def test_a_preset(self, orchid):
        assert_is_an_error(orchid("config", "show", "--preset=papr"), "'papr'", "'paper'")


class TestWrongValues:
    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_no_number_may_be_infinite_or_none_at_all(self, value):
        for key in NUMERIC:
            with pytest.raises(InputError) as error:
                merge([Layer("lab.toml", {key: value})])
            assert f"{key} = {value!r}" in str(error.value)
            assert "lab.toml" in str(error.value)

    @pytest.mark.parametrize(
        ("assignment", "parts"),
        [
            ("network.slot_s=1e-300", ["0.001..86400 s"]),
            ("network.heading_hold_s=1e20", ["0.001..1e+09 s"]),
            ("network.uav_count=1000000", ["1..1000"]),
            ("uav.displacement_scale_m=15,15,1e9", ["1000000000.0", "within 0..1e+06 m"]),
            ("uav.displacement_scale_m=15,15", ["[15, 15]", "3 × 0..1e+06 m"]),
            ("reset.kappa=2", ["> 0, ≤ 1"]),
        ],
    )
    def test_extreme_ones_are_refused_with_the_range(self, orchid, assignment, parts):
        key = assignment.partition("=")[0]
        assert_is_an_error(orchid("config", "show", "--set", assignment), key, "--set", *parts)

    def test_every_number_has_a_range_which_is_told_and_kept(self):
        for key in NUMERIC:
            told = values_of(field_of(key))
            if "> 0" in told:
                assert not is_accepted(key, 0.0)
                continue
            least, greatest = map(float, told.partition(" or ")[0].split(".."))
            step = 1 if isinstance(DEFAULTS[key], int) else 0.0
            for wrong in (
                least - step if step else math.nextafter(least, -math.inf),
                greatest + step if step else math.nextafter(greatest, math.inf),
            ):
                with pytest.raises(InputError) as error:
                    merge([Layer("lab.toml", {key: wrong})])
                assert f"not within {told}" in str(error.value)
            for right in (least, greatest):  # alone it is right, though not beside the defaults
                try:
                    merge([Layer("lab.toml", {key: right})])
                except InputError as error:
                    assert "not within" not in str(error)

    def test_true_is_not_a_number(self):
        # "uav_count = true" is a slip of the pen, which must not quietly mean one UAV.
        assert [key for key in NUMERIC if is_accepted(key, True)] == []

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["--uavs=0"], ["network.uav_count", "0", "--uavs"]),
            (["--uavs=-3"], ["network.uav_count", "-3", "--uavs"]),
            (["--users=0"], ["network.user_count", "0", "--users"]),
            (["--episodes=0"], ["training.episodes", "0", "--episodes"]),
            (["--worlds=0"], ["training.worlds", "0", "--worlds"]),
            (["--seed=-1"], ["training.seed", "-1", "--seed"]),
            (["--seed=4294967296"], ["training.seed", "4294967296"]),
            (["--kappa=0"], ["reset.kappa", "0", "--kappa"]),
            (["--kappa=1.5"], ["reset.kappa", "1.5", "--kappa"]),
            (["--kappa=nan"], ["reset.kappa", "nan", "--kappa"]),
            (["--set=network.area_m=1e999"], ["network.area_m", "inf", "--set"]),
            (["--set=network.area_m=wide"], ["network.area_m", "'wide'", "--set"]),
            (["--set=network.area_m="], ["network.area_m", "''", "--set"]),
            (["--set=network.user_count=20.5"], ["network.user_count", "20.5"]),
            (["--set=reset.enabled=maybe"], ["reset.enabled", "'maybe'"]),
            (["--set=ppo.hidden_sizes=[]"], ["ppo.hidden_sizes", "[]"]),
            (["--set=ppo.hidden_sizes=[16,0]"], ["ppo.hidden_sizes", "0"]),
            (["--set=reward.penalty_weight=[1]"], ["reward.penalty_weight", "[1]"]),
            (["--set=reward.penalty_weight=[1,-2]"], ["reward.penalty_weight", "-2"]),
            (["--set=network.distribution=tpc"], ["network.distribution", "tpc", "tcp"]),
            (["--set=reset.window=0"], ["reset.window", "0"]),
            # Millions of threads end in an abort of the process, without a word and a record.
            (["--set=training.threads=1000000"], ["training.threads", "1000000"]),
        ],
    )
    def test_they_are_named_with_their_key_and_origin(self, orchid, arguments, parts):
        assert_is_an_error(orchid("config", "show", *arguments), *parts)

    @pytest.mark.parametrize(
        "arguments", [["--users=6"], ["--uavs=100"], ["--users=7", "--uavs=7"]]
    )
    def test_users_that_do_not_suffice_for_the_clusters(self, orchid, arguments):
        finished = orchid("config", "show", *arguments)
        assert_is_an_error(
            finished, "user_count", "uav_count", "masts", *(a[:6] for a in arguments)
        )

    def test_one_user_more_than_uavs_suffices(self, orchid):
        assert orchid("config", "show", "--users=7").code == 0

    def test_limits_that_contradict_each_other(self, orchid):
        finished = orchid("config", "show", "--set=uav.min_altitude_m=200")
        assert_is_an_error(finished, "min_altitude_m", "200", "initial_altitude_m", "100")

    def test_one_sample_is_too_few_to_learn_from(self, orchid):
        finished = orchid("config", "show", "--uavs=1", "--set=network.episode_slots=1")
        assert_is_an_error(finished, "episode_slots")

    @pytest.mark.parametrize(
        ("flag", "value", "right"),
        [
            ("--uavs", "six", "integer"),
            ("--kappa", "half", "--kappa"),
            ("--distribution", "tpc", "tcp"),
            ("--objective", "MMF", "mmf"),
        ],
    )
    def test_flags_of_the_wrong_kind_are_named_with_their_value(self, orchid, flag, value, right):
        assert_is_an_error(orchid("config", "show", flag, value), flag, value, right)


class TestFiles:
    @pytest.mark.parametrize("name", ["a.toml", "a.TOML", "a.Toml"])
    def test_toml_in_any_case(self, tmp_path, name):
        (tmp_path / name).write_text("[network]\nuav_count = 4\n")
        assert file_layer(tmp_path / name).values == {"network.uav_count": 4}

    @pytest.mark.parametrize("name", ["a.json", "a.JSON"])
    def test_json_in_any_case(self, tmp_path, name):
        (tmp_path / name).write_text('{"network": {"uav_count": 4}}')
        assert file_layer(tmp_path / name).values == {"network.uav_count": 4}

    def test_the_home_directory(self, tmp_path, monkeypatch):
        for variable in ("HOME", "USERPROFILE"):
            monkeypatch.setenv(variable, str(tmp_path))
        (tmp_path / "lab.toml").write_text("[network]\nuav_count = 4\n")
        layer = file_layer(Path("~/lab.toml"))
        assert layer.values == {"network.uav_count": 4}
        assert layer.source == str(Path("~/lab.toml"))

    @pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="there is no /dev/stdin")
    @pytest.mark.parametrize(
        "text", ["[network]\nuav_count = 4\n", '{"network": {"uav_count": 4}}']
    )
    def test_a_pipe_is_read_to_its_end(self, text):
        code = (
            "import sys; from pathlib import Path;"
            "from orchid_uav.experiments.configuration import file_layer;"
            "print(file_layer(Path('/dev/stdin'), lambda told: print(told, flush=True)).values)"
        )
        with subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdin is not None and process.stdout is not None
            process.stdin.write(text[:9])
            process.stdin.flush()
            assert "waiting" in process.stdout.readline()  # and only now comes the rest
            process.stdin.write(text[9:])
            process.stdin.close()
            assert process.stdout.read() == "{'network.uav_count': 4}\n"

    @pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="there is no /dev/stdin")
    def test_a_file_that_the_shell_opened(self, tmp_path):
        file = tmp_path / "lab"
        file.write_text("[network]\nuav_count = 4\n")
        with file.open() as opened:
            layer = file_layer(Path(f"/dev/fd/{opened.fileno()}"))
        assert layer.values == {"network.uav_count": 4}


class TestWrongFiles:
    @pytest.mark.parametrize(
        ("name", "content", "parts"),
        [
            ("a.toml", b"[network\nx = 1", ["not valid toml", "line 1"]),
            ("a.toml", b"[network]\narea_m = 1\narea_m = 2", ["not valid toml"]),
            ("a.toml", b"[netwrk]\nuav_count = 3", ["'netwrk'", "'network'"]),
            ("a.toml", b"[network]\nuav_cuont = 3", ["'network.uav_cuont'", "'network.uav_count'"]),
            ("a.toml", b"uav_count = 3", ["'uav_count'"]),
            ("a.toml", b"[network]\narea_m = nan", ["network.area_m", "nan"]),
            ("a.toml", b"[network]\narea_m = 2020-01-01", ["network.area_m", "2020"]),
            ("a.json", b'{"network": ', ["not valid json", "line 1"]),
            ("a.json", b"", ["not valid json"]),
            ("a.json", b"[1, 2]", ["sections"]),
            ("a.json", b'{"network": 3}', ["'network'", "not a section"]),
            ("a.json", b'{"network": {"area_m": NaN}}', ["network.area_m", "nan"]),
            ("a.json", b'{"network": {"area_m": null}}', ["network.area_m", "None"]),
            ("a.json", b"\xff\xfe\x00", ["cannot read"]),
            pytest.param("a.json", b"[" * 100_000, ["not valid json"], id="json, deep"),
            pytest.param("a.toml", b"a = " + b"[" * 100_000, ["not valid toml"], id="toml, deep"),
            ("a.yaml", b"network: {}", [".toml", ".json"]),
            ("noend", b"", [".toml", ".json"]),
        ],
    )
    def test_the_file_is_named_with_what_is_wrong(self, orchid, tmp_path, name, content, parts):
        file = tmp_path / name
        file.write_bytes(content)
        assert_is_an_error(orchid("config", "show", "--config", file), str(file), *parts)

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
    def test_a_pipe_that_nothing_is_written_to(self, orchid, tmp_path):
        pipe = tmp_path / "pipe.toml"
        os.mkfifo(pipe)
        assert_is_an_error(orchid("config", "show", "--config", pipe), str(pipe), "nothing")

    def test_one_that_is_far_too_large(self, orchid, tmp_path):
        file = tmp_path / "large.toml"
        file.write_bytes(b"#" * (2**20 + 1))
        assert_is_an_error(orchid("config", "show", "--config", file), str(file), "1 MiB")

    def test_a_home_directory_that_there_is_not(self, orchid):
        finished = orchid("config", "show", "--config=~no-such-user/lab.toml")
        assert_is_an_error(finished, "~no-such-user/lab.toml")

    def test_a_file_that_is_not_there_or_a_directory(self, orchid, tmp_path):
        missing = tmp_path / "missing.toml"
        assert_is_an_error(orchid("config", "show", "--config", missing), str(missing))
        assert_is_an_error(orchid("config", "show", "--config", tmp_path), str(tmp_path))

    def test_brackets_in_a_name_are_no_markup(self, orchid, tmp_path):
        file = tmp_path / "la[red]b[bold].json"
        file.write_text('{"network": {"uavs": 3}}')
        assert_is_an_error(orchid("config", "show", "--config", file), "la[red]b[bold].json")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"hotspot_count": 7}, None),
        ({"hotspot_count": 6}, "6 places at most, fewer than the 7 clusters of Phase I: 1 or more"),
        ({"hotspot_count": 2, "uav_count": 4}, "2 places at most, .*: 3 or more of the 4 UAVs"),
        ({"hotspot_count": 1}, "all users stand at one place"),
        ({"hotspot_count": 1, "positions_m": []}, "1 places at most, fewer than the 6 clusters"),
        ({"hotspot_count": 7, "positions_m": [[0, 0]] * 2}, "fewer than the 8 clusters"),
        ({"hotspot_count": 2, "positions_m": [[0, 0]] * 2}, "2 places at most, which Phase I"),
        ({"hotspot_count": 2, "distribution": "uniform"}, None),
        ({"hotspot_count": 2, "scatter_std_m": 1.0}, None),
        ({"hotspot_count": 2, "sensing_error_std_m": 1.0}, None),
    ],
)
def test_tells_of_uavs_to_spare_where_they_are_certain(changes, text):
    note = spare_uavs_note(Parameters().with_overrides({"scatter_std_m": 0.0, **changes}))
    assert note is None if text is None else re.search(text, note)


REWARDED = (
    *("coverage_weight", "efficiency_weight", "load_fairness_weight", "rate_fairness_weight"),
    *("penalty_weight", "collision_penalty", "boundary_penalty", "backhaul_penalty"),
    *("rewards_log_rates", "log_rate_floor_bps", "best_rate_bps", "power_epsilon_w"),
    *("efficiency_scale_bit_per_joule", "min_separation_m", "required_snr"),
    "backhaul_required_snr_db",
)
"""Constants of the compiled step that the reward is a function of, besides what is reached."""


def changed_a_little(value: Any) -> Any:
    match value:
        case bool():
            return not value
        case int():
            return value + 1
        case float():
            return value * 1.01 + 0.01
        case list():
            return [changed_a_little(one) for one in value]
    return {"mmf": "pf", "tcp": "uniform", "kmeans": "random"}.get(value, value)


@pytest.mark.parametrize("objective", ["mmf", "pf"])
def test_every_key_that_changes_the_reward_function_is_known(objective):
    base, _ = merge([Layer("base", {"reward.objective": objective})])
    of_base = flatten(base)
    constants = Constants.of(base.network_parameters)
    told = []
    for key, value in of_base.items():
        other = changed_a_little(value)
        if other == value:
            continue
        try:
            changed, _ = merge(
                [Layer("base", {"reward.objective": objective}), Layer("", {key: other})]
            )
        except InputError:  # more UAVs than users, say
            continue
        found = reward_differences([of_base, flatten(changed)])
        own = Constants.of(changed.network_parameters)
        is_another = any(
            getattr(own, name) != getattr(constants, name)
            for name in REWARDED
            if name != "log_rate_floor_bps" or own.rewards_log_rates
        )
        if is_another:
            assert found == [key]
        told += found
    assert {"network.episode_slots", "training.schedule_episodes"} <= set(told)
    assert not {"network.shares", "reset.kappa", "network.user_count", "training.seed"} & set(told)
    assert ("reward.log_rate_floor_bps" in told) == (objective == "pf")


def test_rewards_depend_on_the_number_of_uavs_that_divide_a_bandwidth():
    few, many = {"network.uav_count": 4}, {"network.uav_count": 6}
    assert reward_differences([few, many]) == []
    divided = [one | {"network.total_bandwidth_hz": 60e6} for one in (few, many)]
    assert reward_differences(divided) == ["network.uav_count"]
    assert reward_differences([{"training.episodes": 5}, {"training.episodes": 9}]) == [
        "training.schedule_episodes"
    ]
