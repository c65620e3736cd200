"""What flies well, from ``studies/flying.py``: tables and the figure of docs/flying.md."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from orchid_uav.experiments.metrics import METRICS
from studies.pages.markdown import FIGURES, ROOT, recorded, table
from studies.recording import read

NAME = "flying"
PICTURE = FIGURES / f"{NAME}.png"
LEARNED, INFORMED = "orchid-distilled", "orchid-informed"
RULE, BOUND = "best-response", "receding-horizon"
TWIN = f"{LEARNED}-zero"
SHOWN = (LEARNED, INFORMED, TWIN, RULE, BOUND, "forces")
OLD = ("planner", "track-120", "track", "balanced-loiter", "loiter-mmf", "static-mmf")
METRIC_NAMES = (
    *("utility", "rate_jfi", "load_jfi", "worst_rate_bps"),
    *("thrust_energy_efficiency_bit_per_joule", "blocking_pairs"),
)
_SPEED, _UAVS, _PHASE_ONE, _KNOWLEDGE, _FAILURE, _HEADINGS, _CONVERGENCE = (
    *("speed", "UAVs at 15 m/s", "Phase I"),
    *("knowledge", "failure", "headings of 1 s", "convergence"),
)


class Goal(NamedTuple):
    """What was to be shown, before anything was flown."""

    axis: str
    value: Any
    metric: str
    of_rule: float | None
    of_learned: float


GOALS = (
    Goal(_SPEED, 0.0, "rate_jfi", 0.949, 0.945),
    Goal(_SPEED, 10.0, "rate_jfi", 0.958, 0.950),
    Goal(_SPEED, 15.0, "rate_jfi", 0.963, 0.955),
    Goal(_SPEED, 0.0, "worst_rate_bps", 6.33e6, 6.30e6),
    Goal(_SPEED, 10.0, "worst_rate_bps", 5.67e6, 5.60e6),
    Goal(_SPEED, 15.0, "worst_rate_bps", 5.33e6, 5.25e6),
    Goal(_UAVS, 4, "rate_jfi", 0.977, 0.971),
    Goal(_UAVS, 10, "rate_jfi", 0.960, 0.950),
    Goal(_PHASE_ONE, 150.0, "rate_jfi", 0.942, 0.935),
)
TOLERANCES = {"rate_jfi": 0.002, "worst_rate_bps": 0.03e6}
_VALUES = {
    _SPEED: "speed_mps",
    _UAVS: "uavs",
    _PHASE_ONE: "network.sensing_error_std_m",
    "UAVs": "uavs",
    "users": "users",
}
_WORDS = {
    _SPEED: "6 UAVs, {:g} m/s",
    _UAVS: "{} UAVs, 15 m/s",
    _PHASE_ONE: "Phase I {:g} m off, 0 m/s, slots 31 to 200",
    "UAVs": "{} UAVs",
    "users": "{} users",
    "distribution": "{} users",
}

Case = Mapping[str, Any]


def cases(axis: str) -> list[Case]:
    """The settings of an axis, in their order."""
    return [case for case in read(NAME)["cases"].values() if case["axis"] == axis]


def case_of(axis: str, value: Any) -> Case:
    """The setting of an axis with this value."""
    (found,) = (case for case in cases(axis) if case["setting"][_VALUES[axis]] == value)
    return found


def goals_block() -> str:
    """Goals, and what was reached."""
    rows = []
    for goal in GOALS:
        methods = case_of(goal.axis, goal.value)["methods"]
        described, tolerance = METRICS[goal.metric], TOLERANCES[goal.metric]
        cells = [f"{_WORDS[goal.axis].format(goal.value)}: {described.heading}"]
        for name, wanted in ((RULE, goal.of_rule), (LEARNED, goal.of_learned)):
            reached = methods[name][goal.metric]
            is_met = wanted is None or reached >= wanted - tolerance
            text = described.text(reached)
            cells += [
                "–" if wanted is None else described.text(wanted),
                text if is_met else f"{text} (missed)",
            ]
        rows.append(cells)
    header = ["", f"`{RULE}` wanted", "reached", f"`{LEARNED}` wanted", "reached"]
    return table(header, rows) + f"\n\nWithin {TOLERANCES['rate_jfi']} and 0.03 Mbit/s. {_source()}"


def knowledge_block() -> str:
    """Where knowledge is wrong or old: the learned policy less each rule, paired by topology."""
    rows = []
    for case in cases(_KNOWLEDGE):
        setting = case["setting"]
        error_m, delay_s = setting["sensing.flight_error_std_m"], setting["sensing.delay_s"]
        words = f"{error_m:g} m off, {delay_s:g} s old"
        for rule in (RULE, BOUND):
            less = case["learned_less"][LEARNED][rule]
            rows.append([words, f"`{rule}`", *(_less(less[name], name) for name in _PAIRED)])
    heads = [METRICS[name].heading for name in _PAIRED]
    return (
        table(["users' positions", f"`{LEARNED}` less", *heads], rows, words=2) + "\n\n" + _source()
    )


_PAIRED = ("utility", "rate_jfi", "worst_rate_bps")


def failure_block() -> str:
    """One UAV of six fails."""
    (case,) = cases(_FAILURE)
    return _methods_table(case, SHOWN) + "\n\n" + _source()


def speeds_block() -> str:
    """All methods at all speeds."""
    parts = []
    for case in cases(_SPEED):
        words = _WORDS[_SPEED].format(case["setting"]["speed_mps"])
        parts.append(f"**{words}**\n\n" + _methods_table(case, (*SHOWN, *OLD)))
    return "\n\n".join([*parts, _source()])


def headings_block() -> str:
    """All methods where users change their heading every second."""
    parts = []
    for case in cases(_HEADINGS):
        words = _WORDS[_SPEED].format(case["setting"]["speed_mps"])
        parts.append(f"**{words}, headings held 1 s**\n\n" + _methods_table(case, (*SHOWN, *OLD)))
    return "\n\n".join([*parts, _source()])


def convergence_block() -> str:
    """Best response and the learned policies on users who stand still, slot by slot."""
    rows = []
    for case in cases(_CONVERGENCE):
        for name in (RULE, LEARNED, INFORMED, TWIN):
            found = case["methods"][name]
            rows.append([f"{case['first_slot']}", f"`{name}`", *_texts(found, _CONVERGING)])
    heads = [METRICS[name].heading for name in _CONVERGING]
    return table(["slot", "method", *heads], rows, words=2) + "\n\n" + _source()


_CONVERGING = ("utility", "rate_jfi", "blocking_pairs")


def informed_block() -> str:
    """The paper's method on stations less the rules, paired by topology."""
    rows = []
    for case in [*cases(_SPEED), *cases(_HEADINGS)]:
        setting = case["setting"]
        words = f"{setting['speed_mps']:g} m/s, headings {setting['heading_hold_s']:g} s"
        for rule in ("planner", "balanced-loiter", "track", f"{INFORMED}-zero", RULE):
            less = case["learned_less"][INFORMED][rule]
            rows.append([words, f"`{rule}`", *(_less(less[name], name) for name in _PAIRED)])
    heads = [METRICS[name].heading for name in _PAIRED]
    return table(["users", f"`{INFORMED}` less", *heads], rows, words=2) + "\n\n" + _source()


