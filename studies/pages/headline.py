"""The table of README.md: the paper's methods over their seeds, beside doing nothing and rules."""

import textwrap

import numpy as np

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import UTILITY
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.report.methods import signed
from orchid_uav.experiments.reproduction.result import FlownMethod
from studies.pages.findings import WIDTH
from studies.pages.guards import must_hold
from studies.pages.markdown import ROOT, table
from studies.pages.results import result, rows_read
from studies.recording import read_evaluation

TRAINED = (
    *("orchid", "orchid-no-rf", "orchid-pf", "maddpg-mmf", "maddpg-pf"),
    *("maddpg-mmf-paper", "maddpg-pf-paper", "orchid-tuned", "orchid-informed"),
)
RULES = ("static-mmf", "static-pf", "loiter-mmf", "balanced-loiter", "best-response")
COLUMNS = (
    *("coverage", "energy_efficiency_bit_per_joule", "rate_jfi", "load_jfi"),
    *("worst_rate_bps", UTILITY),
)


def headline_block() -> str:
    """Trained methods that have all of their seeds, and rules."""
    found = {method.method: method for method in result().methods}
    waiting = result().waiting
    shown = [found[key] for key in (*TRAINED, *RULES) if key in found and key not in waiting]
    seeds = {method.seeds for method in shown if method.seeds}
    must_hold(len(seeds) == 1, "all trained methods have as many seeds")
    evidence = Evidence(rows_read())
    rows = [[f"`{method.method}`", *_cells(method), _gain(method, evidence)] for method in shown]
    served, reached = (
        float(evidence.flown("static-mmf", metric, [settings.base("tcp")]).mean())
        for metric in ("total_coverage", "gbs_coverage")
    )
    planner = next(one for one in read_evaluation("methods").results if one.method == "planner")
    heads = ["method", *(METRICS[metric].heading for metric in COLUMNS), "beyond doing nothing"]
    return "\n\n".join(
        [
            "![Energy efficiency over the number of UAVs]"
            "(docs/figures/uavs_energy_efficiency_bit_per_joule.png)\n"
            "![Rate fairness over the number of UAVs](docs/figures/uavs_rate_jfi.png)",
            _wrapped(
                "The pictures show the released policies, one training of each. The table has "
                f"{seeds.pop()} trainings: 6 UAVs, 100 users in hotspots, {result().topologies} "
                "unseen topologies, policies without noise; means, ± standard deviation between "
                "training seeds. The last column is the utility less that of the method's own "
                "zero-action twin. Coverage is the share served of the drones' own users (*target "
                f"users*); where all hover, {served:.3f} of all users are served, since the ground "
                f"station reaches {reached:.3f} of its own."
            ),
            table(heads, rows),
            _wrapped(
                "Figures, verdicts and commands: [the paper's results](docs/results.md). Other "
                "rules, a planner that knows every radio link (utility "
                f"{planner.metrics[UTILITY].mean:.3f}), the distilled policy and all metrics: "
                "[evaluation](docs/evaluation.md), on other topologies."
            ),
        ]
    )


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_on_hyphens=False)


def _cells(method: FlownMethod) -> list[str]:
    cells = []
    for metric in COLUMNS:
        described, summary = METRICS[metric], method.deterministic[metric]
        text = "–" if summary.mean is None else described.text(summary.mean)
        spread = described.text(summary.std) if method.seeds and summary.std else ""
        is_seen = bool(spread.strip("0."))  # and is not all zeros
        cells.append(f"{text} ± {spread}" if is_seen else text)
    return cells


def _gain(method: FlownMethod, evidence: Evidence) -> str:
    if not method.seeds:
        return "–"
    gains = evidence.gained(method.method, UTILITY, [settings.base("tcp")])
    return f"{signed(UTILITY, np.mean(gains))} ± {METRICS[UTILITY].text(np.std(gains, ddof=1))}"


HEADLINE_BLOCKS = {"headline": (ROOT / "README.md", headline_block)}
