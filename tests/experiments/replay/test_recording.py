"""What a replay shows is what was flown, within what its files say."""

import json

import numpy as np
import pytest

from orchid_uav.agents.controllers.best_response import BestResponse
from orchid_uav.agents.controllers.heuristics import Loiter
from orchid_uav.envs import evaluation_seeds, parallel_env
from orchid_uav.envs.parameters import Parameters
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.evaluation.flights import EvaluationPlan, Setting, evaluate
from orchid_uav.experiments.evaluation.methods import STATIONS, select
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.replay import flown
from orchid_uav.experiments.replay.document import RATE_RATIO, ReplayDocument
from orchid_uav.experiments.replay.flown import Topology, mean_metrics, replay_of_flights
from orchid_uav.experiments.replay.page.page import page_html
from orchid_uav.experiments.replay.scene import unpack

SLOTS = 12
FIRST = Topology(0, 0)
SETTING = Setting(uavs=3, users=30, speed_mps=7.0, heading_hold_s=4.0)


def parameters_with(**values):
    return Parameters().with_overrides(
        {"network.episode_slots": SLOTS}
        | {key.replace("__", "."): value for key, value in values.items()}
    )


def replayed(*methods, setting=SETTING, topology=FIRST, **values):
    contenders = [select([method])[0] for method in methods]
    document = replay_of_flights(contenders, parameters_with(**values), setting, topology)
    # As it is read from a page.
    return ReplayDocument.from_json(json.loads(json.dumps(document.to_json())))


def flown_alone(method, seed, **values):
    """The same flight by way of PettingZoo: a snapshot and the metrics of every slot."""
    env = parallel_env(parameters=parameters_with(**SETTING.values(), **values))
    env.reset(seed=seed)
    env.world.set_progress(1.0)
    method.begin(env.world)
    states, metrics = [env.snapshot()], []
    while env.agents:
        env.step(dict(zip(env.agents, method.act(env.world)[0], strict=True)))
        states.append(env.snapshot())
        metrics.append(env.world.slot_metrics(0))
    return {name: np.array([one[name] for one in states]) for name in states[0]}, metrics


@pytest.mark.parametrize(
    ("key", "make", "overrides"),
    [
        ("loiter-mmf", Loiter, {}),
        ("best-response", BestResponse, STATIONS),
    ],
)
def test_it_shows_what_was_flown(key, make, overrides):
    document = replayed(key, topology=Topology(5, 2))
    scene = unpack(document)
    (flight,) = scene.flights
    seed = evaluation_seeds(5, 3)[2]
    states, metrics = flown_alone(make(), seed, **overrides)
    assert document.slots == SLOTS == len(metrics)
    np.testing.assert_allclose(scene.users_m, states["users_m"], atol=0.25001)
    assert np.abs(np.diff(states["users_m"], axis=0)).max() > 1.0  # or nothing was compared
    np.testing.assert_allclose(flight.drones_m, states["uav_positions_m"], atol=0.05001)
    np.testing.assert_allclose(flight.powers_w, states["transmit_powers_w"], atol=5.001e-5)
    np.testing.assert_array_equal(scene.targets, states["target_users"][0])
    np.testing.assert_allclose(flight.rates_bps, states["rates_bps"], rtol=RATE_RATIO**0.5 - 1.0)
    of_mast = (states["association"] == -1) & (states["rates_bps"] > 0.0)
    np.testing.assert_array_equal(flight.association, np.where(of_mast, -2, states["association"]))
    for name, values in flight.metrics.items():
        if name in metrics[0]:
            expected = [one[name] * METRICS[name].scale for one in metrics]
            np.testing.assert_allclose(values, expected, rtol=1e-6)
    if flight.stations_m is not None:
        away_m = np.linalg.norm(flight.drones_m[-1, :, :2] - flight.stations_m[-1], axis=1)
        np.testing.assert_allclose(away_m, flight.radius_m, rtol=0.01)


def test_fairness_and_coverage_follow_from_what_is_shown():
    (flight,) = (scene := unpack(replayed("track"))).flights
    rates = np.where(flight.association >= 0, flight.rates_bps, 0.0)[1:, scene.targets]
    served = (rates > 0.0).sum(axis=1)
    jain = rates.sum(axis=1) ** 2 / (served * (rates**2).sum(axis=1))
    np.testing.assert_allclose(flight.metrics["rate_jfi"], jain, rtol=3e-3)
    total = (flight.association[1:] != -1).mean(axis=1)
    np.testing.assert_allclose(flight.metrics["total_coverage"], total, rtol=1e-6)
    worst = rates.min(axis=1) / 1e6
    np.testing.assert_allclose(flight.metrics["worst_rate_bps"], worst, rtol=0.0026)


