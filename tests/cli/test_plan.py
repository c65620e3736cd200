"""``orchid plan``: what it writes, what it says, and what it refuses."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from orchid_uav.cli.tables.planning import print_plan
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning import plan
from orchid_uav.experiments.planning.planner import PlanningListener
from orchid_uav.experiments.planning.result import PlanDocument
from tests.helpers.processes import assert_is_an_error, fingerprint

EXAMPLE = Path(__file__).parents[2] / "examples" / "planning"
PEOPLE = EXAMPLE / "people.csv"
ON_EARTH = {
    *("plan.json", "report.html", "stations.geojson", "people.geojson", "plan.kml"),
    *("fence.geojson", "missions"),
}
QUICK = ("--budget=200", "--drones=3")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Plans without --out are written where the command is given."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def out(tmp_path):
    return tmp_path / "plan"


@pytest.fixture(scope="module")
def metres(tmp_path_factory):
    path = tmp_path_factory.mktemp("metres") / "people.csv"
    places_m = np.random.default_rng(0).uniform(0.0, 1500.0, (40, 2))
    path.write_text("x_m,y_m\n" + "".join(f"{x:.1f},{y:.1f}\n" for x, y in places_m))
    return path


class TestPlan:
    def test_it_writes_all_files_and_tells_what_they_say(self, orchid, out):
        finished = orchid(
            *("plan", PEOPLE, *QUICK, "--out", out, "--mast=17.2966,-62.7243,30"),
            *("--area", EXAMPLE / "area.geojson", "--no-fly", EXAMPLE / "airport.geojson"),
            *("--want", "500kbps:95%", "--home", "17.2975,-62.7250,10"),
        )
        assert finished.code == 0, finished.err
        assert {path.name for path in out.iterdir()} == ON_EARTH
        names = {path.name for path in (out / "missions" / "px4").iterdir()}
        assert names == {"uav_0.plan", "uav_1.plan", "uav_2.plan"}
        names = {path.name for path in (out / "missions" / "ardupilot").iterdir()}
        assert names == {f"uav_{n}.{kind}" for n in range(3) for kind in ("plan", "waypoints")}
        document = PlanDocument.from_json(json.loads((out / "plan.json").read_text()))
        weights = [int(line.split(",")[2]) for line in PEOPLE.read_text().splitlines()[1:]]
        people = document.people
        assert people.total == sum(weights)
        told = f"wanted: 500 kbit/s for 95% of the people; {people.share_above_want:.1%} have it: "
        assert f"{told}not enough, no number above would do" in " ".join(finished.out.split())
        served = people.served_by_drones + people.served_by_masts
        assert served + people.unserved == people.total
        assert sum(drone.people for drone in document.drones) == people.served_by_drones
        assert [size.drones for size in document.fleet_sizes] == [1, 2, 3, 4, 5]
        assert document.evaluations == 200
        assert f"{people.total} people: {people.served_by_drones} served by drones" in finished.out
        for drone in document.drones:
            assert f"{drone.lat:.6f}, {drone.lon:.6f}" in finished.out
        west, south, east, north = document.site.box
        assert all(
            south <= drone.lat <= north and west <= drone.lon <= east for drone in document.drones
        )

    def test_the_same_command_gives_the_same_bytes(self, orchid, tmp_path):
        fingerprints = []
        for _ in range(2):
            assert orchid("plan", PEOPLE, *QUICK, "--quiet").code == 0
            (made,) = (tmp_path / "orchid-plan").iterdir()
            fingerprints.append(fingerprint(made))
            made.rename(tmp_path / f"done-{len(fingerprints)}")
        assert fingerprints[0] == fingerprints[1]

    def test_a_site_in_metres_gets_what_needs_no_place_on_earth(self, orchid, out, metres):
        finished = orchid("plan", metres, *QUICK, "--out", out, "--json")
        assert finished.code == 0, finished.err
        assert {path.name for path in out.iterdir()} == {"plan.json", "report.html", "people.csv"}
        assert "no place on earth" in finished.err
        document = json.loads(finished.out)
        assert document == json.loads((out / "plan.json").read_text())
        assert document["site"]["center"] is None and document["drones"][0]["lat"] is None

    def test_home_is_beside_a_mast_and_not_under_it(self, orchid, out):
        mast = ("--mast", "17.2966,-62.7243,30")
        finished = orchid("plan", PEOPLE, *QUICK, *mast, "--out", out, "--json")
        document = json.loads(finished.out)
        home, (of_mast,) = document["settings"]["home"], document["settings"]["masts"]
        assert of_mast == pytest.approx([17.2966, -62.7243])
        away_m = np.hypot(*(np.subtract(home, of_mast) * [110_700.0, 106_300.0]))
        assert away_m == pytest.approx(60.0, rel=0.01)
        assert f"{home[0]:.6f}, {home[1]:.6f}" in finished.err
        for path in (out / "missions").rglob("*.plan"):
            first = json.loads(path.read_text())["mission"]["items"][0]["params"]
            assert first[4:6] == pytest.approx(home, abs=2e-7)

    def test_what_might_surprise_is_noted(self, orchid, tmp_path):
        people = tmp_path / "three.csv"
        people.write_text("lat,lon\n17.3,-62.72\n17.3,-62.7201\n17.3,-62.7202\n")
        finished = orchid("plan", people, "--drones=4", "--budget=200", "--mast=17.31,-62.72")
        assert finished.code == 0
        assert "more drones (4) than people (3)" in finished.err
        assert "Nobody is served by uav_" in finished.err
        assert "Masts serve nobody" in finished.err

    def test_a_column_that_may_have_been_meant_for_people_is_named(self, orchid, tmp_path):
        people = tmp_path / "three.csv"
        people.write_text("lat,lon,population\n17.3,-62.72,3\n17.3,-62.7201,4\n17.31,-62.72,4\n")
        finished = orchid("plan", people, "--drones=1", "--budget=50")
        assert finished.code == 0
        assert "counts as one person (not used: 'population')" in " ".join(finished.err.split())

    def test_the_display_ends_before_any_error_is_told(self, orchid, out, monkeypatch):
        ended = []
        monkeypatch.setattr(PlanningListener, "ends", lambda _: ended.append(True))
        out.mkdir()
        (out / "mine.txt").write_text("")
        assert orchid("plan", PEOPLE, "--out", out, "--quiet").code == 2
        assert orchid("plan", PEOPLE, "--altitude=120..80", "--quiet").code == 2
        assert orchid("plan", PEOPLE, "--set=channel.environment=city", "--quiet").code == 2
        assert len(ended) >= 2

    def test_swapped_latitudes_and_longitudes_are_suspected(self, orchid, tmp_path):
        people = tmp_path / "three.csv"
        people.write_text("lat,lon\n-62.72,17.3\n-62.7201,17.3\n-62.7202,17.31\n")
        finished = orchid("plan", people, "--drones=1", "--budget=50")
        assert finished.code == 0
        assert "latitude -62.7°, where hardly anybody lives" in " ".join(finished.err.split())

    def test_one_firmware_alone(self, orchid, out):
        assert orchid("plan", PEOPLE, *QUICK, "--out", out, "--firmware=px4").code == 0
        assert [path.name for path in (out / "missions").iterdir()] == ["px4"]

    def test_auto_finds_a_number_that_meets_what_is_wanted(self, orchid, out, metres):
        finished = orchid(
            "plan",
            metres,
            "--drones=auto",
            "--want=3Mbps:90%",
            "--budget=3000",
            "--out",
            out,
            "--json",
        )
        document = PlanDocument.from_json(json.loads(finished.out))
        by_size = {size.drones: size.people.share_above_want for size in document.fleet_sizes}
        found = len(document.drones)
        assert by_size[found] >= 0.9
        shown = io.StringIO()
        print_plan(Console(file=shown, width=100), document)
        assert "of the people; " in shown.getvalue() and " have it: enough\n" in shown.getvalue()
        assert found == 1 or by_size[found - 1] < by_size[found]
        assert f"note: {found} drones are the least that were found" in finished.err

    @pytest.mark.parametrize("method", ["balanced", "best-response"])
    def test_other_methods_find_stations_too(self, orchid, out, metres, method):
        finished = orchid("plan", metres, *QUICK, "--out", out, "--json", f"--method={method}")
        assert finished.code == 0, finished.err
        planner = json.loads(orchid("plan", metres, *QUICK, "--json").out)
        assert json.loads(finished.out)["utility"] < planner["utility"] + 0.05

    def test_hovering_takes_more_energy_and_no_circle(self, orchid, out, metres):
        circling = json.loads(orchid("plan", metres, *QUICK, "--json").out)
        hovering = json.loads(orchid("plan", metres, *QUICK, "--json", "--hover").out)
        for one, other in zip(hovering["drones"], circling["drones"], strict=True):
            assert one["circle_radius_m"] == one["speed_mps"] == 0.0
            assert one["endurance_minutes"] < 0.7 * other["endurance_minutes"]

    def test_a_file_and_options_say_the_same(self, orchid, tmp_path, metres):
        config = tmp_path / "plan.toml"
        config.write_text("[plan]\nbattery_wh = 400\ndrones = 3\nhover = true\n")
        of_file = json.loads(
            orchid("plan", metres, "--budget=200", "--config", config, "--json").out
        )
        flags = ("--battery-wh=400", "--hover")
        of_flags = json.loads(orchid("plan", metres, *QUICK, *flags, "--json").out)
        assert of_file["drones"] == of_flags["drones"]
        assert of_file["settings"] == of_flags["settings"]

    def test_environments_are_constants_of_the_channel(self, orchid, metres):
        found = json.loads(orchid("plan", metres, *QUICK, "--environment=high-rise", "--json").out)[
            "settings"
        ]
        assert (found["channel.s_curve_a"], found["channel.s_curve_b"]) == (27.23, 0.08)
        own = ("--environment=high-rise", "--set=channel.s_curve_a=20")
        found = json.loads(orchid("plan", metres, *QUICK, *own, "--json").out)["settings"]
        assert (found["channel.s_curve_a"], found["channel.s_curve_b"]) == (20.0, 0.08)


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            ([], ["no file with people"]),
            (["no-such.csv"], ["no-such.csv"]),
            ([PEOPLE, "--drones=0"], ["--drones 0"]),
            ([PEOPLE, "--drones=auto"], ["--drones auto needs --want"]),
            ([PEOPLE, "--want=fast"], ["--want", "1Mbps:95%"]),
            ([PEOPLE, "--budget=soon"], ["--budget", "5s"]),
            ([PEOPLE, "--environment=jungle"], ["unknown environment 'jungle'"]),
            ([PEOPLE, "--mast=40.1,-62.7"], ["--mast 40.1,-62.7"]),
            ([PEOPLE, "--battery-wh=2"], ["battery of 2 Wh"]),
            ([PEOPLE, "--set=plan.drone=3"], ["unknown key 'plan.drone'", "plan.drones"]),
            ([PEOPLE, "--method=plannner"], ["plannner", "planner"]),
            ([PEOPLE, "--drones=30", "--clearance-m=3000"], ["room for", "--clearance-m"]),
            ([PEOPLE, "--altitude=120..80"], ["80..120"]),
            ([PEOPLE, "--mast=17.3,-62.72", "--home=17.3,-62.72"], ["--home", "at least 20 m"]),
        ],
    )
    def test_nothing_is_left_behind(self, orchid, tmp_path, arguments, parts):
        finished = orchid("plan", "--budget=100", *arguments, "--quiet")
        assert_is_an_error(finished, *parts)
        assert list(tmp_path.iterdir()) == []

    def test_a_directory_that_is_not_empty_is_kept(self, orchid, out):
        out.mkdir()
        (out / "notes.txt").write_text("mine")
        before = fingerprint(out)
        assert_is_an_error(orchid("plan", PEOPLE, *QUICK, "--out", out), str(out))
        assert fingerprint(out) == before

    def test_all_wrong_rows_are_told_at_once(self, orchid, tmp_path):
        people = tmp_path / "people.csv"
        people.write_text("lat,lon,people\n17.3,-62.7,2\nx,-62.7,1\n17.3,-62.7,-4\n17.3,,1\n")
        finished = orchid("plan", people, *QUICK)
        assert finished.code == 2 and "3 mistakes" in finished.err
        for row in ("row 3", "row 4", "row 5"):
            assert row in finished.err


class TestCheck:
    def test_written_missions_break_no_rule(self, orchid, out):
        assert orchid("plan", PEOPLE, *QUICK, "--out", out).code == 0
        for path in sorted((out / "missions").rglob("*.plan")):
            finished = orchid("plan", "--check", path)
            assert finished.code == 0 and "no rule is broken" in finished.out

    def test_a_broken_rule_is_exit_2(self, orchid, out, tmp_path):
        assert orchid("plan", PEOPLE, *QUICK, "--out", out).code == 0
        document = json.loads((out / "missions" / "px4" / "uav_0.plan").read_text())
        document["mission"]["items"][1]["params"].pop()
        broken = tmp_path / "broken.plan"
        broken.write_text(json.dumps(document))
        finished = orchid("plan", "--check", broken)
        assert finished.code == 2 and "params" in finished.out
        findings = json.loads(orchid("plan", "--check", broken, "--json").out)["findings"]
        assert any(finding["severity"] == "error" for finding in findings)


class TestFromPython:
    def test_attributes_are_those_of_the_file(self, tmp_path):
        made = plan(PEOPLE, drones=2, budget="200", battery_wh=500.0)
        directory = made.write(tmp_path / "plan")
        assert json.loads((directory / "plan.json").read_text()) == made.to_json()
        assert made.settings["plan.battery_wh"] == 500.0 and len(made.drones) == 2

    def test_positions_can_be_an_array(self):
        places_m = [[0.0, 0.0], [600.0, 0.0], [600.0, 600.0]]
        made = plan(places_m, weights=[1, 2, 3], in_metres=True, drones=2, budget="100")
        assert made.people.total == 6 and made.site.center is None

    @pytest.mark.parametrize(
        ("given", "told"),
        [
            ({"people": [[91.0, 0.0]]}, "91.0 is not a latitude"),
            ({"people": [1.0, 2.0]}, r"the shape \(2,\)"),
            ({"people": [[1.0, 2.0]], "weights": [0]}, "not a number of people"),
            ({"people": [[1.0, 2.0]], "batery_wh": 3}, "battery_wh"),
        ],
    )
    def test_what_is_wrong_is_told(self, given, told):
        with pytest.raises(InputError, match=told):
            plan(**given)
