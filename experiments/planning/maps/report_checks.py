"""The parts of the report about how sure a plan is, how many drones it takes, and for how long."""

from collections.abc import Sequence
from statistics import mean

from orchid_uav.experiments.markup import Markup, element, joined, table
from orchid_uav.experiments.metrics import UNBREAKABLE
from orchid_uav.experiments.planning.maps.charts import (
    FleetPoint,
    Range,
    fleet_chart,
    ranges_chart,
)
from orchid_uav.experiments.planning.maps.drawing import MappedPlan
from orchid_uav.experiments.planning.maps.report_people import served
from orchid_uav.experiments.planning.maps.wording import (
    duration_text,
    number_text,
    people_text,
    rate_text,
    share_text,
)
from orchid_uav.experiments.planning.result import (
    DrawnFigures,
    DroneLost,
    OneDroneLost,
    PeopleServed,
    Robustness,
)

_SHOWN_LOSSES = 8
"""With more drones than that, those whose loss matters least are folded away."""


def how_sure(plan: MappedPlan) -> list[Markup]:
    """The section of what is left where things are otherwise than planned."""
    robustness, people = plan.document.robustness, plan.document.people
    lost = robustness.one_drone_lost
    cases = _drawn_cases(robustness)
    ranges = [Range(name, one.share_served, one.share_served_worst) for name, one in cases.items()]
    if lost is not None:
        ranges += [
            Range("one drone lost, at once", lost.share_served, lost.share_served_worst),
            Range(
                "one drone lost, others moved",
                lost.share_served_regained,
                lost.share_served_regained_worst,
            ),
        ]
    draws = max(one.draws for one in cases.values())
    caption = "Share of people served. Dot: mean; tick at the other end: worst."
    planned = served(people) / people.total
    chart = element("figure", ranges_chart(planned, ranges), element("figcaption", caption))
    return [
        *_checks_in_words(draws, lost),
        element("div", chart, _drawn_table(people, cases, lost), class_="beside"),
        *([] if lost is None else _losses(lost)),
    ]


def how_many(plan: MappedPlan) -> list[Markup]:
    """The section of what more or fewer drones would reach."""
    sizes = sorted(plan.document.fleet_sizes, key=lambda size: size.drones)
    if not sizes:
        return [element("p", "Other numbers of drones were not tried.")]
    chosen = len(plan.stations)
    want = None if plan.want is None else rate_text(plan.want.rate_bps)
    points = [
        FleetPoint(
            size.drones, served(size.people) / size.people.total, size.people.share_above_want
        )
        for size in sizes
    ]
    heads = ["Drones", "People served", "Not served", "Worst-off person", "Median"]
    heads += [f"{want} or more"] if want else []
    rows = [
        [
            f"{size.drones}",
            share_text(served(size.people) / size.people.total),
            people_text(size.people.unserved),
            _worst(size.people.worst_rate_bps),
            rate_text(size.people.median_rate_bps),
            *([_share(size.people.share_above_want)] if want else []),
            f"{size.utility:.3f}",
        ]
        for size in sizes
    ]
    classes = ["chosen" if size.drones == chosen else "" for size in sizes]
    figure = element("figure", fleet_chart(points, chosen, want))
    caption = "The same people with other numbers of drones; this plan is marked"
    return [
        *_fleet_in_words(plan),
        element("div", figure, table(caption, [*heads, "Utility"], rows, classes), class_="beside"),
    ]


def keeping_in_the_air(plan: MappedPlan) -> list[Markup]:
    """The section of batteries and of drones in reserve."""
    minutes = [drone.endurance_minutes for drone in plan.document.drones]
    least, most = (duration_text(60.0 * value) for value in (min(minutes), max(minutes)))
    rotation = plan.document.rotation
    stays = least if least == most else f"{least} to {most}"
    batteries = number_text(rotation.batteries_for_24_h, "full battery", "full batteries")
    drones = number_text(rotation.drones_for_24_h, "drone", "drones")
    return [
        element(
            "p",
            f"A drone stays at its station for {stays}; then another has to take its place. To "
            "keep every station manned for 24 hours it takes ",
            element("strong", f"{batteries} and {drones}"),
            ", those counted that are in the air, on the way, or being made ready. A battery that "
            "is charged again in that time counts once more.",
        )
    ]


def _checks_in_words(draws: int, lost: OneDroneLost | None) -> list[Markup]:
    drawn = (
        f"was drawn {draws} times at random: the mean is what to expect, the worst is the poorest "
        f"of the {draws} draws."
    )
    after = (
        f"Each of the first four {drawn} For the lost drone, the mean is over all drones, and the "
        "worst is the drone that is missed most."
        if lost is not None
        else f"Each {drawn} With one drone there is no other that could take over if it is lost."
    )
    return [
        element(
            "p",
            "What if things are not as they were told? The same plan was judged again with people "
            "50 or 150 m from where they were said to be, with obstacles that weaken the radio "
            "signal here and strengthen it there (",
            element("dfn", "shadowing"),
            "), after ten minutes in which people walk about",
            "." if lost is None else ", and with each drone missing in turn.",
            f" {after}",
        )
    ]


