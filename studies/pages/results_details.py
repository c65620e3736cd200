"""Parts of docs/results.md beside the claims: open choices, and numbers that the paper prints."""

import textwrap
from collections.abc import Sequence
from statistics import median

import numpy as np

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import MARGINS, RATE, UTILITY, WORST
from orchid_uav.experiments.reproduction.evidence import Evidence
from orchid_uav.experiments.reproduction.report.methods import USERS, difference_text, signed
from orchid_uav.experiments.reproduction.result import Sensitivity
from orchid_uav.experiments.statistics.comparison import describe_differences
from studies.pages.guards import must_hold
from studies.pages.markdown import table
from studies.pages.results import PAGE, result, rows_read

WIDTH = 112
FLOOR_MBPS = 1.2
"""What the paper's max-min shares guarantee the worst user."""


def sensitivities_block() -> str:
    """What other choices change where the paper leaves one open; those with all of their seeds."""
    found = [one for one in result().sensitivities if one.method not in result().waiting]
    rows = [
        [
            f"`{one.method}`",
            one.purpose,
            USERS[one.users],
            signed(UTILITY, one.gained.mean),
            signed(UTILITY, one.gained_by_orchid.mean),
            difference_text(UTILITY, one.difference.difference),
        ]
        for one in found
    ]
    heads = ["training", "what differs", "flown among users", "gains", "`orchid` gains"]
    heads.append("difference [95 %]")
    return "\n\n".join(
        [
            _choices_in_words(found),
            table(heads, rows, words=3),
            "Gains are utility beyond that of the policy's own twin, in the paper's network, "
            "without noise. Means over ten seeds.",
        ]
    )


def _choices_in_words(found: Sequence[Sensitivity]) -> str:
    gains = {(one.method, one.users): one.gained.mean for one in found}
    must_hold(max(gains.values()) < 0.0, "no other choice lifts a policy above its twin")
    quiet = [gains[f"orchid-log-std-{level}", "tcp"] for level in (1, 2)]
    must_hold(min(quiet) > -MARGINS[UTILITY], "with less noise policies end near their twins")
    evidence, uniform = Evidence(rows_read()), [settings.base("uniform")]
    trained = [
        evidence.flown(key, UTILITY, uniform) for key in ("orchid-uniform", "orchid-no-rf-uniform")
    ]
    reset = describe_differences(trained[0] - trained[1])
    assert reset.ci95 is not None
    must_hold(reset.ci95[0] < 0.0 < reset.ci95[1], "trained there, no gain of R&F is shown")
    tuned = describe_differences(evidence.gained("orchid-tuned", UTILITY, [settings.base("tcp")]))
    assert tuned.ci95 is not None
    must_hold(tuned.ci95[0] > 0.0, "what a search found is above its twin")
    must_hold(tuned.mean < MARGINS[UTILITY], "and by less than counts")
    return textwrap.fill(
        "Where the paper leaves a choice open, or states two values, others were trained as well. "
        "None lifts a policy above its twin, in the mean. With less exploration noise they end "
        "near it. Trained on evenly spread users they are farther below it among users in "
        "hotspots, and no better among evenly spread ones; "
        "Reset-and-Finetune is not shown to help there either, "
        f"{difference_text(UTILITY, reset)} with it less without it. What a search of many such "
        "choices at once found (`orchid-tuned`: less noise and slower learning, among others) is "
        f"above its twin, by {difference_text(UTILITY, tuned)}, less than had been set as what "
        "counts.",
        WIDTH,
        break_on_hyphens=False,
    )


def printed_block() -> str:
    """What stands beside the few numbers that the paper prints."""
    evidence, base = Evidence(rows_read()), settings.base("tcp")
    fair, equal = (evidence.flown(key, RATE, [base]).mean() for key in ("orchid-long", "orchid-pf"))
    hovering = [evidence.flown(key, RATE, [base]).mean() for key in ("static-mmf", "static-pf")]
    must_hold(fair < hovering[0] and equal < hovering[1], "training costs fairness")
    least = {key: _worst(key)[0] for key in ("orchid-long", "orchid-10mhz", "orchid-20mhz")}
    must_hold(least["orchid-long"] > FLOOR_MBPS, "the floor is higher with 10 MHz each")
    must_hold(
        least["orchid-10mhz"] < 0.5 * FLOOR_MBPS < least["orchid-20mhz"] < FLOOR_MBPS,
        "with 10 MHz for all the floor is below the paper's, with 20 near it",
    )
    rate = METRICS[RATE].text
    rows = [
        [
            "Mean rate JFI after 1,000 episodes",
            "0.081 with max-min and 0.082 with proportional shares, probably 0.81 and 0.82",
            f"{rate(fair)} and {rate(equal)}; hovering {rate(hovering[0])} and {rate(hovering[1])}",
        ],
        [
            "Least rate of the worst user, max-min shares",
            f"above {FLOOR_MBPS} Mbit/s",
            _worst_text("orchid-long"),
        ],
        ["The same, proportional shares", "near 1.0 Mbit/s", _worst_text("orchid-pf")],
        [
            "The same, max-min shares, 10 MHz for all UAVs together",
            "–",
            _worst_text("orchid-10mhz"),
        ],
        ["The same, 20 MHz together", "–", _worst_text("orchid-20mhz")],
        ["A decision of one UAV on board", "milliseconds", _latency()],
    ]
    return table(["", "the paper", "here"], rows, words=3)


def _worst(method: str) -> tuple[float, float]:
    """The least and the fifth percentile of all topologies and seeds, in Mbit/s."""
    base = settings.base("tcp")
    values = np.concatenate(
        [
            row.find(base).topologies[WORST]
            for row in rows_read()
            if row.method == method and row.seed is not None
        ]
    )
    return float(values.min()) / 1e6, float(np.percentile(values, 5)) / 1e6


def _worst_text(method: str) -> str:
    least, low = _worst(method)
    return f"{least:.2f} Mbit/s; 95 % of topologies are above {low:.2f}"


def _latency() -> str:
    """The median over the seeds of the paper's policy, on one core."""
    rows = [row for row in rows_read() if row.method == "orchid" and row.actor_latency_us]
    [processor] = {row.host["processor"] for row in rows}
    return f"{median(row.actor_latency_us for row in rows):.0f} µs on one core ({processor})"


RESULTS_DETAILS_BLOCKS = {
    "results printed": (PAGE, printed_block),
    "results sensitivities": (PAGE, sensitivities_block),
}
