"""Plans, of ``studies.planning`` and ``studies.plan_example``: parts of docs/planning.md."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.console import Console

from orchid_uav.cli.tables.planning import print_plan
from orchid_uav.experiments.planning.result import PlanDocument
from studies.pages.markdown import ROOT, recorded, table
from studies.recording import read

PAGE = ROOT / "docs" / "planning.md"
_WIDTH = 88


def example_block() -> str:
    """What the worked example prints on a terminal."""
    document = read("plan_example")
    text = io.StringIO()
    out = Console(file=text, width=_WIDTH, force_terminal=True, no_color=True, highlight=False)
    print_plan(out, PlanDocument.from_json(document["plan"]))
    lines = [_plain(line).rstrip() for line in text.getvalue().splitlines()]
    budget = document["settings"]["budget"]
    return "\n".join(
        [
            "```text",
            *lines,
            "```",
            "",
            f"{recorded(document)}, with `--budget {budget}`, `{document['command']}`.",
        ]
    )


def _plain(line: str) -> str:
    return line.replace("\x1b[1m", "").replace("\x1b[0m", "")


def quality_block() -> str:
    """The search against longer ones, many starts, and CMA-ES."""
    document = read("planning")
    sites = document["sites"]
    usual = list(sites["usual"].values())
    last = f"{document['settings']['times_s'][-1]:g}"
    times = [f"{time_s:g}" for time_s in document["settings"]["times_s"][:-1]]
    rows = []
    for time_s in times:
        lost = np.array([1.0 - one["search"][time_s] / one["search"][last] for one in usual])
        rows.append([f"{2 * float(time_s):g} s", *_lost(lost)])
    lost = np.array([1.0 - one["cma"] / one["search"][last] for one in usual])
    rows.append(["10 s, CMA-ES", *_lost(lost)])
    small = list(sites["small"].values())
    starts = len(small[0]["others"])
    behind = [1.0 - one["default"] / one["others"][-1] for one in small]
    spread = [one["others"][-1] / one["others"][0] - 1.0 for one in small]
    large = [
        [
            str(drones),
            f"{one['positions']:,}",
            *(f"{one['search'][time_s]:.3f}" for time_s in ("2.5", "5", "20", "100")),
            f"{one['cma']:.3f}",
        ]
        for drones, one in sites["large"].items()
    ]
    return "\n\n".join(
        [
            f"Thirty made-up sites with {min(one['drones'] for one in usual)} to "
            f"{max(one['drones'] for one in usual)} drones and "
            f"{min(one['positions'] for one in usual)} to "
            f"{max(one['positions'] for one in usual)} positions, with and without masts and a "
            f"no-fly zone: how far the utility is below that of `--budget {2 * float(last):g}s`, "
            "of which the search has half:",
            table(["--budget", "mean (%)", "worst site (%)"], rows),
            f"{len(small)} sites with 3 to 6 drones and 100 positions: {starts} starts with ten "
            "times the default budget each, so a hundred times altogether, find a utility "
            f"higher by {100 * max(behind):.2f} % at most, {100 * np.mean(behind):.2f} % in the "
            f"mean. These starts themselves differ by {100 * max(spread):.2f} % at most.",
            "A bound that is proved is not to be had this way: Jain's indices make the utility "
            "neither concave nor a sum over people, and what a linear program could bound, "
            "coverage and energy efficiency alone, leaves the other half of the utility at its "
            "greatest value.",
            "Larger sites with a hundred positions for each drone, utility after seconds of "
            "search, and of CMA-ES after 100 s:",
            table(["drones", "positions", "2.5 s", "5 s", "20 s", "100 s", "CMA-ES"], large),
            f"{recorded(document)}, `{document['command']}` → `studies/results/planning.json`.",
        ]
    )


def _lost(lost: Any) -> list[str]:
    return [f"{100 * lost.mean():.2f}", f"{100 * lost.max():.2f}"]


PLANNING_BLOCKS: Mapping[str, Any] = {
    "planning example": (PAGE, example_block),
    "planning quality": (PAGE, quality_block),
}
