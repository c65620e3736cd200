"""Every rule in areas that are no square, with no mast and with several (M44, M45)."""

import numpy as np
import pytest

from orchid_uav.agents.controllers.best_response import BestResponse
from orchid_uav.agents.controllers.forces import Forces
from orchid_uav.agents.controllers.heuristics import BalancedLoiter, Hover, Loiter, Track
from orchid_uav.agents.controllers.planner import Planner
from orchid_uav.agents.controllers.receding_horizon import RecedingHorizon
from orchid_uav.envs import Parameters, WorldBatch
from orchid_uav.envs.metrics import BOUNDARY_VIOLATIONS, COLLISIONS, COVERAGE

DIRECT = {
    "hover": Hover,
    "loiter": Loiter,
    "balanced-loiter": lambda: BalancedLoiter(4),
    "restarted": lambda: BalancedLoiter(4, keeps_targets=False),
    "track": Track,
    "planner": lambda: Planner(60, restarts=4),
}
ON_STATIONS = {
    "forces": Forces,
    "best-response": BestResponse,
    "receding-horizon": lambda: RecedingHorizon(trials=50),
}
PLACES = pytest.mark.parametrize(
    ("area_m", "masts"),
    [((3000.0, 600.0), []), ((150.0, 2500.0), [[75.0, 300.0], [75.0, 2600.0, 45.0]])],
    ids=["wide, no mast", "tall, two masts"],
)


def begun(area_m: tuple[float, float], masts: list, **overrides) -> WorldBatch:
    place = {"network.area_m": area_m, "gbs.positions_m": masts}
    fleet = {"uav_count": 4, "user_count": 30, "user_speed_mps": 10.0, "heading_hold_s": 20.0}
    world = WorldBatch(Parameters().with_overrides({**place, **fleet, **overrides}), 2, 3)
    world.set_progress(1.0)
    world.reset()
    return world


@PLACES
@pytest.mark.parametrize("rule", [*DIRECT, *ON_STATIONS])
def test_rules_keep_inside_and_apart_and_serve(rule, area_m, masts):
    overrides = {"uav.flight": "station"} if rule in ON_STATIONS else {}
    world = begun(area_m, masts, **overrides)
    method = {**DIRECT, **ON_STATIONS}[rule]()
    method.begin(world)
    for _ in range(30):
        world.step(method.act(world))
        positions_m = world.arrays.positions_m[..., :2]
        assert (positions_m >= 0.0).all() and (positions_m <= area_m).all()
    sums = world.arrays.episode_sums
    assert (sums[:, 1 + BOUNDARY_VIOLATIONS] == 0).all()
    assert (sums[:, 1 + COVERAGE] > 0.9 * 30).all()
    if rule in ON_STATIONS:
        assert (sums[:, 1 + COLLISIONS] == 0).all()


@PLACES
def test_best_response_moves_towards_those_who_are_to_be_served(area_m, masts):
    # All UAVs at one end, most users at the other: stations go there along the longer side.
    along = int(np.argmax(area_m))
    world = begun(area_m, masts, **{"uav.flight": "station", "network.user_speed_mps": 0.0})
    start_m = np.full((2, 4, 3), 75.0)
    start_m[..., along] = np.linspace(60.0, 600.0, 4)
    start_m[..., 2] = 100.0
    world.place(start_m)
    method = BestResponse()
    method.begin(world)
    before_m = world.arrays.stations_m.copy()
    for _ in range(30):
        world.step(method.act(world))
    assert (world.arrays.stations_m - before_m)[..., along].max(axis=1).min() > 100.0
