"""The trigger on synthetic curves, and what a reset does to an optimizer."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from orchid_uav.callbacks import (
    EpisodeCallback,
    EpisodeLog,
    LearningRateDecay,
    ProgressSchedules,
    ResetAndFinetune,
)
from orchid_uav.callbacks.learning_rates import optimizers_of
from orchid_uav.callbacks.reset_and_finetune import has_plateaued, relative_change, reset_optimizer
from tests.helpers.learners import MADDPG_NETWORKS, small_maddpg, small_model

FLAT = [1.0] * 20
RISING = [1.0] * 10 + [1.2] * 10


def plateaued(jfi, reward, window=10, tolerance=0.05) -> bool:
    series = {"rate_jfi": jfi, "reward": reward}
    return has_plateaued(series, window, dict.fromkeys(series, tolerance))


class TestTrigger:
    @pytest.mark.parametrize(
        ("jfi", "reward", "fires"),
        [
            (FLAT, FLAT, True),
            (FLAT, RISING, False),
            (RISING, FLAT, False),
            (RISING, RISING, False),
        ],
        ids=["both plateau", "only J", "only U", "neither"],
    )
    def test_fires_only_if_both_plateau(self, jfi, reward, fires):
        assert plateaued(jfi, reward) is fires

    def test_needs_two_full_windows(self):
        assert not plateaued(FLAT[:19], FLAT[:19])
        assert plateaued(FLAT, FLAT)

    @pytest.mark.parametrize(
        ("before", "after", "expected"),
        [
            (-100.0, -90.0, 0.1),
            (-100.0, -110.0, 0.1),
            (0.0, 0.0, 0.0),
            (0.0, 1e-8, 1.0),
            (-1.0, 1.0, 2.0),
            (200.0, 190.0, 0.05),
        ],
    )
    def test_relative_change_of_negative_and_zero_means(self, before, after, expected):
        assert relative_change([before] * 3 + [after] * 3, 3) == pytest.approx(expected)

    def test_only_the_two_last_windows_count(self):
        assert plateaued([9.0] * 50 + FLAT, [-5.0] * 50 + FLAT)

    def test_the_tolerance_itself_is_no_plateau(self):
        edge = [1.0] * 10 + [1.5] * 10
        assert not plateaued(edge, edge, tolerance=0.5)

    @given(
        st.lists(st.floats(-1e6, 1e6), min_size=8, max_size=8),
        st.floats(1e-3, 1e3),
    )
    def test_knows_no_scale(self, series, factor):
        plain = relative_change(series, 4)
        if abs(sum(series[:4])) / 4 > 1.0 and abs(sum(series[:4])) * factor / 4 > 1.0:
            scaled = relative_change([x * factor for x in series], 4)
            assert scaled == pytest.approx(plain, rel=1e-6, abs=1e-9)


def worn_optimizer(rate: float) -> tuple[torch.nn.Parameter, torch.optim.Adam]:
    """An Adam that has seen large gradients for long."""
    weight = torch.nn.Parameter(torch.linspace(-1, 1, 5))
    optimizer = torch.optim.Adam([weight], lr=rate, fused=True)
    for _ in range(3000):
        weight.grad = torch.full((5,), 10.0)
        optimizer.step()
    return weight, optimizer


class TestOptimizer:
    def test_weights_stay_bit_for_bit_and_all_state_goes(self):
        weight, optimizer = worn_optimizer(1e-3)
        before = weight.detach().clone()
        reset_optimizer(optimizer)
        assert torch.equal(weight, before)
        assert len(optimizer.state) == 0
        assert optimizer.param_groups[0]["lr"] == 1e-3

    @settings(max_examples=20, deadline=None)
    @given(st.lists(st.floats(-1e3, 1e3), min_size=5, max_size=5))
    def test_the_first_update_after_it_is_bounded_by_the_rate(self, gradient):
        weight, optimizer = worn_optimizer(1e-3)
        reset_optimizer(optimizer)
        before = weight.detach().clone()
        weight.grad = torch.tensor(gradient)
        optimizer.step()
        # Weights of size 1 are rounded to 6e-8.
        assert (weight.detach() - before).abs().max() <= 1e-3 + 1e-7

    def test_zeroing_the_moments_alone_would_not_be(self):
        # The step count left in force switches the bias correction off: the very slip of M23.
        weight, optimizer = worn_optimizer(1e-3)
        for state in optimizer.state.values():
            state["exp_avg"].zero_()
            state["exp_avg_sq"].zero_()
        before = weight.detach().clone()
        weight.grad = torch.ones(5)
        optimizer.step()
        assert (weight.detach() - before).abs().max() > 2.5e-3


class Recorder:
    """A training with every episode's row and the weights after it."""

    def __init__(self, callback: ResetAndFinetune | None, episodes: int = 12, worlds: int = 1):
        self.rows: list[dict[str, float]] = []
        self.weights: list[torch.Tensor] = []
        self.first_steps: list[float] = []
        self.model = small_model(worlds=worlds, n_steps=10)
        callbacks = [callback] if callback else []
        callbacks += [EpisodeLog(self.take, callback), ProgressSchedules(episodes)]
        self.model.learn(episodes * 20, callback=callbacks)

    def take(self, rows) -> None:
        self.rows += rows
        weights = [p.detach().flatten() for p in self.model.policy.parameters()]
        self.weights.append(torch.cat(weights))


