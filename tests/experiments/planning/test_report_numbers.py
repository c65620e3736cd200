"""That the report tells what the document says, in numbers that people can read."""

import re

import pytest

from orchid_uav.experiments.markup import harmless
from orchid_uav.experiments.planning.maps.charts import FleetPoint, Range, fleet_chart, ranges_chart
from orchid_uav.experiments.planning.maps.report import report_html
from orchid_uav.experiments.planning.maps.wording import (
    clock_text,
    duration_text,
    length_text,
    people_text,
    rate_text,
    share_text,
)
from orchid_uav.experiments.planning.model import Want
from tests.helpers.plans import make_plan

NUMBERS = {
    rate_text: {
        0.0: "0 bit/s",
        12.0: "12 bit/s",
        999.4: "999 bit/s",
        999.6: "1 kbit/s",
        9_440.0: "9.44 kbit/s",
        840_000.0: "840 kbit/s",
        999_600.0: "1 Mbit/s",
        1_000_000.0: "1 Mbit/s",
        12_345_678.0: "12.3 Mbit/s",
        1_250_000_000.0: "1.25 Gbit/s",
        12_340_000_000_000.0: "12,340 Gbit/s",
    },
    people_text: {0: "0 people", 1: "1 person", 47: "47 people", 20_000: "20,000 people"},
    share_text: {
        0.0: "0 %",
        0.0004: "< 0.1 %",
        0.004: "0.4 %",
        0.5: "50 %",
        0.955: "96 %",
        0.994: "99 %",
        0.996: "99.6 %",
        0.9996: "> 99.9 %",
        1.0: "100 %",
    },
    length_text: {0.0: "0 m", 84.6: "85 m", 999.4: "999 m", 999.6: "1 km", 1234.0: "1.23 km"},
    duration_text: {
        45.4: "45 s",
        119.4: "119 s",
        125.0: "2 min",
        1860.0: "31 min",
        7_260.0: "2 h 1 min",
    },
    clock_text: {0.0: "0:00", 45.0: "0:45", 150.4: "2:30", 3_725.0: "62:05"},
}


@pytest.mark.parametrize(
    ("write", "number", "text"),
    [(write, number, text) for write, rows in NUMBERS.items() for number, text in rows.items()],
)
def test_a_number_is_written_as_people_read_it(write, number, text):
    assert write(number).replace("\xa0", " ") == text


def test_emoji_and_right_to_left_letters_stay_and_what_is_unseen_does_not():
    family = "\U0001f468\u200d\U0001f469\u200d\U0001f467"
    assert harmless(f"{family} \u05d0\u05d1") == f"{family} \u05d0\u05d1"
    assert (
        harmless("a\u202eb\u2066c\nd\ud800e\ufffff\u200b")
        == "a\ufffdb\ufffdc\ufffdd\ufffde\ufffdf\ufffd"
    )


def text_of(plan, heading=None):
    """The text of the page, or of one of its parts."""
    page = report_html(plan)
    if heading is not None:
        page = re.search(rf"<h2>\d\. {heading}</h2>(.*?)</section>", page).group(1)
    page = re.sub("<style>.*?</style>", "", page, flags=re.DOTALL)
    text = re.sub("<[^>]*>", " ", page).replace("\xa0", " ").replace("&lt;", "<")
    text = re.sub(r"\s+", " ", text.replace("&gt;", ">"))
    return re.sub(r" ([,.:;)])", r"\1", text)


def rows_of(plan, caption):
    """The rows of a table, as texts."""
    page = report_html(plan).replace("\xa0", " ")
    body = re.search(rf"<caption>{caption}.*?</table>", page).group()
    return [
        [re.sub("<[^>]*>", "", cell) for cell in re.findall("<t[hd].*?</t[hd]>", row)]
        for row in re.findall("<tr.*?</tr>", body)
    ]


PLAN = make_plan(masts=2, seed=2)
PEOPLE = PLAN.document.people


