"""The environment's interfaces: conformance suites, and the same numbers on every path."""

import json
import math
import subprocess
import sys
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from gymnasium.wrappers.vector import (
    DictInfoToList,
    NormalizeObservation,
    RecordEpisodeStatistics,
)
from packaging.version import Version
from pettingzoo import ParallelEnv
from pettingzoo.test import parallel_api_test, parallel_seed_test
from stable_baselines3.common.env_checker import check_env as check_sb3_env
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import orchid_uav  # registers orchid/Fleet-v0
from orchid_uav.agents import MADDPG, MAPPO
from orchid_uav.envs import (
    EPISODE_METRICS,
    SLOT_METRICS,
    CentralizedState,
    make_supersuit_vec_env,
    make_vec_env,
    parallel_env,
    world_seeds,
)
from orchid_uav.extras import install_command
from tests.helpers.processes import NEEDS_SUPERSUIT

SHORT = {"uavs": 3, "users": 20, "episode_slots": 12}
SNAPSHOT = {
    "users_m": (20, 2),
    "target_users": (20,),
    "uav_positions_m": (3, 3),
    "uav_velocities_mps": (3, 3),
    "transmit_powers_w": (3,),
    "association": (20,),
    "rates_bps": (20,),
    "gbs_position_m": (3,),
    "gbs_positions_m": (1, 3),
}


class TestConformance:
    def test_pettingzoo_api(self):
        parallel_api_test(parallel_env(**SHORT), num_cycles=50)

    def test_pettingzoo_seeds(self):
        parallel_seed_test(lambda: parallel_env(**SHORT, speed_mps=5.0), num_cycles=30)

    def test_the_centralised_wrapper_is_a_pettingzoo_environment_too(self):
        parallel_api_test(CentralizedState(parallel_env(**SHORT)), num_cycles=30)
        parallel_seed_test(lambda: CentralizedState(parallel_env(**SHORT)), num_cycles=20)

    def test_gymnasium(self):
        check_env(gymnasium.make("orchid/Fleet-v0", **SHORT).unwrapped)

    @pytest.mark.filterwarnings("ignore:.*unconventional shape.*:UserWarning")
    def test_sb3(self):
        check_sb3_env(gymnasium.make("orchid/Fleet-v0", **SHORT))

    def test_gymnasium_vectors_are_the_batch(self):
        vector = gymnasium.make_vec("orchid/Fleet-v0", num_envs=4, **SHORT)
        observations, _ = vector.reset(seed=3)
        assert observations.shape == (4, 3, 16) == vector.observation_space.shape
        for slot in range(1, 14):
            observations, rewards, terminated, truncated, info = vector.step(
                vector.action_space.sample()
            )
            assert rewards.shape == (4,) and not terminated.any()
            assert truncated.all() == (slot == 12)
            assert ("final_obs" in info) == ("episode_metrics" in info) == (slot == 12)
            assert tuple(info["metrics"]) == SLOT_METRICS
            assert info["metrics"]["coverage"].shape == (4,)
        assert vector.observation_space.contains(observations)

    def test_wrappers_of_sb3_take_the_native_environment(self):
        env = VecNormalize(VecMonitor(make_vec_env(2, **SHORT)), norm_obs_keys=["observation"])
        env.reset()
        for _ in range(12):
            _, _, dones, infos = env.step(np.zeros((6, 4)))
        assert dones.all() and all(info["episode"]["l"] == 12 for info in infos)


