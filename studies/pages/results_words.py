"""What the committed rows say, in words, for docs/results.md; each sentence once it is measured."""

import statistics
from collections import defaultdict
from collections.abc import Mapping

from orchid_uav.experiments.reproduction.checks import MARGINS, NEAREST, VARIANCE_RATIO
from orchid_uav.experiments.reproduction.job import RULES
from orchid_uav.experiments.reproduction.needs import needed_for
from orchid_uav.experiments.reproduction.report.effects import interval_text, mean_text
from orchid_uav.experiments.reproduction.result import JudgedClaim
from orchid_uav.experiments.reproduction.trainings import SEEDS
from orchid_uav.experiments.reproduction.verdicts import Judgement
from studies.movements import FOLDER
from studies.pages.markdown import recorded, table
from studies.pages.results import PAGE, is_measured, result
from studies.recording import ROOT, read

_SAID: Mapping[str, str] = {
    "q1": "**The trained policy of the paper, flown without its noise, is worse than doing "
    "nothing.** Beside its twin: utility {0}, rate JFI {1}, worst user's rate {2}.",
    "c2": "**Its energy efficiency in training is its noise's.** While it is trained, noise moves "
    "the UAVs, and a rotor takes less power in slow flight than in hovering: {0} beside hovering "
    "in the last 50 episodes. Flown without the noise it is {1}.",
    "q2": "**That Reset-and-Finetune makes the paper's policy better is not shown**: with it, "
    "less without it, utility {0}, energy efficiency {1}, rate JFI {2}, load JFI {3}.",
    "q3": "**A linear decay of the learning rates does as well, and so does a reset at a random "
    "moment.** With Reset-and-Finetune the policy has more utility than with a reset that leaves "
    "the learning rates as they are: {0}; not surely more than where they are lowered at the "
    "plateau without a reset: {1}; and not by a margin that counts more than where the same "
    "happens at a random episode, {2}, or where they fall linearly, {3}.",
    "c4": "**Nothing is seen to fall late without Reset-and-Finetune.** From episodes 151 to 200 "
    "to the last 50, energy efficiency changes by {0} and load JFI by {3} without it, by {1} and "
    "{4} with it. At the end, with it less without it, energy efficiency {2} and load JFI {5}: "
    "both within the margins that were set before.",
    "c20": "**Training does not make the association more stable.** Blocking pairs beside those of "
    "the twin: {0} where users stay, {1} where they walk.",
    "c28": "**Phase II does not mend errors of localisation.** Where Phase I sees users 150 m off, "
    "rate JFI is {4} beside the twin, which starts at the same wrong places.",
    "c16": "**From random starts training ends worse, in reward too.** Beside starts from "
    "K-Means++, in the last 50 training episodes: reward {0}, which the paper has higher; energy "
    "efficiency {1} and load JFI {2}, lower as in the paper. Both spread more over the last 200 "
    "episodes, as in the paper: standard deviation of energy efficiency {3}, of load JFI {4}.",
    "c17": "**Max-min shares do not end as fair as proportional ones: they end fairer.** After "
    "1,000 episodes with three resets each, flown without noise: rate JFI {0}.",
    "c19": "**They raise the floor, as the paper says**: the worst user's rate {0} in the mean, "
    "and {1} at the fifth percentile of topologies.",
    "c18": "**They do not have the higher energy efficiency**: {0} beside proportional shares.",
    "c21": "**They keep the UAVs further apart, by less than counts**: {0} to the nearest UAV, "
    f"where {MARGINS[NEAREST]:g} m had been set as the least that matters.",
    "c27": "**Updates shrink by somewhat more than κ² says.** Variance of the 50 updates after the "
    "reset over that of the 50 before, as a decimal logarithm beside κ²: {0} with κ = 0.5, "
    "{1} with κ = 0.1. "
    f"A factor of two, {MARGINS[VARIANCE_RATIO]:g}, had been set as what does not matter.",
    "c24": "**Whether walking users cost hovering energy efficiency hangs on how they walk.** With "
    "new headings every second users hardly get anywhere: {0} at 15 m/s. With headings of 20 s: "
    "{1}.",
    "c15": "**Hovering's fairness is not seen to spread more as users walk.** From 0 to 15 m/s, "
    "with headings of 20 s, its rate JFI changes by {6}, and the spread of that by {7}.",
}
"""By claim; ``{2}`` is the difference of its third comparison, with the interval."""


def words_block() -> str:
    """A sentence for every claim that is measured and has one."""
    found = {claim.key: claim for claim in (*result().questions, *result().claims)}
    told = [
        f"* {text.format(*map(_difference, found[key].tcp.checks))} ({key.upper()})"
        for key, text in _SAID.items()
        if is_measured(found[key])
    ]
    return "\n".join(told)


def _difference(check: Judgement) -> str:
    return " ".join(filter(None, (mean_text(check), interval_text(check))))


def movements_block() -> str:
    """How trained policies move without noise."""
    documents = {path: read(f"movements/{path.stem}") for path in sorted(FOLDER.glob("*.json"))}
    by_method = defaultdict(list)
    for document in documents.values():
        for one in document["runs"]:
            by_method[one["method"]].append(one)
    keys = ("speed_mps", "straightness", "still", "loops", "same_direction")
    rows = [
        [
            f"`{method}`",
            str(len(own)),
            *(f"{_mean(own, key):.2f}" for key in keys),
            f"{_mean(own, 'distance_m'):.0f}",
        ]
        for method, own in by_method.items()
    ]
    heads = ["method", "seeds", "speed (m/s)", "straightness", "still", "loop"]
    [settings] = {tuple(document["settings"].items()) for document in documents.values()}
    topologies, late_slots = dict(settings)["topologies"], dict(settings)["late_slots"]
    origins = [
        f"{recorded(document)}, `{document['command']}` → `{path.relative_to(ROOT).as_posix()}`."
        for path, document in documents.items()
    ]
    return (
        f"{table([*heads, 'same direction', 'off at the end (m)'], rows)}\n\n"
        f"Means over seeds, {topologies} held-out topologies each; all but the last "
        f"column over the last {late_slots} slots.\nStraightness is the distance "
        "gained over the path flown; *still* and *loop* are shares of UAVs; *same\ndirection* is 1 "
        "where all UAVs of all topologies fly the same way, near 0 where each flies its own.\n\n"
        + "\n".join(origins)
    )


def _mean(rows: list[dict[str, float]], key: str) -> float:
    return statistics.fmean(row[key] for row in rows)


def waiting_block() -> str:
    """What is missing for the claims that are not decided."""
    found = result()
    waiting = [claim for claim in (*found.claims, *found.questions) if not is_measured(claim)]
    if not waiting:
        return "Every claim has all of its seeds."
    rows = [[claim.key.upper(), claim.says, _missing(claim)] for claim in waiting]
    return table(["", "claim", "seeds that are missing"], rows, words=3)


def _missing(claim: JudgedClaim) -> str:
    rows = result().rows
    told = []
    for method in sorted(needed_for([claim.key])):
        missing = len(SEEDS) - len(rows.get(method, []))
        if method not in RULES and missing:
            told.append(f"`{method}` {missing}")
    return ", ".join(told) or "flights of rules"


RESULTS_WORDS_BLOCKS = {
    "results in words": (PAGE, words_block),
    "results movements": (PAGE, movements_block),
    "results waiting": (PAGE, waiting_block),
}
