"""Blocks of the documentation about public implementations, from the committed results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median, stdev
from typing import Any

from studies.pages.markdown import FIGURES, ROOT, recorded, table
from studies.pages.performance import spread
from studies.recording import read
from studies.simple_spread.comparison import MARGIN

NAME, SPEED = "validation", "training_speed"
CURVES = FIGURES / f"{NAME}.png"
TITLES = {
    "orchid mappo": "`MAPPO`",
    "benchmarl mappo": "BenchMARL MAPPO",
    "benchmarl mappo-gaussian": "BenchMARL MAPPO, our Gaussian",
    "benchmarl mappo-stock": "BenchMARL MAPPO, TorchRL's wrapper",
    "orchid ippo": "independent PPO (ours)",
    "orchid maddpg": "`MADDPG`",
    "benchmarl maddpg": "BenchMARL MADDPG",
    "agilerl maddpg": "AgileRL MADDPG",
    "orchid maddpg-tripled": "`MADDPG`, three times the steps",
}
RULES = {
    "random": "random actions",
    "no force": "no force",
    "assigned landmarks": "flying to assigned landmarks",
}
PANELS = {
    "PPO": ("orchid mappo", "benchmarl mappo", "benchmarl mappo-gaussian", "orchid ippo"),
    "MADDPG": ("orchid maddpg", "benchmarl maddpg", "agilerl maddpg", "orchid maddpg-tripled"),
}
_LOOKS = {
    "orchid mappo": ("#0072B2", "-"),
    "orchid maddpg": ("#0072B2", "-"),
    "benchmarl mappo": ("#D55E00", "--"),
    "benchmarl maddpg": ("#D55E00", "--"),
    "benchmarl mappo-gaussian": ("#009E73", "-."),
    "agilerl maddpg": ("#009E73", "-."),
    "orchid ippo": ("#666666", ":"),
    "orchid maddpg-tripled": ("#666666", ":"),
}
_DIGEST = 8
"""How many digits of a commit are shown."""
_LATE = 5
"""This many of a curve's last points are compared with as many before them."""
Row = Mapping[str, Any]


def final_block() -> str:
    """What every learner reached."""
    document = read(NAME)
    rows = []
    for arm, described in document["comparison"]["arms"].items():
        runs = _finished(document, arm)
        rows.append(
            [
                TITLES[arm],
                _seeds(described),
                _with_interval(described["iqm"], described["ci95"]),
                f"{described['mean']:.2f} ± {described['std']:.2f}",
                f"{document['arms'][arm]['changes']['frames']:,}",
                _late_change(runs),
                f"{median(run['training_s'] for run in runs):.0f}",
            ]
        )
    rules = [[RULES[rule], f"{value:.2f}"] for rule, value in document["baselines"].items()]
    header = (
        *("learner", "seeds", "final return, IQM [95 %]", "mean ± std", "frames", "late change"),
        "training, median s",
    )
    parts = table(header, rows), table(["rule", "return, mean of episodes"], rules)
    return "\n\n".join([*parts, _source(document)])


def pairs_block() -> str:
    """Which learners are the same at the end, and which are not."""
    return _pairs_table(read(NAME)["comparison"]["pairs"])


def pairs_of_curves_block() -> str:
    """Which learners are the same during training."""
    return _pairs_table(read(NAME)["comparison"]["pairs_of_curves"])


def _pairs_table(pairs: Sequence[Row]) -> str:
    rows = []
    for pair in pairs:
        low, high = pair["ci90"]
        rows.append(
            [
                f"{TITLES[pair['compared']]} − {TITLES[pair['reference']]}",
                f"{_signed(pair['difference'])} [{_signed(low)}, {_signed(high)}]",
                f"{pair['margin']:.2f}",
                f"{pair['least_margin']:.2f}",
                _p_value(pair["equivalence_p"]),
                _p_value(pair["p_value"]),
                pair["verdict"] or "none: too few seeds",
            ]
        )
    header = (
        *("", "difference of means [90 %]", "margin", "least margin", "p (equivalence)"),
        *("p (difference)", "verdict"),
    )
    return table(header, rows)


