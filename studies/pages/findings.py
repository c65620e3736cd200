"""What the results say in six points, and the examples, as blocks of pages."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial

from orchid_uav.envs.parameters import DeploymentParameters
from orchid_uav.experiments.metrics import HEADROOM
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import EFFICIENCY, MADDPG, MARGINS, UTILITY
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.report.effects import interval_text, mean_text
from orchid_uav.experiments.statistics.comparison import ALPHA, describe_differences
from orchid_uav.experiments.statistics.results import EvaluationResult
from studies.pages.flying import BOUND, LEARNED, RULE, TWIN, case_of, cases
from studies.pages.guards import must_hold
from studies.pages.markdown import ROOT
from studies.pages.results import question_of, rows_read
from studies.recording import read, read_evaluation

WIDTH = 104
_LANGUAGES = {".toml": "toml", ".py": "python"}


SEARCHED = ("orchid-tuned", *MADDPG)


def findings_block() -> str:
    """The six findings: numbers come from the results, and words that do not fit them fail."""
    results = read_evaluation("methods").results
    flown = {(result.method, result.deterministic): result for result in results}
    points = (
        _learning(),
        _noise(),
        _rules(flown),
        _flying(),
        _reset(),
        _validation(),
    )
    lines = [
        textwrap.fill(f"{number}. {point}", WIDTH, subsequent_indent="   ", break_on_hyphens=False)
        for number, point in enumerate(points, 1)
    ]
    return "\n".join(lines)


def _learning() -> str:
    question = question_of("q1")
    utility, *others = question.tcp.checks
    assert question.uniform is not None
    evenly = question.uniform.checks
    must_hold({one.finding for one in (utility, *others)} == {"no"}, "it is worse than its twin")
    must_hold(all(one.is_within_margin for one in evenly), "evenly spread it is about as good")
    evidence, base = Evidence(rows_read()), [settings.base("tcp")]
    gains = {key: evidence.gained(key, UTILITY, base) for key in ("orchid", *SEARCHED)}
    searched = [float(gains[key].mean()) for key in SEARCHED]
    must_hold(max(map(abs, searched)) < MARGINS[UTILITY], "the search ends near doing nothing")
    seeds, above = utility.n, int((gains["orchid"] > 0.0).sum())
    must_hold(above == 0, "no seed is above its twin")
    return (
        "**Trained as the paper says, policies are worse than doing nothing.** *Utility*, the "
        "paper's objective, is a weighted sum of coverage (the share of the drones' people who are "
        "served), energy efficiency and two indices of fairness. Flown without the random noise of "
        f"their training, policies of the paper's method, `orchid`, reach {utility.one:.3f} in the "
        f"mean of {_word(seeds)} trainings with different random numbers (*seeds*); their "
        "*zero-action twin*, which starts at the same places and stays there, reaches "
        f"{utility.other:.3f}. None of the {_word(seeds)} is above it. Where people are spread "
        f"evenly it makes hardly a difference ({evenly[0].difference:+.3f}). With the best recipes "
        "of a search, which are the most cautious ones, policies of this method and of MADDPG, "
        f"with which the paper compares it, end in the mean of {_word(seeds)} trainings within "
        f"{math.ceil(max(map(abs, searched)) * 1000) / 1000:.3f} of their twins. "
        "[Results](docs/results.md#what-training-is-worth)"
    )


def _noise() -> str:
    evidence, base = Evidence(rows_read()), [settings.base("tcp")]
    thrust = f"thrust_{EFFICIENCY}"
    sampled, alone = (
        evidence.flown(key, EFFICIENCY, base, deterministic=False) / 1e6
        for key in ("orchid", "orchid-frozen")
    )
    still, without = (
        float(evidence.flown(key, EFFICIENCY, base).mean()) / 1e6
        for key in ("static-mmf", "orchid")
    )
    paid = float(evidence.flown("orchid", thrust, base, deterministic=False).mean()) / 1e6
    beyond = describe_differences(sampled - alone).ci95
    must_hold(beyond[0] < 0.0 < beyond[1], "the policy is not shown to add to the noise")
    must_hold(max(without, paid) < still, "without noise, or with thrust counted, hovering wins")
    return (
        "**The energy efficiency seen in training comes from its noise.** With that noise "
        f"`orchid` reaches {sampled.mean():.2f} megabits per joule, and untrained policies with "
        f"the same noise {alone.mean():.2f}; no difference is shown between them, in "
        f"{_word(len(sampled))} trainings each. Without noise it reaches {without:.2f}, and "
        f"hovering {still:.2f}. Noise keeps drones moving, a rotor needs half the power at 12 to "
        "15 m/s that it needs to hover, and the paper's formula charges nothing for changes of "
        f"speed. Once the power for these changes is counted, {paid:.2f} is left. "
        "[Metrics](docs/evaluation.md#metrics)"
    )


def _rules(flown: Mapping[tuple[str, bool], EvaluationResult]) -> str:
    names = ("static-mmf", "loiter-mmf", "balanced-loiter", "planner")
    static, loiter, balanced, planner = (
        flown[name, True].metrics["utility"].mean for name in names
    )
    must_hold(static < loiter < balanced < planner, "each rule is better than the one before")
    groupings = 1 + DeploymentParameters().balanced_restarts
    share = flown["balanced-loiter", True].metrics[HEADROOM].mean
    mobility = read_evaluation("mobility").results
    speeds = {result.speed_mps for result in mobility}
    leads = [
        _mobile(mobility, "balanced-loiter", speed) - _mobile(mobility, "orchid", speed)
        for speed in (min(speeds), max(speeds))
    ]
    must_hold(leads[0] > leads[1] > 0.0, "the lead is smaller where people walk")
    return (
        "**Simple rules do better.** Circling the start instead of hovering there lifts the "
        f"utility from {static:.3f} to {loiter:.3f}. Circling the best of {groupings} ways to "
        f"group the people reaches {balanced:.3f}. That is {share:.0%} of the *headroom*, the "
        "distance from circling the start to a planner that knows every radio link "
        f"({planner:.3f}). Where people walk, this rule's lead over `orchid` is smaller. "
        "[Methods](docs/methods.md#rules), [moving users](docs/evaluation.md#moving-users)"
    )


def _flying() -> str:
    """What moves stations, and what is learned on them."""
    slowest, fastest = (case_of("speed", speed)["methods"] for speed in (0.0, 15.0))
    (late,) = (
        case
        for case in cases("knowledge")
        if case["setting"]["sensing.flight_error_std_m"] and case["setting"]["sensing.delay_s"]
    )
    less = [late["learned_less"][LEARNED][rule]["utility"] for rule in (RULE, BOUND)]
    must_hold(all(one["ci95"][0] > 0.0 for one in less), "learning wins where knowledge is bad")
    learned = [
        methods[LEARNED]["utility"] - methods[RULE]["utility"] for methods in (slowest, fastest)
    ]
    must_hold(
        0.0 < min(learned) < max(learned) < 0.002, "the learned policy is as good as the rule"
    )
    setting = late["setting"]
    seeds = len(read("flying")["settings"]["training_seeds"][LEARNED])
    return (
        "**Learning earns its place where knowledge is wrong or old.** If an action moves the "
        "place that a drone circles, the rule *best response*, by which each drone improves its "
        f"neighbourhood, reaches {slowest[RULE]['utility']:.3f} where people stand, and "
        f"{fastest[RULE]['utility']:.3f} where they walk at up to 15 m/s; its zero-action twin "
        f"{fastest[TWIN]['utility']:.3f}. A policy that learned from it is as good, and where "
        f"people's positions are {setting['sensing.flight_error_std_m']:g} m off and "
        f"{setting['sensing.delay_s']:g} s old, better by {less[0]['mean']:.3f} in the "
        f"mean of {seeds} trainings, and by {less[1]['mean']:.3f} than a central search every five "
        "seconds. "
        "[What flies well](docs/flying.md)"
    )


def _mobile(results: Sequence[EvaluationResult], method: str, speed_mps: float) -> float:
    """Utility where users walk at up to that speed and hold their headings longest."""
    found = [one for one in results if (one.method, one.speed_mps) == (method, speed_mps)]
    longest = max(found, key=lambda result: result.heading_hold_s)
    return float(longest.metrics["utility"].mean)


def _reset() -> str:
    utility, *_ = question_of("q2").tcp.checks
    controls = question_of("q3").tcp.checks
    must_hold(utility.finding == "undecided", "an effect on the utility is not shown")
    must_hold(
        [one.is_within_margin for one in controls] == [False, False, True, True],
        "a random time and a linear decay are as good",
    )
    learned, with_reset = (question_of(key).tcp.checks for key in ("q4", "q5"))
    must_hold({one.finding for one in learned} == {"yes"}, "learning does better than nothing")
    must_hold(
        all(
            one.is_within_margin and (one.difference or 0.0) > 0.0 and (one.p_holm or 1.0) <= ALPHA
            for one in with_reset
        ),
        "a gain is shown, and it is within the margins",
    )
    return (
        "**That Reset-and-Finetune makes the paper's policy better is not shown.** With it, less "
        f"without it, the utility is {mean_text(utility)} {interval_text(utility)} over "
        f"{_word(utility.n)} seeds. Learning rates that fall linearly, without any reset, lose "
        "nothing that counts, and, narrowly, neither does the same reset at a random episode. "
        "Among people who walk, and where "
        f"the method learns to do better than nothing ({mean_text(learned[0])}; actions move the "
        "place that a drone circles, and drones know how loaded their neighbours are), a gain is "
        f"shown, and it is small: {mean_text(with_reset[0])}. "
        "[Results](docs/results.md#where-learning-moves-something), [ablation](docs/ablation.md)"
    )


def _validation() -> str:
    verdicts = {
        (pair["compared"], pair["reference"]): pair["verdict"]
        for pair in read("validation")["comparison"]["pairs"]
    }
    must_hold(verdicts["orchid mappo", "benchmarl mappo"] == "equivalent", "MAPPO is equivalent")
    must_hold(
        verdicts["orchid maddpg", "benchmarl maddpg"] not in ("lower", "worse"),
        "no lower reward is shown for MADDPG",
    )
    return (
        "**A faulty learner is hardly the cause.** On a public task (`simple_spread` of the "
        "collection MPE2) this project's MAPPO collects as much reward as that of BenchMARL, a "
        "public library, within a margin that was set before. No lower reward is shown for its "
        "MADDPG. Given the same data, both compute the same numbers as BenchMARL's. "
        "[Beside public implementations](docs/validation.md)"
    )


def _word(count: int) -> str:
    return {5: "five", 6: "six", 10: "ten"}.get(count, str(count))


def example_block(name: str) -> str:
    """A file of ``examples/``, unchanged."""
    path = ROOT / "examples" / name
    return f"```{_LANGUAGES[path.suffix]}\n{path.read_text(encoding='utf-8').rstrip()}\n```"


FINDING_BLOCKS = {
    "findings": (ROOT / "README.md", findings_block),
    "lab.toml": (ROOT / "docs" / "quickstart.md", lambda: example_block("lab.toml")),
    "read_evaluation.py": (
        ROOT / "docs" / "quickstart.md",
        lambda: example_block("read_evaluation.py"),
    ),
    "reset_any_model.py": (
        ROOT / "docs" / "reset_and_finetune.md",
        lambda: example_block("reset_any_model.py"),
    ),
    **{
        name: (ROOT / "docs" / "extending.md", partial(example_block, name))
        for name in (
            f"extending/{path.name}" for path in sorted((ROOT / "examples/extending").glob("*.py"))
        )
    },
}
