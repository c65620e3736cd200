"""The parts of the report about methods: beside their twins, and what else was tried."""

from collections.abc import Iterable, Mapping, Sequence

from orchid_uav.envs.parameters import Distribution
from orchid_uav.experiments.ablation.result import TriggerReplay
from orchid_uav.experiments.evaluation.method_keys import RELEASED, RULE_IDEAS
from orchid_uav.experiments.markup import Markup, element, table
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction.checks import RATE, UTILITY, WORST
from orchid_uav.experiments.reproduction.report.effects import MINUS, code
from orchid_uav.experiments.reproduction.result import (
    AMONG_UNIFORM,
    SENSITIVITIES,
    TABLED,
    FlownMethod,
    Sensitivity,
)
from orchid_uav.experiments.statistics.comparison import Difference, SeedSummary

PAPERS = (
    *("orchid", "orchid-no-rf", "orchid-random-init", "orchid-long", "orchid-pf"),
    *("maddpg-mmf", "maddpg-pf", "maddpg-mmf-paper", "maddpg-pf-paper"),
)
"""What the paper trains."""
OWN = ("orchid-informed", "balanced-loiter", "balanced-loiter-120", "best-response")
"""What this project adds, beside the paper's method."""
_GAINED = (UTILITY, RATE, WORST)
_SCALES = {metric: METRICS[metric] for metric in TABLED}
_CHOICES = len(SENSITIVITIES) + len(AMONG_UNIFORM)
USERS: Mapping[Distribution, str] = {"tcp": "in hotspots", "uniform": "spread evenly"}
"""Where users stand, in words."""
_Added = tuple[FlownMethod, Mapping[str, SeedSummary], Mapping[str, Difference]]
"""A method, what it reaches, and what of that is beyond the paper's policy."""


def beside_twins(methods: Sequence[FlownMethod]) -> list[Markup]:
    """Trained methods with and without noise, and their twins; then the rules."""
    trained = [method for method in methods if method.seeds]
    papers = [method for method in trained if method.method in PAPERS]
    others = [method for method in trained if method.method not in PAPERS]
    rules = [method for method in methods if not method.seeds]
    parts = [
        element(
            "p",
            "In the paper's network: 6 drones, 100 users in hotspots that stay. A policy is a "
            "little random while it is trained, so that it tries things out; ",
            element("dfn", "without noise"),
            " it does what it holds best. Its ",
            element("dfn", "twin"),
            " starts where the policy starts and does nothing at all: what a policy gains over its "
            "twin is what it has learned. Means over seeds, ± the standard deviation between them.",
        )
    ]
    if papers:
        parts.append(_methods_table("The paper's methods, and their twins", papers))
    if rules:
        parts.append(_methods_table("Rules, for which nothing is learned", rules))
    if others:
        folded = _methods_table("Other trainings, and their twins", others)
        parts.append(element("details", element("summary", "All other trainings"), folded))
    if trained:
        parts.append(
            element("details", element("summary", "Resets and speed"), _resets_table(trained))
        )
    return parts if papers or rules or others else [_nothing()]


def _nothing() -> Markup:
    return element("p", "There are no results of this yet.")


def _methods_table(caption: str, methods: Iterable[FlownMethod]) -> Markup:
    heads = ["Method", "Flown", *(_SCALES[metric].heading for metric in TABLED)]
    rows: list[list[str]] = []
    classes = []
    for method in methods:
        kind = "without noise" if method.seeds else RULE_IDEAS.get(method.method, "as it is")
        kinds = [(kind, method.deterministic)]
        if method.sampled:
            kinds.append(("with noise", method.sampled))
        for number, (kind, summaries) in enumerate(kinds):
            rows.append([code(method.method), kind, *_summaries(summaries, method.seeds > 1)])
            classes.append("first" if number == 0 else "")
        if method.twin:
            rows.append([code(f"{method.method}-zero"), "does nothing", *_means(method.twin)])
            classes.append("")
    return element("div", table(caption, heads, rows, classes), class_="dense")


def _summaries(summaries: Mapping[str, SeedSummary], has_spread: bool) -> list[str]:
    return [_summary(metric, summaries.get(metric), has_spread) for metric in TABLED]


def _summary(metric: str, summary: SeedSummary | None, has_spread: bool) -> Markup:
    if summary is None or summary.mean is None:
        return element("td", "–")
    mean = _text(metric, summary.mean)
    if not (has_spread and summary.std):
        return element("td", mean)
    return element("td", mean, " ", element("small", f"±\u00a0{_text(metric, summary.std)}"))


def _means(means: Mapping[str, float]) -> list[str]:
    return [_text(metric, means[metric]) if metric in means else "–" for metric in TABLED]


def _text(metric: str, value: float) -> str:
    return _SCALES[metric].text(value).replace("-", MINUS)


def _resets_table(methods: Iterable[FlownMethod]) -> Markup:
    rows = []
    for method in methods:
        resets = "; ".join(
            ", ".join(map(str, episodes)) or "none" for episodes in method.reset_episodes
        )
        latency = method.actor_latency_us
        rows.append(
            [
                code(method.method),
                method.purpose,
                str(method.seeds),
                element("td", resets, class_="wrapped"),
                "–" if latency is None else f"{latency:.1f}",
            ]
        )
    heads = ["Method", "What it is", "Seeds", "Episodes of resets, seed by seed"]
    heads.append("One decision of one drone (µs)")
    return table("Resets of Reset-and-Finetune, and how fast a policy decides", heads, rows)


