"""Blocks of the documentation about ablations, from the committed results."""

import statistics
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

from orchid_uav.cli.tables.ablation import KINDS, comparison_rows, signed, trigger_table
from orchid_uav.experiments.ablation.design import FLOWN, SETTLED, TRAINED
from orchid_uav.experiments.ablation.result import AblationResult
from orchid_uav.experiments.ablation.variants import BASE
from orchid_uav.experiments.configuration import RunConfig, flatten
from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.runs.directory import FINAL_EPISODES
from orchid_uav.experiments.statistics.comparison import ALPHA, SeedSummary
from orchid_uav.experiments.statistics.results import EvaluationResult
from studies.pages.guards import must_hold
from studies.pages.markdown import FIGURES, ROOT, recorded, table
from studies.recording import read_ablation

NAME, MINIBATCH = "ablation_controls", "ablation_minibatch"
WITHOUT = "no-rf"
CURVES = FIGURES / f"{NAME}.png"
_HEADS = ("metric", "difference [95 %]", "relative", "P(better)", "p (Holm)", "verdict")


def doing_nothing(document: AblationResult, deterministic: bool = True) -> float:
    """Mean utility of the base's zero-action twin, or of the exploration noise alone."""
    return next(
        result.metrics["utility"].mean
        for result in document.others
        if result.method == f"{BASE}-s0-zero" and result.deterministic is deterministic
    )


def above_doing_nothing(document: AblationResult, name: str) -> list[float]:
    """By how much the deterministic policy exceeds doing nothing, for each seed where it does."""
    zero = doing_nothing(document)
    utilities = [run.evaluation["utility"] for run in document.runs if run.variant == name]
    return sorted(utility - zero for utility in utilities if utility is not None and utility > zero)


def _better_seeds(document: AblationResult, name: str) -> str:
    """How many seeds are above doing nothing, such as "2 of 10 (by 0.009, 0.066)"."""
    gains = above_doing_nothing(document, name)
    count = sum(run.variant == name for run in document.runs)
    by = f" (by {', '.join(f'{gain:.3f}' for gain in gains)})" if gains else ""
    return f"{len(gains) or 'none'} of {count}{by}"


def _check_effects(document: AblationResult) -> None:
    """Check that Reset-and-Finetune shows a small difference in training, and none elsewhere."""
    found = {kind: document.comparisons[kind][WITHOUT] for kind in document.comparisons}
    unseen = [one.verdict for kind in ("evaluation", "sampled") for one in found[kind].values()]
    must_hold(
        set(unseen) <= {"equivalent", "no difference shown"}
        and unseen.count("equivalent") > len(unseen) / 2,
        "on unseen topologies no difference is shown, and most metrics are equivalent",
    )
    runs = document.runs
    for metric in ("reward", "rate_jfi", "load_jfi"):
        own, without = (
            [run.training[metric] for run in runs if run.variant == name]
            for name in (BASE, WITHOUT)
        )
        must_hold(
            all(lower < higher for lower, higher in zip(without, own, strict=True))
            and found["training"][metric].p_holm <= ALPHA
            and found["training"][metric].equivalence.equivalent,
            f"{metric} is lower in every seed without it, within the margin",
        )
    for metric in ("energy_efficiency_bit_per_joule", "load_jfi"):
        without, own = (document.late_changes[name][metric].ci95 for name in (WITHOUT, BASE))
        must_hold(without[0] > 0.0 and own[0] < 0.0 < own[1], "both rise; with it nothing changes")


