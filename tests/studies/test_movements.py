"""How UAVs are said to move is how they move."""

import numpy as np
import pytest

from studies.movements import described


def flown(way) -> np.ndarray:
    """Positions of one topology with two UAVs that do the same, over 200 slots of 1 s."""
    times_s = np.arange(201.0)
    plane = np.array([way(time_s) for time_s in times_s])
    one = np.column_stack([plane, np.full(len(times_s), 100.0)])
    return np.stack([one, one + np.array([50.0, 0.0, 0.0])], axis=1)[:, None]


def test_a_drift_is_straight_and_all_in_one_direction():
    moves = described(flown(lambda time_s: (0.6 * time_s, 0.8 * time_s)), 1.0)
    assert moves["speed_mps"] == pytest.approx(1.0)
    assert moves["straightness"] == pytest.approx(1.0)
    assert moves["same_direction"] == pytest.approx(1.0)
    assert moves["distance_m"] == pytest.approx(200.0)
    assert moves["loops"] == moves["still"] == moves["climb_m"] == 0.0


def test_a_circle_is_a_loop():
    way = lambda time_s: (40 * np.cos(time_s / 4), 40 * np.sin(time_s / 4))  # noqa: E731
    moves = described(flown(way), 1.0)
    assert moves["loops"] == 1.0
    assert moves["speed_mps"] == pytest.approx(80 * np.sin(1 / 8))  # chords of the circle
    assert moves["straightness"] < 0.2


def test_who_turns_back_every_slot_flies_to_and_fro_even_while_it_drifts():
    moves = described(flown(lambda time_s: (0.2 * time_s + 3 * (time_s % 2), 0.0)), 1.0)
    assert moves["to_and_fro"] == 1.0
    assert moves["speed_mps"] == pytest.approx(3.0)
    assert moves["distance_m"] == pytest.approx(40.0)


@pytest.mark.parametrize(
    "way",
    [
        lambda time_s: (0.6 * time_s, 0.8 * time_s),
        lambda time_s: (3.0, 4.0),
        lambda time_s: (40 * np.cos(time_s / 4), 40 * np.sin(time_s / 4)),
        lambda time_s: (np.random.default_rng(int(time_s)).normal(0.0, 9.0), 0.0),
    ],
    ids=["drift", "still", "circle", "noise"],
)
def test_others_do_not_fly_to_and_fro(way):
    assert described(flown(way), 1.0)["to_and_fro"] == 0.0


def test_who_stands_has_no_direction():
    moves = described(flown(lambda time_s: (3.0, 4.0)), 1.0)
    assert moves["still"] == 1.0
    assert moves["same_direction"] == moves["straightness"] == moves["speed_mps"] == 0.0


def test_opposite_directions_cancel():
    positions = flown(lambda time_s: (time_s, 0.0))
    positions[:, :, 1, 0] *= -1.0
    assert described(positions, 1.0)["same_direction"] == pytest.approx(0.0, abs=1e-9)