def axes_block() -> str:
    """Other numbers of UAVs and users, and users who are everywhere."""
    rows = []
    for case in [*cases("UAVs"), *cases("users"), *cases("distribution")]:
        setting = case["setting"]
        words = {
            "UAVs": _WORDS["UAVs"].format(setting["uavs"]),
            "users": _WORDS["users"].format(setting["users"]),
        }.get(case["axis"], _WORDS["distribution"].format(setting["distribution"]))
        for name in (LEARNED, INFORMED, RULE, TWIN):
            found = case["methods"][name]
            rows.append([words, f"`{name}`", *_texts(found, METRIC_NAMES)])
    heads = [METRICS[name].heading for name in METRIC_NAMES]
    return table(["at 10 m/s", "method", *heads], rows, words=2) + "\n\n" + _source()


def seeds_block() -> str:
    """How much the training seeds differ."""
    rows = []
    seeds = read(NAME)["settings"]["training_seeds"]
    for kind in (LEARNED, INFORMED):
        for axis, value in ((_SPEED, 0.0), (_SPEED, 15.0), (_UAVS, 4), (_UAVS, 10)):
            methods = case_of(axis, value)["methods"]
            rates = [methods[f"{kind}-s{seed}"]["rate_jfi"] for seed in seeds[kind]]
            texts = [METRICS["rate_jfi"].text(rate) for rate in rates]
            rows.append([f"`{kind}`", _WORDS[axis].format(value), *texts])
    heads = [f"seed {seed}" for seed in seeds[LEARNED]]
    return table(["", "rate JFI", *heads], rows, words=2) + "\n\n" + _source()


def readme_block() -> str:
    """The figure and a table for the README."""
    case = case_of(_SPEED, 15.0)
    names = (LEARNED, INFORMED, TWIN, RULE, BOUND, "track", "balanced-loiter", "static-mmf")
    return "\n\n".join(
        [
            f"![Fairness and the worst user's rate over speed](docs/figures/{PICTURE.name})",
            "6 UAVs, 100 users who walk at up to 15 m/s, 100 unseen topologies:",
            _methods_table(case, names),
            _source(),
        ]
    )