class TestParallel:
    def test_agents_spaces_and_infos(self):
        env = parallel_env(**SHORT)
        assert env.possible_agents == ["uav_0", "uav_1", "uav_2"]
        observations, _ = env.reset(seed=0)
        assert env.observation_space("uav_0").shape == (16,)
        assert env.state_space.contains(env.state())
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)
        *_, infos = env.step({agent: np.zeros(4, np.float32) for agent in env.agents})
        for agent in env.possible_agents:
            assert tuple(infos[agent]["metrics"]) == SLOT_METRICS

    def test_ends_by_truncation_alone_with_the_episodes_figures(self):
        env = parallel_env(**SHORT)
        env.reset(seed=0)
        for slot in range(1, 13):
            _, rewards, terminations, truncations, infos = env.step(
                {agent: np.zeros(4) for agent in env.agents}
            )
            assert not any(terminations.values())
            assert all(truncations.values()) == (slot == 12)
        assert env.agents == []
        assert tuple(infos["uav_0"]["episode_metrics"]) == EPISODE_METRICS
        assert len(rewards) == 3
        with pytest.raises(RuntimeError, match="reset"):
            env.step({})

    def test_a_missing_action_is_named(self):
        env = parallel_env(**SHORT)
        env.reset(seed=0)
        with pytest.raises(ValueError, match="uav_1"):
            env.step({"uav_0": np.zeros(4), "uav_2": np.zeros(4)})

    def test_snapshot(self):
        env = parallel_env(**SHORT)
        env.reset(seed=0)
        snapshot = env.snapshot()
        assert {key: value.shape for key, value in snapshot.items() if key != "slot"} == SNAPSHOT
        assert snapshot["slot"] == 0

    def test_progress_is_kept_across_resets(self):
        env = parallel_env(**SHORT)
        rewards = {}
        for progress in (None, 1.0):
            if progress is not None:
                env.set_progress(progress)
            env.reset(seed=0)
            _, rewards[progress], *_ = env.step({agent: np.zeros(4) for agent in env.agents})
        assert rewards[None] != rewards[1.0]

    @pytest.mark.parametrize(
        ("keywords", "message"),
        [
            ({"uavs": 0}, "uav_count"),
            ({"uavs": 5, "users": 5}, "at least 6"),
            ({"altitude": 3}, "altitude"),
            ({"usres": 30}, r"unknown parameter 'usres'"),
            ({"usr_count": 30}, r"did you mean 'user_count'\?"),
            ({"observation": "all-knowing"}, "observation"),
            ({"speed_mps": float("nan")}, "user_speed_mps"),
        ],
    )
    def test_bad_keywords_are_told(self, keywords, message):
        with pytest.raises(ValueError, match=message):
            parallel_env(**keywords)

    def test_errors_are_one_line(self):
        with pytest.raises(ValueError) as error:
            parallel_env(uavs=0)
        assert len(str(error.value).splitlines()) == 1

    def test_numbers_of_users_may_be_numpys_and_positions_more_than_the_default(self):
        assert parallel_env(users=np.int64(50)).world.user_count == 50
        positions = np.random.default_rng(0).uniform(0, 2000, (200, 2))
        assert parallel_env(uavs=120, users=positions).world.uav_count == 120

    def test_keywords_reach_their_parameters(self):
        env = parallel_env(
            uavs=2,
            users=[[float(x), 5.0] for x in range(9)],
            distribution="uniform",
            objective="pf",
            speed_mps=3.0,
            init="random",
            heading_hold_s=20.0,
            **{"uav.max_speed_mps": 12.0},
        )
        parameters = env.parameters
        assert (parameters.network.uav_count, parameters.network.user_count) == (2, 9)
        assert parameters.network.distribution == "uniform"
        assert parameters.share_rule == "pf"
        assert parameters.network.user_speed_mps == 3.0
        assert parameters.deployment.init == "random"
        assert parameters.network.heading_hold_s == 20.0
        assert parameters.uav.max_speed_mps == 12.0


