"""What the results say in five points, and the examples, as blocks of pages."""

import textwrap
from collections.abc import Mapping, Sequence
from functools import partial

from orchid_uav.experiments.ablation.design import BASE
from orchid_uav.experiments.evaluation.methods import RELEASED
from orchid_uav.experiments.metrics import HEADROOM
from orchid_uav.experiments.statistics.results import EvaluationResult
from studies.pages.ablation import CONTROLS, NAME, above_doing_nothing, must_hold
from studies.pages.flying import BOUND, LEARNED, RULE, TWIN, case_of, cases
from studies.pages.markdown import ROOT
from studies.recording import read, read_ablation, read_evaluation

WIDTH = 104
_LANGUAGES = {".toml": "toml", ".py": "python"}


SEARCHED = ("orchid-tuned", "maddpg-pf", "maddpg-mmf")
ON_STATIONS = ("orchid-informed", "orchid-distilled")


def findings_block() -> str:
    """The six findings: numbers come from the results, and words that do not fit them fail."""
    results = read_evaluation("methods").results
    flown = {(result.method, result.deterministic): result for result in results}
    points = (
        _learning(flown),
        _noise(flown),
        _rules(flown),
        _flying(),
        _reset(),
        "**A faulty learner is hardly the cause.** On a public task (`simple_spread` of the "
        "collection MPE2) this project's MAPPO collects as much reward as that of BenchMARL, a "
        "public library, within a margin that was set before. No lower reward is shown for its "
        "MADDPG. Given the same data, both compute the same numbers as BenchMARL's. "
        "[Beside public implementations](docs/validation.md)",
    )
    lines = [
        textwrap.fill(f"{number}. {point}", WIDTH, subsequent_indent="   ", break_on_hyphens=False)
        for number, point in enumerate(points, 1)
    ]
    return "\n".join(lines)


def _learning(flown: Mapping[tuple[str, bool], EvaluationResult]) -> str:
    names = ("orchid", "orchid-zero")
    own, twin = (flown[name, True].metrics["utility"].mean for name in names)
    gains = {
        key: flown[key, True].metrics["utility"].mean
        - flown[f"{key}-zero", True].metrics["utility"].mean
        for key in RELEASED
    }
    of_paper = {key: gain for key, gain in gains.items() if key not in (*SEARCHED, *ON_STATIONS)}
    searched = [gains[key] for key in SEARCHED]
    above = [key for key, gain in of_paper.items() if gain > 0.0]
    must_hold(above == ["orchid-random-init"], "one policy with the paper's numbers is better")
    must_hold(max(searched) < 0.01, "the best recipes of the search hardly are")
    base = read_ablation(NAME)
    seeds = len(base.settings.seeds)
    better = [f"{gain:.3f}" for gain in above_doing_nothing(base, BASE)]
    resets = [f"{gain:.3f}" for gain in above_doing_nothing(read_ablation(CONTROLS), "reset-only")]
    must_hold((len(better), len(resets)) == (1, 2), "one seed and two of the control are better")
    return (
        "**Trained as the paper says, policies are no better than doing nothing.** *Utility*, the "
        "paper's objective, is a weighted sum of coverage (the share of the drones' people who are "
        "served), energy efficiency and two indices of fairness. The policy of the paper's method, "
        f"`orchid`, reaches {own:.3f}; its *zero-action twin*, which starts at the same places and "
        f"stays there, {twin:.3f}. Of the {_word(len(of_paper))} policies with the paper's "
        f"numbers one is above its twin, by {of_paper[above[0]]:.3f}, that which starts anywhere, "
        "when they fly without the random noise that training adds to what they do. With the best "
        "recipes of a search, which are the most cautious ones, "
        f"policies end {min(searched):+.3f} to {max(searched):+.3f} from it. "
        f"Of {_word(seeds)} trainings of `orchid` with different random numbers (*seeds*), and "
        f"minibatches of rows, one policy is above its twin, by {better[0]}. "
        f"Of {_word(seeds)} trainings that only reset the optimizer and keep its learning rates, "
        f"two are, by {' and '.join(resets)}. "
        "[Evaluation](docs/evaluation.md#all-methods), [ablation](docs/ablation.md#controls)"
    )


def _noise(flown: Mapping[tuple[str, bool], EvaluationResult]) -> str:
    name = "energy_efficiency_bit_per_joule"
    sampled, alone, still = (
        flown[key].metrics[name].mean / 1e6
        for key in (("orchid", False), ("orchid-zero", False), ("orchid-zero", True))
    )
    paid = flown["orchid", False].metrics[f"thrust_{name}"].mean / 1e6
    must_hold(sampled < alone and paid < still, "the gain is the noise's, and thrust takes it")
    return (
        "**The energy efficiency seen in training comes from its noise.** With that noise "
        f"`orchid` reaches {sampled:.2f} megabits per joule, and the noise alone, "
        f"without any policy, {alone:.2f}; hovering gives {still:.2f}. Noise keeps drones moving, "
        "a rotor needs half the power at 12 to 15 m/s that it needs to hover, and the paper's "
        "formula charges nothing for changes of speed. Once the power for these changes is "
        f"counted, {paid:.2f} is left. "
        "[Metrics](docs/evaluation.md#metrics)"
    )


def _rules(flown: Mapping[tuple[str, bool], EvaluationResult]) -> str:
    names = ("static-mmf", "loiter-mmf", "balanced-loiter", "planner")
    static, loiter, balanced, planner = (
        flown[name, True].metrics["utility"].mean for name in names
    )
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
        f"utility from {static:.3f} to {loiter:.3f}. Circling the best of 31 ways to group the "
        f"people reaches {balanced:.3f}. That is {share:.0%} of the *headroom*, the distance from "
        f"circling the start to a planner that knows every radio link ({planner:.3f}). Where "
        "people walk, this rule's lead over `orchid` is smaller. [Methods](docs/methods.md#rules), "
        "[moving users](docs/evaluation.md#moving-users)"
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
    document = read_ablation(NAME)
    losses = [
        -document.comparisons["training"]["no-rf"][metric].relative
        for metric in ("reward", "rate_jfi", "load_jfi")
    ]
    return (
        "**Reset-and-Finetune helps a little in training, and no effect is shown on unseen "
        f"topologies.** Over {_word(len(document.settings.seeds))} seeds, training without "
        f"it ends with {min(losses):.1%} to {max(losses):.1%} less reward and fairness. The "
        "controls point to the lower learning rates, not to the reset. "
        "[Ablation](docs/ablation.md)"
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
