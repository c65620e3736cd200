"""The parts of the report about claims and questions."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import get_args

from orchid_uav.experiments.markup import Markup, element, joined, table
from orchid_uav.experiments.reproduction.figures.drawn import DrawnFigure
from orchid_uav.experiments.reproduction.report.effects import (
    badge,
    code,
    counted,
    decisive,
    finding_badge,
    interval_text,
    least_text,
    mean_text,
    pairs_text,
    scale_of,
    separated,
)
from orchid_uav.experiments.reproduction.result import Judged, JudgedClaim
from orchid_uav.experiments.reproduction.trainings import TRAININGS
from orchid_uav.experiments.reproduction.verdicts import Judgement, Verdict

Figures = Mapping[str, Sequence[DrawnFigure]]
"""The figures that were drawn, by the paper's figure, such as "fig4"."""


def at_a_glance(claims: Sequence[JudgedClaim], is_quick: bool) -> list[Markup]:
    """How many claims have which verdict."""
    if is_quick:
        return [
            element(
                "p",
                "A quick run gives no verdicts: it shows that everything works, with trainings "
                "that are too short and too few to say anything about the paper.",
                class_="headline",
            )
        ]
    counts = Counter(claim.tcp.verdict for claim in claims)
    tiles = [
        element("div", element("dt", badge(verdict)), element("dd", str(counts[verdict])))
        for verdict in get_args(Verdict)
    ]
    return [
        element("dl", *tiles, class_="tiles"),
        element(
            "p",
            f"{len(claims)} claims of the paper's are judged here. They were written down with the "
            "rules that decide them before anything was trained, but for changes on record. "
            '"Undecided" means that the runs cannot tell; "partly" that some of a claim\'s '
            "comparisons agree with it and some do not.",
        ),
    ]


def claims_table(caption: str, claims: Sequence[JudgedClaim], figures: Figures) -> Markup:
    """A line for each claim, with the comparison that its verdict hangs on."""
    heads = ["", "Claim", "Verdict", "What decides", "Difference [95 % interval]", "Pairs"]
    heads.append("Figure, orchid reproduce …")
    rows = [_line(claim, figures) for claim in claims]
    return element("div", table(caption, heads, rows), class_="claims")


def _line(claim: JudgedClaim, figures: Figures) -> list[Markup]:
    key = claim.key.upper()
    verdict = [badge(claim.tcp.verdict)]
    if claim.uniform is not None:
        evenly = element("small", "spread evenly: ", badge(claim.uniform.verdict))
        verdict.append(evenly)
    check = decisive(claim.tcp)
    says = [element("span", claim.says), element("small", claim.where)]
    shown = _link(claim.figure, figures)
    cells: list[tuple[str, list[str]]] = [("Claim", [*says]), ("Verdict", [*verdict])]
    if check is None:
        cells += [("What decides", [element("span", claim.note)]), ("Difference", ["–"])]
        cells += [("Pairs", ["–"])]
    else:
        words = [
            element("span", check.what),
            element("small", f"{scale_of(check).title}{_others(claim.tcp)}"),
        ]
        least = "" if claim.tcp.verdict is None else least_text(check)
        difference = [element("span", mean_text(check))]
        interval = interval_text(check)
        difference += [element("span", interval)] if interval else []
        difference += [element("small", least)] if least else []
        cells += [("What decides", [*words]), ("Difference", [*difference])]
        cells += [("Pairs", [pairs_text(check)])]
    command = element("small", code(shlex.join(claim.command[2:])))
    cells.append(("Figure, orchid reproduce …", [shown, command]))
    return [
        element("a", key, href=f"#{claim.key}"),
        *(element("td", *content, data_label=label) for label, content in cells),
    ]


def _others(judged: Judged) -> str:
    """What all comparisons found, where there are several and findings are told."""
    if judged.verdict is None or len(judged.checks) < 2:
        return ""
    return f"; of {len(judged.checks)} comparisons: {counted(judged.checks)}"


def _link(figure: str, figures: Figures) -> Markup:
    """A link to the first of our figures for the paper's."""
    drawn = figures.get(figure, ())
    if not drawn:
        return element("span", "–")
    return element("a", f"Fig.\u00a0{figure.removeprefix('fig')}", href=f"#{drawn[0].key}")


def every_claim(claims: Sequence[JudgedClaim], figures: Figures) -> list[Markup]:
    """All comparisons of each claim, folded away."""
    return [_details(claim, figures) for claim in claims]


def _details(claim: JudgedClaim, figures: Figures) -> Markup:
    summary = element(
        "summary", element("b", claim.key.upper()), " ", badge(claim.tcp.verdict), " ", claim.says
    )
    facts: list[str] = [f"In the paper: {claim.where}."]
    if claim.note:
        facts.append(claim.note)
    parts = [element("p", " ".join(facts), id=claim.key)]
    links = [
        element("a", figure.title, href=f"#{figure.key}")
        for figure in figures.get(claim.figure, ())
    ]
    if links:
        parts.append(element("p", "Figures: ", separated(links)))
    alone = code(shlex.join(claim.command))
    parts.append(element("p", "Trains, flies and judges it alone: ", alone, "."))
    methods = _trained_methods(claim.tcp.checks)
    if methods:
        commands = [element("a", method, href=f"#train-{method}") for method in methods]
        parts.append(element("p", "Trained with the commands of: ", separated(commands)))
    key = claim.key.upper()
    for words, judged in (("users in hotspots", claim.tcp), ("users spread evenly", claim.uniform)):
        if judged is not None and judged.checks:
            parts.append(_checks(f"{key}, {words}", judged))
    return element("details", summary, *parts, class_="claim")


def _checks(caption: str, judged: Judged) -> Markup:
    heads = [
        *("Comparison", "Metric", "One", "Other", "Difference [95 % interval]", "Margin"),
        *("p", "Pairs", "Detectable from", "Found"),
    ]
    told = judged.verdict is not None
    rows = [_check(check, told) for check in judged.checks]
    return joined(
        [
            element("p", f"{caption[0].upper()}{caption[1:]}: ", badge(judged.verdict)),
            table(f"Comparisons of {caption}", heads, rows),
        ]
    )


def _check(check: Judgement, told: bool) -> list[str]:
    """A line for a comparison; a quick run does not tell what it found."""
    scale = scale_of(check)
    unit = f" ({scale.unit})" if scale.unit else ""
    p_value = "–" if check.p_holm is None else f"{check.p_holm:.3f}"
    return [
        check.what,
        f"{scale.title}{unit}",
        scale.text(check.one),
        scale.text(check.other),
        f"{mean_text(check)} {interval_text(check)}".strip(),
        scale.text(check.margin),
        "<\u00a00.001" if p_value == "0.000" else p_value,
        pairs_text(check),
        scale.text(check.least_detectable_effect),
        element("td", finding_badge(check) if told else "–"),
    ]


def _trained_methods(checks: Sequence[Judgement]) -> list[str]:
    """The methods that have to be trained for these comparisons."""
    keys = dict.fromkeys(method for check in checks for method in check.methods)
    return [key for key in keys if key in TRAININGS]