class TestSamePathsSameNumbers:
    @NEEDS_SUPERSUIT
    @pytest.mark.parametrize("distribution", ["tcp", "uniform"])
    def test_native_and_supersuit(self, distribution):
        keywords = {**SHORT, "distribution": distribution, "speed_mps": 10.0}
        native = make_vec_env(3, seed=5, **keywords)
        through_supersuit = make_supersuit_vec_env(lambda: parallel_env(**keywords), 3, seed=5)
        assert native.num_envs == through_supersuit.num_envs == 9
        assert native.observation_space == through_supersuit.observation_space
        generator = np.random.default_rng(0)
        for _ in range(2):
            for first, second in [(native.reset(), through_supersuit.reset())]:
                assert_same(first, second)
            for _ in range(30):  # beyond two ends of episodes
                actions = generator.uniform(-1, 1, (9, 4)).astype(np.float32)
                assert_same(native.step(actions), through_supersuit.step(actions))

    def test_one_native_world_is_the_parallel_environment_of_the_same_seed(self):
        native, single = make_vec_env(1, seed=4, **SHORT), parallel_env(**SHORT)
        rows = native.reset()
        observations, _ = single.reset(seed=4)
        np.testing.assert_array_equal(rows["observation"], np.stack([*observations.values()]))
        np.testing.assert_array_equal(rows["state"][0], single.state())

    def test_the_joint_environment_rewards_the_mean(self):
        joint = gymnasium.make("orchid/Fleet-v0", **SHORT)
        single = parallel_env(**SHORT)
        first, _ = joint.reset(seed=2)
        second, _ = single.reset(seed=2)
        np.testing.assert_array_equal(first, np.stack([*second.values()]))
        actions = np.random.default_rng(0).uniform(-1, 1, (3, 4)).astype(np.float32)
        _, reward, terminated, truncated, info = joint.step(actions)
        _, rewards, *_ = single.step(dict(zip(single.agents, actions, strict=True)))
        assert reward == pytest.approx(np.mean([*rewards.values()]))
        assert not terminated and not truncated and tuple(info["metrics"]) == SLOT_METRICS


def assert_same(first: object, second: object) -> None:
    """Bit for bit, through tuples, dicts and arrays; infos of running episodes may say more."""
    if isinstance(first, tuple):
        rows, rewards, dones, infos = zip(first, second, strict=True)
        for one, other in (rows, rewards, dones):
            assert_same(one, other)
        for one, other in zip(*infos, strict=True):
            for key, value in one.items():
                assert_same(value, other[key])
            assert ("terminal_observation" in one) == ("terminal_observation" in other)
    elif isinstance(first, dict):
        assert first.keys() == second.keys()
        for key in first:
            assert_same(first[key], second[key])
    else:
        np.testing.assert_array_equal(first, second)


@NEEDS_SUPERSUIT
class TestSuperSuitMended:
    def make(self, worlds: int = 3, seed: int | None = 1):
        return make_supersuit_vec_env(lambda: parallel_env(**SHORT), worlds, seed=seed)

    def test_seeds_are_taken(self):
        first, second, other = self.make(), self.make(), self.make(seed=2)
        one = first.reset()["observation"]
        np.testing.assert_array_equal(one, second.reset()["observation"])
        assert not np.array_equal(one, other.reset()["observation"])
        second.seed(2)
        np.testing.assert_array_equal(
            second.reset()["observation"], self.make(seed=2).reset()["observation"]
        )

    def test_worlds_are_distinct(self):
        rows = self.make().reset()["observation"].reshape(3, -1)
        assert len(np.unique(rows, axis=0)) == 3
        assert len({id(world) for world in self.make().worlds}) == 3

    def test_time_limits_are_said(self):
        env = self.make(worlds=1)
        env.reset()
        for _ in range(12):
            _, _, dones, infos = env.step(np.zeros((3, 4), np.float32))
        assert dones.all()
        assert all(info["TimeLimit.truncated"] is True for info in infos)
        assert set(infos[0]["terminal_observation"]) == {"observation", "state"}

    def test_attributes_and_methods_reach_the_worlds(self):
        env = self.make(worlds=2)
        assert env.get_attr("agents_per_world") == [3] * 6
        assert env.get_attr("parameters", [4])[0].network.uav_count == 3
        env.reset()
        env.env_method("set_progress", 0.5)
        assert [world.unwrapped.world.progress for world in env.worlds] == [0.5, 0.5]
        assert env.env_is_wrapped(CentralizedState) == [True] * 6

    def test_another_librarys_environment(self):
        from mpe2 import simple_spread_v3

        env = make_supersuit_vec_env(
            lambda: simple_spread_v3.parallel_env(continuous_actions=True, max_cycles=25), 2, seed=0
        )
        rows = env.reset()
        assert rows["observation"].shape == (6, 18) and rows["state"].shape == (6, 54)
        np.testing.assert_array_equal(rows["state"][0], rows["observation"][:3].flatten())
        for _ in range(25):
            _, _, dones, infos = env.step(np.full((6, 5), 0.5, np.float32))
        assert dones.all() and all(info["TimeLimit.truncated"] for info in infos)

    def test_no_worlds(self):
        with pytest.raises(ValueError, match="at least 1"):
            self.make(worlds=0)


