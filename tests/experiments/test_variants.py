"""Variants of a base: their names and values, the controls, what cannot be compared."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchid_uav.experiments.ablation.variants import (
    CONTROLS,
    Variant,
    apply_variant,
    assigned,
    check_variants,
    control,
    variants_of_values,
)
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.errors import InputError
from tests.helpers.processes import tiny_config

PAPER = RunConfig()
RUN_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def differences(config: RunConfig, base: RunConfig = PAPER) -> dict[str, object]:
    """Values of a configuration that are others than the base's, by "section.key"."""
    own, others = config.model_dump(), base.model_dump()
    return {
        f"{section}.{key}": value
        for section, values in own.items()
        for key, value in values.items()
        if value != others[section][key]
    }


class TestNames:
    def test_values_of_an_option_are_a_variant_each(self):
        assert variants_of_values("init", "deployment.init", ["random", "kmeans"]) == [
            Variant("init-random", {"deployment.init": "random"}),
            Variant("init-kmeans", {"deployment.init": "kmeans"}),
        ]
        assert variants_of_values("kappa", "reset.kappa", [0.1]) == [
            Variant("kappa-0.1", {"reset.kappa": 0.1})
        ]

    def test_assignments_are_a_variant_each(self):
        assert assigned(["network.user_speed_mps=15", "ppo.entropy_coef=[0.02, 0]"]) == [
            Variant("network.user_speed_mps-15", {"network.user_speed_mps": 15}),
            Variant("ppo.entropy_coef-0.02-0", {"ppo.entropy_coef": [0.02, 0]}),
        ]

    def test_a_negative_value_is_told_from_a_positive_one(self):
        names = [one.name for one in assigned(["ppo.log_std_init=1", "ppo.log_std_init=-1"])]
        assert names == ["ppo.log_std_init-1", "ppo.log_std_init--1"]

    @given(st.text(), st.text())
    def test_are_names_of_runs_whatever_is_given(self, key, value):
        [variant] = assigned([f"{key}={value}"])
        assert RUN_NAME.fullmatch(variant.name)

    def test_an_assignment_has_two_sides(self):
        with pytest.raises(InputError, match=r"--set reset\.kappa is not of the form"):
            assigned(["reset.kappa"])


class TestApplied:
    def test_changes_the_given_values_and_no_other(self):
        base = tiny_config(5, reset__kappa=0.3, training__seed=7, network__shares="se")
        variant = Variant("both", {"reset.window": 9, "ppo.hidden_sizes": [8]})
        config = apply_variant(variant, base)
        assert differences(config, base) == {"reset.window": 9, "ppo.hidden_sizes": (8,)}

    def test_an_unknown_key_names_the_nearest(self):
        with pytest.raises(InputError, match=r"'reset\.kapa': did you mean 'reset\.kappa'"):
            apply_variant(Variant("typo", {"reset.kapa": 0.1}), PAPER)

    def test_a_value_that_does_not_fit_is_told_with_its_variant(self):
        with pytest.raises(InputError, match=r"reset.kappa(?s:.*)7(?s:.*)variant kappa-7"):
            apply_variant(Variant("kappa-7", {"reset.kappa": 7}), PAPER)


