"""The figures, as parts of the page."""

import base64
from collections.abc import Sequence

from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.reproduction.figures.drawn import DrawnFigure
from orchid_uav.experiments.reproduction.report.effects import badge, separated
from orchid_uav.experiments.reproduction.result import JudgedClaim
from orchid_uav.experiments.reproduction.verdicts import Verdict


def by_number(figures: Sequence[DrawnFigure]) -> dict[str, list[DrawnFigure]]:
    """Our figures by the paper's, such as "fig4"."""
    found: dict[str, list[DrawnFigure]] = {}
    for figure in figures:
        found.setdefault(figure.key.partition("_")[0], []).append(figure)
    return found


def pictures(figures: Sequence[DrawnFigure], claims: Sequence[JudgedClaim]) -> list[Markup]:
    """All figures with their text alternatives, and the claims that are about them.

    Raises:
        OSError: a file cannot be read.
    """
    if not figures:
        return [element("p", "There are no results yet from which a figure could be drawn.")]
    return [_picture(figure, claims) for figure in figures]


def _picture(figure: DrawnFigure, claims: Sequence[JudgedClaim]) -> Markup:
    number = figure.key.partition("_")[0]
    own = [
        element(
            "span",
            element("a", claim.key.upper(), href=f"#{claim.key}"),
            " ",
            badge(_verdict(figure.key, claim)),
        )
        for claim in claims
        if claim.figure == number
    ]
    image = base64.b64encode(figure.path.read_bytes()).decode()
    source = Markup(f"data:image/svg+xml;base64,{image}")
    parts = [
        element("h3", figure.title),
        element(
            "div",
            element("img", src=source, alt=figure.alternative),
            class_="picture",
            role="region",
            aria_label=figure.title,
            tabindex=0,
        ),
        element("figcaption", figure.caption),
        element("details", element("summary", "In words"), element("p", figure.alternative)),
    ]
    if own:
        parts.append(element("p", "What it says about the claims: ", separated(own)))
    return element("figure", *parts, id=figure.key)


def _verdict(key: str, claim: JudgedClaim) -> Verdict | None:
    """The verdict for the users that a figure is about."""
    judged = claim.uniform if "_uniform" in key else claim.tcp
    return (judged or claim.tcp).verdict