def test_without_supersuit_all_else_is_there(monkeypatch):
    monkeypatch.setitem(sys.modules, "supersuit", None)
    monkeypatch.delitem(sys.modules, "orchid_uav.envs.interfaces.supersuit_vec_env", raising=False)
    for name in orchid_uav.envs.__all__:
        assert getattr(orchid_uav.envs, name) is not None
    with pytest.raises(ImportError, match="supersuit cannot be imported") as refusal:
        make_supersuit_vec_env(lambda: parallel_env(**SHORT))
    assert install_command("supersuit") in str(refusal.value)


class TestNative:
    def test_rows_are_ordered_world_by_world(self):
        env = make_vec_env(2, seed=9, **SHORT)
        rows = env.reset()
        for world, seed in enumerate(world_seeds(9, 2)):
            single = parallel_env(**SHORT)
            observations, _ = single.reset(seed=seed)
            np.testing.assert_array_equal(
                rows["observation"][3 * world : 3 * world + 3], np.stack([*observations.values()])
            )
        np.testing.assert_array_equal(env.snapshot(4)["users_m"], single.snapshot()["users_m"])

    def test_observations_handed_out_are_not_touched_later(self):
        env = make_vec_env(1, **SHORT)
        rows = env.reset()
        kept = {key: array.copy() for key, array in rows.items()}
        env.step(np.ones((3, 4)))
        assert_same(rows, kept)

    def test_spaces_hold_what_is_observed(self):
        env = make_vec_env(4, **SHORT, speed_mps=10.0)
        assert isinstance(env.observation_space, spaces.Dict)
        rows = env.reset()
        generator = np.random.default_rng(0)
        for _ in range(40):
            for row in range(env.num_envs):
                assert env.observation_space.contains({k: v[row] for k, v in rows.items()})
            rows, *_ = env.step(generator.uniform(-1, 1, (12, 4)))

    def test_state_is_what_the_design_says(self):
        rows = make_vec_env(1, seed=0, **SHORT).reset()
        state = rows["state"][0]
        np.testing.assert_array_equal(state[:48], rows["observation"].flatten())
        assert state[48:148].sum() == pytest.approx(1.0)
        assert 0 < state[148] <= 1
        assert state.shape == (149,)


