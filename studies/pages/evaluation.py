"""Blocks of the documentation about evaluations, from the committed summaries."""

from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from orchid_uav.experiments.configuration import flatten
from orchid_uav.experiments.evaluation.methods import COMMANDS, RELEASED
from orchid_uav.experiments.metrics import HEADLINE, METRICS
from orchid_uav.experiments.runs.directory import read_episodes
from orchid_uav.experiments.runs.records import read_config, read_record
from orchid_uav.experiments.statistics.results import EvaluationSummary
from studies.evaluations import PLANNER_BUDGETS
from studies.pages.markdown import (
    FIGURES,
    ROOT,
    cell,
    metrics_table,
    recorded,
    source,
    table,
)
from studies.recording import read, read_evaluation

REFERENCE = ROOT / "runs" / "reference"
UAV_METRICS = ("energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi", "worst_rate_bps")
CURVES = ("reward", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi")
CURVE_WINDOW = 50


def commands_block() -> str:
    """The command that trained every released policy, and its results."""
    rows = []
    for key, arguments in COMMANDS.items():
        record = read_record(REFERENCE / key)
        resets = ", ".join(map(str, record.reset_episodes)) or "–"
        command = " ".join(["orchid train", *arguments])
        rows.append([f"`{key}`", RELEASED[key], f"`{command}`", f"{record.seconds:.0f}", resets])
    header = ["key", "what", "trained by", "seconds", "resets at episode"]
    return (
        table(header, rows, words=3)
        + "\n\n![Training curves](figures/reference_training.png)\n\n"
        + "Means over the last 50 episodes, with the noise of training in the actions and weights "
        "of the reward that\nchange with progress; without the policies on stations, whose "
        "networks are others. Seconds as recorded, two runs side by side on "
        "two busy cores."
    )


def tuning_block() -> str:
    """Both searches."""
    log = read("tuning")
    settings = log["settings"]
    zero = log["zero_action"]["utility"]
    points = [
        settings["episodes"] * (index + 1) // settings["judged"]
        for index in range(settings["judged"])
    ]
    lines = [
        f"{len(settings['values']['mappo'])} trials of each algorithm with {settings['seeds']} "
        f"seeds and "
        f"{settings['episodes']} episodes a run. The score is the utility at τ = 1 of the\n"
        f"deterministic policy on {settings['topologies']} topologies, half its mean over the "
        f"episodes {', '.join(map(str, points))}, half\nthe last of them; means over seeds. Doing "
        f"nothing scores {zero:.3f}. {recorded(log)}, `{log['command']}`.",
    ]
    for algorithm, trials in settings["values"].items():
        names = list(dict.fromkeys(name for values in trials for name in values))
        runs_of = [
            [run for run in log["runs"] if (run["algorithm"], run["trial"]) == (algorithm, number)]
            for number in range(len(trials))
        ]
        scores = [fmean(run["score"] for run in runs) for runs in runs_of]
        rows = []
        for values, runs, score in zip(trials, runs_of, scores, strict=True):
            texts = [_setting(values[name]) if name in values else "–" for name in names]
            curve = [
                fmean(run["judged"][index]["utility"] for run in runs)
                for index in range(len(points))
            ]
            least = min(run["judged"][-1]["utility"] for run in runs)
            violations = fmean(run["judged"][-1]["boundary_violations"] for run in runs)
            best = score == max(scores)
            rows.append(
                [
                    algorithm.upper(),
                    *texts,
                    f"**{score:.3f}**" if best else f"{score:.3f}",
                    " ".join(f"{utility:.3f}" for utility in curve),
                    f"{least:.3f}",
                    f"{violations:.1f}",
                ]
            )
        heads = [name.partition(".")[2] for name in names]
        rest = ["score", f"after {', '.join(map(str, points))}", "worst seed", "violations"]
        lines += ["", table(["", *heads, *rest], rows)]
    return "\n".join(lines)


def _setting(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def planner_block() -> str:
    """The planner's utility at several budgets."""
    rows = []
    for budget in PLANNER_BUDGETS:
        document = read_evaluation(f"planner_{budget}")
        found = {result.method: result for result in document.results}
        metrics = ("utility", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi")
        shown = [cell(found["planner"], metric) for metric in metrics]
        rows.append([f"{budget:,}", *shown, cell(found["planner"], "worst_rate_bps")])
    header = ["plans judged", "utility", "EE, Mbit/J", "rate JFI", "load JFI", "worst, Mbit/s"]
    wins = read_evaluation("methods").planner_wins
    own = [key for key in wins if not key.endswith("-retargeted")]
    least = min(own, key=lambda key: wins[key])
    count = "all" if wins[least] == 1.0 else f"at least {wins[least]:.0%} of the"
    return (
        f"{table(header, rows)}\n\n100 topologies, 6 UAVs. {source('planner_N', document)}\n"
        f"With the default budget it has the higher utility on {count} topologies against every "
        "other method with the same task."
    )


def methods_block() -> str:
    """The table of all methods, and the metrics that have no room in it."""
    document = read_evaluation("methods")
    others = [metric for metric in METRICS if metric not in (*HEADLINE, "backhaul_violations")]
    return "\n\n".join(
        [
            "6 UAVs, 100 users that stay, 100 topologies; mean ± standard deviation.",
            metrics_table(document.results, HEADLINE),
            "The other metrics, means (no backhaul is ever weak at Table I):",
            metrics_table(document.results, others, spread=False),
            source("methods", document),
        ]
    )


def uav_tables(document: EvaluationSummary, metrics: Sequence[str]) -> list[str]:
    """Methods by numbers of UAVs, one table for each metric."""
    counts = document.settings.uavs
    methods = [entry.method for entry in document.settings.methods]
    found = {(result.method, result.uavs): result for result in document.results}
    return [
        table(
            [METRICS[metric].heading, *(f"{count} UAVs" for count in counts)],
            [
                [f"`{method}`", *(cell(found[method, count], metric) for count in counts)]
                for method in methods
            ],
        )
        for metric in metrics
    ]


def uav_block() -> str:
    """The study over numbers of UAVs."""
    document = read_evaluation("uavs")
    parts = ["100 topologies for each number of UAVs, 100 users; policies trained with 6."]
    tables = uav_tables(document, UAV_METRICS)
    for metric, values in zip(UAV_METRICS, tables, strict=True):
        picture = f"![{METRICS[metric].title} over the number of UAVs](figures/uavs_{metric}.png)"
        parts += [picture, values]
    return "\n\n".join([*parts, source("uavs", document)])


def shared_bandwidth_block() -> str:
    """The study over numbers of UAVs, with a fixed total bandwidth."""
    document = read_evaluation("uavs_60mhz")
    tables = uav_tables(document, ("energy_efficiency_bit_per_joule", "worst_rate_bps"))
    return "\n\n".join([*tables, source("uavs_60mhz", document)])


def restarts_block() -> str:
    """Phase I as the best of ten K-Means runs by the sum of squares."""
    document = read_evaluation("n_init_10")
    parts = ["Phase I as the best of ten runs by the sum of squares (decision M27), 6 UAVs:"]
    values = metrics_table(document.results, HEADLINE[:-1])
    return "\n\n".join([*parts, values, source("n_init_10", document)])


def mobility_block() -> str:
    """The study with walking users."""
    document = read_evaluation("mobility")
    methods = [entry.method for entry in document.settings.methods]
    speeds = document.settings.speeds_mps
    parts = ["Users that walk, 6 UAVs: what rules that stay lose, and a rule that follows."]
    for hold in document.settings.heading_hold_s:
        found = {
            (result.method, result.speed_mps): result
            for result in document.results
            if result.heading_hold_s == hold
        }
        for metric in ("utility", "rate_jfi"):
            rows = [
                [f"`{method}`", *(cell(found[method, speed], metric) for speed in speeds)]
                for method in methods
            ]
            header = f"{METRICS[metric].heading}, headings held {hold:g} s"
            parts.append(table([header, *(f"{speed:g} m/s" for speed in speeds)], rows))
    return "\n\n".join([*parts, source("mobility", document)])


def run_index_block() -> str:
    """The time that listing runs takes."""
    document = read("run_index")
    rows = [[name, f"{case['median']:.2f}"] for name, case in document["seconds"].items()]
    settings = document["settings"]
    return (
        table([f"{settings['runs']:,} runs", "seconds"], rows)
        + f"\n\nMedians of {settings['repetitions']} turns. {recorded(document)}, "
        f"`{document['command']}`."
    )


def draw_studies() -> list[Path]:
    """Draw the figures of the UAV study and the training curves."""
    from orchid_uav.experiments.figures.evaluation_figures import draw_figures

    drawn = draw_figures(read_evaluation("uavs").results, FIGURES / "new", UAV_METRICS)
    paths = []
    for path in drawn:
        if path.suffix == ".png":
            paths.append(FIGURES / f"uavs_{path.name}")
            path.replace(paths[-1])
        else:
            path.unlink()
    (FIGURES / "new").rmdir()
    paths.append(FIGURES / "reference_training.png")
    draw_training(paths[-1])
    return paths


def draw_training(path: Path) -> None:
    """Draw the training curves of the released policies that learned in the paper's network."""
    from orchid_uav.experiments.figures.learning_curves import draw_learning_curves
    from orchid_uav.experiments.figures.style import setting_of

    every = {key: REFERENCE / key for key in COMMANDS}
    configurations = {key: read_config(run, read_record(run)) for key, run in every.items()}
    runs = {key: run for key, run in every.items() if configurations[key].uav.flight == "direct"}
    groups = {key: [read_episodes(run / "episodes.csv")] for key, run in runs.items()}
    title = setting_of(flatten(configurations[key]) for key in runs)
    draw_learning_curves(groups, path, CURVES, CURVE_WINDOW, title=title)


EVALUATION_BLOCKS = {
    "commands": (ROOT / "docs" / "methods.md", commands_block),
    "tuning": (ROOT / "docs" / "methods.md", tuning_block),
    "planner budget": (ROOT / "docs" / "methods.md", planner_block),
    "methods table": (ROOT / "docs" / "evaluation.md", methods_block),
    "uav study": (ROOT / "docs" / "evaluation.md", uav_block),
    "uav study at 60 MHz": (ROOT / "docs" / "evaluation.md", shared_bandwidth_block),
    "restarts study": (ROOT / "docs" / "evaluation.md", restarts_block),
    "mobility study": (ROOT / "docs" / "evaluation.md", mobility_block),
    "run index": (ROOT / "docs" / "runs.md", run_index_block),
}
"""Page and content of every block, by the name in its markers."""
