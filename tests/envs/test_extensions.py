"""Parts of a lab's own: a channel, observations, a term of the reward."""

import itertools
import math
import sys
from types import ModuleType

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numba import njit
from numba.core import config
from pettingzoo.test import parallel_api_test

import orchid_uav  # registers orchid/Fleet-v0
from orchid_uav import notices
from orchid_uav.agents.controllers.heuristics import (
    BalancedLoiter,
    candidate_starts,
    repeat_topology,
)
from orchid_uav.agents.controllers.planner import Planner
from orchid_uav.envs import Parameters, WorldBatch, channel, make_vec_env, parallel_env
from orchid_uav.envs.compilation import compiled, digest_of, specialised
from orchid_uav.envs.dynamics import step_worlds
from orchid_uav.envs.metrics import LOAD_JFI, RATE_JFI
from orchid_uav.notices import show_on_stderr
from tests.envs.test_diagnostics import begun, count_both
from tests.envs.test_world import fly_both
from tests.helpers import independent_network as independent

assert orchid_uav.__version__
SMALL = {"uav_count": 3, "user_count": 20, "episode_slots": 12}
SHORT = {"uavs": 3, "users": 20, "episode_slots": 12}


def rippled_path_loss_db(ground_distance_m, altitude_m, carrier_frequency_hz):
    """Rises and falls with distance and with altitude, which pruning by distance cannot know.

    All altitudes but one are bad, and the built-in channel would not lead there. One function for
    all tests: the simulator is compiled anew for another.
    """
    ripples_db = 0.05 * ground_distance_m + 10.0 * math.cos(ground_distance_m / 90.0)
    return carrier_frequency_hz / 4e7 + ripples_db + 1.5 * abs(altitude_m - 83.0)