class TestBounds:
    def test_of_the_backhaul_at_table_i(self):
        space = parallel_env().observation_space("uav_0")
        farthest_m, nearest_m = math.hypot(1000.0, 1000.0, 90.0), 50.0
        noise_dbm = -174.0 + 10.0 * math.log10(20e6)
        for bound, distance_m in ((space.low[15], farthest_m), (space.high[15], nearest_m)):
            loss_db = 20.0 * math.log10(4.0 * math.pi * 2.4e9 * distance_m / 299_792_458.0)
            assert bound == pytest.approx((30.0 - loss_db - noise_dbm - 10.0) / 40.0, abs=3e-6)
        assert np.isfinite(space.low).all() and np.isfinite(space.high).all()

    @pytest.mark.parametrize(
        "overrides",
        [
            {},
            {"gbs.height_m": 100.0},  # within the flight box: a UAV can meet the antenna
            {"gbs.height_m": 300.0},  # above it
            {"min_altitude_m": 100.0, "max_altitude_m": 100.0},
            {"backhaul_required_snr_db": 38.5, "area_m": 50.0, "backhaul_bandwidth_hz": 1e9},
        ],
    )
    def test_are_reached_and_never_left(self, overrides):
        env = parallel_env(uavs=12, users=13, **overrides)
        env.reset(seed=0)
        network, uav = env.parameters.network, env.parameters.uav
        corner, middle = (0.0, 0.0), (network.area_m / 2, network.area_m / 2)
        altitudes = np.linspace(uav.min_altitude_m, uav.max_altitude_m, 5)
        nearest = np.clip(env.parameters.gbs.height_m, uav.min_altitude_m, uav.max_altitude_m)
        places = [(*xy, z) for xy in (corner, middle) for z in (*altitudes, nearest)]
        powers_w = np.tile([uav.min_transmit_power_w, uav.max_transmit_power_w], 6)
        env.world.place(np.array(places)[None], powers_w[None])
        rows = env.world.arrays.observations[0]
        space = env.observation_space("uav_0")
        assert all(space.contains(row) for row in rows)
        assert rows[:, 15].min() == pytest.approx(space.low[15], abs=1e-5)
        assert rows[:, 15].max() == pytest.approx(space.high[15], abs=1e-5)
        assert env.state_space.contains(env.state())


def vector_of(mode: AutoresetMode | str, worlds: int = 3):
    return gymnasium.make_vec("orchid/Fleet-v0", num_envs=worlds, autoreset_mode=mode, **SHORT)


