"""``report.html`` of a reproduction: one page that needs no network and no program."""

from collections.abc import Sequence

from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.pages import html_page
from orchid_uav.experiments.reproduction.figures.drawn import DrawnFigure
from orchid_uav.experiments.reproduction.report.background import rules, terms, what_was_run
from orchid_uav.experiments.reproduction.report.methods import (
    beside_twins,
    false_alarms,
    sensitivities,
    what_is_added,
)
from orchid_uav.experiments.reproduction.report.overview import progress, purpose
from orchid_uav.experiments.reproduction.report.pictures import by_number, pictures
from orchid_uav.experiments.reproduction.report.style import report_style
from orchid_uav.experiments.reproduction.report.verdicts import (
    at_a_glance,
    claims_table,
    every_claim,
)
from orchid_uav.experiments.reproduction.result import Reproduction

_TITLE = "ORCHID reproduced: which of the paper's claims hold"


def report_html(reproduction: Reproduction, figures: Sequence[DrawnFigure]) -> str:
    """The page of a reproduction; the same documents and figures give the same text.

    Args:
        reproduction: the content of ``claims.json``.
        figures: the figures that were drawn from the same rows.

    Raises:
        OSError: the file of a figure cannot be read.
    """
    drawn = by_number(figures)
    claims, questions = reproduction.claims, reproduction.questions
    both = [*claims, *questions]
    title = f"NOT EVIDENCE: {_TITLE}" if reproduction.is_quick else _TITLE
    parts: list[tuple[str, list[Markup]]] = [
        ("What this is, and how far it is", [*purpose(), *progress(reproduction)]),
        (
            "The verdicts at a glance",
            [
                *at_a_glance(claims, reproduction.is_quick),
                claims_table("The paper's claims", claims, drawn),
            ],
        ),
        ("Every claim in full", every_claim(claims, drawn)),
        ("Figures", pictures(figures, both)),
        ("Methods beside their twins, and rules", beside_twins(reproduction.methods)),
        ("What this project's own methods add", what_is_added(reproduction.methods)),
        (
            "Questions that the paper leaves open",
            [
                claims_table("Questions, by the same rules", questions, drawn),
                *every_claim(questions, drawn),
            ],
        ),
        (
            "Choices that the paper leaves open",
            sensitivities(reproduction.sensitivities),
        ),
        ("The trigger where nothing is learned", false_alarms(reproduction.false_alarms)),
        ("What was run", what_was_run(reproduction)),
        ("Rules and margins in short", rules()),
        ("Terms", terms()),
    ]
    contents = [
        element("li", element("a", f"{number}. {heading}", href=f"#part-{number}"))
        for number, (heading, _) in enumerate(parts, 1)
    ]
    sections = [
        element(
            "section",
            element("h2", f"{number}. {heading}", id=f"part-{number}"),
            *content,
        )
        for number, (heading, content) in enumerate(parts, 1)
    ]
    return html_page(
        title,
        report_style(),
        element("header", element("h1", title)),
        element("nav", element("ul", *contents), aria_label="Contents"),
        element("main", *sections),
        with_images=True,
    )
