"""The part of the report about people: how many are served, by whom, and how fast."""

import math

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.markup import Markup, element
from orchid_uav.experiments.metrics import UNBREAKABLE
from orchid_uav.experiments.planning.maps.charts import rates_chart
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.wording import (
    people_text,
    rate_text,
    share_text,
)
from orchid_uav.experiments.planning.result import PeopleServed


def who_is_served(plan: MappedPlan) -> list[Markup]:
    """The section that comes first: what the plan achieves."""
    people = plan.document.people
    caption = "People by their rate, in bits per second."
    if people.served_by_masts:
        caption += " Grey: by masts."
    chart = element(
        "figure",
        rates_chart(plan),
        element("figcaption", caption),
    )
    words = element("div", *_rates_in_words(plan))
    return [
        element("p", *_headline(plan), class_="headline"),
        *_verdict(plan),
        _shares_bar(people, has_masts=bool(plan.surroundings.masts)),
        _tiles(plan),
        element("div", chart, words, class_="pair"),
    ]


def served(people: PeopleServed) -> int:
    """How many people are served at all."""
    return people.served_by_drones + people.served_by_masts


def _headline(plan: MappedPlan) -> list[str]:
    people = plan.document.people
    masts = len(plan.surroundings.masts)
    by_masts = f" and {people.served_by_masts:,} from the mast{'s' * (masts > 1)} on the ground"
    told = (
        f"{served(people):,} of {people_text(people.total)} "
        f"({share_text(served(people) / people.total)}) get a connection: "
        f"{people.served_by_drones:,} from drones{by_masts if masts else ''}."
    )
    if not people.unserved:
        return [told, " Nobody is left out."]
    share = share_text(people.unserved / people.total)
    gets = "gets" if people.unserved == 1 else "get"
    left_out = f"{people_text(people.unserved)} ({share}) {gets} none"
    return [f"{told} ", element("strong", left_out), "."]


def _verdict(plan: MappedPlan) -> list[Markup]:
    share = plan.document.people.share_above_want
    if plan.want is None or share is None:
        return []
    rate_bps, wanted = plan.want
    is_met = share >= wanted
    reached = share_text(share)
    if not is_met and reached == share_text(wanted):  # rounded up to what is wanted
        reached = f"{math.floor(1e4 * share) / 100:g}{UNBREAKABLE}%"
    told = (
        f"Wanted: {rate_text(rate_bps)} or more for {share_text(wanted)} of all people. "
        f"Planned: {reached}. The wish is {'met' if is_met else 'not met'}."
    )
    off = plan.document.robustness.position_error_50m
    if off.share_above_want is not None and off.share_above_want_worst is not None:
        told += (
            f" If people are some 50 m from where they were said to be, it is "
            f"{share_text(off.share_above_want)}, and {share_text(off.share_above_want_worst)} "
            "in the worst of the draws: see how sure this is, below."
        )
    return [element("p", told, class_="verdict met" if is_met else "verdict")]


def _shares_bar(people: PeopleServed, has_masts: bool) -> Markup:
    parts = [("by-drones", "by drones", people.served_by_drones)]
    if has_masts:
        parts.append(("by-masts", "by masts", people.served_by_masts))
    parts.append(("unserved", "not served", people.unserved))
    told = [f"{name}: {count:,} ({share_text(count / people.total)})" for _, name, count in parts]
    bar = [
        element("i", class_=kind, style=Markup(f"flex-grow:{count}"))
        for kind, _, count in parts
        if count
    ]
    keys = [
        element("li", element("span", class_=f"swatch {kind}"), text)
        for (kind, _, _), text in zip(parts, told, strict=True)
    ]
    return element(
        "figure",
        element("div", *bar, class_="share", role="img", aria_label="; ".join(told)),
        element("ul", *keys, class_="keys"),
    )


def _tiles(plan: MappedPlan) -> Markup:
    people = plan.document.people
    worst = rate_text(people.worst_rate_bps) if people.worst_rate_bps else "nothing"
    tiles = [
        ("People with a connection", share_text(served(people) / people.total)),
        ("Rate of the worst-off person", worst),
        ("Median: half of all people get this or more", rate_text(people.median_rate_bps)),
    ]
    if plan.want is not None and people.share_above_want is not None:
        told = f"People with {rate_text(plan.want.rate_bps)} or more"
        tiles.append((told, share_text(people.share_above_want)))
    return element(
        "dl",
        *(element("div", element("dt", told), element("dd", figure)) for told, figure in tiles),
        class_="tiles",
    )


def _rates_in_words(plan: MappedPlan) -> list[Markup]:
    told = [
        element(
            "p",
            "A person’s ",
            element("dfn", "rate"),
            " is how much data a telephone receives each second while everybody else uses the "
            "network, too. Roughly, a call over the internet takes 100 kbit/s (100 thousand bits "
            "each second) and a video call 1 Mbit/s (a million).",
        )
    ]
    if plan.document.people.unserved:
        rates_bps = plan.rates_bps[plan.server != NOBODY]
        slowest = (
            f" The slowest who has one gets {rate_text(float(rates_bps.min()))}."
            if len(rates_bps)
            else ""
        )
        told.append(
            element(
                "p",
                "People are not served where no drone and no mast is received well enough. "
                f"They count as 0 in the worst and the median rate.{slowest}",
            )
        )
    return told