def _drawn_cases(robustness: Robustness) -> dict[str, DrawnFigures]:
    return {
        f"positions 50{UNBREAKABLE}m wrong": robustness.position_error_50m,
        f"positions 150{UNBREAKABLE}m wrong": robustness.position_error_150m,
        "shadowing": robustness.shadowing,
        "people walk for ten minutes": robustness.walking_10_minutes,
    }


def _drawn_table(
    people: PeopleServed, cases: dict[str, DrawnFigures], lost: OneDroneLost | None
) -> Markup:
    has_want = people.share_above_want is not None
    heads = ["If …", "People served", "Worst-off person", "Median"]
    heads += ["Wanted rate"] if has_want else []
    rows: list[list[str]] = [
        [
            "as planned",
            share_text(served(people) / people.total),
            _worst(people.worst_rate_bps),
            rate_text(people.median_rate_bps),
            *([_share(people.share_above_want)] if has_want else []),
        ]
    ]
    for name, one in cases.items():
        row = [
            _both(share_text(one.share_served), share_text(one.share_served_worst)),
            _both(_worst(one.worst_rate_bps), _worst(one.worst_rate_bps_worst)),
            _both(rate_text(one.median_rate_bps), rate_text(one.median_rate_bps_worst)),
        ]
        if has_want:
            row.append(_both(_share(one.share_above_want), _share(one.share_above_want_worst)))
        rows.append([name, *row])
    if lost is not None:
        shares = (lost.share_served, lost.share_served_worst)
        again = (lost.share_served_regained, lost.share_served_regained_worst)
        left, regained = [one.left for one in lost.each], [one.regained for one in lost.each]
        rows.append(["one drone lost, at once", *_without_one(shares, left, has_want)])
        rows.append(["one drone lost, others moved", *_without_one(again, regained, has_want)])
    return table("Means, and in brackets the worst", heads, rows)


def _without_one(
    shares: tuple[float, float], people: Sequence[PeopleServed], has_want: bool
) -> list[Markup]:
    """Cells of what is left: mean and worst over the drone that is lost."""
    worst_bps = [one.worst_rate_bps for one in people]
    medians_bps = [one.median_rate_bps for one in people]
    cells = [
        _both(*map(share_text, shares)),
        _both(_worst(mean(worst_bps)), _worst(min(worst_bps))),
        _both(rate_text(mean(medians_bps)), rate_text(min(medians_bps))),
    ]
    if has_want:
        above = [one.share_above_want or 0.0 for one in people]
        cells.append(_both(share_text(mean(above)), share_text(min(above))))
    return cells


def _losses(lost: OneDroneLost) -> list[Markup]:
    """Who takes over, drone by drone, the ones that are missed most first."""
    each = sorted(lost.each, key=lambda one: served(one.left))
    heads = ["Lost drone", "Served before", "Taken over at once by", "People served then"]
    heads += ["After the others moved", "That takes"]
    rows = [_loss(one) for one in each]
    parts = [
        element("h3", "If one drone is lost"),
        element(
            "p",
            "At once, the others stay where they are, and people turn to the drone or mast that "
            "they receive best. Then the others move to where they serve most.",
        ),
    ]
    caption = "Each drone lost in turn, the one that is missed most first"
    parts.append(table(caption, heads, rows[:_SHOWN_LOSSES]))
    if rows[_SHOWN_LOSSES:]:
        more = number_text(len(rows) - _SHOWN_LOSSES, "other drone", "other drones")
        rest = table(f"The {more}", heads, rows[_SHOWN_LOSSES:])
        parts.append(element("details", element("summary", f"The {more}"), rest))
    return parts


def _loss(one: DroneLost) -> list[str]:
    taken = sorted(one.taken_over.items(), key=lambda item: -item[1])
    nobody = one.people_before - sum(one.taken_over.values())
    words = [joined([element("bdi", name), f": {count:,}"]) for name, count in taken if count]
    if nobody:
        words.append(joined([element("strong", f"nobody: {nobody:,}")]))
    return [
        element("bdi", one.drone),
        people_text(one.people_before),
        joined(words, ", ") if words else "–",
        share_text(served(one.left) / one.left.total),
        share_text(served(one.regained) / one.regained.total),
        duration_text(one.regained_after_s),
    ]


def _fleet_in_words(plan: MappedPlan) -> list[Markup]:
    told = ["The same people were planned for with other numbers of drones."]
    if plan.want is not None:
        rate_bps, share = plan.want
        enough = [
            size.drones
            for size in plan.document.fleet_sizes
            if (size.people.share_above_want or 0.0) >= share
        ]
        wish = f"{rate_text(rate_bps)} or more for {share_text(share)} of all people"
        told.append(
            f"The least of these numbers that gives {wish} is {min(enough)}."
            if enough
            else f"None of these numbers gives {wish}."
        )
    return [element("p", " ".join(told))]


def _both(average: str, worst: str) -> Markup:
    return element("td", average, " ", element("small", f"({worst})"))


def _worst(rate_bps: float) -> str:
    return rate_text(rate_bps) if rate_bps else "nothing"


def _share(share: float | None) -> str:
    return "–" if share is None else share_text(share)
