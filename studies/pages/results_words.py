"""What the committed rows say, in words, for docs/results.md; each sentence once it is measured."""

import functools
import statistics
import tomllib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from orchid_uav.experiments.ablation.result import TriggerReplay
from orchid_uav.experiments.configuration import RunConfig
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import (
    EFFICIENCY,
    LOAD,
    MARGINS,
    NEAREST,
    PAIRS,
    RATE,
    STATIC,
    STATIC_MMF,
    UTILITY,
    VARIANCE_RATIO,
    WORST,
    beside,
)
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.needs import needed_for
from orchid_uav.experiments.reproduction.report.effects import interval_text, mean_text
from orchid_uav.experiments.reproduction.report.methods import difference_text, signed
from orchid_uav.experiments.reproduction.result import JudgedClaim
from orchid_uav.experiments.reproduction.verdicts import Judgement, judge_checks
from orchid_uav.experiments.statistics.comparison import ALPHA, Difference, describe_differences
from studies.movements import FOLDER
from studies.pages.guards import must_hold
from studies.pages.markdown import recorded, table
from studies.pages.results import PAGE, is_measured, result, rows_read
from studies.recording import ROOT, read

_EARLIER = "earlier_controls"
"""Movements of two policies of an earlier study, trained again."""


class Sentence(NamedTuple):
    """What is said of a claim."""

    findings: Sequence[str]
    """Of its comparisons among users in hotspots, for which it was written."""
    text: str
    """With places for differences; see ``results_words.toml``."""
    uniform: Sequence[str] = ()
    """Of those among uniform users; none where it does not speak of them."""


def sentences() -> Mapping[str, Mapping[str, Sentence]]:
    """Headings with claims and what is said of each."""
    document = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    return {
        heading: {key: Sentence(**said) for key, said in claims.items()}
        for heading, claims in document.items()
    }


def words_block() -> str:
    """A sentence for every claim that is measured and has one."""
    found = {claim.key: claim for claim in (*result().questions, *result().claims)}
    parts = []
    for heading, said in sentences().items():
        told = [told_of(found[key], one) for key, one in said.items() if is_measured(found[key])]
        if told:
            parts += [f"### {heading}", "\n".join(told)]
    return "\n\n".join(parts)


def told_of(claim: JudgedClaim, sentence: Sentence) -> str:
    """The sentence of a claim with its numbers.

    Raises:
        ValueError: the claim is measured, and its findings are not those of the sentence.
    """
    for written, judged in ((sentence.findings, claim.tcp), (sentence.uniform, claim.uniform)):
        found = [_found(check) for check in judged.checks] if judged else []
        if written and is_measured(claim) and found != list(written):
            raise ValueError(f"{claim.key}: written for {written}, and found are {found}")
    told = " ".join(sentence.text.split()).format(
        *map(_difference, claim.tcp.checks),
        uniform=[_difference(check) for check in claim.uniform.checks] if claim.uniform else [],
        hovering=_by_sharing(),
        also=_also(),
        distance_margin_m=MARGINS[NEAREST],
        utility_margin=MARGINS[UTILITY],
        variance_margin=MARGINS[VARIANCE_RATIO],
    )
    return f"* {told} ({claim.key.upper()})"


def _found(check: Judgement) -> str:
    """Its finding; of a "no" by a difference within the margin, also on which side it is shown."""
    if check.finding != "no" or not check.is_within_margin:
        return check.finding
    if check.p_holm is None or check.p_holm > ALPHA:
        return "within"
    return "above, within" if (check.difference or 0.0) > 0.0 else "below, within"


@functools.cache
def _by_sharing() -> Mapping[str, str]:
    """What max-min shares change beside proportional ones, where all UAVs hover."""
    checks = [
        beside(STATIC_MMF, "higher", STATIC, key, [settings.base("tcp")])
        for key in (RATE, WORST, EFFICIENCY)
    ]
    judged = judge_checks(checks, Evidence(rows_read()))
    return {check.metric: mean_text(check) for check in judged}


@functools.cache
def _also() -> Mapping[str, str]:
    """Differences beside those of the claims, by what they are called in the sentences."""
    evidence, base = Evidence(rows_read()), [settings.base("tcp")]
    walking = settings.walking_held("tcp")
    fastest = walking[-1:]
    learned, alone = (
        evidence.flown(key, EFFICIENCY, base, deterministic=False)
        for key in ("orchid", "orchid-frozen")
    )
    found = {
        "noise": (EFFICIENCY, learned - alone),
        "best_response": (
            UTILITY,
            evidence.flown("orchid-informed", UTILITY, walking)
            - evidence.flown("best-response", UTILITY, walking),
        ),
        "pairs_walking": (PAIRS, evidence.gained("orchid-informed", PAIRS, walking)),
        "pairs_staying": (PAIRS, evidence.gained("orchid-informed", PAIRS, base)),
    }
    told = {}
    for name, (metric, values) in found.items():
        difference = describe_differences(values)
        must_hold(_SIDES[name](difference), f"{name} is on the side that the sentence says")
        told[name] = difference_text(metric, difference)
    for name, metric in (("twin_rate", RATE), ("twin_load", LOAD)):
        fast, still = (evidence.flown("orchid-zero", metric, one)[0] for one in (fastest, base))
        must_hold(fast > still, "the twin's fairness does not fall either")
        told[name] = signed(metric, fast - still)
    return told