class TestChannel:
    def test_the_built_in_one_given_as_an_own_one_gets_all_of_its_parameters(self):
        changed = {"carrier_frequency_hz": 5e9, "s_curve_a": 12.08, "s_curve_b": 0.11}
        changed |= {"excess_loss_los_db": 1.6, "excess_loss_nlos_db": 23.0}
        setting = independent.Setting(
            carrier_hz=5e9, s_curve_a=12.08, s_curve_b=0.11, eta_los_db=1.6, eta_nlos_db=23.0
        )
        own = WorldBatch(
            Parameters().with_overrides(changed),
            air_to_ground_path_loss_db=channel.air_to_ground_path_loss_db,
        )
        compiled, _, link = own._own_path_loss
        for ground_m, up_m in itertools.product((0.0, 40.0, 700.0), (30.0, 120.0)):
            loss_db = independent.path_loss_db(setting, (ground_m, 0.0, up_m), (0.0, 0.0))
            assert compiled(ground_m, up_m, *link) == pytest.approx(loss_db, rel=1e-9)

    @pytest.fixture
    def rippled(self, monkeypatch):
        """The independent version has that channel too, but for what scales its rewards."""
        best_bps = independent.best_rate(independent.Setting())
        monkeypatch.setattr(independent, "best_rate", lambda setting: best_bps)
        monkeypatch.setattr(
            independent,
            "path_loss_db",
            lambda setting, uav_m, user_m: rippled_path_loss_db(
                math.dist(uav_m[:2], user_m), uav_m[2], 2.4e9
            ),
        )

    @pytest.mark.parametrize(
        "overrides", [{}, {"user_speed_mps": 10.0}, {"network.shares": "se", "uav_count": 3}]
    )
    def test_every_slot_is_that_of_the_independent_version(self, rippled, overrides):
        fly_both(
            Parameters().with_overrides({**overrides, "carrier_frequency_hz": 2.4e9}),
            seed=3,
            slots=12,
            progress=0.4,
            air_to_ground_path_loss_db=rippled_path_loss_db,
        )

    @pytest.mark.parametrize("rule", ["mmf", "pf", "se"])
    def test_every_link_is_computed_as_plain_loops_do(self, rippled, rule):
        overrides = {"network.shares": rule, "deployment.init": "random", "user_count": 40}
        overrides |= {"carrier_frequency_hz": 2.4e9}
        world, diagnostics = begun(
            overrides, worlds=4, seed=2, air_to_ground_path_loss_db=rippled_path_loss_db
        )
        assert count_both(world, diagnostics, slots=3, seed=0) > 0
        assert (world.arrays.association >= 0).any()

    def test_as_many_parameters_are_passed_as_it_takes(self):
        world = WorldBatch(
            Parameters().with_overrides({**SMALL, "carrier_frequency_hz": 2.4e9}),
            seed=0,
            air_to_ground_path_loss_db=rippled_path_loss_db,
        )
        assert world._own_path_loss.link == (2.4e9,)
        plain = WorldBatch(seed=0, air_to_ground_path_loss_db=lambda metres, up_m: 100.0)
        assert plain._own_path_loss.link == ()
        world.reset()
        positions_m, users_m = world.arrays.positions_m[0], world.arrays.user_coordinates_m[0].T
        noise_w, power_w = world.parameters.access_noise_power_w, world.arrays.transmit_powers_w
        gain_db = world.parameters.channel.access_gain_db
        for uav, user in np.ndindex(3, 20):
            ground_m = math.dist(positions_m[uav, :2], users_m[user])
            loss_db = 60.0 + 0.05 * ground_m + 10.0 * math.cos(ground_m / 90.0)
            loss_db += 1.5 * abs(positions_m[uav, 2] - 83.0)
            expected = np.log2(1.0 + power_w[0, uav] * 10 ** ((gain_db - loss_db) / 10) / noise_w)
            if world.arrays.association[0, user] == uav:
                served = world.arrays.spectral_efficiency[0, user]
                assert served == pytest.approx(expected, rel=1e-11)
        assert (world.arrays.association[0] >= 0).any()

    def test_the_built_in_step_is_left_alone(self):
        before = list(getattr(step_worlds, "signatures", []))
        world = WorldBatch(seed=0, air_to_ground_path_loss_db=rippled_path_loss_db)
        assert world.specialised(step_worlds) is not step_worlds
        assert WorldBatch(seed=0).specialised(step_worlds) is step_worlds
        assert list(getattr(step_worlds, "signatures", [])) == before

    def test_a_search_plans_for_the_channel_of_its_worlds(self):
        parameters = Parameters().with_overrides({"uav_count": 1, "user_count": 12})
        world = WorldBatch(parameters, seed=0, air_to_ground_path_loss_db=rippled_path_loss_db)
        world.reset()
        Planner(evaluations=800).begin(world)
        np.testing.assert_allclose(world.arrays.positions_m[0, :, 2], 83.0, atol=1.5)

    def test_the_best_of_some_starts_is_that_of_the_channel(self):
        own = {"air_to_ground_path_loss_db": rippled_path_loss_db}
        crowd = {"uav_count": 4, "user_count": 60}
        world = WorldBatch(Parameters().with_overrides(crowd), seed=3, **own)
        world.reset()
        starts_m, targets = candidate_starts(world, 0, 8, 0)
        trial = WorldBatch(world.parameters, worlds=len(starts_m), seed=0, **own)
        alike = repeat_topology(world, 0, len(starts_m))
        trial.use_topology(alike._replace(start_m=starts_m, target_users=targets))
        fairness = trial.arrays.metrics[:, LOAD_JFI] + trial.arrays.metrics[:, RATE_JFI]
        BalancedLoiter(restarts=8).begin(world)
        best_m = starts_m[np.argmax(fairness)]
        np.testing.assert_array_equal(world.arrays.positions_m[0, :, :2], best_m)
        assert len(np.unique(fairness)) > 1

    @pytest.mark.parametrize(
        ("own", "told"),
        [
            (lambda ground_distance_m: 100.0, "takes 1 arguments"),
            (lambda a, b, c, d, e, f, g, h: 100.0, "takes 8 arguments"),
            (lambda a, b: math.inf, "inf for a link"),
            (lambda a, b: "loud", "'loud' for a link"),
            (lambda a, b: a.nothing, "cannot be compiled"),
            (100.0, "not a function"),
        ],
    )
    def test_what_is_none_is_told(self, own, told):
        with pytest.raises(ValueError, match=told):
            WorldBatch(air_to_ground_path_loss_db=own)


