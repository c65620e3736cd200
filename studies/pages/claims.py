"""The tables of docs/claims.md, from the code that decides."""

from collections import defaultdict
from collections.abc import Iterable

from orchid_uav.experiments.metrics import METRICS
from orchid_uav.experiments.reproduction import settings
from orchid_uav.experiments.reproduction.checks import (
    BLOCK_MARGINS,
    EFFICIENCY,
    MARGINS,
    SPREAD_MARGINS,
    VARIANCE_RATIO_TITLE,
)
from orchid_uav.experiments.reproduction.claims import CLAIMS, QUESTIONS, Claim
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from studies.pages.markdown import ROOT, table

PAGE = ROOT / "docs" / "claims.md"


def protocol_block() -> str:
    """Seeds, topologies and axes."""
    speeds = ", ".join(f"{speed:g}" for speed in settings.SPEEDS_MPS)
    errors = " and ".join(f"{error:g}" for error in settings.SENSING_ERRORS_M[1:])
    headings = " and ".join(f"{hold:g} s" for hold in settings.HEADINGS_S)
    return "\n".join(
        [
            f"* Training seeds {SEEDS[0]} to {SEEDS[-1]}. None was used for tuning or released.",
            f"* {settings.TOPOLOGIES} held-out topologies per setting, of evaluation seed "
            f"{settings.EVALUATION_SEED}, on which nothing was chosen; on the way, every 50 "
            f"episodes, {settings.CURVE_TOPOLOGIES} others.",
            f"* {', '.join(map(str, settings.USERS))} users; {settings.UAVS[0]} to "
            f"{settings.UAVS[-1]} UAVs; users that walk at {speeds} m/s, with headings held for "
            f"{headings}; Phase I that sees users {errors} m off. All else is the paper's network: "
            "6 UAVs, 100 users that stay.",
        ]
    )


def margins_block() -> str:
    """The margin of every metric, in the unit in which it is shown."""
    rows = []
    for name, margin in MARGINS.items():
        spread = SPREAD_MARGINS.get(name)
        metric = METRICS.get(name)
        if metric is None:
            rows.append([VARIANCE_RATIO_TITLE, f"{margin:g}", "–"])
            continue
        told = "–"
        if spread is not None:
            is_relative = name == EFFICIENCY
            told = f"{spread:g}" if is_relative else f"{spread * metric.scale:g}"
        rows.append([metric.heading, f"{margin * metric.scale:g}", told])
    blocks = BLOCK_MARGINS[EFFICIENCY] * METRICS[EFFICIENCY].scale
    return (
        f"{table(['metric', 'margin', 'margin of its spread'], rows)}\n\n"
        f"Of the spread of energy efficiency between episodes of one training (C3, C16) it is "
        f"{blocks:g} Mbit/J."
    )


def _claims(claims: Iterable[Claim]) -> str:
    rows = []
    for claim in claims:
        metrics = defaultdict(list)
        for check in claim.checks("tcp"):
            metrics[check.what].append(_title(check.metric))
        told = [f"{what}: {', '.join(of)}" for what, of in metrics.items()]
        compared = "; ".join(told) or "none is possible"
        both = " *(both)*" if claim.by_distribution else ""
        note = f" {claim.note}" if claim.note else ""
        rows.append([claim.key.upper(), claim.says + both, claim.where, compared + "." + note])
    return table(["", "claim", "in the paper", "compared"], rows, words=4)


def _title(name: str) -> str:
    return METRICS[name].title if name in METRICS else VARIANCE_RATIO_TITLE


def trainings_block() -> str:
    """Every training with its command."""
    flown = {
        "everything": "all settings, both distributions",
        "tcp": "all settings, TCP",
        "walking": "users that stay and walk, Phase I that errs, TCP",
        "base": "the paper's network, TCP",
    }
    rows = [
        [
            f"`{training.key}`",
            training.purpose,
            f"`orchid train{''.join(f' {word}' for word in training.arguments)}`",
            flown[training.flown],
        ]
        for training in TRAININGS.values()
    ]
    return table(["key", "what", "trained by", "flown in"], rows, words=4)


CLAIMS_BLOCKS = {
    "claims protocol": (PAGE, protocol_block),
    "claims margins": (PAGE, margins_block),
    "claims table": (PAGE, lambda: _claims(CLAIMS)),
    "claims questions": (PAGE, lambda: _claims(QUESTIONS)),
    "claims trainings": (PAGE, trainings_block),
}