def curves_block() -> str:
    """The figure."""
    episodes = read(NAME)["settings"]["settings"]["curve_episodes"]
    return (
        f"![Learning curves on simple_spread](figures/{CURVES.name})\n\n"
        "Interquartile mean of the seeds, with 95 % bootstrap bands over seeds, of deterministic "
        f"policies on the\nsame {episodes} episodes at every point."
    )


def trials_block() -> str:
    """The settings that were tried on the public code before the final ones were chosen."""
    rows = []
    for trial in read(NAME)["trials"]:
        changes = ", ".join(f"{name} {value:g}" for name, value in trial["changes"].items())
        value = trial["final_return"]
        reached = f"{value:.2f}" if value is not None else f"failed: {trial['failed']}"
        rows.append([TITLES[trial["arm"]], changes, str(trial["seed"]), reached])
    return table(["learner", "settings", "seed", "final return"], rows, words=2)


def speed_block() -> str:
    """Frames per second."""
    document = read(SPEED)
    settings, spent = document["settings"], document["benchmarl_spent_s"]
    header = ("frames/s", "seconds", "least … greatest", "times ours")
    fleet, mpe2 = (
        [
            [
                TITLES.get(name, f"`{name}`" if name.startswith("orchid") else name),
                f"{document['frames_per_second'][name]:,}",
                *spread(case, 1.0, 2),
                _times_ours(document["ratios"], name),
            ]
            for name, case in document[cases].items()
        ]
        for cases in ("seconds", "spread_seconds")
    )
    return "\n\n".join(
        [
            table([f"the paper's network, {settings['episodes']} episodes", *header], fleet),
            f"BenchMARL spends {spent['collecting_s']:.1f} s on flying and "
            f"{spent['learning_s']:.1f} s on advantages and gradient steps.",
            table([f"simple_spread, {settings['spread_frames']:,} frames", *header], mpe2),
            f"Medians of {settings['repetitions']} repetitions in turns; `times ours` is the "
            f"median of the ratios of\nseconds within a round. {_source(document)}",
        ]
    )


def _times_ours(ratios: Mapping[str, float], name: str) -> str:
    return next((f"{ratios[key]:.2f}" for key in ratios if key.startswith(f"{name} / ")), "")


def summary_block() -> str:
    """The verdicts in words."""
    comparison = read(NAME)["comparison"]
    words = {
        "equivalent": "equivalent within the margin",
        "higher": "**higher**",
        "lower": "**lower**",
        "undecided": "neither shown equivalent nor different",
        None: "no verdict, there are too few seeds",
    }
    lines = []
    for pair, curve in zip(comparison["pairs"], comparison["pairs_of_curves"], strict=True):
        if not pair["control"]:
            lines.append(
                f"* {TITLES[pair['compared']]} − {TITLES[pair['reference']]}: final return "
                f"{_signed(pair['difference'])} (margin {pair['margin']:.2f}), "
                f"{words[pair['verdict']]};\n  mean of the learning curve "
                f"{_signed(curve['difference'])} (margin {curve['margin']:.2f}), "
                f"{words[curve['verdict']]}."
            )
    times = read(SPEED)["ratios"]["BenchMARL MAPPO / orchid train"]
    lines.append(
        f"* On this project's environment BenchMARL's MAPPO takes {times:.1f} times as long as "
        "`orchid train` for the same\n  frames, batch and epochs."
    )
    return "\n".join(lines)


def margin_block() -> str:
    """How the test of equivalence works, and what its margin is."""
    settings = read(NAME)["settings"]["settings"]
    return (
        f"The margin is {MARGIN:.0%} of what the reference's mean gains over random actions, set "
        "before the runs. Two one-sided\nWelch tests at 5 % show equivalence where the 90 % "
        "interval lies within the margin; `least margin` is the\nleast that these seeds would "
        "have shown. The p values are not adjusted for the number of pairs. Final returns\nare "
        f"means over the same {settings['final_episodes']} episodes for every policy, none of "
        "which a learner has seen."
    )