LAB = "module_of_a_lab"
FILE = """
import math
import numpy as np
from math import pi

EXPONENT = 2.0
TABLE = np.array([1.0, 2.0])

def helper(x):
    return x * EXPONENT

def make(slope):
    def loss(d, z, offset=3.0):
        return helper(d) * slope + offset + math.log(z) + pi + TABLE[0]
    return loss

own = make(0.5)
"""


def defined(text: str):
    module = {"__name__": LAB}
    exec(compile(text, "lab.py", "exec"), module)
    return module["own"]


@pytest.fixture(autouse=True)
def lab(monkeypatch):
    """A module of the lab's that was imported."""
    monkeypatch.setitem(sys.modules, LAB, ModuleType(LAB))


class TestDigest:
    def test_is_none_for_a_module_that_is_not_imported(self, monkeypatch):
        own = defined(FILE)
        monkeypatch.delitem(sys.modules, LAB)
        assert digest_of(own) is None

    def test_is_the_same_for_the_same_file(self):
        assert digest_of(defined(FILE)) == digest_of(defined(FILE)) is not None
        assert digest_of(njit(defined(FILE))) == digest_of(defined(FILE))

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("make(0.5)", "make(0.6)"),
            ("EXPONENT = 2.0", "EXPONENT = 2"),
            ("[1.0, 2.0]", "[1.5, 2.0]"),
            ("offset=3.0", "offset=4.0"),
            ("x * EXPONENT", "x + EXPONENT"),
            ("+ pi +", "- pi +"),
            ("math.log(z)", "math.exp(z)"),
        ],
    )
    def test_is_another_for_every_change(self, old, new):
        changed = FILE.replace(old, new)
        assert changed != FILE
        assert digest_of(defined(changed)) not in (digest_of(defined(FILE)), None)

    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("+ pi +", "+ os.path.sep +"),
            ("+ pi +", "+ (lambda: EXPONENT)() +"),
        ],
    )
    def test_is_none_where_something_may_change_unseen(self, old, new):
        assert digest_of(defined("import os\n" + FILE.replace(old, new))) is None


SUM = """
def add(numbers, own=None, sources=""):
    for index in range(len(numbers)):
        numbers[index] += own(numbers[index], 1.0)
"""


@pytest.fixture
def add(tmp_path, monkeypatch, capsys):
    """A compiled function specialised as by a process that has just started.

    Calls give what was added to 1, how often code was read from the cache, and what was said.
    """
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "adding.py").write_text(SUM)
    show_on_stderr()

    def call(text: str) -> tuple[float, int, list[str]]:
        monkeypatch.setattr(notices, "_told", set())
        specialised.cache_clear()
        module = {"__name__": LAB}
        exec(compile(SUM, tmp_path / "adding.py", "exec"), module)
        own = defined(text)
        function = specialised(compiled(module["add"]), njit(own), digest_of(own))
        numbers = np.ones(1)
        capsys.readouterr()
        function(numbers)
        hits = sum(function.stats.cache_hits.values())
        return numbers[0] - 1.0, hits, capsys.readouterr().err.splitlines()

    return call


class TestCache:
    def test_code_is_found_again_by_the_function_that_it_was_made_for(self, add):
        one, two = (f"def own(d, z): return {value} * d" for value in (2.0, 3.0))
        assert add(one)[:2] == (2.0, 0)
        assert add(two)[:2] == (3.0, 0)
        assert add(one) == (2.0, 1, [])
        assert add(two) == (3.0, 1, [])

    def test_code_that_may_change_unseen_is_not_kept(self, add):
        text = "import os\ndef own(d, z): return d * len(os.sep)"
        for _ in range(2):
            added, hits, told = add(text)
            assert (added, hits) == (1.0, 0)
            assert "at every start" in told[0]


def seen_by(world: WorldBatch) -> np.ndarray:
    """Positions in km, and the slot."""
    slot = np.broadcast_to(world.arrays.slot[:, None, None], (*world.arrays.loads.shape, 1))
    return np.concatenate([world.arrays.positions_m / 1000.0, slot], axis=2)


