"""The table of seconds against utility in docs/training.md."""

from itertools import groupby
from statistics import fmean

from studies.pages.markdown import ROOT, recorded, table
from studies.recording import read


def batches_block() -> str:
    """Seconds and utilities of the runs, a row for each number of worlds and minibatch."""
    document = read("batches")
    settings, zero = document["settings"], document["zero_action"]["utility"]

    def kind(run: dict[str, float]) -> tuple[float, float, float]:
        return run["worlds"], run["minibatch"], run["batch_size"]

    rows = []
    for (worlds, unit, size), found in groupby(sorted(document["runs"], key=kind), kind):
        runs = list(found)
        utilities = [run["utility"] for run in runs]
        rows.append(
            [
                f"{worlds}",
                f"{size:,} {unit}",
                f"{fmean(run['cpu_s'] for run in runs):.0f}",
                f"{fmean(utilities):.3f}",
                f"{min(utilities):.3f} … {max(utilities):.3f}",
            ]
        )
    header = ["worlds", "a minibatch", "seconds", "utility", "least … greatest"]
    return (
        table(header, rows)
        + f"\n\nMeans of {settings['seeds']} seeds, {settings['episodes']} episodes each, seconds "
        f"of one core; the deterministic policy on {settings['topologies']} topologies, where "
        f"doing nothing has {zero:.3f}. {recorded(document)}, `{document['command']}`."
    )


BATCHES_BLOCKS = {"batches": (ROOT / "docs" / "training.md", batches_block)}
