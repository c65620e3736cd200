"""The numbers on the page of a flight are those of the simulator, flown another way."""

import json

import numpy as np
import pytest

from orchid_uav.agents.controllers.heuristics import Loiter
from orchid_uav.envs import evaluation_seeds, parallel_env
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.evaluation.flights import Setting
from orchid_uav.experiments.evaluation.methods import select
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.replay.flown import Topology, replay_of_flights

pytestmark = pytest.mark.browser

SLOTS = 12
SETTING = Setting(uavs=3, users=30, speed_mps=7.0, heading_hold_s=4.0)


def flown_by_pettingzoo():
    """Loiter on the first held-out topology: states 0 … T, and metrics of the slots 1 … T."""
    overrides = {"network.episode_slots": SLOTS} | SETTING.values()
    env = parallel_env(parameters=Parameters().with_overrides(overrides))
    env.reset(seed=evaluation_seeds(0, 1)[0])
    env.world.set_progress(1.0)
    method = Loiter()
    method.begin(env.world)
    states, metrics = [env.snapshot()], []
    while env.agents:
        infos = env.step(dict(zip(env.agents, method.act(env.world)[0], strict=True)))[-1]
        states.append(env.snapshot())
        metrics.append(infos["uav_0"]["metrics"])
    return states, metrics


def test_a_flight_shows_what_the_simulator_did(open_page):
    parameters = Parameters().with_overrides({"network.episode_slots": SLOTS})
    document = replay_of_flights(select(["loiter-mmf"]), parameters, SETTING, Topology(0, 0))
    page = open_page(json.dumps(document.to_json()), "#slot=0")
    states, metrics = flown_by_pettingzoo()
    compared = set()
    for slot, state in enumerate(states):
        page.locator("#time").fill(str(slot))
        rows = page.locator("#drone-tables tbody tr").evaluate_all(
            "(rows) => rows.map((row) => [...row.cells].map((cell) => cell.textContent))"
        )
        for index, row in enumerate(rows):
            shown_m = [float(cell) for cell in row[1:4]]
            assert shown_m == pytest.approx(state["uav_positions_m"][index], abs=0.1 + 1e-9)
            assert float(row[5]) == pytest.approx(state["transmit_powers_w"][index], abs=6e-4)
            assert int(row[6]) == (state["association"] == index).sum()
        if not slot:
            continue
        for key, value in metrics[slot - 1].items():
            data = page.locator(f"[data-metric='{key}'] data")
            if data.count():
                shown = np.float32(value * METRICS[key].scale)
                assert np.float32(data.get_attribute("value")) == shown
                assert data.text_content() == f"{shown:.{METRICS[key].digits}f}"
                compared.add(key)
    assert {"coverage", "rate_jfi", "load_jfi", "worst_rate_bps"} <= compared
