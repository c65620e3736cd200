"""How long drones can stay, and what keeps their stations manned for a day (decision P5)."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from orchid_uav.envs.parameters import Parameters
from orchid_uav.envs.propulsion import propulsion_power_w, total_power_w
from orchid_uav.experiments.errors import InputError
from orchid_uav.experiments.planning.model import Station
from orchid_uav.experiments.planning.network import station_power_w
from orchid_uav.experiments.planning.result import Rotation

DAY_S = 86_400.0


class Battery(NamedTuple):
    """A charged battery, and what is not to be used of it."""

    capacity_wh: float
    reserve: float
    """Share that is left on landing."""

    @property
    def usable_j(self) -> float:
        """Energy of a flight."""
        return self.capacity_wh * 3600.0 * (1.0 - self.reserve)


class Way(NamedTuple):
    """The way to a station and back."""

    level_s: float
    """Time in level flight at cruise speed, both ways."""
    vertical_s: float
    """Time in which it climbs and descends, counted as hovering."""

    @property
    def seconds(self) -> float:
        """Both together."""
        return self.level_s + self.vertical_s


def endurance_s(
    parameters: Parameters, station: Station, battery: Battery, way: Way, cruise_mps: float
) -> float:
    """Time on station of one battery, way and reserve taken off, with the thrust of turns paid.

    Raises:
        InputError: the battery does not carry the drone there and back.
    """
    curve = parameters.rotor.power_curve()
    level_w = float(propulsion_power_w(cruise_mps, **curve))
    hover_w = float(propulsion_power_w(0.0, **curve))
    left_j = battery.usable_j - way.level_s * level_w - way.vertical_s * hover_w
    if left_j <= 0.0:
        raise InputError(
            f"{station.name} cannot stay: a battery of {battery.capacity_wh:g} Wh with "
            f"{battery.reserve:.0%} reserve does not carry it to its station and back "
            f"({way.seconds:.0f} s of flight); a larger --battery-wh, or --home nearer to people"
        )
    propulsion_w = station_power_w(
        parameters, station.circle_radius_m, station.speed_mps, with_thrust=True
    )
    return left_j / float(total_power_w(propulsion_w, station.transmit_power_w))


def rotation_of(endurances_s: Sequence[float], ways: Sequence[Way], swap_s: float) -> Rotation:
    """Drones and charged batteries that keep every station manned for 24 h.

    A drone that comes back gets another battery in ``swap_s``, and relieves the next station;
    the one that is relieved leaves when its successor has come.
    """
    rounds = [
        (stay_s + way.seconds + swap_s) / stay_s
        for stay_s, way in zip(endurances_s, ways, strict=True)
    ]
    return Rotation(
        batteries_for_24_h=sum(math.ceil(DAY_S / stay_s) for stay_s in endurances_s),
        drones_for_24_h=max(math.ceil(sum(rounds)), len(rounds) + 1),
    )
