"""Starts that are remembered are those that would be made."""

import numpy as np

from orchid_uav.envs import WorldBatch
from orchid_uav.envs.keys import in_sections
from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.starts import topologies
from studies.remembered_starts import Memory

SEEDS = (3, 4, 5)


def starts_m(parameters):
    world = WorldBatch(parameters, len(SEEDS), SEEDS)
    world.reset()
    return world.arrays.positions_m[..., :2].copy()


def balanced(**others):
    values = {"deployment.init": "balanced", "network.user_count": 20, **others}
    return Parameters.model_validate(in_sections(values))


def test_remembered_starts_are_the_made_ones_and_made_once(tmp_path, monkeypatch):
    parameters = balanced()
    plain = topologies.balanced_start_m
    expected = starts_m(parameters)
    for hits in (0, len(SEEDS)):
        memory = Memory(tmp_path / "starts.bin", 6, plain)
        monkeypatch.setattr(topologies, "balanced_start_m", memory.start_m)
        np.testing.assert_array_equal(starts_m(parameters), expected)
        assert memory.hits == hits
        memory.keep()


def test_another_network_has_starts_of_its_own(tmp_path, monkeypatch):
    memory = Memory(tmp_path / "starts.bin", 6, topologies.balanced_start_m)
    monkeypatch.setattr(topologies, "balanced_start_m", memory.start_m)
    starts_m(balanced())
    starts_m(balanced(**{"network.subband_bandwidth_hz": 5e6}))
    assert memory.hits == 0
