"""Plans for real places: from where people are to where drones circle.

:func:`plan` does from Python what ``orchid plan`` does; ``docs/planning.md`` says what that is.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from orchid_uav.experiments.planning.planned import Plan


def plan(
    people: str | Path | ArrayLike,
    *,
    drones: int | str = 6,
    want: str | None = None,
    masts: Sequence[str] = (),
    home: str | None = None,
    area: str | Path | None = None,
    no_fly: str | Path | None = None,
    weights: ArrayLike | None = None,
    in_metres: bool = False,
    budget: str = "5s",
    method: str = "planner",
    **settings: Any,
) -> "Plan":
    """Plan stations of drones; what is left out is as in ``orchid plan``.

    Args:
        people: a file, or positions (P, 2): latitude and longitude in degrees.
        drones: number of drones, or "auto": the least that meets ``want``.
        want: a rate and a share of people, like "1Mbps:95%".
        masts: "LAT,LON[,HEIGHT_M]" each.
        home: "LAT,LON[,AMSL_M]".
        area: a file with polygons that drones stay in.
        no_fly: a file with polygons that drones keep out of.
        weights: people that each position stands for, (P,), where ``people`` are positions.
        in_metres: positions are metres to the east and north instead, and so are places.
        budget: a time, or a number of plans to judge.
        method: "planner", "balanced", or a method of ``orchid eval`` or a run.
        settings: keys of the configuration, as ``battery_wh=500`` or ``**{"gbs.height_m": 25.0}``.

    Returns:
        The plan: its attributes are those of ``plan.json``, and ``write`` makes all files.

    Raises:
        InputError: something given is wrong, or cannot be had.
    """
    from orchid_uav.experiments.planning.planned import plan_of

    return plan_of(
        people,
        drones=drones,
        want=want,
        masts=masts,
        home=home,
        area=area,
        no_fly=no_fly,
        weights=weights,
        in_metres=in_metres,
        budget=budget,
        method=method,
        settings=settings,
    )
