"""A plan as Python sees it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PrivateAttr

from orchid_uav.experiments.configuration import Layer
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.files import Given, check_free, task_of, write_plan
from orchid_uav.experiments.planning.planner import Firmware, Planned, PlanningListener, make_plan
from orchid_uav.experiments.planning.reading.cells import check_position, weight_of
from orchid_uav.experiments.planning.reading.nearness import check_nearness
from orchid_uav.experiments.planning.reading.places import parse_budget, parse_want
from orchid_uav.experiments.planning.reading.table import PeopleTable, Rows
from orchid_uav.experiments.planning.result import PlanDocument
from orchid_uav.experiments.planning.settings import PlanConfig, plan_configuration


class Plan(PlanDocument):
    """A plan: what ``plan.json`` says, as attributes."""

    _planned: Planned = PrivateAttr()

    def write(self, directory: str | Path | None = None, firmware: Firmware = "both") -> Path:
        """Write all files into a new or empty directory, or none; returns the directory.

        Raises:
            InputError: the directory is not empty.
            RunFailedError: the files cannot be written.
        """
        out = None if directory is None else Path(directory)
        check_free(out)
        return write_plan(self._planned, out, firmware)


def plan_of(
    people: str | Path | ArrayLike,
    *,
    drones: int | str,
    want: str | None,
    masts: Sequence[str],
    home: str | None,
    area: str | Path | None,
    no_fly: str | Path | None,
    weights: ArrayLike | None,
    in_metres: bool,
    budget: str,
    method: str,
    settings: Mapping[str, Any],
) -> Plan:
    """See :func:`orchid_uav.experiments.planning.plan`."""
    if isinstance(people, str | Path):
        if weights is not None or in_metres:
            raise InputError(
                f"{people} says itself what people weigh and what its columns are: leave out "
                "weights and in_metres"
            )
        where: Path | PeopleTable = Path(people)
    else:
        where = _table_of(people, weights, in_metres)
    values = {_key_of(name): value for name, value in settings.items()}
    values["plan.drones"] = None if drones == "auto" else drones
    if want is not None:
        values["plan.want_rate_bps"], values["plan.want_share"] = parse_want(want)
    config, _ = plan_configuration([Layer("plan()", values)])
    given = Given(
        where,
        masts,
        home,
        None if area is None else Path(area),
        None if no_fly is None else Path(no_fly),
    )
    task = task_of(given, config, parse_budget(budget), method)
    planned = make_plan(task, ["orchid_uav.experiments.planning.plan"], PlanningListener())
    plan = Plan.from_json(planned.mapped.document.to_json())
    plan._planned = planned
    return plan


def _key_of(name: str) -> str:
    try:
        return PlanConfig.locate(name)
    except ValueError as error:
        raise InputError(str(error)) from error


def _table_of(people: ArrayLike, weights: ArrayLike | None, in_metres: bool) -> PeopleTable:
    positions = np.asarray(people, np.float64)
    if positions.ndim != 2 or positions.shape[1] != 2:
        raise InputError(f"people have the shape {positions.shape}, not (people, 2)")
    counts = np.ones(len(positions), np.int64) if weights is None else np.asarray(weights)
    if counts.shape != (len(positions),):
        raise InputError(f"weights have the shape {counts.shape}, not {(len(positions),)}")
    rows = Rows(Path("people"), on_earth=not in_metres)
    for number, (position, count) in enumerate(
        zip(positions.tolist(), counts.tolist(), strict=True)
    ):
        rows.count()
        source = f"people[{number}]"
        try:
            check_position(position[0], position[1], not in_metres)
            rows.add(source, (position[0], position[1]), weight_of(count))
        except ValueError as error:
            rows.problems.add(source, str(error))
    table = rows.table([])
    check_nearness(table)
    return table