class TestControls:
    """What has to be ruled out before an effect is Reset-and-Finetune's."""

    def test_are_those_of_the_protocol(self):
        assert set(CONTROLS) == {
            "reset-only",
            "decay-only",
            "random-time",
            "linear-decay",
            "frozen",
        }
        assert all(control(name, PAPER).name == name for name in CONTROLS)

    @pytest.mark.parametrize(
        ("name", "expected"),
        [
            ("reset-only", {"reset.kappa": 1.0}),
            ("decay-only", {"reset.clear_optimizer": False}),
            ("random-time", {"reset.trigger": "random"}),
            (
                "linear-decay",
                {"reset.enabled": False, "training.final_learning_rate_scale": 0.5},
            ),
            (
                "frozen",
                {
                    "reset.enabled": False,
                    "ppo.actor_learning_rate": 0.0,
                    "ppo.critic_learning_rate": 0.0,
                },
            ),
        ],
    )
    def test_change_one_thing_about_the_base(self, name, expected):
        assert differences(apply_variant(control(name, PAPER), PAPER)) == expected

    @pytest.mark.parametrize("own_scale", [1.0, 0.3])
    @pytest.mark.parametrize(("kappa", "resets"), [(0.5, 1), (0.5, 3), (0.05, 1), (0.1, 5)])
    def test_a_linear_decay_ends_where_all_resets_of_the_base_do(self, kappa, resets, own_scale):
        base = tiny_config(
            reset__kappa=kappa,
            reset__max_resets=resets,
            training__final_learning_rate_scale=own_scale,
        )
        scale = 1.0
        for _ in range(resets):
            scale = max(scale * kappa, 0.01)  # no rate falls lower (M22)
        config = apply_variant(control("linear-decay", base), base)
        assert config.training.final_learning_rate_scale == pytest.approx(scale * own_scale)

    def test_a_frozen_policy_of_maddpg_has_its_rates_at_zero(self):
        base = tiny_config(training__algorithm="maddpg", reset__enabled=True)
        assert differences(apply_variant(control("frozen", base), base), base) == {
            "reset.enabled": False,
            "maddpg.actor_learning_rate": 0.0,
            "maddpg.critic_learning_rate": 0.0,
        }

    def test_an_unknown_one_names_the_nearest(self):
        with pytest.raises(InputError, match="'reset-onyl': did you mean 'reset-only'"):
            control("reset-onyl", PAPER)

    @pytest.mark.parametrize("name", CONTROLS)
    def test_need_a_base_with_reset_and_finetune(self, name):
        with pytest.raises(InputError, match=f"'{name}': the base has no Reset-and-Finetune"):
            control(name, tiny_config(reset__enabled=False))


NO_RF = Variant("no-rf", {"reset.enabled": False})


class TestCheck:
    @pytest.mark.parametrize(
        ("variants", "message"),
        [
            ([], "nothing to compare: name a variant, such as --no-rf"),
            ([NO_RF, NO_RF], "two variants are called 'no-rf'"),
            ([Variant("base", {"reset.kappa": 0.1})], "two variants are called 'base'"),
            (
                variants_of_values("kappa", "reset.kappa", [0.5]),
                "'kappa-0.5' is the same as the base",
            ),
            (
                [NO_RF, *assigned(["reset.enabled=false"])],
                "'reset.enabled-false' is the same as variant 'no-rf'",
            ),
            (assigned(["training.seed=3"]), "see --seeds"),
            (assigned(["reset.kapa=3"]), "did you mean 'reset.kappa'"),
        ],
        ids=["none", "twice", "base", "as the base", "as another", "seed", "unknown"],
    )
    def test_refuses_what_compares_nothing(self, variants, message):
        with pytest.raises(InputError, match=re.escape(message)):
            check_variants(variants, PAPER)

    def test_without_reset_and_finetune_twice_is_refused(self):
        with pytest.raises(InputError, match="'no-rf' is the same as the base"):
            check_variants([NO_RF], tiny_config(reset__enabled=False))

    def test_has_nothing_to_say_about_most(self):
        variants = [
            NO_RF,
            *variants_of_values("kappa", "reset.kappa", [0.1, 0.3]),
            *variants_of_values("shares", "network.shares", ["se"]),
            *variants_of_values("init", "deployment.init", ["random"]),
            *(control(name, PAPER) for name in CONTROLS),
        ]
        assert check_variants(variants, PAPER) == []

    @pytest.mark.parametrize(
        ("text", "base", "note"),
        [
            ("reset.kappa=0.1", {"reset.enabled": False}, "kappa has no effect"),
            ("training.algorithm=maddpg", {}, "Reset-and-Finetune stays on"),
            ("reward.objective=pf", {}, "(reward.objective), so rewards do not compare"),
            ("training.episodes=300", {}, "(training.schedule_episodes), so rewards do not"),
            ("reward.coverage_weight=1", {"network.shares": "se"}, "rewards do not compare"),
            ("network.scatter_std_m=0", {}, "5 places at most, fewer than the 7 clusters"),
        ],
    )
    def test_notes_what_is_easily_missed(self, text, base, note):
        config = apply_variant(Variant("base", base), PAPER)
        variants = assigned([text])
        [found] = check_variants(variants, config)
        assert found.startswith(f"variant '{variants[0].name}': ")
        assert note in found

    @pytest.mark.parametrize(("episodes", "is_told"), [(100, True), (101, False)])
    def test_notes_that_runs_are_too_short_for_a_reset(self, episodes, is_told):
        base = apply_variant(Variant("base", {"training.episodes": episodes}), PAPER)
        notes = check_variants([NO_RF], base)
        assert ["100 episodes" in note for note in notes] == [True] * is_told