class TestObservations:
    def test_rows_of_the_vector_environment(self):
        env = make_vec_env(worlds=2, observe=seen_by, **SHORT)
        plain = make_vec_env(worlds=2, **SHORT)
        assert env.observation_space["observation"].shape == (4,)
        assert env.observation_space["state"] == plain.observation_space["state"]
        rows, plain_rows = env.reset(), plain.reset()
        actions = np.full((6, 4), 0.5, np.float32)
        for slot in range(1, 13):
            before = env.world.arrays.positions_m.copy()
            rows, rewards, dones, infos = env.step(actions)
            plain_rows, plain_rewards, _, _ = plain.step(actions)
            np.testing.assert_array_equal(rewards, plain_rewards)
            np.testing.assert_array_equal(rows["state"], plain_rows["state"])
            positions_m = env.world.arrays.positions_m.reshape(6, 3)
            assert rows["observation"].dtype == np.float32
            np.testing.assert_allclose(rows["observation"][:, :3], positions_m / 1000.0, rtol=1e-6)
            assert (rows["observation"][:, 3] == slot % 12).all()
        assert dones.all()
        last = np.stack([info["terminal_observation"]["observation"] for info in infos])
        assert (last[:, 3] == 12).all()
        assert not np.allclose(last[:, :3], rows["observation"][:, :3])
        assert not np.allclose(last[:, :3], before.reshape(6, 3) / 1000.0)

    def test_other_interfaces_conform_and_show_the_same(self):
        parallel_api_test(parallel_env(observe=seen_by, **SHORT), num_cycles=30)
        with pytest.warns(UserWarning, match="infinity"):  # no bounds are known
            check_env(gymnasium.make("orchid/Fleet-v0", observe=seen_by, **SHORT).unwrapped)
        rows = make_vec_env(observe=seen_by, **SHORT).reset()["observation"]
        agents, _ = parallel_env(observe=seen_by, **SHORT).reset(seed=0)
        np.testing.assert_array_equal(np.stack(list(agents.values())), rows)
        vector = gymnasium.make_vec("orchid/Fleet-v0", num_envs=2, observe=seen_by, **SHORT)
        assert vector.observation_space.shape == (2, 3, 4)
        worlds, _ = vector.reset(seed=0)
        np.testing.assert_array_equal(worlds[0], rows)
        for _ in range(12):
            worlds, _, _, _, info = vector.step(np.zeros((2, 3, 4)))
        assert (worlds[..., 3] == 0).all()
        assert (np.stack(info["final_obs"])[..., 3] == 12).all()

    @pytest.mark.parametrize(
        ("observe", "told"),
        [
            (lambda world: np.zeros((1, 4)), r"observe gave shape \(1, 4\), not \(1, 3, any"),
            (lambda world: np.zeros((1, 3, 0)), "observe gave shape"),
            (lambda world: np.full((1, 3, 2), np.nan), "not finite"),
        ],
    )
    def test_what_are_none_is_told(self, observe, told):
        with pytest.raises(ValueError, match=told):
            parallel_env(observe=observe, **SHORT)


class TestReward:
    def test_is_added_after_each_step_and_to_the_episode(self):
        def powers(world):
            return -world.arrays.transmit_powers_w * [1.0, 2.0, 3.0]

        worlds = [
            WorldBatch(Parameters().with_overrides(SMALL), 2, 0, extra_reward=term)
            for term in (None, powers)
        ]
        total = np.zeros(2)
        for world in worlds:
            world.reset()
        for _ in range(12):
            for world in worlds:
                world.step(np.full((2, 3, 4), 0.3))
            plain, own = (world.arrays.rewards for world in worlds)
            extra = powers(worlds[1])
            np.testing.assert_array_equal(own, plain + extra)
            total += extra.mean(axis=1)
        for index in range(2):
            plain, own = (world.episode_metrics(index) for world in worlds)
            assert own.pop("reward") == pytest.approx(plain.pop("reward") + total[index])
            assert own == plain

    def test_of_another_shape_is_told(self):
        env = make_vec_env(extra_reward=lambda world: np.zeros((1, 2)), **SHORT)
        env.reset()
        with pytest.raises(ValueError, match=r"extra_reward gave shape \(1, 2\), not \(1, 3\)"):
            env.step(np.zeros((3, 4)))
