"""The first part of the report: what it is, and how far it is."""

from orchid_uav.experiments.markup import Markup, element, table
from orchid_uav.experiments.reproduction.report.effects import code
from orchid_uav.experiments.reproduction.result import Reproduction
from orchid_uav.experiments.reproduction.trainings import TRAININGS


def purpose() -> list[Markup]:
    """What was asked, for a reader who knows no learning."""
    return [
        element(
            "p",
            "After a disaster, drones can carry ",
            element("dfn", "base stations"),
            ": small mobile phone masts in the air. A published paper proposes ORCHID, by which "
            "such drones learn where to fly. They try things out in a simulated network, and do "
            "more of what was rewarded: that is called ",
            element("dfn", "training"),
            ". The paper says how good the result is beside other methods. This page says which of "
            "its claims an independent implementation could confirm, and which it could not.",
        ),
        element(
            "p",
            "How it was found out: each method was trained several times, each time with other "
            "random numbers, which a number called the ",
            element("dfn", "seed"),
            " begins. Then every trained method, called a ",
            element("dfn", "policy"),
            ", was flown over the same places with the same users (",
            element("dfn", "topologies"),
            "), none of which it had seen. Differences count only if they are larger than what "
            "other seeds make of them. Further terms are explained at the ",
            element("a", "end of the page", href="#terms"),
            ".",
        ),
    ]


def progress(document: Reproduction) -> list[Markup]:
    """How far it is: seeds that are there, rows that are missing."""
    trainings = [key for key in TRAININGS if key in document.asked]
    waiting = {key: document.waiting[key] for key in trainings if key in document.waiting}
    seeds = f"{document.seeds[0]} to {document.seeds[-1]}" if document.seeds else "none"
    text = (
        f"{len(trainings) - len(waiting)} of {len(trainings)} trainings have all of their "
        f"{len(document.seeds)} seeds ({seeds}); "
        f"each policy was flown over {document.topologies} topologies in every setting."
    )
    missing = (
        "Nothing is missing."
        if not document.missing
        else f"{document.missing} results are still missing: what depends on them is undecided."
    )
    parts = [element("p", text, " ", element("strong", missing))]
    if document.is_quick:
        parts.insert(
            0,
            element(
                "p",
                element("strong", "NOT EVIDENCE"),
                " This is a quick run: two seeds, short trainings, few topologies. It shows that "
                "the program works. Nothing on this page says anything about the paper.",
                class_="banner",
                role="note",
            ),
        )
    if document.status != "completed":
        parts.insert(0, element("p", f"Status: {document.status}.", class_="banner"))
    if waiting:
        rows = [
            [code(key), f"{document.asked[key] - count} of {document.asked[key]}"]
            for key, count in waiting.items()
        ]
        summary = element("summary", "Which trainings are missing")
        seeds_of = table("Trainings with fewer seeds", ["Training", "Seeds"], rows)
        parts.append(element("details", summary, seeds_of))
    return parts
