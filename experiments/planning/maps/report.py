"""``report.html``: the whole plan on one page that needs no network and no program."""

from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.pages import html_page
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.report_background import (
    how_it_was_made,
    terms,
    what_is_unknown,
)
from orchid_uav.experiments.planning.maps.report_checks import (
    how_many,
    how_sure,
    keeping_in_the_air,
)
from orchid_uav.experiments.planning.maps.report_people import who_is_served
from orchid_uav.experiments.planning.maps.report_places import where_drones_are
from orchid_uav.experiments.planning.maps.style import report_style
from orchid_uav.experiments.planning.maps.wording import number_text, people_text


def report_html(plan: MappedPlan) -> str:
    """The page of a plan; the same plan gives the same text."""
    drones = len(plan.stations)
    stay = "hover" if all(one.circle_radius_m == 0.0 for one in plan.stations) else "circle"
    title = (
        f"Where {number_text(drones, 'drone', 'drones')} should {stay} "
        f"to connect {people_text(plan.document.people.total)}"
    )
    return html_page(
        title,
        report_style(drones),
        element("header", element("h1", title), _purpose()),
        element(
            "main",
            *(
                element("section", element("h2", f"{number}. {heading}"), *content)
                for number, (heading, content) in enumerate(
                    (
                        ("Who is served", who_is_served(plan)),
                        ("Where the drones are", where_drones_are(plan)),
                        ("How sure this is", how_sure(plan)),
                        ("Why so many drones", how_many(plan)),
                        ("Keeping the drones in the air", keeping_in_the_air(plan)),
                        ("What this plan does not know", what_is_unknown(plan)),
                        ("Terms, and how this plan was made", [*terms(), *how_it_was_made(plan)]),
                    ),
                    1,
                )
            ),
        ),
    )


def _purpose() -> Markup:
    return element(
        "p",
        "This is a plan for ",
        element("dfn", "drones that carry base stations"),
        ": small mobile phone masts in the air, for a place where the network on the ground has "
        "failed. It says where the drones should be, whom they serve and how well, and who is "
        "left without a connection. It shows where people are: share it with care.",
        class_="quiet",
    )
