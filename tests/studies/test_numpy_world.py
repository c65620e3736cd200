"""The compiled step against its NumPy version: same equations, other composition, same arrays."""

import numpy as np
import pytest

from benchmarks import numpy_world
from orchid_uav.envs.arrays import Worlds
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.world import WorldBatch

SLOTS = 30
SETTINGS = {
    "table-1": {},
    "uniform": {"distribution": "uniform"},
    "moving": {"user_speed_mps": 10.0},
    "moving-held": {"user_speed_mps": 60.0, "heading_hold_s": 4.0, "area_m": 500.0},
    "pf": {"objective": "pf"},
    "shares-pf": {"shares": "pf"},
    "shares-se": {"shares": "se"},
    "collisions": {"min_separation_m": 120.0, "area_m": 300.0, "scatter_std_m": 30.0},
    "climb-power": {"climb_power": True},
    "weak-backhaul": {"gbs.transmit_power_dbm": 0.0},
    "few-are-served": {"required_snr_db": 30.0, "objective": "pf", "initial_altitude_m": 80.0},
    "nobody-is-served": {"required_snr_db": 90.0},
    "uneven-powers": {"min_transmit_power_w": 0.001, "power_step_w": 0.08},
    "short-slots": {"slot_s": 0.5, "user_speed_mps": 5.0},
    "one-uav": {"uav_count": 1, "user_count": 20},
    "two-uavs": {"uav_count": 2, "user_count": 3, "init": "random"},
    "rectangle": {"area_m": (400.0, 1900.0), "user_speed_mps": 60.0},
    "two-masts": {"gbs.positions_m": [[0.0, 500.0], [1500.0, -700.0, 20.0]]},
}


def copy_of(arrays: Worlds) -> Worlds:
    copy = Worlds(*(array.copy() for array in arrays))
    return copy._replace(  # UAVs that know the truth know it by the same arrays
        known_coordinates_m=copy.user_coordinates_m, known_velocities_mps=copy.user_velocities_mps
    )


def assert_equal(compiled: Worlds, reference: Worlds, slot: int) -> None:
    for name in Worlds._fields:
        got, wanted = getattr(compiled, name), getattr(reference, name)
        message = f"{name} after {slot + 1} slots"
        if got.dtype.kind == "f":
            # Sums are taken in another order, and observations are rounded to 32 bits.
            relative = 1e-9 if got.dtype == np.float64 else 3e-7
            np.testing.assert_allclose(got, wanted, relative, 1e-9, err_msg=message)
        else:
            np.testing.assert_array_equal(got, wanted, err_msg=message)


def fly(overrides: dict, prune: bool = False) -> Worlds:
    batch = WorldBatch(Parameters().with_overrides(overrides), worlds=5, seed=3)
    batch.reset()
    # One world is ahead of the others, as after an uneven reset.
    batch.arrays.slot[-1] = 2
    reference = copy_of(batch.arrays)
    actions = np.random.default_rng(7).uniform(-1.5, 1.5, (SLOTS, 5, batch.uav_count, 4))
    for slot, wanted in enumerate(actions):
        batch.set_progress(slot / SLOTS)
        batch.step(wanted)
        numpy_world.step_worlds(batch.constants, reference, wanted, batch.progress, prune)
        assert_equal(batch.arrays, reference, slot)
    return reference


@pytest.mark.parametrize("prune", [False, True], ids=["all-links", "few-links"])
@pytest.mark.parametrize("name", SETTINGS)
def test_numpy_version_agrees_in_every_array(name, prune):
    assert np.isfinite(fly(SETTINGS[name], prune).episode_sums).all()


@pytest.mark.parametrize("prune", [False, True], ids=["all-links", "few-links"])
def test_of_uavs_at_one_point_the_first_serves(prune):
    batch = WorldBatch(worlds=2, seed=3)
    batch.reset()
    batch.arrays.positions_m[:] = batch.arrays.positions_m[:, :1]
    reference = copy_of(batch.arrays)
    hover = np.zeros((2, batch.uav_count, 4))
    batch.step(hover)
    numpy_world.step_worlds(batch.constants, reference, hover, 0.0, prune)
    assert_equal(batch.arrays, reference, 0)
    assert set(np.unique(reference.association)) <= {-1, 0}


@pytest.mark.parametrize(
    ("name", "kind"), [("collisions", 0), ("table-1", 1), ("weak-backhaul", 2)]
)
def test_the_settings_make_some_violations_happen(name, kind):
    happened = fly(SETTINGS[name]).violation_slots[..., kind]
    assert 0 < happened.sum() < happened.size * SLOTS


def test_the_settings_leave_users_without_service():
    few = fly(SETTINGS["few-are-served"], prune=True)
    served = (few.association >= 0).sum()
    assert 0 < served < few.target_users.sum()
    assert (fly(SETTINGS["nobody-is-served"], prune=True).association == -1).all()