EAGER = {"window": 2, "tolerance_jfi": 1e9, "tolerance_reward": 1e9}


class TestInTraining:
    def test_with_and_without_are_identical_up_to_the_trigger_and_differ_after(self):
        with_reset = Recorder(ResetAndFinetune(**EAGER))
        without = Recorder(None)
        for episode in range(4):
            assert torch.equal(with_reset.weights[episode], without.weights[episode])
        assert not torch.equal(with_reset.weights[4], without.weights[4])
        assert [row["reset"] for row in with_reset.rows] == [0, 0, 0, 1] + [0] * 8

    def test_both_rates_fall_by_exactly_kappa(self):
        for kappa in (0.5, 0.1, 1.0):
            rows = Recorder(ResetAndFinetune(**EAGER, kappa=kappa), episodes=6).rows
            assert [row["actor_lr"] for row in rows] == [1e-4] * 3 + [1e-4 * kappa] * 3
            assert [row["critic_lr"] for row in rows] == [1e-3] * 3 + [1e-3 * kappa] * 3

    def test_the_optimizer_uses_the_lower_rates_and_starts_anew(self):
        callback = ResetAndFinetune(**EAGER)
        recorder = Recorder(callback, episodes=5)
        optimizer = recorder.model.policy.optimizer
        assert [group["lr"] for group in optimizer.param_groups] == [5e-5, 5e-4]
        steps = {int(state["step"]) for state in optimizer.state.values()}
        assert steps == {4}  # one rollout of 20 samples: one mini-batch, four epochs

    def test_once_by_default_and_every_two_windows_if_allowed(self):
        assert Recorder(once := ResetAndFinetune(**EAGER), episodes=14).rows
        assert once.reset_episodes == [4]
        Recorder(thrice := ResetAndFinetune(**EAGER, max_resets=3), episodes=14)
        assert thrice.reset_episodes == [4, 8, 12]

    def test_no_rate_falls_below_one_percent(self):
        callback = ResetAndFinetune(**EAGER, max_resets=3, kappa=0.05)
        rows = Recorder(callback, episodes=14).rows
        assert rows[-1]["actor_lr"] == pytest.approx(1e-6)
        assert rows[-1]["critic_lr"] == pytest.approx(1e-5)

    def test_episodes_of_parallel_worlds_count_one_by_one(self):
        callback = ResetAndFinetune(window=2, tolerance_jfi=1e9, tolerance_reward=1e9)
        rows = Recorder(callback, episodes=7, worlds=3).rows
        assert [row["episode"] for row in rows] == [1, 2, 3, 4, 5, 6, 7]
        assert callback.reset_episodes == [4]
        # The rates in force after an episode are those after the update it was part of.
        assert [row["actor_lr"] for row in rows] == [1e-4] * 3 + [5e-5] * 4

    @pytest.mark.parametrize(
        "wrong",
        [
            {"window": 0},
            {"max_resets": 0},
            {"kappa": 0.0},
            {"kappa": 1.5},
            {"kappa": float("nan")},
            {"tolerance_jfi": 0.0},
            {"tolerance_reward": -1.0},
        ],
    )
    def test_refuses_what_makes_no_sense(self, wrong):
        with pytest.raises(ValueError, match=next(iter(wrong)).split("_")[0]):
            ResetAndFinetune(**wrong)