def summary_block() -> str:
    """The results in words, which are checked against the document's numbers."""
    document = read_ablation(NAME)
    _check_effects(document)
    flown, trained = (document.comparisons[kind][WITHOUT] for kind in ("evaluation", "training"))
    low, high = flown["rate_jfi"].difference.ci95
    metrics = ("reward", "rate_jfi", "load_jfi")
    losses = ", ".join(f"{-trained[metric].relative:.1%}" for metric in metrics)
    p_value = max(trained[metric].p_holm for metric in metrics)
    late = document.late_changes[WITHOUT]
    rises = " and ".join(
        f"{METRICS[metric].title} {signed(metric, late[metric].iqm)}"
        for metric in ("energy_efficiency_bit_per_joule", "load_jfi")
    )
    zero, alone = (doing_nothing(document, deterministic) for deterministic in (True, False))
    utility = {
        (kind, name): values["utility"].iqm
        for kind in ("evaluation", "sampled")
        for name, values in document.values[kind].items()
    }
    for kind, reference in (("evaluation", zero), ("sampled", alone)):
        both = (utility[kind, BASE], utility[kind, WITHOUT])
        must_hold(max(both) < reference, "both policies are worse than doing nothing")
    firings = [run.reset_episodes[0] for run in document.runs if run.variant == BASE]
    first = min(firings)
    window = document.settings.base["reset"]["window"]
    must_hold(first == 2 * window, "fires at the first episode at which it can")
    bullets = (
        "**On unseen topologies no difference is shown**, with deterministic or sampled actions; "
        "most metrics are equivalent within the margin. The means point towards "
        "Reset-and-Finetune (rate JFI without it: "
        f"{signed('rate_jfi', flown['rate_jfi'].difference.mean)} "
        f"[{signed('rate_jfi', low)}, {signed('rate_jfi', high)}]).",
        "**In the last training episodes it helps a little, in every seed**: without it reward, "
        f"rate JFI and load JFI are lower by {losses} (adjusted p at most {p_value:.3f}), which is "
        "within the margin.",
        "**The paper's claim that energy efficiency and load JFI fall after about 200 episodes "
        "without it, and do not with it (C4), does not hold here.** Without it both rise after "
        f"episode {SETTLED[1]} ({rises}), from a lower level; with it nothing is seen to change.",
        "**Both policies are worse than doing nothing** in utility: deterministic "
        f"{utility['evaluation', BASE]:.3f} with and {utility['evaluation', 'no-rf']:.3f} without "
        f"it, {zero:.3f} without any action; sampled {utility['sampled', BASE]:.3f} and "
        f"{utility['sampled', 'no-rf']:.3f}, the noise alone {alone:.3f} (IQM of "
        "seeds). Seed by seed, deterministic policies above doing nothing are "
        f"{_better_seeds(document, BASE)} with it and {_better_seeds(document, 'no-rf')} without.",
        "**The trigger is a timer.** With the paper's window and tolerances it fires at episode "
        f"{first}, the first at which it can, in {firings.count(first)} of {len(firings)} seeds, "
        f"and by episode {max(firings)} in all.",
    )
    lines = [textwrap.fill(f"* {text}", 104, subsequent_indent="  ") for text in bullets]
    return "\n".join(["What this says, plainly:", "", *lines])


def effects_block() -> str:
    """What Reset-and-Finetune changes: the differences of the variant without it, first."""
    return _effects(NAME, WITHOUT, "with", "without")


def minibatch_block() -> str:
    """What minibatches of whole slots change, the differences slots minus rows (M34)."""
    document = read_ablation(MINIBATCH)
    (variant,) = document.settings.variants
    every = [
        one for kind in document.comparisons for one in document.comparisons[kind][variant].values()
    ]
    must_hold(
        all(one.difference.mean >= 0.0 for one in every if one.difference),
        "no metric is worse with slots, in the mean",
    )
    found = document.values["evaluation"]
    zero = doing_nothing(document)
    must_hold(
        max(found[name]["utility"].iqm for name in (BASE, variant)) < zero,
        "both are worse than doing nothing",
    )
    verdicts = [one.verdict for one in every]
    shown = {name: _seconds(document, name) for name in (BASE, variant)}
    words = (
        f"No metric is worse with slots in the mean; of {len(verdicts)} comparisons "
        f"{verdicts.count('equivalent')} are equivalent within the margin and "
        f"{verdicts.count('better')} better. Both are worse than doing nothing "
        f"({found[BASE]['utility'].iqm:.3f} and {found[variant]['utility'].iqm:.3f} against "
        f"{zero:.3f} in utility). A run takes {shown[variant]:.0f} seconds instead of "
        f"{shown[BASE]:.0f} (medians, beside other work on the machine)."
    )
    return "\n\n".join([textwrap.fill(words, 104), _effects(MINIBATCH, variant, "rows", "slots")])