class TestAutoreset:
    """Against Gymnasium's own vector of single environments, whose semantics are the reference."""

    @pytest.mark.parametrize("mode", list(AutoresetMode))
    def test_as_gymnasiums_own_vector(self, mode):
        ours = vector_of(mode)
        theirs = gymnasium.make_vec(
            "orchid/Fleet-v0",
            num_envs=3,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": mode},
            **SHORT,
        )
        assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"] == mode
        assert ours.observation_space == theirs.observation_space
        seeds = world_seeds(5, 3)
        np.testing.assert_array_equal(ours.reset(seed=5)[0], theirs.reset(seed=seeds)[0])
        generator = np.random.default_rng(0)
        for step in range(40):
            if step == 4:  # from now on the worlds' episodes end at different steps
                mask = np.array([False, True, False])
                first, _ = ours.reset(seed=8, options={"reset_mask": mask})
                second, _ = theirs.reset(seed=world_seeds(8, 3), options={"reset_mask": mask})
                np.testing.assert_array_equal(first, second)
            actions = generator.uniform(-1, 1, (3, 3, 4)).astype(np.float32)
            one, other = ours.step(actions), theirs.step(actions)
            for mine, reference in zip(one[:4], other[:4], strict=True):
                np.testing.assert_array_equal(mine, reference)
            self.assert_infos_agree(one[4], other[4])
            finished = one[3]
            if mode == AutoresetMode.DISABLED and finished.any():
                with pytest.raises(RuntimeError, match="reset"):
                    ours.step(actions)
                first, _ = ours.reset(options={"reset_mask": finished})
                second, _ = theirs.reset(options={"reset_mask": finished.copy()})
                np.testing.assert_array_equal(first, second)

    def assert_infos_agree(self, ours, theirs):
        """All that the reference says is said by ours; ours has a slot's figures more often."""
        for key in ("final_obs", "final_info", "metrics", "episode_metrics"):
            where = theirs.get(f"_{key}", np.zeros(3, np.bool_))
            if key in ("final_obs", "final_info"):
                np.testing.assert_array_equal(ours.get(f"_{key}", np.zeros(3, np.bool_)), where)
            for world in np.flatnonzero(where):
                assert ours[f"_{key}"][world]
                if key == "final_info":
                    self.assert_infos_agree(ours[key], theirs[key])
                elif key == "final_obs":
                    np.testing.assert_array_equal(ours[key][world], theirs[key][world])
                else:
                    for name in ours[key]:
                        assert ours[key][name][world] == theirs[key][name][world]

    def test_the_default_begins_anew_in_the_same_step(self):
        vector = gymnasium.make_vec("orchid/Fleet-v0", num_envs=2, **SHORT)
        assert vector.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
        assert vector_of("NextStep").metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
        assert vector.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP  # of its own

    def test_normalized_observations(self):
        vector = NormalizeObservation(vector_of(AutoresetMode.NEXT_STEP, worlds=8))
        vector.reset(seed=0)
        seen = [vector.step(vector.action_space.sample())[0] for _ in range(60)]
        assert np.isfinite(seen).all()
        np.testing.assert_allclose(np.mean(seen[30:], axis=(0, 1, 2))[:2], 0.0, atol=0.5)

    @pytest.mark.skipif(
        Version(gymnasium.__version__) < Version("1.4"),
        reason="its DictInfoToList takes no dictionaries in dictionaries without masks",
    )
    @pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
    def test_statistics_of_episodes(self, mode):
        vector = DictInfoToList(RecordEpisodeStatistics(vector_of(mode)))
        vector.reset(seed=0)
        returns, ended = np.zeros(3), 0
        for _ in range(27):
            _, rewards, _, truncated, infos = vector.step(np.zeros((3, 3, 4), np.float32))
            returns += rewards
            for world in np.flatnonzero(truncated):
                assert infos[world]["episode"]["l"] == 12
                assert infos[world]["episode"]["r"] == pytest.approx(returns[world])
                assert infos[world]["episode_metrics"]["reward"] == pytest.approx(returns[world])
                returns[world], ended = 0.0, ended + 1
        assert ended == 6

    @pytest.mark.parametrize("mask", [[True, False, True], np.ones(3), np.ones(2, np.bool_)])
    def test_a_wrong_mask(self, mask):
        with pytest.raises(ValueError, match="reset_mask"):
            vector_of("Disabled").reset(options={"reset_mask": mask})


class DoubleEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """Two agents whose observations and states are float64; ends by itself or by a time limit."""

    metadata = {"name": "double_v0"}
    render_mode = None
    possible_agents = ["left", "right"]
    state_space = spaces.Box(-np.inf, np.inf, (4,), np.float64)
    own_space = spaces.Box(-1e300, 2.0, (2,), np.float64)
    force_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def __init__(self, terminates: bool):
        self.terminates = terminates
        self.agents: list[str] = []

    def observation_space(self, agent):
        return self.own_space

    def action_space(self, agent):
        return self.force_space

    def reset(self, seed=None, options=None):
        self.agents, self.steps = self.possible_agents[:], 0
        return self.observations(), {agent: {} for agent in self.agents}

    def step(self, actions):
        self.steps += 1
        agents, is_over = self.agents, self.steps == 5
        if is_over:
            self.agents = []
        return (
            {agent: np.full(2, 0.1 * self.steps) for agent in agents},
            {agent: float(actions[agent][0]) for agent in agents},
            dict.fromkeys(agents, is_over and self.terminates),
            dict.fromkeys(agents, is_over and not self.terminates),
            {agent: {} for agent in agents},
        )

    def observations(self):
        return {agent: np.full(2, 0.1) for agent in self.agents}

    def state(self):
        return np.full(4, 0.1 * self.steps)


