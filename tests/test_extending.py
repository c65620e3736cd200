"""The files of ``examples/extending`` are short, run, and fly beside all others."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "examples" / "extending"
FILES = sorted(FOLDER.glob("*.py"))
TRAINED = {
    "own_observation": ("Informed", {"episodes": 2}),
    "own_reward": ("Frugal", {"episodes": 2}),
    "sb3_learner": ("IndependentPPO", {"episodes": 2}),
    "pettingzoo_learner": ("Linear", {"rounds": 2, "candidates": 4, "elite": 2}),
}
"""Classes that fly what was learned, and how little is learned here."""


@pytest.fixture
def example(monkeypatch):
    """Imports a file of the folder by its name."""

    def imported(name: str):
        specification = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
        module = importlib.util.module_from_spec(specification)
        monkeypatch.setitem(sys.modules, name, module)
        specification.loader.exec_module(module)
        return module

    return imported


@pytest.fixture
def fly(orchid, tmp_path):
    """Flies a method of a file beside two others in tiny worlds; calls give its result."""

    def flown(specification: str) -> dict:
        finished = orchid(
            *("eval", "--methods=orchid,static-mmf", f"--method={specification}", "--uavs=2"),
            *("--users=20", "--set=network.episode_slots=10", "--episodes=3", "--no-figures"),
            *("--quiet", "--out", tmp_path / "out"),
        )
        assert finished.code == 0, finished.err
        results = json.loads((tmp_path / "out" / "summary.json").read_text())["results"]
        assert [result["method"] for result in results[:2]] == ["orchid", "static-mmf"]
        (own,) = results[2:]
        return own | {"others": results[:2]}

    return flown


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_file_has_at_most_60_lines_and_says_how_it_is_run(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 60
    assert f"examples/extending/{path.name}" in text


def test_each_is_tried_here():
    assert {path.stem for path in FILES} == {"own_rule", "own_channel", *TRAINED}


def test_a_rule_flies_beside_others(fly):
    own = fly(f"{FOLDER / 'own_rule.py'}:FollowServed")
    assert own["method"] == "follow-served"
    for other in own["others"]:
        assert own["nearest_uav_m"] != other["nearest_uav_m"]
        assert own["coverage"]["mean"] > 0.5


@pytest.mark.parametrize("name", TRAINED)
def test_what_is_learned_flies_beside_others(example, fly, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    kind, little = TRAINED[name]
    example(name).train(**little, uavs=2, users=20, episode_slots=10)
    own = fly(f"{FOLDER / name}.py:{kind}")
    static = own["others"][1]
    assert own["utility"]["mean"] > 0.0
    assert own["propulsion_power_w"] != static["propulsion_power_w"]  # it moves


def test_woods_weaken_who_is_far(example, monkeypatch):
    channel = example("own_channel")
    small = {"worlds": 3, "uav_count": 2, "user_count": 20, "episode_slots": 10}
    built_in = channel.fly(**small)
    woods = channel.fly(channel.woodland_path_loss_db, **small)
    assert woods["propulsion_power_w"] == built_in["propulsion_power_w"]
    assert woods["sum_rate_bps"] != built_in["sum_rate_bps"]
    assert woods["coverage"] > 0.0


def test_own_observations_and_terms_are_what_the_worlds_show(example):
    from orchid_uav.envs import make_vec_env

    observe, cost = example("own_observation").observe, example("own_reward").radio_cost
    small = {"uavs": 3, "users": 20, "episode_slots": 10}
    env = make_vec_env(observe=observe, extra_reward=cost, **small)
    assert env.observation_space["observation"].shape == (18,)
    rows = env.reset()["observation"].reshape(3, 18)
    world = env.world
    assert (rows[:, :16] == world.arrays.observations[0]).all()
    for uav in range(3):
        mine = world.arrays.user_coordinates_m[0][:, world.arrays.association[0] == uav]
        way_m = mine.mean(axis=1) - world.arrays.positions_m[0, uav, :2] if mine.size else 0.0
        area_m = world.parameters.network.area_m
        assert rows[uav, 16:] * area_m == pytest.approx(way_m, abs=0.01)
    assert cost(world)[0, 0] == -0.5 * world.arrays.transmit_powers_w[0, 0] / 0.2
