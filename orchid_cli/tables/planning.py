"""The tables of ``orchid plan``."""

from typing import TYPE_CHECKING

from rich.console import Console

from orchid_uav.cli.console import print_line, print_table, print_text

if TYPE_CHECKING:
    from orchid_uav.experiments.planning.result import PlanDocument


def print_plan(out: Console, document: "PlanDocument") -> None:
    """Who is served, from where, and how many drones it takes."""
    people = document.people
    unserved = f"{people.unserved} not at all" if people.unserved else "nobody is left out"
    print_text(
        out,
        f"{people.total} people: {people.served_by_drones} served by drones, "
        f"{people.served_by_masts} by masts, {unserved}",
    )
    worst, median = _rate(people.worst_rate_bps), _rate(people.median_rate_bps)
    print_text(out, f"worst-off {worst}, half of all have {median} or more")
    columns = ["drone", "place", "altitude (m)", "people", "endurance (min)", "backhaul (dB)"]
    rows = []
    for drone in document.drones:
        place = f"{drone.east_m:.0f} m E, {drone.north_m:.0f} m N"
        if drone.lat is not None:
            place = f"{drone.lat:.6f}, {drone.lon:.6f}"
        backhaul = "–" if drone.backhaul_snr_db is None else f"{drone.backhaul_snr_db:.1f}"
        cells = (f"{drone.altitude_m:.0f}", f"{drone.people}", f"{drone.endurance_minutes:.0f}")
        rows.append([drone.id, place, *cells, backhaul])
    print_table(out, columns, rows)
    print_line(out, "")
    columns = ["drones", "served", "worst-off", "half have", "utility"]
    has_want = people.share_above_want is not None
    rows = []
    for size in document.fleet_sizes:
        row = [
            f"{size.drones}",
            f"{size.people.share_served:.1%}",
            _rate(size.people.worst_rate_bps),
            _rate(size.people.median_rate_bps),
            f"{size.utility:.3f}",
        ]
        if size.people.share_above_want is not None:
            row.append(f"{size.people.share_above_want:.1%}")
        rows.append(row)
    print_table(out, [*columns, *(["as wanted"] if has_want else [])], rows)
    if people.share_above_want is not None:
        print_text(out, _verdict(document, people.share_above_want))
    off = document.robustness.position_error_50m
    if off.share_above_want is not None:
        print_text(
            out,
            f"with people 50 m off, {off.share_above_want:.1%} have what is wanted (in the mean; "
            f"{off.share_above_want_worst:.1%} in the worst draw)",
        )
    rotation = document.rotation
    print_text(
        out,
        f"to keep all stations manned for 24 h: {rotation.drones_for_24_h} drones, "
        f"{rotation.batteries_for_24_h} charged batteries",
    )


def _verdict(document: "PlanDocument", share: float) -> str:
    """Whether what is wanted is had; if not, how many drones of the table would do."""
    settings = document.settings
    rate_bps, wanted = settings["plan.want_rate_bps"], settings["plan.want_share"]
    if not isinstance(rate_bps, int | float) or not isinstance(wanted, int | float):
        raise TypeError("a plan with a share of those who have what they want says what that is")
    told = f"wanted: {_rate(rate_bps)} for {wanted:.0%} of the people; {share:.1%} have it"
    if share >= wanted:
        return f"{told}: enough"
    enough = [
        size.drones
        for size in document.fleet_sizes
        if size.people.share_above_want is not None and size.people.share_above_want >= wanted
    ]
    would = f"{min(enough)} drones would do" if enough else "no number above would do"
    return f"{told}: not enough, {would}"


def _rate(rate_bps: float) -> str:
    return f"{rate_bps / 1e6:.2f} Mbit/s" if rate_bps >= 1e6 else f"{rate_bps / 1e3:.0f} kbit/s"
