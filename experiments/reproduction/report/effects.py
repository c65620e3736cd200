"""Findings and verdicts as people read them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from orchid_uav.experiments.markup import Markup, element, joined
from orchid_uav.experiments.metrics import METRICS, UNBREAKABLE
from orchid_uav.experiments.reproduction.checks import VARIANCE_RATIO, VARIANCE_RATIO_TITLE
from orchid_uav.experiments.reproduction.result import Judged
from orchid_uav.experiments.reproduction.verdicts import Finding, Judgement, Verdict

MINUS = "\N{MINUS SIGN}"
_SIGNS: dict[Verdict | None, tuple[str, str]] = {
    "holds": ("✓", "holds"),
    "partly": ("◐", "partly"),
    "does not hold": ("✗", "fails"),
    "undecided": ("?", "open"),
    "not testable in this model": ("–", "untestable"),
    None: ("·", "untestable"),
}
"""A sign for each verdict, so that it is not told by its colour alone, and its class."""
_FINDINGS: dict[Finding, tuple[str, str]] = {
    "yes": ("✓", "holds"),
    "no": ("✗", "fails"),
    "undecided": ("?", "open"),
}


class Scale(NamedTuple):
    """How the numbers of a check are shown."""

    title: str
    unit: str
    factor: float
    """From stored values to shown ones."""
    digits: int

    def text(self, value: float | None, signed: bool = False) -> str:
        """A number without its unit."""
        if value is None or not math.isfinite(value):
            return "–"
        text = f"{abs(value) * self.factor:.{self.digits}f}"
        if float(text) == 0.0:
            return text
        return (MINUS if value < 0.0 else "+" if signed else "") + text


def scale_of(check: Judgement) -> Scale:
    """How a check's numbers are shown; a relative spread is a plain number, whatever the metric."""
    if check.metric == VARIANCE_RATIO:
        return Scale(VARIANCE_RATIO_TITLE, "", 1.0, 2)
    metric = METRICS[check.metric]
    if check.is_relative:
        return Scale(f"relative spread of {metric.title}", "", 1.0, 4)
    return Scale(metric.title, metric.unit, metric.scale, metric.digits)


def badge(verdict: Verdict | None) -> Markup:
    """A verdict, with its sign."""
    sign, kind = _SIGNS[verdict]
    return _badge(sign, kind, verdict or "no verdict")


def finding_badge(check: Judgement) -> Markup:
    """The finding of one check, with its sign."""
    return _badge(*_FINDINGS[check.finding], finding_text(check))


def finding_text(check: Judgement) -> str:
    """The finding of one check; of a "no" also why: too small a difference is not the opposite."""
    if check.finding != "no":
        return check.finding
    if check.is_within_margin:
        return "no (less than counts)"
    return {"equal": "no (it differs)", "not lower": "no (it is lower)"}.get(
        check.expected, "no (the opposite)"
    )


def _badge(sign: str, kind: str, word: str) -> Markup:
    return element(
        "span", element("span", sign, aria_hidden="true"), f"{UNBREAKABLE}{word}",
        class_=f"badge {kind}"
    )  # fmt: skip


def mean_text(check: Judgement) -> str:
    """The difference in the unit that is shown."""
    if check.difference is None:
        return "not measured"
    scale = scale_of(check)
    return f"{scale.text(check.difference, signed=True)}{UNBREAKABLE}{scale.unit}".strip()


def interval_text(check: Judgement) -> str:
    """Its 95 % interval; empty where there is none."""
    if check.ci95 is None:
        return ""
    scale = scale_of(check)
    return f"[{' to '.join(scale.text(end, signed=True) for end in check.ci95)}]"


def least_text(check: Judgement) -> str:
    """What would have been decided, where nothing was."""
    if check.finding != "undecided" or check.least_detectable_effect is None:
        return ""
    scale = scale_of(check)
    least = f"{scale.text(check.least_detectable_effect)}{UNBREAKABLE}{scale.unit}".rstrip()
    is_from_zero = check.expected in ("higher", "lower")
    return f"detectable from {least}{'' if is_from_zero else ' off the margin'}"


def pairs_text(check: Judgement) -> str:
    """Complete pairs of those that there should be."""
    return f"{check.n} of {check.units}".replace(" ", UNBREAKABLE)


def decisive(judged: Judged) -> Judgement | None:
    """The check that a verdict hangs on.

    Of an undecided claim it is an open check, one that waits for seeds before all others; else a
    "no", where there is one. Of several it is that which speaks most against the claim, in margins,
    so that metrics compare.
    """
    order: tuple[Finding, ...] = ("no", "undecided", "yes")
    if judged.verdict == "undecided":
        order = ("undecided",)
    for finding in order:
        found = [check for check in judged.checks if check.finding == finding]
        if found:
            return min(found, key=lambda check: (check.is_complete, _for_the_claim(check)))
    return None


def _for_the_claim(check: Judgement) -> float:
    """How far a difference speaks for the claim, in margins."""
    in_margins = (check.difference or 0.0) / check.margin
    if check.expected == "equal":
        return 1.0 - abs(in_margins)
    if check.expected == "not lower":
        return 1.0 + in_margins
    return in_margins if check.expected == "higher" else -in_margins


def counted(checks: Sequence[Judgement]) -> str:
    """How many checks found what, such as "3 yes, 1 no"."""
    findings = [check.finding for check in checks]
    told = [
        f"{findings.count(finding)} {'open' if finding == 'undecided' else finding}"
        for finding in ("yes", "no", "undecided")
        if finding in findings
    ]
    return ", ".join(told) or "none"


def code(text: str) -> Markup:
    """A name or a command."""
    return element("code", element("bdi", text))


def separated(parts: Sequence[str]) -> Markup:
    """Parts in one line."""
    return joined(parts, " · ")