class TestWhoIsServed:
    def test_it_tells_how_many_by_whom_and_how_many_not(self):
        text = text_of(PLAN, "Who is served")
        served = PEOPLE.served_by_drones + PEOPLE.served_by_masts
        assert f"{served} of {PEOPLE.total} people" in text
        assert f"{PEOPLE.served_by_drones} from drones" in text
        assert f"{PEOPLE.served_by_masts} from the masts on the ground" in text
        assert f"{PEOPLE.unserved} people (" in text
        assert rate_text(PEOPLE.median_rate_bps).replace("\xa0", " ") in text
        assert "Rate of the worst-off person nothing" in text

    def test_it_tells_what_was_wanted_and_whether_that_is_reached(self):
        text = text_of(PLAN, "Who is served")
        assert "Wanted: 500 kbit/s or more for 95 % of all people." in text
        assert "The wish is not met." in text
        text = text_of(make_plan(want=Want(1e3, 0.5)), "Who is served")
        assert "Wanted: 1 kbit/s or more for 50 % of all people." in text
        assert "The wish is met." in text

    def test_a_wish_that_is_just_missed_does_not_look_met(self):
        people = PEOPLE.model_copy(update={"share_above_want": 0.94996})
        text = text_of(make_plan(people=people.to_json()), "Who is served")
        assert "for 95 % of all people. Planned: 94.99 %. The wish is not met." in text

    def test_nobody_left_out_is_told_plainly(self):
        people = PEOPLE.model_copy(
            update={"unserved": 0, "served_by_drones": 590, "served_by_masts": 19, "total": 609}
        )
        text = text_of(make_plan(people=people.to_json()), "Who is served")
        assert "Nobody is left out." in text
        assert "not served: 0 (0 %)" in text

    def test_without_a_mast_none_is_spoken_of(self):
        text = text_of(make_plan(masts=0), "Who is served")
        assert "from the mast" not in text
        assert "by masts" not in text

    def test_one_person_is_one_person(self):
        text = text_of(make_plan(1, 1, 0, greatest_weight=1))
        assert "Where 1 drone should circle to connect 1 person" in text


class TestWhereTheDronesAre:
    def test_the_table_tells_all_of_each_drone(self):
        heads, *rows = rows_of(PLAN, "The drones and their stations")
        assert len(rows) == 6
        for row, drone in zip(rows, PLAN.document.drones, strict=True):
            told = dict(zip(heads, row, strict=True))
            assert told["Drone"] == drone.id
            assert told["Latitude, longitude"] == f"{drone.lat:.5f}, {drone.lon:.5f}"
            assert told["Altitude above home"] == f"{drone.altitude_m:.0f} m"
            assert told["Circle, speed"] == "48 m radius, 11.5 m/s"
            assert told["People"] == str(drone.people)
            assert told["Time on station"] == f"{drone.endurance_minutes:.0f} min"
            assert told["Transmits"] == f"{drone.transmit_power_w:g} W"
            assert told["Link to a mast"].startswith(f"{drone.backhaul_snr_db:.1f} dB, ")
        assert [row[-1] for row in rows[:2]] == ["0:00, 60 m", "0:45, 70 m"]

    def test_the_distance_is_that_to_the_nearest_mast(self):
        plan = make_plan(drones=1, masts=2)
        drone, masts = plan.document.drones[0], plan.surroundings.masts
        distances_m = [
            ((mast.east_m - drone.east_m) ** 2 + (mast.north_m - drone.north_m) ** 2) ** 0.5
            for mast in masts
        ]
        heads, row = rows_of(plan, "The drones and their stations")
        told = row[heads.index("Link to a mast")]
        assert told.endswith(f", {length_text(min(distances_m))}".replace("\xa0", " "))

    def test_without_a_place_on_earth_there_are_metres(self):
        plan = make_plan(center=None)
        heads, *rows = rows_of(plan, "The drones and their stations")
        assert "Latitude, longitude" not in heads
        first = plan.document.drones[0]
        assert rows[0][heads.index("Metres east, north")] == (
            f"{first.east_m:,.0f}, {first.north_m:,.0f}"
        )
        assert "WGS 84" not in text_of(plan)

    def test_without_masts_and_launches_there_are_no_such_columns(self):
        heads, *_ = rows_of(make_plan(masts=0, launches=[]), "The drones and their stations")
        assert heads[-1] == "Transmits"
        assert "There is no mast in this plan" in text_of(make_plan(masts=0))

    def test_a_drone_that_hovers_has_no_circle(self):
        heads, *rows = rows_of(make_plan(hover=True), "The drones and their stations")
        assert {row[heads.index("Circle, speed")] for row in rows} == {"hovers"}

    def test_the_masts_are_told_with_their_people(self):
        _, *rows = rows_of(PLAN, "The masts on the ground")
        assert [row[0] for row in rows] == ["mast_0", "mast_1"]
        people = [int(row[3].split()[0]) for row in rows]
        assert sum(people) == PEOPLE.served_by_masts
        assert rows[0][2] == "30 m"


