"""The last parts of the report: what was run, by which rules, and what words mean."""

import shlex
from collections.abc import Sequence

from orchid_uav.experiments.markup import Markup, element, harmless, table
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.checks import MARGINS, VARIANCE_RATIO, VARIANCE_RATIO_TITLE
from orchid_uav.experiments.reproduction.report.effects import code
from orchid_uav.experiments.reproduction.result import Reproduction
from orchid_uav.experiments.reproduction.trainings import TRAININGS

_RULES = (
    "The unit is the training seed: a value is the mean over topologies of one trained policy. "
    "Hovering is not trained: where a claim is about it alone, the unit is the topology.",
    "Methods share seeds and topologies, so that comparisons are paired. The interval is the 95 % "
    "BCa bootstrap interval of the mean difference; of ten seeds it covers the truth in some 90 % "
    "of samples.",
    "A margin is the greatest difference that does not matter. It was fixed before the runs.",
    "p says how often chance alone would make a difference as large (sign-flip permutation test), "
    "adjusted for the number of comparisons of the claim (Holm). Up to 0.05 a difference is shown.",
    '"Higher" and "lower": yes, if it is shown and not shown to be within the margin; no, if '
    'the opposite is shown, or that it lies within the margin. "Equal": yes, if it is shown to lie '
    'within the margin; no, if beyond it. "Not lower": yes, if it is shown to be lower by no more '
    "than the margin; no, if by more.",
    "A claim holds if all of its comparisons are yes; partly, if some are yes and some no; it does "
    "not hold, if all are no; else it is undecided.",
    "What was changed in claims and rules after the first trainings stands in the project's "
    "docs/claims.md, with the verdicts before and after.",
    'Fewer than ten pairs decide nothing. Where nothing is decided, "detectable from" says how '
    "large a difference would have been shown with a chance of 80 %, or, for what is asked about "
    "the margin, how far from the margin it would have had to be.",
)
_TERMS = {
    "blocking pair": "A user and a drone that would both rather be connected to each other.",
    "coverage": "The share of the users to be served that are.",
    "energy efficiency": "Data sent for the energy that flying takes, in Mbit per joule.",
    "episode": "One simulated flight of the fleet.",
    "hotspots (TCP)": "Users stand in clusters, as where people gather; the paper's main case.",
    "hovering (static-)": "Drones stay where they were put at first, in the middle of their users.",
    "JFI": "Jain's fairness index: 1 where all get the same, less the more unequal it is. Of the "
    "users' rates (rate JFI), or of how many users each drone serves (load JFI).",
    "MADDPG": "Another method of learning, with which the paper compares its own.",
    "MAPPO": "The method of learning that the paper's proposal uses.",
    "max-min (mmf)": "A drone shares its bandwidth so that its worst user gets as much as can be.",
    "proportional (pf)": "A drone gives each of its users the same share of bandwidth.",
    "reward": "The number that training makes as large as it can.",
    "signal-to-noise ratio (SNR)": "How much stronger a signal is than the noise, in decibels.",
    "spread evenly (uniform)": "Users stand anywhere with the same chance.",
    "twin (-zero)": "A fleet with the same start that does nothing.",
    "UAV": "Unmanned aerial vehicle: here a drone that carries a base station.",
    "utility": "The paper's weighted sum of coverage, energy efficiency and both fairness indices.",
    "worst user": "The one with the lowest rate.",
}


def what_was_run(document: Reproduction) -> list[Markup]:
    """Where the numbers come from."""
    facts = {
        "Made on": f"{document.date}, by orchid {document.versions.get('orchid_uav')}",
        "Seeds": ", ".join(map(str, document.seeds)) or "none",
        "Topologies": f"{document.topologies} in each setting",
        "Time": f"{document.hours:g} hours of one core, for all results",
        "Processors": "; ".join(document.processors) or "none",
        "Commits of the code": ", ".join(document.commits) or "none",
    }
    listed = [
        part
        for name, fact in facts.items()
        for part in (element("dt", name), element("dd", element("bdi", fact)))
    ]
    return [
        element("p", "Command of this page: ", code(_command(document.command))),
        element("dl", *listed, class_="glossary"),
        element("h3", "To repeat one of the trainings"),
        element(
            "p",
            "Each command trains one seed; the others differ in the number behind ",
            code("--seed"),
            ". Policies are flown by ",
            code("orchid eval"),
            ", rules by ",
            code("orchid eval --methods NAME"),
            ".",
        ),
        _commands(document),
    ]


def _commands(document: Reproduction) -> Markup:
    seed = document.seeds[0] if document.seeds else 0
    rows = [
        [
            element("span", code(key), id=f"train-{key}"),
            element("td", training.purpose, class_="wrapped"),
            f"{len(document.rows.get(key, []))} of {len(document.seeds)}",
            element("td", code(_command(training.command(seed))), class_="wrapped"),
        ]
        for key, training in TRAININGS.items()
    ]
    return table("Commands", ["Training", "What it is", "Seeds", "Command"], rows)


def _command(words: Sequence[str]) -> str:
    return " ".join(shlex.quote(harmless(word)) for word in words)


def rules() -> list[Markup]:
    """Rules and margins in short."""
    rows = [
        [
            VARIANCE_RATIO_TITLE if key == VARIANCE_RATIO else METRICS[key].heading,
            f"{margin if key == VARIANCE_RATIO else margin * METRICS[key].scale:g}",
        ]
        for key, margin in MARGINS.items()
    ]
    return [
        element("ul", *(element("li", rule) for rule in _RULES)),
        table("Margins of means", ["Metric", "Margin"], rows),
        element(
            "p",
            "Claims, comparisons, margins and rules stand in ",
            code("docs/claims.md"),
            ", which was committed before the runs.",
        ),
    ]


def terms() -> list[Markup]:
    """The glossary."""
    listed = [
        part
        for term, meaning in _TERMS.items()
        for part in (element("dt", term), Markup(" "), element("dd", meaning))
    ]
    return [element("dl", *listed, class_="glossary", id="terms")]