def versions_block() -> str:
    """The versions of the public packages."""
    arms = read(NAME)["arms"]
    return table(
        ["learner", "versions"],
        [
            [
                TITLES[arm],
                ", ".join(
                    f"{name} {version[:_DIGEST] if name == 'git_commit' else version}"
                    for name, version in arms[arm]["versions"].items()
                ),
            ]
            for arm in ("orchid mappo", "benchmarl mappo", "agilerl maddpg")
        ],
        words=2,
    )


def _finished(document: Row, arm: str) -> list[Row]:
    return [run for run in document["runs"] if run["arm"] == arm and "failed" not in run]


def _seeds(described: Row) -> str:
    failed = described["failed"]
    return f"{described['n']} ({failed} failed)" if failed else str(described["n"])


def _late_change(runs: Sequence[Row]) -> str:
    """How much the curves still rise in their last quarter."""
    changes = [
        fmean(run["curve"][-_LATE:]) - fmean(run["curve"][-2 * _LATE : -_LATE]) for run in runs
    ]
    return f"{_signed(fmean(changes))} ± {stdev(changes):.2f}"


def _with_interval(value: float, ends: Sequence[float] | None) -> str:
    return f"{value:.2f} [{ends[0]:.2f}, {ends[1]:.2f}]" if ends else f"{value:.2f}"


def _p_value(value: float) -> str:
    return f"{value:.3f}" if value >= 0.0005 else "< 0.001"


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


def _source(document: Row) -> str:
    return f"{recorded(document)}, {document['host']['cores']} cores, `{document['command']}`."


def draw_validation() -> list[Path]:
    """Draw the learning curves from their committed points."""
    from matplotlib.figure import Figure

    from orchid_uav.experiments.statistics.curves import group_curve

    document = read(NAME)
    figure = Figure((9.5, 4.8), layout="constrained")
    for axes, (title, arms) in zip(figure.subplots(1, 2), PANELS.items(), strict=True):
        for arm in arms:
            frames = document["arms"][arm]["frames"]
            runs = [
                [
                    {"episode": frame, "return": value}
                    for frame, value in zip(frames, run["curve"], strict=True)
                ]
                for run in _finished(document, arm)
            ]
            curve = group_curve(runs, "return", window=1)
            colour, line = _LOOKS[arm]
            thousands = curve.episodes / 1000
            label = f"{TITLES[arm].replace('`', '')} ({len(runs)} seeds)"
            axes.plot(thousands, curve.values, color=colour, linestyle=line, label=label)
            if curve.band is not None:
                axes.fill_between(thousands, *curve.band, color=colour, alpha=0.18, lw=0)
        axes.axhline(document["baselines"]["random"], color="#999999", lw=0.8)
        axes.annotate(
            "random actions",
            (1.0, document["baselines"]["random"]),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            xytext=(-4, 3),
            ha="right",
            fontsize=8,
            color="#777777",
        )
        axes.set_title(f"{title} on simple_spread", fontsize=10)
        axes.set_xlabel("frames (thousands)")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.13), frameon=False)
    figure.axes[0].set_ylabel("return, mean over agents")
    figure.savefig(CURVES, dpi=130)
    return [CURVES]


_PAGE = ROOT / "docs" / "validation.md"
VALIDATION_BLOCKS = {
    "validation summary": (_PAGE, summary_block),
    "final returns": (_PAGE, final_block),
    "margin": (_PAGE, margin_block),
    "pairs": (_PAGE, pairs_block),
    "pairs of curves": (_PAGE, pairs_of_curves_block),
    "versions": (_PAGE, versions_block),
    "validation curves": (_PAGE, curves_block),
    "trials": (_PAGE, trials_block),
    "training speed": (_PAGE, speed_block),
}
"""Page and content of every block, by the name in its markers."""
