"""What is read out of rows, worked out by hand."""

import numpy as np
import pytest

from orchid_uav.experiments.reproduction import checks, settings
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.rows import TrainingCurve
from tests.helpers.reproductions import make_flight, make_row

BASE, FEW, MANY = settings.base("tcp"), settings.users("tcp")[0], settings.users("tcp")[-1]
REWARD, UTILITY = "reward", "utility"


def evidence_of(*rows, seeds=(10,)):
    return Evidence(rows, seeds)


def trained(blocks, block=10, **changes):
    """A row of ``orchid`` whose reward has these means over blocks of episodes."""
    curve = TrainingCurve(block=block, mean={REWARD: [float(one) for one in blocks]}, std={})
    return make_row("orchid", 10, curve=curve, episodes=len(blocks) * block, **changes)


def flown(case, mean, std=1.0, label="orchid", **changes):
    flight = make_flight(label, case, 10, **changes)
    return flight.model_copy(update={"metrics": flight.metrics | {UTILITY: [mean, std]}})


class TestOfTraining:
    def test_means_are_over_whole_blocks_of_episodes(self):
        row = trained(range(40))
        assert evidence_of(row).trained("orchid", REWARD, 151, 200) == [17.0]  # of 15 to 19
        assert evidence_of(row).at_the_end("orchid", REWARD) == [37.0]  # of 35 to 39
        assert evidence_of(row).late_change("orchid", REWARD) == [20.0]

    def test_unsteadiness_is_that_of_steps_in_the_first_200_episodes(self):
        zigzag = [1.0, 3.0] * 10 + [1000.0]
        assert evidence_of(trained(zigzag)).unsteadiness("orchid", REWARD) == pytest.approx(2**0.5)

    def test_unsteadiness_of_a_trend_is_its_step_alone(self):
        found = evidence_of(trained(range(70))).unsteadiness("orchid", REWARD)
        assert found == pytest.approx(0.5**0.5)

    def test_spread_is_between_the_blocks_of_the_last_200_episodes(self):
        blocks = [1000.0] * 50 + list(range(20))
        expected = (20 * 21 / 12) ** 0.5  # of 0 to 19, with ddof = 1
        assert evidence_of(trained(blocks)).spread_at_the_end("orchid", REWARD) == pytest.approx(
            expected
        )

    def test_a_training_of_fewer_than_200_episodes_has_no_spread(self):
        assert np.isnan(evidence_of(trained(range(15))).spread_at_the_end("orchid", REWARD))[0]

    def test_variances_are_those_of_50_updates_on_either_side_of_the_reset(self):
        # Two updates an episode, and a reset after episode 60: after 120 updates.
        variances = [1000.0] * 70 + [4.0] * 50 + [1.0] * 50 + [1000.0] * 30
        row = trained(range(10), reset_episodes=[60, 90], update_variances=variances)
        found = evidence_of(row).update_variance_ratio("orchid")
        assert found == pytest.approx(np.log10(0.25))

    def test_without_a_reset_there_is_no_ratio(self):
        row = trained(range(10), reset_episodes=[], update_variances=[1.0] * 100)
        assert np.isnan(evidence_of(row).update_variance_ratio("orchid"))[0]

    def test_a_seed_without_a_row_is_not_a_number(self):
        found = evidence_of(trained(range(40)), seeds=(9, 10)).at_the_end("orchid", REWARD)
        assert np.isnan(found[0]) and found[1] == 37.0


class TestOfFlights:
    ROW = make_row(
        "orchid",
        10,
        flights=[
            flown(FEW, 2.0, 1.0),
            flown(MANY, 4.0, 3.0),
            flown(MANY, 9.0, 3.0, deterministic=False),
            flown(MANY, 3.5, 0.5, "orchid-zero"),
        ],
    )

    @pytest.mark.parametrize(
        ("statistic", "value"), [("mean", 3.0), ("std", 2.0), ("cv", (0.5 + 0.75) / 2)]
    )
    def test_are_averaged_over_cases(self, statistic, value):
        found = evidence_of(self.ROW).flown("orchid", UTILITY, [FEW, MANY], statistic)
        assert found == pytest.approx(value)

    def test_are_none_where_a_case_was_not_flown(self):
        assert np.isnan(evidence_of(self.ROW).flown("orchid", UTILITY, [FEW, BASE]))[0]

    def test_of_a_twin_stand_for_all_seeds(self):
        found = evidence_of(self.ROW, seeds=(10, 11)).flown("orchid-zero", UTILITY, [MANY])
        assert found.tolist() == [3.5, 3.5]

    def test_of_a_rule_stand_for_all_seeds(self):
        rule = make_row("track", None, flights=[flown(FEW, 7.0, label="track")])
        found = evidence_of(rule, seeds=(10, 11)).flown("track", UTILITY, [FEW])
        assert found.tolist() == [7.0, 7.0]

    def test_of_a_rule_have_every_topology(self):
        flight = flown(FEW, 2.0, label="static-pf")
        flight = flight.model_copy(update={"topologies": {UTILITY: [1.0, 3.0]}})
        evidence = evidence_of(make_row("static-pf", None, flights=[flight]))
        assert evidence.topologies("static-pf", UTILITY, FEW).tolist() == [1.0, 3.0]
        assert len(evidence.topologies("static-pf", UTILITY, MANY)) == 0

    def test_the_floor_is_the_fifth_percentile(self):
        flight = make_flight("orchid-long", BASE, 10)
        worst = np.random.default_rng(1).permutation(np.arange(101.0))
        flight = flight.model_copy(update={"topologies": {"worst_rate_bps": worst.tolist()}})
        evidence = evidence_of(make_row("orchid-long", 10, flights=[flight]), seeds=(10, 11))
        floor, missing = checks._floor(evidence, "orchid-long")
        assert floor == 5.0 and np.isnan(missing)

    def test_what_an_error_costs_is_the_difference_from_none(self):
        evidence = evidence_of(self.ROW)
        assert checks._loss(evidence, "orchid", exact=FEW, wrong=MANY) == [2.0]

    def test_deviations_are_from_the_median(self):
        flight = flown(FEW, 2.0, label="static-pf")
        flight = flight.model_copy(update={"topologies": {UTILITY: [1.0, 2.0, 9.0]}})
        evidence = evidence_of(make_row("static-pf", None, flights=[flight]))
        found = checks._deviations(evidence, "static-pf", UTILITY, FEW)
        assert found.tolist() == [1.0, 0.0, 7.0]
