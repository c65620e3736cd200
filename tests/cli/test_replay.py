"""``orchid replay``: what it writes, what it says, and what it refuses."""

import html.parser
import json

import numpy as np
import pytest
from PIL import Image

from orchid_uav.experiments.planning import plan
from orchid_uav.experiments.replay.document import ReplayDocument
from orchid_uav.experiments.replay.scene import unpack
from tests.helpers.processes import TINY_FLAGS, assert_is_an_error

QUICK = ("--uavs=2", "--users=20", "--set=network.episode_slots=8", "--quiet")
METHODS = "--methods=loiter-mmf,static-mmf"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """Replays without --out are written where the command is given."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def a_plan(tmp_path):
    made = plan([[0.0, 0.0], [600.0, 0.0], [600.0, 600.0]], in_metres=True, drones=2, budget="50")
    return made.write(tmp_path / "a plan")


class _Elements(html.parser.HTMLParser):
    """The elements of a page, and the texts of its scripts."""

    def __init__(self, text):
        super().__init__()
        self.names, self.documents, self._inside = [], [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        self._inside = tag == "script" and dict(attrs).get("id") == "document"

    def handle_data(self, data):
        if self._inside:
            self.documents.append(data)
            self._inside = False


def document_of(path):
    (text,) = _Elements(path.read_text(encoding="utf-8")).documents
    return ReplayDocument.from_json(json.loads(text))


class TestReplay:
    def test_two_methods_make_a_page(self, orchid, tmp_path):
        finished = orchid("replay", METHODS, *QUICK, "-o", "flight.html")
        assert finished.code == 0, finished.err
        document = document_of(tmp_path / "flight.html")
        assert [flight.key for flight in document.flights] == ["loiter-mmf", "static-mmf"]
        assert (document.slots, document.users.count) == (8, 20)
        heading, *rows, last = finished.out.splitlines()
        assert heading.split("\t")[:2] == ["method", "rate JFI"]
        assert [row.split("\t")[0] for row in rows] == ["loiter-mmf", "static-mmf"]
        jfi = document.flights[0].metrics["rate_jfi"].values().mean()
        assert rows[0].split("\t")[1] == f"{jfi:.3f}"
        assert last.startswith("completed: flight.html (0.")

    def test_without_a_name_it_says_where_the_page_is(self, orchid, tmp_path):
        for count in (1, 2):
            finished = orchid("replay", "--methods=track", *QUICK)
            assert finished.code == 0, finished.err
            pages = list((tmp_path / "orchid-replay").iterdir())
            assert len(pages) == count
            name = finished.out.splitlines()[-1].split()[1]
            assert tmp_path / name in pages and name.endswith(".html")

    def test_json_is_the_only_output(self, orchid, tmp_path):
        topology = ("--seed=3", "--topology=2", "--speeds=10")
        finished = orchid("replay", METHODS, *QUICK, *topology, "-o", "f.html", "--json")
        told = json.loads(finished.out)
        assert told["bytes"] == (tmp_path / "f.html").stat().st_size
        assert told["file"] == "f.html" and told["slots"] == 8
        assert told["subtitle"].endswith("held-out topology 2 of seed 3")
        assert "10\N{NO-BREAK SPACE}m/s" in told["subtitle"]
        evaluated = orchid(
            *("eval", METHODS, *QUICK, "--seed=3", "--episodes=3", "--speeds=10", "--json"),
            *("--no-figures", "--out", "e"),
        )
        assert evaluated.code == 0, evaluated.err
        import pyarrow.parquet as pq

        rows = pq.read_table(tmp_path / "e" / "episodes.parquet").to_pylist()
        for flight in told["flights"]:
            (row,) = [
                row for row in rows if (row["method"], row["episode"]) == (flight["method"], 2)
            ]
            for name, mean in flight["metrics"].items():
                assert mean == pytest.approx(row[name], rel=1e-5)

    def test_a_name_says_what_is_written(self, orchid, tmp_path):
        for name, options, frames in (
            ("f.gif", ("--every=4", "--fps=5", "--width=300"), 3),
            ("f.webp", ("--every=8", "--width=300"), 2),
            ("f.png", ("--frame=0", "--width=300"), 1),
        ):
            finished = orchid("replay", METHODS, *QUICK, "-o", name, *options)
            assert finished.code == 0, finished.err
            with Image.open(tmp_path / name) as picture:
                assert picture.format.lower() == name[2:] and picture.width == 300
                assert getattr(picture, "n_frames", 1) == frames

    def test_the_same_command_gives_the_same_page(self, orchid, tmp_path):
        for name in ("a.html", "b.html"):
            assert orchid("replay", METHODS, *QUICK, "-o", name).code == 0
        assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()

    def test_a_file_that_is_there_is_kept_unless_forced(self, orchid, tmp_path):
        page = tmp_path / "f.html"
        page.write_text("precious")
        again = ("replay", "--methods=track", *QUICK, "-o", "f.html")
        assert_is_an_error(orchid(*again), "f.html exists", "--force")
        assert page.read_text() == "precious"
        assert orchid(*again, "--force").code == 0
        assert document_of(page).title == "track"

    def test_a_run_flies_in_its_own_world_beside_a_method(self, orchid, tmp_path):
        trained = orchid(
            *("train", *TINY_FLAGS, "--episodes=1", "--no-rf", "--quiet"),
            *("--set=network.area_m=1500", "--set=network.user_speed_mps=6", "--name=mine"),
        )
        assert trained.code == 0, trained.err
        (run,) = (tmp_path / "runs").iterdir()
        finished = orchid("replay", run.name, "--methods=track", "-o", "f.html", "--quiet")
        assert finished.code == 0, finished.err
        document = document_of(tmp_path / "f.html")
        assert document.area_m == [1500.0, 1500.0] and document.slots == 10
        assert [flight.key for flight in document.flights] == [run.name, "track"]
        assert document.flights[0].label.startswith("mine")
        assert np.ptp(unpack(document).users_m, axis=0).max() > 1.0
        finished = orchid("replay", run.name, "--users=7", "-o", "g.html", "--quiet")
        assert document_of(tmp_path / "g.html").users.count == 7

    def test_a_plan_by_its_directory(self, orchid, tmp_path, a_plan):
        finished = orchid("replay", a_plan, "-o", "f.html", "--json")
        assert finished.code == 0, finished.err
        assert json.loads(finished.out)["flights"][0]["method"] == "plan"
        assert document_of(tmp_path / "f.html").users.count == 3

    def test_hostile_texts_do_no_harm(self, orchid, tmp_path, a_plan):
        hostile = "</script><script>alert(1)</script>\u2028\N{FIRE}{{style}}<!--" + "x" * 10_000
        own = tmp_path / "own.py"
        own.write_text(
            "from orchid_uav.agents.controllers.heuristics import Hover\n"
            f"class Mine(Hover):\n    idea = {hostile!r}\n"
        )
        described = json.loads((a_plan / "plan.json").read_text())
        described["drones"][0]["id"] = hostile
        (a_plan / "plan.json").write_text(json.dumps(described))
        table = a_plan / "people.csv"
        table.write_text(table.read_text().replace("uav_0", hostile), encoding="utf-8")
        assert orchid("replay", "--methods=track", *QUICK, "-o", "usual.html").code == 0
        usual = _Elements((tmp_path / "usual.html").read_text(encoding="utf-8")).names
        for number, given in enumerate((["--method", f"{own}:Mine", *QUICK], [a_plan])):
            page = tmp_path / f"{number}.html"
            finished = orchid("replay", *given, "-o", page)
            assert finished.code == 0, finished.err
            assert _Elements(page.read_text(encoding="utf-8")).names == usual
            (flight,) = document_of(page).flights
            shown = flight.note if number == 0 else flight.drones.names[0]
            assert shown.startswith("</script><script>alert(1)</script>\ufffd\N{FIRE}{{style}}<!--")
            assert len(shown) < 300


class TestRefusals:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            ((), ("nothing to replay", "--methods orchid-distilled")),
            (("--methods=track,orchid,planner",), ("3 methods", "two side by side")),
            (("--methods=rules",), ("methods: a replay shows one",)),
            (("--methods=trak",), ("unknown method 'trak'", "track")),
            (("--methods=track", "--uavs=4..6"), ("--uavs", "'4..6'")),
            (("--methods=track", "--uavs=0"), ("uav_count = 0",)),
            (("--methods=track", "--topology=-1"), ("--topology",)),
            (("--methods=track", "-o", "f.mp4"), ("f.mp4", ".webp")),
            (("--methods=track", "-o", "no/f.gif"), ("f.gif", "not a directory to write in")),
            (("--methods=track", "--frame=3"), ("--frame has no effect on a .html", ".png")),
            (("--methods=track", "-o", "f.png", "--every=3"), ("--every has no effect",)),
            (("--methods=track", "-o", "f.png", "--frame=201"), ("--frame 201", "slot is 200")),
            (
                ("--methods=track", "--set=network.episode_slots=9000", "--every=1", "-o=f.gif"),
                ("9,001 pictures", "--every 90"),
            ),
            (("--methods=track", "--set=network.uav_count=3"), ("use --uavs",)),
            (("--methods=track", "--set=ppo.discount=0.5"), ("nothing is trained here",)),
            (("nowhere",), ("no run 'nowhere'",)),
            (("track",), ("no run 'track'", "it is a method: give --methods track")),
        ],
    )
    def test_what_is_wrong_is_told_and_nothing_written(self, orchid, tmp_path, arguments, parts):
        assert_is_an_error(orchid("replay", *arguments), *parts)
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize("given", ["--methods=track", "--seed=1", "--uavs=3"])
    def test_a_plan_is_shown_alone(self, orchid, tmp_path, a_plan, given):
        finished = orchid("replay", a_plan, given, "-o", "f.html")
        assert_is_an_error(finished, "is a plan, which is shown", "leave out")
        assert not (tmp_path / "f.html").exists()

    def test_a_full_disk_leaves_nothing(self, orchid, tmp_path, monkeypatch):
        def full(*_):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("orchid_uav.storage.files.sync_file", full)
        finished = orchid("replay", "--methods=track", *QUICK, "-o", "f.html")
        assert_is_an_error(finished, "cannot write f.html: No space left", code=1)
        assert not list(tmp_path.iterdir())