def _methods_table(case: Case, names: Iterable[str]) -> str:
    shown = [name for name in METRIC_NAMES if name in next(iter(case["methods"].values()))]
    heads = [METRICS[name].heading for name in shown]
    rows = [
        [f"`{name}`", *_texts(case["methods"][name], shown)]
        for name in names
        if name in case["methods"]
    ]
    return table(["method", *heads], rows)


def _texts(found: Mapping[str, float], metrics: Sequence[str]) -> list[str]:
    return [METRICS[metric].text(found[metric]) for metric in metrics]


def _less(less: Mapping[str, Any], metric: str) -> str:
    scale, digits = (1e-6, 2) if metric == "worst_rate_bps" else (1.0, 4)
    low, high = (scale * end for end in less["ci95"])
    return f"{scale * less['mean']:+.{digits}f} ({low:+.{digits}f} … {high:+.{digits}f})"


def _source() -> str:
    document = read(NAME)
    settings = document["settings"]
    return (
        f"Means over {settings['topologies']} unseen topologies and "
        f"{len(settings['training_seeds'][LEARNED])} training seeds. {recorded(document)}, "
        f"`{document['command']}` → "
        f"`studies/results/{NAME}.json`."
    )


def draw_flying() -> Path:
    """Rate JFI and the worst user over the users' speed; what is gained where knowledge is bad."""
    from matplotlib import style
    from matplotlib.figure import Figure

    from orchid_uav.experiments.figures.style import PAGE_IN, STYLE, line_styles

    names = (LEARNED, INFORMED, TWIN, RULE, BOUND, "track", "balanced-loiter", "static-mmf")
    looks = line_styles(names)
    by_speed = cases(_SPEED)
    speeds = [case["setting"]["speed_mps"] for case in by_speed]
    with style.context(["default", STYLE]):
        figure = Figure((PAGE_IN, 2.9), layout="constrained")
        fairness, worst, gain = figure.subplots(1, 3)
        for name in names:
            values = [case["methods"][name] for case in by_speed]
            fairness.plot(speeds, [one["rate_jfi"] for one in values], label=name, **looks[name])
            worst.plot(speeds, [1e-6 * one["worst_rate_bps"] for one in values], **looks[name])
        for axes, label in ((fairness, "rate JFI"), (worst, "worst user's rate (Mbit/s)")):
            axes.set_xlabel("users' greatest speed (m/s)")
            axes.set_ylabel(label)
        texts = []
        for place, case in enumerate(cases(_KNOWLEDGE)):
            setting = case["setting"]
            texts.append(
                f"{setting['sensing.flight_error_std_m']:g} m,\n{setting['sensing.delay_s']:g} s"
            )
            for shift, rule in ((-0.12, RULE), (0.12, BOUND)):
                less = case["learned_less"][LEARNED][rule]["rate_jfi"]
                low, high = less["ci95"]
                gain.errorbar(
                    place + shift,
                    less["mean"],
                    [[less["mean"] - low], [high - less["mean"]]],
                    color=looks[rule]["color"],
                    marker=looks[rule]["marker"],
                    capsize=2,
                )
        gain.axhline(0.0, color="black", lw=0.8)
        gain.set_xticks(range(len(texts)), texts)
        gain.set_xlim(-0.5, len(texts) - 0.5)
        gain.set_xlabel("positions off, old (15 m/s)")
        gain.set_ylabel(f"rate JFI of {LEARNED}\nless that of the rule")
        figure.legend(loc="outside lower center", ncols=4)
        figure.savefig(PICTURE)
    return PICTURE


FLYING_BLOCKS = {
    "flying": (ROOT / "README.md", readme_block),
    "flying goals": (ROOT / "docs" / "flying.md", goals_block),
    "flying knowledge": (ROOT / "docs" / "flying.md", knowledge_block),
    "flying failure": (ROOT / "docs" / "flying.md", failure_block),
    "flying speeds": (ROOT / "docs" / "flying.md", speeds_block),
    "flying headings": (ROOT / "docs" / "flying.md", headings_block),
    "flying convergence": (ROOT / "docs" / "flying.md", convergence_block),
    "flying informed": (ROOT / "docs" / "flying.md", informed_block),
    "flying axes": (ROOT / "docs" / "flying.md", axes_block),
    "flying seeds": (ROOT / "docs" / "flying.md", seeds_block),
}
