"""Fuzzed input and large fleets of ``python -m studies.torture``, for docs/reliability.md."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies.pages.markdown import FIGURES, table
from studies.pages.torture import PAGE, source
from studies.recording import read

FUZZ, FLEETS = "torture/fuzz", "torture/fleets"
PICTURE = FIGURES / "fleets.png"


def fuzz_block() -> str:
    """How the cases of every surface ended."""
    document = read(FUZZ)
    rows = []
    for surface in document["surfaces"]:
        ended = surface["ended"]
        others = sum(count for code, count in ended.items() if code not in ("0", "2"))
        numbers = [surface["cases"], ended.get("0", 0), ended.get("2", 0), others]
        numbers.append(surface["kinds_of_refusal"])
        rows.append([surface["name"], *(f"{number:,}" for number in numbers)])
    heads = ["surface", "cases", "accepted (0)", "refused (2)", "ended by ctrl-C"]
    return f"{table([*heads, 'different messages'], rows)}\n\n{source(document)}"


def fleets_block() -> str:
    """Time and memory by size."""
    document = read(FLEETS)
    rows = [
        [
            f"{fleet['uavs']:,}",
            f"{fleet['users']:,}",
            _time(fleet["slot_ms"]),
            _time(fleet["decision_ms"]),
            _time(1e3 * fleet["deployment_s"]),
            f"{fleet['memory_mib']:.0f}",
        ]
        for fleet in document["fleets"]
    ]
    heads = ["UAVs", "users", "slot (ms)", "decisions (ms)", "Phase I (ms)", "memory (MiB)"]
    return (
        f"![Time of a slot against the number of users](figures/{PICTURE.name})\n\n"
        f"{table(heads, rows, words=0)}\n\n"
        "A slot of one world, and the decisions of all its UAVs by the released policy `orchid`:\n"
        f"the least of {document['repetitions']} medians of {document['slots']} slots. Memory "
        "is what the process needs at most beyond what it\nneeds for six UAVs and 100 users "
        f"({_process_mib(document['fleets']):.0f} MiB, most of them imports).\n\n"
        f"{source(document)}"
    )


def _time(milliseconds: float) -> str:
    digits = 2 if milliseconds < 10.0 else 0
    return f"{milliseconds:,.{digits}f}"


def _process_mib(fleets: Sequence[dict[str, Any]]) -> float:
    least = min(fleets, key=lambda fleet: fleet["memory_mib"])
    return least["process_mib"] - least["memory_mib"]


def draw_fleets() -> Path:
    """Time of a slot over the number of users, a line for each number of UAVs."""
    from matplotlib import style
    from matplotlib.figure import Figure
    from matplotlib.ticker import StrMethodFormatter

    from orchid_uav.experiments.figures.style import PAGE_IN, STYLE

    fleets = read(FLEETS)["fleets"]
    counts = sorted({fleet["uavs"] for fleet in fleets})
    with style.context(["default", STYLE]):
        figure = Figure((PAGE_IN, 3.0), layout="constrained")
        slots, memory = figure.subplots(1, 2)
        for number, count in enumerate(counts):
            own = [fleet for fleet in fleets if fleet["uavs"] == count]
            users = [fleet["users"] for fleet in own]
            look = {"marker": "os^Dv"[number], "color": f"C{number}"}
            label = f"{count} UAV{'s' * (count != 1)}"
            slots.plot(users, [fleet["slot_ms"] for fleet in own], label=label, **look)
            memory.plot(users, [max(fleet["memory_mib"], 0.05) for fleet in own], **look)
        for axes, label in ((slots, "time of a slot (ms)"), (memory, "memory more (MiB)")):
            axes.set_xscale("log")
            axes.set_yscale("log")
            for axis in (axes.xaxis, axes.yaxis):  # the style shows no mathematical text
                axis.set_major_formatter(StrMethodFormatter("{x:,g}"))
            axes.set_xlabel("users")
            axes.set_ylabel(label)
        figure.legend(loc="outside lower center", ncols=len(counts))
        figure.savefig(PICTURE)
    return PICTURE


TORTURE_FUZZ_BLOCKS = {"fuzzed input": (PAGE, fuzz_block), "large fleets": (PAGE, fleets_block)}