class Adam(EpisodeCallback):
    """Copies of an optimizer's state after every episode."""

    def __init__(self) -> None:
        super().__init__()
        self.states: list[list[torch.Tensor]] = []

    def _on_episodes(self, episodes) -> None:
        [optimizer] = optimizers_of(self.model)
        self.states.append(
            [
                tensor.clone()
                for parameter in optimizer.state.values()
                for tensor in parameter.values()
            ]
        )


STRICT = {"window": 2, "tolerance_jfi": 1e-12, "tolerance_reward": 1e-12}


class TestControls:
    @pytest.mark.parametrize("patience", [EAGER, STRICT], ids=["plateau", "no plateau"])
    def test_given_episodes_are_acted_at_whatever_the_windows_say(self, patience):
        callback = ResetAndFinetune(**patience, at_episodes=[5, 6, 9], max_resets=3)
        rows = Recorder(callback).rows
        assert callback.reset_episodes == [5, 6, 9]
        assert [row["episode"] for row in rows if row["reset"]] == [5, 6, 9]
        expected = [1e-4] * 4 + [5e-5] + [2.5e-5] * 3 + [1.25e-5] * 4
        assert [row["actor_lr"] for row in rows] == expected

    def test_no_more_of_them_than_resets_are_allowed(self):
        once = ResetAndFinetune(**EAGER, at_episodes=[5, 9])
        Recorder(once)
        never = ResetAndFinetune(**EAGER, at_episodes=[])
        Recorder(never)
        assert (once.reset_episodes, never.reset_episodes) == ([5], [])

    def test_a_run_is_the_same_as_without_up_to_a_given_episode(self):
        with_reset = Recorder(ResetAndFinetune(**EAGER, at_episodes=[7]))
        without = Recorder(None)
        same = [
            torch.equal(*pair) for pair in zip(with_reset.weights, without.weights, strict=True)
        ]
        assert same == [True] * 7 + [False] * 5

    @pytest.mark.parametrize(
        ("options", "is_cleared", "rate"),
        [
            ({}, True, 5e-5),
            ({"kappa": 1.0}, True, 1e-4),
            ({"clear_optimizer": False}, False, 5e-5),
        ],
        ids=["both", "reset only", "decay only"],
    )
    def test_halves_of_a_reset(self, options, is_cleared, rate):
        model, before, after = small_model(), Adam(), Adam()
        model.learn(4 * 20, callback=[before, ResetAndFinetune(**EAGER, **options), after])
        assert len(before.states[3]) == 3 * len(list(model.policy.parameters()))
        if is_cleared:
            assert after.states[3] == []
        else:  # moments and steps, bit for bit
            assert len(after.states[3]) == len(before.states[3])
            assert all(map(torch.equal, before.states[3], after.states[3]))
        assert model.learning_rates == (rate, 10 * rate)

    def test_decay_alone_goes_on_with_the_moments_at_the_lower_rates(self):
        decayed, both = small_model(), small_model()
        decayed.learn(
            100, callback=ResetAndFinetune(**EAGER, clear_optimizer=False, at_episodes=[4])
        )
        both.learn(100, callback=ResetAndFinetune(**EAGER, at_episodes=[4]))
        steps = [
            {int(state["step"]) for state in model.policy.optimizer.state.values()}
            for model in (decayed, both)
        ]
        assert steps == [{5 * 4}, {4}]  # four epochs of one mini-batch an episode
        assert [group["lr"] for group in decayed.policy.optimizer.param_groups] == [5e-5, 5e-4]


class Rates:
    """The actor's learning rates of a training: in use at each update, and as they are logged."""

    def __init__(self, model, episodes: int, schedules, reset_and_finetune=None) -> None:
        self.used: list[float] = []
        self.rows: list[dict[str, float]] = []
        original = model.train

        def train(**arguments):
            original(**arguments)
            self.used.append(model.policy.optimizer.param_groups[0]["lr"])

        model.train = train
        callbacks = [reset_and_finetune] if reset_and_finetune else []
        callbacks += [schedules, EpisodeLog(self.rows.extend, reset_and_finetune)]
        model.learn(episodes * 20, callback=callbacks)