def _seconds(document: AblationResult, name: str) -> float:
    return statistics.median(run.seconds for run in document.runs if run.variant == name)


def _effects(name: str, shown: str, base: str, variant: str) -> str:
    """Tables of one variant of an ablation, with names for the base and for it."""
    document = read_ablation(name)
    parts = []
    for kind, title in KINDS.items():
        rows = [
            [metric, *cells[: len(_HEADS) - 1], first, second]
            for name_of, metric, *cells, first, second, _ in comparison_rows(document, kind)
            if name_of == shown
        ]
        heads = [*_HEADS, f"{base} (IQM)", f"{variant} (IQM)"]
        parts += [f"**{title.capitalize()}**", table(heads, rows)]
    return "\n\n".join([*parts, _source(document, name)])


def controls_block() -> str:
    """Which half of Reset-and-Finetune has which effect."""
    document = read_ablation(NAME)
    rows = [
        [f"`{name}`", METRICS[metric].heading, *_control_cells(document, name, metric)]
        for name in document.comparisons["training"]
        for metric in ("reward", "rate_jfi", "load_jfi", "energy_efficiency_bit_per_joule")
    ]
    heads = ["variant", "last training episodes", "difference [95 %]", "p (Holm)", "verdict"]
    utility = [
        [f"`{name}`", *(f"{values[name]['utility'].iqm:.3f}" for values in _flown(document))]
        for name in document.values["evaluation"]
    ]
    for row, name in zip(utility, document.values["evaluation"], strict=True):
        row.append(_better_seeds(document, name))
    zero = f"deterministic seeds above doing nothing ({doing_nothing(document):.3f})"
    return "\n\n".join(
        [
            table(heads, rows, words=2),
            table(["utility, IQM of seeds", "deterministic", "sampled", zero], utility),
            _source(document),
        ]
    )


def _control_cells(document: AblationResult, name: str, metric: str) -> list[str]:
    found = document.comparisons["training"][name][metric]
    low, high = found.difference.ci95
    mean = signed(metric, found.difference.mean)
    ends = f"[{signed(metric, low)}, {signed(metric, high)}]"
    return [f"{mean} {ends}", f"{found.p_holm:.3f}", found.verdict]


def _flown(document: AblationResult) -> list[Mapping[str, Mapping[str, SeedSummary]]]:
    return [document.values[kind] for kind in ("evaluation", "sampled")]


def twins_block() -> str:
    """The policies beside their twins and the rules."""
    document = read_ablation(NAME)
    rows = []
    for name in (BASE, WITHOUT):
        for kind, suffix in (("evaluation", ""), ("sampled", ", sampled")):
            values = document.values[kind][name]
            shown = [METRICS[metric].text(values[metric].iqm) for metric in FLOWN]
            rows.append([f"`{name}`{suffix}, IQM of {values[FLOWN[0]].n} seeds", *shown])
    shown_others = _without_repetition(document.others)
    for label, result in shown_others.items():
        rows.append(
            [label, *(METRICS[metric].text(result.metrics[metric].mean) for metric in FLOWN)]
        )
    return table(["", *(METRICS[metric].heading for metric in FLOWN)], rows)


def _without_repetition(others: Sequence[EvaluationResult]) -> dict[str, EvaluationResult]:
    """One twin, the noise alone once, and the rules; all twins with one start do the same."""
    shown: dict[str, EvaluationResult] = {}
    for result in others:
        label = f"`{result.label}`"
        if result.method.endswith("-zero"):
            if not result.method.startswith(f"{BASE}-s0"):
                continue
            label = "zero action" if result.deterministic else "noise of `base`, seed 0, alone"
        shown[label] = result
    return shown


def late_block() -> str:
    """Whether metrics fall late in training (claim C4)."""
    document = read_ablation(NAME)
    rows = []
    for metric in TRAINED:
        cells = []
        for name in (BASE, WITHOUT):
            change = document.late_changes[name][metric]
            low, high = change.ci95 or (None, None)
            ends = f" [{signed(metric, low)}, {signed(metric, high)}]" if low is not None else ""
            cells.append(f"{signed(metric, change.iqm)}{ends}")
        rows.append([METRICS[metric].heading, *cells])
    first, last = SETTLED
    title = f"last {FINAL_EPISODES} episodes minus episodes {first}–{last}"
    return table([title, "with", "without"], rows)