class TestHowSure:
    def test_every_check_is_told_with_its_worst(self):
        _, planned, *rows = rows_of(PLAN, "Means, and in brackets the worst")
        assert planned[0] == "as planned"
        robustness = PLAN.document.robustness
        drawn = [
            robustness.position_error_50m,
            robustness.position_error_150m,
            robustness.shadowing,
            robustness.walking_10_minutes,
        ]
        for row, one in zip(rows[:4], drawn, strict=True):
            pairs = [
                (share_text(one.share_served), share_text(one.share_served_worst)),
                ("nothing", "nothing"),
                (rate_text(one.median_rate_bps), rate_text(one.median_rate_bps_worst)),
                (share_text(one.share_above_want), share_text(one.share_above_want_worst)),
            ]
            expected = [f"{mean} ({worst})".replace("\xa0", " ") for mean, worst in pairs]
            assert row[1:] == expected
        assert [row[0] for row in rows[4:]] == [
            "one drone lost, at once",
            "one drone lost, others moved",
        ]
        lost = robustness.one_drone_lost
        assert rows[4][1] == (
            f"{share_text(lost.share_served)} ({share_text(lost.share_served_worst)})"
        ).replace("\xa0", " ")
        assert rows[5][1].startswith(share_text(lost.share_served_regained).replace("\xa0", " "))

    def test_who_takes_over_is_told_and_nobody_is_forgotten(self):
        _, *rows = rows_of(PLAN, "Each drone lost in turn")
        lost = {one.drone: one for one in PLAN.document.robustness.one_drone_lost.each}
        assert {row[0] for row in rows} == set(lost)
        for name, before, taken, *_ in rows:
            one = lost[name]
            assert before == people_text(one.people_before).replace("\xa0", " ")
            told = dict(part.split(": ") for part in taken.split(", "))
            assert sum(map(int, told.values())) == one.people_before
            for other, count in one.taken_over.items():
                assert told[other] == str(count)

    def test_the_drone_that_is_missed_most_comes_first(self):
        _, *rows = rows_of(PLAN, "Each drone lost in turn")
        each = PLAN.document.robustness.one_drone_lost.each
        assert rows[0][0] == max(each, key=lambda one: one.left.unserved).drone

    def test_of_many_drones_all_are_told_those_that_matter_least_folded_away(self):
        plan = make_plan(20, 400)
        _, *first = rows_of(plan, "Each drone lost in turn")
        _, *rest = rows_of(plan, "The 12 other drones")
        names = {row[0] for row in first + rest}
        assert names == {drone.id for drone in plan.document.drones}

    def test_a_single_drone_cannot_be_replaced(self):
        text = text_of(make_plan(drones=1), "How sure this is")
        assert "With one drone there is no other that could take over" in text
        assert "one drone lost" not in text


