"""Plans as replays: the plan's own numbers, and files that are not as they were written."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning import plan
from orchid_uav.experiments.replay.flown import mean_metrics
from orchid_uav.experiments.replay.planned import plan_directory, replay_of_plan
from orchid_uav.experiments.replay.scene import unpack

PEOPLE = Path(__file__).parents[3] / "examples" / "planning" / "people.csv"


@pytest.fixture(scope="module")
def on_earth(tmp_path_factory):
    made = plan(PEOPLE, drones=3, masts=["17.2966,-62.7243,35"], budget="100")
    return made.write(tmp_path_factory.mktemp("plans") / "earth")


@pytest.fixture(scope="module")
def in_metres(tmp_path_factory):
    places_m = np.random.default_rng(0).uniform(-500.0, 1500.0, (40, 2))
    weights = [1, 30] * 20
    made = plan(places_m, weights=weights, in_metres=True, drones=2, masts=["0,0,25"], budget="100")
    return made.write(tmp_path_factory.mktemp("plans") / "metres")


@pytest.fixture
def copied(in_metres, tmp_path):
    """A plan that a test may change."""
    for path in in_metres.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def changed(directory, change):
    path = directory / "plan.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return directory


@pytest.mark.parametrize("where", ["on_earth", "in_metres"])
def test_numbers_are_the_plans_own(where, request):
    directory = request.getfixturevalue(where)
    written = json.loads((directory / "plan.json").read_text())
    document = replay_of_plan(directory)
    (flight,) = unpack(document).flights
    weights = np.array(document.users.weights)
    assert weights.sum() == written["people"]["total"]
    for index, drone in enumerate(written["drones"]):
        assert weights[flight.association[0] == index].sum() == drone["people"]
    assert weights[flight.association[0] < -1].sum() == written["people"]["served_by_masts"]
    worst_bps = flight.rates_bps[0][flight.association[0] != -1].min()
    assert worst_bps == pytest.approx(written["people"]["worst_rate_bps"], rel=0.0026)
    means = mean_metrics(document.flights[0])
    assert means["utility"] == pytest.approx(written["utility"])
    assert means["worst_rate_bps"] == pytest.approx(written["people"]["worst_rate_bps"])
    assert means["total_coverage"] == 1.0
    assert len(flight.metrics["utility"]) == document.slots
    height_m = {"on_earth": 35.0, "in_metres": 25.0}[where]
    assert [mast.position_m[2] for mast in document.masts] == [height_m]


def test_drones_circle_their_stations_at_the_plans_speed(in_metres):
    drones = json.loads((in_metres / "plan.json").read_text())["drones"]
    (flight,) = unpack(replay_of_plan(in_metres)).flights
    assert flight.stations_m is not None
    offsets_m = flight.drones_m[..., :2] - flight.stations_m
    radius_m = drones[0]["circle_radius_m"]
    np.testing.assert_allclose(np.linalg.norm(offsets_m, axis=2), radius_m, atol=0.15)
    steps_m = np.linalg.norm(np.diff(flight.drones_m, axis=0), axis=2)
    chord_m = 2.0 * radius_m * np.sin(drones[0]["speed_mps"] / radius_m / 2.0)
    np.testing.assert_allclose(steps_m, chord_m, atol=0.15)
    np.testing.assert_allclose(
        flight.drones_m[0, :, 2], [drone["altitude_m"] for drone in drones], atol=0.06
    )


def test_places_in_metres_are_those_of_the_table(in_metres):
    scene = unpack(replay_of_plan(in_metres))
    with (in_metres / "people.csv").open() as file:
        rows = list(csv.DictReader(file))
    people_m = np.array([[float(row["x_m"]), float(row["y_m"])] for row in rows])
    shift_m = people_m - scene.users_m[0]
    np.testing.assert_allclose(shift_m, shift_m[:1].repeat(40, axis=0), atol=0.51)
    west_m, south_m, east_m, north_m = json.loads((in_metres / "plan.json").read_text())["site"][
        "box"
    ]
    np.testing.assert_allclose(shift_m[0], [west_m, south_m], atol=0.51)
    np.testing.assert_allclose(scene.document.area_m, [east_m - west_m, north_m - south_m])


def test_a_place_on_earth_keeps_distances(on_earth):
    """Against degrees on the ellipsoid at 17.3° N: 110,664 m and 106,282 m."""
    document = replay_of_plan(on_earth)
    features = json.loads((on_earth / "people.geojson").read_text())["features"]
    degrees = np.array([one["geometry"]["coordinates"] for one in features])
    expected_m = (degrees - degrees[0]) * [106_282.0, 110_664.0]
    users_m = unpack(document).users_m[0]
    np.testing.assert_allclose(users_m - users_m[0], expected_m, atol=1.5)
    assert document.place is not None
    middle_m = (np.array([document.place.lon, document.place.lat]) - degrees[0]) * [
        106_282.0,
        110_664.0,
    ]
    np.testing.assert_allclose(middle_m + users_m[0], np.array(document.area_m) / 2.0, atol=3.0)


def test_a_plan_is_found_by_its_directory_and_its_file(in_metres, tmp_path, monkeypatch):
    assert plan_directory(str(in_metres)) == in_metres
    assert plan_directory(str(in_metres / "plan.json")) == in_metres
    monkeypatch.chdir(in_metres)
    assert plan_directory("plan.json") == Path()
    for name in (str(tmp_path), "orchid", "\0", "x" * 10_000, "~nobody-here/plan"):
        assert plan_directory(name) is None


def test_drones_that_hover_stay(tmp_path):
    made = plan([[0.0, 0.0], [300.0, 0.0]], in_metres=True, drones=1, budget="50", hover=True)
    scene = unpack(replay_of_plan(made.write(tmp_path / "plan")))
    assert scene.slots == 1
    np.testing.assert_array_equal(scene.flights[0].drones_m[0], scene.flights[0].drones_m[1])


class TestDamage:
    @pytest.mark.parametrize(
        ("change", "told"),
        [
            (lambda plan: plan.update(schema=2), "schema is 2, not 1"),
            (lambda plan: plan.pop("drones"), "it has no drones"),
            (lambda plan: plan.update(drones=[]), "nothing to show"),
            (lambda plan: plan["people"].update(total=3), "has 620 people, and the plan 3"),
            (lambda plan: plan["drones"].pop(), "'uav_1', whom the plan does not have"),
            (lambda plan: plan["site"].update(box=[1.0]), "cannot replay the plan"),
            (lambda plan: plan["settings"].update(masts="x"), "cannot replay the plan"),
            (lambda plan: plan["settings"].update(masts={"x": []}), "cannot replay the plan"),
            (lambda plan: plan["settings"].update(mast_heights_m=[]), "cannot replay the plan"),
            (lambda plan: plan["drones"][0].update(east_m=1e300), "too large"),
            (lambda plan: plan["site"].update(center={"lat": 1.0}), "cannot replay the plan"),
            (lambda plan: plan["site"].update(center={"lat": 1e9, "lon": 0.0}), "cannot re"),
        ],
    )
    def test_of_the_plan_is_told(self, copied, change, told):
        with pytest.raises(InputError, match=told):
            replay_of_plan(changed(copied, change))

    @pytest.mark.parametrize(
        ("content", "told"),
        [
            ("x_m,y_m\n", "has no column people"),
            ("x_m,y_m,people,served_by,rate_bps\n1,2\n", "a row is not complete"),
            ("x_m,y_m,people,served_by,rate_bps\n1,2,many,uav_0,3\n", "many"),
            ("x_m,y_m,people,served_by,rate_bps\nnan,2,620,uav_0,3\n", "not finite"),
            ("\xff", "people.csv"),
        ],
    )
    def test_of_the_table_is_told(self, copied, content, told):
        (copied / "people.csv").write_bytes(content.encode("latin-1"))
        with pytest.raises(InputError, match=told):
            replay_of_plan(copied)

    def test_a_missing_table_is_told(self, copied):
        (copied / "people.csv").unlink()
        with pytest.raises(InputError, match=r"cannot read .*people.csv: No such file"):
            replay_of_plan(copied)

    def test_names_of_drones_are_made_harmless(self, copied):
        hostile = "</script>\N{RIGHT-TO-LEFT OVERRIDE}" + "x" * 10_000
        changed(copied, lambda plan: plan["drones"][0].update(id=hostile))
        table = copied / "people.csv"
        table.write_text(table.read_text().replace("uav_0", hostile))
        (name, _) = replay_of_plan(copied).flights[0].drones.names
        assert len(name) < 300 and "\N{RIGHT-TO-LEFT OVERRIDE}" not in name
