"""The environment's faces: conformance suites, and the same numbers on every path."""

import json
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from stable_baselines3.common.env_checker import check_env as check_sb3_env
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import orchid_uav  # registers orchid/Fleet-v0
from orchid_uav.envs import (
    EPISODE_METRICS,
    SLOT_METRICS,
    CentralizedState,
    make_supersuit_vec_env,
    make_vec_env,
    parallel_env,
    world_seeds,
)
from orchid_uav.envs.extras import install_command
from tests.running import NEEDS_SUPERSUIT

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
}


class TestConformance:
    def test_pettingzoo_api(self):
        parallel_api_test(parallel_env(**SHORT), num_cycles=50)

    def test_pettingzoo_seeds(self):
        parallel_seed_test(lambda: parallel_env(**SHORT, speed_mps=5.0), num_cycles=30)

    def test_the_centralised_wrapper_is_a_pettingzoo_environment_too(self):
        parallel_api_test(CentralizedState(parallel_env(**SHORT)), num_cycles=30)
        parallel_seed_test(lambda: CentralizedState(parallel_env(**SHORT)), num_cycles=20)

    # Unbounded: the backhaul's margin, see orchid_uav.envs.spaces.
    @pytest.mark.filterwarnings("ignore:.*infinity.*:UserWarning")
    def test_gymnasium(self):
        check_env(gymnasium.make("orchid/Fleet-v0", **SHORT).unwrapped)

    @pytest.mark.filterwarnings("ignore:.*infinity.*:UserWarning")
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
            ({"observation": "informed"}, "observation"),
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
        assert parameters.reward.share_rule == "pf"
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
    monkeypatch.delitem(sys.modules, "orchid_uav.envs.supersuit_path", raising=False)
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


def test_importing_the_simulator_needs_neither_torch_nor_sb3():
    code = (
        "import json, sys; from orchid_uav.envs import parallel_env; parallel_env().reset();"
        "print(json.dumps([m for m in ('torch', 'stable_baselines3') if m in sys.modules]))"
    )
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert json.loads(finished.stdout) == []