def what_is_added(methods: Sequence[FlownMethod]) -> list[Markup]:
    """What the project's own methods reach beyond the paper's."""
    by_key = {method.method: method for method in methods}
    paper = by_key.get("orchid")
    own = [by_key[key] for key in OWN if key in by_key]
    if paper is None or not own:
        return [_nothing()]
    shown = [paper, *own]
    staying = [(one, one.deterministic, one.beside_orchid) for one in shown]
    walking = [(one, one.walking, one.walking_beside_orchid) for one in shown if one.walking]
    walked = "Where users walk at 5 to 15 m/s and hold their headings for 20 s, flown without noise"
    return [
        element(
            "p",
            "Beyond the paper, this project trains a policy that is told what a drone in flight "
            "can know, and flies rules that need no training. ",
            element("dfn", "Utility"),
            " is the paper's own sum of what should be good. Differences are paired by training "
            "seed, with their 95\u00a0% intervals, and without a verdict.",
        ),
        _added_table("In the paper's network, flown without noise", staying),
        *([_added_table(walked, walking)] if len(walking) > 1 else []),
    ]


def _added_table(caption: str, shown: Sequence[_Added]) -> Markup:
    heads = ["Method", "What it is"]
    for metric in _GAINED:
        heads += [_SCALES[metric].heading, "beside the paper's"]
    rows = [
        [code(method.method), _idea(method.method), *_beside(reached, beside)]
        for method, reached, beside in shown
    ]
    return table(caption, heads, rows)


def _idea(key: str) -> Markup:
    return element("td", (RELEASED | RULE_IDEAS)[key], class_="wrapped")


def _beside(reached: Mapping[str, SeedSummary], beside: Mapping[str, Difference]) -> list[str]:
    cells = []
    for metric in _GAINED:
        summary = reached.get(metric)
        mean = None if summary is None else summary.mean
        cells.append("–" if mean is None else _text(metric, mean))
        cells.append(difference_text(metric, beside.get(metric)))
    return cells


def difference_text(metric: str, difference: Difference | None) -> str:
    """A mean difference with its interval, where there is one."""
    if difference is None or difference.mean is None:
        return "–"
    text = signed(metric, difference.mean)
    if difference.ci95 is None:
        return text
    return f"{text} [{' to '.join(signed(metric, end) for end in difference.ci95)}]"


def signed(metric: str, value: float) -> str:
    """A difference as it is shown, with its sign."""
    text = _text(metric, value)
    return f"+{text}" if value > 0.0 and float(text) else text


def sensitivities(found: Sequence[Sensitivity]) -> list[Markup]:
    """What other choices change where the paper leaves one open."""
    if not found:
        return [_nothing()]
    heads = ["Training", "What differs", "Flown among users", "It gains", "orchid gains"]
    heads += ["Difference [95 % interval]", "Pairs"]
    rows = [
        [
            code(one.method),
            element("td", one.purpose, class_="wrapped"),
            USERS[one.users],
            _gained(one.gained),
            _gained(one.gained_by_orchid),
            difference_text(UTILITY, one.difference.difference),
            f"{one.difference.n} of {one.difference.seeds}",
        ]
        for one in found
    ]
    return [
        element(
            "p",
            "Where the paper leaves a choice open, or states two values, other ones were trained "
            "as well. Shown is the utility that a policy gains over its own twin.",
        ),
        table(f"{len(found)} of {_CHOICES} flights of other choices", heads, rows),
    ]


def _gained(summary: SeedSummary) -> Markup:
    if summary.mean is None:
        return element("td", "–")
    spread = f"±\u00a0{_text(UTILITY, summary.std)}" if summary.std else ""
    return element("td", signed(UTILITY, summary.mean), " ", element("small", spread))


def false_alarms(found: Sequence[TriggerReplay]) -> list[Markup]:
    """How often the trigger fires where nothing is learned."""
    if not found:
        return [_nothing()]
    windows = sorted({one.window for one in found})
    tolerances = sorted({one.tolerance for one in found})
    cells = {(one.window, one.tolerance): one for one in found}
    heads = ["Window (episodes)", *(f"tolerance {tolerance:g}" for tolerance in tolerances)]
    rows = [
        [str(window), *(_alarm(cells.get((window, tolerance))) for tolerance in tolerances)]
        for window in windows
    ]
    return [
        element(
            "p",
            element("dfn", "Reset-and-Finetune"),
            " is the paper's remedy for training that stands still: when neither "
            "fairness nor reward changes by more than a tolerance from one window of episodes to "
            "the next, it forgets the momentum "
            "of learning and learns in smaller steps. Here nothing was learned at all, so that "
            "every firing is due to chance and to the places that happened to be drawn.",
        ),
        table("Runs that learn nothing in which the trigger fires", heads, rows),
    ]


def _alarm(one: TriggerReplay | None) -> Markup:
    if one is None or not one.runs:
        return element("td", "–")
    fired = f"{one.fired} of {one.runs}"
    if one.median_episode is None:
        return element("td", fired)
    when = element("small", f"(episode\u00a0{one.median_episode:g})")
    return element("td", fired, " ", when)
