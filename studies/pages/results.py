"""The tables of docs/results.md, from the rows that are committed."""

from collections.abc import Sequence
from functools import cache
from statistics import median

from orchid_uav.experiments.provenance import CHANGES
from orchid_uav.experiments.reproduction.campaign import Campaign
from orchid_uav.experiments.reproduction.report.effects import (
    finding_text,
    interval_text,
    least_text,
    mean_text,
    scale_of,
)
from orchid_uav.experiments.reproduction.result import Judged, JudgedClaim, Reproduction
from orchid_uav.experiments.reproduction.rows import Row
from orchid_uav.experiments.reproduction.trainings import SEEDS, TRAININGS
from orchid_uav.experiments.reproduction.verdicts import Judgement
from studies.pages.markdown import ROOT, table
from studies.recording import RESULTS

PAGE = ROOT / "docs" / "results.md"
ROWS = RESULTS / "reproduction"


CAMPAIGN = Campaign(ROWS / "nowhere", ROWS)
"""Its directory does not exist, since nothing is written there."""


@cache
def rows_read() -> Sequence[Row]:
    """The committed rows: hundreds of files, which several blocks need."""
    return tuple(CAMPAIGN.checked_rows())


@cache
def result() -> Reproduction:
    """What the committed rows say."""
    return CAMPAIGN.gathered(("orchid", "reproduce"), "completed", rows_read())


def question_of(key: str) -> JudgedClaim:
    """A question with all of its seeds.

    Raises:
        LookupError: there is no such question, or it waits for seeds.
    """
    for question in result().questions:
        if question.key == key and is_measured(question):
            return question
    raise LookupError(f"{key} has not been answered")


def progress_block() -> str:
    """How many seeds of each method have their row."""
    found = result()
    trained = [key for key in TRAININGS if found.rows.get(key)]
    rows = [
        [f"`{key}`", f"{len(found.rows[key])} of {len(SEEDS)}", f"{_minutes(key):.1f}"]
        for key in trained
    ]
    dates = sorted({row.date for row in rows_read()})
    when = " to ".join(dict.fromkeys((dates[0], dates[-1])))
    done, wanted = sum(len(found.rows[key]) for key in trained), len(TRAININGS) * len(SEEDS)
    told = (
        f"{done} of {wanted} trainings have their row, {found.missing} rows of all are missing; "
        f"{found.hours} hours of one core "
        f"so far ({', '.join(found.processors)}, {when}, commits "
        f"{', '.join(f'`{commit[:7]}`' for commit in found.commits)})."
    )
    changed = [commit for commit in found.commits if commit.endswith(CHANGES)]
    if changed:
        raise ValueError(f"rows were made by code with uncommitted changes: {changed}")
    return f"{told}\n\n{table(['method', 'seeds', 'minutes of one core for one'], rows)}"


def _minutes(method: str) -> float:
    """Of one core for one seed with its flights, in the median."""
    return median(
        ((row.seconds_trained or 0.0) + (row.seconds_flown or 0.0)) / 60.0
        for row in rows_read()
        if row.method == method
    )


def verdicts_block() -> str:
    """The verdicts that have all of their seeds."""
    found = result()
    lines = []
    for heading, claims in (("claim", found.claims), ("question", found.questions)):
        decided = [claim for claim in claims if is_measured(claim)]
        if decided:
            head = ["", heading, "verdict", "uniform users", "what was compared"]
            lines.append(table(head, [_row(claim) for claim in decided], words=5))
    return "\n\n".join(lines)


def uniform_block() -> str:
    """What the verdicts among uniform users rest on."""
    found = result()
    rows = [
        [claim.key.upper(), f"**{claim.uniform.verdict}**", _told_of(claim.uniform)]
        for claim in (*found.claims, *found.questions)
        if claim.uniform and is_measured(claim)
    ]
    return table(["", "verdict", "what was compared"], rows, words=3)


def is_measured(claim: JudgedClaim) -> bool:
    """Whether all comparisons of a claim have all of their pairs, among all users."""
    checks = [*claim.tcp.checks, *(claim.uniform.checks if claim.uniform else ())]
    return all(check.is_complete for check in checks)


def _row(claim: JudgedClaim) -> list[str]:
    uniform = claim.uniform.verdict if claim.uniform else None
    checks = _told_of(claim.tcp) or "nothing: " + claim.note
    verdict = f"**{claim.tcp.verdict}**"
    return [claim.key.upper(), claim.says, verdict, uniform or "–", checks]


def _told_of(judged: Judged) -> str:
    return "<br>".join(_told(check) for check in judged.checks)


def _told(check: Judgement) -> str:
    title = scale_of(check).title
    what = check.what.removesuffix(", relative spread")
    what = what if title in what else f"{what}, {title}"
    parts = [f"{what}: {mean_text(check)}", interval_text(check)]
    if least := least_text(check):
        parts.append(f"({least})")
    return f"{' '.join(filter(None, parts))}: {finding_text(check)}"


RESULTS_BLOCKS = {
    "results progress": (PAGE, progress_block),
    "results verdicts": (PAGE, verdicts_block),
    "results verdicts among uniform users": (PAGE, uniform_block),
}
