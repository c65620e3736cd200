"""Who is served by whom, as a table in metres: for plans that have no place on earth."""

import csv
import io

from orchid_uav.envs.plans.network import NOBODY
from orchid_uav.experiments.planning.maps.drawing import MappedPlan

COLUMNS = ("x_m", "y_m", "people", "served_by", "rate_bps")
"""``served_by`` is empty for those whom nobody serves."""


def people_csv(plan: MappedPlan) -> bytes:
    """Each position of people: how many they are, who serves them and how fast."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    names = plan.servers
    for (x_m, y_m), weight, server, rate_bps in zip(
        plan.people.positions_m.tolist(),
        plan.people.weights.tolist(),
        plan.server.tolist(),
        plan.rates_bps.tolist(),
        strict=True,
    ):
        served_by = "" if server == NOBODY else names[server]
        rows.writerow([round(x_m, 3), round(y_m, 3), weight, served_by, round(rate_bps)])
    return text.getvalue().encode()