def test_an_evaluation_reports_the_same_means():
    contenders = [select([key])[0] for key in ("orchid-distilled", "balanced-loiter")]
    world = parameters_with()
    evaluated, _ = evaluate(EvaluationPlan(contenders, [SETTING], 2, 7, world))
    document = replay_of_flights(contenders, world, SETTING, Topology(7, 1))
    for flight, found in zip(document.flights, evaluated.values(), strict=True):
        for name, mean in mean_metrics(flight).items():
            assert mean == pytest.approx(found[name][1], rel=1e-5), (flight.key, name)


def test_two_methods_fly_the_same_topology_in_the_order_given():
    both = replayed("orchid", "balanced-loiter")
    alone = replayed("balanced-loiter")
    assert [flight.key for flight in both.flights] == ["orchid", "balanced-loiter"]
    assert both.users == alone.users
    assert both.flights[1] == alone.flights[0]


def test_methods_that_serve_other_users_are_not_shown_side_by_side():
    for number in range(20):
        topology = Topology(0, number)
        one, other = (
            unpack(replayed(key, topology=topology))
            for key in ("balanced-loiter", "balanced-loiter-retargeted")
        )
        if (one.targets != other.targets).any():
            break
    else:
        pytest.fail("no topology on which they differ")
    with pytest.raises(InputError, match="serves other users than balanced-loiter"):
        replayed("balanced-loiter", "balanced-loiter-retargeted", topology=topology)


def test_other_ways_of_the_same_users_would_be_noticed(monkeypatch):
    recorded = flown.record
    shift_m = iter([0.0, 1.0])

    def elsewhere(*arguments):
        recording = recorded(*arguments)
        recording.users_m[3] += next(shift_m)
        return recording

    monkeypatch.setattr(flown, "record", elsewhere)
    with pytest.raises(RuntimeError, match="track has flown over other users' ways"):
        replayed("loiter-mmf", "track")


def test_the_nearest_of_several_masts_serves():
    masts = [[500.0, 500.0, 30.0], [1500.0, 1500.0, 30.0]]
    document = replayed("static-mmf", gbs__positions_m=masts, gbs__shadowing_std_db=0.0)
    scene = unpack(document)
    assert [mast.position_m for mast in document.masts] == masts
    codes = scene.flights[0].association[0]
    assert set(codes[codes < -1]) == {-2, -3}
    away_m = np.linalg.norm(scene.users_m[0][:, None] - np.array(masts)[:, :2], axis=2)
    for user in np.flatnonzero(codes < -1):
        assert -2 - codes[user] == away_m[user].argmin()


def test_a_drone_that_fails_sends_nothing():
    (flight,) = unpack(replayed("loiter-mmf", network__failures=["1@5-9"])).flights
    np.testing.assert_array_equal(flight.powers_w[:, 1] == 0.0, [5 <= t < 9 for t in range(13)])
    assert not (flight.association[5:9] == 1).any()


def test_people_who_stand_take_no_room():
    document = replayed("loiter-mmf", setting=SETTING._replace(speed_mps=0.0))
    assert document.users.positions.shape == [1, 30, 2]
    assert unpack(document).users_m.shape == (13, 30, 2)


def test_a_long_flight_of_many_stays_below_a_megabyte():
    document = replayed(
        "orchid-distilled",
        "balanced-loiter",
        setting=Setting(uavs=10, users=200, speed_mps=1.5, heading_hold_s=20.0),
        network__episode_slots=600,
    )
    page = page_html(json.dumps(document.to_json()), document.title)
    assert len(page.encode()) < 1_000_000
    assert unpack(document).users_m.shape == (601, 200, 2)


@pytest.mark.parametrize(
    ("methods", "values", "told"),
    [
        ((), {}, "0 methods"),
        (("rules",), {}, None),
        (("track", "loiter-mmf", "orchid"), {}, "3 methods: a replay shows one, or two"),
        (("track",), {"network__episode_slots": 1_000_000}, "too many to show"),
    ],
)
def test_what_cannot_be_shown_is_refused(methods, values, told):
    if told is None:
        with pytest.raises(InputError, match="methods: a replay shows one"):
            replay_of_flights(select(["rules"]), parameters_with(), SETTING, Topology(0, 0))
        return
    with pytest.raises(InputError, match=told):
        replayed(*methods, **values)