class TestSchedules:
    def test_a_linear_decay_ends_at_its_last_scale(self):
        model = small_model()
        rates = Rates(model, 8, LearningRateDecay(8, 0.2))
        # The update on episode e has the progress of the e - 1 episodes before it.
        line = [1e-4 * (1 - 0.8 * done / 8) for done in range(8)]
        assert rates.used == pytest.approx(line, rel=1e-12)
        for column, first in (("actor_lr", 1e-4), ("critic_lr", 1e-3)):
            # In force after the episode, as they are with a reset.
            logged = [row[column] for row in rates.rows]
            expected = [first * (1 - 0.8 * done / 8) for done in range(1, 9)]
            assert logged == pytest.approx(expected, rel=1e-12)
        assert model.learning_rates == pytest.approx((2e-5, 2e-4), rel=1e-12)

    def test_of_maddpg_too(self):
        model = small_maddpg()
        schedules = LearningRateDecay(5, 0.0)
        rates = Rates(model, 5, schedules)
        assert sorted(set(rates.used), reverse=True) == pytest.approx(
            [1e-4, 8e-5, 6e-5, 4e-5, 2e-5], rel=1e-12
        )
        assert model.learning_rates == (0.0, 0.0)

    def test_a_decay_and_a_reset_multiply(self):
        model = small_model()
        callback = ResetAndFinetune(**EAGER, kappa=0.1)
        rates = Rates(model, 8, LearningRateDecay(8, 0.5), callback)
        line = [1e-4 * (1 - 0.5 * done / 8) for done in range(8)]
        expected = line[:4] + [0.1 * rate for rate in line[4:]]
        assert rates.used == pytest.approx(expected, rel=1e-12)
        assert model.learning_rates == pytest.approx((5e-6, 5e-5), rel=1e-12)

    def test_stay_at_their_last_values_behind_their_last_episode(self):
        model, seen = small_model(), []
        original = model.train

        def train() -> None:
            world = model.env.world
            seen.append((world.progress, model.ent_coef, model.learning_rates[0]))
            original()

        model.train = train
        model.learn(
            7 * 20, callback=[LearningRateDecay(4, 0.5), ProgressSchedules(4, (0.03, 0.01))]
        )
        taus = [0.0, 0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
        expected = [(tau, 0.03 - 0.02 * tau, 1e-4 * (1 - 0.5 * tau)) for tau in taus]
        np.testing.assert_allclose(seen, expected, rtol=1e-12)

    def test_change_nothing_about_the_rates_by_default(self):
        assert Rates(small_model(), 3, LearningRateDecay(3)).used == [1e-4] * 3


class TestFrozen:
    @pytest.mark.parametrize("rate", [0.0, 1e-4], ids=["frozen", "learning"])
    @pytest.mark.parametrize("algorithm", ["mappo", "maddpg"])
    def test_rates_of_zero_leave_all_weights_as_they_began(self, algorithm, rate):
        make = {"mappo": small_model, "maddpg": small_maddpg}[algorithm]
        model = make(learning_rate=rate, critic_learning_rate=rate)
        networks = (
            [model.policy]
            if algorithm == "mappo"
            else [getattr(model.policy, name) for name in MADDPG_NETWORKS[:2]]
        )
        parameters = [p for network in networks for p in network.parameters()]
        before = [parameter.detach().clone() for parameter in parameters]
        model.learn(5 * 20, callback=ProgressSchedules(5, None))
        assert model.policy.optimizer.state, "there was no update"
        assert all(map(torch.equal, before, parameters)) is (rate == 0.0)


def test_schedules_follow_finished_episodes():
    seen = []
    model = small_model(worlds=2)
    world = model.env.world
    original = model.train

    def train() -> None:
        seen.append((world.progress, model.ent_coef))
        original()

    model.train = train
    model.learn(7 * 20, callback=ProgressSchedules(7, (0.01, 0.0)))
    progress = [0.0, 2 / 7, 4 / 7, 6 / 7]
    np.testing.assert_allclose(seen, [(tau, 0.01 * (1 - tau)) for tau in progress])
    assert world.progress == 1.0
