"""The replay of whole-fleet transitions: what is stored, overwritten and drawn."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.agents import MADDPG
from orchid_uav.agents.maddpg.replay_buffer import JointReplayBuffer
from tests.helpers.learners import Clock, small_maddpg

NEVER = 200
"""More transitions than are flown: nothing is learned."""


def flown_by_clock(
    steps: int, lengths: tuple[int, ...], limits: tuple[bool, ...], **keywords
) -> tuple[Clock, MADDPG]:
    env = Clock(lengths, limits)
    model = MADDPG(
        "JointCriticPolicy",
        env,
        seed=0,
        policy_kwargs={"net_arch": [8]},
        **{"batch_size": NEVER, "buffer_size": NEVER, "exploration_std": 0.5} | keywords,
    )
    model.learn(steps * env.num_envs)
    return env, model


def expected_transition(world: int, step: int, length: int, is_limit: bool) -> list[list[float]]:
    """Of :class:`Clock`, in the order of ``JointBatch``; actions are left out."""
    episode, slot = divmod(step, length)
    before, after = [
        ([[world, agent, episode, time] for agent in (0, 1)], [world, episode, time])
        for time in (slot, slot + 1)
    ]
    is_terminated = slot + 1 == length and not is_limit
    return [*before, 100 * world + 5 + slot + 1, *after, float(is_terminated)]


LENGTHS, LIMITS, STEPS = (3, 5, 4), (True, False, True), 17


@pytest.fixture(scope="module")
def flight():
    return flown_by_clock(STEPS, LENGTHS, LIMITS)


class TestContents:
    def test_each_row_is_a_worlds_step_up_to_the_last_view_of_its_episode(self, flight):
        _, model = flight
        buffer = model.replay_buffer
        assert buffer.size() == STEPS * 3
        without_actions = [array for index, array in enumerate(buffer.arrays) if index != 2]
        for place in range(buffer.size()):
            step, world = divmod(place, 3)
            expected = expected_transition(world, step, LENGTHS[world], LIMITS[world])
            for array, numbers in zip(without_actions, expected, strict=True):
                np.testing.assert_array_equal(array[place], numbers)

    def test_actions_are_those_that_were_flown_in_units_of_the_network(self, flight):
        env, model = flight
        stored = model.replay_buffer.arrays[2][: STEPS * 3]
        flown = np.stack(env.flown).reshape(STEPS * 3, 2, 2)
        np.testing.assert_allclose(stored, flown / 2.0 - 1.0, atol=1e-6)
        assert np.abs(stored).max() <= 1.0
        assert stored.std() > 0.3

    def test_a_batch_is_a_set_of_rows(self, flight):
        _, model = flight
        batch = model.replay_buffer.sample(50)
        assert {tensor.dtype for tensor in batch} == {torch.float32}
        shapes = [(50, 2, 4), (50, 3), (50, 2, 2), (50,), (50, 2, 4), (50, 3), (50,)]
        assert [tuple(tensor.shape) for tensor in batch] == shapes
        for row in range(50):
            world, episode, slot = (int(number) for number in batch.states[row])
            length = LENGTHS[world]
            step = episode * length + slot
            drawn = [tensor[row].numpy() for index, tensor in enumerate(batch) if index != 2]
            expected = expected_transition(world, step, length, LIMITS[world])
            for tensor, numbers in zip(drawn, expected, strict=True):
                np.testing.assert_array_equal(tensor, numbers)
            place = step * 3 + world
            np.testing.assert_array_equal(batch.actions[row], model.replay_buffer.arrays[2][place])

    def test_of_a_real_network_the_next_episodes_first_view_is_never_what_follows(self):
        model = small_maddpg(worlds=2, batch_size=NEVER)
        steps = []
        step = model.env.step
        model.env.step = lambda actions: steps.append(step(actions)) or steps[-1]
        model.learn(4 * 20)
        following = model.replay_buffer.arrays[4][:40].reshape(20, 4, 16)
        for (observation, _, dones, infos), stored in zip(steps, following, strict=True):
            if dones.any():
                last = [info["terminal_observation"]["observation"] for info in infos]
                np.testing.assert_array_equal(stored, last)
                assert not np.array_equal(stored, observation["observation"])
            else:
                np.testing.assert_array_equal(stored, observation["observation"])
        # Episodes end by a time limit alone.
        assert model.replay_buffer.arrays[6].sum() == 0

    def test_worlds_without_an_episode_left_are_not_stored(self):
        _, model = flown_by_clock(0, (4, 4, 4), (True,) * 3, episode_steps=4)
        model.learn(4 * 4 * 2)
        states = model.replay_buffer.arrays[1][: model.replay_buffer.size()]
        first_round = [[world, 0, slot] for slot in range(4) for world in range(3)]
        assert states.tolist() == first_round + [[0, 1, slot] for slot in range(4)]


class TestRing:
    @settings(max_examples=60, deadline=None)
    @given(
        size=st.integers(1, 9),
        worlds=st.integers(1, 4),
        flown=st.lists(st.integers(1, 4), min_size=1, max_size=12),
    )
    def test_the_last_transitions_are_kept_whatever_the_sizes(self, size, worlds, flown):
        env = Clock((9,) * worlds, (True,) * worlds)
        buffer = JointReplayBuffer(
            size, env.observation_space, env.action_space, n_envs=2 * worlds, agents_per_world=2
        )
        everything = []
        for step, counted in enumerate(min(worlds, wanted) for wanted in flown):
            env.time[:, 1] = step
            before = env._rows()
            env.time[:, 1] = step + 1
            actions = np.full((2 * worlds, 2), step / 100, np.float32)
            rewards = np.arange(2.0 * worlds) + step
            ended = np.arange(2 * worlds) // 2 % 2 == 0
            buffer.add(2 * counted, before, actions, rewards, env._rows(), ended)
            everything += [(world, step) for world in range(counted)]
        kept = everything[-size:]
        assert buffer.size() == len(kept)
        places = [(int(world), int(step)) for world, _, step in buffer.arrays[1][: len(kept)]]
        assert sorted(places) == sorted(kept)
        for place, (world, step) in enumerate(places):
            # All arrays turn together.
            assert buffer.arrays[0][place, 1].tolist() == [world, 1, 0, step]
            assert buffer.arrays[2][place] == pytest.approx(step / 100)
            assert buffer.arrays[3][place] == 2 * world + 0.5 + step
            assert buffer.arrays[4][place, 0].tolist() == [world, 0, 0, step + 1]
            assert buffer.arrays[5][place].tolist() == [world, 0, step + 1]
            assert buffer.arrays[6][place] == (world % 2 == 0)

    def test_what_is_learned_from_afterwards_is_recent(self):
        _, model = flown_by_clock(11, (100,) * 3, (True,) * 3, buffer_size=7)
        states = model.replay_buffer.sample(300).states
        drawn = {(int(world), int(slot)) for world, _, slot in states}
        assert drawn == {(2, 8), *((world, slot) for world in range(3) for slot in (9, 10))}


class TestSampling:
    def test_is_uniform_and_draws_nothing_that_is_not_stored(self):
        _, model = flown_by_clock(10, (1000,), (True,))
        torch.manual_seed(0)
        slots = model.replay_buffer.sample(20_000).states[:, 2].long()
        counts = torch.bincount(slots)
        assert len(counts) == 10
        # Chi-square of 9 degrees of freedom: 27.9 is exceeded once in a thousand.
        assert float(((counts - 2000) ** 2 / 2000).sum()) < 27.9

    def test_is_repeatable_by_torchs_generator_alone(self):
        _, model = flown_by_clock(10, (1000,), (True,))

        def drawn(seed: int) -> torch.Tensor:
            torch.manual_seed(seed)
            np.random.default_rng().random()
            return model.replay_buffer.sample(30).states

        assert torch.equal(drawn(1), drawn(1))
        assert not torch.equal(drawn(1), drawn(2))

    def test_batches_are_copies(self):
        _, model = flown_by_clock(10, (1000,), (True,))
        for tensor in model.replay_buffer.sample(30):
            tensor.fill_(-1.0)
        assert all((array[:10] != -1.0).any() for array in model.replay_buffer.arrays)
        assert (model.replay_buffer.arrays[1] >= 0.0).all()


def test_refuses_to_save_memory_at_the_cost_of_last_views():
    env = Clock((3,), (True,))
    with pytest.raises(ValueError, match="optimize_memory_usage"):
        MADDPG("JointCriticPolicy", env, optimize_memory_usage=True)