class TestTheRest:
    def test_other_numbers_of_drones_are_told_and_this_one_is_marked(self):
        heads, *rows = rows_of(PLAN, "The same people with other numbers of drones")
        sizes = PLAN.document.fleet_sizes
        assert [row[0] for row in rows] == ["4", "5", "6", "7", "8"]
        for row, size in zip(rows, sizes, strict=True):
            told = dict(zip(heads, row, strict=True))
            assert told["Not served"] == f"{size.people.unserved} people"
            assert told["Median"] == rate_text(size.people.median_rate_bps).replace("\xa0", " ")
            assert told["500 kbit/s or more"] == share_text(size.people.share_above_want).replace(
                "\xa0", " "
            )
            assert told["Utility"] == f"{size.utility:.3f}"
        assert report_html(PLAN).count('class="chosen"') == 1

    def test_the_least_number_that_meets_the_wish_is_named(self):
        text = text_of(make_plan(want=Want(500e3, 1.0)), "Why so many drones")
        assert "None of these numbers gives 500 kbit/s or more for 100 % of all people." in text
        plan = make_plan(want=Want(500e3, 0.7))
        shares = {size.drones: size.people.share_above_want for size in plan.document.fleet_sizes}
        least = min(drones for drones, share in shares.items() if share >= 0.7)
        assert 4 < least < 9
        text = text_of(plan, "Why so many drones")
        wish = "500 kbit/s or more for 70 % of all people"
        assert f"The least of these numbers that gives {wish} is {least}." in text

    def test_batteries_and_drones_of_a_day_are_told(self):
        text = text_of(PLAN, "Keeping the drones in the air")
        assert "38 min to 41 min" in text
        assert "228 full batteries and 13 drones" in text

    def test_what_is_not_known_is_told_with_the_notes(self):
        text = text_of(
            make_plan(notes=["A first note.", "And <another>."]), "What this plan does not know"
        )
        for word in ("Terrain", "Buildings", "Weather", "neighbouring networks", "authorities"):
            assert word in text
        assert "A first note." in text
        assert "And &lt;another>." in text.replace("<", "&lt;")

    def test_how_it_was_made_is_told(self):
        text = text_of(make_plan(date="2026-11-27"), "Terms, and how this plan was made")
        assert "orchid plan people.csv --drones 6 --seed 7" in text
        assert "tried 12,000 arrangements of the drones, beginning with seed 7." in text
        assert "a utility of 2.613" in text
        assert "environment suburban" in text
        assert "date 2026-11-27" in text

    @pytest.mark.parametrize("term", ["median", "utility", "shadowing", "dB", "home", "seed"])
    def test_terms_are_explained(self, term):
        assert f"<dt>{term}</dt>" in report_html(PLAN)


class TestCharts:
    def test_bars_tell_everybody_once(self):
        page = report_html(PLAN)
        chart = re.search('<desc id="rates-desc">(.*?)</desc>', page).group(1)
        counts = [int(number.replace(",", "")) for number in re.findall(r"([\d,]+)\xa0p", chart)]
        assert sum(counts) == PEOPLE.total
        assert counts[0] == PEOPLE.unserved

    def test_bars_are_as_tall_as_their_counts(self):
        page = report_html(PLAN)
        chart = page[page.index("rates-title") : page.index("</svg>", page.index("rates-title"))]
        bars = re.findall(r'<rect [^>]*height="([\d.]+)" class="c-(\w+)"', chart)
        tall = {}
        for height, kind in bars:
            tall[kind] = tall.get(kind, 0.0) + float(height)
        assert tall["drone"] / tall["unserved"] == pytest.approx(
            PEOPLE.served_by_drones / PEOPLE.unserved, rel=0.05
        )
        assert tall["mast"] / tall["unserved"] == pytest.approx(
            PEOPLE.served_by_masts / PEOPLE.unserved, rel=0.05
        )

    def test_the_range_chart_lies_between_its_ends(self):
        chart = ranges_chart(1.0, [Range("a", 0.9, 0.0), Range("b", 1.0, 1.0)])
        across = [float(x) for x in re.findall(r'cx="([\d.]+)"', chart)]
        assert across[0] == pytest.approx(16 + 0.9 * (across[1] - 16), abs=0.2)

    def test_a_fleet_chart_of_one_number_is_drawn(self):
        assert "nan" not in fleet_chart([FleetPoint(1, 0.5, None)], 1, None)