def trigger_block() -> str:
    """When the trigger fired, and when it would have fired with other settings."""
    document = read_ablation(NAME)
    fired = [
        ", ".join(map(str, run.reset_episodes)) or "never"
        for run in document.runs
        if run.variant == BASE
    ]
    heads, rows = trigger_table(document.replayed_trigger[WITHOUT])
    return (
        f"Episodes at which it fired, by seed: {'; '.join(fired)}.\n\n"
        "Replayed on the runs without it, for other windows and tolerances, with the median of the "
        "first\nepisodes:\n\n" + table(heads, rows)
    )


def curves_block() -> str:
    """The figure."""
    document = read_ablation(NAME)
    runs = document.learning_curves[BASE][TRAINED[0]].runs
    return (
        f"![Learning curves with and without Reset-and-Finetune](figures/{CURVES.name})\n\n"
        f"Interquartile mean of {runs} seeds, each a trailing mean of 20 episodes, with 95 % "
        "bootstrap bands over seeds.\nActions are sampled, and the reward's weights change with "
        "training progress."
    )


def _source(document: AblationResult, name: str = NAME) -> str:
    hours = sum(run.seconds for run in document.runs) / 3600
    return (
        f"{recorded(document.to_json())}, `{' '.join(document.command)}`, "
        f"{hours:.1f} hours of one core; `make ablation` → `studies/results/{name}.json`."
    )


def draw_ablations() -> list[Path]:
    """Draw the learning curves from their committed points."""
    from matplotlib import style
    from matplotlib.figure import Figure

    from orchid_uav.experiments.figures.style import (
        PAGE_IN,
        STYLE,
        line_styles,
        set_ticks,
        setting_of,
    )

    document = read_ablation(NAME)
    curves = document.learning_curves
    looks = line_styles([BASE, WITHOUT])
    labels = {BASE: "with Reset-and-Finetune", WITHOUT: "without"}
    shown = [name for name in TRAINED if name != "coverage"]  # coverage is 1 throughout
    with style.context(["default", STYLE]):
        figure = Figure((PAGE_IN, 4.4), layout="constrained")
        figure.suptitle(setting_of([flatten(RunConfig(**document.settings.base))]))
        grid = figure.subplots(2, 3, sharex=True)
        for axes, name in zip(grid.flat, shown, strict=False):
            scale = METRICS[name].scale
            for turn, (group, label) in enumerate(labels.items()):
                curve, look = curves[group][name], looks[group]
                middle, low, high = (
                    [value * scale for value in values]
                    for values in (curve.iqm, curve.low, curve.high)
                )
                episodes = curve.episodes
                axes.plot(episodes, middle, label=label, markevery=(5 * turn, 10), **look)
                axes.fill_between(episodes, low, high, color=look["color"], alpha=0.2, lw=0)
            axes.set_title(METRICS[name].heading)
            set_ticks(axes.yaxis)
        for axes in grid[1, :2]:
            axes.set_xlabel("training episode")
        grid[0, 2].tick_params(labelbottom=True)
        grid[1, 2].axis("off")
        handles = grid[0, 0].get_legend_handles_labels()
        grid[1, 2].legend(*handles, loc="center")
        figure.savefig(CURVES)
    return [CURVES]


_PAGE = ROOT / "docs" / "ablation.md"
ABLATION_BLOCKS = {
    "what it says": (_PAGE, summary_block),
    "effects of reset-and-finetune": (_PAGE, effects_block),
    "late changes": (_PAGE, late_block),
    "learning curves": (_PAGE, curves_block),
    "policies and twins": (_PAGE, twins_block),
    "trigger": (_PAGE, trigger_block),
    "controls": (_PAGE, controls_block),
    "minibatches": (_PAGE, minibatch_block),
}
"""Page and content of every block, by the name in its markers."""