_SIDES: Mapping[str, Callable[[Difference], bool]] = {
    "noise": lambda one: one.ci95[0] < 0.0 < one.ci95[1],
    "best_response": lambda one: one.ci95[1] < 0.0,
    "pairs_walking": lambda one: one.ci95[1] < 0.0,
    "pairs_staying": lambda one: one.ci95[0] > 0.0,
}
"""What the sentences say of these differences."""


def _difference(check: Judgement) -> str:
    return " ".join(filter(None, (mean_text(check), interval_text(check))))


def movements_block() -> str:
    """How trained policies move without noise."""
    paths = sorted(path for path in FOLDER.glob("*.json") if path.stem != _EARLIER)
    documents = {path: read(f"movements/{path.stem}") for path in paths}
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


def to_and_fro_block() -> str:
    """The policies that did learn to move, trained again."""
    document = read(f"movements/{_EARLIER}")
    slow, shuttling = sorted(document["runs"], key=lambda one: one["to_and_fro"])
    hovering = Evidence(rows_read()).flown("static-mmf", EFFICIENCY, [settings.base("tcp")])[0]
    thrust = f"thrust_{EFFICIENCY}"
    must_hold(slow["to_and_fro"] == 0.0 and slow["straightness"] > 0.99, "one drifts")
    must_hold(shuttling["to_and_fro"] > 0.9, "the other flies to and fro")
    must_hold(shuttling[thrust] < hovering < shuttling[EFFICIENCY], "which thrust takes away")
    keys = (EFFICIENCY, thrust, UTILITY, "propulsion_power_w")
    rows = [
        [
            str(one["seed"]),
            *(METRICS[key].text(one[key]) for key in keys),
            *(f"{one[key]:.2f}" for key in ("speed_mps", "straightness", "to_and_fro")),
        ]
        for one in document["runs"]
    ]
    heads = ["seed", *(METRICS[key].heading for key in keys)]
    heads += ["speed (m/s)", "straightness", "to and fro"]
    return (
        f"{table(heads, rows)}\n\n"
        f"Hovering's energy efficiency is {METRICS[EFFICIENCY].text(hovering)} Mbit/J. *To and "
        "fro* is the share of UAVs that turn back in every slot.\n\n"
        f"{recorded(document)}, `{document['command']}` → "
        f"`studies/results/movements/{_EARLIER}.json`."
    )


def _mean(rows: list[dict[str, float]], key: str) -> float:
    return statistics.fmean(row[key] for row in rows)


def trigger_block() -> str:
    """How often Reset-and-Finetune's trigger fires on a policy that learns nothing."""
    found = {(one.window, one.tolerance): one for one in result().false_alarms}
    reset = RunConfig().reset
    own = found[reset.window, reset.tolerance_jfi]
    resets = [
        row.reset_episodes[0]
        for row in rows_read()
        if row.method == "orchid" and row.reset_episodes
    ]
    told = (
        f"With the paper's window of {own.window} episodes and tolerance of {own.tolerance:g}, it "
        f"fires in {own.fired} of {own.runs} trainings\nwhose learning rates are 0, at episode "
        f"{own.median_episode:g} in the median; {2 * own.window} is the first at which it can. In "
        f"{len(resets)} trainings of `orchid`,\nwhich learn, it fires at episode "
        f"{statistics.median(resets):g} in the median. Runs of a policy that learns nothing in "
        "which it\nfires, and the median episode:"
    )
    windows, tolerances = (sorted({key[place] for key in found}) for place in (0, 1))
    rows = [
        [f"{window} episodes", *(_fired(found[window, tolerance]) for tolerance in tolerances)]
        for window in windows
    ]
    heads = ["window", *(f"tolerance {tolerance:g}" for tolerance in tolerances)]
    return f"{told}\n\n{table(heads, rows)}"


def _fired(one: TriggerReplay) -> str:
    at = f", at {one.median_episode:g}" if one.median_episode is not None else ""
    return f"{one.fired} of {one.runs}{at}"


def waiting_block() -> str:
    """What is missing for the claims that are not decided."""
    found = result()
    waiting = [claim for claim in (*found.claims, *found.questions) if not is_measured(claim)]
    if not waiting:
        return "Every claim has all of its seeds."
    rows = [[claim.key.upper(), claim.says, _missing(claim)] for claim in waiting]
    return table(["", "claim", "rows that are missing"], rows, words=3)


def _missing(claim: JudgedClaim) -> str:
    waiting = result().waiting
    needed = sorted(needed_for([claim.key]))
    return ", ".join(f"`{method}` {waiting[method]}" for method in needed if method in waiting)


RESULTS_WORDS_BLOCKS = {
    "results in words": (PAGE, words_block),
    "results movements": (PAGE, movements_block),
    "results to and fro": (PAGE, to_and_fro_block),
    "results trigger": (PAGE, trigger_block),
    "results waiting": (PAGE, waiting_block),
}