class AsDouble(VecMonitor):
    """The rows of a vector environment in double precision, past all that SuperSuit's path does."""

    def __init__(self, venv):
        super().__init__(venv)
        self.observation_space = spaces.Dict(
            {
                key: spaces.Box(box.low.astype(float), box.high.astype(float), dtype=np.float64)
                for key, box in venv.observation_space.items()
            }
        )

    def reset(self):
        return {key: rows.astype(float) for key, rows in super().reset().items()}

    def step_wait(self):
        rows, rewards, dones, infos = super().step_wait()
        for info in infos:
            if "terminal_observation" in info:
                last = info["terminal_observation"]
                info["terminal_observation"] = {key: last[key].astype(float) for key in last}
        return {key: value.astype(float) for key, value in rows.items()}, rewards, dones, infos


class TestDoublePrecision:
    def test_the_centralised_wrapper_casts(self):
        env = CentralizedState(DoubleEnv(terminates=False))
        parallel_api_test(env, num_cycles=20)
        space = env.observation_space("left")
        assert space["observation"].dtype == space["state"].dtype == np.float32
        assert space["observation"].low[0] == -np.inf and space["observation"].high[0] == 2.0
        observations, _ = env.reset()
        assert space.contains(observations["left"])
        rows = make_supersuit_vec_env(lambda: DoubleEnv(terminates=False), 2).reset()
        assert {array.dtype for array in rows.values()} == {np.dtype(np.float32)}

    @pytest.mark.parametrize("terminates", [True, False])
    @pytest.mark.parametrize("wrapped", [AsDouble, VecMonitor])
    @pytest.mark.parametrize("learner", [MAPPO, MADDPG])
    def test_learners_take_it(self, learner, wrapped, terminates):
        env = wrapped(make_supersuit_vec_env(lambda: DoubleEnv(terminates), 2))
        if learner is MAPPO:
            policy, own = "CentralizedCriticPolicy", {"n_steps": 5, "batch_size": 10}
        else:
            policy, own = "JointCriticPolicy", {"batch_size": 4, "update_every": 5}
        model = learner(policy, env, policy_kwargs={"net_arch": [8]}, seed=0, **own)
        model.learn(60)
        observation = env.reset()
        actions, _ = model.predict(observation, deterministic=True)
        single = {key: rows.astype(np.float32) for key, rows in observation.items()}
        np.testing.assert_array_equal(actions, model.predict(single, deterministic=True)[0])
        assert {weight.dtype.itemsize for weight in model.policy.parameters()} == {4}

    def test_the_same_numbers_in_double_precision_are_learned_from_alike(self):
        weights = []
        for wrapped in (VecMonitor, AsDouble):
            env = wrapped(make_vec_env(2, seed=1, **SHORT))
            model = MAPPO(
                *("CentralizedCriticPolicy", env),
                **{"n_steps": 12, "batch_size": 24, "policy_kwargs": {"net_arch": [8]}, "seed": 0},
            )
            model.learn(2 * 12 * 6)
            weights.append([weight.detach().numpy() for weight in model.policy.parameters()])
        for one, other in zip(*weights, strict=True):
            np.testing.assert_array_equal(one, other)


class TestOtherProcesses:
    def test_the_module_form_of_the_id_registers_where_nothing_was_imported(self):
        make = partial(gymnasium.make, "orchid_uav:orchid/Fleet-v0", **SHORT)
        processes = AsyncVectorEnv([make], context="spawn")
        try:
            rows, _ = processes.reset(seed=[3])
        finally:
            processes.close()
        expected, _ = gymnasium.make("orchid/Fleet-v0", **SHORT).reset(seed=3)
        np.testing.assert_array_equal(rows[0], expected)


def test_importing_the_simulator_needs_neither_torch_nor_sb3():
    code = (
        "import json, sys; from orchid_uav.envs import parallel_env; parallel_env().reset();"
        "print(json.dumps([m for m in ('torch', 'stable_baselines3') if m in sys.modules]))"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert json.loads(finished.stdout) == []
